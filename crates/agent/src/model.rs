//! What a team agrees on before the mission: the chart, the inputs that a link yields, and the prior over them.

use std::f64::consts::FRAC_1_SQRT_2;
use std::ops::Range;
use std::sync::Arc;

use dgpc::{
    Candidates, Correlation, Inputs, Kernel, Observations, Posterior, Prior, PriorMean, Reflection, Shape, Summary,
    Term,
};

use crate::attempt::Attempt;
use crate::chart::Chart;
use crate::event::{Event, Link, Position};
use crate::fading::Fading;
use crate::place::Place;

/// Version of what a [`Model`] holds. Whoever reads one from a file or message refuses a newer version.
pub const MODEL_SCHEMA: u32 = 5;

/// Name of the column of the time.
pub(crate) const TIME: &str = "time";

/// The numbers that a link is turned into: raw positions and what follows from them. Kernel terms choose among these
/// columns.
///
/// | columns | what |
/// |---|---|
/// | `tx_…`, `rx_…` | both ends, in metres about the chart's origin: east, north (and depth) |
/// | `u_…` | (tx + rx)/√2: where the link lies |
/// | `v_…` | (tx − rx)/√2: which way and how far it reaches; swapping the ends turns its sign |
/// | `range` | distance between the ends, in metres |
/// | `time`, `water` | when, in seconds, and a label that is negative where time does not count ([`crate::When`]) |
/// | `tx_vehicle`, `rx_vehicle` | who, as labels ([`crate::Party`]) |
/// | `kind` | what kind of message, as a label ([`crate::Kind`]) |
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InputSpec {
    /// East and north of each end: fourteen columns.
    Positions,
    /// East, north and depth of each end: eighteen columns. Unknown depth counts as 0.
    PositionsAndDepths,
}

impl InputSpec {
    /// Number of columns.
    pub fn dimension(self) -> usize {
        4 * self.dimension_of_an_end() + 6
    }

    /// Whether it looks at depths.
    pub fn has_depths(self) -> bool {
        self == InputSpec::PositionsAndDepths
    }

    /// Names of the columns, in order.
    pub fn column_names(self) -> Vec<String> {
        let axes = &["east", "north", "depth"][..self.dimension_of_an_end()];
        let groups = ["tx", "rx", "u", "v"].iter();
        let names = groups.flat_map(|group| axes.iter().map(move |axis| format!("{group}_{axis}")));
        names.chain(["range", TIME, "water", "tx_vehicle", "rx_vehicle", "kind"].map(str::to_owned)).collect()
    }

    /// Columns of the transmitter.
    pub fn transmitter(self) -> Range<usize> {
        self.group(0)
    }

    /// Columns of the receiver.
    pub fn receiver(self) -> Range<usize> {
        self.group(1)
    }

    /// Columns of both ends: the raw positions, from which all others follow.
    pub fn ends(self) -> Range<usize> {
        0..self.group(1).end
    }

    /// Columns of the link coordinates, u and then v.
    pub fn link_coordinates(self) -> Range<usize> {
        self.group(2).start..self.group(3).end
    }

    /// Column of the distance between the ends.
    pub fn range(self) -> usize {
        4 * self.dimension_of_an_end()
    }

    /// Column of the time, in seconds.
    pub fn time(self) -> usize {
        self.range() + 1
    }

    /// Column of the label of the water, which is negative where time does not count.
    pub fn water(self) -> usize {
        self.range() + 2
    }

    /// Column of the label of who transmits.
    pub fn transmitting_vehicle(self) -> usize {
        self.range() + 3
    }

    /// Column of the label of who receives.
    pub fn receiving_vehicle(self) -> usize {
        self.range() + 4
    }

    /// Column of the label of the kind of message.
    pub fn kind(self) -> usize {
        self.range() + 5
    }

    fn group(self, place: usize) -> Range<usize> {
        let width = self.dimension_of_an_end();
        place * width..(place + 1) * width
    }

    fn dimension_of_an_end(self) -> usize {
        match self {
            InputSpec::Positions => 2,
            InputSpec::PositionsAndDepths => 3,
        }
    }

