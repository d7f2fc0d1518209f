//! What a vehicle tells of single transmissions: what it heard and missed, and where it was.

use alloc::string::String;
use alloc::vec;
use alloc::vec::Vec;

use crate::bits::overwrite;
use crate::error::Error;
use crate::layout::{TAG, model, sender, tag_of, word};
use crate::outcomes::{Coded, Outcome, OutcomeCounts, code, decode};
use crate::schema::{Field, Kind, Schema};
use crate::seal::{Seal, TAG_BITS, check_seal, sealed};
use crate::value::{Fields, Value, number, numbers};

/// Slots are told apart by a number below this.
pub const SLOTS: u32 = 1 << 18;

/// Cells of the chart east and north that knots lie in.
pub const KNOT_CELLS: u16 = 256;

/// Cells of depth that knots lie in.
pub const KNOT_DEPTH_CELLS: u8 = 64;

/// Knots of a report at most.
pub const KNOTS_MAX: usize = 31;

/// Bytes of outcomes at most.
pub const OUTCOME_BYTES_MAX: usize = 255;

/// Bytes of the longest report, and some more.
const BYTES_MAX: usize = 512;

/// The bit at which the body of a report begins: after an id of two bytes and the sender.
const BODY_START: usize = 24;

/// A form of the report: with or without depth, open or sealed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReportLayout {
    /// Name of the message in the `.proto`.
    pub name: &'static str,
    /// DCCL id, from the range for private use.
    pub id: u16,
    /// Whether knots have depths.
    pub has_depth: bool,
    /// Whether the message carries an authentication tag of 8 bytes instead of a check number.
    pub is_sealed: bool,
}

/// All forms.
pub const REPORT_LAYOUTS: [ReportLayout; 4] = [
    ReportLayout { name: "Report", id: 136, has_depth: false, is_sealed: false },
    ReportLayout { name: "ReportSealed", id: 137, has_depth: false, is_sealed: true },
    ReportLayout { name: "ReportDepth", id: 138, has_depth: true, is_sealed: false },
    ReportLayout { name: "ReportDepthSealed", id: 139, has_depth: true, is_sealed: true },
];

/// Where the sender was when a slot began. Between knots it went straight on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Knot {
    /// Slots since the knot before; of the first one, from it to [`Report::first`].
    pub slots: u8,
    /// From west to east.
    pub east: u8,
    /// From south to north.
    pub north: u8,
    /// From the surface down; 0 where the message has no depths.
    pub depth: u8,
}

/// What becomes of the sender's map messages, now that its reports tell events that those speak of, too.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Earlier {
    /// It is about map messages with counters below this one, of which only the lowest 8 bits are sent.
    pub before: u8,
    /// Whether what they say beyond its reports still counts; if not, nothing of them does.
    pub counts: bool,
}

/// What a vehicle heard and missed, slot by slot, and where it was meanwhile.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Report {
    /// The sender's number in its team.
    pub sender: u8,
    /// Check number, at most 14 bits, as that of a [`MapMessage`](crate::MapMessage).
    pub model: u16,
    /// Number of the slot that outcomes and knots begin at.
    pub first: u32,
    /// Whether the sender's own slots stand among the outcomes, sent or silent; without that it was silent in none.
    pub tells_own: bool,
    /// What became of the transmissions in slots from `first` on that the sender could hear. Those at the end that say nothing
    /// are not sent.
    pub outcomes: Vec<Outcome>,
    /// Where the sender was, in the order of time.
    pub knots: Vec<Knot>,
    /// Which of its map messages speak of the same events; nothing where none does.
    pub earlier: Option<Earlier>,
}

