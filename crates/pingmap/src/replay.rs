//! `pingmap replay`: what each vehicle knows alone, what the team knows after sharing, what it could know at best.

use std::collections::BTreeMap;
use std::path::Path;

use pingmap_agent::{LearnedModel, VehicleId};
use pingmap_packet::Layout;
use pingmap_trial::{
    Agreed, Alternative, EventLog, Learners, MeanScore, Plan, Replay, Split, Water, draw_splits, read_splits,
};
use serde_json::{Value, json};

use crate::cli::{self, LearnName};
use crate::learn::{kernel_json, prior_mean_json, stop_words};
use crate::online;
use crate::output::{count, note, print, print_json, progress, table, use_threads, warn};
use crate::report;
use crate::survey::{of_events, open_log, open_model, path_variance, thinned, warn_of_search};
use crate::team::{open_key, open_team};

pub fn run(options: &cli::Replay) -> anyhow::Result<()> {
    use_threads(options.work.threads)?;
    let log = open_log(&options.events)?;
    if let Some(folder) = &options.report {
        report::make_folder(folder)?;
    }
    if options.online {
        let (log, _) = thinned(log, Vec::new(), options.work.events_max, options.work.seed);
        return online::run(&log, &plan(options, &log)?, options);
    }
    let splits = match &options.splits {
        Some(path) => read_splits(path, &log)?,
        None => draw_splits(&log, options.repeats, options.test_share, options.work.seed)?,
    };
    let events = log.events.len();
    let (log, splits) = thinned(log, splits, options.work.events_max, options.work.seed);
    let plan = plan(options, &log)?;
    let mut mission = Replayed::new(log, events, splits, &options.frames, plan)?;
    if options.learn == LearnName::Both {
        mission.learn_own(&options.frames)?;
    }
    mission.show(options.json, options.report.as_deref())
}

/// What the options say of the team and of what it sends.
fn plan(options: &cli::Replay, log: &EventLog) -> anyhow::Result<Plan> {
    let kernel = &options.source.kernel;
    let sharing = &options.sharing;
    let agreed = match (&options.source.model, &sharing.team) {
        (_, Some(path)) => Agreed::Team(open_team(path, log)?),
        (Some(path), None) => Agreed::Model(open_model(path, log)?),
        (None, None) => Agreed::Nothing,
    };
    Ok(Plan {
        agreed,
        learners: if options.learn == LearnName::Own { Learners::Own } else { Learners::Pooled },
        frame_bytes: sharing.frame_bytes,
        key: sharing.key_file.as_ref().map(|path| open_key(path)).transpose()?,
        repeats_max: sharing.repeat,
        water: sharing.water(),
        compare: options.compare,
        ..Plan::new(kernel.learning(kernel.given().few(), options.work.limits()), options.work.seed)
    })
}

/// A replay and all that is needed to speak about it.
pub struct Replayed {
    pub log: EventLog,
    pub splits: Vec<Split>,
    pub plan: Plan,
    pub replay: Replay,
    /// The same with every vehicle learning by itself, if that was asked for beside the pooled one.
    own_learning: Option<Replay>,
    /// Events in the file, before thinning.
    events: usize,
}

impl Replayed {
    /// Replays the mission with a progress bar.
    pub fn new(log: EventLog, events: usize, splits: Vec<Split>, frames: &[usize], plan: Plan) -> anyhow::Result<Self> {
        let replay = with_progress(&log, &splits, frames, &plan)?;
        Ok(Self { log, splits, plan, replay, own_learning: None, events })
    }

    /// Replays it once more with every vehicle learning by itself.
    fn learn_own(&mut self, frames: &[usize]) -> anyhow::Result<()> {
        let plan = Plan { learners: Learners::Own, ..self.plan.clone() };
        self.own_learning = Some(with_progress(&self.log, &self.splits, frames, &plan)?);
        Ok(())
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
            split.fit.iter().for_each(warn_of_search);
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
        let mut text = format!(
            "{}, {} ({}); {splits}, seed {}\n{}\n{}\n\n{}\n\n{}",
            count(self.log.events.len(), "event"),
            count(vehicles.len(), "vehicle"),
            vehicles.join(", "),
            self.plan.seed,
            self.kernel_line(),
            self.inference_line(),
            table(&["", "accuracy", "NLL", "± s.e."], &self.score_rows()),
            table(&SHARING_HEADER, &self.sharing_rows()),
        );
        if self.plan.compare {
            text += &format!("\n\n{}", table(&self.comparison_header(), &self.comparison_rows()));
            text += "\n\nA star marks the best of those that can be sent.";
        }
        if let Some(own) = &self.own_learning {
            let header = ["who learns the model", "pooled, NLL", "± s.e.", "every vehicle, NLL", "± s.e."];
            text += &format!("\n\n{}", table(&header, &self.learner_rows(own)));
        }
        text + "\n\nNLL: negative log-likelihood of held-out events in nats, lower is better. Gap closed: how much of the way from\nown events \
                only to all raw events in one place sharing goes."
    }

