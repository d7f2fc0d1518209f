//! Comparison of text with golden files. `PINGMAP_WRITE_GOLDEN=1` rewrites the files instead.

use std::{env, fs, path::Path};

/// Compares `found` with the file at `path`, relative to the crate, or rewrites the file.
pub fn check(path: &str, found: &str) {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(path);
    if env::var_os("PINGMAP_WRITE_GOLDEN").is_some_and(|value| value == "1") {
        fs::write(file, found).unwrap();
        return;
    }
    let expected = fs::read_to_string(file).unwrap();
    let mismatch = found.lines().zip(expected.lines()).position(|(found, expected)| found != expected);
    assert!(
        found == expected,
        "{path} differs, first in line {}; PINGMAP_WRITE_GOLDEN=1 rewrites it. It should be:\n{found}",
        mismatch.unwrap_or_else(|| found.lines().count().min(expected.lines().count())) + 1
    );
}