impl ReportLayout {
    /// The form of reports with or without depths, open or sealed.
    pub fn new(has_depth: bool, is_sealed: bool) -> &'static ReportLayout {
        &REPORT_LAYOUTS[usize::from(is_sealed) + 2 * usize::from(has_depth)]
    }

    /// The form that these bytes say they have.
    pub fn of(bytes: &[u8]) -> Option<&'static ReportLayout> {
        let id = Schema::id_of(bytes)?;
        REPORT_LAYOUTS.iter().find(|layout| layout.id == id)
    }

    /// Bytes of a report with so many outcomes and knots at most.
    pub fn length(&self, outcomes: OutcomeCounts, knots: usize, has_earlier: bool) -> usize {
        // Model or tag, first slot, coding, unused bits, whether own slots are told, how many bytes and knots there are, and whether
        // anything is said of map messages.
        let fixed = if self.is_sealed { TAG_BITS as usize } else { 14 } + 18 + 2 + 3 + 1 + 8 + 5 + 1;
        let knot = if self.has_depth { 30 } else { 24 };
        let earlier = if has_earlier { 9 } else { 0 };
        let body = fixed + 8 * outcomes.bytes_max() + knot * knots + earlier;
        (BODY_START + body).div_ceil(8)
    }

    /// The bytes of a message with zeros in place of its check number: see
    /// [`Layout::with_model_zeroed`](crate::Layout::with_model_zeroed).
    pub fn with_model_zeroed(&self, message: &[u8]) -> Vec<u8> {
        let mut message = message.to_vec();
        if !self.is_sealed {
            overwrite(&mut message, BODY_START, model().bits_max() as u32, 0);
        }
        message
    }

    /// The first bit of the tag of a sealed report: it begins the body.
    fn tag_place(&self) -> Option<usize> {
        self.is_sealed.then_some(BODY_START)
    }

    fn knot(&self) -> Kind {
        let plane = Kind::integer(0.0, f64::from(KNOT_CELLS - 1));
        let mut fields = vec![
            Field::required("slots", Kind::integer(0.0, f64::from(u8::MAX))),
            Field::required("east", plane.clone()),
            Field::required("north", plane),
        ];
        if self.has_depth {
            fields.push(Field::required("depth", Kind::integer(0.0, f64::from(KNOT_DEPTH_CELLS - 1))));
        }
        Kind::Message(fields)
    }

    /// The message as DCCL describes it.
    pub fn schema(&self) -> Schema {
        let mut fields = vec![Field::required("sender", sender()).in_head()];
        match self.is_sealed {
            true => fields.extend(TAG.map(|name| Field::required(name, word()))),
            false => fields.push(Field::required("model", model())),
        }
        fields.extend([
            Field::required("first", first()),
            Field::required("coding", coding()),
            Field::required("unused", unused()),
            Field::required("tells_own", Kind::Bool),
            Field::required("outcomes", Kind::Bytes { length_max: OUTCOME_BYTES_MAX }),
            Field::repeated("knot", self.knot(), 0, KNOTS_MAX),
            Field::optional("earlier", Kind::Message(earlier_fields())),
        ]);
        Schema { name: self.name.into(), id: Some(self.id), bytes_max: BYTES_MAX, fields }
    }
}

fn first() -> Kind {
    Kind::integer(0.0, f64::from(SLOTS - 1))
}

/// One more is left, for outcomes with grades, of two bits each.
fn coding() -> Kind {
    Kind::integer(0.0, 3.0)
}

fn unused() -> Kind {
    Kind::integer(0.0, 7.0)
}

fn earlier_fields() -> Vec<Field> {
    vec![Field::required("before", Kind::integer(0.0, f64::from(u8::MAX))), Field::required("counts", Kind::Bool)]
}

impl Report {
    /// The report as bytes. O(length).
    ///
    /// # Errors
    /// As [`MapMessage::encode`](crate::MapMessage::encode).
    pub fn encode(&self, layout: &ReportLayout, seal: Option<Seal<'_>>) -> Result<Vec<u8>, Error> {
        sealed(layout.schema().write(&self.fields(layout)?)?, layout.tag_place(), seal)
    }

