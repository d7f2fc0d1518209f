//! `pingmap predict`: probability of success over links.

use pingmap_agent::Link;
use pingmap_trial::read_links;
use serde_json::json;

use crate::cli;
use crate::learn::kernel_json;
use crate::output::{print, spinner, use_threads, write_file};
use crate::survey::{Survey, fill_depths};

pub fn run(options: &cli::Predict) -> anyhow::Result<()> {
    use_threads(options.source.work.threads)?;
    let mut links = read_links(&options.links)?;
    let survey = Survey::learn(&options.source)?;
    fill_depths(&mut links, &survey.log);
    let bar = spinner("predicting");
    let latent = survey.posterior.latent(&survey.model().inputs(&links)?)?;
    bar.finish_and_clear();
    let depths = survey.model().inputs.has_depths();
    let rows: Vec<Vec<f64>> = links
        .iter()
        .zip(latent.mean.iter().zip(&latent.variance).zip(latent.probability()))
        .map(|(link, ((&mean, &variance), p))| [columns(link, depths), vec![mean, variance, p]].concat())
        .collect();
    let mut header = vec!["tx_easting_m", "tx_northing_m", "rx_easting_m", "rx_northing_m"];
    if depths {
        header.extend(["tx_depth_m", "rx_depth_m"]);
    }
    header.extend(["mean", "variance", "probability"]);
    let text = if options.json {
        let rows = rows.iter().map(|row| header.iter().zip(row).map(|(k, v)| (k.to_string(), json!(v))).collect());
        let predictions: Vec<serde_json::Map<_, _>> = rows.collect();
        let object = json!({
            "schema": 1, "events_used": survey.log.events.len(), "jitter": survey.posterior.jitter(),
            "kernel": kernel_json(survey.model()), "predictions": predictions,
        });
        serde_json::to_string_pretty(&object)?
    } else {
        csv_text(&header, &rows)?
    };
    match &options.output {
        Some(path) => write_file(path, text.as_bytes()),
        None => print(&text),
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

/// CSV with numbers in the shortest form that reads back the same.
pub fn csv_text(header: &[&str], rows: &[Vec<f64>]) -> anyhow::Result<String> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(header)?;
    for row in rows {
        writer.write_record(row.iter().map(ToString::to_string))?;
    }
    Ok(String::from_utf8(writer.into_inner().map_err(|error| error.into_error())?)?)
}
