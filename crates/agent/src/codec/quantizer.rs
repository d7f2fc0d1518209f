//! Quantises summaries to the levels of a packet, and back (docs/method/packets.md).
//!
//! Every combination of levels is a positive semi-definite Ĝ. Its diagonal is positive, and any partial correlations
//! between −1 and 1 give a correlation matrix.

use dgpc::{Candidates, DISTINCT_SHARE, Inputs, Matrix, Summary, spread_out};
use pingmap_packet::{Block, CORRELATION_LEVELS, INFORMATION_LEVELS, Layout, MEAN_LEVELS, Point, TIME_CELLS};

use crate::model::link_model::Model;
use crate::team::config::Team;
use crate::team::grid::Grid;
use crate::types::event::{Event, Link};
use crate::types::query::{Kind, LinkQuery, Time, Vehicle};

/// Whitened precision at the lowest and at the highest information level. Successive levels differ by a constant
/// factor.
const INFORMATION_RANGE: (f64, f64) = (0.02, 1000.0);

/// Step of the lower levels of the whitened mean. The three highest levels are [`FAR_MEANS`], for a prior mean that is
/// far off. Larger means are clipped; later packets transmit the rest.
const MEAN_STEP: f64 = 1.0 / 6.0;

/// Mean level above which a point is sent even if it has no information.
const FAR_MEAN_LEVEL: i8 = 6;

/// Whitened means at the three highest levels.
const FAR_MEANS: [f64; 3] = [3.2, 6.0, 12.0];

/// Partial correlations at levels from 1 up.
const CORRELATIONS: [f64; CORRELATION_LEVELS as usize] = [0.3, 0.6, 0.93];

/// Share of its prior variance that a point must keep, given the points before it, for a receiver to accept it. It is
/// half of the share that a sender requires, so that rounding differences between machines refuse no packet.
const RECEIVER_DISTINCT_SHARE: f64 = 0.5 * DISTINCT_SHARE;

/// Converts between summaries and blocks of cells and levels, under one model and grid.
#[derive(Debug, Clone, Copy)]
pub struct SummaryQuantizer<'a> {
    pub(crate) model: &'a Model,
    pub(crate) grid: &'a Grid,
    /// Receiver of the links: the sender of the packet.
    pub(crate) receiver: Vehicle,
}

impl Team {
    /// Returns the quantizer of the team, for a typical receiver.
    pub fn quantizer(&self) -> SummaryQuantizer<'_> {
        SummaryQuantizer { model: &self.model, grid: &self.grid, receiver: Vehicle::Typical }
    }

    /// Returns the quantizer of the packets of this member. They describe the links that it receives over.
    pub fn quantizer_of(&self, sender: u8) -> SummaryQuantizer<'_> {
        SummaryQuantizer { receiver: self.members.get(&sender).map_or(Vehicle::New, Vehicle::from), ..self.quantizer() }
    }

    /// Returns the candidates for inducing points of a vehicle with these events: their links within the grid, for a
    /// typical transmitter and kind of message, spread over time if they exceed
    /// [`Limits::candidates_max`](crate::Limits::candidates_max).
    pub fn candidates<'a>(&self, events: impl IntoIterator<Item = &'a Event>) -> Vec<LinkQuery> {
        let quantizer = self.quantizer();
        let held: Vec<&Event> = events.into_iter().filter(|event| quantizer.holds(&event.link)).collect();
        let spread = spread_out(held.len(), self.limits.candidates_max).into_iter();
        let typical = |query| LinkQuery { transmitter: Vehicle::Typical, kind: Kind::Typical, ..query };
        spread.map(|place| typical(held[place].query())).collect()
    }
}

