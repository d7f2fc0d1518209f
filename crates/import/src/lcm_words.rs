//! The words of definitions of LCM types.

/// Names, numbers and signs, without remarks.
pub(crate) fn words(text: &str) -> Vec<String> {
    let mut words: Vec<String> = Vec::new();
    let mut rest = text;
    while let Some(first) = rest.chars().next() {
        if let Some(remark) = rest.strip_prefix("//") {
            rest = remark.split_once('\n').map_or("", |(_, rest)| rest);
        } else if let Some(remark) = rest.strip_prefix("/*") {
            rest = remark.split_once("*/").map_or("", |(_, rest)| rest);
        } else {
            let is_part = |c: char| c.is_alphanumeric() || matches!(c, '_' | '.' | '-' | '+');
            let end = if is_part(first) { rest.find(|c| !is_part(c)).unwrap_or(rest.len()) } else { first.len_utf8() };
            let (word, after) = rest.split_at(end);
            words.extend((!word.trim().is_empty()).then(|| word.to_owned()));
            rest = after;
        }
    }
    words
}
