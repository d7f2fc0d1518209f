//! Measures the benefit of each feature of sharing: the mean NLL of the team for several numbers of frames, and the
//! paired difference that the feature makes. A positive difference means that the feature lowers the NLL.
//!
//! With `events.csv:splits.csv` the errors are those between overlapping splits of one log. Logs without splits count
//! as one mission each, divided twice by whole transmissions, and the errors are those between missions. One model is
//! learned for each split, and all variants use it.
//!
//! `cargo run --release -p pingmap-trial --example sharing_features -- [loss=SHARE] [model=model.toml]
//! events.csv:splits.csv | events.csv…`

#![allow(clippy::print_stdout, reason = "what it measures is its output")]

mod common;

use std::path::Path;

use common::{Failure, sharing_without};
use pingmap_agent::{Learning, Model, ModelFile};
use pingmap_trial::{Agreed, DivideBy, Division, Estimate, EventLog, Mission, Plan, Score, Split, Water, read_splits};

const FRAMES: [usize; 5] = [1, 2, 4, 7, 10];

/// A variant, and the one that it is compared with: both as features that are turned off.
const VARIANTS: [(&str, &str); 5] = [
    ("", ""),
    ("report_candidates", ""),
    ("acknowledgements", ""),
    ("reports", ""),
    ("reports,summary_candidates", "reports"),
];

/// NLL by variant and number of frames.
type Nlls = Vec<[f64; FRAMES.len()]>;

fn main() -> Result<(), Failure> {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let mut option = |name: &str| {
        let place = arguments.iter().position(|argument| argument.starts_with(name))?;
        Some(arguments.remove(place)[name.len()..].to_owned())
    };
    let loss = option("loss=").map_or(Ok(0.0), |loss| loss.parse())?;
    let model = option("model=").map(std::fs::read_to_string).transpose()?;
    let model = model.map(|text| ModelFile::parse(&text)).transpose()?.map(|file| file.model);
    let mut missions = Vec::new();
    for argument in &arguments {
        match argument.split_once(':') {
            Some((events, splits)) => {
                let log = EventLog::open(Path::new(events))?;
                let splits = read_splits(Path::new(splits), &log)?;
                let nlls = measure(&log, &splits, model.as_ref(), loss)?;
                println!("{events}");
                let held_out = splits[0].indices(true).len() as f64;
                print(&nlls, held_out / (log.events.len() as f64 - held_out));
            }
            None => missions.push(mission(&EventLog::open(Path::new(argument))?, model.as_ref(), loss)?),
        }
    }
    if !missions.is_empty() {
        println!("{} missions", missions.len());
        print(&missions, 0.0);
    }
    Ok(())
}

/// The mean over two splits of whole transmissions.
fn mission(log: &EventLog, model: Option<&Model>, loss: f64) -> Result<Nlls, Failure> {
    let division = Division { by: DivideBy::Random, repeats: 2, test_share: 0.35, whole_transmissions: true };
    let splits = measure(log, &division.splits(log, 1)?, model, loss)?;
    let mean = |variant: usize, frames: usize| {
        splits.iter().map(|split| split[variant][frames]).sum::<f64>() / splits.len() as f64
    };
    Ok((0..VARIANTS.len()).map(|variant| std::array::from_fn(|frames| mean(variant, frames))).collect())
}

/// The NLL of the team on every split.
fn measure(log: &EventLog, splits: &[Split], model: Option<&Model>, loss: f64) -> Result<Vec<Nlls>, Failure> {
    let mut nlls = Vec::new();
    for split in splits {
        let mut plan = Plan::new(Learning::default(), 1);
        plan.water = Water { loss, ..Water::default() };
        let training: Vec<_> = split.indices(false).into_iter().map(|n| &log.events[n]).collect();
        plan.agreed = Agreed::Model(match model {
            Some(model) => model.clone(),
            None => plan.team(log, Some(&training))?.0.model,
        });
        let mut of_split = Vec::new();
        for (features, _) in VARIANTS {
            plan.sharing = sharing_without(features)?;
            of_split.push(team_nlls(log, split, &plan)?);
        }
        nlls.push(of_split);
    }
    Ok(nlls)
}

fn team_nlls(log: &EventLog, split: &Split, plan: &Plan) -> Result<[f64; FRAMES.len()], Failure> {
    let mission = Mission::prepare(log, split, plan, FRAMES[FRAMES.len() - 1])?;
    let mut nlls = [f64::NAN; FRAMES.len()];
    for (nll, frames) in nlls.iter_mut().zip(FRAMES) {
        let scores: Vec<Score> = mission
            .predict_as_team(frames)?
            .iter()
            .filter_map(|probabilities| Score::new(probabilities, &mission.outcomes))
            .collect();
        *nll = Score::mean(&scores).map_or(f64::NAN, |score| score.nll);
    }
    Ok(nlls)
}

fn print(cases: &[Nlls], test_share: f64) {
    println!("{:34} {}", "frames", FRAMES.map(|frames| format!("{frames:>17}")).join(" "));
    for (variant, (features, base)) in VARIANTS.iter().enumerate() {
        let base = VARIANTS.iter().position(|(other, _)| other == base).unwrap_or_default();
        let cell = |of: &dyn Fn(&Nlls) -> f64| {
            let values: Vec<f64> = cases.iter().map(of).collect();
            Estimate::overlapping(&values, test_share).map_or_else(String::new, |Estimate { mean, se, .. }| {
                format!("{mean:+.4} ±{:.4}", se.unwrap_or(f64::NAN))
            })
        };
        let row: Vec<String> = (0..FRAMES.len())
            .map(|frames| match variant == base {
                true => cell(&|nlls| nlls[variant][frames]),
                false => cell(&|nlls| nlls[variant][frames] - nlls[base][frames]),
            })
            .collect();
        let name = if features.is_empty() { "all features, NLL".to_owned() } else { format!("without {features}") };
        println!("{name:34} {}", row.iter().map(|cell| format!("{cell:>17}")).collect::<Vec<_>>().join(" "));
    }
}