impl SummaryQuantizer<'_> {
    /// Returns whether the grid contains both ends of a link. Depths are ignored if the model has none.
    pub fn holds(&self, link: &Link) -> bool {
        self.point(link).is_some()
    }

    /// Encodes a block with inducing points at these links in a time cell. Returns the block and the summary that it
    /// decodes to.
    ///
    /// `summarize` returns the summary at some inputs. Links outside the grid are omitted, and of the others only as
    /// many are used as a block has points. Links with equal cells, or that the kernel cannot distinguish, are used
    /// once. Points below the lowest information level are omitted, and `summarize` is called again for the others.
    /// Returns `None` if no point remains.
    ///
    /// # Errors
    /// Errors of `summarize`, and errors as of [`SummaryQuantizer::decode`].
    pub fn encode(
        &self,
        layout: &Layout,
        time: u8,
        links: &[Link],
        summarize: &dyn Fn(&Inputs) -> dgpc::Result<Summary>,
    ) -> dgpc::Result<Option<(Block, Summary)>> {
        let mut points: Vec<Point> = links.iter().filter_map(|link| self.point(link)).take(layout.points).collect();
        let distinct =
            Candidates::new(self.model.prior.kernel(), &self.inputs(time, &points)?)?.distinct(DISTINCT_SHARE);
        points = distinct.iter().map(|&index| points[index]).collect();
        // Omitting a point changes the summary at the others.
        while !points.is_empty() {
            let summary = summarize(&self.inputs(time, &points)?)?;
            let levels = point_levels(&summary)?;
            let is_present: Vec<bool> = levels.iter().map(|&(information, _)| information > 0).collect();
            if is_present.iter().all(|&is_present| is_present) {
                for (point, &(information, mean)) in points.iter_mut().zip(&levels) {
                    (point.information, point.mean) = (information, mean);
                }
                let correlations = correlation_levels(&summary);
                let mut block = Block { time, ..Block::empty(layout) };
                block.points[..points.len()].copy_from_slice(&points);
                block.correlations[..correlations.len()].copy_from_slice(&correlations);
                let decoded = self.decode(&block)?;
                return Ok(Some((block, decoded)));
            }
            let mut flags = is_present.into_iter();
            points.retain(|_| flags.next().unwrap_or(false));
        }
        Ok(None)
    }

    /// Returns the summary that a block encodes. Points of information level 0 are absent.
    ///
    /// # Errors
    /// * [`dgpc::Error::SizeMismatch`] if the number of correlations is not the number of pairs of points.
    /// * [`dgpc::Error::OutOfRange`] for a level that no packet can carry.
    /// * [`dgpc::Error::NotPositiveDefinite`] if points coincide, or are so close that the kernel cannot distinguish
    ///   them. No correct sender sends such points. Fused with other data they would be lost in rounding.
    pub fn decode(&self, block: &Block) -> dgpc::Result<Summary> {
        check_levels(block)?;
        let present: Vec<usize> =
            (0..block.points.len()).filter(|&index| block.points[index].information > 0).collect();
        let points: Vec<Point> = present.iter().map(|&index| block.points[index]).collect();
        let inputs = self.inputs(block.time, &points)?;
        let distinct = Candidates::new(self.model.prior.kernel(), &inputs)?.distinct(RECEIVER_DISTINCT_SHARE);
        if let Some(pivot) = (0..points.len()).find(|index| !distinct.contains(index)) {
            let (what, size) = ("covariance of a packet's points", points.len());
            return Err(dgpc::Error::NotPositiveDefinite { what, pivot, size, jitter: 0.0 });
        }
        let root: Vec<f64> = points.iter().map(|point| information_at(point.information).sqrt()).collect();
        let partial = |i: usize, j: usize| correlation_at(block.correlations[pair_index(present[i], present[j])]);
        let rows = correlation_factor(points.len(), partial);
        let precision = Matrix::from_fn(points.len(), points.len(), |i, j| {
            rows[i].iter().zip(&rows[j]).map(|(a, b)| a * b).sum::<f64>() * root[i] * root[j]
        });
        // b̂ = (I + Ĝ)μ̂.
        let mean: Vec<f64> = points.iter().map(|point| mean_at(point.mean)).collect();
        let shift = (0..points.len())
            .map(|i| mean[i] + (0..points.len()).map(|j| precision[(i, j)] * mean[j]).sum::<f64>())
            .collect();
        Summary::from_whitened(&self.model.prior, &inputs, precision, shift)
    }

    /// Returns the links between the centres of the cells of these points.
    pub fn links(&self, points: &[Point]) -> Vec<Link> {
        let (chart, has_depth) = (&self.model.chart, self.model.inputs.has_depths());
        let position = |cell| self.grid.position(chart, cell, has_depth);
        let link =
            |point: &Point| Link { transmitter: position(point.transmitter), receiver: position(point.receiver) };
        points.iter().map(link).collect()
    }

    /// Returns the query of an inducing point: a typical transmitter, the quantizer's receiver, and the middle of a
    /// time cell.
    pub fn query(&self, time: u8, link: Link) -> LinkQuery {
        LinkQuery { receiver: self.receiver, when: self.grid.when(time), ..LinkQuery::from(link) }
    }

    /// Returns the time cell for a block about these queries: the cell of their median time, or 0 if none has a time.
    pub fn time_of<'a>(&self, queries: impl IntoIterator<Item = &'a LinkQuery>) -> u8 {
        let time_s = |query: &LinkQuery| if let Time::At(time_s) = query.when { Some(time_s) } else { None };
        let mut times_s: Vec<f64> = queries.into_iter().filter_map(time_s).collect();
        times_s.sort_by(f64::total_cmp);
        times_s.get(times_s.len() / 2).map_or(0, |&middle_s| self.grid.time_cell(middle_s))
    }

    /// Returns the queries of the points that a block contains. Points of information level 0 are absent.
    pub fn queries(&self, block: &Block) -> Vec<LinkQuery> {
        let present: Vec<Point> = block.points.iter().filter(|point| point.information > 0).copied().collect();
        self.links(&present).into_iter().map(|link| self.query(block.time, link)).collect()
    }

    /// Returns the link between the centres of the cells of a link; `None` outside the grid.
    pub fn rounded(&self, link: &Link) -> Option<Link> {
        self.links(&[self.point(link)?]).pop()
    }

    fn inputs(&self, time: u8, points: &[Point]) -> dgpc::Result<Inputs> {
        self.model.inputs(self.links(points).into_iter().map(|link| self.query(time, link)))
    }

    /// Returns a point with the cells of a link and without information; `None` outside the grid.
    fn point(&self, link: &Link) -> Option<Point> {
        let mut link = *link;
        if !self.model.inputs.has_depths() {
            (link.transmitter.depth_m, link.receiver.depth_m) = (None, None);
        }
        let [transmitter, receiver] = self.grid.cells(&self.model.chart, &link)?;
        Some(Point { transmitter, receiver, ..Point::default() })
    }
}

