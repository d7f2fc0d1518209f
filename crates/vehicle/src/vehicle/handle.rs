//! Handles the messages of the host.

use pingmap_agent::Position;
use pingmap_packet::to_hex;

use crate::protocol::fault::{Fault, FaultCode};
use crate::protocol::input::{
    At, Departed, FrameIn, FrameLink, FrameRequest, Heard, Hello, Input, Listening, Nav, Nmea, Peer, PeerSource,
    PiggybackIn, PiggybackRequest, Predict,
};
use crate::protocol::output::{Greeting, Message, PROTOCOL};
use crate::vehicle::ledger::{LedgerRecord, shortened, span_s};
use crate::vehicle::record::Record;
use crate::vehicle::slots::{CLOCK, LOST_MESSAGES, SURFACED, failed};
use crate::vehicle::state::{Output, Vehicle};

/// Maximum number of slots that are searched for the latest slot of a member.
const SLOTS_BACK_MAX: usize = 1000;

/// Records after which the store gets another base.
const RECORDS_MAX: usize = 10_000;

impl Vehicle {
    /// Handles a message of the host. Returns what the process has to do, in order: store records, send messages.
    pub fn handle(&mut self, input: Input) -> Vec<Output> {
        self.inputs += 1;
        let is_stop = matches!(input, Input::Stop {});
        let handled = self.dispatch(input);
        let is_stop = is_stop && handled.is_ok();
        if let Err(fault) = handled {
            self.send(Message::Error { input: self.inputs, fault });
        }
        self.finish(is_stop)
    }

    /// Sets the number of the next input. The process answers some lines without the vehicle, and they have numbers,
    /// too.
    pub fn number_next_input(&mut self, number: u64) {
        self.inputs = number.saturating_sub(1);
    }

    /// Notes that messages before the next one were not handled. Receptions may be among them, so that no slot counts
    /// from the last counted one to the next navigation.
    pub fn note_lost_messages(&mut self) {
        // Navigation before the loss does not confirm the time after it.
        self.unconfirmed = None;
        let slots = &self.agent.team().slots;
        let Some(clock_s) = self.ledger.clock_s() else { return };
        let from_s = slots.begin_s(self.ledger.next()).map_or(clock_s, |begin_s| begin_s.min(clock_s));
        self.note_deafness(LOST_MESSAGES, true, from_s);
    }

    /// Expects another host from now on. It must send `hello`, and its inputs are counted from 1.
    pub fn begin_host(&mut self) {
        self.has_greeted = false;
        self.inputs = 0;
        // Without a host, receptions are not reported.
        (self.is_starting, self.unconfirmed) = (true, None);
    }

    /// Ends without a message of the host. Returns what the process has to do, as for `stop`.
    pub fn stop(&mut self) -> Vec<Output> {
        self.finish(true)
    }

    /// Answers a line that is no valid message.
    pub fn refuse(&mut self, fault: Fault) -> Vec<Output> {
        self.inputs += 1;
        self.send(Message::Error { input: self.inputs, fault });
        self.finish(false)
    }

    /// Continues in memory after the store failed. The vehicle sends nothing from now on. Returns what the process has
    /// to do instead of the remaining steps.
    pub fn store_failed(&mut self, problem: &str) -> Vec<Output> {
        let fault = Fault::new(FaultCode::StoreFailed, format!("the store failed: {problem}"));
        self.store_problem = Some(problem.into());
        vec![Output::Send(Message::Error { input: self.inputs, fault }), Output::Send(self.status_report(0))]
    }

