//! Summaries as whole numbers and back (docs/method.md, section 8).
//!
//! Every combination of levels is a positive semi-definite Ĝ: its diagonal is positive, and partial correlations
//! between −1 and 1 make a correlation matrix whatever they are.

use dgpc::{Candidates, DISTINCT_SHARE, Inputs, Matrix, Summary};
use pingmap_packet::{Block, CORRELATION_LEVELS, INFORMATION_LEVELS, Layout, MEAN_LEVELS, Point, TIME_CELLS};

use crate::attempt::{Attempt, Party, When};
use crate::event::Link;
use crate::grid::Grid;
use crate::model::Model;

/// Whitened precision at the lowest and the highest level of information; levels between are a constant factor apart.
const INFORMATION: (f64, f64) = (0.02, 1000.0);

/// A whitened mean goes up to 2 in steps of a sixth, and then in long ones, so that a prior that was far off can be set
/// right. More is cut off, and told by later packets.
const MEAN_STEP: f64 = 1.0 / 6.0;

/// A mean beyond this level is told even where there is no information to tell.
const MEAN_FAR: i8 = 6;

/// Whitened means at the highest levels.
const MEANS_FAR: [f64; 3] = [3.2, 6.0, 12.0];

/// Partial correlations at levels from 1 up.
const CORRELATIONS: [f64; CORRELATION_LEVELS as usize] = [0.3, 0.6, 0.93];

/// Points are taken as distinct by a receiver down to this share of their prior variance, half of what a sender wants, so
/// that a difference in the last bit between two machines never turns a packet away.
const RECEIVED_SHARE: f64 = 0.5 * DISTINCT_SHARE;

/// What the numbers of a packet mean: the way between summaries and blocks of cells and levels.
#[derive(Debug, Clone, Copy)]
pub struct Wire<'a> {
    pub(crate) model: &'a Model,
    pub(crate) grid: &'a Grid,
    /// Who hears what is spoken of: the sender.
    pub(crate) receiver: Party,
}