/// Checks that a block has one correlation for each pair of points, and that each quantised value fits its field in the
/// packet.
fn check_levels(block: &Block) -> dgpc::Result<()> {
    let points = block.points.len();
    let (expected, found) = (points * points.saturating_sub(1) / 2, block.correlations.len());
    if expected != found {
        return Err(dgpc::Error::SizeMismatch {
            what: "correlations of a block, one per pair of points",
            expected,
            found,
        });
    }
    let level = |what, expected, value: i16| dgpc::Error::OutOfRange { what, expected, value: value.into() };
    for point in &block.points {
        if point.information >= INFORMATION_LEVELS {
            return Err(level("level of information", "below 32", point.information.into()));
        }
        if point.mean.unsigned_abs() > MEAN_LEVELS.unsigned_abs() {
            return Err(level("level of the mean", "from -15 to 15", point.mean.into()));
        }
    }
    if block.time >= TIME_CELLS {
        return Err(level("cell of time", "below 64", block.time.into()));
    }
    match block.correlations.iter().find(|level| level.unsigned_abs() > CORRELATION_LEVELS.unsigned_abs()) {
        Some(&correlation) => Err(level("level of a correlation", "from -3 to 3", correlation.into())),
        None => Ok(()),
    }
}

/// Returns the information level and the mean level of every point.
fn point_levels(summary: &Summary) -> dgpc::Result<Vec<(u8, i8)>> {
    let precision = summary.whitened_precision();
    let mean = summary.whitened_mean()?;
    let of_point = |i: usize| {
        let (information, mean) = (information_level(precision[(i, i)]), mean_level(mean[i]));
        // A point of level 0 is absent, so a large mean needs the lowest information level.
        (if mean.abs() > FAR_MEAN_LEVEL { information.max(1) } else { information }, mean)
    };
    Ok((0..summary.len()).map(of_point).collect())
}

fn correlation_levels(summary: &Summary) -> Vec<i8> {
    partial_correlations(summary.whitened_precision()).into_iter().map(correlation_level).collect()
}

