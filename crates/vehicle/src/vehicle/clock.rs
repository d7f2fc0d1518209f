//! The clock of the vehicle: it follows reports that do not depend on receptions.

use std::collections::BTreeMap;

use crate::protocol::fault::Fault;
use crate::protocol::input::{FrameRequest, Input, Listening, Peer, PeerSource, PiggybackRequest, Predict};
use crate::vehicle::ledger::LedgerRecord;
use crate::vehicle::state::Vehicle;

pub(crate) const NOT_RUNNING: &str = "the vehicle was not running";
pub(crate) const NO_INPUT: &str = "no input from the host";

/// The meaning of the time of a message.
pub(crate) enum Stamp {
    /// The present, whether or not the vehicle received anything.
    Clock(f64),
    /// The time at which something arrived.
    Arrival(f64),
    /// Another time, or none.
    Other,
}

impl Vehicle {
    /// Checks the times of a message.
    pub(crate) fn check_times(&self, input: &Input) -> Result<Stamp, Fault> {
        let stamp = match input {
            Input::Nav(nav) => Stamp::Clock(nav.time),
            Input::Sent(at) | Input::NotSent(at) => Stamp::Clock(at.time),
            Input::Departed(departed) => Stamp::Clock(departed.time),
            Input::Heard(heard) => Stamp::Arrival(heard.time),
            Input::Nmea(nmea) => Stamp::Arrival(nmea.time),
            Input::FrameIn(frame) => Stamp::Arrival(frame.time),
            Input::PiggybackIn(piggyback) => Stamp::Arrival(piggyback.time),
            Input::Peer(peer) if peer.source == PeerSource::Message => Stamp::Arrival(peer.time),
            // Plans and requests are about the future.
            Input::Peer(Peer { time, .. })
            | Input::FrameRequest(FrameRequest { time, .. })
            | Input::PiggybackRequest(PiggybackRequest { time, .. }) => {
                return self.check_time("time", *time).map(|()| Stamp::Other);
            }
            Input::Listening(Listening { from, to, .. }) => {
                self.check_interval(*from, *to)?;
                Stamp::Clock(*from)
            }
            // A query may be about any time.
            Input::Predict(Predict { time: Some(time), .. }) => {
                return self.check_any_time("time", *time).map(|()| Stamp::Other);
            }
            Input::Predict(_) | Input::Hello(_) | Input::Dropped(_) | Input::Status {} | Input::Stop {} => Stamp::Other,
        };
        if let Stamp::Clock(time_s) | Stamp::Arrival(time_s) = stamp {
            self.check_time("time", time_s)?;
        }
        Ok(stamp)
    }

    /// Moves the clock to the time of a report that does not depend on receptions. If receptions moved it, a host that
    /// reports nothing else would make heard slots count more often than missed ones.
    ///
    /// The vehicle does not know what it could receive in a gap without such reports. A single report after a gap may
    /// have a wrong time: the clock follows the second one.
    pub(crate) fn advance_clock(&mut self, time_s: f64) {
        let slots = &self.agent.team().slots;
        let Some(clock_s) = self.ledger.clock_s() else {
            let next = slots.number(time_s).unwrap_or(0);
            self.change_ledger(LedgerRecord::Settled { next, excluded: BTreeMap::new() });
            return self.end_gap(f64::MIN, time_s, time_s, NOT_RUNNING);
        };
        if time_s <= clock_s {
            return;
        }
        if self.is_starting {
            // Receptions in slots that are not counted may be lost.
            let from_s = slots.begin_s(self.ledger.next()).map_or(clock_s, |begin_s| begin_s.min(clock_s));
            return self.end_gap(from_s, time_s, time_s, NOT_RUNNING);
        }
        let gap_s = self.config.clock.gap_s;
        match self.after_gap_s.filter(|first_s| (time_s - first_s).abs() <= gap_s) {
            _ if time_s - clock_s <= gap_s => {
                self.after_gap_s = None;
                self.ledger.apply(&LedgerRecord::Handled { time_s });
            }
            Some(first_s) => self.end_gap(clock_s, first_s.min(time_s), time_s, NO_INPUT),
            None => self.after_gap_s = Some(time_s),
        }
    }

    /// Notes a gap without reports, and moves the clock behind it.
    fn end_gap(&mut self, from_s: f64, to_s: f64, time_s: f64, reason: &str) {
        (self.is_starting, self.after_gap_s) = (false, None);
        self.change_ledger(LedgerRecord::Deaf { from_s, to_s, reason: reason.into() });
        self.ledger.apply(&LedgerRecord::Handled { time_s });
    }
}
