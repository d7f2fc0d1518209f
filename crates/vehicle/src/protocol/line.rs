//! Lines of JSON in both directions.

use serde_json::Value;

use crate::protocol::fault::{Fault, FaultCode};
use crate::protocol::input::Input;
use crate::protocol::output::Message;

/// Longest line in bytes, without its end.
pub const LINE_BYTES_MAX: usize = 64 * 1024;

/// Types of messages from a host.
const TYPES: [&str; 17] = [
    "hello",
    "nav",
    "peer",
    "sent",
    "not_sent",
    "heard",
    "listening",
    "nmea",
    "frame_in",
    "piggyback_in",
    "frame_request",
    "departed",
    "dropped",
    "piggyback_request",
    "predict",
    "status",
    "stop",
];

/// Reads one line from a host.
///
/// # Errors
/// [`Fault`] for a line that is too long, is not a JSON object, or whose type or fields are wrong.
pub fn read_line(line: &[u8]) -> Result<Input, Fault> {
    if line.len() > LINE_BYTES_MAX {
        return Err(too_long(line.len()));
    }
    let value: Value = serde_json::from_slice(line)
        .map_err(|error| Fault::new(FaultCode::NotJson, format!("the line is not JSON: {error}")))?;
    let Value::Object(object) = &value else {
        return Err(Fault::new(FaultCode::NotJson, "the line is JSON, but not an object"));
    };
    match object.get("type") {
        Some(Value::String(name)) if TYPES.contains(&name.as_str()) => {}
        found => {
            let found = found.map_or("none".into(), Value::to_string);
            return Err(Fault::of_field(FaultCode::UnknownType, "type", found, format!("one of {}", TYPES.join(", "))));
        }
    }
    // The text of the error names the field and what was expected.
    serde_json::from_value(value).map_err(|error| Fault::new(FaultCode::WrongField, error.to_string()))
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
