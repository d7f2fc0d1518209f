//! `pingmap replay`: what each vehicle knows alone, what the team knows after sharing, what it could know at best.

use std::path::Path;

use dgpc::Shape;
use pingmap_agent::{Fusion, InputSpec, SummaryKind, VehicleId};
use pingmap_trial::{EventLog, MeanScore, Plan, Replay, Split, draw_splits, read_splits};
use serde_json::{Value, json};

use crate::cli;
use crate::output::{count, note, print, print_json, progress, table, use_threads, warn};
use crate::report;
use crate::survey::{open_log, thinned};

pub fn run(options: &cli::Replay) -> anyhow::Result<()> {
    use_threads(options.work.threads)?;
    let log = open_log(&options.events)?;
    let splits = match &options.splits {
        Some(path) => read_splits(path, &log)?,
        None => draw_splits(&log, options.repeats, options.test_share, options.work.seed),
    };
    if let Some(folder) = &options.report {
        report::make_folder(folder)?;
    }
    let events = log.events.len();
    let (log, splits) = thinned(log, splits, options.work.events_max, options.work.seed);
    let plan = Plan {
        kernel: options.kernel.choice(),
        limits: options.work.limits(),
        summary: options.summary.kind(),
        fusion: options.fusion.fusion(),
        points_per_frame: options.points_per_frame,
        seed: options.work.seed,
    };
    let mission = Replayed::new(log, events, splits, &options.frames, plan)?;
    mission.show(options.json, options.report.as_deref())
}

/// A replay and all that is needed to speak about it.
pub struct Replayed {
    pub log: EventLog,
    pub splits: Vec<Split>,
    pub plan: Plan,
    pub replay: Replay,
    /// Events in the file, before thinning.
    events: usize,
}

impl Replayed {
    /// Replays the mission with a progress bar.
    pub fn new(log: EventLog, events: usize, splits: Vec<Split>, frames: &[usize], plan: Plan) -> anyhow::Result<Self> {
        let bar = progress((splits.len() * (1 + frames.len())) as u64, "replaying");
        let replay = pingmap_trial::replay(&log, &splits, frames, &plan, &|| bar.inc(1))?;
        bar.finish_and_clear();
        Ok(Self { log, splits, plan, replay, events })
    }

    /// Warns, prints, and writes the report if one is wanted.
    pub fn show(&self, as_json: bool, report: Option<&Path>) -> anyhow::Result<()> {
        for split in &self.replay.splits {
            let (name, without) = (&split.name, &split.vehicles_without_events);
            if split.training_events == 0 {
                warn(format_args!("split {name}: every event is held out, so that nothing can be learned"));
            } else if !without.is_empty() {
                let names: Vec<&str> = without.iter().map(VehicleId::as_str).collect();
                warn(format_args!(
                    "split {name}: no training events for {}: knowing only what others send",
                    names.join(", ")
                ));
            }
            if !split.converged {
                warn(format_args!("split {name}: a fit stopped before its fixed point"));
            }
        }
        if as_json {
            print_json(&self.json())?;
        } else {
            print(&self.text())?;
        }
        match report {
            Some(folder) => {
                let page = report::write(self, folder)?;
                note(format_args!("report: {}", page.display()));
                Ok(())
            }
            None => Ok(()),
        }
    }

    fn text(&self) -> String {
        let replay = &self.replay;
        let vehicles: Vec<&str> = replay.vehicles.iter().map(VehicleId::as_str).collect();
        let splits = match replay.splits.as_slice() {
            [_] => "1 split".to_owned(),
            several => format!("mean of {} splits", several.len()),
        };
        format!(
            "{}, {} ({}); {splits}, seed {}\n{}\n{}\n\n{}\n\n{}\n\n{}",
            count(self.log.events.len(), "event"),
            count(vehicles.len(), "vehicle"),
            vehicles.join(", "),
            self.plan.seed,
            self.kernel_line(),
            self.inference_line(),
            table(&["", "accuracy", "NLL", "± s.e."], &self.score_rows()),
            table(
                &["after sharing, per vehicle", "accuracy", "NLL", "± s.e.", "worst vehicle", "gap closed"],
                &self.sharing_rows()
            ),
            "NLL: negative log-likelihood of held-out events in nats, lower is better. Gap closed: how much of the way from\nown events only to all raw events in one place sharing goes.",
        )
    }

    /// The scores that sharing is compared with.
    pub fn score_rows(&self) -> Vec<Vec<String>> {
        let replay = &self.replay;
        let mut rows = vec![
            score_row("base rate", &replay.base_rate),
            score_row("distance only", &replay.distance_only),
            score_row("own events only", &replay.own),
            score_row("all raw events in one place", &replay.centralised),
        ];
        rows.extend(replay.true_probability.as_ref().map(|score| score_row("true probability", score)));
        rows
    }

    /// The team for each number of frames.
    pub fn sharing_rows(&self) -> Vec<Vec<String>> {
        let row = |sharing: &pingmap_trial::Sharing| {
            let (frames, points) = (count(sharing.frames, "packet"), count(self.plan.points_per_frame, "point"));
            let name = format!("{frames} of {points}");
            let gap = sharing.gap_closed.map_or("–".to_owned(), |gap| format!("{:.0} %", 100.0 * gap));
            [score_row(&name, &sharing.team), vec![format!("{:.4}", sharing.worst_vehicle_nll), gap]].concat()
        };
        self.replay.sharing.iter().map(row).collect()
    }

