//! Chooses the events that summarise a locality region of one vehicle, and bounds the loss.

use dgpc::{Candidates, Certificate, FitOptions, Inputs, LocalityRegion, Observations, log_evidence};
use pingmap_agent::{Event, Link, Model};

use crate::event_log::EventLog;
use crate::paper::{Policy, RADIUS_LENGTH_SCALES};
use crate::streams::{self, stream};

/// The region, and the number and policy of the points.
#[derive(Debug, Clone, PartialEq)]
pub struct Query {
    /// Link at the centre of the region; if not given, the event with the most other events around it.
    pub centre: Option<Link>,
    /// Radius of the region over all coordinates of both ends, in metres; 1.384 length-scales if not given.
    pub radius_m: Option<f64>,
    /// Number of points.
    pub points: usize,
    /// Policy of the choice.
    pub policy: Policy,
    /// Largest number of events that are summarised, those nearest to the centre.
    pub events_max: usize,
    /// Seed of all random numbers.
    pub seed: u64,
}

/// Inducing points of a region, and the certificate of the choice.
#[derive(Debug, Clone)]
pub struct RegionChoice {
    /// Radius of the region, in metres.
    pub radius_m: f64,
    /// Events within the radius.
    pub events_within: usize,
    /// Number of summarised events; smaller than `events_within` if limited.
    pub events: usize,
    /// Events that become inducing points, in the order of choice. There are fewer than requested if events coincide.
    pub chosen: Vec<Event>,
    /// tr K̃ given these points.
    pub trace: f64,
    /// tr K̃ without any points.
    pub trace_before: f64,
    /// The KL divergence of the posterior at the points from that of all events, in nats.
    pub kl: f64,
    /// Bounds of the divergence.
    pub certificate: Certificate,
}

/// Reason why no point could be chosen.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SelectionError {
    /// The region contains no event.
    #[error("no event lies within {radius_m} m of the centre; expected at least one")]
    NoEvents {
        /// The radius.
        radius_m: f64,
    },
    /// A numerical failure.
    #[error(transparent)]
    Method(#[from] dgpc::Error),
}

/// Chooses the points that summarise a region of the events in `own`, which are one vehicle's. O(N³) for N events in
/// the region.
///
/// # Errors
/// Returns [`SelectionError`] for an empty region or a numerical failure.
pub fn choose_points(own: &EventLog, model: &Model, query: &Query) -> Result<RegionChoice, SelectionError> {
    let inputs = model.inputs(own.events.iter().map(Event::query))?;
    let (region, events_within) = region(&inputs, model, query)?;
    let (inputs, events) = (inputs.select(&region.members), region.members.iter().map(|&n| &own.events[n]));
    let events: Vec<&Event> = events.collect();
    let candidates = Candidates::new(model.prior.kernel(), &inputs)?;
    // The stream of the first split is not used elsewhere here.
    let mut rng = stream(query.seed, streams::SPLITS);
    let selection = query.policy.choose(&candidates, query.points, &mut rng);
    let observations = Observations::new(inputs.clone(), events.iter().map(|event| event.success).collect())?;
    let fit = dgpc::fit(&model.prior, &observations, &FitOptions::default().tolerance(1e-6))?;
    let certificate = Certificate::new(&model.prior, fit.sites(), &inputs.select(&selection.indices))?;
    Ok(RegionChoice {
        radius_m: region.radius,
        events_within,
        events: events.len(),
        chosen: selection.indices.iter().map(|&n| events[n].clone()).collect(),
        trace: selection.trace,
        trace_before: candidates.trace(),
        kl: certificate.divergence(log_evidence(&model.prior, fit.sites())?),
        certificate,
    })
}

/// Returns the queried region, limited to the largest number of events, and the number of events within its radius.
fn region(inputs: &Inputs, model: &Model, query: &Query) -> Result<(LocalityRegion, usize), SelectionError> {
    let ends = inputs.columns(model.inputs.ends());
    let radius_m = query.radius_m.unwrap_or(RADIUS_LENGTH_SCALES * model.length_scale_m());
    let region = match &query.centre {
        Some(link) => {
            let centre = model.inputs([link])?.columns(model.inputs.ends());
            Some(LocalityRegion::around(&ends, centre.row(0), radius_m)?)
        }
        None => LocalityRegion::busiest(&ends, radius_m)?,
    };
    let region = region.filter(|region| !region.members.is_empty());
    let mut region = region.ok_or(SelectionError::NoEvents { radius_m })?;
    let within = region.members.len();
    if within > query.events_max {
        region.keep_nearest(&ends, query.events_max);
    }
    Ok((region, within))
}
