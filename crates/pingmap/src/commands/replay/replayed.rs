//! A replay with its inputs.

use std::collections::BTreeMap;

use pingmap_agent::VehicleId;
use pingmap_packet::Layout;
use pingmap_trial::{EventLog, ModelSource, Plan, Replay, Split};

use crate::log::WholeLog;
use crate::model::warn_of_search;
use crate::output::{note, progress, warn};

/// A replay with its inputs.
pub struct Replayed {
    pub log: EventLog,
    pub splits: Vec<Split>,
    pub plan: Plan,
    pub replay: Replay,
    /// The replay in which every vehicle learns its own model, if it was requested in addition.
    pub own_learning: Option<Replay>,
    /// Whether the model was learned from this log.
    pub has_seen_log: bool,
    /// Whether the calibration is printed. A report always contains it.
    pub shows_calibration: bool,
    /// The log before thinning.
    pub whole: WholeLog,
}

impl Replayed {
    /// Replays the mission with a progress bar.
    pub fn new(
        (log, whole): (EventLog, WholeLog),
        splits: Vec<Split>,
        frames: &[usize],
        plan: Plan,
    ) -> anyhow::Result<Self> {
        let replay = with_progress(&log, &splits, frames, &plan)?;
        Ok(Self { log, splits, plan, replay, own_learning: None, has_seen_log: false, shows_calibration: false, whole })
    }

    /// Replays the mission again with every vehicle learning its own model.
    pub fn learn_own(&mut self, frames: &[usize]) -> anyhow::Result<()> {
        let plan = Plan { model_source: ModelSource::Own, ..self.plan.clone() };
        self.own_learning = Some(with_progress(&self.log, &self.splits, frames, &plan)?);
        Ok(())
    }

    /// Prints which members' data vehicles exclude, and in how many splits.
    fn note_ignored(&self) {
        let mut splits = BTreeMap::<(&VehicleId, &VehicleId, &str), usize>::new();
        for ignored in self.replay.splits.iter().flat_map(|split| &split.ignored) {
            *splits.entry((&ignored.listener, &ignored.member, ignored.reason.description())).or_default() += 1;
        }
        for ((listener, member, explanation), count) in splits {
            let of = self.replay.splits.len();
            note(format_args!("{listener} does not use {member} in {count} of {of} splits: {explanation}"));
        }
    }

    /// Warns about conditions that affect the scores.
    pub fn warn(&self) {
        self.note_ignored();
        for split in &self.replay.splits {
            let (name, without) = (&split.name, &split.vehicles_without_events);
            if split.training_events == 0 {
                warn(format_args!("split {name}: every event is held out, so there are no training events"));
            } else if !without.is_empty() {
                let names: Vec<&str> = without.iter().map(VehicleId::as_str).collect();
                warn(format_args!(
                    "split {name}: no training events for {}: they use only received data",
                    names.join(", ")
                ));
            }
            if !split.converged {
                warn(format_args!("split {name}: a fit stopped before its fixed point"));
            }
            split.fit.iter().for_each(warn_of_search);
        }
    }

    /// Returns the layout of the packets.
    pub fn layout(&self) -> Option<&'static Layout> {
        let team = &self.replay.splits.first()?.team;
        team.layout(team.frame_bytes).ok()
    }
}

/// Replays a mission with a progress bar.
fn with_progress(log: &EventLog, splits: &[Split], frames: &[usize], plan: &Plan) -> anyhow::Result<Replay> {
    let bar = progress((splits.len() * (1 + frames.len())) as u64, "replaying");
    let replay = pingmap_trial::replay(log, splits, frames, plan, &|| bar.inc(1))?;
    bar.finish_and_clear();
    Ok(replay)
}
