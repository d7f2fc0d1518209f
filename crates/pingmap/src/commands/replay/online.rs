//! `pingmap replay --online`: replays the mission in the order of time.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

use pingmap_trial::{EventLog, Observer, Online, Plan, Preshared, Step, TrafficPlan, Vehicles, online_observed};
use schemars::JsonSchema;
use serde::Serialize;

use super::film;
use super::report::{of_log, of_run, pairs};
use crate::figure::{Figure, Mark, Room, Series, Style, curves};
use crate::files::write_file;
use crate::log::WholeLog;
use crate::model::{HAS_SEEN_LOG, InputDigests};
use crate::output::{Results, count, note, print_json, print_text, progress, table};
use crate::page::Page;

/// Number of parts of the mission in the table.
const PARTS: usize = 10;

/// Ranges of the early events of each vehicle in the table.
const EARLY_EVENTS: [Range<usize>; 3] = [0..50, 50..100, 100..200];

/// Points of a curve.
const CURVE_POINTS: usize = 200;

/// A series of the comparison: name, style of its curve, and score in a step.
type Way = (&'static str, Style<'static>, fn(&Step) -> f64);

const WAYS: [Way; 4] = [
    ("range only", Style { color: "#8c6bb1", width: 1.6, dash: &[1.0, 3.0], mark: Mark::Cross }, |step| {
        step.range_only
    }),
    ("own events only", Style { color: "#d7301f", width: 1.6, dash: &[2.0, 3.0], mark: Mark::Triangle }, |step| {
        step.own
    }),
    ("team", Style { color: "#0571b0", width: 2.2, dash: &[], mark: Mark::Dot }, |step| step.team),
    (
        "all events at once, without delay",
        Style { color: "#404040", width: 1.6, dash: &[7.0, 4.0], mark: Mark::Square },
        |step| step.centralised,
    ),
];

/// Default number of transmissions between two packets of a vehicle.
pub const SLOT_EVERY: usize = 10;

/// Options of a replay in the order of time.
pub struct OnlineMission {
    pub plan: Plan,
    /// Whether the model was learned from this log.
    pub has_seen_log: bool,
    /// Packets and outcomes that are sent with the transmissions.
    pub traffic: TrafficPlan,
    pub seed: u64,
    /// The log before thinning.
    pub whole: WholeLog,
}

/// Files that are written in addition to the printed scores.
pub struct OnlineFiles<'a> {
    /// Folder of the report.
    pub report: Option<&'a Path>,
    /// Page of the film.
    pub film: Option<&'a Path>,
}

impl OnlineMission {
    pub fn run(&self, log: &EventLog, results: Results, as_json: bool, files: OnlineFiles) -> anyhow::Result<()> {
        let mut recorder = files.film.map(|_| film::Recorder::new(log)).transpose()?;
        let online = self.replay(log, recorder.as_mut())?;
        let command = results.command().to_vec();
        match as_json {
            true => print_json(results, &OnlineJson::of(&online, self))?,
            false => print_text(results, &self.text(&online))?,
        }
        if let Some(folder) = files.report {
            note(format_args!("report: {}", self.write_report((&online, log), &command, folder)?.display()));
        }
        if let (Some(path), Some(recorder)) = (files.film, recorder) {
            let page = film::page(&recorder.finish(self.whole.name.clone()), &self.provenance(log, &command))?;
            write_file(path, page.as_bytes())?;
            note(format_args!("film: {}", path.display()));
        }
        Ok(())
    }

    /// Replays the mission with a progress bar, and records the film if there is a recorder.
    fn replay(&self, log: &EventLog, mut recorder: Option<&mut film::Recorder>) -> anyhow::Result<Online> {
        let times_s = recorder.as_ref().map(|recorder| recorder.times_s()).unwrap_or_default();
        let steps = log.events.len() + times_s.len() * log.vehicles().len();
        let bar = progress(steps as u64, "replaying in the order of time");
        let step = || bar.inc(1);
        let mut observe = |time_s, vehicles: &Vehicles| {
            recorder.as_mut().map_or(Ok(()), |recorder| recorder.record(time_s, vehicles, &step))
        };
        let observer = Observer { times_s: &times_s, observe: &mut observe };
        let online = online_observed(log, &self.plan, self.traffic, &step, observer)?;
        bar.finish_and_clear();
        Ok(online)
    }

