//! The input columns of a query.

use std::f64::consts::FRAC_1_SQRT_2;
use std::ops::Range;

use dgpc::{Correlation, Kernel, Prior, PriorMean, Reflection, Term};

use crate::types::event::Position;
use crate::types::query::LinkQuery;

/// Label of an end whose heading is unknown.
const UNKNOWN_HEADING: f64 = -1.0;

/// An end of a link.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// The end that transmits.
    Transmitter,
    /// The end that receives.
    Receiver,
}

/// The unit of a length-scale.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LengthUnit {
    /// Metres, for positions, depths and ranges.
    Metres,
    /// Seconds, for the time.
    Seconds,
    /// Chords of the unit circle, for aspects.
    Chords,
}

/// The input columns of a query: raw positions, and quantities computed from them. Kernel terms use a subset of the
/// columns.
///
/// | columns | meaning |
/// |---|---|
/// | `tx_…`, `rx_…` | both ends, in metres about the chart's origin: east, north (and depth) |
/// | `u_…` | (tx + rx)/√2: the location of the link |
/// | `v_…` | (tx − rx)/√2: direction and length of the link; swapping the ends changes the sign |
/// | `range` | distance between the ends, in metres |
/// | `time`, `water` | time in seconds, and a label that is negative at a typical time ([`crate::Time`]) |
/// | `tx_vehicle`, `rx_vehicle` | labels of the vehicles ([`crate::Vehicle`]) |
/// | `kind` | label of the message kind ([`crate::Kind`]) |
/// | `tx_ahead`, `tx_starboard` | cos and sin of the receiver's bearing from the bow of the transmitter |
/// | `rx_ahead`, `rx_starboard` | cos and sin of the transmitter's bearing from the bow of the receiver |
/// | `tx_heading`, `rx_heading` | labels that are negative where the heading of the end is unknown |
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InputSpec {
    /// East and north of each end. There are twenty columns.
    Positions,
    /// East, north and depth of each end. There are twenty-four columns. An unknown depth counts as 0.
    PositionsAndDepths,
}

impl InputSpec {
    /// Returns the number of columns.
    pub fn dimension(self) -> usize {
        self.aspect(End::Receiver).end + 2
    }

    /// Returns true if the columns include depths.
    pub fn has_depths(self) -> bool {
        self == InputSpec::PositionsAndDepths
    }

    /// Returns the names of the columns, in order.
    pub fn column_names(self) -> Vec<String> {
        let axes = &["east", "north", "depth"][..self.dimension_of_an_end()];
        let groups = ["tx", "rx", "u", "v"].iter();
        let names = groups.flat_map(|group| axes.iter().map(move |axis| format!("{group}_{axis}")));
        let others = ["range", "time", "water", "tx_vehicle", "rx_vehicle", "kind"].into_iter();
        let aspects = ["tx_ahead", "tx_starboard", "rx_ahead", "rx_starboard", "tx_heading", "rx_heading"];
        names.chain(others.chain(aspects).map(str::to_owned)).collect()
    }

    /// Returns the columns of the transmitter's position.
    pub fn transmitter(self) -> Range<usize> {
        self.group(0)
    }

    /// Returns the columns of the receiver's position.
    pub fn receiver(self) -> Range<usize> {
        self.group(1)
    }

    /// Returns the columns of both positions. All other position columns follow from these.
    pub fn ends(self) -> Range<usize> {
        0..self.group(1).end
    }

    /// Returns the columns of the link coordinates, u before v.
    pub fn link_coordinates(self) -> Range<usize> {
        self.group(2).start..self.group(3).end
    }

    /// Returns true for the column of a depth, or of a sum or difference of depths.
    pub fn is_depth(self, column: usize) -> bool {
        self.has_depths() && column < self.range() && column % 3 == 2
    }

    /// Returns the columns of the depths u and v of a link. There are none without depths.
    pub fn link_depths(self) -> impl Iterator<Item = usize> {
        self.link_coordinates().filter(move |&column| self.is_depth(column))
    }

    /// Returns the column of the distance between the ends, in metres.
    pub fn range(self) -> usize {
        4 * self.dimension_of_an_end()
    }

    /// Returns the column of the time, in seconds.
    pub fn time(self) -> usize {
        self.range() + 1
    }

    /// Returns the column of the label of the water, which is negative at a typical time.
    pub fn water(self) -> usize {
        self.range() + 2
    }

    /// Returns the column of the transmitter's label.
    pub fn transmitting_vehicle(self) -> usize {
        self.range() + 3
    }

    /// Returns the column of the receiver's label.
    pub fn receiving_vehicle(self) -> usize {
        self.range() + 4
    }

    /// Returns the column of the label of the message kind.
    pub fn kind(self) -> usize {
        self.range() + 5
    }

    /// Returns the columns of the direction of the other end, as seen from `end`: ahead and starboard.
    pub fn aspect(self, end: End) -> Range<usize> {
        let first = self.kind() + 1 + 2 * end as usize;
        first..first + 2
    }

    /// Returns the unit of the length-scales of these columns, which are no labels.
    pub fn length_unit(self, columns: &[usize]) -> LengthUnit {
        let aspects = self.aspect(End::Transmitter).start..self.aspect(End::Receiver).end;
        match () {
            () if columns.iter().all(|&column| column == self.time()) => LengthUnit::Seconds,
            () if columns.iter().all(|column| aspects.contains(column)) => LengthUnit::Chords,
            () => LengthUnit::Metres,
        }
    }

