//! `pingmap predict`: predicts the probability of success over links.

use std::path::{Path, PathBuf};

use clap::Args;
use pingmap_agent::{Link, LinkQuery, Position, Prediction, Which};
use pingmap_import::{Place, Reference};
use pingmap_trial::{AttemptTable, read_attempts};
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::{Map, Value, json};

use crate::learned_map::LearnedMap;
use crate::log::{fill_depths, opened};
use crate::model::{InputDigests, KernelJson};
use crate::options::{QueryOptions, RESULT, Source};
use crate::output::{Results, csv_of_text, json_text, spinner, warn};
use crate::output_target::{Overwrite, STANDARD_OUTPUT};
use crate::reference::reference;

/// Predict the probability of success over links
#[derive(Args)]
#[command(after_help = "Example:\n  pingmap predict log.csv --links links.csv --model model.toml -o predicted.csv")]
pub struct Options {
    /// CSV of links; - is standard input
    ///
    /// Columns are tx_easting_m, tx_northing_m, rx_easting_m and rx_northing_m, or tx_latitude_deg and so on. Optional
    /// columns tx_id, rx_id and time_s select vehicles and time. All columns are copied to the output. The output adds
    /// probability, which follows from log_odds_mean and log_odds_variance, and lower and upper, the ends of its 90 %
    /// interval. The interval follows from other moments of the log-odds: those of expectation propagation, with a
    /// standard deviation that is 1.7 times as large. It always contains the probability. It is 0 to 1 for a link with
    /// an end that is far from all data. An end is far if the nearest position with data is farther away than the
    /// longest link with data.
    #[arg(long)]
    pub links: PathBuf,
    #[command(flatten)]
    pub query: QueryOptions,
    #[command(flatten)]
    pub source: Source,
    /// File for the result; standard output if not given
    #[arg(help_heading = RESULT, long, short, value_name = "FILE")]
    pub output: Option<PathBuf>,
    #[command(flatten)]
    pub overwrite: Overwrite,
    /// Write one JSON object instead of CSV
    #[arg(help_heading = RESULT, long)]
    pub json: bool,
}

impl Options {
    pub fn threads(&self) -> usize {
        self.source.work.threads
    }

    pub fn run(&self, results: Results) -> anyhow::Result<()> {
        let inputs: Vec<&Path> = self.source.inputs().into_iter().chain([self.links.as_path()]).collect();
        let output = self.output.as_deref().unwrap_or(Path::new(STANDARD_OUTPUT));
        let target = self.overwrite.target(output, &inputs)?;
        let predictions = Predictions::compute(self)?;
        let text = match self.json {
            true => json_text(results, &predictions.json())?,
            false => predictions.csv()?,
        };
        target.write_or_print(&(text.trim_end().to_owned() + "\n"), results)
    }
}

/// Largest number of links that are predicted in one call.
const LINKS_AT_ONCE: usize = 1024;

/// Columns of a prediction: probability, 90 % interval, and mean and variance of the log-odds.
const COLUMNS: [&str; 5] = ["probability", "lower", "upper", "log_odds_mean", "log_odds_variance"];

/// Columns of the positions of both ends: metres of the log, and degrees if the reference system is known.
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

/// Links and their predictions.
struct Predictions {
    learned_map: LearnedMap,
    reference: Reference,
    table: AttemptTable,
    jitter: f64,
    /// Values of [`COLUMNS`].
    predicted: Vec<[f64; 5]>,
}

/// Predictions in JSON.
#[derive(Serialize, JsonSchema)]
pub struct PredictionsJson {
    /// Version of this object.
    schema: u32,
    #[serde(flatten)]
    digests: InputDigests,
    /// Reference system of the metres; `unknown` if the log does not name it.
    reference_system: String,
    /// Number of events from which the map was learned.
    events_used: usize,
    /// Number added to the kernel matrix's diagonal to factorise the matrix; usually 0.
    jitter: f64,
    /// Kernel of the model.
    kernel: KernelJson,
    /// A row for each link: the columns of the input, then `probability`, `lower`, `upper`, `log_odds_mean` and
    /// `log_odds_variance`.
    predictions: Vec<Map<String, Value>>,
}

