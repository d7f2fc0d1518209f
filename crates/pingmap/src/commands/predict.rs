//! `pingmap predict`: probability of success over links.

use std::path::{Path, PathBuf};

use clap::Args;
use pingmap_agent::{Link, LinkQuery, Position, PredictOptions, Prediction, Which};
use pingmap_import::{Place, Reference};
use pingmap_trial::{AttemptTable, read_attempts};
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::{Map, Value, json};

use crate::log::{fill_depths, opened};
use crate::model::{KernelJson, MadeOf};
use crate::options::{Asked, RESULT, Source};
use crate::output::{Results, csv_of_text, json_text, spinner, warn};
use crate::outputs::{Kind, STANDARD_OUTPUT, Target};
use crate::reference::reference;
use crate::survey::Survey;

/// Predict the probability of success over links
#[derive(Args)]
#[command(after_help = "Example:\n  pingmap predict log.csv --links links.csv --model model.toml -o predicted.csv")]
pub struct Options {
    /// CSV of links: tx_easting_m, tx_northing_m, rx_easting_m, rx_northing_m, or tx_latitude_deg and so on; who and when in tx_id,
    /// rx_id and time_s where it has these; - is standard input. Its columns stand before what is predicted
    #[arg(long)]
    pub links: PathBuf,
    #[command(flatten)]
    pub asked: Asked,
    #[command(flatten)]
    pub source: Source,
    /// File for the result; standard output if not given
    #[arg(help_heading = RESULT, long, short, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Write one JSON object instead of CSV
    #[arg(help_heading = RESULT, long)]
    pub json: bool,
}

impl Options {
    pub fn threads(&self) -> usize {
        self.source.work.threads
    }

    pub fn run(&self, results: Results) -> anyhow::Result<()> {
        let logs = &self.source.logs;
        let kind = if self.json { Kind::PREDICTIONS_JSON } else { Kind::PREDICTIONS };
        let inputs: Vec<&Path> = self.source.inputs().into_iter().chain([self.links.as_path()]).collect();
        let output = self.output.as_deref().unwrap_or(Path::new(STANDARD_OUTPUT));
        let target = Target::new(output, kind, &inputs, logs.overwrite)?;
        let predictions = Predictions::compute(self)?;
        let text = match self.json {
            true => json_text(results, &predictions.json())?,
            false => predictions.csv()?,
        };
        target.write_or_print(&(text.trim_end().to_owned() + "\n"), results)
    }
}

/// What is predicted of a link: the probability, between which ends nine in ten lie, and what both were made from.
const COLUMNS: [&str; 5] = ["probability", "lower", "upper", "log_odds_mean", "log_odds_variance"];

/// Where both ends are: in metres of the log, and in degrees where these are known.
const PLACES: [&str; 8] = [
    "tx_easting_m",
    "tx_northing_m",
    "rx_easting_m",
    "rx_northing_m",
    "tx_latitude_deg",
    "tx_longitude_deg",
    "rx_latitude_deg",
    "rx_longitude_deg",
];

/// Links and what is predicted of them.
struct Predictions {
    survey: Survey,
    reference: Reference,
    table: AttemptTable,
    jitter: f64,
    /// In the order of [`COLUMNS`].
    predicted: Vec<[f64; 5]>,
}

/// The same for programs.
#[derive(Serialize, JsonSchema)]
pub struct PredictionsJson {
    /// Version of this object.
    schema: u32,
    #[serde(flatten)]
    made_of: MadeOf,
    /// What metres mean; `unknown` where nobody said so.
    reference_system: String,
    /// How many events the answer rests on.
    events_used: usize,
    /// What was added to the kernel matrix's diagonal to factorise it; 0 in the ordinary case.
    jitter: f64,
    /// The kernel that all was computed with.
    kernel: KernelJson,
    /// A row for each link that was asked about: its own columns, then `probability`, `lower`, `upper`, `log_odds_mean` and `log_odds_variance`.
    predictions: Vec<Map<String, Value>>,
}

impl Predictions {
    fn compute(options: &Options) -> anyhow::Result<Self> {
        // What is asked comes first: learning takes a while, and a slip of the pen should not wait for it.
        let log = Survey::open(&options.source)?;
        let reference = reference(log.reference)?;
        let nowhere = Position::new(0.0, 0.0);
        let asked = options.asked.attempt(&log)?(Link { transmitter: nowhere, receiver: nowhere });
        let mut table =
            read_attempts(opened(&options.links)?, &asked, &|place| reference.metres(Place::Degrees(place)))?;
        let replaced: Vec<&str> = table.header.iter().map(String::as_str).filter(is_predicted).collect();
        if !replaced.is_empty() {
            let (path, columns) = (options.links.display(), replaced.join(", "));
            warn(format_args!("{path}: what stood in {columns} is replaced by what is predicted now"));
        }
        let mut survey = Survey::learn(log, &options.source)?.capped(&options.asked);
        fill_depths(table.attempts.iter_mut().map(|attempt| &mut attempt.link), &survey.log);
        let bar = spinner("predicting");
        let predicted = survey.agent.predict(&table.attempts, PredictOptions::with_intervals())?;
        bar.finish_and_clear();
        let row = |Prediction { mean, variance, probability, interval, .. }| {
            let (lower, upper) = interval.unwrap_or((probability, probability));
            [probability, lower, upper, mean, variance]
        };
        let predicted = predicted.into_iter().map(row).collect();
        let jitter = survey.agent.posterior(Which::Fused)?.jitter();
        Ok(Self { survey, reference, table, jitter, predicted })
    }

