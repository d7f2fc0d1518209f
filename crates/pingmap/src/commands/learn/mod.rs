//! `pingmap learn`: learns kernel, prior mean and chart from a log.

pub mod json;

use std::path::{Path, PathBuf};

use clap::Args;
use dgpc::{PriorMean, Term, spread_out};
use pingmap_agent::{
    Attempt, Event, Fading, InputSpec, LearnedModel, Learning, LengthUnit, Limits, Link, Model, ModelFile, Provenance,
    Which,
};
use pingmap_trial::{Division, EventLog, Score, learn};

use self::json::{AddedJson, CandidateJson, LearnJson, ModelJson};
use crate::cli_parsers::{open_share, site_points};
use crate::learned_map::all_in_one;
use crate::log::{Logs, thinned};
use crate::model::{InputDigests, counted, of_events, open_model, stop_words, warn_of_search};
use crate::options::{ModelOptions, RESULT, Work};
use crate::output::{BadInput, Results, note, print_json, spinner, table, warn};
use crate::output_target::{Overwrite, Target};
use crate::reference::ReferenceOptions;

/// Learn a model of links from an event log, and write it to a model file
///
/// The other commands read the model file with --model.
#[derive(Args)]
#[command(
    after_long_help = "Examples:\n  pingmap learn log.csv -o model.toml\n  pingmap learn monday.csv tuesday.csv --site-prior 40 -o site.toml"
)]
pub struct Options {
    #[command(flatten)]
    pub logs: Logs,
    /// File for the model
    #[arg(help_heading = RESULT, long, short, value_name = "FILE", default_value = "model.toml")]
    pub output: PathBuf,
    #[command(flatten)]
    pub overwrite: Overwrite,
    /// Also score predictions of this share of every vehicle's events, which is held out
    #[arg(long, value_parser = open_share, allow_negative_numbers = true)]
    pub test_share: Option<f64>,
    /// Also write a site prior at this number of inducing points
    ///
    /// The posterior of this log becomes the prior of later missions in the area. 64 points are enough for a few
    /// hundred events.
    #[arg(long, value_name = "POINTS", value_parser = site_points)]
    pub site_prior: Option<usize>,
    /// With --site-prior: learn no model. Read this model file and add the log to its site prior
    #[arg(long, value_name = "FILE", requires = "site_prior", conflicts_with_all = ["test_share", "ModelOptions"])]
    pub update: Option<PathBuf>,
    #[command(flatten)]
    pub reference: ReferenceOptions,
    #[command(flatten)]
    pub model: ModelOptions,
    #[command(flatten)]
    pub work: Work,
    /// Print one JSON object instead of tables
    #[arg(help_heading = RESULT, long)]
    pub json: bool,
}

impl Options {
    pub fn threads(&self) -> usize {
        self.work.threads
    }

    pub fn run(&self, results: Results) -> anyhow::Result<()> {
        run(self, results)
    }
}

fn run(options: &Options, results: Results) -> anyhow::Result<()> {
    let target = options.overwrite.target(&options.output, &options.logs.paths())?.with_json(options.json)?;
    let mut log = options.logs.open()?;
    options.reference.apply(&mut log)?;
    let log_digest = log.digest();
    let (log, _) = thinned(log, Vec::new(), options.work.events_max, options.work.seed);
    let limits = options.work.limits();
    if let Some((base, points)) = options.update.as_deref().zip(options.site_prior) {
        return add_to_site_prior(options, &target, (&log, log_digest), (base, points), results);
    }
    let learning = options.model.learning(limits);
    let (training, held_out) = divided(&log, options)?;

    let bar = spinner("learning");
    let added = learn(&learning, log.chart(), log.inputs(), &training)?;
    bar.finish_and_clear();
    let mut candidates = Vec::new();
    for (attempt, seconds) in added.tried {
        if !attempt.is_screened_out {
            warn_of_search(&attempt.model);
        }
        let held_out_nll = held_out_nll(&attempt.model.model, &training, &held_out, limits)?;
        candidates.push(Candidate { attempt, seconds, held_out_nll });
    }
    let merit = |candidate: &Candidate| candidate.attempt.leave_one_out;
    candidates.sort_by(|a, b| merit(b).total_cmp(&merit(a)));

    // The final model is learned from all events, including the held-out ones.
    let best = if held_out.is_empty() { added.best } else { learn_again(&learning, &added.best, &log)? };
    let from = options.logs.file_names();
    let model = options.site_prior.map(|points| with_site_prior(&best.model, &log, points, limits)).transpose()?;
    let model = model.unwrap_or_else(|| best.model.clone());
    let digests = InputDigests { log_digest: log_digest.clone(), model_digest: Some(model.digest()) };
    let site_log_digests = options.site_prior.map(|_| log_digest.clone()).into_iter().collect();
    let file = ModelFile { model, learned: Some(provenance(&best, from, log_digest)), site_log_digests };
    let file = file.write().map_err(|error| BadInput(error.to_string()))?;
    let written = target.write(file.as_bytes(), results);

    if options.json {
        print_json(
            results,
            &LearnJson {
                schema: 3,
                digests,
                file: &options.output,
                events: log.events.len(),
                training_events: training.len(),
                held_out_events: held_out.len(),
                seed: options.work.seed,
                candidates: candidates.iter().map(|candidate| candidate.json(&best)).collect(),
                rule: RULE,
                model: ModelJson::of(&best),
            },
        )?;
    } else {
        target.print_message(&text(&candidates, &best, !held_out.is_empty()), results)?;
    }
    if written.is_ok() {
        note(format_args!("wrote {}", options.output.display()));
    }
    written
}

