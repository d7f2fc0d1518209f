//! Pages of the documentation: all pages are in the book, all links and citations resolve, and all named items exist.

use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize().unwrap()
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// Returns all files under a folder whose names have one of these extensions.
fn files(folder: &Path, extensions: &[&str]) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            if path.file_name().is_none_or(|name| name != "target") {
                found.extend(files(&path, extensions));
            }
        } else if path.extension().is_some_and(|extension| extensions.iter().any(|one| extension == *one)) {
            found.push(path);
        }
    }
    found
}

/// Returns the pages of the book, without its table of contents.
fn book() -> Vec<PathBuf> {
    let mut pages = files(&root().join("docs"), &["md"]);
    pages.retain(|page| !page.ends_with("SUMMARY.md"));
    pages
}

/// Returns all pages of the project whose links and citations are checked.
fn pages() -> Vec<PathBuf> {
    let outside =
        ["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "examples/README.md"].map(|name| root().join(name));
    [book(), files(&root().join("crates/dgpc/docs"), &["md"]), outside.to_vec()].concat()
}

/// Returns a page with the text of the files that it includes.
fn read_with_includes(page: &Path) -> String {
    let lines = read(page);
    let lines = lines.lines().map(|line| match line.strip_prefix("{{#include ") {
        Some(rest) => read(&page.parent().unwrap().join(rest.trim_end_matches("}}"))),
        None => line.to_owned(),
    });
    lines.collect::<Vec<_>>().join("\n")
}

/// Returns the relative links of a text, without addresses, intra-doc links and code.
fn links(text: &str) -> Vec<String> {
    let inline = text.split("](").skip(1).filter_map(|rest| rest.split(')').next());
    let definitions = text.lines().filter(|line| line.starts_with('[')).filter_map(|line| line.split_once("]: "));
    let links = inline.chain(definitions.map(|(_, target)| target));
    let links = links.filter(|link| !link.contains("::") && !link.contains("://"));
    links.filter(|link| !link.contains(char::is_whitespace)).map(str::to_owned).collect()
}

/// Returns the anchors of the headings of a text, as mdBook and GitHub form them.
fn anchors(text: &str) -> Vec<String> {
    let headings = text.lines().filter(|line| line.starts_with('#'));
    let headings = headings.map(|line| line.trim_start_matches('#').trim().to_lowercase());
    let is_kept = |letter: &char| letter.is_alphanumeric() || "-_ ".contains(*letter);
    headings.map(|heading| heading.chars().filter(is_kept).collect::<String>().replace(' ', "-")).collect()
}

#[test]
fn the_book_lists_every_page() {
    let docs = root().join("docs");
    let listed: Vec<PathBuf> = links(&read(&docs.join("SUMMARY.md"))).iter().map(|link| docs.join(link)).collect();
    for page in book() {
        assert!(listed.contains(&page), "docs/SUMMARY.md lacks {}", page.display());
    }
    assert!(listed.len() > 25, "{}", listed.len());
}

#[test]
fn links_resolve() {
    let docs = root().join("docs");
    let mut count = 0;
    for page in pages() {
        for link in links(&read(&page)) {
            let (file, anchor) = link.split_once('#').unwrap_or((&link, ""));
            let target = if file.is_empty() { page.clone() } else { page.parent().unwrap().join(file) };
            assert!(target.exists(), "{} links to {link}, which does not exist", page.display());
            let target = target.canonicalize().unwrap();
            // Links out of the book do not resolve in the book. Only the source of an included page is named.
            let is_source = target.starts_with(root().join("crates/dgpc/docs"));
            let leaves_book = page.starts_with(&docs) && !target.starts_with(&docs) && !is_source;
            assert!(!leaves_book, "{} links out of the book: {link}", page.display());
            // A page in the crate may link to a heading of its neighbour.
            let has_anchor = anchor.is_empty() || anchors(&read_with_includes(&target)).iter().any(|one| one == anchor);
            assert!(has_anchor, "{} links to {link}: no such heading", page.display());
            count += 1;
        }
    }
    assert!(count > 150, "{count}");
}

/// Returns the paths of pages that a text cites, relative to the root of the project.
fn cited_pages(text: &str) -> Vec<String> {
    let mut cited = Vec::new();
    for (at, _) in text.match_indices("docs/") {
        let is_in_path = |letter: char| letter.is_ascii_alphanumeric() || "/-_.".contains(letter);
        let start = text[..at].rfind(|letter| !is_in_path(letter)).map_or(0, |end| end + 1);
        let path = text[start..].split(|letter| !is_in_path(letter)).next().unwrap();
        let before = text[..start].chars().last();
        // Only text in words and parentheses cites pages: strings of the code are paths of other places.
        if path.ends_with(".md") && !path.starts_with('.') && before != Some('"') && before != Some('{') {
            cited.push(path.to_owned());
        }
    }
    cited
}

#[test]
fn pages_cited_in_the_sources_exist() {
    let mut count = 0;
    for file in [files(&root().join("crates"), &["rs"]), pages()].concat() {
        let text = read(&file);
        let comments = text.lines().filter(|line| file.extension().unwrap() == "md" || line.contains("//"));
        for path in cited_pages(&comments.collect::<Vec<_>>().join("\n")) {
            assert!(root().join(&path).exists(), "{} cites {path}, which does not exist", file.display());
            count += 1;
        }
    }
    assert!(count > 20, "{count}");
}

/// Returns whether a source file of a crate defines the item.
fn defines(sources: &str, name: &str) -> bool {
    let kinds = ["fn ", "struct ", "enum ", "const ", "mod "];
    kinds.iter().any(|kind| {
        let definition = format!("pub {kind}{name}");
        sources.match_indices(&definition).any(|(at, _)| {
            !sources[at + definition.len()..].starts_with(|letter: char| letter.is_alphanumeric() || letter == '_')
        })
    })
}

#[test]
fn items_named_in_the_pages_exist() {
    let crates = ["dgpc", "pingmap_agent", "pingmap_trial"];
    let folders = ["dgpc", "agent", "trial"].map(|name| root().join("crates").join(name).join("src"));
    let sources = folders.map(|folder| files(&folder, &["rs"]).iter().map(|file| read(file)).collect::<String>());
    let mut count = 0;
    for page in pages() {
        let text = read(&page);
        // Every second part of a text that is split at backticks is code.
        for code in text.split('`').skip(1).step_by(2) {
            let Some((name, path)) = code.split_once("::") else { continue };
            let Some(at) = crates.iter().position(|one| *one == name) else { continue };
            for part in path.split("::") {
                assert!(defines(&sources[at], part), "{} names {code}, which does not exist", page.display());
                count += 1;
            }
        }
    }
    assert!(count > 60, "{count}");
}