    /// Returns facts about the log, the model and the run.
    fn provenance(&self, log: &EventLog, command: &[String]) -> Vec<(&'static str, String)> {
        let seed = vec![("seed", self.seed.to_string())];
        [of_log(log, &self.whole, &self.plan.preshared), seed, of_run(command)].concat()
    }

    fn headline(&self, online: &Online) -> String {
        let packets: usize = online.packets.values().sum();
        let model = match self.plan.preshared {
            Preshared::Nothing => "the model is the prior before any event; --model gives a learned one".to_owned(),
            Preshared::Model(_) | Preshared::Team(_) => {
                let mean = online.model_weights.values().sum::<f64>() / online.model_weights.len().max(1) as f64;
                let model = if self.has_seen_log { HAS_SEEN_LOG } else { "model as given" };
                format!("{model}; the mean final weight of the model is {mean:.2}, that of the prior {:.2}", 1.0 - mean)
            }
        };
        let vehicles = online.team.members.len();
        let slots = self
            .traffic
            .slot_every
            .map(|every| format!("at most one packet of a vehicle every {}", count(every, "transmission")));
        let sent = self.traffic.slot_every.map(|_| {
            let (packets, bytes) = (count(packets, "packet"), count(online.bytes, "byte"));
            format!("{packets}, {bytes}, heard {}", count(online.received, "time"))
        });
        let is_spare = self.traffic.piggyback_bytes > 0;
        let spare = is_spare.then(|| format!("{} on each", count(self.traffic.piggyback_bytes, "piggybacked byte")));
        let spared = is_spare.then(|| format!("{} in all", count(online.piggyback_bytes, "piggybacked byte")));
        let both =
            |one: Option<String>, other: Option<String>| one.into_iter().chain(other).collect::<Vec<_>>().join(", ");
        format!(
            "{} in the order of time, {}; {}\n{}; {model}",
            count(online.steps.len(), "event"),
            count(vehicles, "vehicle"),
            both(slots, spare),
            both(sent, spared),
        )
    }

    fn text(&self, online: &Online) -> String {
        format!(
            "{}\n\n{}\n\nNLL: negative log-likelihood in nats of every event, predicted by its receiver beforehand; lower is better.\nRange only: logistic regression on range, from the own events of the receiver.\nSlots are the transmissions of the log, in the order of time.",
            self.headline(online),
            table(&header(), &rows(online))
        )
    }

    /// Returns the main result as a sentence.
    fn conclusion(&self, online: &Online) -> String {
        let Some(Step { own, team, centralised, .. }) = Step::mean(&online.steps) else {
            return "The log has no events.".to_owned();
        };
        let better = match own - centralised {
            gap if gap <= 0.0 => "events of other vehicles do not help here".to_owned(),
            gap if team >= own => format!("sharing does not help, although all events would gain {gap:.3} nats"),
            gap => format!("sharing closes {:.0} % of the gap", 100.0 * (own - team) / gap),
        };
        format!(
            "The NLL of coming events is {own:.3} nats for vehicles alone, {team:.3} for the team, and {centralised:.3} with \
             all events at once: {better}."
        )
    }

    fn write_report(
        &self,
        (online, log): (&Online, &EventLog),
        command: &[String],
        folder: &Path,
    ) -> anyhow::Result<PathBuf> {
        let figure = figure(online);
        write_file(&folder.join("online.png"), &figure.png()?)?;
        let page = folder.join("index.html");
        let mut html = Page::new("pingmap: a mission in the order of time");
        html.conclusion(&self.conclusion(online));
        html.paragraph(&self.headline(online));
        html.heading("How well are coming events predicted?");
        html.figure(&figure, "NLL of coming events in the order of time: lower is better.");
        html.table(&header(), &rows(online));
        html.paragraph(
            "Every event is predicted by its receiver before it is learned from. NLL is the negative log-likelihood in nats: lower is better.",
        );
        html.heading("Received messages");
        pairs(&mut html, log);
        html.heading("Provenance");
        html.facts(&self.provenance(log, command));
        write_file(&page, html.finish().as_bytes())?;
        Ok(page)
    }
}

