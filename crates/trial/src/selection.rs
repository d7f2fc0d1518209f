//! The events that sum up a locality region of one vehicle, and what is lost by them.

use dgpc::{Candidates, Certificate, FitOptions, Inputs, LocalityRegion, Observations, log_evidence};
use pingmap_agent::{Event, Link, Model};

use crate::event_log::EventLog;
use crate::paper::{Policy, RADIUS_LENGTH_SCALES};
use crate::streams::{self, stream};

/// Which region, and how many points by which policy.
#[derive(Debug, Clone, PartialEq)]
pub struct Query {
    /// The link at the centre of the region; the event with most others around it if not given.
    pub centre: Option<Link>,
    /// Radius of the region over all coordinates of both ends, in metres; 1.384 length-scales if not given.
    pub radius_m: Option<f64>,
    /// How many points.
    pub points: usize,
    /// Which.
    pub policy: Policy,
    /// Sum up at most so many events, those nearest to the centre.
    pub events_max: usize,
    /// Seed of everything random.
    pub seed: u64,
}

/// Inducing points of a region, and the certificate of the choice.
#[derive(Debug, Clone)]
pub struct RegionChoice {
    /// Radius of the region, in metres.
    pub radius_m: f64,
    /// Events within the radius.
    pub events_within: usize,
    /// Events that are summed up: fewer where there were too many.
    pub events: usize,
    /// The events that become inducing points, in the order of choice; fewer than asked for where events coincide.
    pub chosen: Vec<Event>,
    /// tr K̃ given these points.
    pub trace: f64,
    /// tr K̃ without any.
    pub trace_before: f64,
    /// The KL divergence of the posterior at the points from that of all events, in nats.
    pub kl: f64,
    /// Its bounds.
    pub certificate: Certificate,
}

/// Why nothing could be chosen.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SelectionError {
    /// The region is empty.
    #[error("no event lies within {radius_m} m of the centre; expected at least one")]
    NoEvents {
        /// The radius.
        radius_m: f64,
    },
    /// The method refused.
    #[error(transparent)]
    Method(#[from] dgpc::Error),
}

/// Chooses the points that sum up a region of the events in `own`, one vehicle's. O(N³) in the events of the region.
///
/// # Errors
/// [`SelectionError`] when the region is empty or the method refuses.
pub fn choose_points(own: &EventLog, model: &Model, query: &Query) -> Result<RegionChoice, SelectionError> {
    let inputs = model.inputs(own.events.iter().map(Event::query))?;
    let (region, events_within) = region(&inputs, model, query)?;
    let (inputs, events) = (inputs.select(&region.members), region.members.iter().map(|&n| &own.events[n]));
    let events: Vec<&Event> = events.collect();
    let candidates = Candidates::new(model.prior.kernel(), &inputs)?;
    // The stream of the first split, which nothing else here draws from.
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

/// The region that is asked for, cut to as many events as it may have, and how many lie within its radius.
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