    /// The report that `bytes` begin with, its form, and how many bytes it has. What follows it, zeros or other messages, is
    /// not looked at.
    ///
    /// # Errors
    /// As [`MapMessage::decode`](crate::MapMessage::decode), and [`Error::Padding`] for outcomes in another form than ours.
    pub fn decode(bytes: &[u8], seal: Option<Seal<'_>>) -> Result<(&'static ReportLayout, Self, usize), Error> {
        let layout = ReportLayout::of(bytes)
            .ok_or_else(|| Error::Id { found: Schema::id_of(bytes), expected: "that of a report".into() })?;
        let (fields, length) = layout.schema().read_first(bytes)?;
        check_seal(&bytes[..length], layout.tag_place(), tag_of(&fields), seal)?;
        Ok((layout, Self::from_fields(&fields)?, length))
    }

    /// The values by field name, a tag of zeros included.
    fn fields(&self, layout: &ReportLayout) -> Result<Fields, Error> {
        let Coded { coding, unused, bytes } = code(&self.outcomes);
        let mut fields = Fields::new();
        fields.set("sender", number(self.sender));
        match layout.is_sealed {
            true => TAG.iter().for_each(|name| fields.set(name, number(0_u8))),
            false => fields.set("model", number(self.model)),
        }
        fields.set("first", number(self.first));
        fields.set("coding", number(coding));
        fields.set("unused", number(unused));
        fields.set("tells_own", Value::Bool(self.tells_own));
        fields.set("outcomes", Value::Bytes(bytes));
        let knots = self.knots.iter().map(|knot| knot_value(knot, layout.has_depth)).collect::<Result<_, _>>()?;
        fields.set("knot", Value::List(knots));
        if let Some(Earlier { before, counts }) = self.earlier {
            let mut earlier = Fields::new();
            earlier.set("before", number(before));
            earlier.set("counts", Value::Bool(counts));
            fields.set("earlier", Value::Message(earlier));
        }
        Ok(fields)
    }

    /// The report of values that the schema has checked.
    fn from_fields(fields: &Fields) -> Result<Self, Error> {
        let single = |fields: &Fields, name: &str| numbers(fields, name).next().unwrap_or(0.0);
        let knot = |value: &Value| {
            let Value::Message(knot) = value else { return None };
            let part = |name| single(knot, name) as u8;
            Some(Knot { slots: part("slots"), east: part("east"), north: part("north"), depth: part("depth") })
        };
        let knots = if let Some(Value::List(knots)) = fields.get("knot") { knots.as_slice() } else { &[] };
        let earlier = if let Some(Value::Message(earlier)) = fields.get("earlier") { Some(earlier) } else { None };
        let bytes = if let Some(Value::Bytes(bytes)) = fields.get("outcomes") { bytes.clone() } else { Vec::new() };
        let (coding, unused) = (single(fields, "coding") as u8, single(fields, "unused") as u8);
        Ok(Self {
            sender: single(fields, "sender") as u8,
            model: single(fields, "model") as u16,
            first: single(fields, "first") as u32,
            tells_own: matches!(fields.get("tells_own"), Some(Value::Bool(true))),
            outcomes: decode(&Coded { coding, unused, bytes })?,
            knots: knots.iter().filter_map(knot).collect(),
            earlier: earlier.map(|earlier| Earlier {
                before: single(earlier, "before") as u8,
                counts: matches!(earlier.get("counts"), Some(Value::Bool(true))),
            }),
        })
    }
}

fn knot_value(knot: &Knot, has_depth: bool) -> Result<Value, Error> {
    let mut fields = Fields::new();
    let parts = [("slots", knot.slots), ("east", knot.east), ("north", knot.north)];
    parts.into_iter().for_each(|(name, value)| fields.set(name, number(value)));
    match (has_depth, knot.depth) {
        (true, depth) => fields.set("depth", number(depth)),
        (false, 0) => {}
        (false, depth) => {
            let field = String::from("knot.depth");
            return Err(Error::OutOfBounds { field, min: 0.0, max: 0.0, value: depth.into() });
        }
    }
    Ok(Value::Message(fields))
}
