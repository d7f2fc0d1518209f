//! What a vehicle tells of its map: inducing points as cells of the team's chart, and what its events say about them.

use alloc::string::String;
use alloc::vec::Vec;
use alloc::{format, vec};

use crate::error::Error;
use crate::schema::{Field, Kind, Rule, Schema};
use crate::seal::Key;
use crate::value::{Fields, Value};

/// The map messages as a Goby user loads them.
pub const PROTO: &str = include_str!("../proto/pingmap.proto");

/// Cells of the chart east and north.
pub const HORIZONTAL_CELLS: u8 = 64;

/// Cells of the chart in depth.
pub const DEPTH_CELLS: u8 = 32;

/// Levels of information: 0 is a point of which nothing is said.
pub const INFORMATION_LEVELS: u8 = 32;

/// Partial correlations go from minus to plus this level.
pub const CORRELATION_LEVELS: i8 = 7;

/// Means go from minus to plus this level.
pub const MEAN_LEVELS: i8 = 15;

/// Models are told apart by a number below this in open messages.
const MODELS: u16 = 1 << 14;

/// A form of the map message: one for each frame size, with or without depth, open or sealed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    /// Name of the message in the `.proto`.
    pub name: &'static str,
    /// DCCL id, from the range for private use.
    pub id: u16,
    /// Frame that it fits into, in bytes.
    pub frame_bytes: usize,
    /// Whether links have depths.
    pub has_depth: bool,
    /// Whether the message carries an authentication tag of 8 bytes. The model's digest then goes into the tag instead.
    pub is_sealed: bool,
    /// How many blocks it carries.
    pub blocks: usize,
    /// Inducing points of a block.
    pub points: usize,
}

/// All forms.
pub const LAYOUTS: [Layout; 12] = [
    layout("Map32", 124, 32, false, false, 1, 5),
    layout("MapSealed32", 125, 32, false, true, 1, 4),
    layout("MapDepth32", 126, 32, true, false, 1, 4),
    layout("MapDepthSealed32", 127, 32, true, true, 1, 3),
    layout("Map64", 128, 64, false, false, 2, 5),
    layout("MapSealed64", 129, 64, false, true, 2, 4),
    layout("MapDepth64", 130, 64, true, false, 2, 4),
    layout("MapDepthSealed64", 131, 64, true, true, 2, 4),
    layout("Map256", 132, 256, false, false, 9, 5),
    layout("MapSealed256", 133, 256, false, true, 9, 5),
    layout("MapDepth256", 134, 256, true, false, 9, 4),
    layout("MapDepthSealed256", 135, 256, true, true, 9, 4),
];

const fn layout(
    name: &'static str,
    id: u16,
    frame_bytes: usize,
    has_depth: bool,
    is_sealed: bool,
    blocks: usize,
    points: usize,
) -> Layout {
    Layout { name, id, frame_bytes, has_depth, is_sealed, blocks, points }
}

/// Where one end of a link lies, in cells of the chart.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct Cell {
    /// From west to east.
    pub east: u8,
    /// From south to north.
    pub north: u8,
    /// From the surface down; 0 where the message has no depths.
    pub depth: u8,
}

/// An inducing point, and what is said about it by itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Point {
    /// Transmitter.
    pub transmitter: Cell,
    /// Receiver.
    pub receiver: Cell,
    /// Level of the whitened precision's diagonal; 0 for a point of which nothing is said.
    pub information: u8,
    /// Level of the whitened mean.
    pub mean: i8,
}

/// One Gaussian message about f at a few points, in whole numbers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Block {
    /// As many as the layout says.
    pub points: Vec<Point>,
    /// Levels of the partial correlations: of points (2, 1), (3, 1), (3, 2), (4, 1) and so on, counted from 1.
    pub correlations: Vec<i8>,
}

impl Block {
    /// A block that says nothing.
    pub fn silent(layout: &Layout) -> Self {
        Self { points: vec![Point::default(); layout.points], correlations: vec![0; layout.correlations()] }
    }
}

/// What a vehicle tells of its map in one frame.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MapMessage {
    /// The sender's number in its team.
    pub sender: u8,
    /// Counts the sender's messages; never repeats under one key.
    pub counter: u16,
    /// Check number of the team's model and of this message, at most 14 bits. Not sent in a sealed message, where it decodes as 0.
    pub model: u16,
    /// As many as the layout says.
    pub blocks: Vec<Block>,
}

/// A key, and what both ends must agree on without sending it.
#[derive(Debug, Clone, Copy)]
pub struct Seal<'a> {
    /// The team's secret.
    pub key: &'a Key,
    /// Such as the digest of the team's model.
    pub context: &'a [u8],
}