impl Predictions {
    fn compute(options: &Options) -> anyhow::Result<Self> {
        // Options are checked before learning, which takes longer.
        let log = LearnedMap::open(&options.source)?;
        let reference = reference(log.reference)?;
        let nowhere = Position::new(0.0, 0.0);
        let query = options.query.attempt(&log)?(Link { transmitter: nowhere, receiver: nowhere });
        let mut table =
            read_attempts(opened(&options.links)?, &query, &|place| reference.metres(Place::Degrees(place)))?;
        let replaced: Vec<&str> = table.header.iter().map(String::as_str).filter(is_predicted).collect();
        if !replaced.is_empty() {
            let (path, columns) = (options.links.display(), replaced.join(", "));
            warn(format_args!("{path}: predictions replace the values of {columns}"));
        }
        let mut learned_map = LearnedMap::learn(log, &options.source)?.capped(&options.query);
        fill_depths(table.attempts.iter_mut().map(|attempt| &mut attempt.link), &learned_map.log);
        let bar = spinner("predicting");
        // An interrupt stops the work between two calls.
        let predict = |attempts: &[LinkQuery]| learned_map.agent.predict_intervals(attempts);
        let predicted = table.attempts.chunks(LINKS_AT_ONCE).map(predict).collect::<Result<Vec<_>, _>>()?.concat();
        bar.finish_and_clear();
        let row = |(Prediction { mean, variance, probability, interval, .. }, attempt): (Prediction, &LinkQuery)| {
            let ends = interval.map_or((probability, probability), |ends| (ends.low, ends.high));
            let (lower, upper) = learned_map.extent.interval(&attempt.link, ends);
            [probability, lower, upper, mean, variance]
        };
        let predicted = predicted.into_iter().zip(&table.attempts).map(row).collect();
        let jitter = learned_map.agent.posterior(Which::Fused)?.jitter();
        Ok(Self { learned_map, reference, table, jitter, predicted })
    }

    /// Returns the values of [`PLACES`], as far as they are known.
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

    /// Formats the columns of the input, then missing columns of positions, then the predictions.
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
            // A position outside the projection has no latitude and longitude.
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
            let mut object: Map<String, Value> =
                own.map(|(name, field)| (name.clone(), field_value(name, field))).collect();
            let places = PLACES.iter().zip(self.places(&attempt.link));
            object.extend(places.filter_map(|(name, number)| Some(((*name).to_owned(), json!(number?)))));
            object.extend(depths(&attempt.link));
            object.extend(COLUMNS.iter().zip(numbers).map(|(name, number)| ((*name).to_owned(), json!(number))));
            // Earlier names of these values.
            let before =
                [("mean", mean), ("variance", variance), ("probability_low", lower), ("probability_high", upper)];
            for (name, number) in before {
                object.entry(name).or_insert_with(|| json!(number));
            }
            object
        };
        PredictionsJson {
            schema: 1,
            digests: self.learned_map.digests(),
            reference_system: self.learned_map.log.reference.to_string(),
            events_used: self.learned_map.log.events.len(),
            jitter: self.jitter,
            kernel: KernelJson::of(self.learned_map.model()),
            predictions: self.table.attempts.iter().zip(&self.table.rows).zip(&self.predicted).map(of).collect(),
        }
    }
}

/// Whether a column of the input has the name of a predicted column.
fn is_predicted(name: &&str) -> bool {
    COLUMNS.iter().any(|column| column.eq_ignore_ascii_case(name))
}

/// Returns a field of the input as a JSON value. Names and codes such as 007 stay text.
fn field_value(column: &str, field: &str) -> Value {
    let is_name = ["tx_id", "rx_id", "kind"].iter().any(|name| name.eq_ignore_ascii_case(column));
    let begins_as_code = |rest: &str| rest.starts_with(|letter: char| letter.is_ascii_digit());
    let is_code = field.trim_start_matches('-').strip_prefix('0').is_some_and(begins_as_code);
    match field.parse::<f64>() {
        Ok(number) if number.is_finite() && !is_name && !is_code => json!(number),
        _ => json!(field),
    }
}

/// Returns the depths of both ends, if known.
fn depths(link: &Link) -> impl Iterator<Item = (String, Value)> {
    let depths = [("tx_depth_m", link.transmitter.depth_m), ("rx_depth_m", link.receiver.depth_m)];
    depths.into_iter().filter_map(|(name, depth_m)| Some((name.to_owned(), json!(depth_m?))))
}
