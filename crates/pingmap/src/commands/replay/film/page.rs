//! The page of a film: one self-contained HTML file.

use super::data::Film;
use crate::output::count;
use crate::page::Page;

/// Returns the page. `facts` are its provenance.
pub fn page(film: &Film, facts: &[(&str, String)]) -> anyhow::Result<String> {
    let mut page = Page::new("pingmap: film of a mission");
    page.paragraph(&format!(
        "The page shows {} at {} of the mission, equally spaced from the first event to the last. The colours are the \
         probability that a message from the chosen vehicle's position is received, as this vehicle predicted it at that time.",
        film.log,
        count(film.moments.len(), "time")
    ));
    page.embed(include_str!("film.html"));
    // A name in the data cannot end the script.
    let data = serde_json::to_string(film)?.replace('<', "\\u003c");
    page.embed(&format!("<script type=\"application/json\" id=\"film-data\">{data}</script>"));
    page.embed(concat!("<script>\n", include_str!("film.js"), "</script>"));
    page.heading("Provenance");
    page.facts(facts);
    Ok(page.finish())
}
