//! The forms of the map message, and the position of each of their bits.

use alloc::vec;
use alloc::vec::Vec;

use crate::authenticator::TAG_BITS;
use crate::bits::overwrite;
use crate::error::Error;
use crate::point::Point;
use crate::schema::{Field, Kind, Schema};
use crate::value::{Fields, numbers};
use crate::widths::id_bits;

/// The `.proto` file with all messages of this crate, for users of DCCL and Goby.
pub const PROTO: &str = include_str!("../proto/pingmap.proto");

/// Number of cells of the chart, east and north.
pub const HORIZONTAL_CELLS: u8 = 64;

/// Number of cells of the chart in depth.
pub const DEPTH_CELLS: u8 = 32;

/// Number of time cells. Cell 0 means no particular time.
pub const TIME_CELLS: u8 = 64;

/// Number of information levels. Level 0 marks an unused point.
pub const INFORMATION_LEVELS: u8 = 32;

/// Largest level of a partial correlation. Levels range from minus to plus this value.
pub const CORRELATION_LEVELS: i8 = 3;

/// Largest level of a mean. Levels range from minus to plus this value.
pub const MEAN_LEVELS: i8 = 15;

/// Number of distinct check numbers in plain messages.
const MODELS: u16 = 1 << 14;

/// A form of the map message: one for each frame size, with or without depth, plain or authenticated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    /// Name of the message in the `.proto`.
    pub name: &'static str,
    /// DCCL id, from the range for private use.
    pub id: u16,
    /// Size in bytes of the frame that the message fits into.
    pub frame_bytes: usize,
    /// Whether links have depths.
    pub has_depth: bool,
    /// Whether the message has an authentication tag of 8 bytes. The tag then covers the digest of the team's settings,
    /// and there is no check number.
    pub is_authenticated: bool,
    /// Number of blocks.
    pub blocks: usize,
    /// Number of inducing points in each block.
    pub points: usize,
}

/// All forms of the map message.
pub const LAYOUTS: [Layout; 12] = [
    layout("Map32", 124, 32, false, false, 1, 5),
    layout("MapAuthenticated32", 125, 32, false, true, 1, 4),
    layout("MapDepth32", 126, 32, true, false, 1, 4),
    layout("MapDepthAuthenticated32", 127, 32, true, true, 1, 3),
    layout("Map64", 128, 64, false, false, 2, 5),
    layout("MapAuthenticated64", 129, 64, false, true, 2, 4),
    layout("MapDepth64", 130, 64, true, false, 2, 4),
    layout("MapDepthAuthenticated64", 131, 64, true, true, 2, 4),
    layout("Map256", 132, 256, false, false, 9, 5),
    layout("MapAuthenticated256", 133, 256, false, true, 9, 5),
    layout("MapDepth256", 134, 256, true, false, 9, 4),
    layout("MapDepthAuthenticated256", 135, 256, true, true, 9, 4),
];

const fn layout(
    name: &'static str,
    id: u16,
    frame_bytes: usize,
    has_depth: bool,
    is_authenticated: bool,
    blocks: usize,
    points: usize,
) -> Layout {
    Layout { name, id, frame_bytes, has_depth, is_authenticated, blocks, points }
}

/// A field of every point, with its name, its kind, a getter and a setter.
pub(crate) struct PointField {
    pub(crate) name: &'static str,
    pub(crate) kind: fn() -> Kind,
    pub(crate) get: fn(&Point) -> i16,
    pub(crate) set: fn(&mut Point, i16),
}

const fn point_field(
    name: &'static str,
    kind: fn() -> Kind,
    get: fn(&Point) -> i16,
    set: fn(&mut Point, i16),
) -> PointField {
    PointField { name, kind, get, set }
}

pub(crate) fn sender() -> Kind {
    Kind::integer(0.0, f64::from(u8::MAX))
}

fn counter() -> Kind {
    Kind::integer(0.0, f64::from(u16::MAX))
}

pub(crate) fn model() -> Kind {
    Kind::integer(0.0, f64::from(MODELS - 1))
}

