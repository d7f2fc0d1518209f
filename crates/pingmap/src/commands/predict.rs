//! `pingmap predict`: probability of success over links.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use clap::Args;
use pingmap_agent::{Attempt, Link, Position, Prediction};
use pingmap_trial::read_attempts;
use serde::Serialize;

use crate::log::fill_depths;
use crate::model::KernelJson;
use crate::options::{Asked, Source};
use crate::output::{Results, csv_text, spinner};
use crate::outputs::{Kind, STANDARD_OUTPUT, Target};
use crate::survey::Survey;

/// Predict the probability of success over links
#[derive(Args)]
pub struct Options {
    #[command(flatten)]
    pub source: Source,
    /// CSV of links: tx_easting_m, tx_northing_m, rx_easting_m, rx_northing_m; who and when in tx_id, rx_id and time_s
    /// where it has these
    #[arg(long)]
    pub links: PathBuf,
    #[command(flatten)]
    pub asked: Asked,
    /// File for the result; standard output if not given
    #[arg(long, short, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Write one JSON object instead of CSV
    #[arg(long)]
    pub json: bool,
}

impl Options {
    pub fn threads(&self) -> usize {
        self.source.work.threads
    }

    pub fn run(&self, results: Results) -> anyhow::Result<()> {
        let logs = &self.source.logs;
        let kind = if self.json { Kind::PREDICTIONS_JSON } else { Kind::PREDICTIONS };
        let inputs: Vec<&Path> = logs.paths().into_iter().chain([self.links.as_path()]).collect();
        let output = self.output.as_deref().unwrap_or(Path::new(STANDARD_OUTPUT));
        let target = Target::new(output, kind, &inputs, logs.force)?;
        let predictions = Predictions::compute(self)?;
        let text = match self.json {
            true => serde_json::to_string_pretty(&serde_json::to_value(predictions.json())?)?,
            false => csv_text(&predictions.header, &predictions.rows)?,
        };
        target.write((text.trim_end().to_owned() + "\n").as_bytes(), results)
    }
}

/// Links and what is predicted of them, as a table.
struct Predictions {
    survey: Survey,
    header: Vec<&'static str>,
    jitter: f64,
    rows: Vec<Vec<f64>>,
}

/// The same for programs.
#[derive(Serialize)]
struct PredictionsJson<'a> {
    schema: u32,
    events_used: usize,
    jitter: f64,
    kernel: KernelJson,
    predictions: Vec<BTreeMap<&'a str, f64>>,
}

impl Predictions {
    fn compute(options: &Options) -> anyhow::Result<Self> {
        // What is asked comes first: learning takes a while, and a slip of the pen should not wait for it.
        let log = Survey::open(&options.source)?;
        let nowhere = Position::new(0.0, 0.0);
        let asked = options.asked.attempt(&log)?(Link { transmitter: nowhere, receiver: nowhere });
        let mut attempts = read_attempts(&options.links, &asked)?;
        let mut survey = Survey::learn(log, &options.source)?.rising(&options.asked);
        fill_depths(attempts.iter_mut().map(|attempt| &mut attempt.link), &survey.log);
        let bar = spinner("predicting");
        let predicted = survey.agent.predictions(&attempts)?;
        let wide = survey.agent.wide_posterior()?;
        let intervals = survey.agent.intervals(&wide, &attempts)?;
        bar.finish_and_clear();
        let depths = survey.model().inputs.has_depths();
        let row = |((attempt, predicted), (low, high)): ((&Attempt, &Prediction), (f64, f64))| {
            let Prediction { mean, variance, probability } = *predicted;
            [columns(&attempt.link, depths), vec![mean, variance, probability, low, high]].concat()
        };
        let rows = attempts.iter().zip(&predicted).zip(intervals).map(row).collect();
        let mut header = vec!["tx_easting_m", "tx_northing_m", "rx_easting_m", "rx_northing_m"];
        if depths {
            header.extend(["tx_depth_m", "rx_depth_m"]);
        }
        header.extend(["mean", "variance", "probability", "probability_low", "probability_high"]);
        let jitter = survey.agent.posterior()?.jitter();
        Ok(Self { survey, header, jitter, rows })
    }

    fn json(&self) -> PredictionsJson<'_> {
        let row = |row: &Vec<f64>| self.header.iter().copied().zip(row.iter().copied()).collect();
        PredictionsJson {
            schema: 1,
            events_used: self.survey.log.events.len(),
            jitter: self.jitter,
            kernel: KernelJson::of(self.survey.model()),
            predictions: self.rows.iter().map(row).collect(),
        }
    }
}

fn columns(link: &Link, depths: bool) -> Vec<f64> {
    let Link { transmitter: t, receiver: r } = link;
    let mut columns = vec![t.east_m, t.north_m, r.east_m, r.north_m];
    if depths {
        columns.extend([t.depth_m.unwrap_or(0.0), r.depth_m.unwrap_or(0.0)]);
    }
    columns
}
