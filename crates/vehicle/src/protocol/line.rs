//! Lines of JSON in both directions.

use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::protocol::fault::{Fault, FaultCode};
use crate::protocol::input::Input;
use crate::protocol::output::Message;
use crate::protocol::unique_keys::UniqueKeys;

/// Longest line in bytes, without its end.
pub const LINE_BYTES_MAX: usize = 64 * 1024;

/// Defines [`TYPES`], and `read_fields` that reads the fields of a message of one of these types.
macro_rules! types {
    ($($name:literal => $input:expr,)*) => {
        /// Types of messages from a host.
        const TYPES: &[&str] = &[$($name),*];

        /// Reads the fields of a message. `None` if its type is unknown.
        fn read_fields(name: &str, fields: Value) -> Option<Result<Input, Fault>> {
            match name {
                $($name => Some(typed(fields, $input)),)*
                _ => None,
            }
        }
    };
}

types! {
    "hello" => Input::Hello,
    "nav" => Input::Nav,
    "peer" => Input::Peer,
    "sent" => Input::Sent,
    "not_sent" => Input::NotSent,
    "heard" => Input::Heard,
    "listening" => Input::Listening,
    "nmea" => Input::Nmea,
    "frame_in" => Input::FrameIn,
    "piggyback_in" => Input::PiggybackIn,
    "frame_request" => Input::FrameRequest,
    "departed" => Input::Departed,
    "dropped" => Input::Dropped,
    "piggyback_request" => Input::PiggybackRequest,
    "predict" => Input::Predict,
    "status" => |_: NoFields| Input::Status {},
    "stop" => |_: NoFields| Input::Stop {},
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct NoFields {}

/// Reads one line from a host.
///
/// # Errors
/// [`Fault`] for a line that is too long, is not a JSON object, or whose type or fields are wrong.
pub fn read_line(line: &[u8]) -> Result<Input, Fault> {
    if line.len() > LINE_BYTES_MAX {
        return Err(too_long(line.len()));
    }
    let UniqueKeys(value) = serde_json::from_slice(line)
        .map_err(|error| Fault::new(FaultCode::NotJson, format!("the line is not JSON: {error}")))?;
    let Value::Object(mut fields) = value else {
        return Err(Fault::new(FaultCode::NotJson, "the line is JSON, but not an object"));
    };
    let name = fields.remove("type");
    let read = name.as_ref().and_then(Value::as_str).and_then(|name| read_fields(name, fields.into()));
    read.unwrap_or_else(|| {
        let found = name.map_or("none".into(), |name| name.to_string());
        Err(Fault::of_field(FaultCode::UnknownType, "type", found, format!("one of {}", TYPES.join(", "))))
    })
}

/// Reads fields of one type, and makes a message of them.
fn typed<T: DeserializeOwned>(fields: Value, input: impl FnOnce(T) -> Input) -> Result<Input, Fault> {
    serde_path_to_error::deserialize(fields).map(input).map_err(|error| {
        let path = error.path().to_string();
        let problem = error.into_inner().to_string();
        // The text names unknown and missing fields in backticks.
        let field = if path == "." { problem.split('`').nth(1).unwrap_or("line").to_owned() } else { path };
        let (found, expected) = match problem.split_once(", expected ") {
            Some((found, expected)) => (found.to_owned(), Some(expected.to_owned())),
            None => (problem.clone(), None),
        };
        let message = format!("{field}: {problem}");
        Fault { code: FaultCode::WrongField, field: Some(field), found: Some(found), expected, message }
    })
}

/// Returns the fault of a line with this number of bytes.
pub(crate) fn too_long(bytes: usize) -> Fault {
    let expected = format!("at most {LINE_BYTES_MAX} bytes");
    Fault::of_field(FaultCode::LineTooLong, "line", format!("{bytes} bytes"), expected)
}

/// Returns a message as one line without its end.
pub fn write_line(message: &Message) -> String {
    // Maps have texts as keys and numbers are finite, so that this cannot fail.
    serde_json::to_string(message).unwrap_or_else(|error| {
        let fault = Fault::new(FaultCode::Failed, format!("an answer could not be written: {error}"));
        serde_json::json!({ "type": "error", "input": 0, "code": fault.code, "message": fault.message }).to_string()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wrong_field_is_named_with_what_was_found_and_expected() {
        let fault = |line: &str| read_line(line.as_bytes()).unwrap_err();
        let named = |line: &str| fault(line).field.unwrap();
        assert_eq!(named(r#"{"type":"nav","time":1,"position":{"x":"east"}}"#), "position.x");
        assert_eq!(named(r#"{"type":"nav","position":{}}"#), "time");
        assert_eq!(named(r#"{"type":"status","more":1}"#), "more");
        assert_eq!(named(r#"{"type":"predict","links":[{"from":"a","to":"b"},{"from":"a"}]}"#), "links[1]");
        let wrong = fault(r#"{"type":"sent","time":"noon"}"#);
        assert_eq!(wrong.found.as_deref(), Some("invalid type: string \"noon\""));
        assert_eq!(wrong.expected.as_deref(), Some("f64"));
        assert_eq!(wrong.message, "time: invalid type: string \"noon\", expected f64");
    }

    #[test]
    fn a_repeated_key_is_refused_at_every_depth() {
        for line in [
            r#"{"type":"nav","time":1,"time":2,"position":{"x":1,"y":2}}"#,
            r#"{"type":"nav","time":1,"position":{"x":1,"y":2,"x":1}}"#,
            r#"{"type":"predict","links":[{"from":"a","to":"b","to":"c"}]}"#,
            r#"{"type":"status","type":"stop"}"#,
        ] {
            let fault = read_line(line.as_bytes()).unwrap_err();
            assert_eq!(fault.code, FaultCode::NotJson, "{line}");
            assert!(fault.message.contains("is repeated at line 1 column"), "{}", fault.message);
        }
    }

    #[test]
    fn values_are_read_as_by_the_library() {
        let line = r#"{"a":[null,true,-1,18446744073709551615,1.5e300,"\u00e9\n",{"b":{}}],"c":-0.0,"d":1e-7}"#;
        let UniqueKeys(value) = serde_json::from_str(line).unwrap();
        assert_eq!(value, serde_json::from_str::<Value>(line).unwrap());
    }
}
