//! Runs the mission of a log with processes.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use anyhow::Context;
use pingmap_agent::{Event, Position, VehicleId};
use pingmap_trial::{EventLog, Score, TrafficPlan, transmissions};
use pingmap_vehicle::{
    At, Departed, FrameIn, FrameLink, FrameRequest, Heard, Input, LearnedEvent, Listening, Message, Nav, Peer,
    PeerSource, PiggybackIn, PiggybackRequest, Place, StatusReport, Trust,
};

use super::process::Process;
use super::setup::Setup;

/// Parts of the mission in the report.
const PARTS: usize = 4;

/// The state of one vehicle at a time of the mission.
#[derive(Debug, Clone)]
pub struct Known {
    /// Share of the mission that has passed.
    pub share: f64,
    pub time_s: f64,
    pub vehicle: VehicleId,
    pub own_events: usize,
    /// Events of other members that are located.
    pub other_events: usize,
    /// Mean NLL of own events so far, each predicted before it was learned, and their number.
    pub nll: Option<f64>,
    pub scored: usize,
    pub trust: Trust,
}

/// The vehicle that was killed.
#[derive(Debug, Clone)]
pub struct Killed {
    pub vehicle: VehicleId,
    pub time_s: f64,
    /// Own events before and after.
    pub events: [usize; 2],
}

/// The result of a mission.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// States at the quarters of the mission, all vehicles at each.
    pub known: Vec<Known>,
    pub killed: Option<Killed>,
    pub frames: usize,
    /// Mean NLL of all scored events, and their number.
    pub nll: f64,
    pub scored: usize,
}

/// A mission under way.
pub struct Mission<'a> {
    log: &'a EventLog,
    setup: &'a Setup,
    traffic: TrafficPlan,
    program: PathBuf,
    processes: BTreeMap<VehicleId, Process>,
    /// NLL of the events of each vehicle.
    losses: BTreeMap<VehicleId, Vec<f64>>,
    /// Number of transmissions of each vehicle.
    transmissions: BTreeMap<VehicleId, usize>,
    /// The first slot that no message was about.
    next_slot: u32,
    frames: usize,
    known: Vec<Known>,
    killed: Option<Killed>,
}

impl<'a> Mission<'a> {
    /// Starts one process for each vehicle.
    pub fn start(log: &'a EventLog, setup: &'a Setup, traffic: TrafficPlan, program: &Path) -> anyhow::Result<Self> {
        let start = |(id, config): (&VehicleId, &PathBuf)| Ok((id.clone(), Process::start(id, program, config)?));
        let processes = setup.configs.iter().map(start).collect::<anyhow::Result<_>>()?;
        Ok(Self {
            log,
            setup,
            traffic,
            program: program.into(),
            processes,
            losses: BTreeMap::new(),
            transmissions: BTreeMap::new(),
            next_slot: 0,
            frames: 0,
            known: Vec::new(),
            killed: None,
        })
    }

    /// Runs the mission. Half-way the vehicle with the first name is killed and started again, if `kills`.
    pub fn run(&mut self, kills: bool, step: &dyn Fn()) -> anyhow::Result<()> {
        let all = transmissions(&self.log.events);
        for (number, events) in all.iter().enumerate() {
            let Some(first) = events.first() else { continue };
            self.transmit(events)?;
            events.iter().for_each(|_| step());
            let passed = number + 1;
            if kills && passed == all.len() / 2 {
                self.kill_first(first.time_s)?;
            }
            let parts = (1..PARTS).filter(|part| passed == part * all.len() / PARTS);
            for part in parts {
                self.note_known(part as f64 / PARTS as f64, first.time_s)?;
            }
        }
        Ok(())
    }