    /// In the order of [`PLACES`], as far as they are known.
    fn places(&self, link: &Link) -> [Option<f64>; 8] {
        let [tx, rx] = link.ends();
        let in_degrees = |end: &Position| {
            let place = self.reference.geographic(end.east_m, end.north_m);
            [place.map(|place| place.latitude_deg), place.map(|place| place.longitude_deg)]
        };
        let ([tx_latitude, tx_longitude], [rx_latitude, rx_longitude]) = (in_degrees(&tx), in_degrees(&rx));
        let [tx_east, tx_north, rx_east, rx_north] = [tx.east_m, tx.north_m, rx.east_m, rx.north_m].map(Some);
        [tx_east, tx_north, rx_east, rx_north, tx_latitude, tx_longitude, rx_latitude, rx_longitude]
    }

    /// The columns of the input, places in the other form where both are known, and behind them what is predicted.
    fn csv(&self) -> anyhow::Result<String> {
        let is_there = |name: &str| self.table.header.iter().any(|column| column.eq_ignore_ascii_case(name));
        let is_known = |n: usize| n < 4 || self.reference.system().is_known();
        let added: Vec<usize> = (0..PLACES.len()).filter(|&n| is_known(n) && !is_there(PLACES[n])).collect();
        let kept: Vec<usize> =
            (0..self.table.header.len()).filter(|&n| !is_predicted(&self.table.header[n].as_str())).collect();
        let of = |fields: &[String]| kept.iter().map(|&n| fields[n].clone()).collect::<Vec<_>>();
        let places = added.iter().map(|&n| PLACES[n].to_owned()).collect();
        let header = [of(&self.table.header), places, COLUMNS.map(str::to_owned).to_vec()].concat();
        let rows = self.table.rows.iter().zip(&self.table.attempts).zip(&self.predicted);
        let rows = rows.map(|((fields, attempt), numbers)| {
            let places = self.places(&attempt.link);
            // A place on no map of the Earth has no degrees.
            let places =
                added.iter().map(|&n| places[n].map_or_else(String::new, |number| number.to_string())).collect();
            [of(fields), places, numbers.map(|number| number.to_string()).to_vec()].concat()
        });
        csv_of_text(&header, rows)
    }

    fn json(&self) -> PredictionsJson {
        let of = |((attempt, fields), numbers): ((&LinkQuery, &Vec<String>), &[f64; 5])| {
            let [_, lower, upper, mean, variance] = *numbers;
            let own = self.table.header.iter().zip(fields).filter(|(name, _)| !is_predicted(&name.as_str()));
            let mut object: Map<String, Value> = own.map(|(name, field)| (name.clone(), said(name, field))).collect();
            let places = PLACES.iter().zip(self.places(&attempt.link));
            object.extend(places.filter_map(|(name, number)| Some(((*name).to_owned(), json!(number?)))));
            object.extend(depths(&attempt.link));
            object.extend(COLUMNS.iter().zip(numbers).map(|(name, number)| ((*name).to_owned(), json!(number))));
            // As these were called before.
            let before =
                [("mean", mean), ("variance", variance), ("probability_low", lower), ("probability_high", upper)];
            for (name, number) in before {
                object.entry(name).or_insert_with(|| json!(number));
            }
            object
        };
        PredictionsJson {
            schema: 1,
            made_of: self.survey.made_of(),
            reference_system: self.survey.log.reference.to_string(),
            events_used: self.survey.log.events.len(),
            jitter: self.jitter,
            kernel: KernelJson::of(self.survey.model()),
            predictions: self.table.attempts.iter().zip(&self.table.rows).zip(&self.predicted).map(of).collect(),
        }
    }
}

/// Whether a column of the input is called as one that is predicted.
fn is_predicted(name: &&str) -> bool {
    COLUMNS.iter().any(|column| column.eq_ignore_ascii_case(name))
}

/// A field of the input: numbers as such, but for names; codes such as 007 are no numbers.
fn said(column: &str, field: &str) -> Value {
    let is_name = ["tx_id", "rx_id", "kind"].iter().any(|name| name.eq_ignore_ascii_case(column));
    let begins_as_code = |rest: &str| rest.starts_with(|letter: char| letter.is_ascii_digit());
    let is_code = field.trim_start_matches('-').strip_prefix('0').is_some_and(begins_as_code);
    match field.parse::<f64>() {
        Ok(number) if number.is_finite() && !is_name && !is_code => json!(number),
        _ => json!(field),
    }
}

/// How deep both ends of a link are, where depths count.
fn depths(link: &Link) -> impl Iterator<Item = (String, Value)> {
    let depths = [("tx_depth_m", link.transmitter.depth_m), ("rx_depth_m", link.receiver.depth_m)];
    depths.into_iter().filter_map(|(name, depth_m)| Some((name.to_owned(), json!(depth_m?))))
}