    /// Swapping the two ends, as a reflection of the columns.
    ///
    /// # Errors
    /// None in practice: no column is named twice.
    pub fn swap_ends(self) -> dgpc::Result<Reflection> {
        let pairs: Vec<(usize, usize)> = self.transmitter().zip(self.receiver()).collect();
        Reflection::swap(&pairs)?.and_negate(&self.group(3).collect::<Vec<_>>())
    }

    /// A prior mean that falls with the distance between the ends.
    ///
    /// # Errors
    /// [`dgpc::Error::NotFinite`] for numbers that are not finite.
    pub fn range_mean(self, intercept: f64, slope_per_m: f64) -> dgpc::Result<PriorMean> {
        let columns = |range: Range<usize>| range.collect::<Vec<_>>();
        PriorMean::range(intercept, slope_per_m, &columns(self.transmitter()), &columns(self.receiver()))
    }

    /// Appends the columns of an attempt, given both ends' numbers.
    fn append_row(self, ends: &[f64], attempt: &Attempt, values: &mut Vec<f64>) {
        let (transmitter, receiver) = ends.split_at(self.dimension_of_an_end());
        let pairs = || transmitter.iter().zip(receiver);
        values.extend(ends);
        values.extend(pairs().map(|(t, r)| (t + r) * FRAC_1_SQRT_2));
        values.extend(pairs().map(|(t, r)| (t - r) * FRAC_1_SQRT_2));
        values.push(pairs().map(|(t, r)| (t - r) * (t - r)).sum::<f64>().sqrt());
        values.extend(attempt.when.columns());
        values.extend([attempt.transmitter.label(), attempt.receiver.label(), attempt.kind.label()]);
    }
}

/// Chart, inputs and prior: all that is needed to read a link as the method does.
#[derive(Debug, Clone, PartialEq)]
pub struct Model {
    /// [`MODEL_SCHEMA`] at the time of writing.
    pub schema: u32,
    /// The common frame.
    pub chart: Chart,
    /// The numbers that a link is turned into.
    pub inputs: InputSpec,
    /// Kernel and prior mean over those numbers; length-scales in metres.
    pub prior: Prior,
    /// What earlier missions learned of the place under that prior, if anything.
    pub place: Option<Arc<Place>>,
    /// How much outcomes count that follow one another at one place.
    pub fading: Fading,
}

impl Model {
    /// A model of the current schema.
    pub fn new(chart: Chart, inputs: InputSpec, prior: Prior) -> Self {
        Self { schema: MODEL_SCHEMA, chart, inputs, prior, place: None, fading: Fading::default() }
    }

    /// The same model with what `learned`, a posterior under it, says of its place: at up to `points_max` of the links, those that
    /// leave least of the prior variance of all of them. Of typical vehicles at a typical time, so that yesterday's noise stays
    /// behind; a place that the model had before is in the posterior already, and goes on. O(N²m + mn²), and 2N² numbers, for N links,
    /// m of them kept, and a posterior of n events and points.
    ///
    /// # Errors
    /// [`dgpc::Error`] for a position that is not finite, and for a posterior under another prior.
    pub fn with_place(&self, learned: &Posterior, links: &[Link], points_max: usize) -> dgpc::Result<Self> {
        if *learned.prior() != self.prior {
            return Err(dgpc::Error::DifferentPriors { what: "a model and what was learned of its place" });
        }
        let chosen = Candidates::new(self.prior.kernel(), &self.inputs(links)?)?.greedy(points_max).indices;
        let links: Vec<Link> = chosen.into_iter().map(|n| self.as_looked_at(&links[n])).collect();
        let inputs = self.inputs(&links)?;
        let said = learned.summarise(&inputs)?;
        let (precision, shift) = (said.whitened_precision().clone(), said.whitened_shift().to_vec());
        let place = Place::new(&self.prior, links, &inputs, precision, shift)?;
        Ok(Self { schema: MODEL_SCHEMA, place: Some(Arc::new(place)), ..self.clone() })
    }