/// A field of every point: its name, its kind, how it is read and how it is set.
struct PointField {
    name: &'static str,
    kind: fn() -> Kind,
    get: fn(&Point) -> i16,
    set: fn(&mut Point, i16),
}

const fn point_field(
    name: &'static str,
    kind: fn() -> Kind,
    get: fn(&Point) -> i16,
    set: fn(&mut Point, i16),
) -> PointField {
    PointField { name, kind, get, set }
}

fn horizontal() -> Kind {
    Kind::integer(0.0, f64::from(HORIZONTAL_CELLS - 1))
}

fn vertical() -> Kind {
    Kind::integer(0.0, f64::from(DEPTH_CELLS - 1))
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

fn word() -> Kind {
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

const CORRELATION: &str = "correlation";

impl Layout {
    /// The largest form that fits into a frame.
    pub fn for_frame(frame_bytes: usize, has_depth: bool, is_sealed: bool) -> Option<&'static Layout> {
        let fits = |layout: &&Layout| {
            layout.has_depth == has_depth && layout.is_sealed == is_sealed && layout.frame_bytes <= frame_bytes
        };
        LAYOUTS.iter().filter(fits).max_by_key(|layout| layout.frame_bytes)
    }

    /// The form that these bytes say they have.
    pub fn of(bytes: &[u8]) -> Option<&'static Layout> {
        let id = Schema::id_of(bytes)?;
        LAYOUTS.iter().find(|layout| layout.id == id)
    }

    /// Partial correlations of a block.
    pub fn correlations(&self) -> usize {
        self.points * self.points.saturating_sub(1) / 2
    }

    /// Inducing points of all blocks.
    pub fn points_in_all(&self) -> usize {
        self.blocks * self.points
    }

    /// Bits of a point's two cells.
    pub fn location_bits(&self) -> u64 {
        let locations = LOCATION.iter().chain(DEPTHS.iter().filter(|_| self.has_depth));
        locations.map(|field| Field::required(field.name, (field.kind)()).bits_max()).sum()
    }

    /// Bits of all that does not speak of points: id, sender, counter, and check number or tag.
    pub fn overhead_bits(&self) -> u64 {
        let schema = self.schema();
        let single = schema.fields.iter().filter(|field| field.rule == Rule::Required);
        schema.id_bits() + single.map(Field::bits_max).sum::<u64>()
    }

    /// Fields of every point: locations first.
    fn point_fields(&self) -> impl Iterator<Item = PointField> {
        let depths = if self.has_depth { Some(DEPTHS) } else { None };
        LOCATION.into_iter().chain(depths.into_iter().flatten()).chain(STATISTICS)
    }

    /// The message as DCCL describes it. Every number is whole; what it means is the team's affair.
    pub fn schema(&self) -> Schema {
        let all = |name, kind, count| Field::repeated(name, kind, count, count);
        let mut fields = vec![
            Field::required("sender", Kind::integer(0.0, 255.0)).in_head(),
            Field::required("counter", Kind::integer(0.0, 65535.0)).in_head(),
        ];
        if !self.is_sealed {
            fields.push(Field::required("model", Kind::integer(0.0, f64::from(MODELS - 1))));
        }
        fields.extend(self.point_fields().map(|field| all(field.name, (field.kind)(), self.points_in_all())));
        fields.push(all(CORRELATION, correlation(), self.blocks * self.correlations()));
        if self.is_sealed {
            fields.extend(["tag_low", "tag_high"].map(|name| Field::required(name, word())));
        }
        Schema { name: self.name.into(), id: Some(self.id), bytes_max: self.frame_bytes, fields }
    }
}

impl MapMessage {
    /// The message as bytes: at most [`Layout::frame_bytes`].
    ///
    /// # Errors
    /// [`Error::OutOfBounds`] for a number that its field does not hold, [`Error::Count`] for another number of blocks or points
    /// than the layout has, [`Error::Seal`] for a sealed layout without a seal or the other way round.
    pub fn encode(&self, layout: &Layout, seal: Option<Seal<'_>>) -> Result<Vec<u8>, Error> {
        let schema = layout.schema();
        let mut fields = self.fields(layout)?;
        match (layout.is_sealed, seal) {
            (false, None) => schema.encode(&fields),
            (true, Some(seal)) => {
                set_tag(&mut fields, 0);
                let tag = seal.key.tag(seal.context, &schema.encode(&fields)?);
                set_tag(&mut fields, tag);
                schema.encode(&fields)
            }
            (true, None) => Err(Error::Seal("a sealed message needs a key")),
            (false, Some(_)) => Err(Error::Seal("an open message cannot be sealed")),
        }
    }