    /// Lets the last slots be counted, and ends all processes.
    pub fn finish(mut self) -> anyhow::Result<Outcome> {
        let last = self.log.events.iter().max_by(|a, b| a.time_s.total_cmp(&b.time_s)).cloned();
        if let Some(last) = last {
            let time_s = last.time_s + 60.0 + 2.0 * self.setup.team.slots.duration_s;
            let ids: Vec<VehicleId> = self.processes.keys().cloned().collect();
            for id in &ids {
                let not = Some("after the mission".to_owned());
                let from = last.time_s + self.setup.team.slots.duration_s;
                self.tell(id, &Input::Listening(Listening { from, to: time_s, not }))?;
            }
            self.collect()?;
            self.note_known(1.0, time_s)?;
        }
        for process in std::mem::take(&mut self.processes).into_values() {
            process.stop()?;
        }
        let losses: Vec<f64> = self.losses.into_values().flatten().collect();
        let nll = losses.iter().sum::<f64>() / losses.len() as f64;
        Ok(Outcome { known: self.known, killed: self.killed, frames: self.frames, nll, scored: losses.len() })
    }

    fn tell(&mut self, id: &VehicleId, input: &Input) -> anyhow::Result<()> {
        // A vehicle of the log that is no member only appears in events.
        self.processes.get_mut(id).map_or(Ok(()), |process| process.tell(input))
    }

    /// One transmission of the log, with the event of each receiver.
    fn transmit(&mut self, events: &[&Event]) -> anyhow::Result<()> {
        let time_s = events[0].time_s;
        let sender = events[0].transmitter_id.clone();
        let receivers: BTreeSet<VehicleId> = events.iter().map(|event| event.receiver_id.clone()).collect();
        self.close_slots(time_s, &receivers)?;
        self.tell(&sender, &nav(time_s, &events[0].link.transmitter))?;
        for event in events {
            self.tell(&event.receiver_id, &nav(time_s, &event.link.receiver))?;
            let (member, source) = (sender.clone(), PeerSource::Other);
            let position = place(&event.link.transmitter);
            self.tell(&event.receiver_id, &Input::Peer(Peer { time: time_s, member, position, source }))?;
        }
        let piggyback = self.piggyback(&sender, time_s)?;
        let frame = self.frame(&sender, time_s)?;
        for event in events.iter().filter(|event| event.success) {
            self.deliver(event, piggyback.as_ref(), frame.as_ref())?;
        }
        self.collect()
    }

    /// Reports that vehicles did not listen in slots for which the log has no event of theirs.
    fn close_slots(&mut self, time_s: f64, receivers: &BTreeSet<VehicleId>) -> anyhow::Result<()> {
        let slots = &self.setup.team.slots;
        let now = slots.number(time_s).context("a slot of the log")?;
        let duration_s = slots.duration_s;
        let mut silent = Vec::new();
        for slot in self.next_slot..=now {
            let begin_s = slots.begin_s(slot).context("a slot of the log")?;
            let strangers = self.processes.keys().filter(|id| slot < now || !receivers.contains(*id));
            let strangers = strangers.filter(|id| slots.sender(slot).is_some_and(|sender| sender != *id));
            silent.extend(strangers.map(|id| (id.clone(), begin_s)));
        }
        self.next_slot = now + 1;
        for (id, from) in silent {
            let (to, not) = (from + duration_s, Some("no event in the log".to_owned()));
            // The end of the present slot is not reached yet.
            let to = to.min(time_s.max(from + 0.5 * duration_s));
            self.tell(&id, &Input::Listening(Listening { from, to, not }))?;
        }
        Ok(())
    }

    fn piggyback(&mut self, sender: &VehicleId, time_s: f64) -> anyhow::Result<Option<(String, usize)>> {
        let n_bits = 8 * self.traffic.piggyback_bytes;
        let Some(process) = self.processes.get_mut(sender).filter(|_| n_bits > 0) else { return Ok(None) };
        process.wait()?;
        match process.ask(&Input::PiggybackRequest(PiggybackRequest { time: time_s, n_bits }))? {
            Message::Piggyback { bits, n_bits, .. } => Ok(Some((bits, n_bits))),
            _ => Ok(None),
        }
    }

