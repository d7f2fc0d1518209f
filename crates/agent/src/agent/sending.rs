//! Chooses and forms the next frame.

use pingmap_packet::{Layout, MapMessage, Report as ReportMessage};

use crate::agent::state::Agent;
use crate::error::AgentError;
use crate::send::delivery::DeliveryEstimate;
use crate::send::report_planner::ReportPlanner;
use crate::send::summary_planner::SummaryPlanner;
use crate::store::entry::{Entry, FrameState, check_time};

/// A frame that [`Agent::next_frame`] proposes to the host.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ProposedFrame {
    /// Number of frames proposed before it.
    pub number: u64,
    /// The vehicle's slot in which it is expected to leave, if known.
    pub slot: Option<u32>,
    /// Bytes of the frame.
    pub bytes: Vec<u8>,
}

impl ProposedFrame {
    /// Returns the entry for the journal of the host.
    pub fn entry(&self) -> Entry {
        let Self { number, slot, bytes } = self.clone();
        Entry::Sent { number, state: FrameState::Proposed, slot, bytes }
    }
}

impl Agent {
    /// Returns the next frame of at most `frame_bytes` bytes, and of at most the team's; `None` if nothing is worth a
    /// frame. `time_s` is the time at which it will leave, or `None` if that is unknown.
    ///
    /// The frame is a report as long as one is worth sending: single outcomes by slot, and the vehicle's track.
    /// Otherwise it is a summary of the events that no report can carry: those without a slot, and those before the
    /// report window. The method fits nothing; a host with time for [`Agent::refit`] calls it before. A host that can
    /// lose its memory stores [`ProposedFrame::entry`] before the frame leaves, because a counter must not be used
    /// twice. The frame counts as transmitted in the vehicle's slot at or after `time_s`, unless the host calls
    /// [`Agent::frame_departed`] or [`Agent::frame_dropped`].
    ///
    /// # Errors
    /// [`AgentError::NotAMember`], [`AgentError::CountersUsedUp`], and [`AgentError::Team`] for a frame below 32 bytes.
    pub fn next_frame(&mut self, time_s: Option<f64>, frame_bytes: usize) -> Result<Option<ProposedFrame>, AgentError> {
        let sender = self.memory.own.ok_or_else(|| AgentError::NotAMember(self.id.clone()))?;
        let frame_bytes = frame_bytes.min(self.team().frame_bytes);
        let layout = self.team().layout(frame_bytes)?;
        self.advance_clock(time_s);
        let slot = time_s.and_then(|time_s| self.team().slots.next_slot(time_s, &self.id));
        self.update()?;
        let attempt = (frame_bytes, self.options.sharing);
        if self.posteriors.nothing_to_send == Some(attempt) {
            return Ok(None);
        }
        let Some(bytes) = self.plan(sender, layout, frame_bytes)? else {
            self.posteriors.nothing_to_send = Some(attempt);
            return Ok(None);
        };
        let number = self.memory.next_transmission_number();
        let proposed = ProposedFrame { number, slot, bytes };
        self.memory.apply(proposed.entry())?;
        self.data_changed();
        self.note_time(sender, time_s);
        Ok(Some(proposed))
    }

    /// Records that a proposed frame left at a time. Returns the entry for the journal of the host. The entry contains
    /// the slot of the time. The time itself only advances the clock.
    ///
    /// # Errors
    /// [`AgentError::NoSuchFrame`] for a number that [`Agent::next_frame`] did not return, or whose frame is not stored
    /// any more. [`AgentError::NoTime`] for a time that is not finite.
    pub fn frame_departed(&mut self, number: u64, time_s: f64) -> Result<Entry, AgentError> {
        check_time(time_s)?;
        let slot = self.team().slots.sent_in(time_s, &self.id);
        let entry = self.change_frame(number, FrameState::Departed, slot)?;
        self.advance_clock(Some(time_s));
        Ok(entry)
    }

    /// Records that a proposed frame did not leave and never will. It was delivered to no member, so its content is
    /// worth sending again. Its counter stays used. Returns the entry for the journal of the host.
    ///
    /// # Errors
    /// [`AgentError::NoSuchFrame`] as [`Agent::frame_departed`].
    pub fn frame_dropped(&mut self, number: u64) -> Result<Entry, AgentError> {
        self.change_frame(number, FrameState::Dropped, None)
    }

    /// Raises the counter of the vehicle's next packet to `next`, if it is lower. A vehicle that was restored from a
    /// snapshot older than its last packets may have used counters that it does not know. If it skips
    /// [`Team::packets_per_sender_max`](crate::Team::packets_per_sender_max) counters, every receiver forgets these
    /// packets. A snapshot holds the result.
    pub fn raise_counter(&mut self, next: u32) {
        if let Some(own) = self.memory.own.filter(|_| next > self.next_counter()) {
            self.memory.packets.advance_to(own, u16::try_from(next - 1).unwrap_or(u16::MAX));
            self.data_changed();
        }
    }