    /// What the bytes are used for: ours, then every alternative.
    pub fn comparison_header(&self) -> Vec<&'static str> {
        let tried = self.replay.sharing.first().map_or(&[][..], |sharing| &sharing.alternatives);
        let names = tried.iter().map(|(way, _)| alternative_name(*way));
        ["NLL at equal bytes", "bytes", "pingmap"].into_iter().chain(names).collect()
    }

    /// NLL of each way, one row for each number of frames. The best of those that can be sent is marked.
    pub fn comparison_rows(&self) -> Vec<Vec<String>> {
        let bytes = self.layout().map_or(0, |layout| layout.frame_bytes);
        let row = |sharing: &pingmap_trial::Sharing| {
            let sendable = sharing.alternatives.iter().filter(|(way, _)| *way != Alternative::Unrounded);
            let best = sendable.map(|(_, nll)| *nll).fold(sharing.team.nll, f64::min);
            let cell = |nll: f64| format!("{nll:.4}{}", if nll <= best + 5e-5 { " *" } else { "  " });
            let ways = sharing.alternatives.iter().map(|(way, nll)| match way {
                Alternative::Unrounded => format!("{nll:.4}"),
                _ => cell(*nll),
            });
            let ours = [frames_name(sharing.frames), (bytes * sharing.frames).to_string(), cell(sharing.team.nll)];
            ours.into_iter().chain(ways).collect()
        };
        self.replay.sharing.iter().map(row).collect()
    }

    /// The model learned from pooled events beside models that every vehicle learned by itself.
    fn learner_rows(&self, own: &Replay) -> Vec<Vec<String>> {
        let row = |name: &str, pooled: &MeanScore, own: &MeanScore| {
            let [pooled, own] = [pooled, own].map(|score| score_row("", score)[2..].to_vec());
            [vec![name.to_owned()], pooled, own].concat()
        };
        let mut rows = vec![row("own events only", &self.replay.own, &own.own)];
        rows.extend(
            self.replay
                .sharing
                .iter()
                .zip(&own.sharing)
                .map(|(pooled, own)| row(&frames_name(pooled.frames), &pooled.team, &own.team)),
        );
        rows.push(row("all raw events in one place", &self.replay.centralised, &own.centralised));
        rows
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
            let name = frames_name(sharing.frames);
            let bytes = format!("{:.0}", sharing.bytes_per_vehicle);
            let gap = sharing.gap_closed.map_or("–".to_owned(), |gap| format!("{:.0} %", 100.0 * gap));
            [
                vec![name, bytes],
                score_row("", &sharing.team)[1..].to_vec(),
                vec![format!("{:.4}", sharing.worst_vehicle_nll), gap],
            ]
            .concat()
        };
        self.replay.sharing.iter().map(row).collect()
    }

    /// What links are read with, in one line.
    pub fn kernel_line(&self) -> String {
        let splits = &self.replay.splits;
        let numbers = format!(
            "path: length-scale {:.0} m, variance {:.2}",
            self.median(|split| split.model().length_scale_m()),
            self.median(|split| path_variance(split.model())),
        );
        if self.plan.learners == Learners::Own {
            return format!("every vehicle learns its own model; packets under a fixed one, {numbers}");
        }
        let Some(fit) = splits.iter().find_map(|split| split.fit.as_ref()) else {
            return format!("model as given; {numbers}");
        };
        let mut structures: BTreeMap<String, usize> = BTreeMap::new();
        for fit in splits.iter().filter_map(|split| split.fit.as_ref()) {
            *structures.entry(fit.structure.to_string()).or_default() += 1;
        }
        let in_splits = |(structure, &count): (&String, &usize)| {
            if count == splits.len() {
                structure.clone()
            } else {
                format!("{structure} ({count} of {} splits)", splits.len())
            }
        };
        let structures: Vec<String> = structures.iter().map(in_splits).collect();
        format!(
            "{}; learned from {}; {numbers}",
            structures.join("; "),
            of_events(fit.events_used, fit.events).replace("event", "pooled training event"),
        )
    }

    fn inference_line(&self) -> String {
        let (own, centralised) = self.dense();
        let words = |dense: bool| if dense { "dense" } else { "sparse" };
        format!(
            "{} mean field for each vehicle, {} for all events together; {}",
            words(own),
            words(centralised),
            self.packets_line(),
        )
    }

    /// What is sent, and what happens to it, in a few words.
    fn packets_line(&self) -> String {
        let Water { loss, duplicate, reorder } = self.plan.water;
        let mut line = self.layout().map_or_else(String::new, |layout| {
            let points = layout.points_in_all();
            let sealed = if layout.is_sealed { ", sealed" } else { "" };
            format!("packets of {} with up to {points} points{sealed}", count(layout.schema().length(), "byte"))
        });
        for (share, what) in [(loss, "lost"), (duplicate, "doubled"), (reorder, "overtaken")] {
            if share > 0.0 {
                line += &format!(", {:.0} % {what}", 100.0 * share);
            }
        }
        line
    }

    /// The form of the packets.
    pub fn layout(&self) -> Option<&'static Layout> {
        let team = &self.replay.splits.first()?.team;
        team.layout(team.frame_bytes).ok()
    }

    /// Whether every vehicle's fit, and the centralised one, was dense in every split.
    fn dense(&self) -> (bool, bool) {
        let splits = &self.replay.splits;
        (splits.iter().all(|split| split.dense.0), splits.iter().all(|split| split.dense.1))
    }

    fn packets_json(&self) -> Value {
        let Water { loss, duplicate, reorder } = self.plan.water;
        let team = self.replay.splits.first().map(|split| &split.team);
        json!({
            "message": self.layout().map(|layout| layout.name), "bytes": self.layout().map(|layout| layout.schema().length()),
            "sealed": self.layout().map(|layout| layout.is_sealed), "cell_m": team.map(|team| team.grid.cell_m),
            "loss": loss, "duplicate": duplicate, "reorder": reorder, "repeats_max": team.map(|team| team.repeats_max),
        })
    }

    fn median(&self, of: impl Fn(&pingmap_trial::SplitSummary) -> f64) -> f64 {
        let mut values: Vec<f64> = self.replay.splits.iter().map(of).collect();
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or_default()
    }

    fn json(&self) -> Value {
        let replay = &self.replay;
        let limits = &self.plan.limits;
        let (own, centralised) = self.dense();
        let method = |dense: bool| if dense { "dense mean field" } else { "sparse mean field" };
        let points = self.layout().map(Layout::points_in_all);
        let sharing = replay.sharing.iter().map(|sharing| {
            json!({
                "frames": sharing.frames, "points_per_frame": points,
                "packets_per_vehicle": sharing.packets_per_vehicle, "bytes_per_vehicle": sharing.bytes_per_vehicle,
                "team": score_json(&sharing.team), "worst_vehicle_nll": sharing.worst_vehicle_nll,
                "gap_closed": sharing.gap_closed,
                "alternatives": sharing.alternatives.iter().map(|(way, nll)| json!({
                    "name": alternative_name(*way).trim_matches(['(', ')']), "nll": nll,
                })).collect::<Vec<_>>(),
            })
        });
        let per_split = replay.splits.iter().map(|split| {
            let fit = split.fit.as_ref();
            json!({
                "name": split.name, "training_events": split.training_events, "held_out_events": split.held_out_events,
                "length_scale_m": split.model().length_scale_m(), "variance": path_variance(split.model()),
                "structure": fit.map(|fit| fit.structure.to_string()), "kernel": kernel_json(split.model()),
                "prior_mean": prior_mean_json(split.model().prior.mean()), "evidence": fit.map(LearnedModel::evidence),
                "leave_one_out": fit.map(LearnedModel::leave_one_out), "learning_events": fit.map(|fit| fit.events_used),
                "stop": fit.map(|fit| stop_words(&fit.learned.stop)),
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
                "summary": "residual", "fusion": "sites",
            },
            "packets": self.packets_json(),
            "learn": if self.plan.learners == Learners::Own { "own" } else { "pooled" },
            "kernel": replay.splits.first().map(|split| {
                let mut kernel = kernel_json(split.model());
                kernel["inputs"] = json!(if split.model().inputs.has_depths() { "positions and depths" } else { "positions" });
                kernel["length_scale_m"] = json!(self.median(|split| split.model().length_scale_m()));
                kernel["variance"] = json!(self.median(|split| path_variance(split.model())));
                kernel
            }),
            "prior_mean": replay.splits.first().map(|split| prior_mean_json(split.model().prior.mean())),
            "own_learning": self.own_learning.as_ref().map(own_learning_json),
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

/// Columns of [`Replayed::sharing_rows`].
pub const SHARING_HEADER: [&str; 7] =
    ["after sharing, per vehicle", "bytes", "accuracy", "NLL", "± s.e.", "worst vehicle", "gap closed"];

/// What an alternative is called in a table.
fn alternative_name(way: Alternative) -> &'static str {
    match way {
        Alternative::Unrounded => "(unrounded)",
        Alternative::RawEvents => "raw events",
        Alternative::RandomPoints => "random points",
        Alternative::BadPoints => "bad points",
        Alternative::Variational => "variational",
        Alternative::Concatenation => "concatenation",
    }
}

fn frames_name(frames: usize) -> String {
    count(frames, "packet")
}

/// The scores of every vehicle learning by itself, beside those of the pooled model.
fn own_learning_json(own: &Replay) -> Value {
    let sharing = own.sharing.iter().map(|sharing| {
        json!({
            "frames": sharing.frames, "team": score_json(&sharing.team), "worst_vehicle_nll": sharing.worst_vehicle_nll,
            "gap_closed": sharing.gap_closed,
        })
    });
    json!({
        "scores": { "own": score_json(&own.own), "centralised": score_json(&own.centralised) },
        "sharing": sharing.collect::<Vec<_>>(),
    })
}

/// A replay with a progress bar.
fn with_progress(log: &EventLog, splits: &[Split], frames: &[usize], plan: &Plan) -> anyhow::Result<Replay> {
    let bar = progress((splits.len() * (1 + frames.len())) as u64, "replaying");
    let replay = pingmap_trial::replay(log, splits, frames, plan, &|| bar.inc(1))?;
    bar.finish_and_clear();
    Ok(replay)
}
