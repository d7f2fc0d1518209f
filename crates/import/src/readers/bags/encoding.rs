//! Encodings of the messages in a bag.

use std::borrow::Cow;
use std::io::Read;

/// The format of the messages in a topic.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum TopicFormat {
    /// Positions in degrees, `sensor_msgs/NavSatFix`.
    NavSatFix,
    /// Positions in metres, `nav_msgs/Odometry`.
    Odometry,
    /// Text, `std_msgs/String`.
    Text,
    /// Bytes, `std_msgs/UInt8MultiArray` or `ByteMultiArray`.
    Bytes,
    /// JSON objects.
    Json,
    /// A type without information for the import.
    Other,
    /// An encoding that is not supported.
    OtherEncoding,
}

impl TopicFormat {
    /// Returns the format of a topic by its type and encoding.
    pub(crate) fn new(kind: &str, encoding: &str) -> Self {
        match (encoding, kind) {
            ("json", _) => Self::Json,
            ("cdr", "sensor_msgs/msg/NavSatFix") => Self::NavSatFix,
            ("cdr", "nav_msgs/msg/Odometry") => Self::Odometry,
            ("cdr", "std_msgs/msg/String") => Self::Text,
            ("cdr", "std_msgs/msg/UInt8MultiArray" | "std_msgs/msg/ByteMultiArray") => Self::Bytes,
            ("cdr", _) => Self::Other,
            _ => Self::OtherEncoding,
        }
    }
}

/// The first bytes of a message that is compressed with Zstandard. No message of another encoding begins with them.
const ZSTD_MAGIC: &[u8] = &[0x28, 0xb5, 0x2f, 0xfd];

/// Longest message after decompression, in bytes.
const MESSAGE_BYTES_MAX: u64 = 1 << 26;

/// Decompresses a message if it is compressed. Returns `None` if it is damaged or too long.
pub(crate) fn decompress(message: &[u8]) -> Option<Cow<'_, [u8]>> {
    if !message.starts_with(ZSTD_MAGIC) {
        return Some(Cow::Borrowed(message));
    }
    let mut plain = Vec::new();
    let mut decoder = zstd::stream::read::Decoder::with_buffer(message).ok()?.take(MESSAGE_BYTES_MAX + 1);
    decoder.read_to_end(&mut plain).ok()?;
    (plain.len() as u64 <= MESSAGE_BYTES_MAX).then_some(Cow::Owned(plain))
}
