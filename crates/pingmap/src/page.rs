//! A page for browsers and printing with headings, text, tables and figures, all in one file.

use std::fmt::Write;

use crate::figure::Figure;

/// A page under construction.
pub struct Page {
    html: String,
    /// Number of figures so far. SVG ids must differ between figures.
    figures: usize,
}

impl Page {
    pub fn new(title: &str) -> Self {
        let html = format!("{HEAD}<h1>{}</h1>\n", escape(title));
        Self { html, figures: 0 }
    }

    pub fn heading(&mut self, text: &str) {
        // Writing to a String never fails.
        let _ = writeln!(self.html, "<h2>{}</h2>", escape(text));
    }

    pub fn paragraph(&mut self, text: &str) {
        let _ = writeln!(self.html, "<p>{}</p>", escape(text));
    }

    /// Adds a paragraph with the main result.
    pub fn conclusion(&mut self, text: &str) {
        let _ = writeln!(self.html, "<p class=\"conclusion\">{}</p>", escape(text));
    }

    /// Adds a table. On a narrow page each row becomes a list with the names of the columns.
    pub fn table(&mut self, header: &[impl AsRef<str>], rows: &[Vec<String>]) {
        let head: String =
            header.iter().map(|cell| format!("<th scope=\"col\">{}</th>", escape(cell.as_ref()))).collect();
        let row = |row: &Vec<String>| {
            let cells = header.iter().zip(row);
            let cells =
                cells.map(|(name, cell)| format!("<td data-name=\"{}\">{}</td>", escape(name.as_ref()), escape(cell)));
            format!("<tr>{}</tr>\n", cells.collect::<String>())
        };
        let body: String = rows.iter().map(row).collect();
        let _ = writeln!(
            self.html,
            "<table class=\"rows\">\n<thead><tr>{head}</tr></thead>\n<tbody>\n{body}</tbody></table>"
        );
    }

    /// Adds a table of names and facts.
    pub fn facts(&mut self, facts: &[(&str, String)]) {
        let rows = facts
            .iter()
            .map(|(name, fact)| format!("<tr><th scope=\"row\">{}</th><td>{}</td></tr>\n", escape(name), escape(fact)));
        let _ = writeln!(self.html, "<table class=\"facts\"><tbody>\n{}</tbody></table>", rows.collect::<String>());
    }

    /// Adds a figure with a caption, which is also its text alternative.
    pub fn figure(&mut self, figure: &Figure, caption: &str) {
        self.figures += 1;
        let svg = with_names_of_its_own(&figure.svg(false), self.figures);
        let caption = escape(caption);
        let _ = writeln!(
            self.html,
            "<figure role=\"img\" aria-label=\"{caption}\">{svg}<figcaption>{caption}</figcaption></figure>"
        );
    }

    /// Adds a part in HTML as it is, without escaping.
    pub fn embed(&mut self, html: &str) {
        self.html += html;
        self.html.push('\n');
    }

    /// Returns the finished page.
    pub fn finish(self) -> String {
        self.html + "</body>\n</html>\n"
    }
}

/// Appends a number to the ids within an SVG, because ids must differ on one page.
fn with_names_of_its_own(svg: &str, number: usize) -> String {
    let names = svg.split(" id=\"").skip(1).filter_map(|rest| rest.split('"').next());
    let mut names: Vec<&str> = names.collect();
    // Longer ids come first, since a shorter id may be the beginning of a longer one.
    names.sort_by_key(|name| std::cmp::Reverse(name.len()));
    names.dedup();
    names.into_iter().fold(svg.to_owned(), |svg, name| {
        let renamed = format!("{name}-of-{number}");
        svg.replace(&format!(" id=\"{name}\""), &format!(" id=\"{renamed}\""))
            .replace(&format!("#{name})"), &format!("#{renamed})"))
    })
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Colours follow the reader's device, light or dark; figures keep a white background. On a narrow page the rows of
/// tables become lists. In print no figure or row is divided between pages.
const HEAD: &str = "<!DOCTYPE html>
<html lang=\"en\">
<head>
<meta charset=\"utf-8\">
<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">
<meta name=\"color-scheme\" content=\"light dark\">
<title>pingmap report</title>
<style>
:root { --ink: #222; --paper: #fff; --line: #ddd; --stress: #eef3f8; }
@media (prefers-color-scheme: dark) { :root { --ink: #e4e4e4; --paper: #15181c; --line: #3a3f46; --stress: #22303d; } }
body { font: 16px/1.5 'DejaVu Sans', Verdana, sans-serif; max-width: 76rem; margin: 2rem auto; padding: 0 1rem; color: var(--ink); background: var(--paper); overflow-wrap: anywhere; }
p, figcaption { max-width: 62rem; }
h1 { font-size: 1.6rem; line-height: 1.25; }
h2 { font-size: 1.25rem; margin-top: 2.2rem; }
.conclusion { font-size: 1.1rem; padding: .8rem 1rem; background: var(--stress); border-left: 4px solid #0571b0; }
table { border-collapse: collapse; font-size: .92rem; margin: 1rem 0; max-width: 100%; }
.rows { overflow-wrap: normal; }
th, td { padding: .25rem .6rem; text-align: right; border-bottom: 1px solid var(--line); font-variant-numeric: tabular-nums; vertical-align: top; }
th:first-child, td:first-child { text-align: left; }
.facts td { text-align: left; overflow-wrap: anywhere; }
@media screen and (max-width: 72rem) {
  .rows thead { display: none; }
  .rows tr { display: block; padding: .4rem 0; border-bottom: 1px solid var(--line); }
  .rows td { display: flex; justify-content: space-between; gap: 1rem; padding: .1rem 0; border: 0; overflow-wrap: anywhere; }
  .rows td::before { content: attr(data-name); text-align: left; }
}
figure { margin: 1rem 0; }
figure svg { display: block; width: 36rem; max-width: 100%; height: auto; background: #fff; }
figcaption { font-size: .9rem; margin-top: .4rem; }
@page { margin: 15mm; }
@media print {
  :root { --ink: #000; --paper: #fff; --line: #999; --stress: #fff; }
  body { max-width: none; margin: 0; padding: 0; font-size: 10pt; }
  table { font-size: 7.5pt; }
  th, td { padding: .15rem .35rem; }
  figure, tr, .conclusion { break-inside: avoid; }
  figure svg { max-height: 200mm; }
  h2 { break-after: avoid; }
}
</style>
</head>
<body>
";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_in_figures_are_unique() {
        let svg = "<clipPath id=\"clip\"/><clipPath id=\"clip2\"/><g clip-path=\"url(#clip)\"/><g clip-path=\"url(#clip2)\"/>";
        let second = with_names_of_its_own(svg, 2);
        let expected = "<clipPath id=\"clip-of-2\"/><clipPath id=\"clip2-of-2\"/><g clip-path=\"url(#clip-of-2)\"/><g clip-path=\"url(#clip2-of-2)\"/>";
        assert_eq!(second, expected);
    }

    #[test]
    fn names_are_escaped() {
        let mut page = Page::new("a < b");
        page.table(&["<name>"], &[vec!["\"x\" & y".into()]]);
        page.facts(&[("log", "<script>".into())]);
        let html = page.finish();
        assert!(html.contains("a &lt; b") && html.contains("&lt;name&gt;") && html.contains("&quot;x&quot; &amp; y"));
        assert!(!html.contains("<script>") && html.ends_with("</html>\n"));
    }
}
