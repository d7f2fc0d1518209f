//! The clock of the vehicle: the times of navigation and of listening. Receptions do not move it.

use std::collections::BTreeMap;

use crate::protocol::fault::{Fault, FaultCode};
use crate::protocol::output::Message;
use crate::vehicle::copies::Copies;
use crate::vehicle::ledger::{AfterGap, LEAD_S_MAX, LedgerRecord};
use crate::vehicle::state::Vehicle;

pub(crate) const NOT_RUNNING: &str = "the vehicle was not running";
pub(crate) const NO_INPUT: &str = "no input from the host";

impl Vehicle {
    /// Moves the clock to the time of navigation. Returns whether the navigation applies now: its time is at most
    /// `gap_s` after the clock, or it confirms the report before it. Receptions do not move the clock. Otherwise a host
    /// that reports nothing else would count heard slots more often than missed ones.
    ///
    /// # Errors
    /// [`Fault`] for the first report after more than a day.
    pub(crate) fn advance_clock(&mut self, time_s: f64) -> Result<bool, Fault> {
        let clock_s = self.ledger.clock_s();
        let lead_s = clock_s.map_or(f64::INFINITY, |clock_s| time_s - clock_s);
        let gap_s = self.config.clock.gap_s;
        if (-LEAD_S_MAX..=0.0).contains(&lead_s) {
            return Ok(true);
        }
        if (0.0..=gap_s).contains(&lead_s) && !self.is_starting {
            self.after_gap = None;
            self.set_clock(time_s);
            self.copy_agent(time_s);
            return Ok(true);
        }
        let former = self.after_gap.replace(AfterGap { time_s, nav: None, agent: self.agent.clone() });
        let before_s = if self.is_starting { None } else { clock_s };
        let before_s = before_s.or(former.as_ref().map(|first| first.time_s));
        if let Some(first) = former.filter(|first| (0.0..=LEAD_S_MAX).contains(&(time_s - first.time_s))) {
            self.end_gap(&first);
            let is_confirmed = time_s - first.time_s <= gap_s;
            if is_confirmed {
                self.after_gap = None;
                self.set_clock(time_s);
                // The agent may have data from between the two reports.
                if let Some(slot) = self.transmission_slot(time_s) {
                    self.copies.skip(slot);
                }
            }
            return Ok(is_confirmed);
        }
        let is_behind = lead_s < 0.0 && !self.is_starting;
        if is_behind || before_s.is_some_and(|before_s| time_s - before_s > LEAD_S_MAX) {
            let expected = "within a day of the report before it, or confirmed by the next one";
            return Err(Fault::of_field(FaultCode::WrongTime, "time", time_s, expected));
        }
        Ok(false)
    }

    /// Moves the clock to the end of a gap. No slot in the gap counts. A clock that was wrong by more than a day goes
    /// back.
    fn end_gap(&mut self, first: &AfterGap) {
        let clock_s = self.ledger.clock_s();
        if clock_s.is_some_and(|clock_s| first.time_s < clock_s) {
            let next = self.ledger.next_before_jump(&self.agent.team().slots, first.time_s);
            self.change_ledger(LedgerRecord::Restarted { next });
            self.copies = Copies::default();
            self.arrivals_s.clear();
            self.nav_s = None;
        }
        let slots = &self.agent.team().slots;
        let (from_s, reason) = match self.ledger.clock_s() {
            None => {
                let next = slots.number(first.time_s).unwrap_or(0);
                self.change_ledger(LedgerRecord::Settled { next, excluded: BTreeMap::new() });
                (f64::MIN, NOT_RUNNING)
            }
            // Receptions in slots that were not counted before the restart may be lost.
            Some(clock_s) if self.is_starting => {
                let begin_s = slots.begin_s(self.ledger.next()).unwrap_or(clock_s);
                (begin_s.min(clock_s), NOT_RUNNING)
            }
            Some(clock_s) => (clock_s, NO_INPUT),
        };
        self.is_starting = false;
        self.change_ledger(LedgerRecord::Deaf { from_s, to_s: first.time_s, reason: reason.into() });
        self.set_clock(first.time_s);
        if let Some(slot) = self.transmission_slot(first.time_s) {
            self.copies.add(slot, &first.agent);
        }
        if let Some((nav, position)) = &first.nav
            && let Err(fault) = self.apply_nav(nav, *position)
        {
            self.send(Message::Error { input: self.inputs, fault });
        }
    }

    fn set_clock(&mut self, time_s: f64) {
        self.ledger.apply(&LedgerRecord::Handled { time_s });
    }

    /// Returns the slot of a transmission at a time, unless it was counted already.
    fn transmission_slot(&self, time_s: f64) -> Option<u32> {
        let slots = &self.agent.team().slots;
        let present = slots.number(time_s).and_then(|slot| slots.transmission_slot(slot));
        present.filter(|&slot| !self.ledger.is_settled(slot))
    }

    /// Stores a copy of the agent if an input is the first one of its slot. A reception far after the clock does not
    /// count.
    pub(crate) fn copy_agent(&mut self, time_s: f64) {
        let is_near = self.ledger.clock_s().is_some_and(|clock_s| time_s - clock_s <= self.config.clock.gap_s);
        if let Some(slot) = self.transmission_slot(time_s).filter(|_| is_near && !self.is_starting) {
            self.copies.add(slot, &self.agent);
        }
    }
}
