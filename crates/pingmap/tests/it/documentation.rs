//! Pages of the documentation: all pages are in the book, and all links resolve.

use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Returns the relative links of a text, without addresses and anchors in the same page.
fn links(text: &str) -> Vec<String> {
    let links = text.split("](").skip(1).filter_map(|rest| rest.split(')').next());
    let links =
        links.filter(|link| !link.contains("://") && !link.starts_with('#') && !link.contains(char::is_whitespace));
    links.map(|link| link.split('#').next().unwrap_or(link).to_owned()).collect()
}

#[test]
fn every_page_is_in_the_book_and_links_resolve() {
    let docs = root().join("docs");
    let summary = std::fs::read_to_string(docs.join("SUMMARY.md")).unwrap();
    let listed = links(&summary);
    let mut pages = vec![root().join("README.md"), root().join("ARCHITECTURE.md"), root().join("examples/README.md")];
    for entry in std::fs::read_dir(&docs).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        if name.ends_with(".md") {
            assert!(name == "SUMMARY.md" || listed.contains(&name), "docs/SUMMARY.md lacks {name}");
            pages.push(path);
        }
    }
    let mut count = 0;
    for page in pages {
        let text = std::fs::read_to_string(&page).unwrap();
        for link in links(&text) {
            // Links out of the book do not resolve in the book.
            let is_in_book = page.parent() == Some(&docs) && !page.ends_with("mathematics.md");
            assert!(!is_in_book || !link.starts_with(".."), "{} links out of the book: {link}", page.display());
            let target = page.parent().unwrap().join(&link);
            assert!(target.exists(), "{} links to {link}, which does not exist", page.display());
            count += 1;
        }
    }
    assert!(count > 20, "{count}");
}
