//! The clock of the vehicle: the times of navigation and of listening. Receptions do not move it.

use std::collections::BTreeMap;

use pingmap_agent::Position;

use crate::protocol::fault::{Fault, FaultCode};
use crate::protocol::input::Nav;
use crate::protocol::output::Message;
use crate::vehicle::copies::Copies;
use crate::vehicle::ledger::{Jump, LEAD_S_MAX, LedgerRecord, NO_INPUT, NOT_RUNNING, WRONG_CLOCK};
use crate::vehicle::state::Vehicle;
use crate::vehicle::unconfirmed_nav::UnconfirmedNav;

impl Vehicle {
    /// Moves the clock to the time of navigation. Returns whether the navigation applies now: its time is at most
    /// `gap_s` from the clock, or it confirms the report before it. Receptions do not move the clock. Otherwise a host
    /// that reports nothing else would count heard slots more often than missed ones.
    ///
    /// # Errors
    /// [`Fault`] for the first report after more than a day, and for a report far behind the clock.
    pub(crate) fn advance_clock(&mut self, nav: &Nav, position: Position) -> Result<bool, Fault> {
        if self.step_clock(nav.time) {
            return Ok(true);
        }
        let (clock_s, gap_s) = (self.ledger.clock_s(), self.config.clock.gap_s);
        let agent = self.agent.clone();
        let former = self.unconfirmed.replace(UnconfirmedNav { nav: *nav, position, agent });
        let is_behind = |time_s: f64| clock_s.is_some_and(|clock_s| time_s < clock_s);
        let before_s = if self.is_starting { None } else { clock_s };
        let before_s = before_s.or(former.as_ref().map(|first| first.nav.time));
        // A clock that goes back needs two reports that follow each other.
        let later_s_max = |first: &UnconfirmedNav| if is_behind(first.nav.time) { gap_s } else { LEAD_S_MAX };
        let is_later =
            |first: &UnconfirmedNav| nav.time > first.nav.time && nav.time - first.nav.time <= later_s_max(first);
        if let Some(first) = former.filter(is_later) {
            self.end_gap(&first, nav.time)?;
            let is_confirmed = nav.time - first.nav.time <= gap_s;
            if is_confirmed {
                self.unconfirmed = None;
                self.set_clock(nav.time);
                // The agent may have data from between the two reports.
                if let Some(slot) = self.transmission_slot(nav.time) {
                    self.copies.skip(slot);
                }
            }
            return Ok(is_confirmed);
        }
        let is_refused = is_behind(nav.time) && !self.is_starting;
        if is_refused || before_s.is_some_and(|before_s| nav.time - before_s > LEAD_S_MAX) {
            let expected = match clock_s.filter(|_| is_refused) {
                Some(clock_s) => format!("at most {gap_s} s before {clock_s}, or confirmed by the next one"),
                None => "within a day after the report before it, or confirmed by the next one".into(),
            };
            return Err(Fault::of_field(FaultCode::WrongTime, "time", nav.time, expected));
        }
        Ok(false)
    }

    /// Moves the clock to a time at most `gap_s` after it. Returns whether the time is within `gap_s` of the clock. A
    /// report may be late.
    pub(crate) fn step_clock(&mut self, time_s: f64) -> bool {
        let gap_s = self.config.clock.gap_s;
        match self.ledger.clock_s().map(|clock_s| time_s - clock_s) {
            Some(lead_s) if (-gap_s..=0.0).contains(&lead_s) => true,
            Some(lead_s) if (0.0..=gap_s).contains(&lead_s) && !self.is_starting => {
                self.unconfirmed = None;
                self.set_clock(time_s);
                self.copy_agent(time_s);
                true
            }
            _ => false,
        }
    }

    /// Moves the clock to the end of a gap. A report at `confirmed_s` has confirmed it. No slot in the gap counts. A
    /// clock that was ahead goes back. Slots before `confirmed_s` then do not count, because the clock that was ahead
    /// had counted them before their receptions arrived.
    ///
    /// # Errors
    /// [`Fault`] for a time that is behind the clock although slots around it were counted.
    fn end_gap(&mut self, first: &UnconfirmedNav, confirmed_s: f64) -> Result<(), Fault> {
        let time_s = first.nav.time;
        let mut deaf_to_s = time_s;
        let slots = &self.agent.team().slots;
        let from_s = self.ledger.clock_s().unwrap_or(f64::MIN);
        let next = slots.number(from_s).map_or(0, |slot| slot + 1).max(self.ledger.next());
        let mut jump = Jump { from_s, to_s: time_s, next };
        if time_s < from_s {
            jump = self.ledger.find_jump(time_s, self.config.clock.gap_s).ok_or_else(|| {
                let expected = format!("after {from_s}, the time of the clock, because slots count only once");
                Fault::of_field(FaultCode::WrongTime, "time", time_s, expected)
            })?;
            deaf_to_s = confirmed_s;
            self.change_ledger(LedgerRecord::Handled { time_s: from_s });
            self.change_ledger(LedgerRecord::WentBack { jump });
            self.copies = Copies::default();
            self.arrivals_s.clear();
            (self.nav_s, self.base_s) = (None, None);
        }
        self.change_ledger(LedgerRecord::Jumped { jump: Jump { to_s: time_s, ..jump } });
        let slots = &self.agent.team().slots;
        let (from_s, reason) = match self.ledger.clock_s() {
            None => {
                let next = slots.number(time_s).unwrap_or(0);
                self.change_ledger(LedgerRecord::Settled { next, excluded: BTreeMap::new() });
                (f64::MIN, if deaf_to_s > time_s { WRONG_CLOCK } else { NOT_RUNNING })
            }
            // Receptions in slots that were not counted before the gap may be lost, or arrive after it.
            Some(clock_s) => {
                let begin_s = slots.begin_s(self.ledger.next()).unwrap_or(clock_s);
                (begin_s.min(clock_s), if self.is_starting { NOT_RUNNING } else { NO_INPUT })
            }
        };
        self.is_starting = false;
        self.change_ledger(LedgerRecord::Deaf { from_s, to_s: deaf_to_s, reason: reason.into() });
        self.set_clock(time_s);
        if let Some(slot) = self.transmission_slot(time_s) {
            self.copies.add(slot, &first.agent);
        }
        if let Err(fault) = self.apply_nav(&first.nav, first.position) {
            self.send(Message::Error { input: self.inputs, fault });
        }
        Ok(())
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