fn correlation_at(level: i8) -> f64 {
    let index = usize::from(level.unsigned_abs()).checked_sub(1);
    let size = index.map_or(0.0, |index| CORRELATIONS[index.min(CORRELATIONS.len() - 1)]);
    size.copysign(f64::from(level))
}

fn correlation_level(partial: f64) -> i8 {
    let error = |level: &i8| (correlation_at(*level) - partial).abs();
    (-CORRELATION_LEVELS..=CORRELATION_LEVELS).min_by(|a, b| error(a).total_cmp(&error(b))).unwrap_or(0)
}

/// Returns the index of the pair (i, j), i > j, among the correlations of a block.
fn pair_index(i: usize, j: usize) -> usize {
    i * (i - 1) / 2 + j
}

/// Returns the whitened precision at a level from 1 up.
fn information_at(level: u8) -> f64 {
    let (low, high) = INFORMATION_RANGE;
    low * (high / low).powf(f64::from(level - 1) / f64::from(INFORMATION_LEVELS - 2))
}

/// Returns the nearest level of a whitened precision; 0 for a precision well below the lowest level.
fn information_level(value: f64) -> u8 {
    let (low, high) = INFORMATION_RANGE;
    if value < low / 1.4 {
        return 0;
    }
    let steps = f64::from(INFORMATION_LEVELS - 2);
    1 + ((value / low).ln() / (high / low).ln() * steps).round().clamp(0.0, steps) as u8
}

fn mean_at(level: i8) -> f64 {
    let steps = level.unsigned_abs();
    let size = match usize::from(steps).checked_sub(usize::from(MEAN_LEVELS.unsigned_abs()) + 1 - FAR_MEANS.len()) {
        Some(far) => FAR_MEANS[far.min(FAR_MEANS.len() - 1)],
        None => f64::from(steps) * MEAN_STEP,
    };
    size.copysign(f64::from(level))
}

fn mean_level(value: f64) -> i8 {
    let error = |level: &i8| (mean_at(*level) - value.abs()).abs();
    let nearest = (0..=MEAN_LEVELS).min_by(|a, b| error(a).total_cmp(&error(b))).unwrap_or(0);
    if value < 0.0 { -nearest } else { nearest }
}

/// Returns the rows of the Cholesky factor of the correlation matrix with these partial correlations.
fn correlation_factor(size: usize, partial: impl Fn(usize, usize) -> f64) -> Vec<Vec<f64>> {
    let row = |i: usize| {
        let mut remainder = 1.0f64;
        let mut row = vec![0.0; size];
        for (j, entry) in row.iter_mut().enumerate().take(i) {
            *entry = partial(i, j) * remainder.sqrt();
            remainder = (remainder - *entry * *entry).max(0.0);
        }
        row[i] = remainder.sqrt();
        row
    };
    (0..size).map(row).collect()
}

/// Returns the partial correlations of a positive semi-definite matrix, each given the points before both. They have
/// the order of a block: (2, 1), (3, 1), (3, 2) and so on.
fn partial_correlations(matrix: &Matrix) -> Vec<f64> {
    let size = matrix.rows();
    let mut partials = Vec::new();
    let mut rows: Vec<Vec<f64>> = Vec::new();
    for i in 0..size {
        let mut remainder = 1.0f64;
        let mut row = vec![0.0; size];
        for j in 0..i {
            let scale = (matrix[(i, i)] * matrix[(j, j)]).sqrt();
            let correlation = if scale > 0.0 { matrix[(i, j)] / scale } else { 0.0 };
            let explained: f64 = row[..j].iter().zip(&rows[j]).map(|(a, b)| a * b).sum();
            // Below this limit point j is a linear combination of the points before it, and its partial correlation is
            // undefined.
            let resolved = rows[j][j] > 1e-6;
            row[j] = if resolved { (correlation - explained) / rows[j][j] } else { 0.0 };
            partials.push(if remainder > 1e-9 { (row[j] / remainder.sqrt()).clamp(-1.0, 1.0) } else { 0.0 });
            remainder = (remainder - row[j] * row[j]).max(0.0);
        }
        row[i] = remainder.sqrt();
        rows.push(row);
    }
    partials
}
