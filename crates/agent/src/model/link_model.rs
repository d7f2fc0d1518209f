//! The model of links: the chart, the input columns, and the prior over them.

use std::sync::Arc;

use dgpc::{Candidates, Correlation, Inputs, Kernel, Observations, Posterior, Prior, PriorMean, Shape, Summary, Term};

use crate::model::fading::Fading;
use crate::model::inputs::{End, InputSpec};
use crate::model::site_prior::SitePrior;
use crate::types::chart::Chart;
use crate::types::event::{Event, Link, Position};
use crate::types::query::LinkQuery;

/// Schema version of a [`Model`]. Readers of files and messages refuse a newer version.
pub const MODEL_SCHEMA: u32 = 6;

/// A model of links: chart, inputs, prior and fading. All members of a team use one model, fixed before the mission.
#[derive(Debug, Clone, PartialEq)]
pub struct Model {
    /// Schema version with which the model was written.
    pub schema: u32,
    /// Common coordinate frame.
    pub chart: Chart,
    /// Input columns of a query.
    pub inputs: InputSpec,
    /// Kernel and prior mean over the input columns. Length-scales are in metres, and in seconds for the time.
    pub prior: Prior,
    /// Knowledge from earlier missions at the site under this prior, if any.
    pub site: Option<Arc<SitePrior>>,
    /// Correlation of successive outcomes of one link.
    pub fading: Fading,
}

impl Model {
    /// Returns a model of the current schema, without a site prior and with default fading.
    pub fn new(chart: Chart, inputs: InputSpec, prior: Prior) -> Self {
        Self { schema: MODEL_SCHEMA, chart, inputs, prior, site: None, fading: Fading::default() }
    }

    /// Returns the model with a site prior that summarizes `learned`, a posterior under this model.
    ///
    /// The site prior has up to `points_max` of the links as inducing points. They are chosen to minimize the remaining
    /// prior variance of all links. The links are those of typical vehicles at a typical time, so offsets of vehicles
    /// and of one day are integrated out. A site prior that the model already has is part of `learned`, and therefore
    /// of the new one. Takes O(N²m + mn²) time, and memory for 2N² numbers. Here N is the number of links, m the number
    /// of chosen ones, and n the number of events and points of the posterior.
    ///
    /// # Errors
    /// [`dgpc::Error`] for a position that is not finite, and for a posterior under another prior.
    pub fn with_site_prior(&self, learned: &Posterior, links: &[Link], points_max: usize) -> dgpc::Result<Self> {
        if *learned.prior() != self.prior {
            return Err(dgpc::Error::DifferentPriors { what: "a model and the posterior for its site prior" });
        }
        let links: Vec<Link> = links.iter().map(|link| self.typical_link(link)).collect();
        let chosen = Candidates::new(self.prior.kernel(), &self.inputs(&links)?)?.greedy(points_max).indices;
        let links: Vec<Link> = chosen.into_iter().map(|n| links[n]).collect();
        let summary = learned.summarise(&self.inputs(&links)?)?;
        let site = SitePrior::new(links, summary)?;
        Ok(Self { schema: MODEL_SCHEMA, site: Some(Arc::new(site)), ..self.clone() })
    }

    /// Returns the model with depth columns. Its terms ignore them, but ranges become slant ranges.
    ///
    /// # Errors
    /// [`dgpc::Error`] for a term over columns that the model does not have.
    pub fn with_depths(&self) -> dgpc::Result<Self> {
        let inputs = InputSpec::PositionsAndDepths;
        let prior = self.inputs.converted_prior(&self.prior, inputs)?;
        let mut model = Self { inputs, prior, site: None, ..self.clone() };
        if let Some(site) = &self.site {
            let inputs = model.inputs(site.links())?;
            let (precision, shift) = (site.summary().whitened_precision().clone(), site.summary().whitened_shift());
            let summary = Summary::from_whitened(&model.prior, &inputs, precision, shift.to_vec())?;
            model.site = Some(Arc::new(SitePrior::new(site.links().to_vec(), summary)?));
        }
        Ok(model)
    }

    /// Returns the link with the depths that the model uses, and without headings. Without depth columns depths are
    /// removed, else an unknown depth becomes 0.
    fn typical_link(&self, link: &Link) -> Link {
        let end = |end: Position| {
            let depth_m = self.inputs.has_depths().then_some(end.depth_m.unwrap_or(0.0));
            Position { depth_m, ..end.without_heading() }
        };
        Link { transmitter: end(link.transmitter), receiver: end(link.receiver) }
    }

    /// Returns true if a term depends on the aspect of this end.
    pub fn has_aspect(&self, end: End) -> bool {
        self.inputs.is_aspect_in(self.prior.kernel(), end)
    }

