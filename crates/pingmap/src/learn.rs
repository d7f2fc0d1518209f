//! `pingmap learn`: kernel, prior mean and chart by the data.

use dgpc::PriorMean;
use dgpc::Stop;
use pingmap_agent::{Criterion, Event, LearnedModel, Model, ModelFile, Provenance};
use pingmap_trial::{EventLog, Score, draw_splits, learn_all, learn_best};
use serde_json::{Value, json};

use crate::cli::{self, name_of};
use crate::output::{note, print, print_json, progress, spinner, table, use_threads, write_file};
use crate::survey::{all_in_one, of_events, open_log, thinned, warn_of_search};

pub fn run(options: &cli::Learn) -> anyhow::Result<()> {
    use_threads(options.work.threads)?;
    let log = open_log(&options.events)?;
    let (log, _) = thinned(log, Vec::new(), options.work.events_max, options.work.seed);
    let limits = options.work.limits();
    let learning = options.kernel.learning(options.kernel.given().many(), limits);
    let (training, held_out) = divided(&log, options)?;

    let bar = progress(learning.structures.len() as u64, "learning");
    let fits = learn_all(&learning, log.chart(), log.inputs(), &training, &|| bar.inc(1))?;
    bar.finish_and_clear();
    let mut candidates = Vec::new();
    for (fit, seconds) in fits {
        warn_of_search(&fit);
        let held_out_nll = held_out_nll(&fit.model, &training, &held_out, limits)?;
        candidates.push(Candidate { fit, seconds, held_out_nll });
    }
    let merit = |candidate: &Candidate| candidate.fit.merit(learning.criterion);
    candidates.sort_by(|a, b| merit(b).total_cmp(&merit(a)));

    // What is kept knows all events, those that were held out too.
    let best = match candidates.first() {
        Some(best) if held_out.is_empty() => best.fit.clone(),
        Some(best) => {
            let bar = spinner("learning from all events");
            let structures = vec![best.fit.structure];
            let learning = pingmap_agent::Learning { structures, ..learning.clone() };
            let fit = learn_best(&learning, log.chart(), log.inputs(), &log.events.iter().collect::<Vec<_>>())?;
            bar.finish_and_clear();
            fit
        }
        None => anyhow::bail!("no structure to learn"),
    };
    let from = options.events.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    let file = ModelFile { model: best.model.clone(), learned: Some(provenance(&best, from)) };
    write_file(&options.output, file.to_toml().as_bytes())?;

    if options.json {
        print_json(&json!({
            "schema": 1, "file": options.output, "events": log.events.len(), "training_events": training.len(),
            "held_out_events": held_out.len(), "seed": options.work.seed, "criterion": name_of(&options.kernel.criterion),
            "candidates": candidates.iter().map(Candidate::json).collect::<Vec<_>>(), "model": model_json(&best),
        }))?;
    } else {
        print(&text(&candidates, &best, learning.criterion, !held_out.is_empty()))?;
    }
    note(format_args!("wrote {}", options.output.display()));
    Ok(())
}

/// One structure and how it did.
struct Candidate {
    fit: LearnedModel,
    seconds: f64,
    held_out_nll: Option<f64>,
}

impl Candidate {
    fn row(&self) -> Vec<String> {
        let per_event = self.fit.evidence() / self.fit.events_used.max(1) as f64;
        // A structure in words is its parts with commas between them.
        let mut row: Vec<String> = self.fit.structure.to_string().split(", ").map(str::to_owned).collect();
        row.extend([
            format!("{per_event:.4}"),
            format!("{:.4}", self.fit.leave_one_out()),
            format!("{:.1}", self.seconds),
        ]);
        row.extend(self.held_out_nll.map(|nll| format!("{nll:.4}")));
        row
    }

    fn json(&self) -> Value {
        json!({
            "structure": self.fit.structure.to_string(), "evidence": self.fit.evidence(),
            "leave_one_out": self.fit.leave_one_out(), "seconds": self.seconds, "held_out_nll": self.held_out_nll,
            "events_used": self.fit.events_used, "evaluations": self.fit.learned.evaluations,
            "stop": stop_words(&self.fit.learned.stop), "variance_factor": self.fit.learned.calibration.factor(),
            "kernel": kernel_json(&self.fit.model), "prior_mean": prior_mean_json(self.fit.model.prior.mean()),
        })
    }
}

/// Training and held-out events; all are training events unless a share is to be held out.
fn divided<'a>(log: &'a EventLog, options: &cli::Learn) -> anyhow::Result<(Vec<&'a Event>, Vec<&'a Event>)> {
    let splits = options.test_share.map(|share| draw_splits(log, 1, share, options.work.seed)).transpose()?;
    let Some(split) = splits.iter().flatten().next() else { return Ok((log.events.iter().collect(), Vec::new())) };
    let side = |held_out| split.indices(held_out).into_iter().map(|n| &log.events[n]).collect();
    Ok((side(false), side(true)))
}