fn horizontal() -> Kind {
    Kind::integer(0.0, f64::from(HORIZONTAL_CELLS - 1))
}

fn vertical() -> Kind {
    Kind::integer(0.0, f64::from(DEPTH_CELLS - 1))
}

fn time() -> Kind {
    Kind::integer(0.0, f64::from(TIME_CELLS - 1))
}

fn information() -> Kind {
    Kind::integer(0.0, f64::from(INFORMATION_LEVELS - 1))
}

fn mean() -> Kind {
    Kind::integer(-f64::from(MEAN_LEVELS), f64::from(MEAN_LEVELS))
}

fn correlation() -> Kind {
    Kind::integer(-f64::from(CORRELATION_LEVELS), f64::from(CORRELATION_LEVELS))
}

pub(crate) fn word() -> Kind {
    Kind::integer(0.0, f64::from(u32::MAX))
}

const LOCATION: [PointField; 4] = [
    point_field("tx_east", horizontal, |p| p.transmitter.east.into(), |p, v| p.transmitter.east = v as u8),
    point_field("tx_north", horizontal, |p| p.transmitter.north.into(), |p, v| p.transmitter.north = v as u8),
    point_field("rx_east", horizontal, |p| p.receiver.east.into(), |p, v| p.receiver.east = v as u8),
    point_field("rx_north", horizontal, |p| p.receiver.north.into(), |p, v| p.receiver.north = v as u8),
];

const DEPTHS: [PointField; 2] = [
    point_field("tx_depth", vertical, |p| p.transmitter.depth.into(), |p, v| p.transmitter.depth = v as u8),
    point_field("rx_depth", vertical, |p| p.receiver.depth.into(), |p, v| p.receiver.depth = v as u8),
];

const STATISTICS: [PointField; 2] = [
    point_field("information", information, |p| p.information.into(), |p, v| p.information = v as u8),
    point_field("mean", mean, |p| p.mean.into(), |p, v| p.mean = v as i8),
];

/// Name of the field with the time cells.
pub(crate) const TIME: &str = "time";

/// Name of the field with the partial correlations.
pub(crate) const CORRELATION: &str = "correlation";

/// Names of the fields with the lower and the upper half of the tag.
pub(crate) const TAG: [&str; 2] = ["tag_low", "tag_high"];

/// Returns the tag of an authenticated message.
pub(crate) fn tag_of(fields: &Fields) -> u64 {
    let [low, high] = TAG.map(|name| numbers(fields, name).next().unwrap_or(0.0) as u64);
    low | high << 32
}

/// Returns the number of bits of these fields of one point.
fn bits_of<'a>(fields: impl Iterator<Item = &'a PointField>) -> u64 {
    fields.map(|field| (field.kind)().bits_max()).sum()
}

