//! What a team agreed on, in the one form of bytes that its digest is of (docs/protocol.md, "What a team agrees on").

use dgpc::{Correlation, Prior, PriorMean, Reflection};
use pingmap_packet::{Key, digest, to_hex};

use crate::canonical::Writer;
use crate::chart::Chart;
use crate::event::{Link, VehicleId};
use crate::fading::Fading;
use crate::grid::Grid;
use crate::model::Model;
use crate::place::Place;
use crate::reference::{Geographic, ReferenceSystem};
use crate::slots::Slots;
use crate::team::Team;

/// Version of what bytes on the water mean: of the packets, their levels and the digest. It is in the digest, so that
/// packets of another version are another team's.
pub const PROTOCOL_VERSION: u16 = 4;

impl Team {
    /// Digest of all that gives a packet its meaning: chart, inputs, kernel and prior mean, what is known of the place, grid, members, frames,
    /// window, slots, epoch and key, in the version of the protocol. Whoever differs in one of these reads another team's
    /// packets as foreign. What a vehicle decides for itself (limits, what is worth a frame, repeats, how fading weighs its own events) and what is for
    /// learning alone (ties of length-scales, the chart's scale) is not in it.
    pub fn digest(&self) -> [u8; 32] {
        digest(&self.canonical_bytes())
    }

    /// The same of what decides about slots before this one alone: without changes of order from it on. A report is formed under the
    /// agreement about its latest slot, and a map message, which speaks of places and of no slots, under that without changes: so
    /// whoever missed a change still shares what was before it.
    pub(crate) fn digest_before(&self, slot: u32) -> [u8; 32] {
        let changes = self.slots.changes.iter().filter(|change| change.from < slot).cloned().collect();
        Self { slots: Slots { changes, ..self.slots.clone() }, ..self.clone() }.digest()
    }

    /// What [`Team::digest`] is the digest of.
    pub fn canonical_bytes(&self) -> Vec<u8> {
        let mut out = Writer::default();
        out.text("pingmap agreement");
        out.u16(PROTOCOL_VERSION);
        write_chart(&mut out, &self.model.chart);
        out.u8(self.model.inputs.has_depths().into());
        write_prior(&mut out, &self.model.prior);
        write_place(&mut out, self.model.place.as_deref());
        let Grid { cell_m, depth_cell_m, start_s, time_cell_s } = self.grid;
        [cell_m, depth_cell_m, start_s, time_cell_s].into_iter().for_each(|value| number(&mut out, value));
        out.u32(self.frame_bytes.min(u32::MAX as usize) as u32);
        out.u16(self.packets_per_sender_max);
        out.u16(self.reports_per_sender_max);
        out.u32(self.epoch);
        out.u32(self.members.len() as u32);
        for (member, name) in &self.members {
            out.u8(*member);
            out.text(name.as_str());
        }
        write_slots(&mut out, &self.slots);
        out.u8(self.key.is_some().into());
        self.key.iter().for_each(|key: &Key| out.bytes(&key.fingerprint()));
        out.finish()
    }
}

impl Model {
    /// 32 hexadecimal digits by which a model is known again, whatever its file: of all that decides what is predicted under it. Two models
    /// that differ in what is for learning alone have the same.
    pub fn digest(&self) -> String {
        let mut out = Writer::default();
        out.text("pingmap model");
        write_chart(&mut out, &self.chart);
        out.u8(self.inputs.has_depths().into());
        write_prior(&mut out, &self.prior);
        write_place(&mut out, self.place.as_deref());
        let Fading { correlation, memory_s, drift_m_per_s } = self.fading;
        [correlation, memory_s, drift_m_per_s].into_iter().for_each(|value| number(&mut out, value));
        to_hex(&digest(&out.finish())[..16])
    }
}

/// Minus zero means zero.
fn number(out: &mut Writer, value: f64) {
    out.f64(value + 0.0);
}

fn list(out: &mut Writer, values: &[usize]) {
    out.u32(values.len() as u32);
    values.iter().for_each(|&value| out.u32(value as u32));
}