fn held_out_nll(
    model: &Model,
    training: &[&Event],
    held_out: &[&Event],
    limits: pingmap_agent::Limits,
) -> anyhow::Result<Option<f64>> {
    if held_out.is_empty() {
        return Ok(None);
    }
    let mut agent = all_in_one(model, training.iter().map(|event| (*event).clone()), limits)?;
    let links: Vec<_> = held_out.iter().map(|event| event.link).collect();
    let outcomes: Vec<bool> = held_out.iter().map(|event| event.success).collect();
    Ok(Score::new(&agent.probabilities(&links)?, &outcomes).map(|score| score.nll))
}

fn text(candidates: &[Candidate], best: &LearnedModel, criterion: Criterion, held_out: bool) -> String {
    let mut header =
        vec!["kernel", "inputs", "direction", "terms", "prior mean", "E / event", "leave-one-out", "seconds"];
    if held_out {
        header.push("held-out NLL");
    }
    let by = match criterion {
        Criterion::LeaveOneOut => "leave-one-out log predictive",
        Criterion::Evidence => "evidence bound E",
    };
    let terms = best.model.prior.kernel().terms().iter().map(|term| {
        let names = best.model.inputs.column_names();
        let scale = |(column, length_scale): (&usize, &f64)| format!("{} {length_scale:.0} m", names[*column]);
        let first = &term.correlations()[0];
        let scales: Vec<String> = first.columns().iter().zip(first.length_scales()).map(scale).collect();
        format!("  {} variance {:.2}, length-scales {}", first.shape().title(), term.variance(), scales.join(", "))
    });
    let mean = match best.model.prior.mean() {
        PriorMean::Constant(log_odds) => format!("  prior mean {log_odds:.2}"),
        PriorMean::Range(range) => {
            let (intercept, slope) = (range.intercept(), range.slope());
            format!(
                "  prior mean {intercept:.2} - {:.2} per km: even odds at {:.0} m",
                slope * 1000.0,
                intercept / slope
            )
        }
        _ => "  zero prior mean".to_owned(),
    };
    format!(
        "{}\n\nBest by {by}, learned from {}: {}\n{}\n{mean}\nE and leave-one-out in nats an event, higher is better; NLL in nats, \
         lower is better.",
        table(&header, &candidates.iter().map(Candidate::row).collect::<Vec<_>>()),
        of_events(best.events_used, best.events),
        best.structure,
        terms.collect::<Vec<_>>().join("\n"),
    )
}

fn provenance(fit: &LearnedModel, from: String) -> Provenance {
    Provenance {
        from,
        structure: fit.structure.to_string(),
        events: fit.events,
        events_used: fit.events_used,
        evidence: fit.evidence(),
        leave_one_out: fit.leave_one_out(),
        variance_factor: fit.learned.calibration.factor(),
        stop: stop_words(&fit.learned.stop),
    }
}

pub fn stop_words(stop: &Stop) -> String {
    match stop {
        Stop::Converged => "converged".to_owned(),
        Stop::IterationsMax => "iterations used up".to_owned(),
        Stop::NoProgress(why) => format!("no progress: {why}"),
        other => format!("{other:?}"),
    }
}

fn model_json(fit: &LearnedModel) -> Value {
    json!({
        "structure": fit.structure.to_string(), "evidence": fit.evidence(), "leave_one_out": fit.leave_one_out(),
        "events_used": fit.events_used, "kernel": kernel_json(&fit.model),
        "prior_mean": prior_mean_json(fit.model.prior.mean()),
    })
}

/// The kernel: the path term's shape, typical length-scale and variance, and all terms.
pub fn kernel_json(model: &Model) -> Value {
    let names = model.inputs.column_names();
    let terms = model.prior.kernel().terms().iter().map(|term| {
        json!({
            "shape": term.correlations()[0].shape().name(), "variance": term.variance(), "reciprocal": term.is_reciprocal(),
            "columns": term.correlations()[0].columns().iter().map(|&column| &names[column]).collect::<Vec<_>>(),
            "length_scales_m": term.correlations()[0].length_scales(),
        })
    });
    let path = model.prior.kernel().terms().first();
    json!({
        "shape": path.map(|term| term.correlations()[0].shape().name()), "reciprocal": path.map(dgpc::Term::is_reciprocal),
        "length_scale_m": model.length_scale_m(), "variance": path.map(dgpc::Term::variance),
        "terms": terms.collect::<Vec<_>>(),
    })
}

/// The prior mean and its numbers.
pub fn prior_mean_json(mean: &PriorMean) -> Value {
    match mean {
        PriorMean::Constant(log_odds) => json!({ "kind": "constant", "log_odds": log_odds }),
        PriorMean::Range(range) => {
            json!({ "kind": "range", "intercept": range.intercept(), "slope_per_m": range.slope() })
        }
        _ => json!({ "kind": "zero" }),
    }
}
