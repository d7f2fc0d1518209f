//! Whether a receiver could have heard, whatever became of the message.

use pingmap_agent::Link;

use crate::clocks::Clocks;
use crate::fleet::Fleet;
use crate::recording::{Unknown, bands_differ};
use crate::transmission::{Proof, Transmission};

/// When vehicles were sending themselves, each on its own clock, in the order of time.
pub(crate) struct Sending(Vec<Vec<f64>>);

impl Sending {
    pub(crate) fn of(fleet: &Fleet, clocks: &Clocks, sent: &[Vec<Transmission>]) -> Self {
        let own = |(sender, sent): (usize, &Vec<Transmission>)| {
            let certain = sent.iter().filter(|sent| sent.proof != Proof::Nothing);
            let mut times: Vec<f64> = certain.map(|sent| clocks.local_s(sent, sender)).collect();
            times.sort_by(f64::total_cmp);
            times
        };
        debug_assert_eq!(fleet.vehicles.len(), sent.len());
        Self(sent.iter().enumerate().map(own).collect())
    }

    fn is_within(&self, vehicle: usize, from_s: f64, to_s: f64) -> bool {
        let times = &self.0[vehicle];
        times.get(times.partition_point(|time_s| *time_s <= from_s)).is_some_and(|time_s| *time_s < to_s)
    }
}

/// What stands against counting a transmission as heard or missed by a receiver, where both were or may have been. The outcome is not
/// asked for, so that heard and missed ones are left out alike.
pub(crate) fn unknown(
    fleet: &Fleet,
    clocks: &Clocks,
    sending: &Sending,
    (sender, sent): (usize, &Transmission),
    (receiver, link): (usize, Option<Link>),
) -> Option<Unknown> {
    if sent.proof == Proof::Nothing {
        return Some(Unknown::NotKnownSent);
    }
    let rules = fleet.rules;
    if sent.destination_unknown && !rules.overhear {
        return Some(Unknown::DestinationUnknown);
    }
    let recording = fleet.vehicles[receiver].recording;
    let arrival_s = clocks.expected_s(fleet, (sender, sent), receiver);
    let begin_s = arrival_s - clocks.delay_s;
    let is_at_work = |span: &(f64, f64)| span.0 <= arrival_s && arrival_s <= span.1;
    if !fleet.vehicles[receiver].at_work.iter().any(is_at_work) {
        return Some(Unknown::NotRecording);
    }
    if sending.is_within(receiver, begin_s - rules.message_s, begin_s + rules.message_s) {
        return Some(Unknown::Transmitting);
    }
    if let Some(deaf) = recording.deaf.iter().find(|deaf| deaf.0 <= begin_s + rules.message_s && begin_s <= deaf.1) {
        return Some(deaf.2);
    }
    let worked = |vehicle: usize, time_s| fleet.vehicles[vehicle].recording.band(time_s);
    let sent_in = sent.band.as_deref().or_else(|| worked(sender, clocks.local_s(sent, sender)));
    let bands = sent_in.zip(worked(receiver, begin_s));
    if bands.is_some_and(|(sent, heard)| bands_differ(sent, heard)) {
        return Some(Unknown::OtherMode);
    }
    // The clock of a sender that only others tell of says where it was, and nothing of what was heard.
    let is_unsure = |clock: usize| !clocks.clocks[clock].known;
    if sent.doubtful_at.contains(&receiver) || is_unsure(sent.clock) || is_unsure(receiver) {
        return Some(Unknown::ClockUnsure);
    }
    let Some(link) = link else { return Some(Unknown::NoNavigation) };
    let is_up = |depth_m: f64| rules.surfaced_above_m.is_some_and(|above_m| depth_m < above_m);
    link.ends().iter().filter_map(|end| end.depth_m).any(is_up).then_some(Unknown::Surfaced)
}