fn write_chart(out: &mut Writer, chart: &Chart) {
    number(out, chart.origin.east_m);
    number(out, chart.origin.north_m);
    match chart.reference {
        ReferenceSystem::Unknown => [None, None].into_iter().for_each(|none| out.option(none)),
        ReferenceSystem::About(Geographic { latitude_deg, longitude_deg }) => {
            [latitude_deg, longitude_deg].into_iter().for_each(|degrees| out.option(Some(degrees + 0.0)));
        }
        ReferenceSystem::Epsg(code) => {
            // Neither the 0 nor the 1 of an option.
            out.u8(2);
            out.u32(code);
        }
    }
}

fn write_prior(out: &mut Writer, prior: &Prior) {
    write_mean(out, prior.mean());
    let terms = prior.kernel().terms();
    out.u32(terms.len() as u32);
    for term in terms {
        number(out, term.variance());
        out.u32(term.correlations().len() as u32);
        term.correlations().iter().for_each(|correlation| write_correlation(out, correlation));
        write_reflection(out, term.reflection());
    }
}

/// Links, and what is said of them; no links where nothing is known of the place.
fn write_place(out: &mut Writer, place: Option<&Place>) {
    let links = place.map_or(&[][..], Place::links);
    out.u32(links.len() as u32);
    for end in links.iter().flat_map(Link::ends) {
        number(out, end.east_m);
        number(out, end.north_m);
        out.option(end.depth_m.map(|depth_m| depth_m + 0.0));
    }
    if let Some(place) = place {
        place.precision_rows().flatten().for_each(|entry| number(out, entry));
        place.summary().whitened_shift().iter().for_each(|&entry| number(out, entry));
    }
}

/// Its kind, and its numbers.
fn write_mean(out: &mut Writer, mean: &PriorMean) {
    let (kind, numbers, columns): (&str, Vec<f64>, [&[usize]; 2]) = match mean {
        PriorMean::Constant(log_odds) => ("constant", vec![*log_odds], [&[], &[]]),
        PriorMean::Range(range) => ("range", vec![range.intercept(), range.slope()], [range.from(), range.to()]),
        _ => ("zero", Vec::new(), [&[], &[]]),
    };
    out.text(kind);
    out.u32(numbers.len() as u32);
    numbers.into_iter().for_each(|value| number(out, value));
    columns.into_iter().for_each(|columns| list(out, columns));
}

fn write_correlation(out: &mut Writer, correlation: &Correlation) {
    let shape = correlation.shape();
    out.text(shape.name());
    out.u32(shape.parameters().len() as u32);
    shape.parameters().iter().for_each(|&parameter| number(out, parameter));
    list(out, correlation.columns());
    correlation.length_scales().iter().for_each(|&length_scale| number(out, length_scale));
}

fn write_reflection(out: &mut Writer, reflection: Option<&Reflection>) {
    let images = reflection.map_or(&[][..], Reflection::images);
    out.u32(images.len() as u32);
    for image in images {
        out.u32(image.column as u32);
        out.u32(image.source as u32);
        out.u8(image.negated.into());
    }
}

/// The order from the beginning on, other orders from later slots on, and transmissions one by one if there are.
fn write_slots(out: &mut Writer, slots: &Slots) {
    let names = |out: &mut Writer, names: &[VehicleId]| {
        out.u32(names.len() as u32);
        names.iter().for_each(|name| out.text(name.as_str()));
    };
    number(out, slots.start_s);
    number(out, slots.duration_s);
    names(out, &slots.order);
    out.u32(slots.changes.len() as u32);
    for change in &slots.changes {
        out.u32(change.from);
        names(out, &change.order);
    }
    out.u8(slots.at_will.into());
    let listed = slots.listed.as_deref().unwrap_or_default();
    out.u32(listed.len() as u32);
    for opportunity in listed {
        number(out, opportunity.time_s);
        out.text(opportunity.sender.as_str());
        names(out, &opportunity.listeners);
    }
}