    /// Asks the sender for a frame if one is due, and lets it leave.
    fn frame(&mut self, sender: &VehicleId, time_s: f64) -> anyhow::Result<Option<FrameIn>> {
        let count = self.transmissions.entry(sender.clone()).or_default();
        *count += 1;
        let is_due = self.traffic.slot_every.is_some_and(|every| count.is_multiple_of(every));
        let Some(process) = self.processes.get_mut(sender) else { return Ok(None) };
        process.wait()?;
        if is_due {
            let bytes = self.setup.team.frame_bytes;
            if let Message::Frame { token, bytes, .. } =
                process.ask(&Input::FrameRequest(FrameRequest { time: time_s, bytes }))?
            {
                process.tell(&Input::Departed(Departed { token, time: time_s }))?;
                self.frames += 1;
                let (from, link) = (Some(sender.clone()), FrameLink::Acoustic);
                return Ok(Some(FrameIn { time: time_s, from, bytes, link }));
            }
        }
        process.tell(&Input::Sent(At { time: time_s, kind: None }))?;
        Ok(None)
    }

    fn deliver(
        &mut self,
        event: &Event,
        piggyback: Option<&(String, usize)>,
        frame: Option<&FrameIn>,
    ) -> anyhow::Result<()> {
        let (time, from) = (event.time_s, event.transmitter_id.clone());
        let receiver = &event.receiver_id;
        self.tell(receiver, &Input::Heard(Heard { time, from: from.clone(), kind: None, frames: Vec::new() }))?;
        if let Some((bits, n_bits)) = piggyback.cloned() {
            self.tell(receiver, &Input::PiggybackIn(PiggybackIn { time, from, bits, n_bits }))?;
        }
        frame.map_or(Ok(()), |frame| self.tell(receiver, &Input::FrameIn(frame.clone())))
    }

    /// Waits for all answers, and scores the events that the vehicles have counted.
    fn collect(&mut self) -> anyhow::Result<()> {
        for (id, process) in &mut self.processes {
            process.wait()?;
            let losses = self.losses.entry(id.clone()).or_default();
            losses.extend(process.take_events().iter().filter_map(loss));
        }
        Ok(())
    }

    fn kill_first(&mut self, time_s: f64) -> anyhow::Result<()> {
        let Some((id, mut process)) = self.processes.pop_first() else { return Ok(()) };
        let before = process.status()?;
        process.kill()?;
        let config = self.setup.configs.get(&id).context("a configuration")?;
        let mut process = Process::start(&id, &self.program, config)?;
        let after: StatusReport = process.status()?;
        self.processes.insert(id.clone(), process);
        self.killed = Some(Killed { vehicle: id, time_s, events: [before.own_events, after.own_events] });
        Ok(())
    }

    fn note_known(&mut self, share: f64, time_s: f64) -> anyhow::Result<()> {
        for (id, process) in &mut self.processes {
            let status = process.status()?;
            let losses = self.losses.get(id).map_or(&[][..], Vec::as_slice);
            let scored = losses.len();
            let nll = (scored > 0).then(|| losses.iter().sum::<f64>() / scored as f64);
            let (own_events, other_events) = (status.own_events, status.located_events);
            let (vehicle, trust) = (id.clone(), status.trust);
            self.known.push(Known { share, time_s, vehicle, own_events, other_events, nll, scored, trust });
        }
        Ok(())
    }
}

fn nav(time: f64, at: &Position) -> Input {
    Input::Nav(Nav { time, clock_sigma: None, position: place(at), sigma: None, surfaced: false })
}

fn place(at: &Position) -> Place {
    let (x, y) = (Some(at.east_m), Some(at.north_m));
    Place { x, y, depth: at.depth_m, heading: at.heading_deg, ..Place::default() }
}

/// The NLL of an event that was predicted before it was learned.
fn loss(event: &LearnedEvent) -> Option<f64> {
    Some(Score::new(&[event.probability?], &[event.heard])?.nll)
}
