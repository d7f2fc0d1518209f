//! Reports of single transmissions: the outcomes at the sender of the report, and its waypoints.

use alloc::string::String;
use alloc::vec;
use alloc::vec::Vec;

use crate::authenticator::{Authenticator, TAG_BITS, authenticate, check_tag};
use crate::bits::overwrite;
use crate::error::Error;
use crate::layout::{TAG, model, sender, tag_of, word};
use crate::outcomes::{Coded, Outcome, OutcomeCounts, code, decode};
use crate::schema::{Field, Kind, Schema};
use crate::value::{Fields, Value, number, numbers};

/// Number of distinct slot numbers.
pub const SLOTS: u32 = 1 << 18;

/// Number of waypoint cells of the chart, east and north.
pub const WAYPOINT_CELLS: u16 = 256;

/// Number of waypoint cells in depth.
pub const WAYPOINT_DEPTH_CELLS: u8 = 64;

/// Largest number of waypoints in a report.
pub const WAYPOINTS_MAX: usize = 31;

/// Largest number of bytes for the outcomes of a report.
pub const OUTCOME_BYTES_MAX: usize = 255;

/// `max_bytes` of the schema, larger than the longest report.
const BYTES_MAX: usize = 512;

/// First bit of the body of a report, after an id of two bytes and the sender.
const BODY_START: usize = 24;

/// A form of the report: with or without depth, plain or authenticated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReportLayout {
    /// Name of the message in the `.proto`.
    pub name: &'static str,
    /// DCCL id, from the range for private use.
    pub id: u16,
    /// Whether waypoints have depths.
    pub has_depth: bool,
    /// Whether the message has an authentication tag of 8 bytes instead of a check number.
    pub is_authenticated: bool,
}

/// All forms of the report.
pub const REPORT_LAYOUTS: [ReportLayout; 4] = [
    ReportLayout { name: "Report", id: 136, has_depth: false, is_authenticated: false },
    ReportLayout { name: "ReportAuthenticated", id: 137, has_depth: false, is_authenticated: true },
    ReportLayout { name: "ReportDepth", id: 138, has_depth: true, is_authenticated: false },
    ReportLayout { name: "ReportDepthAuthenticated", id: 139, has_depth: true, is_authenticated: true },
];

/// Position of the sender at the start of a slot. Between waypoints the track is a straight line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Waypoint {
    /// Number of slots since the previous waypoint. For the first waypoint, the number of slots from it to
    /// [`Report::first`].
    pub slots: u8,
    /// Cell from west to east.
    pub east: u8,
    /// Cell from south to north.
    pub north: u8,
    /// Cell from the surface down; 0 if the message has no depths.
    pub depth: u8,
}

/// The outcomes of a vehicle, slot by slot, and its waypoints in the same period.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Report {
    /// The sender's number in its team.
    pub sender: u8,
    /// Check number, at most 14 bits, as in a [`MapMessage`](crate::MapMessage).
    pub model: u16,
    /// Number of the first slot with an outcome. The first waypoint counts from it.
    pub first: u32,
    /// Whether the outcomes include the sender's own slots: heard means used, missed means unused. Otherwise the sender
    /// used all its slots.
    pub includes_own_slots: bool,
    /// Outcomes of the transmissions that the sender could hear in slots from `first` on. Unreported outcomes at the
    /// end are not sent.
    pub outcomes: Vec<Outcome>,
    /// Positions of the sender, in the order of time.
    pub waypoints: Vec<Waypoint>,
}

impl ReportLayout {
    /// Returns the form with or without depth, plain or authenticated.
    pub fn new(has_depth: bool, is_authenticated: bool) -> &'static ReportLayout {
        &REPORT_LAYOUTS[usize::from(is_authenticated) + 2 * usize::from(has_depth)]
    }

    /// Returns the form with the id at the start of these bytes.
    pub fn of(bytes: &[u8]) -> Option<&'static ReportLayout> {
        let id = Schema::id_of(bytes)?;
        REPORT_LAYOUTS.iter().find(|layout| layout.id == id)
    }

    /// Returns the length in bytes of a report with these numbers of outcomes and waypoints.
    pub fn length(&self, outcomes: OutcomeCounts, waypoints: usize) -> usize {
        // Check number or tag, first slot, coding, unused bits, own slots included, number of bytes, number of
        // waypoints.
        let fixed = if self.is_authenticated { TAG_BITS as usize } else { 14 } + 18 + 2 + 3 + 1 + 8 + 5;
        let waypoint = if self.has_depth { 30 } else { 24 };
        let body = fixed + 8 * outcomes.bytes() + waypoint * waypoints;
        (BODY_START + body).div_ceil(8)
    }

    /// Returns the bytes of a message with zeros in place of its check number. See
    /// [`Layout::with_model_zeroed`](crate::Layout::with_model_zeroed).
    pub fn with_model_zeroed(&self, message: &[u8]) -> Vec<u8> {
        let mut message = message.to_vec();
        if !self.is_authenticated {
            overwrite(&mut message, BODY_START, model().bits_max() as u32, 0);
        }
        message
    }

    /// Returns the first bit of the tag of an authenticated report. The body starts with the tag.
    fn tag_place(&self) -> Option<usize> {
        self.is_authenticated.then_some(BODY_START)
    }

    fn waypoint(&self) -> Kind {
        let plane = Kind::integer(0.0, f64::from(WAYPOINT_CELLS - 1));
        let mut fields = vec![
            Field::required("slots", Kind::integer(0.0, f64::from(u8::MAX))),
            Field::required("east", plane.clone()),
            Field::required("north", plane),
        ];
        if self.has_depth {
            fields.push(Field::required("depth", Kind::integer(0.0, f64::from(WAYPOINT_DEPTH_CELLS - 1))));
        }
        Kind::Message(fields)
    }

    /// Returns the DCCL schema of the message.
    pub fn schema(&self) -> Schema {
        let mut fields = vec![Field::required("sender", sender()).in_head()];
        match self.is_authenticated {
            true => fields.extend(TAG.map(|name| Field::required(name, word()))),
            false => fields.push(Field::required("model", model())),
        }
        fields.extend([
            Field::required("first", first()),
            Field::required("coding", coding()),
            Field::required("unused", unused()),
            Field::required("includes_own_slots", Kind::Bool),
            Field::required("outcomes", Kind::Bytes { length_max: OUTCOME_BYTES_MAX }),
            Field::repeated("waypoint", self.waypoint(), 0, WAYPOINTS_MAX),
        ]);
        Schema { name: self.name.into(), id: Some(self.id), bytes_max: BYTES_MAX, fields }
    }
}

