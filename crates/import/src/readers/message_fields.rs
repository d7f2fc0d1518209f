//! Fields of a message, identified by the names of its JSON or LCM members.

use serde_json::{Map, Value};

use crate::readers::tables::roles::{TableKind, column_role};

/// The fields of a position, a reception or a transmission.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct MessageFields {
    pub(crate) latitude: Option<f64>,
    pub(crate) longitude: Option<f64>,
    pub(crate) easting: Option<f64>,
    pub(crate) northing: Option<f64>,
    pub(crate) depth: Option<f64>,
    pub(crate) source: Option<String>,
    pub(crate) destination: Option<String>,
    pub(crate) good: Option<bool>,
    pub(crate) sent: Option<bool>,
    pub(crate) frame: Option<u32>,
    pub(crate) frames: Option<u32>,
    pub(crate) kind: Option<String>,
    /// Whether a satellite receiver states that it has no fix.
    pub(crate) has_no_fix: bool,
    /// Whether the fields are ambiguous or invalid: two sources, or a value of the wrong type.
    pub(crate) is_ambiguous: bool,
    /// Texts that may contain the sentences of a modem.
    pub(crate) texts: Vec<String>,
}

impl MessageFields {
    /// Parses a JSON object; `None` for any other text.
    pub(crate) fn from_json(text: &str) -> Option<Self> {
        let members: Map<String, Value> = serde_json::from_str(text).ok()?;
        let mut fields = Self::default();
        for (name, value) in &members {
            match value {
                Value::Bool(flag) => fields.flag(name, *flag),
                Value::Number(number) => fields.number(name, number.as_f64()?),
                Value::String(text) => fields.text(name, text),
                // `sensor_msgs/NavSatFix` states the lack of a fix in `status.status`.
                Value::Object(inner) if name == "status" => {
                    fields.has_no_fix = inner.get("status").and_then(Value::as_i64).is_some_and(|status| status < 0);
                }
                _ => {}
            }
        }
        Some(fields)
    }

    /// Sets the field that a member's name denotes, from a number. The first of several positions counts.
    pub(crate) fn number(&mut self, name: &str, number: f64) {
        let place = match column_role(TableKind::Navigation, name) {
            Some("latitude") => Some(&mut self.latitude),
            Some("longitude") => Some(&mut self.longitude),
            Some("easting") => Some(&mut self.easting),
            Some("northing") => Some(&mut self.northing),
            Some("depth") => Some(&mut self.depth),
            _ => None,
        };
        if let Some(place) = place {
            place.get_or_insert(number);
            return;
        }
        let whole = (number >= 0.0 && number.fract() == 0.0 && number < 9e15).then_some(number as u64);
        match column_role(TableKind::Receptions, name) {
            // A negative number stands for no source.
            Some("source") => self.set_source(whole.map(|whole| whole.to_string())),
            Some("destination") => self.destination = self.destination.take().or(whole.map(|whole| whole.to_string())),
            Some("good") => self.good = self.good.or(Some(number != 0.0)),
            Some("frame") => self.frame = self.frame.or(whole.and_then(|whole| whole.try_into().ok())),
            Some("frames") => self.frames = self.frames.or(whole.and_then(|whole| whole.try_into().ok())),
            // A number named `sent` is a counter and not a flag, so it is ignored.
            _ => {}
        }
    }

    /// Sets the field that a member's name denotes, from a Boolean.
    pub(crate) fn flag(&mut self, name: &str, flag: bool) {
        match column_role(TableKind::Receptions, name) {
            Some("good") => self.good = self.good.or(Some(flag)),
            _ if name.eq_ignore_ascii_case("sent") => self.sent = self.sent.or(Some(flag)),
            _ => {}
        }
    }

    /// Sets the field that a member's name denotes, from a text.
    pub(crate) fn text(&mut self, name: &str, text: &str) {
        let is_number = text.parse::<f64>().ok();
        match column_role(TableKind::Receptions, name) {
            Some("source") => self.set_source(Some(text.to_owned()).filter(|text| !text.is_empty())),
            Some("destination") => self.destination = self.destination.take().or(Some(text.to_owned())),
            Some("good") => match pingmap_trial::flag(text) {
                Some(flag) => self.flag(name, flag),
                None => self.is_ambiguous = true,
            },
            Some("frame" | "frames") => match is_number {
                Some(number) => self.number(name, number),
                None => self.is_ambiguous |= !text.is_empty(),
            },
            _ if name.eq_ignore_ascii_case("kind") => self.kind = self.kind.take().or(Some(text.to_owned())),
            _ if matches!(column_role(TableKind::Navigation, name), Some("time" | "vehicle") | None) => {
                self.texts.push(text.to_owned());
            }
            _ => match is_number {
                Some(number) => self.number(name, number),
                None => self.is_ambiguous |= !text.is_empty(),
            },
        }
    }

    fn set_source(&mut self, source: Option<String>) {
        self.is_ambiguous |= self.source.is_some() && source.is_some();
        self.source = self.source.take().or(source);
    }

    /// Returns the number of the received frame, from 1; `None` if it is not stated.
    ///
    /// Frame 0 of several is an error, because the counting may start at 0. Any other frame 0 counts as not stated.
    pub(crate) fn received_frame(&self) -> Result<Option<u32>, ()> {
        match self.frame {
            Some(0) if self.frames.is_some_and(|frames| frames > 1) => Err(()),
            frame => Ok(frame.filter(|frame| *frame > 0)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn members_have_the_names_of_columns() {
        let fields =
            MessageFields::from_json(r#"{"from":"auv2","to":63,"crc_ok":false,"frame":2,"frames":"3","kind":"short"}"#)
                .unwrap();
        assert_eq!((fields.source.as_deref(), fields.destination.as_deref()), (Some("auv2"), Some("63")));
        assert_eq!((fields.good, fields.frame, fields.frames, fields.sent), (Some(false), Some(2), Some(3), None));
        let place =
            MessageFields::from_json(r#"{"lat":41.5,"lon":"-70.5","depth":null,"status":{"status":-1}}"#).unwrap();
        assert_eq!(
            (place.latitude, place.longitude, place.depth, place.has_no_fix),
            (Some(41.5), Some(-70.5), None, true)
        );
        assert_eq!(MessageFields::from_json("[1]"), None);
    }

    #[test]
    fn ambiguous_members_are_reported_as_unclear() {
        // A counter is not a flag. A message with two sources is ambiguous.
        assert_eq!(MessageFields::from_json(r#"{"sent":1}"#).unwrap(), MessageFields::default());
        let mut fields = MessageFields::default();
        fields.number("src", -1.0);
        fields.number("src", 2.0);
        assert!(!fields.is_ambiguous && fields.source.as_deref() == Some("2"));
        fields.number("src", 3.0);
        assert!(fields.is_ambiguous);
        for wrong in [r#"{"latitude":"here"}"#, r#"{"source":2,"good":"perhaps"}"#, r#"{"source":2,"frame":"first"}"#] {
            assert!(MessageFields::from_json(wrong).unwrap().is_ambiguous, "{wrong}");
        }
        let frame = |text| MessageFields::from_json(text).unwrap().received_frame();
        assert_eq!(frame(r#"{"frame":0,"frames":3}"#), Err(()));
        assert_eq!((frame(r#"{"frame":0}"#), frame(r#"{"frame":2,"frames":3}"#)), (Ok(None), Ok(Some(2))));
    }
}