    pub fn kernel_line(&self) -> String {
        let kernel = &self.plan.kernel;
        let direction = if kernel.reciprocal { ", the same both ways" } else { "" };
        let source = match self.replay.splits.iter().find_map(|split| split.evidence.map(|_| split.search_events)) {
            Some(events) => {
                let splits = &self.replay.splits;
                let edge = match splits.iter().filter(|split| split.at_grid_edge).count() {
                    0 => String::new(),
                    at_edge => format!("; at the edge of the grid in {at_edge} of {}", count(splits.len(), "split")),
                };
                format!("by grid search on {events} pooled training events{edge}")
            }
            None => "as given".to_owned(),
        };
        format!(
            "{} kernel{direction}: length-scale {:.0} m, variance {} ({source})",
            shape_words(kernel.shape),
            self.median(|split| split.length_scale_m),
            self.median(|split| split.variance),
        )
    }

    fn inference_line(&self) -> String {
        let (own, centralised) = self.dense();
        let words = |dense: bool| if dense { "dense" } else { "sparse" };
        format!(
            "{} mean field for each vehicle, {} for all events together; {} summaries, fusion by {}",
            words(own),
            words(centralised),
            summary_name(self.plan.summary),
            fusion_name(self.plan.fusion),
        )
    }

    /// Whether every vehicle's fit, and the centralised one, was dense in every split.
    fn dense(&self) -> (bool, bool) {
        let splits = &self.replay.splits;
        (splits.iter().all(|split| split.dense.0), splits.iter().all(|split| split.dense.1))
    }

    fn median(&self, of: impl Fn(&pingmap_trial::SplitSummary) -> f64) -> f64 {
        let mut values: Vec<f64> = self.replay.splits.iter().map(of).collect();
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or_default()
    }

    fn json(&self) -> Value {
        let replay = &self.replay;
        let kernel = &self.plan.kernel;
        let limits = &self.plan.limits;
        let (own, centralised) = self.dense();
        let method = |dense: bool| if dense { "dense mean field" } else { "sparse mean field" };
        let sharing = replay.sharing.iter().map(|sharing| {
            json!({
                "frames": sharing.frames, "points_per_frame": self.plan.points_per_frame, "bytes_per_vehicle": null,
                "team": score_json(&sharing.team), "worst_vehicle_nll": sharing.worst_vehicle_nll,
                "gap_closed": sharing.gap_closed,
            })
        });
        let per_split = replay.splits.iter().map(|split| {
            json!({
                "name": split.name, "training_events": split.training_events, "held_out_events": split.held_out_events,
                "length_scale_m": split.length_scale_m, "variance": split.variance, "evidence": split.evidence,
                "search_events": split.search_events, "at_grid_edge": split.at_grid_edge,
                "converged": split.converged, "jitter_max": split.jitter_max,
            })
        });
        json!({
            "schema": 1,
            "events": self.events,
            "events_used": self.log.events.len(),
            "vehicles": replay.vehicles.len(),
            "vehicle_ids": replay.vehicles.iter().map(VehicleId::as_str).collect::<Vec<_>>(),
            "splits": replay.splits.len(),
            "seed": self.plan.seed,
            "inference": {
                "own": method(own), "centralised": method(centralised),
                "dense_events_max": limits.dense_events_max, "inducing_points_max": limits.inducing_points_max,
                "summary": summary_name(self.plan.summary), "fusion": fusion_name(self.plan.fusion),
            },
            "kernel": {
                "shape": shape_name(kernel.shape), "reciprocal": kernel.reciprocal,
                "inputs": if self.log.inputs() == InputSpec::Positions { "positions" } else { "positions and depths" },
                "length_scale_m": self.median(|split| split.length_scale_m),
                "variance": self.median(|split| split.variance),
            },
            "prior_mean": "zero",
            "scores": {
                "base_rate": score_json(&replay.base_rate), "distance_only": score_json(&replay.distance_only),
                "own": score_json(&replay.own), "centralised": score_json(&replay.centralised),
                "true_probability": replay.true_probability.as_ref().map(score_json),
            },
            "sharing": sharing.collect::<Vec<_>>(),
            "per_split": per_split.collect::<Vec<_>>(),
        })
    }
}

fn score_row(name: &str, score: &MeanScore) -> Vec<String> {
    let error = score.nll_se.map_or("–".to_owned(), |error| format!("{error:.4}"));
    vec![name.to_owned(), format!("{:.1} %", 100.0 * score.accuracy), format!("{:.4}", score.nll), error]
}

fn score_json(score: &MeanScore) -> Value {
    json!({ "acc": score.accuracy, "nll": score.nll, "nll_se": score.nll_se })
}

/// As the option `--fusion` calls it.
fn fusion_name(fusion: Fusion) -> &'static str {
    match fusion {
        Fusion::Sites => "sites",
        Fusion::Concatenation => "concatenation",
    }
}

/// As the option `--summary` calls it.
fn summary_name(kind: SummaryKind) -> &'static str {
    match kind {
        SummaryKind::Marginal => "marginal",
        SummaryKind::Variational => "variational",
    }
}

/// As the option `--kernel` calls it.
fn shape_name(shape: Shape) -> &'static str {
    match shape {
        Shape::SquaredExponential => "squared-exponential",
        Shape::Matern32 => "matern32",
        Shape::Matern52 => "matern52",
    }
}

fn shape_words(shape: Shape) -> &'static str {
    match shape {
        Shape::SquaredExponential => "squared-exponential",
        Shape::Matern32 => "Matérn 3/2",
        Shape::Matern52 => "Matérn 5/2",
    }
}