/// Returns the NLL in each part of the mission, and over the whole mission.
fn rows(online: &Online) -> Vec<Vec<String>> {
    let size = online.steps.len().div_ceil(PARTS).max(1);
    let row =
        |name: String, step: &Step| [vec![name], WAYS.map(|(_, _, of)| format!("{:.4}", of(step))).to_vec()].concat();
    let parts = online.steps.chunks(size).filter_map(|part| {
        let mean = Step::mean(part)?;
        Some(row(format!("{:.0} s to {:.0} s", part.first()?.time_s, mean.time_s), &mean))
    });
    let early = EARLY_EVENTS.into_iter().filter_map(|events| {
        let steps = online.steps.iter().filter(|step| events.contains(&step.earlier));
        let name = format!("own events {} to {}", events.start + 1, events.end);
        Some(row(name, &Step::mean(steps)?))
    });
    let all = Step::mean(&online.steps).map(|mean| row("all".to_owned(), &mean));
    parts.chain(early).chain(all).collect()
}

fn header() -> Vec<&'static str> {
    ["NLL of coming events"].into_iter().chain(WAYS.map(|(name, _, _)| name)).collect()
}

/// A replay in the order of time in JSON.
#[derive(Serialize, JsonSchema)]
pub struct OnlineJson {
    /// Version of this object.
    schema: u32,
    #[serde(flatten)]
    digests: InputDigests,
    /// Number of events of the mission.
    events: usize,
    /// Number of its transmissions after which a vehicle may send a packet. A packet is sent only if it is useful.
    slot_every: Option<usize>,
    /// Bytes in every transmission for the newest outcomes of its sender.
    piggyback_bytes: usize,
    /// Seed of all random numbers.
    seed: u64,
    /// Whether the model was learned from these events. The scores are then too good.
    model_has_seen_log: bool,
    /// Number of packets that each vehicle sent.
    packets: BTreeMap<String, usize>,
    /// Bytes of all packets.
    bytes: usize,
    /// Number of receptions of packets that were accepted.
    received: usize,
    /// Bytes of piggybacked outcomes in all transmissions.
    piggyback_bytes_sent: usize,
    /// Final weight of the given model in the predictions of each vehicle, 0 to 1; the rest is that of the prior before
    /// any event. Empty if no model was given.
    model_weights: BTreeMap<String, f64>,
    /// Mean negative log-likelihood over the whole mission, in nats.
    nll: Option<StepJson>,
    /// Mean negative log-likelihood up to each time, in nats.
    running_nll: Vec<StepJson>,
}

#[derive(Serialize, JsonSchema)]
pub struct StepJson {
    /// Time in seconds.
    time_s: f64,
    /// Logistic regression on range of each vehicle's own events.
    range_only: f64,
    /// Each vehicle with its own events only.
    own: f64,
    /// The team, with received packets.
    team: f64,
    /// All events in one place.
    centralised: f64,
}

impl OnlineJson {
    fn of(online: &Online, mission: &OnlineMission) -> Self {
        let step = |&Step { time_s, range_only, own, team, centralised, .. }: &Step| StepJson {
            time_s,
            range_only,
            own,
            team,
            centralised,
        };
        Self {
            schema: 1,
            digests: InputDigests::given(&mission.whole, &mission.plan.preshared),
            events: online.steps.len(),
            slot_every: mission.traffic.slot_every,
            piggyback_bytes: mission.traffic.piggyback_bytes,
            seed: mission.seed,
            model_has_seen_log: mission.has_seen_log,
            packets: online.packets.iter().map(|(id, &count)| (id.to_string(), count)).collect(),
            bytes: online.bytes,
            received: online.received,
            piggyback_bytes_sent: online.piggyback_bytes,
            model_weights: online.model_weights.iter().map(|(id, &weight)| (id.to_string(), weight)).collect(),
            nll: Step::mean(&online.steps).as_ref().map(step),
            running_nll: online.running(CURVE_POINTS).iter().map(step).collect(),
        }
    }
}

fn figure(online: &Online) -> Figure {
    let running = online.running(CURVE_POINTS);
    // The mean over the first few events varies too much to show.
    let settled = &running[(running.len() / 20).min(running.len().saturating_sub(2))..];
    let points = WAYS.map(|(_, _, of)| settled.iter().map(|step| (step.time_s, of(step))).collect::<Vec<_>>());
    let series: Vec<Series> =
        WAYS.iter().zip(&points).map(|(&(name, style, _), points)| Series { name, points, style }).collect();
    let title = "How well coming events are predicted, so far";
    curves(title, ["time (s)", "mean NLL so far (nats)"], &series, Room::SCREEN, 300.0)
}