/// Returns the model with a site prior that contains the log.
fn with_site_prior(model: &Model, log: &EventLog, points: usize, limits: Limits) -> anyhow::Result<Model> {
    let bar = spinner("fitting the site prior");
    let mut agent = all_in_one(model, log.events.iter().cloned(), limits)?;
    let known = model.site.iter().flat_map(|site| site.links()).copied();
    // Choosing points takes a matrix with as many rows as there are candidate links.
    let spread = spread_out(log.events.len(), limits.candidates_max).into_iter().map(|n| log.events[n].link);
    let links: Vec<Link> = known.chain(spread).collect();
    let model = model.with_site_prior(agent.posterior(Which::Fused)?, &links, points)?;
    bar.finish_and_clear();
    Ok(model)
}

/// Adds the log to the site prior of an existing model file.
fn add_to_site_prior(
    options: &Options,
    target: &Target,
    (log, log_digest): (&EventLog, String),
    (base, points): (&Path, usize),
    results: Results,
) -> anyhow::Result<()> {
    let mut file = open_model(base, log)?;
    if file.site_log_digests.contains(&log_digest) {
        warn(format_args!("{}: already contains this log, which counts twice now", base.display()));
    }
    file.model = with_site_prior(&file.model, log, points, options.work.limits())?;
    let digests = InputDigests { log_digest: log_digest.clone(), model_digest: Some(file.model.digest()) };
    file.site_log_digests.push(log_digest);
    let text = file.write().map_err(|error| BadInput(error.to_string()))?;
    let written = match options.json {
        true => target.write(text.as_bytes(), results),
        false => target.write_or_print(&text, results),
    };
    let site_points = file.model.site.as_ref().map_or(0, |site| site.links().len());
    if options.json {
        let added = AddedJson { schema: 1, digests, file: &options.output, events: log.events.len(), site_points };
        print_json(results, &added)?;
    }
    if written.is_ok() {
        note(format_args!("wrote {}: a site prior at {site_points} points", options.output.display()));
    }
    written
}

/// Learns the chosen structure from all events.
fn learn_again(learning: &Learning, chosen: &LearnedModel, log: &EventLog) -> anyhow::Result<LearnedModel> {
    let bar = spinner("learning from all events");
    let learning = Learning { structure: chosen.structure, additions: Vec::new(), ..learning.clone() };
    let fit = learn(&learning, log.chart(), log.inputs(), &log.events.iter().collect::<Vec<_>>())?.best;
    bar.finish_and_clear();
    Ok(fit)
}

/// A learned structure with its duration and score.
struct Candidate {
    attempt: Attempt,
    seconds: f64,
    held_out_nll: Option<f64>,
}

impl Candidate {
    /// Returns true if the model has the structure of this candidate.
    fn is_chosen(&self, model: &LearnedModel) -> bool {
        self.attempt.model.structure == model.structure
    }

    fn row(&self, model: &LearnedModel) -> Vec<String> {
        let [kernel, inputs, direction, terms, mean] = self.attempt.model.structure.parts();
        let first_word = |text: &str| text.split(' ').next().unwrap_or_default().to_owned();
        let kernel = if self.is_chosen(model) { format!("{kernel} *") } else { kernel };
        let mut row = vec![kernel, first_word(&inputs), direction, terms, first_word(&mean)];
        let about = if self.attempt.is_screened_out { "~" } else { "" };
        row.extend(
            [self.attempt.evidence_per_event, self.attempt.leave_one_out].map(|value| format!("{about}{value:.4}")),
        );
        row.extend(self.held_out_nll.map(|nll| format!("{nll:.4}")));
        row
    }

    fn json(&self, model: &LearnedModel) -> CandidateJson {
        let fit = &self.attempt.model;
        CandidateJson {
            chosen: self.is_chosen(model),
            model: ModelJson::of(fit),
            evidence_per_event: self.attempt.evidence_per_event,
            comparable_leave_one_out: self.attempt.leave_one_out,
            screened: self.attempt.is_screened_out,
            seconds: self.seconds,
            held_out_nll: self.held_out_nll,
            evaluations: fit.learned.evaluations,
            stop: stop_words(&fit.learned.stop),
            variance_factor: fit.learned.calibration.factor(),
        }
    }
}