impl Wire<'_> {
    /// Whether a link is within the grid. Depth counts only where the model looks at it.
    pub fn holds(&self, link: &Link) -> bool {
        self.point(link).is_some()
    }

    /// A block for what `say` says of these links in a cell of time, and the summary that it decodes to. Links beyond the grid and links
    /// that come together in a cell, or that the kernel cannot tell apart, are left out. `None` where nothing is left
    /// to say.
    ///
    /// # Errors
    /// What `say` refuses, and as [`Wire::decode`].
    pub fn encode(
        &self,
        layout: &Layout,
        time: u8,
        links: &[Link],
        say: &dyn Fn(&Inputs) -> dgpc::Result<Summary>,
    ) -> dgpc::Result<Option<(Block, Summary)>> {
        let mut points: Vec<Point> = links.iter().filter_map(|link| self.point(link)).take(layout.points).collect();
        let distinct =
            Candidates::new(self.model.prior.kernel(), &self.inputs(time, &points)?)?.distinct(DISTINCT_SHARE);
        points = distinct.iter().map(|&place| points[place]).collect();
        // A point of which too little is said is left out, which changes what is said of the others.
        while !points.is_empty() {
            let summary = say(&self.inputs(time, &points)?)?;
            let levels = levels(&summary)?;
            let said: Vec<bool> = levels.iter().map(|&(information, _)| information > 0).collect();
            if said.iter().all(|&said| said) {
                for (point, &(information, mean)) in points.iter_mut().zip(&levels) {
                    (point.information, point.mean) = (information, mean);
                }
                let correlations = correlation_levels(&summary);
                let mut block = Block { time, ..Block::silent(layout) };
                block.points[..points.len()].copy_from_slice(&points);
                block.correlations[..correlations.len()].copy_from_slice(&correlations);
                let decoded = self.decode(&block)?;
                return Ok(Some((block, decoded)));
            }
            let mut kept = said.iter();
            points.retain(|_| kept.next().copied().unwrap_or(false));
        }
        Ok(None)
    }

    /// The summary that a block stands for. Points without information are not there.
    ///
    /// # Errors
    /// [`dgpc::Error::SizeMismatch`] for another number of correlations than pairs of points,
    /// [`dgpc::Error::OutOfRange`] for a level that no packet can carry, [`dgpc::Error::NotPositiveDefinite`] when
    /// points coincide, or are so close that the kernel cannot tell them apart: no sender says that, and put together
    /// with the rest it would be lost in rounding.
    pub fn decode(&self, block: &Block) -> dgpc::Result<Summary> {
        check_levels(block)?;
        let said: Vec<usize> = (0..block.points.len()).filter(|&place| block.points[place].information > 0).collect();
        let points: Vec<Point> = said.iter().map(|&place| block.points[place]).collect();
        let inputs = self.inputs(block.time, &points)?;
        let distinct = Candidates::new(self.model.prior.kernel(), &inputs)?.distinct(RECEIVED_SHARE);
        if let Some(pivot) = (0..points.len()).find(|place| !distinct.contains(place)) {
            let (what, size) = ("covariance of a packet's points", points.len());
            return Err(dgpc::Error::NotPositiveDefinite { what, pivot, size, jitter: 0.0 });
        }
        let root: Vec<f64> = points.iter().map(|point| information(point.information).sqrt()).collect();
        let partial = |i: usize, j: usize| partial_correlation(block.correlations[pair(said[i], said[j])]);
        let rows = correlation_root(points.len(), partial);
        let precision = Matrix::from_fn(points.len(), points.len(), |i, j| {
            rows[i].iter().zip(&rows[j]).map(|(a, b)| a * b).sum::<f64>() * root[i] * root[j]
        });
        // b̂ = (I + Ĝ)μ̂.
        let mean: Vec<f64> = points.iter().map(|point| mean(point.mean)).collect();
        let shift = (0..points.len())
            .map(|i| mean[i] + (0..points.len()).map(|j| precision[(i, j)] * mean[j]).sum::<f64>())
            .collect();
        Summary::from_whitened(&self.model.prior, &inputs, precision, shift)
    }

    /// The links of these points.
    pub fn links(&self, points: &[Point]) -> Vec<Link> {
        let (chart, has_depth) = (&self.model.chart, self.model.inputs.has_depths());
        let position = |cell| self.grid.position(chart, cell, has_depth);
        let link =
            |point: &Point| Link { transmitter: position(point.transmitter), receiver: position(point.receiver) };
        points.iter().map(link).collect()
    }

    /// What is said of a link in a cell of time: how a typical vehicle is heard over it by the sender then.
    pub fn attempt(&self, time: u8, link: Link) -> Attempt {
        Attempt { receiver: self.receiver, when: self.grid.when(time), ..Attempt::from(link) }
    }

    /// The cell of the time in the middle of all times at which these were tried: what a block about them is said of.
    pub fn time_of<'a>(&self, attempts: impl IntoIterator<Item = &'a Attempt>) -> u8 {
        let time_s = |attempt: &Attempt| if let When::At(time_s) = attempt.when { Some(time_s) } else { None };
        let mut times_s: Vec<f64> = attempts.into_iter().filter_map(time_s).collect();
        times_s.sort_by(f64::total_cmp);
        times_s.get(times_s.len() / 2).map_or(0, |&middle_s| self.grid.time_cell(middle_s))
    }

    /// What a block speaks of: its points of which something is said.
    pub fn attempts(&self, block: &Block) -> Vec<Attempt> {
        let said: Vec<Point> = block.points.iter().filter(|point| point.information > 0).copied().collect();
        self.links(&said).into_iter().map(|link| self.attempt(block.time, link)).collect()
    }

    /// A link between the middles of its cells, if the grid holds it.
    pub fn rounded(&self, link: &Link) -> Option<Link> {
        self.links(&[self.point(link)?]).pop()
    }

    fn inputs(&self, time: u8, points: &[Point]) -> dgpc::Result<Inputs> {
        self.model.inputs(self.links(points).into_iter().map(|link| self.attempt(time, link)))
    }

    /// The cells of a link, with nothing said of it yet.
    fn point(&self, link: &Link) -> Option<Point> {
        let mut link = *link;
        if !self.model.inputs.has_depths() {
            (link.transmitter.depth_m, link.receiver.depth_m) = (None, None);
        }
        let [transmitter, receiver] = self.grid.cells(&self.model.chart, &link)?;
        Some(Point { transmitter, receiver, ..Point::default() })
    }
}

/// Checks that a block has as many correlations as pairs of points, and no level that a packet cannot carry.
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

/// Levels of information and mean of every point.
fn levels(summary: &Summary) -> dgpc::Result<Vec<(u8, i8)>> {
    let precision = summary.whitened_precision();
    let mean = summary.whitened_mean()?;
    let of_point = |i: usize| {
        let (information, mean) = (information_level(precision[(i, i)]), mean_level(mean[i]));
        // A mean that must move far takes the least information along.
        (if mean.abs() > MEAN_FAR { information.max(1) } else { information }, mean)
    };
    Ok((0..summary.len()).map(of_point).collect())
}

/// Levels of the partial correlations between points.
fn correlation_levels(summary: &Summary) -> Vec<i8> {
    partial_correlations(summary.whitened_precision()).into_iter().map(correlation_level).collect()
}

fn partial_correlation(level: i8) -> f64 {
    let place = usize::from(level.unsigned_abs()).checked_sub(1);
    let size = place.map_or(0.0, |place| CORRELATIONS[place.min(CORRELATIONS.len() - 1)]);
    size.copysign(f64::from(level))
}

/// The nearest level.
fn correlation_level(partial: f64) -> i8 {
    let off = |level: &i8| (partial_correlation(*level) - partial).abs();
    (-CORRELATION_LEVELS..=CORRELATION_LEVELS).min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(0)
}