    /// Returns the lowest counter that the vehicle's next packet may have. 0 for a vehicle that is no member.
    pub fn next_counter(&self) -> u32 {
        self.memory.own.map_or(0, |own| self.memory.packets.next_counter(own))
    }

    fn change_frame(&mut self, number: u64, state: FrameState, slot: Option<u32>) -> Result<Entry, AgentError> {
        match self.memory.frame_sent_as(number) {
            Some(Entry::Sent { bytes, .. }) => {
                let entry = Entry::Sent { number, state, slot, bytes };
                self.memory.apply(entry.clone())?;
                self.data_changed();
                self.posteriors.nothing_to_send = None;
                Ok(entry)
            }
            _ => Err(AgentError::NoSuchFrame(number)),
        }
    }

    fn plan(&mut self, sender: u8, layout: &Layout, frame_bytes: usize) -> Result<Option<Vec<u8>>, AgentError> {
        let sharing = self.options.sharing;
        let everyone = || self.team().members.keys().copied().collect();
        let ignored = if sharing.acknowledgements { self.ignored_members() } else { everyone() };
        let delivery = DeliveryEstimate::new(&self.memory, sender, &ignored);
        self.posteriors.update_shared_summary(&self.memory, &|slot| delivery.is_delivered(slot))?;
        let reports = sharing.reports.then(|| ReportPlanner::new(&self.memory, sender, frame_bytes, delivery));
        if let Some(reports) = &reports
            && let Some(report) = self.plan_report(sender, layout, reports)?
        {
            return Ok(Some(self.memory.codec.write_report(&report)?));
        }
        if !sharing.summaries {
            return Ok(None);
        }
        let used_up = || AgentError::CountersUsedUp { id: self.id.clone(), epoch: self.team().epoch };
        let counter = u16::try_from(self.memory.packets.next_counter(sender)).map_err(|_| used_up())?;
        let planner = self.summary_planner(sender, layout)?;
        let planned = match &reports {
            None => planner.plan(&self.posteriors.shared, sharing)?,
            Some(reports) => {
                // Reports carry what is in the window, and carried what was.
                let reported = self.memory.reports.reports_of(sender);
                let begin = reports.begin();
                let is_reported = |slot: u32| {
                    begin.is_some_and(|begin| slot >= begin)
                        || reported.is_some_and(|reported| reported.outcomes.contains_key(&slot))
                };
                planner.plan(&self.posteriors.shared_of(&self.memory, &is_reported)?, sharing)?
            }
        };
        let Some(planned) = planned else { return Ok(None) };
        let message = MapMessage { sender, counter, model: 0, blocks: planned.blocks };
        Ok(Some(self.memory.codec.write(layout, &message)?))
    }

    /// Returns the candidate report after which the mean divergence is smallest: see
    /// [`SummaryPlanner::mean_divergence`].
    fn plan_report(
        &self,
        sender: u8,
        layout: &Layout,
        reports: &ReportPlanner<'_>,
    ) -> Result<Option<ReportMessage>, AgentError> {
        let mut candidates = reports.reports();
        let Some(mut best) = candidates.pop() else { return Ok(None) };
        if candidates.is_empty() || !self.options.sharing.report_candidates {
            return Ok(Some(best));
        }
        let planner = self.summary_planner(sender, layout)?;
        let is_delivered = |slot: u32| reports.is_delivered(slot);
        let shared = self.posteriors.shared_of(&self.memory, &is_delivered)?;
        let mut at_candidates = planner.at_candidates(&shared)?;
        let mut divergence_after = |report: &ReportMessage| -> Result<f64, AgentError> {
            let mut new = reports.slots_in(report);
            new.retain(|&slot| !is_delivered(slot));
            let shared = self.posteriors.shared_with(&self.memory, &shared, &new)?;
            Ok(planner.mean_divergence(&at_candidates.latent(&shared)?))
        };
        let mut least = divergence_after(&best)?;
        for candidate in candidates {
            let divergence = divergence_after(&candidate)?;
            if divergence < least {
                (best, least) = (candidate, divergence);
            }
        }
        Ok(Some(best))
    }

    fn summary_planner<'a>(&'a self, sender: u8, layout: &'a Layout) -> Result<SummaryPlanner<'a>, AgentError> {
        let team = self.team();
        let (quantizer, candidates) = (team.quantizer_of(sender), team.candidates(self.events()));
        Ok(SummaryPlanner::new(quantizer, layout, &self.posteriors, candidates, team.min_gain_nats)?)
    }
}
