//! NMEA 0183 sentences.

/// A sentence. `$CARXD,1,63,0,1,00*5A`, for example, has the name `CARXD` and five fields.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Sentence<'a> {
    pub(crate) name: &'a str,
    pub(crate) fields: Vec<&'a str>,
}

impl<'a> Sentence<'a> {
    /// Parses the sentence that starts at the first `$` of a text. Returns `None` without a sentence, or with a wrong
    /// checksum.
    pub(crate) fn parse(text: &'a str) -> Option<Self> {
        let body = &text[text.find('$')? + 1..];
        let is_right = |star: usize| {
            let sum = body.get(star + 1..star + 3).and_then(|sum| u8::from_str_radix(sum, 16).ok());
            sum == Some(nmea_checksum(&body[..star]))
        };
        // A text in the sentence may hold an asterisk, too.
        let body = match (body.find('*'), body.rfind('*')) {
            (Some(first), Some(last)) => &body[..[first, last].into_iter().find(|star| is_right(*star))?],
            _ => body.trim_end(),
        };
        let mut parts = body.split(',').map(str::trim);
        let name = parts.next().filter(|name| name.len() >= 4 && name.chars().all(|c| c.is_ascii_alphanumeric()))?;
        Some(Self { name, fields: parts.collect() })
    }

    /// Returns a field by its index, from 0; empty if it does not exist.
    pub(crate) fn field(&self, index: usize) -> &'a str {
        self.fields.get(index).copied().unwrap_or("")
    }

    /// Parses a field as a non-negative integer.
    pub(crate) fn number(&self, index: usize) -> Option<u32> {
        self.field(index).parse().ok()
    }
}

/// Returns the checksum of a sentence: the exclusive or of all bytes between `$` and `*`.
pub fn nmea_checksum(body: &str) -> u8 {
    body.bytes().fold(0, |sum, byte| sum ^ byte)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sentences_with_a_wrong_checksum_are_rejected() {
        let sum = nmea_checksum("CARXD,1,63,0,1,00FF");
        let text = format!("12:00 <- $CARXD,1,63,0,1,00FF*{sum:02x}\r");
        let sentence = Sentence::parse(&text).unwrap();
        assert_eq!((sentence.name, sentence.field(4), sentence.number(1)), ("CARXD", "00FF", Some(63)));
        assert_eq!((sentence.field(9), sentence.number(4)), ("", None));
        let text = format!("$CARXA,1,2,0,1,2*3*{:02X}\r\n", nmea_checksum("CARXA,1,2,0,1,2*3"));
        assert_eq!(Sentence::parse(&text).map(|sentence| sentence.field(4)), Some("2*3"));
        // A well-known sentence with its published checksum.
        assert!(Sentence::parse("$GPGLL,5300.97914,N,00259.98174,E,125926,A*28").is_some());
        assert!(Sentence::parse("$GPGLL,5300.97915,N,00259.98174,E,125926,A*28").is_none());
        assert!(Sentence::parse("$CATXF,32 ").is_some_and(|sentence| sentence.number(0) == Some(32)));
        for text in ["", "CATXF,32", "$", "$,,", "$CATXF,32*", "$CATXF,32*G0", "$CA\u{e9}\u{e9},1", "$CATXF*\u{e9}"] {
            assert!(Sentence::parse(text).is_none(), "{text}");
        }
    }
}
