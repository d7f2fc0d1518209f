//! Counts slots: heard, missed, or excluded by a rule that does not depend on the outcome.

use std::collections::BTreeMap;

use pingmap_agent::{AgentError, Event, Link, VehicleId, Which};

use crate::protocol::fault::{Fault, FaultCode};
use crate::protocol::output::{LearnedEvent, Message};
use crate::vehicle::ledger::{LedgerRecord, NO_INPUT, NOT_RUNNING, SlotOutcome, WRONG_CLOCK, span_s};
use crate::vehicle::record::Record;
use crate::vehicle::state::Vehicle;
use crate::vehicle::trust::Score;

pub(crate) const SURFACED: &str = "surfaced";
pub(crate) const CLOCK: &str = "clock uncertain";
pub(crate) const LOST_MESSAGES: &str = "messages dropped";

impl Vehicle {
    /// Notes that a message of another member arrived at a time.
    pub(crate) fn note_reception(&mut self, from: &VehicleId, time_s: f64) -> Result<(), Fault> {
        if self.ledger.clock_s().is_some_and(|clock_s| time_s - clock_s <= self.config.clock.gap_s) {
            let latest_s = self.arrivals_s.entry(from.clone()).or_insert(time_s);
            *latest_s = latest_s.max(time_s);
        }
        match self.agent.team().slots.sent_in(time_s, from) {
            Some(slot) if self.ledger.has_heard(slot) => {}
            Some(slot) if self.ledger.is_settled(slot) => self.late_receptions += 1,
            Some(slot) => self.change_ledger(LedgerRecord::Heard { slot }),
            None => self.note_reception_in_other_slot(from, time_s)?,
        }
        Ok(())
    }

    /// Notes a reception in a slot of another member. It never counts, and may show a wrong clock. Receptions of one
    /// member in one slot are one outcome, which bounds their number.
    fn note_reception_in_other_slot(&mut self, from: &VehicleId, time_s: f64) -> Result<(), Fault> {
        let slots = &self.agent.team().slots;
        let begin_s = self.ledger.clock_s().and(slots.number(time_s)).and_then(|slot| slots.begin_s(slot));
        let Some(begin_s) = begin_s else { return Ok(()) };
        let entry = self.agent.record_outcome(from, begin_s, true).map_err(|error| failed(&error))?;
        self.records.extend(entry.map(Record::Entry));
        Ok(())
    }

    /// Counts the slots that ended long enough ago.
    pub(crate) fn count_slots(&mut self) {
        let due = self.ledger.due(&self.agent.team().slots, self.config.slots.settle_s);
        // The vehicle does not know yet since when it runs.
        if self.is_starting || due.is_empty() {
            return;
        }
        self.forget_scores_of_unused_slots();
        let slots = self.agent.team().slots.clone();
        let news = self.modem.finish_before(slots.begin_s(due.end).unwrap_or(f64::INFINITY));
        self.note_modem_news(news);
        let own = self.id().clone();
        let mut excluded = BTreeMap::<String, u64>::new();
        for slot in due.clone() {
            let Some((sender, span_s)) = slots.sender(slot).zip(span_s(&slots, slot)) else { continue };
            if *sender == own {
                self.count_own_slot(slot, span_s);
                continue;
            }
            match self.ledger.outcome(slot, span_s, self.config.slots.listens) {
                SlotOutcome::Excluded(reason) => *excluded.entry(reason).or_default() += 1,
                SlotOutcome::Counts { heard } => {
                    if let Err(error) = self.learn(sender, slot, span_s.0, heard) {
                        let fault = failed(&error);
                        self.send(Message::Error { input: self.inputs, fault });
                    }
                }
            }
        }
        self.change_ledger(LedgerRecord::Settled { next: due.end, excluded });
        self.ledger.forget_intervals(&slots);
        self.copies.forget_before(due.end);
        self.refit_if_due();
    }

