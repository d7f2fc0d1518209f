//! Summaries of a vehicle's map: inducing points as cells of the team's chart, with quantized Gaussian messages.

use alloc::string::String;
use alloc::vec::Vec;
use alloc::{format, vec};

use crate::authenticator::{Authenticator, authenticate, check_tag};
use crate::error::Error;
use crate::layout::{CORRELATION, Layout, TAG, TIME, tag_of};
use crate::point::Point;
use crate::schema::Schema;
use crate::value::{Fields, Value, number, numbers};

/// One Gaussian message about f at a few points, as integers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Block {
    /// Time cell of its points; 0 for no particular time.
    pub time: u8,
    /// Inducing points, [`Layout::points`] of them.
    pub points: Vec<Point>,
    /// Levels of the partial correlations of points (2, 1), (3, 1), (3, 2), (4, 1) and so on, counted from 1.
    pub correlations: Vec<i8>,
}

impl Block {
    /// Returns a block without information.
    pub fn empty(layout: &Layout) -> Self {
        Self { time: 0, points: vec![Point::default(); layout.points], correlations: vec![0; layout.correlations()] }
    }

    /// Returns whether at least one point has information.
    pub fn has_content(&self) -> bool {
        self.points.iter().any(|point| point.information > 0)
    }
}

/// One frame with a summary of a vehicle's map.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MapMessage {
    /// The sender's number in its team.
    pub sender: u8,
    /// Counter of the sender's messages. A value never repeats under one key.
    pub counter: u16,
    /// Check number of the team's settings and of this message, at most 14 bits. An authenticated message does not
    /// contain it; the decoder then sets it to 0.
    pub model: u16,
    /// Blocks of inducing points, [`Layout::blocks`] of them.
    pub blocks: Vec<Block>,
}

impl MapMessage {
    /// Encodes the message in at most [`Layout::frame_bytes`] bytes.
    ///
    /// # Errors
    /// * [`Error::OutOfBounds`] for a number outside the bounds of its field.
    /// * [`Error::Count`] if the number of blocks or points differs from that of the layout.
    /// * [`Error::Authentication`] for an authenticated layout without a key, or a plain layout with a key.
    /// * The errors of [`Schema::check`] for a layout outside [`LAYOUTS`](crate::LAYOUTS).
    pub fn encode(&self, layout: &Layout, auth: Option<Authenticator<'_>>) -> Result<Vec<u8>, Error> {
        authenticate(layout.encode(&self.fields(layout)?)?, layout.tag_place(), auth)
    }

    /// Decodes `bytes`, and returns the message and its form. Modems may fill a frame with zeros; zeros after the
    /// message are ignored.
    ///
    /// # Errors
    /// * [`Error::Id`] for another type of message.
    /// * [`Error::Authentication`] for an authenticated message without a key, or a plain message with a key.
    /// * [`Error::Forged`] if the tag does not match, and [`Error::OtherContext`] if it matches another context.
    /// * The errors of [`Schema::decode`].
    pub fn decode(bytes: &[u8], auth: Option<Authenticator<'_>>) -> Result<(&'static Layout, Self), Error> {
        let layout = Layout::of(bytes)
            .ok_or_else(|| Error::Id { found: Schema::id_of(bytes), expected: "that of a map message".into() })?;
        let message = match bytes.split_at_checked(layout.length()) {
            Some((message, rest)) if rest.iter().all(|&byte| byte == 0) => message,
            _ => bytes,
        };
        let fields = layout.schema().read(message)?;
        check_tag(message, layout.tag_place(), tag_of(&fields), auth)?;
        Ok((layout, Self::from_fields(layout, &fields)))
    }

    /// Returns the values by field name, including a tag of zeros.
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
        if layout.is_authenticated {
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

    /// Builds the message from values that the schema has checked.
    fn from_fields(layout: &Layout, fields: &Fields) -> Self {
        let mut blocks = vec![Block::empty(layout); layout.blocks];
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
