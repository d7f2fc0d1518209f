//! A table that can be printed or written as Markdown.

use crate::output;

/// A table with a note.
pub struct Table {
    pub title: String,
    pub header: Vec<String>,
    pub rows: Vec<Vec<String>>,
    pub note: String,
}

impl Table {
    pub fn new(
        title: impl Into<String>,
        header: &[impl ToString],
        rows: Vec<Vec<String>>,
        note: impl Into<String>,
    ) -> Self {
        let header = header.iter().map(ToString::to_string).collect();
        Self { title: title.into(), header, rows, note: note.into() }
    }

    pub fn text(&self) -> String {
        let header: Vec<&str> = self.header.iter().map(String::as_str).collect();
        let table = output::table(&header, &self.rows);
        let note = if self.note.is_empty() { String::new() } else { format!("\n{}\n", self.note) };
        format!("{}\n\n{table}\n{note}", self.title)
    }

    /// Formats the table as Markdown. Names may contain characters that Markdown reads as cell borders or HTML.
    pub fn markdown(&self) -> String {
        let escaped = |cell: &String| cell.replace('&', "&amp;").replace('<', "&lt;").replace('|', "\\|");
        let line = |cells: &[String]| format!("| {} |\n", cells.iter().map(escaped).collect::<Vec<_>>().join(" | "));
        let rules: Vec<String> = (0..self.header.len()).map(|n| if n == 0 { "---" } else { "---:" }.into()).collect();
        let rows: String = self.rows.iter().map(|row| line(row)).collect();
        let note = if self.note.is_empty() { String::new() } else { format!("\n{}\n", self.note) };
        format!("**{}**\n\n{}{}{rows}{note}\n", self.title, line(&self.header), line(&rules))
    }
}