    /// Tells the team that an own slot was not used.
    fn count_own_slot(&mut self, slot: u32, span_s: (f64, f64)) {
        let is_open = self.open_frames.values().any(|&expected| expected == Some(slot));
        let was_running = !self.ledger.is_deaf_for(&[NOT_RUNNING, NO_INPUT, WRONG_CLOCK, LOST_MESSAGES], span_s);
        if self.config.slots.reports_transmissions && was_running && !is_open && !self.ledger.has_sent(slot) {
            let entries = self.agent.record_unused_slots([span_s.0]).unwrap_or_default();
            self.records.extend(entries.into_iter().map(Record::Entry));
        }
    }

    /// Learns the outcome of a slot: as an event if the host knows both positions independently of receptions, and
    /// else as an outcome without positions.
    fn learn(&mut self, from: &VehicleId, slot: u32, time_s: f64, heard: bool) -> Result<(), AgentError> {
        let gap_s = self.gap_s_max();
        let (own, positions) = (self.id(), &self.positions);
        let exact = positions.at(from, time_s, gap_s).zip(positions.at(own, time_s, gap_s));
        // The latest positions before the slot predict it. They do not depend on whether it was heard.
        let near = |id: &VehicleId| positions.at(id, time_s, gap_s).or_else(|| positions.before(id, time_s, gap_s));
        let ends = exact.or_else(|| positions.before(from, time_s, gap_s).zip(near(own)));
        let event = ends.map(|(transmitter, receiver)| Event {
            time_s,
            transmitter_id: from.clone(),
            receiver_id: own.clone(),
            link: Link { transmitter, receiver },
            kind: None,
            success: heard,
        });
        let event = event.filter(|event| self.is_usable(event));
        let is_known_unused = !heard && !self.agent.has_transmitted(from, time_s);
        let scored = event.as_ref().filter(|_| !is_known_unused);
        let score = scored.map(|event| self.score(event, slot)).transpose().unwrap_or_else(|error| {
            let fault = failed(&error);
            self.send(Message::Error { input: self.inputs, fault });
            None
        });
        let entries = match event.filter(|_| exact.is_some()) {
            Some(event) => self.agent.record([event])?,
            None => self.agent.record_outcome(from, time_s, heard)?.into_iter().collect(),
        };
        let applied = self.copies.apply(&entries);
        self.records.extend(entries.into_iter().map(Record::Entry));
        applied?;
        let (probability, by_range) = score.as_ref().map(|score| (score.map, score.by_range)).unzip();
        if let Some(score) = score {
            self.scores.add(score.clone());
            self.records.push(Record::Score(score));
        }
        if is_known_unused {
            return Ok(());
        }
        self.send(Message::Event(LearnedEvent { time: time_s, from: from.clone(), heard, probability, by_range }));
        Ok(())
    }

    /// Predicts the event of a slot with the data from before the slot. Data that arrive with the message itself would
    /// reveal the outcome.
    fn score(&mut self, event: &Event, slot: u32) -> Result<Score, AgentError> {
        let agent = self.copies.before(slot).unwrap_or(&mut self.agent);
        let map = agent.predict([event.query()], Which::Fused)?[0].probability;
        let by_range = self.probability_by_range(&event.link);
        let (from, time_s, range_m) = (event.transmitter_id.clone(), event.time_s, event.link.range_m());
        Ok(Score { from, time_s, map, by_range, range_m, heard: event.success })
    }

    /// Removes the scores of slots that their senders reported as unused. O(members log N) for each of the latest 2000
    /// events.
    pub(crate) fn forget_scores_of_unused_slots(&mut self) {
        let agent = &self.agent;
        self.scores.retain(|member, time_s| agent.has_transmitted(member, time_s));
    }

    pub(crate) fn probability_by_range(&mut self, link: &Link) -> f64 {
        self.by_range.probability(&self.scores, self.config.conservative_range_m, link)
    }

    /// Fits again if enough data changed. The last fit stays after a failure.
    pub(crate) fn refit_if_due(&mut self) {
        if !self.agent.refit_due() {
            return;
        }
        if let Err(error) = self.agent.refit() {
            let fault = failed(&error);
            self.send(Message::Error { input: self.inputs, fault });
        }
    }
}

pub(crate) fn failed(error: &AgentError) -> Fault {
    Fault::new(FaultCode::Failed, format!("a computation failed: {error}"))
}
