//! Objects as bytes: a mark, a version, the content in CBOR, and a checksum.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use serde::Serialize;
use serde::de::DeserializeOwned;

/// The first bytes of every object.
const MARK: &[u8] = b"dgpc";

/// The version of the format.
const VERSION: u8 = 1;

/// Number of bytes of the checksum, at the end.
const CHECKSUM: usize = 4;

/// Returns an object as bytes.
pub fn encode(object: &impl Serialize) -> PyResult<Vec<u8>> {
    let mut bytes = [MARK, &[VERSION]].concat();
    ciborium::into_writer(object, &mut bytes).map_err(|error| PyValueError::new_err(error.to_string()))?;
    bytes.extend(crc32fast::hash(&bytes).to_le_bytes());
    Ok(bytes)
}

/// Returns the object of the bytes. Refuses other bytes, damaged bytes and those of a newer version.
pub fn decode<T: DeserializeOwned>(bytes: &[u8]) -> PyResult<T> {
    let refuse = |reason: String| Err(PyValueError::new_err(reason));
    let Some([version, rest @ ..]) = bytes.strip_prefix(MARK) else {
        return refuse("these bytes are no object of dgpc".to_owned());
    };
    if *version > VERSION {
        return refuse(format!("these bytes have version {version}; this package reads versions up to {VERSION}"));
    }
    let Some((content, checksum)) = rest.split_last_chunk::<CHECKSUM>() else {
        return refuse("these bytes are incomplete".to_owned());
    };
    if crc32fast::hash(&bytes[..bytes.len() - CHECKSUM]).to_le_bytes() != *checksum {
        return refuse("these bytes are damaged: the checksum differs".to_owned());
    }
    ciborium::from_reader(content).or_else(|error| refuse(format!("these bytes are damaged: {error}")))
}

/// Returns the parts of a pickle for an object that has `to_bytes` and a static `from_bytes`.
pub fn reduce(object: &Bound<'_, PyAny>) -> PyResult<(Py<PyAny>, (Py<PyAny>,))> {
    let read = object.get_type().getattr("from_bytes")?;
    Ok((read.unbind(), (object.call_method0("to_bytes")?.unbind(),)))
}