    /// The message in `bytes` and its form. Zeros after the message, as modems add to fill a frame, are ignored.
    ///
    /// # Errors
    /// [`Error::Id`] for another kind of message, [`Error::Seal`] for a sealed message without a key or an open one with a key,
    /// [`Error::Forged`] when the tag does not fit, and as [`Schema::decode`].
    pub fn decode(bytes: &[u8], seal: Option<Seal<'_>>) -> Result<(&'static Layout, Self), Error> {
        let layout = Layout::of(bytes)
            .ok_or_else(|| Error::Id { found: Schema::id_of(bytes), expected: "that of a map message".into() })?;
        let schema = layout.schema();
        let length = schema.length();
        let message = match bytes.split_at_checked(length) {
            Some((message, rest)) if rest.iter().all(|&byte| byte == 0) => message,
            _ => bytes,
        };
        let mut fields = schema.decode(message)?;
        match (layout.is_sealed, seal) {
            (false, None) => {}
            (true, Some(seal)) => {
                let sent = take_tag(&mut fields);
                if seal.key.tag(seal.context, &schema.encode(&fields)?) != sent {
                    return Err(Error::Forged);
                }
            }
            (true, None) => return Err(Error::Seal("a sealed message, but no key is at hand")),
            (false, Some(_)) => return Err(Error::Seal("an open message where only sealed ones are taken")),
        }
        Ok((layout, Self::from_fields(layout, &fields)))
    }

    /// The values by field name, a tag of zeros included.
    fn fields(&self, layout: &Layout) -> Result<Fields, Error> {
        let count = |field: String, expected: usize, found: usize| {
            if expected == found { Ok(()) } else { Err(Error::Count { field, min: expected, max: expected, found }) }
        };
        count("blocks".into(), layout.blocks, self.blocks.len())?;
        for (place, block) in self.blocks.iter().enumerate() {
            count(format!("points of block {place}"), layout.points, block.points.len())?;
            count(format!("correlations of block {place}"), layout.correlations(), block.correlations.len())?;
        }
        let mut fields = Fields::new();
        fields.set("sender", number(self.sender));
        fields.set("counter", number(self.counter));
        if !layout.is_sealed {
            fields.set("model", number(self.model));
        }
        for field in layout.point_fields() {
            let points = self.blocks.iter().flat_map(|block| &block.points);
            fields.set(field.name, Value::List(points.map(|point| number((field.get)(point))).collect()));
        }
        let correlations = self.blocks.iter().flat_map(|block| &block.correlations);
        fields.set(CORRELATION, Value::List(correlations.map(|&level| number(level)).collect()));
        if !layout.has_depth {
            let deep = |point: &&Point| point.transmitter.depth != 0 || point.receiver.depth != 0;
            if let Some(point) = self.blocks.iter().flat_map(|block| &block.points).find(deep) {
                let value = point.transmitter.depth.max(point.receiver.depth).into();
                return Err(Error::OutOfBounds { field: "depth".into(), min: 0.0, max: 0.0, value });
            }
        }
        Ok(fields)
    }

    /// The message of values that the schema has checked.
    fn from_fields(layout: &Layout, fields: &Fields) -> Self {
        let mut blocks = vec![Block::silent(layout); layout.blocks];
        for field in layout.point_fields() {
            let points = blocks.iter_mut().flat_map(|block| &mut block.points);
            points.zip(numbers(fields, field.name)).for_each(|(point, level)| (field.set)(point, level as i16));
        }
        let correlations = blocks.iter_mut().flat_map(|block| &mut block.correlations);
        correlations.zip(numbers(fields, CORRELATION)).for_each(|(known, level)| *known = level as i8);
        let single = |name| numbers(fields, name).next().unwrap_or(0.0);
        Self {
            sender: single("sender") as u8,
            counter: single("counter") as u16,
            model: single("model") as u16,
            blocks,
        }
    }
}

fn number(value: impl Into<f64>) -> Value {
    Value::Number(value.into())
}

/// The numbers of a field, repeated or not.
fn numbers<'a>(fields: &'a Fields, name: &str) -> impl Iterator<Item = f64> + use<'a> {
    let elements = match fields.get(name) {
        Some(Value::List(elements)) => elements.as_slice(),
        Some(single) => core::slice::from_ref(single),
        None => &[],
    };
    elements.iter().filter_map(|value| if let Value::Number(value) = value { Some(*value) } else { None })
}

fn set_tag(fields: &mut Fields, tag: u64) {
    fields.set("tag_low", number(tag as u32));
    fields.set("tag_high", number((tag >> 32) as u32));
}

/// The tag; zeros stay in its place.
fn take_tag(fields: &mut Fields) -> u64 {
    let word = |name| numbers(fields, name).next().unwrap_or(0.0) as u64;
    let tag = word("tag_low") | word("tag_high") << 32;
    set_tag(fields, 0);
    tag
}
