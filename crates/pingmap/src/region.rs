//! `pingmap select`: the inducing points that sum up a locality region.

use dgpc::{Candidates, Certificate, FitOptions, Inputs, LocalityRegion, Observations, log_evidence};
use pingmap_agent::{Event, Limits, Link, Model, Position};
use pingmap_trial::EventLog;
use pingmap_trial::paper::RADIUS_LENGTH_SCALES;
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use serde_json::json;

use crate::cli::{self, name_of};
use crate::learn::kernel_json;
use crate::output::{BadInput, count, note, print, print_json, spinner, table, use_threads, warn};
use crate::survey::{self, Known};

pub fn run(options: &cli::Select) -> anyhow::Result<()> {
    use_threads(options.threads)?;
    let log = survey::open_log(&options.events)?;
    let own = survey::only(&log, &options.vehicle)?;
    let known = Known::new(&options.model, &log, Limits::default())?;
    let Region { events: region, inputs, radius_m } = Region::find(&own, &known.model, options)?;
    let bar = spinner("selecting");
    let prior = &known.model.prior;
    let candidates = Candidates::new(prior.kernel(), &inputs)?;
    let mut rng = ChaCha8Rng::seed_from_u64(options.seed);
    let selection = options.policy.policy().choose(&candidates, options.points, &mut rng);
    let observations = Observations::new(inputs.clone(), region.iter().map(|event| event.success).collect())?;
    let fit = dgpc::fit(prior, &observations, &FitOptions::default().tolerance(1e-6))?;
    let sites = fit.sites();
    let certificate = Certificate::new(prior, sites, &inputs.select(&selection.indices))?;
    let kl = certificate.divergence(log_evidence(prior, sites)?);
    bar.finish_and_clear();

    if selection.indices.len() < options.points {
        let (found, wanted) = (selection.indices.len(), options.points);
        warn(format_args!("only {found} of {wanted} points are distinct in this region"));
    }
    let chosen: Vec<&Event> = selection.indices.iter().map(|&i| region[i]).collect();
    note(known.describe(region.len(), true));
    if options.json {
        return print_json(&json!({
            "schema": 1, "vehicle": options.vehicle, "policy": name_of(&options.policy), "radius_m": radius_m,
            "events_in_region": region.len(), "seed": options.seed,
            "kernel": kernel_json(&known.model),
            "inducing_points": chosen.iter().map(|event| point_json(event)).collect::<Vec<_>>(),
            "trace": selection.trace,
            "trace_before": candidates.trace(),
            "certificate": {
                "kl": kl, "gap": certificate.gap, "closed_form": certificate.closed_form, "paper": certificate.paper_closed_form,
                "jitter": certificate.jitter,
            },
        }));
    }
    let (points, events) = (count(chosen.len(), "point"), count(region.len(), "event"));
    let text = format!(
        "{} choice of {points} for {events} of {} within {radius_m:.0} m:\n\n{}\n\n\
         tr K̃ {:.4} of {:.4} without points\n\
         KL {kl:.4} nats ≤ gap {:.4} ≤ closed form {:.4} (the paper's: {:.4})",
        name_of(&options.policy),
        options.vehicle,
        points_table(&chosen),
        selection.trace,
        candidates.trace(),
        certificate.gap,
        certificate.closed_form,
        certificate.paper_closed_form,
    );
    print(&text)
}

/// The events of one vehicle around a centre.
struct Region<'a> {
    events: Vec<&'a Event>,
    inputs: Inputs,
    radius_m: f64,
}

impl<'a> Region<'a> {
    /// The region that the options describe, or the busiest one; at most as many events as they allow.
    fn find(own: &'a EventLog, model: &Model, options: &cli::Select) -> anyhow::Result<Self> {
        let inputs = model.inputs(own.events.iter().map(|event| &event.link))?;
        let ends = inputs.columns(model.inputs.ends());
        let radius_m = options.radius_m.unwrap_or(RADIUS_LENGTH_SCALES * model.length_scale_m());
        let centre = match options.centre {
            Some([tx_east, tx_north, rx_east, rx_north]) => {
                let (transmitter, receiver) = (Position::new(tx_east, tx_north), Position::new(rx_east, rx_north));
                let mut link = [Link { transmitter, receiver }];
                survey::fill_depths(&mut link, own);
                model.inputs(&link)?.columns(model.inputs.ends()).row(0).to_vec()
            }
            None => LocalityRegion::busiest(&ends, radius_m)?.map_or_else(Vec::new, |region| region.centre),
        };
        let mut region = LocalityRegion::around(&ends, &centre, radius_m)?;
        if region.members.is_empty() {
            let vehicle = &options.vehicle;
            let message =
                format!("no event of {vehicle} lies within {radius_m} m of the centre; expected at least one");
            return Err(BadInput(message).into());
        }
        if region.members.len() > options.events_max {
            let (found, used) = (region.members.len(), options.events_max);
            warn(format_args!(
                "the region holds {found} events; using the {used} nearest to its centre (--events-max)"
            ));
            region.keep_nearest(&ends, used);
        }
        let members = region.members;
        let events = members.iter().map(|&n| &own.events[n]).collect();
        Ok(Self { events, inputs: inputs.select(&members), radius_m })
    }
}

fn point_json(event: &Event) -> serde_json::Value {
    let Link { transmitter: t, receiver: r } = event.link;
    json!({
        "time_s": event.time_s, "tx_easting_m": t.east_m, "tx_northing_m": t.north_m,
        "rx_easting_m": r.east_m, "rx_northing_m": r.north_m, "success": u8::from(event.success),
    })
}

fn points_table(chosen: &[&Event]) -> String {
    let row = |event: &&Event| {
        let Link { transmitter: t, receiver: r } = event.link;
        let numbers = [event.time_s, t.east_m, t.north_m, r.east_m, r.north_m, event.link.range_m()];
        let outcome = if event.success { "heard" } else { "missed" };
        numbers.iter().map(|number| format!("{number:.1}")).chain([outcome.to_owned()]).collect()
    };
    let header = ["time_s", "tx_easting_m", "tx_northing_m", "rx_easting_m", "rx_northing_m", "range_m", "outcome"];
    table(&header, &chosen.iter().map(row).collect::<Vec<_>>())
}