impl Layout {
    /// Returns the largest form that fits into a frame.
    pub fn for_frame(frame_bytes: usize, has_depth: bool, is_authenticated: bool) -> Option<&'static Layout> {
        let fits = |layout: &&Layout| {
            layout.has_depth == has_depth
                && layout.is_authenticated == is_authenticated
                && layout.frame_bytes <= frame_bytes
        };
        LAYOUTS.iter().filter(fits).max_by_key(|layout| layout.frame_bytes)
    }

    /// Returns the form with the id at the start of these bytes.
    pub fn of(bytes: &[u8]) -> Option<&'static Layout> {
        let id = Schema::id_of(bytes)?;
        LAYOUTS.iter().find(|layout| layout.id == id)
    }

    /// Returns the number of partial correlations of a block.
    pub fn correlations(&self) -> usize {
        self.points.saturating_mul(self.points.saturating_sub(1)) / 2
    }

    /// Returns the number of inducing points of all blocks.
    pub fn points_in_all(&self) -> usize {
        self.blocks.saturating_mul(self.points)
    }

    /// Returns the number of bits of a point's two cells.
    pub fn location_bits(&self) -> u64 {
        bits_of(LOCATION.iter().chain(DEPTHS.iter().filter(|_| self.has_depth)))
    }

    /// Returns the number of bits of id, sender, counter, and check number or tag.
    pub fn overhead_bits(&self) -> u64 {
        self.head_bits() + self.proof_bits()
    }

    /// Returns the length of the message in bytes, without building [`Layout::schema`]. All messages of a form have
    /// equal length.
    pub fn length(&self) -> usize {
        self.body_start().saturating_add(self.body_bits()).div_ceil(8)
    }

    /// Returns the bytes of a message with zeros in place of the check number `model`, without decoding and encoding.
    ///
    /// The check number is computed from these bytes. Bytes after the message, for example zeros added by a modem, are
    /// cut off. An authenticated message has no check number and is returned unchanged. The function accepts any bytes.
    pub fn with_model_zeroed(&self, bytes: &[u8]) -> Vec<u8> {
        let mut message = bytes[..bytes.len().min(self.length())].to_vec();
        if !self.is_authenticated {
            overwrite(&mut message, self.body_start(), model().bits_max() as u32, 0);
        }
        message
    }

    /// Encodes these values. The schemas of [`LAYOUTS`] are known to be valid; only the schema of another layout is
    /// checked.
    pub(crate) fn encode(&self, values: &Fields) -> Result<Vec<u8>, Error> {
        let schema = self.schema();
        if !LAYOUTS.contains(self) {
            schema.check()?;
        }
        schema.write(values)
    }

    /// Returns the first bit of the tag of an authenticated message. The tag ends the body.
    pub(crate) fn tag_place(&self) -> Option<usize> {
        let end = self.body_start().saturating_add(self.body_bits());
        self.is_authenticated.then(|| end.saturating_sub(TAG_BITS as usize))
    }

    /// Returns the number of bits of id, sender and counter.
    fn head_bits(&self) -> u64 {
        id_bits(self.id) + sender().bits_max() + counter().bits_max()
    }

    /// Returns the number of bits of the check number or the tag.
    fn proof_bits(&self) -> u64 {
        if self.is_authenticated { TAG_BITS.into() } else { model().bits_max() }
    }

    /// Returns the first bit of the body, which starts at a whole byte.
    fn body_start(&self) -> usize {
        self.head_bits().next_multiple_of(8) as usize
    }

    fn body_bits(&self) -> usize {
        let bits = |count: usize, each: u64| count.saturating_mul(each as usize);
        let points = bits(self.points_in_all(), self.location_bits() + bits_of(STATISTICS.iter()));
        let correlations = bits(self.blocks.saturating_mul(self.correlations()), correlation().bits_max());
        let of_blocks = bits(self.blocks, time().bits_max()).saturating_add(points).saturating_add(correlations);
        of_blocks.saturating_add(self.proof_bits() as usize)
    }

    /// Iterates over the fields of every point, locations first.
    pub(crate) fn point_fields(&self) -> impl Iterator<Item = PointField> {
        let depths = if self.has_depth { Some(DEPTHS) } else { None };
        LOCATION.into_iter().chain(depths.into_iter().flatten()).chain(STATISTICS)
    }

    /// Returns the DCCL schema of the message. All numbers are integers; the team's chart and quantizer define their
    /// meaning.
    pub fn schema(&self) -> Schema {
        let all = |name, kind, count| Field::repeated(name, kind, count, count);
        let mut fields =
            vec![Field::required("sender", sender()).in_head(), Field::required("counter", counter()).in_head()];
        if !self.is_authenticated {
            fields.push(Field::required("model", model()));
        }
        fields.push(all(TIME, time(), self.blocks));
        fields.extend(self.point_fields().map(|field| all(field.name, (field.kind)(), self.points_in_all())));
        fields.push(all(CORRELATION, correlation(), self.blocks.saturating_mul(self.correlations())));
        if self.is_authenticated {
            fields.extend(TAG.map(|name| Field::required(name, word())));
        }
        Schema { name: self.name.into(), id: Some(self.id), bytes_max: self.frame_bytes, fields }
    }
}
