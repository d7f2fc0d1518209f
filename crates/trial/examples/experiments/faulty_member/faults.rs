//! Packets of faulty members.

use std::sync::Arc;

use pingmap_agent::{Agent, AgentError, AgentOptions, Event, Sharing};
use pingmap_packet::{Block, Cell, MapMessage, Outcome, Point, Waypoint};
use pingmap_trial::{EventLog, Mission, send_frames};
use rand::{Rng, RngExt};

use super::PACKETS;

/// Faults of a member that sends summaries.
pub(super) const FAULTS: [&str; 8] =
    ["honest", "silent", "deaf", "random", "one lie", "reversed", "biased by 1/6", "biased by 1/2"];

/// Faults of a member that sends reports.
pub(super) const REPORT_FAULTS: [&str; 12] = [
    "honest",
    "silent",
    "deaf",
    "all heard",
    "random",
    "reversed",
    "1/5 reversed",
    "300 m east",
    "mirrored",
    "random track",
    "claims",
    "mirrored, claims",
];

/// Faults of a receiver, with both kinds of packets.
pub(super) const FAULTY_RECEIVERS: [&str; 5] = ["honest", "silent", "deaf", "random", "reversed"];

/// Largest magnitude of the mean of a point in a summary.
const MEAN_MAX: i8 = 15;

/// Largest information of a point in a summary.
const INFORMATION_MAX: u8 = 31;

type Packets = Vec<Vec<u8>>;

/// A member of a team that sends wrong packets.
pub(super) struct FaultyMember<'a> {
    log: &'a EventLog,
    member: &'a Agent,
    /// Packets of the member without a fault.
    honest: &'a [Vec<u8>],
    sharing: Sharing,
}

impl<'a> FaultyMember<'a> {
    pub(super) fn new(log: &'a EventLog, mission: &'a Mission, sharing: Sharing, place: usize) -> Self {
        Self { log, member: &mission.vehicles[place], honest: &mission.packets[place], sharing }
    }

    /// Returns the packets with this fault.
    pub(super) fn packets(&self, fault: &str, rng: &mut impl Rng) -> Result<Packets, AgentError> {
        let (summaries_alone, both) = (!self.sharing.reports, self.sharing.summaries && self.sharing.reports);
        let lower = |levels: i8| move |point: &mut Point| point.mean = (point.mean - levels).max(-MEAN_MAX);
        let lie = |point: &mut Point| {
            (point.information, point.mean) = (INFORMATION_MAX, if point.mean > 0 { -MEAN_MAX } else { MEAN_MAX });
        };
        let cells = (300.0 / (0.25 * self.member.team().grid.cell_m)).min(120.0) as u8;
        let mut mirror = |at: &mut Waypoint| (at.east, at.north) = (u8::MAX - at.east, u8::MAX - at.north);
        match fault {
            "all heard" => self.changed(PACKETS, &|_| (), &mut |_| true),
            "1/5 reversed" => self.changed(PACKETS, &|_| (), &mut |heard| heard != rng.random_bool(0.2)),
            "300 m east" => self.with_track(&mut |at| at.east = at.east.saturating_add(cells)),
            "mirrored" => self.with_track(&mut mirror),
            "random track" => self.with_track(&mut |at| (at.east, at.north) = (rng.random(), rng.random())),
            "claims" => Ok([self.honest.to_vec(), self.claims()?].concat()),
            "mirrored, claims" => Ok([self.with_track(&mut mirror)?, self.claims()?].concat()),
            "silent" => Ok(Vec::new()),
            "deaf" if self.sharing.summaries => self.with_receiver(&mut |_| false),
            "random" if both => self.with_receiver(&mut |_| rng.random()),
            "reversed" if both => self.with_receiver(&mut |heard| !heard),
            "deaf" => self.changed(PACKETS, &|_| (), &mut |_| false),
            "random" if summaries_alone => (0..PACKETS).map(|counter| self.random(counter as u16, rng)).collect(),
            "random" => self.changed(PACKETS, &|_| (), &mut |_| rng.random()),
            "one lie" => self.changed(1, &lie, &mut |heard| !heard),
            "reversed" => self.changed(PACKETS, &|point| point.mean = -point.mean, &mut |heard| !heard),
            "biased by 1/6" => self.changed(PACKETS, &lower(1), &mut |heard| heard),
            "biased by 1/2" => self.changed(PACKETS, &lower(3), &mut |heard| heard),
            _ => Ok(self.honest.to_vec()),
        }
    }

    /// Returns the packets of a member with a faulty receiver: `hear` maps each true outcome to the recorded one.
    fn with_receiver(&self, hear: &mut dyn FnMut(bool) -> bool) -> Result<Packets, AgentError> {
        let mut faulty = self.agent(self.sharing);
        faulty.record_positions(self.log.track(self.member.id()))?;
        let heard = self.member.events().map(|event| Event { success: hear(event.success), ..event.clone() });
        faulty.record(heard)?;
        faulty.refit()?;
        send_frames(&mut faulty, PACKETS)
    }

