//! Replays a mission over many splits, and scores predictions by each vehicle alone, by the team after sharing, and
//! with all events in one place.

use std::sync::Arc;

use dgpc::Latent;
use pingmap_agent::{Agent, AgentError, Event, FitQuality, LearnedModel, Model, Team, VehicleId};
use rayon::prelude::*;

use crate::alternative::Alternative;
use crate::baseline::{DistanceOnly, base_rate};
use crate::calibration::Calibration;
use crate::decision::Decisions;
use crate::event_log::EventLog;
use crate::ignored::{Ignored, ignored_members};
use crate::mission::{Mission, Traffic, probabilities};
use crate::plan::Plan;
use crate::score::{Estimate, MeanScore, Score};
use crate::split::Split;

/// Reason why a replay is impossible.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReplayError {
    /// A split holds out no event.
    #[error("split {split} holds out no event; expected at least one to predict")]
    NothingHeldOut {
        /// The split.
        split: String,
    },
    /// There are no splits.
    #[error("no splits; expected at least one")]
    NoSplits,
    /// A numerical failure.
    #[error("split {split}")]
    Method {
        /// The split.
        split: String,
        /// The failure.
        source: AgentError,
    },
}

/// Scores of a replay, means over splits.
#[derive(Debug, Clone)]
pub struct Replay {
    /// Every vehicle that is a receiver of events.
    pub vehicles: Vec<VehicleId>,
    /// The share of heard training events as the probability of every event.
    pub base_rate: MeanScore,
    /// Logistic regression on the distance between the ends.
    pub distance_only: MeanScore,
    /// Each vehicle with its own events only; mean over vehicles.
    pub own: MeanScore,
    /// One vehicle with all raw events.
    pub centralised: MeanScore,
    /// NLL of own events minus that of all raw events, paired over splits.
    pub gap: Estimate,
    /// The true probabilities, if the log has them. No method can be better on average.
    pub true_probability: Option<MeanScore>,
    /// The team after sharing, one entry per number of frames.
    pub sharing: Vec<Sharing>,
    /// Calibration, if [`Plan::calibration`] is set.
    pub calibration: Option<Calibrated>,
    /// Summary of each split.
    pub splits: Vec<SplitSummary>,
}

/// Calibration over all splits.
#[derive(Debug, Clone, Default)]
pub struct Calibrated {
    /// Each vehicle with its own events only.
    pub own: Calibration,
    /// Each vehicle after the largest number of frames.
    pub team: Calibration,
    /// One vehicle with all raw events.
    pub centralised: Calibration,
    /// Latent variance of the team divided by that with all raw events, for every held-out event and vehicle, in
    /// ascending order. Below 1 the team is more certain than if it counted each event once.
    pub variance_ratios: Vec<f64>,
}

impl Calibrated {
    /// Returns the median of [`Calibrated::variance_ratios`]; `None` without any.
    pub fn median_variance_ratio(&self) -> Option<f64> {
        self.variance_ratios.get(self.variance_ratios.len() / 2).copied()
    }

    /// Returns the share of ratios below 1; `None` without any.
    pub fn surer(&self) -> Option<f64> {
        let count = self.variance_ratios.len();
        let surer = self.variance_ratios.partition_point(|&ratio| ratio < 1.0);
        (count > 0).then(|| surer as f64 / count as f64)
    }

    fn of_split(mission: &Mission, frames: usize, truth: Option<&[f64]>) -> Result<Self, AgentError> {
        let mut calibrated = Self::default();
        let count = |calibration: &mut Calibration, agent: &Agent| -> Result<Latent, AgentError> {
            let latent = mission.latent(agent)?;
            let predicted = probabilities(&mut agent.clone(), &mission.held_out)?;
            calibration.count(&predicted, &mission.interval_latent(agent)?, &mission.outcomes, truth);
            Ok(latent)
        };
        let all = count(&mut calibrated.centralised, &mission.centralised)?;
        for agent in &mission.vehicles {
            count(&mut calibrated.own, agent)?;
        }
        for agent in &mission.after_sharing(frames)? {
            let latent = count(&mut calibrated.team, agent)?;
            let ratios = latent.variance.iter().zip(&all.variance).map(|(team, all)| team / all);
            calibrated.variance_ratios.extend(ratios);
        }
        Ok(calibrated)
    }

