//! `pingmap select`: the inducing points that sum up a locality region.

use dgpc::{Candidates, Certificate, Inputs, Observations, Selection, log_evidence, mean_field};
use pingmap_agent::{Event, Link, Position};
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use serde_json::json;

use crate::cli::{self, PolicyName, name_of};
use crate::output::{BadInput, note, print, print_json, spinner, table, use_threads, warn};
use crate::survey;

/// Radius of the reference locality region in length-scales, √(−2 ln ε) for ε = 0.384: the paper's 0.4 / 0.289.
const RADIUS_LENGTH_SCALES: f64 = 1.384;

/// Above so many events the exact KL divergence, O(N³), is not worth waiting for.
const EXACT_EVENTS_MAX: usize = 2000;

pub fn run(options: &cli::Select) -> anyhow::Result<()> {
    use_threads(options.work.threads)?;
    let log = survey::open_log(&options.events)?;
    let own = survey::only(&log, &options.vehicle)?;
    let bar = spinner("learning");
    let fit = survey::fit(&log, &options.kernel.choice(), options.work.seed)?;
    let own_inputs = fit.model.inputs(own.events.iter().map(|event| &event.link))?;
    let radius_m = options.radius_m.unwrap_or(RADIUS_LENGTH_SCALES * fit.length_scale_m);
    let centre = match options.centre {
        Some([tx_east, tx_north, rx_east, rx_north]) => {
            let link =
                Link { transmitter: Position::new(tx_east, tx_north), receiver: Position::new(rx_east, rx_north) };
            fit.model.inputs([&link])?.row(0).to_vec()
        }
        None => busiest(&own_inputs, radius_m).to_vec(),
    };
    let members = within(&own_inputs, &centre, radius_m);
    if members.is_empty() {
        let message =
            format!("no event of {} lies within {radius_m} m of the centre; expected at least one", options.vehicle);
        return Err(BadInput(message).into());
    }
    if members.len() > EXACT_EVENTS_MAX {
        let message = format!(
            "the region holds {} events; expected at most {EXACT_EVENTS_MAX}, so make --radius-m smaller than {radius_m:.0}",
            members.len()
        );
        return Err(BadInput(message).into());
    }
    let region: Vec<&Event> = members.iter().map(|&n| &own.events[n]).collect();
    let inputs = own_inputs.select(&members);

    let candidates = Candidates::new(fit.model.prior.kernel(), &inputs)?;
    let selection = choose(&candidates, options);
    if selection.indices.len() < options.points {
        let (found, wanted) = (selection.indices.len(), options.points);
        warn(format_args!("only {found} of {wanted} points are distinct in this region"));
    }
    let observations = Observations::new(inputs.clone(), region.iter().map(|event| event.success).collect())?;
    let sites = mean_field::dense(&fit.model.prior, &observations, &Default::default())?.sites;
    let points = inputs.select(&selection.indices);
    let certificate = Certificate::new(&fit.model.prior, &sites, &points)?;
    let kl = log_evidence(&fit.model.prior, &sites)? - certificate.lower;

    bar.finish_and_clear();
    let chosen: Vec<&Event> = selection.indices.iter().map(|&i| region[i]).collect();
    note(survey::describe(&fit, log.events.len(), true));
    if options.json {
        return print_json(&json!({
            "schema": 1, "vehicle": options.vehicle, "policy": name_of(&options.policy), "radius_m": radius_m,
            "events_in_region": region.len(), "seed": options.work.seed,
            "kernel": { "length_scale_m": fit.length_scale_m, "variance": fit.variance },
            "inducing_points": chosen.iter().map(|event| point_json(event)).collect::<Vec<_>>(),
            "trace": selection.trace,
            "trace_before": candidates.trace(),
            "certificate": {
                "kl": kl, "gap": certificate.gap, "closed_form": certificate.closed_form, "paper": certificate.paper,
                "jitter": certificate.jitter,
            },
        }));
    }
    let text = format!(
        "{} {} points for {} events of {} within {:.0} m:\n\n{}\n\ntr K̃ {:.4} of {:.4} without points\nKL {:.4} nats ≤ gap {:.4} ≤ closed form {:.4} (the paper's: {:.4})",
        chosen.len(),
        name_of(&options.policy),
        region.len(),
        options.vehicle,
        radius_m,
        points_table(&chosen),
        selection.trace,
        candidates.trace(),
        kl,
        certificate.gap,
        certificate.closed_form,
        certificate.paper,
    );
    print(&text)
}

fn choose(candidates: &Candidates, options: &cli::Select) -> Selection {
    match options.policy {
        PolicyName::Good => candidates.good(options.points),
        PolicyName::Bad => candidates.bad(options.points),
        PolicyName::Random => candidates.random(options.points, &mut ChaCha8Rng::seed_from_u64(options.work.seed)),
    }
}

/// Indices of the inputs within a radius.
fn within(inputs: &Inputs, centre: &[f64], radius_m: f64) -> Vec<usize> {
    let near = |row: &[f64]| {
        let squares: f64 = row.iter().zip(centre).map(|(a, b)| (a - b) * (a - b)).sum();
        squares <= radius_m * radius_m
    };
    (0..inputs.len()).filter(|&n| near(inputs.row(n))).collect()
}

/// The input with most inputs within a radius; the first of equals.
fn busiest(inputs: &Inputs, radius_m: f64) -> &[f64] {
    // Every k-th input is candidate enough in a long log.
    let step = inputs.len().div_ceil(1000).max(1);
    let counted = inputs.rows().step_by(step).map(|row| (row, within(inputs, row, radius_m).len()));
    counted.reduce(|best, next| if next.1 > best.1 { next } else { best }).map_or(&[], |(row, _)| row)
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