/// The place of the pair (i, j), i > j, among the correlations of a block.
fn pair(i: usize, j: usize) -> usize {
    i * (i - 1) / 2 + j
}

fn information(level: u8) -> f64 {
    let (low, high) = INFORMATION;
    low * (high / low).powf(f64::from(level - 1) / f64::from(INFORMATION_LEVELS - 2))
}

/// The nearest level; 0 below the lowest.
fn information_level(value: f64) -> u8 {
    let (low, high) = INFORMATION;
    if value < low / 1.4 {
        return 0;
    }
    let steps = f64::from(INFORMATION_LEVELS - 2);
    1 + ((value / low).ln() / (high / low).ln() * steps).round().clamp(0.0, steps) as u8
}

fn mean(level: i8) -> f64 {
    let steps = level.unsigned_abs();
    let size = match usize::from(steps).checked_sub(usize::from(MEAN_LEVELS.unsigned_abs()) + 1 - MEANS_FAR.len()) {
        Some(far) => MEANS_FAR[far.min(MEANS_FAR.len() - 1)],
        None => f64::from(steps) * MEAN_STEP,
    };
    size.copysign(f64::from(level))
}

/// The nearest level.
fn mean_level(value: f64) -> i8 {
    let off = |level: &i8| (mean(*level) - value.abs()).abs();
    let nearest = (0..=MEAN_LEVELS).min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(0);
    if value < 0.0 { -nearest } else { nearest }
}

/// Rows of the Cholesky factor of the correlation matrix with these partial correlations.
fn correlation_root(size: usize, partial: impl Fn(usize, usize) -> f64) -> Vec<Vec<f64>> {
    let row = |i: usize| {
        let mut left = 1.0f64;
        let mut row = vec![0.0; size];
        for (j, entry) in row.iter_mut().enumerate().take(i) {
            *entry = partial(i, j) * left.sqrt();
            left = (left - *entry * *entry).max(0.0);
        }
        row[i] = left.sqrt();
        row
    };
    (0..size).map(row).collect()
}

/// The partial correlations of a positive semi-definite matrix, in the order of a block: those of (2, 1), (3, 1), (3,
/// 2) …, each given the points before both.
fn partial_correlations(matrix: &Matrix) -> Vec<f64> {
    let size = matrix.rows();
    let mut partials = Vec::new();
    let mut rows: Vec<Vec<f64>> = Vec::new();
    for i in 0..size {
        let mut left = 1.0f64;
        let mut row = vec![0.0; size];
        for j in 0..i {
            let scale = (matrix[(i, i)] * matrix[(j, j)]).sqrt();
            let correlation = if scale > 0.0 { matrix[(i, j)] / scale } else { 0.0 };
            let explained: f64 = row[..j].iter().zip(&rows[j]).map(|(a, b)| a * b).sum();
            // Below this a point is a combination of those before, and has no correlation of its own.
            let resolved = rows[j][j] > 1e-6;
            row[j] = if resolved { (correlation - explained) / rows[j][j] } else { 0.0 };
            partials.push(if left > 1e-9 { (row[j] / left.sqrt()).clamp(-1.0, 1.0) } else { 0.0 });
            left = (left - row[j] * row[j]).max(0.0);
        }
        row[i] = left.sqrt();
        rows.push(row);
    }
    partials
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn partial_correlations_are_those_that_make_the_matrix() {
        let partials = [0.3, -0.8, 0.55, 0.1, 0.9, -0.4];
        let rows = correlation_root(4, |i, j| partials[pair(i, j)]);
        let scale = [2.0, 0.1, 30.0, 1.0];
        let matrix = Matrix::from_fn(4, 4, |i, j| {
            rows[i].iter().zip(&rows[j]).map(|(a, b)| a * b).sum::<f64>() * scale[i] * scale[j]
        });
        for (found, expected) in partial_correlations(&matrix).iter().zip(partials) {
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        }
    }

    #[test]
    fn levels_of_correlations_are_their_own_nearest() {
        for level in -CORRELATION_LEVELS..=CORRELATION_LEVELS {
            assert_eq!(correlation_level(partial_correlation(level)), level);
        }
        assert_eq!((correlation_level(1.0), correlation_level(-1.0)), (CORRELATION_LEVELS, -CORRELATION_LEVELS));
    }

    #[test]
    fn levels_of_the_mean_are_their_own_nearest() {
        for level in -MEAN_LEVELS..=MEAN_LEVELS {
            assert_eq!(mean_level(mean(level)), level);
        }
        assert_eq!((mean_level(1e9), mean_level(-1e9)), (MEAN_LEVELS, -MEAN_LEVELS));
    }

    #[test]
    fn levels_of_information_are_their_own_nearest() {
        for level in 1..INFORMATION_LEVELS {
            assert_eq!(information_level(information(level)), level);
        }
        assert_eq!(information_level(0.0), 0);
        assert_eq!(information_level(1e9), INFORMATION_LEVELS - 1);
    }
}