/// Returns training and held-out events. All events are training events unless a share is held out.
fn divided<'a>(log: &'a EventLog, options: &Options) -> anyhow::Result<(Vec<&'a Event>, Vec<&'a Event>)> {
    let splits =
        options.test_share.map(|share| Division::random(1, share).splits(log, options.work.seed)).transpose()?;
    let Some(split) = splits.iter().flatten().next() else { return Ok((log.events.iter().collect(), Vec::new())) };
    let side = |held_out| split.indices(held_out).into_iter().map(|n| &log.events[n]).collect();
    Ok((side(false), side(true)))
}

fn held_out_nll(
    model: &Model,
    training: &[&Event],
    held_out: &[&Event],
    limits: Limits,
) -> anyhow::Result<Option<f64>> {
    if held_out.is_empty() {
        return Ok(None);
    }
    let mut agent = all_in_one(model, training.iter().map(|event| (*event).clone()), limits)?;
    let attempts = held_out.iter().map(|event| event.query());
    let predictions = agent.predict(attempts, Which::Fused)?;
    let probabilities: Vec<f64> = predictions.iter().map(|prediction| prediction.probability).collect();
    let outcomes: Vec<bool> = held_out.iter().map(|event| event.success).collect();
    Ok(Score::new(&probabilities, &outcomes).map(|score| score.nll))
}

/// Rule by which a row of the table is chosen: `Learning::try_term` in words.
const RULE: &str = "\
The program tries each term in turn. The threshold is 0.001 nats an event, or one standard error of the gain in LOO if \
that is larger. Range and receiver's place are kept if LOO rises by more than the threshold. Other terms must also \
raise the corrected evidence an event by more than twice the threshold. The time term is kept if the corrected \
evidence over all events rises by more than 1 nat; LOO does not count. The corrected evidence is not in the table. In \
logs of 300 events or more, the program tries each of these other terms on half of the events first, and on at most \
500. It rejects a term if gains one standard error higher would miss the thresholds there, or if the evidence for a \
time term does not rise. ~ marks its row: the change on these events is added to E and LOO of the model before, and \
NLL is that of the model learned from these events.";

fn text(candidates: &[Candidate], best: &LearnedModel, held_out: bool) -> String {
    let mut header = vec!["kernel", "inputs", "direction", "terms", "mean", "E", "LOO"];
    if held_out {
        header.push("NLL");
    }
    let terms = best.model.prior.kernel().terms().iter().map(|term| term_in_words(term, best.model.inputs));
    let mean = match best.model.prior.mean() {
        PriorMean::Constant(log_odds) => format!("  prior mean {log_odds:.2}"),
        PriorMean::Range(range) => {
            let even = range.even_odds_distance();
            let even = even.map_or_else(String::new, |distance| format!(": even odds at {distance:.0} m"));
            format!("  prior mean {:.2} - {:.2} per km{even}", range.intercept(), range.slope() * 1000.0)
        }
        _ => "  zero prior mean".to_owned(),
    };
    let Fading { correlation, memory_s, .. } = best.model.fading;
    let fading = format!(
        "  outcomes of stationary vehicles correlated by {correlation:.2}, for {memory_s:.0} s: {} events count as {:.0}",
        best.events_used,
        counted(best),
    );
    format!(
        "{}\n\nRule: {RULE}\n\nChosen row (*), learned from {}: {}\n{}\n{mean}\n{fading}\nE: evidence bound. LOO: leave-one-out log predictive. Both \
         are in nats an event; higher is better. NLL: negative log-likelihood \
         of a held-out event in nats; lower is better.",
        table(&header, &candidates.iter().map(|candidate| candidate.row(best)).collect::<Vec<_>>()),
        of_events(best.events_used, best.events, "event"),
        best.structure,
        terms.collect::<Vec<_>>().join("\n"),
    )
}

/// Formats a term's shape, variance and length-scales. Terms over labels have no length-scales.
fn term_in_words(term: &Term, inputs: InputSpec) -> String {
    let names = inputs.column_names();
    let first = &term.correlations()[0];
    if first.shape().is_of_labels() {
        let columns: Vec<&str> = first.columns().iter().map(|&column| names[column].as_str()).collect();
        return format!("  offset of every {}, variance {:.2}", columns.join(", "), term.variance());
    }
    let scale = |(&column, length_scale): (&usize, &f64)| match (&names[column], inputs.length_unit(&[column])) {
        (name, LengthUnit::Metres) => format!("{name} {length_scale:.0} m"),
        (name, LengthUnit::Seconds) => format!("{name} {length_scale:.0} s"),
        (name, LengthUnit::Chords) => format!("{name} {length_scale:.2}"),
    };
    let scales: Vec<String> = first.columns().iter().zip(first.length_scales()).map(scale).collect();
    format!("  {} variance {:.2}, length-scales {}", first.shape().title(), term.variance(), scales.join(", "))
}

fn provenance(fit: &LearnedModel, from: String, log_digest: String) -> Provenance {
    Provenance {
        from,
        log_digest: Some(log_digest),
        structure: fit.structure.to_string(),
        events: fit.events,
        events_used: fit.events_used,
        evidence: fit.evidence(),
        leave_one_out: fit.leave_one_out(),
        variance_factor: fit.learned.calibration.factor(),
        stop: stop_words(&fit.learned.stop),
    }
}