    fn over<'a>(splits: impl Iterator<Item = &'a Self>) -> Self {
        let mut sum = Self::default();
        for split in splits {
            sum.own.add(&split.own);
            sum.team.add(&split.team);
            sum.centralised.add(&split.centralised);
            sum.variance_ratios.extend(&split.variance_ratios);
        }
        sum.variance_ratios.sort_by(f64::total_cmp);
        sum
    }
}

impl Replay {
    /// Returns the median of a number over splits; 0 without splits.
    pub fn median(&self, of: impl Fn(&SplitSummary) -> f64) -> f64 {
        let mut values: Vec<f64> = self.splits.iter().map(of).collect();
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or_default()
    }

    /// Returns whether the vehicles' fits, and the centralised fit, were dense in every split.
    pub fn dense(&self) -> (bool, bool) {
        (self.splits.iter().all(|split| split.dense.0), self.splits.iter().all(|split| split.dense.1))
    }
}

/// The team after every vehicle sent `frames` packets.
#[derive(Debug, Clone)]
pub struct Sharing {
    /// Number of packets of every vehicle.
    pub frames: usize,
    /// Traffic of a vehicle, the mean over splits.
    pub traffic: Traffic,
    /// Mean score over vehicles.
    pub team: MeanScore,
    /// NLL of the vehicle with the worst score.
    pub worst_vehicle_nll: f64,
    /// NLL of each vehicle alone minus that of the team, paired over splits.
    pub gain: Estimate,
    /// NLL of the team minus that of all raw events, paired over splits.
    pub behind: Estimate,
    /// (own − team) / (own − centralised) in NLL; `None` if that gap is not significant.
    pub gap_closed: Option<Estimate>,
    /// Mean scores over vehicles of the alternative uses of as many frames in [`Plan::alternatives`].
    pub alternatives: Vec<(Alternative, MeanScore)>,
}

/// One split and the model learned on it.
#[derive(Debug, Clone)]
pub struct SplitSummary {
    /// Name of the split.
    pub name: String,
    /// Number of training events.
    pub training_events: usize,
    /// Number of held-out events.
    pub held_out_events: usize,
    /// Vehicles without any training event.
    pub vehicles_without_events: Vec<VehicleId>,
    /// The team configuration.
    pub team: Arc<Team>,
    /// Fit of the model, if it was learned.
    pub fit: Option<LearnedModel>,
    /// Whether the vehicles' fits, and the centralised fit, were dense.
    pub dense: (bool, bool),
    /// Whether every fit reached its fixed point.
    pub converged: bool,
    /// Largest jitter of any fit; usually 0.
    pub jitter_max: f64,
    /// NLL of the held-out events.
    pub nll: SplitNll,
    /// Members whose data vehicles exclude after the last number of frames.
    pub ignored: Vec<Ignored>,
}

/// NLL of the held-out events of one split.
#[derive(Debug, Clone, PartialEq)]
pub struct SplitNll {
    /// Logistic regression on the distance.
    pub distance_only: f64,
    /// Each vehicle with its own events only, mean over vehicles.
    pub own: f64,
    /// The team for each number of frames, mean over vehicles.
    pub team: Vec<f64>,
    /// All raw events in one place.
    pub centralised: f64,
}

impl SplitSummary {
    /// Returns the packet model.
    pub fn model(&self) -> &Model {
        &self.team.model
    }
}

/// Scores of one split.
struct SplitScores {
    summary: SplitSummary,
    base_rate: Score,
    distance_only: Score,
    own: Score,
    centralised: Score,
    true_probability: Option<Score>,
    /// Scores for each number of frames: the mean over vehicles, and each vehicle's.
    team: Vec<(Score, Vec<Score>)>,
    /// Traffic for each number of frames.
    traffic: Vec<Traffic>,
    /// Score of every alternative for each number of frames, mean over vehicles.
    alternatives: Vec<Vec<Score>>,
    calibration: Option<Calibrated>,
}

impl SplitScores {
    /// Returns the number of held-out events divided by that of training events.
    fn test_share(&self) -> f64 {
        self.summary.held_out_events as f64 / self.summary.training_events.max(1) as f64
    }
}