    /// The link as far as the model looks at it: with depths, of which an unknown one counts as 0, or without.
    fn as_looked_at(&self, link: &Link) -> Link {
        let end = |end: Position| {
            let depth_m = self.inputs.has_depths().then_some(end.depth_m.unwrap_or(0.0));
            Position { depth_m, ..end }
        };
        Link { transmitter: end(link.transmitter), receiver: end(link.receiver) }
    }

    /// What is known before any event: the prior, and the place.
    pub fn known_before(&self) -> Posterior {
        let prior_alone = || Posterior::prior_alone(&self.prior, self.inputs.dimension());
        self.place.as_ref().map_or_else(prior_alone, |place| place.posterior().clone())
    }

    /// What is known of the place, as a message.
    pub(crate) fn place_summary(&self) -> Option<&Summary> {
        self.place.as_ref().map(|place| place.summary())
    }

    /// Geometric mean of the length-scales of its first term's first correlation, in metres: how far what is seen of
    /// one link says something of others.
    pub fn length_scale_m(&self) -> f64 {
        let terms = self.prior.kernel().terms();
        let length_scales = terms.first().map_or(&[][..], |term| term.correlations()[0].length_scales());
        (length_scales.iter().map(|length_scale| length_scale.ln()).sum::<f64>() / length_scales.len().max(1) as f64)
            .exp()
    }

    /// The events as the method sees them, each with its weight among them ([`Fading::weights`]).
    ///
    /// # Errors
    /// [`dgpc::Error::NotFinite`] with row and column of the first NaN or infinity.
    pub fn observations<'a>(&self, events: impl IntoIterator<Item = &'a Event>) -> dgpc::Result<Observations> {
        let events: Vec<&Event> = events.into_iter().collect();
        let outcomes = events.iter().map(|event| event.success).collect();
        let inputs = self.inputs(events.iter().map(|event| event.attempt()))?;
        Observations::weighted(inputs, outcomes, self.fading.weights(&events))
    }

    /// Some of these events, by their places, each with its weight among all of them: those of each pair of vehicles come in canonical
    /// order.
    ///
    /// # Errors
    /// As [`Model::observations`].
    pub(crate) fn observations_among(&self, events: &[&Event], places: &[usize]) -> dgpc::Result<Observations> {
        let inputs = self.inputs(places.iter().map(|&place| events[place].attempt()))?;
        let outcomes = places.iter().map(|&place| events[place].success).collect();
        let weight = |&place: &usize| self.fading.weight(events[place], events[..place].iter().rev().copied());
        Observations::weighted(inputs, outcomes, places.iter().map(weight).collect())
    }

    /// One event, with its weight beside earlier ones of the same receiver, the latest first.
    ///
    /// # Errors
    /// As [`Model::observations`].
    pub(crate) fn observation_beside<'a>(
        &self,
        event: &Event,
        earlier: impl Iterator<Item = &'a Event>,
    ) -> dgpc::Result<Observations> {
        let weight = self.fading.weight(event, earlier);
        Observations::weighted(self.inputs([event.attempt()])?, vec![event.success], vec![weight])
    }

    /// A model with one isotropic kernel term over all inputs, reciprocal or not, and a zero prior mean.
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

    /// The inputs of links or attempts: one row each, as [`InputSpec`] says, about the chart's origin.
    ///
    /// # Errors
    /// [`dgpc::Error::NotFinite`] with row and column of the first NaN or infinity.
    pub fn inputs(&self, attempts: impl IntoIterator<Item = impl Into<Attempt>>) -> dgpc::Result<Inputs> {
        let (mut values, mut ends) = (Vec::new(), Vec::with_capacity(6));
        for attempt in attempts {
            let attempt: Attempt = attempt.into();
            ends.clear();
            for end in attempt.link.ends() {
                let (east_m, north_m) = self.chart.local_m(&end);
                ends.extend([east_m, north_m]);
                if self.inputs.has_depths() {
                    ends.push(end.depth_m.unwrap_or(0.0));
                }
            }
            self.inputs.append_row(&ends, &attempt, &mut values);
        }
        Inputs::new(values, self.inputs.dimension())
    }
}