    fn finish(&mut self, is_stop: bool) -> Vec<Output> {
        let clock_s = self.ledger.clock_s();
        let interval_s = self.config.store.snapshot_interval_s;
        let is_due = clock_s.zip(self.base_s).is_some_and(|(clock_s, base_s)| clock_s - base_s >= interval_s);
        self.records_after_base += self.records.len();
        let is_due = std::mem::take(&mut self.wants_base) || is_due || self.records_after_base > RECORDS_MAX;
        self.base_s = self.base_s.or(clock_s);
        let mut outputs = Vec::new();
        let mut records = std::mem::take(&mut self.records);
        if self.store_problem.is_none() {
            if !records.is_empty() {
                records.extend(clock_s.map(|time_s| Record::Ledger(LedgerRecord::Handled { time_s })));
                outputs.push(Output::Store(records.iter().map(Record::to_bytes).collect()));
            }
            if is_stop || is_due {
                (self.base_s, self.records_after_base) = (clock_s, 0);
                self.begin_snapshot();
                self.forget_scores_of_unused_slots();
                outputs.push(Output::Base(self.base()));
            }
        }
        outputs.extend(std::mem::take(&mut self.messages).into_iter().map(Output::Send));
        if is_stop {
            outputs.push(Output::Send(Message::Stopped { inputs: self.inputs }));
        }
        outputs
    }

    fn dispatch(&mut self, input: Input) -> Result<(), Fault> {
        if let Input::Hello(hello) = &input {
            return self.greet(hello);
        }
        if !self.has_greeted {
            return Err(Fault::new(FaultCode::NotGreeted, "the first message must be hello"));
        }
        self.check_times(&input)?;
        let is_answered = self.apply_input(input)?;
        self.count_slots();
        if !is_answered {
            self.send(Message::Ok { input: self.inputs, stored: self.store_problem.is_none() });
        }
        Ok(())
    }

    /// Checks the times of a message.
    fn check_times(&self, input: &Input) -> Result<(), Fault> {
        match input {
            Input::Heard(Heard { time, .. })
            | Input::Nmea(Nmea { time, .. })
            | Input::FrameIn(FrameIn { time, .. })
            | Input::PiggybackIn(PiggybackIn { time, .. })
            | Input::Peer(Peer { time, .. })
            | Input::Sent(At { time, .. })
            | Input::NotSent(At { time, .. })
            | Input::Departed(Departed { time, .. })
            | Input::FrameRequest(FrameRequest { time, .. })
            | Input::PiggybackRequest(PiggybackRequest { time, .. }) => self.check_time("time", *time)?,
            // Navigation may follow a gap of days, and a query may be about any time.
            Input::Nav(Nav { time, .. }) | Input::Predict(Predict { time: Some(time), .. }) => {
                self.check_any_time("time", *time)?;
            }
            Input::Listening(Listening { from, to, .. }) => self.check_interval(*from, *to)?,
            Input::Predict(_) | Input::Hello(_) | Input::Dropped(_) | Input::Status {} | Input::Stop {} => {}
        }
        Ok(())
    }

    /// Applies a message after its checks. Returns whether it has sent an answer.
    fn apply_input(&mut self, input: Input) -> Result<bool, Fault> {
        if let Input::Peer(Peer { time, source: PeerSource::Message, .. })
        | Input::Heard(Heard { time, .. })
        | Input::Nmea(Nmea { time, .. })
        | Input::FrameIn(FrameIn { time, .. })
        | Input::PiggybackIn(PiggybackIn { time, .. }) = &input
        {
            self.copy_agent(*time);
        }
        match input {
            Input::Nav(nav) => self.navigate(&nav)?,
            Input::Peer(peer) => self.locate_peer(&peer)?,
            Input::Sent(at) => self.note_transmission(at.time),
            Input::NotSent(at) => self.note_unused_slot(at.time)?,
            Input::Heard(heard) => self.hear(&heard)?,
            Input::Listening(listening) => self.note_listening(listening)?,
            Input::Nmea(nmea) => self.absorb_sentence(nmea.time, &nmea.sentence)?,
            Input::FrameIn(frame) => {
                self.take_frame(&frame)?;
                return Ok(true);
            }
            Input::PiggybackIn(piggyback) => {
                self.check_peer("from", &piggyback.from)?;
                self.receive_piggyback(&piggyback)?;
                self.note_reception(&piggyback.from, piggyback.time)?;
                return Ok(true);
            }
            Input::FrameRequest(request) => {
                self.propose_frame(&request)?;
                return Ok(true);
            }
            Input::Departed(departed) => self.close_frame(departed.token, Some(departed.time))?,
            Input::Dropped(dropped) => self.close_frame(dropped.token, None)?,
            Input::PiggybackRequest(request) => {
                self.piggyback(&request)?;
                return Ok(true);
            }
            Input::Predict(query) => {
                self.predict(&query)?;
                return Ok(true);
            }
            Input::Status {} => {
                self.forget_scores_of_unused_slots();
                let report = self.status_report(self.inputs);
                self.send(report);
                return Ok(true);
            }
            Input::Hello(_) | Input::Stop {} => return Ok(true),
        }
        Ok(false)
    }