/// Replays the mission once for every split, in parallel on the current thread pool. Results do not depend on the
/// number of threads. `step` is called after every stage, 1 + `frames.len()` times per split.
///
/// # Errors
/// Returns [`ReplayError`] without held-out events or splits, and for a numerical failure.
pub fn replay(
    log: &EventLog,
    splits: &[Split],
    frames: &[usize],
    plan: &Plan,
    step: &(dyn Fn() + Sync),
) -> Result<Replay, ReplayError> {
    let scores: Result<Vec<SplitScores>, ReplayError> = splits
        .par_iter()
        .enumerate()
        .map(|(n, split)| {
            // Impairments of the channel differ between splits.
            let plan = Plan { seed: plan.seed.wrapping_add((n as u64) << 32), ..plan.clone() };
            replay_split(log, split, frames, &plan, step)
        })
        .collect();
    let scores = scores?;
    let test_share = scores.iter().map(SplitScores::test_share).sum::<f64>() / scores.len() as f64;
    let mean = |of: &dyn Fn(&SplitScores) -> Score| {
        MeanScore::over(&scores.iter().map(of).collect::<Vec<_>>(), test_share).ok_or(ReplayError::NoSplits)
    };
    let paired = |of: &dyn Fn(&SplitScores) -> f64| {
        Estimate::overlapping(&scores.iter().map(of).collect::<Vec<_>>(), test_share).ok_or(ReplayError::NoSplits)
    };
    let gap = paired(&|s| s.own.nll - s.centralised.nll)?;
    let true_scores: Option<Vec<Score>> = scores.iter().map(|s| s.true_probability).collect();
    let vehicles = log.vehicles();
    let share = |(row, &frames): (usize, &usize)| {
        let team = mean(&|s| s.team[row].0)?;
        let traffic: Vec<Traffic> = scores.iter().map(|s| s.traffic[row]).collect();
        let of_vehicle = |v: usize| scores.iter().map(|s| s.team[row].1[v].nll).sum::<f64>() / scores.len() as f64;
        let gain = paired(&|s| s.own.nll - s.team[row].0.nll)?;
        let closed = gain.mean / gap.mean;
        // Error of a ratio of two correlated means, from each split's residual: its gain minus the ratio times its gap.
        let left = paired(&|s| s.own.nll - s.team[row].0.nll - closed * (s.own.nll - s.centralised.nll))?;
        let tried = plan.alternatives.iter().enumerate();
        let alternatives = tried.map(|(place, &way)| Ok((way, mean(&|s| s.alternatives[row][place])?)));
        Ok(Sharing {
            frames,
            traffic: Traffic::mean(&traffic).ok_or(ReplayError::NoSplits)?,
            team,
            worst_vehicle_nll: (0..vehicles.len()).map(of_vehicle).fold(f64::NEG_INFINITY, f64::max),
            alternatives: alternatives.collect::<Result<_, ReplayError>>()?,
            gain,
            behind: paired(&|s| s.team[row].0.nll - s.centralised.nll)?,
            gap_closed: (gap.mean > 0.0 && gap.is_clear()).then(|| Estimate {
                mean: closed,
                se: left.se.map(|se| se / gap.mean),
                count: gap.count,
            }),
        })
    };
    Ok(Replay {
        base_rate: mean(&|s| s.base_rate)?,
        distance_only: mean(&|s| s.distance_only)?,
        own: mean(&|s| s.own)?,
        centralised: mean(&|s| s.centralised)?,
        gap,
        true_probability: true_scores.and_then(|scores| MeanScore::over(&scores, test_share)),
        sharing: frames.iter().enumerate().map(share).collect::<Result<_, ReplayError>>()?,
        calibration: plan.calibration.then(|| Calibrated::over(scores.iter().filter_map(|s| s.calibration.as_ref()))),
        splits: scores.into_iter().map(|s| s.summary).collect(),
        vehicles,
    })
}

