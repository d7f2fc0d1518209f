//! `pingmap select`: chooses the inducing points of a locality region.

use clap::Args;
use pingmap_agent::{Event, Limits, Link, Position};
use pingmap_import::Reference;
use pingmap_trial::selection::{Query, RegionChoice, SelectionError, choose_points};
use schemars::JsonSchema;
use serde::Serialize;

use crate::cli_enums::{PolicyName, name_of};
use crate::cli_parsers::{dense_events, inducing_points, positive, quadruple, threads};
use crate::log::{self, Logs};
use crate::model::{InputDigests, KernelJson, ModelAndFit};
use crate::options::{ModelFileOption, RESULT};
use crate::output::{BadInput, Results, count, note, print_json, print_text, spinner, table, warn};
use crate::reference::{PlaceJson, ReferenceOptions, reference};

/// Choose the inducing points that summarise a locality region, with a certificate
#[derive(Args)]
#[command(after_help = "Example:\n  pingmap select log.csv --vehicle auv1 --points 3")]
pub struct Options {
    #[command(flatten)]
    pub logs: Logs,
    /// Vehicle whose events are summarised
    #[arg(long)]
    pub vehicle: String,
    /// Centre of the locality region, in metres; if not given, the vehicle's event with the most own events around it
    #[arg(long, value_name = "TX_EAST,TX_NORTH,RX_EAST,RX_NORTH", value_parser = quadruple, allow_hyphen_values = true)]
    pub centre: Option<[f64; 4]>,
    /// Radius of the locality region over all coordinates of both ends; 1.384 length-scales if not given
    #[arg(long, value_parser = positive, allow_negative_numbers = true)]
    pub radius_m: Option<f64>,
    /// Number of inducing points
    #[arg(long, default_value_t = 2, value_parser = inducing_points)]
    pub points: usize,
    /// Policy of the choice
    #[arg(long, value_enum, default_value_t = PolicyName::Good)]
    pub policy: PolicyName,
    #[command(flatten)]
    pub reference: ReferenceOptions,
    #[command(flatten)]
    pub model: ModelFileOption,
    /// Seed of all random numbers
    #[arg(help_heading = "Computation", long, default_value_t = 1)]
    pub seed: u64,
    /// Largest number of events that are summarised, those nearest to the centre
    #[arg(help_heading = "Computation", long, default_value_t = 1000, value_parser = dense_events)]
    pub events_max: usize,
    /// Worker threads; 0 uses one per core. Results do not depend on it
    #[arg(help_heading = "Computation", long, default_value_t = 0, value_parser = threads)]
    pub threads: usize,
    /// Print one JSON object instead of tables
    #[arg(help_heading = RESULT, long)]
    pub json: bool,
}

impl Options {
    pub fn threads(&self) -> usize {
        self.threads
    }

    pub fn run(&self, results: Results) -> anyhow::Result<()> {
        let selected = Selected::choose(self)?;
        match self.json {
            true => print_json(results, &selected.json(self)),
            false => print_text(results, &selected.text(self)),
        }
    }
}

/// The chosen points, with the log and model.
struct Selected {
    log_digest: String,
    reference: Reference,
    known: ModelAndFit,
    choice: RegionChoice,
}

/// The choice of inducing points in JSON.
#[derive(Serialize, JsonSchema)]
pub struct SelectedJson<'a> {
    /// Version of this object.
    schema: u32,
    #[serde(flatten)]
    digests: InputDigests,
    /// Reference system of the metres; `unknown` if the log does not name it.
    reference_system: String,
    /// Vehicle whose events are summarised.
    vehicle: &'a str,
    /// Policy of the choice.
    policy: String,
    /// Radius of the locality region in metres.
    radius_m: f64,
    /// Number of events in the region.
    events_in_region: usize,
    /// Seed of all random numbers.
    seed: u64,
    /// Kernel of the model.
    kernel: KernelJson,
    /// The chosen points.
    inducing_points: Vec<PointJson>,
    /// tr K̃ with these points: the prior variance that they leave unexplained.
    trace: f64,
    /// tr K̃ without any points.
    trace_before: f64,
    /// Bounds on the divergence from the posterior with all events of the region.
    certificate: CertificateJson,
}

#[derive(Serialize, JsonSchema)]
pub struct PointJson {
    /// Time of the event in seconds.
    time_s: f64,
    /// Easting of the transmitter in metres.
    tx_easting_m: f64,
    /// Northing of the transmitter in metres.
    tx_northing_m: f64,
    /// Easting of the receiver in metres.
    rx_easting_m: f64,
    /// Northing of the receiver in metres.
    rx_northing_m: f64,
    /// Latitude of the transmitter, if the reference system is known.
    tx_latitude_deg: Option<f64>,
    /// Longitude of the transmitter, if the reference system is known.
    tx_longitude_deg: Option<f64>,
    /// Latitude of the receiver, if the reference system is known.
    rx_latitude_deg: Option<f64>,
    /// Longitude of the receiver, if the reference system is known.
    rx_longitude_deg: Option<f64>,
    /// 1 heard, 0 missed.
    success: u8,
}

