//! What a vehicle tells of its map: inducing points as cells of the team's chart, and what its events say about them.

use alloc::string::String;
use alloc::vec::Vec;
use alloc::{format, vec};

use crate::error::Error;
use crate::layout::{CORRELATION, Layout, TAG, TIME, tag_of};
use crate::point::Point;
use crate::schema::Schema;
use crate::seal::{Seal, check_seal, sealed};
use crate::value::{Fields, Value, number, numbers};

/// One Gaussian message about f at a few points, in whole numbers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Block {
    /// The cell of the time at which its points were true; 0 for no certain time.
    pub time: u8,
    /// As many as the layout says.
    pub points: Vec<Point>,
    /// Levels of the partial correlations: of points (2, 1), (3, 1), (3, 2), (4, 1) and so on, counted from 1.
    pub correlations: Vec<i8>,
}

impl Block {
    /// A block that says nothing.
    pub fn silent(layout: &Layout) -> Self {
        Self { time: 0, points: vec![Point::default(); layout.points], correlations: vec![0; layout.correlations()] }
    }

    /// Whether there is a point of which it says something.
    pub fn says_something(&self) -> bool {
        self.points.iter().any(|point| point.information > 0)
    }
}

/// What a vehicle tells of its map in one frame.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MapMessage {
    /// The sender's number in its team.
    pub sender: u8,
    /// Counts the sender's messages; never repeats under one key.
    pub counter: u16,
    /// Check number of the team's model and of this message, at most 14 bits. Not sent in a sealed message, where it
    /// decodes as 0.
    pub model: u16,
    /// As many as the layout says.
    pub blocks: Vec<Block>,
}

impl MapMessage {
    /// The message as bytes: at most [`Layout::frame_bytes`].
    ///
    /// # Errors
    /// [`Error::OutOfBounds`] for a number that its field does not hold, [`Error::Count`] for another number of blocks
    /// or points than the layout has, [`Error::Seal`] for a sealed layout without a seal or the other way round, and as
    /// [`Schema::check`] for a layout that is none of [`LAYOUTS`](crate::LAYOUTS).
    pub fn encode(&self, layout: &Layout, seal: Option<Seal<'_>>) -> Result<Vec<u8>, Error> {
        sealed(layout.encode(&self.fields(layout)?)?, layout.tag_place(), seal)
    }

    /// The message in `bytes` and its form. Zeros after the message, as modems add to fill a frame, are ignored.
    ///
    /// # Errors
    /// [`Error::Id`] for another kind of message, [`Error::Seal`] for a sealed message without a key or an open one
    /// with a key, [`Error::Forged`] when the tag does not fit, [`Error::OtherContext`] when it fits another context, and as
    /// [`Schema::decode`].
    pub fn decode(bytes: &[u8], seal: Option<Seal<'_>>) -> Result<(&'static Layout, Self), Error> {
        let layout = Layout::of(bytes)
            .ok_or_else(|| Error::Id { found: Schema::id_of(bytes), expected: "that of a map message".into() })?;
        let message = match bytes.split_at_checked(layout.length()) {
            Some((message, rest)) if rest.iter().all(|&byte| byte == 0) => message,
            _ => bytes,
        };
        let fields = layout.schema().read(message)?;
        check_seal(message, layout.tag_place(), tag_of(&fields), seal)?;
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
        if layout.is_sealed {
            TAG.iter().for_each(|name| fields.set(name, number(0_u8)));
        } else {
            fields.set("model", number(self.model));
        }
        fields.set(TIME, Value::List(self.blocks.iter().map(|block| number(block.time)).collect()));
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
        blocks.iter_mut().zip(numbers(fields, TIME)).for_each(|(block, cell)| block.time = cell as u8);
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