    fn greet(&mut self, hello: &Hello) -> Result<(), Fault> {
        let team = to_hex(&self.agent.team().digest());
        if self.has_greeted {
            return Err(Fault::new(FaultCode::NotGreeted, "hello was sent before"));
        }
        if hello.version != PROTOCOL {
            return Err(Fault::of_field(FaultCode::Mismatch, "version", hello.version, PROTOCOL));
        }
        if let Some(other) = hello.vehicle.as_ref().filter(|id| *id != self.id()) {
            return Err(Fault::of_field(FaultCode::Mismatch, "vehicle", other, self.id()));
        }
        if let Some(other) = hello.team.as_ref().filter(|digest| digest.is_empty() || !team.starts_with(*digest)) {
            return Err(Fault::of_field(FaultCode::Mismatch, "team", other, &team));
        }
        self.has_greeted = true;
        let greeting = Greeting {
            version: PROTOCOL,
            program: env!("CARGO_PKG_VERSION").into(),
            vehicle: self.id().clone(),
            team,
            epoch: self.agent.team().epoch,
            events: self.agent.events().len(),
            warnings: self.warnings.clone(),
        };
        self.recovery = None;
        self.send(Message::Hello(greeting));
        Ok(())
    }

    fn navigate(&mut self, nav: &Nav) -> Result<(), Fault> {
        self.check_sigma("clock_sigma", nav.clock_sigma)?;
        self.check_sigma("sigma", nav.sigma)?;
        let position = self.position("position", &nav.position)?;
        if self.advance_clock(nav, position)? {
            self.apply_nav(nav, position)?;
        }
        Ok(())
    }

    /// Applies navigation whose time the clock has reached.
    pub(crate) fn apply_nav(&mut self, nav: &Nav, position: Position) -> Result<(), Fault> {
        if self.nav_s.is_none_or(|nav_s| nav.time >= nav_s) {
            self.nav_s = Some(nav.time);
            self.note_deafness(SURFACED, nav.surfaced, nav.time);
            let sigma_max_s = self.config.clock.sigma_max_s.unwrap_or(0.25 * self.agent.team().slots.duration_s);
            let sigma_s = nav.clock_sigma.unwrap_or(self.config.clock.sigma_s);
            self.note_deafness(CLOCK, sigma_s > sigma_max_s, nav.time);
            let now_s = self.ledger.clock_s().map_or(nav.time, |clock_s| clock_s.max(nav.time));
            self.note_deafness(LOST_MESSAGES, false, now_s);
        }
        if nav.sigma.is_some_and(|sigma_m| sigma_m > self.config.navigation.sigma_max_m) {
            return Ok(());
        }
        let id = self.id().clone();
        self.add_position(&id, nav.time, position, true);
        let interval_s = self.config.navigation.interval_s;
        let is_due = self.stored_nav_s.is_none_or(|stored_s| (nav.time - stored_s).abs() >= interval_s);
        if is_due {
            let entries = self.agent.record_positions([(nav.time, position)]).map_err(|error| failed(&error))?;
            self.records.extend(entries.into_iter().map(Record::Entry));
            self.stored_nav_s = Some(nav.time);
        }
        Ok(())
    }