    /// Returns reports that claim every slot of the member as unused.
    fn claims(&self) -> Result<Packets, AgentError> {
        let mut agent = self.agent(Sharing::reports());
        let slots = &self.member.team().slots;
        let own = (0..slots.end()).filter(|&slot| slots.sender(slot) == Some(self.member.id()));
        agent.record_unused_slots(own.filter_map(|slot| slots.begin_s(slot)))?;
        agent.record_positions(self.member.events().map(|event| (event.time_s, event.link.receiver)))?;
        send_frames(&mut agent, usize::MAX)
    }

    /// Returns an agent of the member without data.
    fn agent(&self, sharing: Sharing) -> Agent {
        let options = AgentOptions { sharing, ..AgentOptions::default() };
        Agent::new(self.member.id().clone(), Arc::new(self.member.team().clone()), options)
    }

    /// Returns a valid summary with random numbers.
    fn random(&self, counter: u16, rng: &mut impl Rng) -> Result<Vec<u8>, AgentError> {
        let team = self.member.team();
        let layout = team.layout(team.frame_bytes)?;
        let mut cell = || Cell { east: rng.random_range(0..64), north: rng.random_range(0..64), depth: 0 };
        let places: Vec<[Cell; 2]> = (0..layout.points_in_all()).map(|_| [cell(), cell()]).collect();
        let point = |[transmitter, receiver]: [Cell; 2]| Point {
            transmitter,
            receiver,
            information: rng.random_range(0..=INFORMATION_MAX),
            mean: rng.random_range(-MEAN_MAX..=MEAN_MAX),
        };
        let points: Vec<Point> = places.into_iter().map(point).collect();
        let blocks = points.chunks(layout.points).map(|points| Block {
            time: rng.random_range(0..64),
            points: points.to_vec(),
            correlations: (0..layout.correlations()).map(|_| rng.random_range(-3..=3)).collect(),
        });
        let sender = team.number(self.member.id()).unwrap_or_default();
        let message = MapMessage { sender, counter, model: 0, blocks: blocks.collect() };
        Ok(self.member.codec().write(layout, &message)?)
    }

    /// Returns the packets with changes of the first `count`: of points in summaries, or of outcomes in reports.
    fn changed(
        &self,
        count: usize,
        change: &dyn Fn(&mut Point),
        hear: &mut dyn FnMut(bool) -> bool,
    ) -> Result<Packets, AgentError> {
        let changed = self.honest.iter().take(count).map(|bytes| match self.sharing.reports {
            false => self.changed_summary(bytes, change),
            true => self.changed_report(bytes, hear),
        });
        changed.chain(self.honest.iter().skip(count).cloned().map(Ok)).collect()
    }

    /// Returns the packets with changed waypoints in reports.
    fn with_track(&self, change: &mut dyn FnMut(&mut Waypoint)) -> Result<Packets, AgentError> {
        self.honest.iter().map(|bytes| self.changed_track(bytes, change)).collect()
    }

    /// Returns a summary with changed points.
    fn changed_summary(&self, bytes: &[u8], change: &dyn Fn(&mut Point)) -> Result<Vec<u8>, AgentError> {
        let Ok((layout, mut message)) = self.member.codec().read(bytes) else { return Ok(bytes.to_vec()) };
        let points = message.blocks.iter_mut().flat_map(|block| &mut block.points);
        points.filter(|point| point.information > 0).for_each(change);
        Ok(self.member.codec().write(layout, &message)?)
    }

    /// Returns a report with changed waypoints.
    fn changed_track(&self, bytes: &[u8], change: &mut dyn FnMut(&mut Waypoint)) -> Result<Vec<u8>, AgentError> {
        let Ok((_, mut report, _)) = self.member.codec().read_report(bytes) else { return Ok(bytes.to_vec()) };
        report.waypoints.iter_mut().for_each(change);
        Ok(self.member.codec().write_report(&report)?)
    }

    /// Returns a report with changed outcomes.
    fn changed_report(&self, bytes: &[u8], hear: &mut dyn FnMut(bool) -> bool) -> Result<Vec<u8>, AgentError> {
        let Ok((_, mut report, _)) = self.member.codec().read_report(bytes) else { return Ok(bytes.to_vec()) };
        for outcome in report.outcomes.iter_mut().filter(|outcome| **outcome != Outcome::Unreported) {
            *outcome = if hear(*outcome == Outcome::Heard) { Outcome::Heard } else { Outcome::Missed };
        }
        Ok(self.member.codec().write_report(&report)?)
    }
}