fn replay_split(
    log: &EventLog,
    split: &Split,
    frames: &[usize],
    plan: &Plan,
    step: &(dyn Fn() + Sync),
) -> Result<SplitScores, ReplayError> {
    let failed = |source: AgentError| ReplayError::Method { split: split.name.clone(), source };
    let nothing = || ReplayError::NothingHeldOut { split: split.name.clone() };
    let frames_max = frames.iter().copied().max().unwrap_or(0);
    let mission = Mission::prepare(log, split, plan, frames_max).map_err(failed)?;
    let truth = log.true_probability.as_ref();
    let truth = truth.map(|known| split.indices(true).iter().map(|&n| known[n]).collect::<Vec<_>>());
    let held_out: Vec<&Event> = split.indices(true).iter().map(|&n| &log.events[n]).collect();
    let decisions = truth.clone().and_then(|truth| Decisions::draw(&held_out, truth, plan.seed));
    let score = |probabilities: &[f64]| {
        let score = Score::new(probabilities, &mission.outcomes).ok_or_else(nothing)?;
        Ok(Score { regret: decisions.as_ref().map(|decisions| decisions.regret(probabilities)), ..score })
    };
    let score_each = |predictions: Vec<Vec<f64>>| {
        let each = predictions.iter().map(|p| score(p)).collect::<Result<Vec<_>, _>>()?;
        Ok((Score::mean(&each).ok_or_else(nothing)?, each))
    };

    let rate = base_rate(&mission.training_outcomes);
    let distance_only = DistanceOnly::fit(&mission.training, &mission.training_outcomes);
    let by_distance: Vec<f64> =
        mission.held_out.iter().map(|attempt| distance_only.probability(&attempt.link)).collect();
    let (own, _) = score_each(mission.predict_alone().map_err(failed)?)?;
    let centralised = score(&mission.predict_centralised().map_err(failed)?)?;
    let true_probability = truth.as_ref().map(|truth| score(truth)).transpose()?;
    step();
    let mut team = Vec::with_capacity(frames.len());
    let mut traffic = Vec::with_capacity(frames.len());
    let mut alternatives = Vec::with_capacity(frames.len());
    let mut ignored = Vec::new();
    for &frames in frames {
        let mut agents = mission.after_sharing(frames).map_err(failed)?;
        ignored = ignored_members(&mut agents).map_err(failed)?;
        traffic.push(mission.traffic(frames, &agents));
        team.push(score_each(mission.predict(agents).map_err(failed)?)?);
        let tried = plan.alternatives.iter();
        let each = tried.map(|way| Ok(score_each(way.predict(&mission, frames).map_err(failed)?)?.0));
        alternatives.push(each.collect::<Result<Vec<_>, ReplayError>>()?);
        step();
    }
    let calibration = plan.calibration.then(|| Calibrated::of_split(&mission, frames_max, truth.as_deref()));
    let distance_only = score(&by_distance)?;
    let nll = SplitNll {
        distance_only: distance_only.nll,
        own: own.nll,
        team: team.iter().map(|(score, _)| score.nll).collect(),
        centralised: centralised.nll,
    };
    Ok(SplitScores {
        calibration: calibration.transpose().map_err(failed)?,
        base_rate: score(&vec![rate; mission.held_out.len()])?,
        distance_only,
        own,
        centralised,
        true_probability,
        team,
        traffic,
        alternatives,
        summary: summarise(split, &mission, nll, ignored),
    })
}

fn summarise(split: &Split, mission: &Mission, nll: SplitNll, ignored: Vec<Ignored>) -> SplitSummary {
    let empty = mission.vehicles.iter().filter(|agent| agent.events().len() == 0);
    let agents = mission.vehicles.iter().chain([&mission.centralised]);
    let quality: Vec<FitQuality> = agents.filter_map(|agent| agent.status().fit).collect();
    SplitSummary {
        converged: quality.iter().all(|quality| quality.converged),
        jitter_max: quality.iter().map(|quality| quality.jitter).fold(0.0, f64::max),
        name: split.name.clone(),
        training_events: mission.training.len(),
        held_out_events: mission.held_out.len(),
        vehicles_without_events: empty.map(|agent| agent.id().clone()).collect(),
        nll,
        ignored,
        team: mission.team.clone(),
        fit: mission.fit.clone(),
        dense: (mission.vehicles.iter().all(|agent| agent.status().is_dense), mission.centralised.status().is_dense),
    }
}