    /// Returns true if a term of this kernel depends on the aspect of this end.
    pub fn is_aspect_in(self, kernel: &Kernel, end: End) -> bool {
        let correlations = kernel.terms().iter().flat_map(Term::correlations);
        correlations.flat_map(Correlation::columns).any(|column| self.aspect(end).contains(column))
    }

    /// Returns the column of the label that is negative where the heading of `end` is unknown.
    pub fn heading(self, end: End) -> usize {
        self.aspect(End::Receiver).end + end as usize
    }

    /// Returns the columns of one group of position columns. Groups 0 to 3 are tx, rx, u and v.
    fn group(self, index: usize) -> Range<usize> {
        let width = self.dimension_of_an_end();
        index * width..(index + 1) * width
    }

    fn dimension_of_an_end(self) -> usize {
        match self {
            InputSpec::Positions => 2,
            InputSpec::PositionsAndDepths => 3,
        }
    }

    /// Returns the reflection of the columns that swaps the two ends.
    ///
    /// # Errors
    /// Never fails in practice, because no column occurs twice.
    pub fn swap_ends(self) -> dgpc::Result<Reflection> {
        let pairs: Vec<(usize, usize)> = self.transmitter().zip(self.receiver()).collect();
        Reflection::swap(&pairs)?.and_negate(&self.group(3).collect::<Vec<_>>())
    }

    /// Returns a prior mean that decreases with the distance between the ends, in log-odds.
    ///
    /// # Errors
    /// [`dgpc::Error::NotFinite`] for parameters that are not finite.
    pub fn range_mean(self, intercept: f64, slope_per_m: f64) -> dgpc::Result<PriorMean> {
        let columns = |range: Range<usize>| range.collect::<Vec<_>>();
        PriorMean::range(intercept, slope_per_m, &columns(self.transmitter()), &columns(self.receiver()))
    }

    /// Converts a prior over these columns to a prior over columns of equal names in `other`, which must have them all.
    pub(crate) fn converted_prior(self, prior: &Prior, other: InputSpec) -> dgpc::Result<Prior> {
        let (names, other_names) = (self.column_names(), other.column_names());
        let column = |&column: &usize| other_names.iter().position(|name| names.get(column) == Some(name));
        let correlation = |correlation: &Correlation| {
            let columns: Vec<usize> = correlation.columns().iter().filter_map(column).collect();
            match correlation.shape().is_of_labels() {
                true => Correlation::of_labels(&columns),
                false => Correlation::new(correlation.shape(), &columns, correlation.length_scales())?
                    .tied(correlation.ties()),
            }
        };
        let term = |term: &Term| {
            let mut correlations = term.correlations().iter().map(correlation);
            // A term has at least one correlation.
            let first = correlations.next().unwrap_or_else(|| Correlation::of_labels(&[]))?;
            let product = correlations.try_fold(Term::of(term.variance(), first)?, |term, next| term.times(next?))?;
            match term.reciprocity() {
                0.0 => Ok(product),
                reciprocity => product.partly_reciprocal(other.swap_ends()?, reciprocity),
            }
        };
        let kernel = Kernel::new(prior.kernel().terms().iter().map(term).collect::<dgpc::Result<_>>()?)?;
        let mean = match prior.mean() {
            PriorMean::Range(range) => other.range_mean(range.intercept(), range.slope())?,
            constant => constant.clone(),
        };
        Prior::new(kernel, mean)
    }

    /// Appends the columns of a query to `values`. `ends` holds the coordinates of both ends.
    pub(crate) fn append_row(self, ends: &[f64], query: &LinkQuery, values: &mut Vec<f64>) {
        let (transmitter, receiver) = ends.split_at(self.dimension_of_an_end());
        let pairs = || transmitter.iter().zip(receiver);
        values.extend(ends);
        values.extend(pairs().map(|(t, r)| (t + r) * FRAC_1_SQRT_2));
        values.extend(pairs().map(|(t, r)| (t - r) * FRAC_1_SQRT_2));
        values.push(pairs().map(|(t, r)| (t - r) * (t - r)).sum::<f64>().sqrt());
        values.extend(query.when.columns());
        values.extend([query.transmitter.label(), query.receiver.label(), query.kind.label()]);
        let link = query.link;
        let aspects = [aspect(&link.transmitter, &link.receiver), aspect(&link.receiver, &link.transmitter)];
        values.extend(aspects.iter().flat_map(|aspect| aspect.unwrap_or_default()));
        values.extend(aspects.iter().map(|aspect| if aspect.is_some() { 0.0 } else { UNKNOWN_HEADING }));
    }
}

/// Returns the direction of `other` as seen from a vehicle at `end`: cos and sin of its clockwise bearing from the bow.
/// Returns `None` if the heading is unknown, or if one end is above the other.
fn aspect(end: &Position, other: &Position) -> Option<[f64; 2]> {
    let (east_m, north_m) = (other.east_m - end.east_m, other.north_m - end.north_m);
    let range_m = east_m.hypot(north_m);
    let (sin, cos) = end.heading_deg?.to_radians().sin_cos();
    (range_m > 0.0).then(|| [(north_m * cos + east_m * sin) / range_m, (east_m * cos - north_m * sin) / range_m])
}