fn first() -> Kind {
    Kind::integer(0.0, f64::from(SLOTS - 1))
}

/// Returns the kind of the field `coding`. Two of its values are reserved.
fn coding() -> Kind {
    Kind::integer(0.0, 3.0)
}

fn unused() -> Kind {
    Kind::integer(0.0, 7.0)
}

impl Report {
    /// Encodes the report. Cost: O(length).
    ///
    /// # Errors
    /// The errors of [`MapMessage::encode`](crate::MapMessage::encode).
    pub fn encode(&self, layout: &ReportLayout, auth: Option<Authenticator<'_>>) -> Result<Vec<u8>, Error> {
        authenticate(layout.schema().write(&self.fields(layout)?)?, layout.tag_place(), auth)
    }

    /// Decodes the report at the start of `bytes`, and returns its form, the report and its length in bytes. Zeros or
    /// other messages may follow the report.
    ///
    /// # Errors
    /// The errors of [`MapMessage::decode`](crate::MapMessage::decode), and [`Error::Padding`] for outcomes in a form
    /// that the encoder does not write.
    pub fn decode(
        bytes: &[u8],
        auth: Option<Authenticator<'_>>,
    ) -> Result<(&'static ReportLayout, Self, usize), Error> {
        let layout = ReportLayout::of(bytes)
            .ok_or_else(|| Error::Id { found: Schema::id_of(bytes), expected: "that of a report".into() })?;
        let (fields, length) = layout.schema().read_first(bytes)?;
        check_tag(&bytes[..length], layout.tag_place(), tag_of(&fields), auth)?;
        Ok((layout, Self::from_fields(&fields)?, length))
    }

    /// Returns the values by field name, including a tag of zeros.
    fn fields(&self, layout: &ReportLayout) -> Result<Fields, Error> {
        let Coded { coding, unused, bytes } = code(&self.outcomes);
        let mut fields = Fields::new();
        fields.set("sender", number(self.sender));
        match layout.is_authenticated {
            true => TAG.iter().for_each(|name| fields.set(name, number(0_u8))),
            false => fields.set("model", number(self.model)),
        }
        fields.set("first", number(self.first));
        fields.set("coding", number(coding));
        fields.set("unused", number(unused));
        fields.set("includes_own_slots", Value::Bool(self.includes_own_slots));
        fields.set("outcomes", Value::Bytes(bytes));
        let waypoints = self
            .waypoints
            .iter()
            .map(|waypoint| waypoint_value(waypoint, layout.has_depth))
            .collect::<Result<_, _>>()?;
        fields.set("waypoint", Value::List(waypoints));
        Ok(fields)
    }

    /// Builds the report from values that the schema has checked.
    fn from_fields(fields: &Fields) -> Result<Self, Error> {
        let single = |fields: &Fields, name: &str| numbers(fields, name).next().unwrap_or(0.0);
        let waypoint = |value: &Value| {
            let Value::Message(waypoint) = value else { return None };
            let part = |name| single(waypoint, name) as u8;
            Some(Waypoint { slots: part("slots"), east: part("east"), north: part("north"), depth: part("depth") })
        };
        let waypoints =
            if let Some(Value::List(waypoints)) = fields.get("waypoint") { waypoints.as_slice() } else { &[] };
        let bytes = if let Some(Value::Bytes(bytes)) = fields.get("outcomes") { bytes.clone() } else { Vec::new() };
        let (coding, unused) = (single(fields, "coding") as u8, single(fields, "unused") as u8);
        Ok(Self {
            sender: single(fields, "sender") as u8,
            model: single(fields, "model") as u16,
            first: single(fields, "first") as u32,
            includes_own_slots: matches!(fields.get("includes_own_slots"), Some(Value::Bool(true))),
            outcomes: decode(&Coded { coding, unused, bytes })?,
            waypoints: waypoints.iter().filter_map(waypoint).collect(),
        })
    }
}

fn waypoint_value(waypoint: &Waypoint, has_depth: bool) -> Result<Value, Error> {
    let mut fields = Fields::new();
    let parts = [("slots", waypoint.slots), ("east", waypoint.east), ("north", waypoint.north)];
    parts.into_iter().for_each(|(name, value)| fields.set(name, number(value)));
    match (has_depth, waypoint.depth) {
        (true, depth) => fields.set("depth", number(depth)),
        (false, 0) => {}
        (false, depth) => {
            let field = String::from("waypoint.depth");
            return Err(Error::OutOfBounds { field, min: 0.0, max: 0.0, value: depth.into() });
        }
    }
    Ok(Value::Message(fields))
}