    /// Returns the posterior before the first event: the prior and the site prior.
    pub fn prior_posterior(&self) -> Posterior {
        let prior_alone = || Posterior::prior_alone(&self.prior, self.inputs.dimension());
        self.site.as_ref().map_or_else(prior_alone, |site| site.posterior().clone())
    }

    pub(crate) fn site_summary(&self) -> Option<&Summary> {
        self.site.as_ref().map(|site| site.summary())
    }

    /// Returns the geometric mean of the horizontal length-scales of the first correlation of the first kernel term, in
    /// metres.
    ///
    /// It is the distance over which links are correlated.
    pub fn length_scale_m(&self) -> f64 {
        let path = self.prior.kernel().terms().first().map(|term| &term.correlations()[0]);
        let columns = path.into_iter().flat_map(|path| path.columns().iter().zip(path.length_scales()));
        let logarithms: Vec<f64> =
            columns.filter(|(column, _)| !self.inputs.is_depth(**column)).map(|(_, scale)| scale.ln()).collect();
        (logarithms.iter().sum::<f64>() / logarithms.len().max(1) as f64).exp()
    }

    /// Returns the events as observations of the method. Their weights are those of [`Fading::weights`].
    ///
    /// # Errors
    /// [`dgpc::Error::NotFinite`] with the row and column of the first NaN or infinity.
    pub fn observations<'a>(&self, events: impl IntoIterator<Item = &'a Event>) -> dgpc::Result<Observations> {
        let events: Vec<&Event> = events.into_iter().collect();
        let outcomes = events.iter().map(|event| event.success).collect();
        let inputs = self.inputs(events.iter().map(|event| event.query()))?;
        Observations::weighted(inputs, outcomes, self.fading.weights(&events))
    }

    /// Returns the events at `indices` as observations. Each weight takes all `events` into account.
    ///
    /// The events of each pair of vehicles must be in canonical order.
    pub(crate) fn observations_among(&self, events: &[&Event], indices: &[usize]) -> dgpc::Result<Observations> {
        let inputs = self.inputs(indices.iter().map(|&index| events[index].query()))?;
        let outcomes = indices.iter().map(|&index| events[index].success).collect();
        let weight = |&index: &usize| self.fading.weight(events[index], events[..index].iter().rev().copied());
        Observations::weighted(inputs, outcomes, indices.iter().map(weight).collect())
    }

    /// Returns one event as an observation, with its weight given earlier events of its receiver. `earlier` starts with
    /// the latest.
    pub(crate) fn observation_given_earlier<'a>(
        &self,
        event: &Event,
        earlier: impl Iterator<Item = &'a Event>,
    ) -> dgpc::Result<Observations> {
        let weight = self.fading.weight(event, earlier);
        Observations::weighted(self.inputs([event.query()])?, vec![event.success], vec![weight])
    }

    /// Returns a model with one isotropic kernel term over both positions, reciprocal if requested, and a zero prior
    /// mean.
    ///
    /// # Errors
    /// [`dgpc::Error::OutOfRange`] for a length-scale or variance that is not finite and positive.
    pub fn isotropic(
        chart: Chart,
        inputs: InputSpec,
        shape: Shape,
        reciprocal: bool,
        length_scale_m: f64,
        variance: f64,
    ) -> dgpc::Result<Self> {
        let columns: Vec<usize> = inputs.ends().collect();
        let mut term = Term::of(variance, Correlation::isotropic(shape, &columns, length_scale_m)?)?;
        if reciprocal {
            term = term.reciprocal(inputs.swap_ends()?)?;
        }
        let prior = Prior::new(Kernel::new(vec![term])?, PriorMean::Zero)?;
        Ok(Self::new(chart, inputs, prior))
    }

    /// Computes the inputs of links or queries, one row each. Columns are those of [`InputSpec`], about the chart's
    /// origin.
    ///
    /// # Errors
    /// [`dgpc::Error::NotFinite`] with the row and column of the first NaN or infinity.
    pub fn inputs(&self, queries: impl IntoIterator<Item = impl Into<LinkQuery>>) -> dgpc::Result<Inputs> {
        let (mut values, mut ends) = (Vec::new(), Vec::with_capacity(6));
        for query in queries {
            let query: LinkQuery = query.into();
            ends.clear();
            for end in query.link.ends() {
                let (east_m, north_m) = self.chart.local_m(&end);
                ends.extend([east_m, north_m]);
                if self.inputs.has_depths() {
                    ends.push(end.depth_m.unwrap_or(0.0));
                }
            }
            self.inputs.append_row(&ends, &query, &mut values);
        }
        Inputs::new(values, self.inputs.dimension())
    }
}