    /// Notes that a reason not to receive began or ended.
    fn note_deafness(&mut self, reason: &str, is_deaf: bool, time_s: f64) {
        let reason_text = reason.to_owned();
        match (self.ledger.is_deaf_by(reason), is_deaf) {
            (false, true) => self.change_ledger(LedgerRecord::DeafSince { from_s: time_s, reason: reason_text }),
            (true, false) => self.change_ledger(LedgerRecord::DeafUntil { to_s: time_s, reason: reason_text }),
            _ => {}
        }
    }

    fn locate_peer(&mut self, peer: &Peer) -> Result<(), Fault> {
        self.check_peer("member", &peer.member)?;
        let position: Position = self.position("position", &peer.position)?;
        let is_independent = peer.source == PeerSource::Other;
        let time_s = if is_independent { peer.time } else { self.arrival_s(peer) };
        self.add_position(&peer.member, time_s, position, is_independent);
        let entry = self.agent.record_peer_position(&peer.member, time_s, position, is_independent);
        self.records.extend(entry.map_err(|error| failed(&error))?.map(Record::Entry));
        Ok(())
    }

    /// Returns the time of a position in a message: within the slot in which the message arrived. A position before the
    /// slot would predict that slot only if it was heard. A position after the slot would locate only heard slots.
    fn arrival_s(&self, peer: &Peer) -> f64 {
        let slots = &self.agent.team().slots;
        let clock_s = self.ledger.clock_s().unwrap_or(peer.time);
        let now_s = self.arrivals_s.get(&peer.member).copied().unwrap_or(clock_s.max(peer.time));
        let latest = slots.number(now_s).into_iter().flat_map(|latest| (0..=latest).rev());
        let slot = latest.take(SLOTS_BACK_MAX).find(|&slot| slots.sender(slot) == Some(&peer.member));
        match slot.and_then(|slot| span_s(slots, slot)) {
            Some((begin_s, end_s)) => peer.time.clamp(begin_s, end_s.next_down()),
            None => peer.time,
        }
    }

    fn note_unused_slot(&mut self, time_s: f64) -> Result<(), Fault> {
        let entries = self
            .agent
            .record_unused_slots([time_s])
            .map_err(|_| Fault::of_field(FaultCode::WrongTime, "time", time_s, "a time in a slot of this vehicle"))?;
        self.records.extend(entries.into_iter().map(Record::Entry));
        Ok(())
    }

    fn hear(&mut self, heard: &Heard) -> Result<(), Fault> {
        self.check_peer("from", &heard.from)?;
        self.note_reception(&heard.from, heard.time)?;
        heard.frames.iter().for_each(|frame| self.receive(&frame.0, heard.time));
        Ok(())
    }

    fn take_frame(&mut self, frame: &FrameIn) -> Result<(), Fault> {
        match (&frame.from, frame.link) {
            (Some(from), FrameLink::Acoustic) => {
                self.check_peer("from", from)?;
                self.note_reception(from, frame.time)?;
            }
            (None, FrameLink::Acoustic) => {
                let expected = "the member that transmitted the acoustic message";
                return Err(Fault::of_field(FaultCode::WrongField, "from", "none", expected));
            }
            (_, FrameLink::Other) => {}
        }
        self.receive(&frame.bytes.0, frame.time);
        Ok(())
    }

    /// Returns whether the slot at a time was counted.
    pub(crate) fn is_counted(&self, time_s: f64) -> bool {
        self.agent.team().slots.number(time_s).is_some_and(|slot| self.ledger.is_settled(slot))
    }

    fn note_listening(&mut self, Listening { from, to, not }: Listening) -> Result<(), Fault> {
        // Navigation alone begins the count, and ends a gap.
        self.late_reports += u64::from(not.is_some() && self.is_counted(from));
        self.step_clock(from);
        self.change_ledger(match not {
            Some(reason) => LedgerRecord::Deaf { from_s: from, to_s: to, reason: shortened(&reason) },
            None => LedgerRecord::Listened { from_s: from, to_s: to },
        });
        Ok(())
    }
}
