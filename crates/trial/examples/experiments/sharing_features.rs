//! Benefit of each feature of sharing.

use std::io::Write;
use std::path::PathBuf;
use std::slice::from_ref;

use clap::Args;
use pingmap_agent::{Learning, Model};
use pingmap_trial::{ChannelImpairments, DivideBy, Division, Estimate, EventLog, Plan, Preshared, Split, replay};

use crate::arguments::{TrialFiles, read_model, sharing_without};
use crate::statistics::mean;

const FRAMES: [usize; 5] = [1, 2, 4, 7, 10];

/// A variant, and the one that it is compared with: both as features that are turned off.
const VARIANTS: [(&str, &str); 5] = [
    ("", ""),
    ("report_candidates", ""),
    ("acknowledgements", ""),
    ("reports", ""),
    ("reports,summary_candidates", "reports"),
];

/// NLL of the team by variant and number of frames.
type Nlls = Vec<[f64; FRAMES.len()]>;

/// Measures the benefit of each feature of sharing.
///
/// The table has the mean NLL of the team for several numbers of frames, and the paired difference that each feature
/// makes. A positive difference means that the feature lowers the NLL.
///
/// With `events.csv:splits.csv` the errors are those between overlapping splits of one log. Logs without splits count
/// as one mission each, divided twice by whole transmissions, and the errors are those between missions. One model is
/// learned for each split, and all variants use it.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Share of packets that the channel loses
    #[arg(long, default_value_t = 0.0)]
    loss: f64,
    /// Model file; without it, a model is learned for each split
    #[arg(long)]
    model: Option<PathBuf>,
    /// Event logs, each with splits or as one mission
    #[arg(required = true, value_name = "EVENTS[:SPLITS]")]
    trials: Vec<TrialFiles>,
}

impl Arguments {
    pub(crate) fn run(&self, out: &mut dyn Write) -> anyhow::Result<()> {
        let model = self.model.as_deref().map(read_model).transpose()?;
        let mut missions = Vec::new();
        for trial in &self.trials {
            match trial {
                TrialFiles::Splits(files) => {
                    let (log, splits) = files.read()?;
                    let nlls = self.measure(&log, &splits, model.as_ref())?;
                    let held_out = splits[0].indices(true).len() as f64;
                    writeln!(out, "{}", files.events.display())?;
                    write_table(out, &nlls, held_out / (log.events.len() as f64 - held_out))?;
                }
                TrialFiles::Mission(events) => missions.push(self.mission(&EventLog::open(events)?, model.as_ref())?),
            }
        }
        if !missions.is_empty() {
            writeln!(out, "{} missions", missions.len())?;
            write_table(out, &missions, 0.0)?;
        }
        Ok(())
    }

    /// Returns the mean NLL over two splits of whole transmissions.
    fn mission(&self, log: &EventLog, model: Option<&Model>) -> anyhow::Result<Nlls> {
        let division = Division { by: DivideBy::Random, repeats: 2, test_share: 0.35, whole_transmissions: true };
        let splits = self.measure(log, &division.splits(log, 1)?, model)?;
        let mean = |variant: usize, frames: usize| mean(splits.iter().map(|split| split[variant][frames]));
        Ok((0..VARIANTS.len()).map(|variant| std::array::from_fn(|frames| mean(variant, frames))).collect())
    }

    /// Returns the NLL of the team on every split.
    fn measure(&self, log: &EventLog, splits: &[Split], model: Option<&Model>) -> anyhow::Result<Vec<Nlls>> {
        let mut nlls = Vec::new();
        for split in splits {
            let mut plan = Plan::new(Learning::default(), 1);
            plan.impairments = ChannelImpairments { loss: self.loss, ..ChannelImpairments::default() };
            let training: Vec<_> = split.indices(false).into_iter().map(|n| &log.events[n]).collect();
            plan.preshared = Preshared::Model(match model {
                Some(model) => model.clone(),
                None => plan.team(log, Some(&training))?.0.model,
            });
            let nll = |(features, _): (&str, &str)| {
                let plan = Plan { sharing: sharing_without(features).map_err(anyhow::Error::msg)?, ..plan.clone() };
                let replayed = replay(log, from_ref(split), &FRAMES, &plan, &|| ())?;
                Ok(std::array::from_fn(|frames| replayed.splits[0].nll.team[frames]))
            };
            nlls.push(VARIANTS.into_iter().map(nll).collect::<anyhow::Result<Nlls>>()?);
        }
        Ok(nlls)
    }
}

fn write_table(out: &mut dyn Write, cases: &[Nlls], test_share: f64) -> std::io::Result<()> {
    writeln!(out, "{:34} {}", "frames", FRAMES.map(|frames| format!("{frames:>17}")).join(" "))?;
    for (variant, (features, base)) in VARIANTS.iter().enumerate() {
        let base = VARIANTS.iter().position(|(other, _)| other == base).unwrap_or_default();
        let value = |nlls: &Nlls, frames: usize| match variant == base {
            true => nlls[variant][frames],
            false => nlls[variant][frames] - nlls[base][frames],
        };
        let cell = |frames: usize| {
            let values: Vec<f64> = cases.iter().map(|nlls| value(nlls, frames)).collect();
            format!("{:>17}", with_error(&values, test_share))
        };
        let name = if features.is_empty() { "all features, NLL".to_owned() } else { format!("without {features}") };
        writeln!(out, "{name:34} {}", (0..FRAMES.len()).map(cell).collect::<Vec<_>>().join(" "))?;
    }
    Ok(())
}

/// Formats a mean with its error over overlapping splits.
fn with_error(values: &[f64], test_share: f64) -> String {
    Estimate::overlapping(values, test_share)
        .map_or_else(String::new, |Estimate { mean, se, .. }| format!("{mean:+.4} ±{:.4}", se.unwrap_or(f64::NAN)))
}
