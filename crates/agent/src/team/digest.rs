//! Digests of team configurations and models, and the canonical bytes that they cover
//! (docs/reference/protocol.md, "Team configuration").

use dgpc::{Correlation, Prior, PriorMean, Reflection};
use pingmap_packet::{Key, digest, to_hex};

use crate::model::fading::Fading;
use crate::model::link_model::Model;
use crate::model::site_prior::SitePrior;
use crate::team::canonical::Writer;
use crate::team::config::Team;
use crate::team::grid::Grid;
use crate::team::slots::Slots;
use crate::types::chart::Chart;
use crate::types::event::{Link, VehicleId};
use crate::types::reference_system::{Geographic, ReferenceSystem};

/// Version of the protocol: of packets, quantisation levels and the digest. The digest covers it, so packets of another
/// version belong to another team.
pub const PROTOCOL_VERSION: u16 = 5;

impl Team {
    /// Returns the digest of the team configuration. Packets of a team with another digest are foreign.
    ///
    /// The digest covers every setting that gives a packet its meaning:
    /// * the version of the protocol;
    /// * the model: chart, inputs, kernel, prior mean and site prior;
    /// * the grid, the members, the slots, the epoch and the key;
    /// * the frame size, and the numbers of packets and reports that count.
    ///
    /// The digest does not cover settings that each vehicle chooses for itself:
    /// * minimum gain, exclusion threshold, maximum numbers of transmissions, and limits;
    /// * track tolerance, extrapolation, and piggybacking;
    /// * the fading model.
    ///
    /// It does not cover settings for learning alone: ties of length-scales, and the chart's scale.
    pub fn digest(&self) -> [u8; 32] {
        digest(&self.canonical_bytes())
    }

    /// Returns the bytes that [`Team::digest`] covers. docs/reference/protocol.md specifies them.
    pub fn canonical_bytes(&self) -> Vec<u8> {
        let mut out = Writer::default();
        out.text("pingmap team configuration");
        out.u16(PROTOCOL_VERSION);
        write_chart(&mut out, &self.model.chart);
        out.u8(self.model.inputs.has_depths().into());
        write_prior(&mut out, &self.model.prior);
        write_site_prior(&mut out, self.model.site.as_deref());
        let Grid { cell_m, depth_cell_m, start_s, time_cell_s } = self.grid;
        [cell_m, depth_cell_m, start_s, time_cell_s].into_iter().for_each(|value| write_number(&mut out, value));
        out.u32(self.frame_bytes.min(u32::MAX as usize) as u32);
        out.u16(self.packets_per_sender_max);
        out.u16(self.reports_per_sender_max);
        out.u32(self.epoch);
        out.u32(self.members.len() as u32);
        for (member, name) in self.members.iter() {
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
    /// Returns the digest of the model, as 32 hexadecimal digits. It covers everything that predictions depend on, but
    /// neither the file nor settings for learning alone.
    pub fn digest(&self) -> String {
        let mut out = Writer::default();
        out.text("pingmap model");
        write_chart(&mut out, &self.chart);
        out.u8(self.inputs.has_depths().into());
        write_prior(&mut out, &self.prior);
        write_site_prior(&mut out, self.site.as_deref());
        let Fading { correlation, memory_s, drift_m_per_s } = self.fading;
        [correlation, memory_s, drift_m_per_s].into_iter().for_each(|value| write_number(&mut out, value));
        to_hex(&digest(&out.finish())[..16])
    }
}

/// Writes a number. Minus zero is written as zero.
fn write_number(out: &mut Writer, value: f64) {
    out.f64(value + 0.0);
}

fn write_list(out: &mut Writer, values: &[usize]) {
    out.u32(values.len() as u32);
    values.iter().for_each(|&value| out.u32(value as u32));
}

fn write_chart(out: &mut Writer, chart: &Chart) {
    write_number(out, chart.origin.east_m);
    write_number(out, chart.origin.north_m);
    match chart.reference {
        ReferenceSystem::Unknown => [None, None].into_iter().for_each(|none| out.option(none)),
        ReferenceSystem::About(Geographic { latitude_deg, longitude_deg }) => {
            [latitude_deg, longitude_deg].into_iter().for_each(|degrees| out.option(Some(degrees + 0.0)));
        }
        ReferenceSystem::Epsg(code) => {
            // An option begins with 0 or 1.
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
        write_number(out, term.variance());
        out.u32(term.correlations().len() as u32);
        term.correlations().iter().for_each(|correlation| write_correlation(out, correlation));
        write_reflection(out, term.reflection());
        write_number(out, term.reciprocity());
    }
}

/// Writes the links of a site prior, then its whitened precision and shift. Without a site prior the list of links is
/// empty.
fn write_site_prior(out: &mut Writer, site: Option<&SitePrior>) {
    let links = site.map_or(&[][..], SitePrior::links);
    out.u32(links.len() as u32);
    for end in links.iter().flat_map(Link::ends) {
        write_number(out, end.east_m);
        write_number(out, end.north_m);
        out.option(end.depth_m.map(|depth_m| depth_m + 0.0));
    }
    if let Some(site) = site {
        site.precision_rows().flatten().for_each(|entry| write_number(out, entry));
        site.summary().whitened_shift().iter().for_each(|&entry| write_number(out, entry));
    }
}

/// Writes the kind of a prior mean, its numbers, and the columns of its range.
fn write_mean(out: &mut Writer, mean: &PriorMean) {
    let (kind, numbers, columns): (&str, Vec<f64>, [&[usize]; 2]) = match mean {
        PriorMean::Constant(log_odds) => ("constant", vec![*log_odds], [&[], &[]]),
        PriorMean::Range(range) => ("range", vec![range.intercept(), range.slope()], [range.from(), range.to()]),
        _ => ("zero", Vec::new(), [&[], &[]]),
    };
    out.text(kind);
    out.u32(numbers.len() as u32);
    numbers.into_iter().for_each(|value| write_number(out, value));
    columns.into_iter().for_each(|columns| write_list(out, columns));
}

fn write_correlation(out: &mut Writer, correlation: &Correlation) {
    let shape = correlation.shape();
    out.text(shape.name());
    out.u32(shape.parameters().len() as u32);
    shape.parameters().iter().for_each(|&parameter| write_number(out, parameter));
    write_list(out, correlation.columns());
    correlation.length_scales().iter().for_each(|&length_scale| write_number(out, length_scale));
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

/// Writes the cycle, then the explicit transmissions.
fn write_slots(out: &mut Writer, slots: &Slots) {
    let names = |out: &mut Writer, names: &[VehicleId]| {
        out.u32(names.len() as u32);
        names.iter().for_each(|name| out.text(name.as_str()));
    };
    write_number(out, slots.start_s);
    write_number(out, slots.duration_s);
    names(out, &slots.order);
    let explicit = slots.explicit.as_deref().unwrap_or_default();
    out.u32(explicit.len() as u32);
    for transmission in explicit {
        write_number(out, transmission.time_s);
        out.text(transmission.sender.as_str());
        names(out, &transmission.listeners);
    }
}