#[derive(Serialize, JsonSchema)]
pub struct CertificateJson {
    /// The divergence in nats.
    kl: f64,
    /// Upper minus lower bound on the evidence: the certificate, in nats.
    gap: f64,
    /// A bound that vanishes with the trace, in nats.
    closed_form: f64,
    /// The closed form of the paper.
    paper: f64,
    /// Number added to a diagonal to factorise a matrix; usually 0.
    jitter: f64,
}

impl Selected {
    fn choose(options: &Options) -> anyhow::Result<Self> {
        let mut log = options.logs.open()?;
        options.reference.apply(&mut log)?;
        let reference = reference(log.reference)?;
        let own = log::only(&log, &options.vehicle)?;
        let log_digest = log.digest();
        let known = ModelAndFit::new(options.model.path(), &log, Limits::default())?;
        let centre = options.centre.map(|[tx_east, tx_north, rx_east, rx_north]| {
            let (transmitter, receiver) = (Position::new(tx_east, tx_north), Position::new(rx_east, rx_north));
            let mut link = [Link { transmitter, receiver }];
            log::fill_depths(link.iter_mut(), &own);
            link[0]
        });
        let query = Query {
            centre,
            radius_m: options.radius_m,
            points: options.points,
            policy: options.policy.policy(),
            events_max: options.events_max,
            seed: options.seed,
        };
        let bar = spinner("selecting");
        let choice = choose_points(&own, &known.model, &query).map_err(|error| of_vehicle(error, &options.vehicle))?;
        bar.finish_and_clear();
        if choice.events < choice.events_within {
            let (found, used) = (choice.events_within, choice.events);
            warn(format_args!(
                "the region holds {found} events; using the {used} nearest to its centre (--events-max)"
            ));
        }
        if choice.chosen.len() < options.points {
            let (found, wanted) = (choice.chosen.len(), options.points);
            warn(format_args!("only {found} of {wanted} points are distinct in this region"));
        }
        note(known.describe(choice.events, true));
        Ok(Self { log_digest, reference, known, choice })
    }

    fn json<'a>(&self, options: &'a Options) -> SelectedJson<'a> {
        let RegionChoice { radius_m, events, ref chosen, trace, trace_before, kl, certificate, .. } = self.choice;
        let point = |event: &Event| {
            let Link { transmitter: t, receiver: r } = event.link;
            let [tx, rx] = [t, r].map(|end| PlaceJson::of(&end, &self.reference));
            PointJson {
                time_s: event.time_s,
                tx_easting_m: t.east_m,
                tx_northing_m: t.north_m,
                rx_easting_m: r.east_m,
                rx_northing_m: r.north_m,
                tx_latitude_deg: tx.latitude_deg,
                tx_longitude_deg: tx.longitude_deg,
                rx_latitude_deg: rx.latitude_deg,
                rx_longitude_deg: rx.longitude_deg,
                success: u8::from(event.success),
            }
        };
        SelectedJson {
            schema: 1,
            digests: InputDigests {
                log_digest: self.log_digest.clone(),
                model_digest: Some(self.known.model.digest()),
            },
            reference_system: self.reference.system().to_string(),
            vehicle: &options.vehicle,
            policy: name_of(&options.policy),
            radius_m,
            events_in_region: events,
            seed: options.seed,
            kernel: KernelJson::of(&self.known.model),
            inducing_points: chosen.iter().map(point).collect(),
            trace,
            trace_before,
            certificate: CertificateJson {
                kl,
                gap: certificate.gap,
                closed_form: certificate.closed_form,
                paper: certificate.paper_closed_form,
                jitter: certificate.jitter,
            },
        }
    }

    fn text(&self, options: &Options) -> String {
        let RegionChoice { radius_m, events, ref chosen, trace, trace_before, kl, certificate, .. } = self.choice;
        let (points, events) = (count(chosen.len(), "point"), count(events, "event"));
        format!(
            "{} choice of {points} for {events} of {} within {radius_m:.0} m:\n\n{}\n\n\
             tr K̃ {trace:.4} of {trace_before:.4} without points\n\
             KL {kl:.4} nats ≤ gap {:.4} ≤ closed form {:.4} (the paper's: {:.4})",
            name_of(&options.policy),
            options.vehicle,
            points_table(chosen),
            certificate.gap,
            certificate.closed_form,
            certificate.paper_closed_form,
        )
    }
}

/// An empty region is an error of the user's input.
fn of_vehicle(error: SelectionError, vehicle: &str) -> anyhow::Error {
    match error {
        SelectionError::NoEvents { radius_m } => {
            let message =
                format!("no event of {vehicle} lies within {radius_m} m of the centre; expected at least one");
            BadInput(message).into()
        }
        other => other.into(),
    }
}

fn points_table(chosen: &[Event]) -> String {
    let row = |event: &Event| {
        let Link { transmitter: t, receiver: r } = event.link;
        let numbers = [event.time_s, t.east_m, t.north_m, r.east_m, r.north_m, event.link.range_m()];
        let outcome = if event.success { "heard" } else { "missed" };
        numbers.iter().map(|number| format!("{number:.1}")).chain([outcome.to_owned()]).collect()
    };
    let header = ["time_s", "tx_easting_m", "tx_northing_m", "rx_easting_m", "rx_northing_m", "range_m", "outcome"];
    table(&header, &chosen.iter().map(row).collect::<Vec<_>>())
}
