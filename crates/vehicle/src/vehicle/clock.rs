//! The clock of the vehicle: the times of navigation and of listening. Receptions do not move it.

use std::collections::BTreeMap;

use crate::protocol::fault::{Fault, FaultCode};
use crate::protocol::output::Message;
use crate::vehicle::check::LEAD_S_MAX;
use crate::vehicle::ledger::{AfterGap, LedgerRecord};
use crate::vehicle::state::Vehicle;

pub(crate) const NOT_RUNNING: &str = "the vehicle was not running";
pub(crate) const NO_INPUT: &str = "no input from the host";

/// Copies of the agent, at most. Slots that wait for longer are predicted by the last of them.
const COPIES_MAX: usize = 8;

impl Vehicle {
    /// Moves the clock to the time of a report. Returns whether the report counts now: its time is near the clock, or
    /// it confirms the report before it. If receptions moved the clock, a host that reports nothing else would make
    /// heard slots count more often than missed ones.
    ///
    /// # Errors
    /// [`Fault`] for the first report after more than a day.
    pub(crate) fn advance_clock(&mut self, time_s: f64) -> Result<bool, Fault> {
        let lead_s = self.ledger.clock_s().map_or(f64::INFINITY, |clock_s| time_s - clock_s);
        if lead_s <= 0.0 {
            return Ok(true);
        }
        if lead_s <= self.config.clock.gap_s && !self.is_starting {
            self.after_gap = None;
            self.set_clock(time_s);
            return Ok(true);
        }
        let former = self.after_gap.replace(AfterGap { time_s, nav: None });
        let before_s = if self.is_starting { None } else { self.ledger.clock_s() };
        let before_s = before_s.or(former.as_ref().map(|first| first.time_s));
        if let Some(first) = former.filter(|first| (0.0..=LEAD_S_MAX).contains(&(time_s - first.time_s))) {
            self.end_gap(&first, time_s);
            return Ok(true);
        }
        if self.is_starting {
            self.copies.entry(0).or_insert_with(|| self.agent.clone());
        }
        match before_s.filter(|before_s| time_s - before_s > LEAD_S_MAX) {
            Some(_) => {
                let expected = "at most a day after the report before it, or confirmed by the next one";
                Err(Fault::of_field(FaultCode::WrongTime, "time", time_s, expected))
            }
            None => Ok(false),
        }
    }

    /// Moves the clock behind a gap. The vehicle does not know what it could receive in the gap.
    fn end_gap(&mut self, first: &AfterGap, time_s: f64) {
        let is_confirmed = time_s - first.time_s <= self.config.clock.gap_s;
        let to_s = if is_confirmed { first.time_s } else { time_s };
        let slots = &self.agent.team().slots;
        let (from_s, reason) = match self.ledger.clock_s() {
            None => {
                let next = slots.number(to_s).unwrap_or(0);
                self.change_ledger(LedgerRecord::Settled { next, excluded: BTreeMap::new() });
                (f64::MIN, NOT_RUNNING)
            }
            // Receptions in slots that are not counted may be lost.
            Some(clock_s) if self.is_starting => {
                let begin_s = slots.begin_s(self.ledger.next()).unwrap_or(clock_s);
                (begin_s.min(clock_s), NOT_RUNNING)
            }
            Some(clock_s) => (clock_s, NO_INPUT),
        };
        (self.is_starting, self.after_gap) = (false, None);
        self.change_ledger(LedgerRecord::Deaf { from_s, to_s, reason: reason.into() });
        self.set_clock(time_s);
        if let Some(nav) = first.nav.as_ref().filter(|_| is_confirmed)
            && let Err(fault) = self.apply_nav(nav)
        {
            self.send(Message::Error { input: self.inputs, fault });
        }
    }

    /// Sets the clock. Keeps a copy of the agent at the first report in a slot. O(n²) for n events, once a slot.
    fn set_clock(&mut self, time_s: f64) {
        self.ledger.apply(&LedgerRecord::Handled { time_s });
        let slots = &self.agent.team().slots;
        let present = slots.number(time_s).and_then(|slot| slots.transmission_slot(slot));
        let Some(present) = present.filter(|&slot| !self.ledger.is_settled(slot)) else { return };
        if self.copies.len() < COPIES_MAX && !self.copies.contains_key(&present) {
            self.copies.insert(present, self.agent.clone());
        }
    }
}
