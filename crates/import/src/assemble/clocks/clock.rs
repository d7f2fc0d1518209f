//! Clock models and their robust fit to comparisons between pairs of clocks.

use crate::assemble::median::median;

/// Smallest number of comparisons from which a drift is estimated. With fewer, the offset is constant.
const DRIFT_COMPARISONS_MIN: usize = 8;

/// A drift is estimated from comparisons over at least this span, in seconds.
const DRIFT_SPAN_S_MIN: f64 = 600.0;

/// Largest number of rounds of [`fit`]; each round fits every clock once.
const ROUNDS_MAX: usize = 200;

/// [`fit`] has converged if no offset changes by more than this, in seconds.
const CHANGE_S_MAX: f64 = 1e-6;

/// Lower limit of the residual up to which a comparison has full weight, in seconds.
const FULL_WEIGHT_S_MIN: f64 = 1e-3;

/// The offset of a clock against the reference clock: linear in time between the times at which the clock was set.
#[derive(Debug, Clone, PartialEq)]
pub struct Clock {
    /// Start of each segment by this clock, and the segment.
    segments: Vec<(f64, ClockSegment)>,
    /// Whether any comparison determines the offset.
    pub is_determined: bool,
}

/// The offset of a clock between two times at which it was set.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ClockSegment {
    /// Time by this clock at which `offset_s` holds.
    pub middle_s: f64,
    /// Offset against the reference clock, in seconds; positive if this clock is ahead.
    pub offset_s: f64,
    /// Change of the offset, in seconds per second.
    pub drift: f64,
}

impl ClockSegment {
    pub(crate) fn offset_at_s(&self, time_s: f64) -> f64 {
        self.offset_s + self.drift * (time_s - self.middle_s)
    }
}

impl Clock {
    /// Returns a clock with one offset in all segments, and a new segment at each time in `sync_times_s`.
    pub(crate) fn constant(offset_s: f64, sync_times_s: &[f64], is_determined: bool) -> Self {
        let segment = ClockSegment { offset_s, ..ClockSegment::default() };
        let starts = [f64::NEG_INFINITY].into_iter().chain(sync_times_s.iter().copied());
        Self { segments: starts.map(|start_s| (start_s, segment)).collect(), is_determined }
    }

    /// Returns the offset at the moment when this clock shows `time_s`, in seconds.
    pub fn offset_s(&self, time_s: f64) -> f64 {
        self.segments[self.segment_index(time_s)].1.offset_at_s(time_s)
    }

    /// Returns the segments in the order of time.
    pub fn segments(&self) -> impl Iterator<Item = &ClockSegment> {
        self.segments.iter().map(|(_, segment)| segment)
    }

    fn segment_index(&self, time_s: f64) -> usize {
        self.segments.partition_point(|(start_s, _)| *start_s <= time_s).saturating_sub(1)
    }

    /// Returns the offset that each comparison implies for this clock, by segment: the time by this clock, and the
    /// offset.
    ///
    /// `index` is the index of this clock in `clocks`. Comparisons without this clock are ignored.
    pub(crate) fn implied_offsets(
        &self,
        index: usize,
        comparisons: &[Comparison],
        clocks: &[Clock],
    ) -> Vec<Vec<(f64, f64)>> {
        let mut points = vec![Vec::new(); self.segments.len()];
        for comparison in comparisons {
            let Comparison { start, arrival } = *comparison;
            let (time_s, offset_s) = match (start.0 == index, arrival.0 == index) {
                (false, true) => (arrival.1, comparison.difference_s() + clocks[start.0].offset_s(start.1)),
                (true, false) => (start.1, clocks[arrival.0].offset_s(arrival.1) - comparison.difference_s()),
                _ => continue,
            };
            points[self.segment_index(time_s)].push((time_s, offset_s));
        }
        points
    }

    /// Divides the segment that contains a time by this clock, and sets a constant offset before and after it.
    pub(crate) fn divide_segment(&mut self, time_s: f64, before_s: f64, after_s: f64) {
        let index = self.segment_index(time_s);
        self.segments.insert(index + 1, (time_s, ClockSegment { offset_s: after_s, ..ClockSegment::default() }));
        self.set_offset(index, before_s);
    }

    /// Adds `change_s` to the offsets of all segments.
    pub(crate) fn shift(&mut self, change_s: f64) {
        self.segments.iter_mut().for_each(|(_, segment)| segment.offset_s += change_s);
    }

    /// Sets a constant offset in one segment.
    pub(crate) fn set_offset(&mut self, segment: usize, offset_s: f64) {
        self.segments[segment].1 = ClockSegment { offset_s, ..ClockSegment::default() };
    }
}

/// One message by the clocks of its sender and its receiver, without the travel time of sound and the recording delay.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Comparison {
    /// Index of the clock at the start of the message, and its reading in seconds.
    pub(crate) start: (usize, f64),
    /// Index of the clock at the reception, and its reading in seconds.
    pub(crate) arrival: (usize, f64),
}

impl Comparison {
    pub(crate) fn difference_s(&self) -> f64 {
        self.arrival.1 - self.start.1
    }

    /// Returns the time of the start and the difference, in seconds.
    pub(crate) fn point(&self) -> (f64, f64) {
        (self.start.1, self.difference_s())
    }

    /// Returns the difference that the clock models do not explain, in seconds.
    pub(crate) fn residual_s(&self, clocks: &[Clock]) -> f64 {
        let offset_s = |(clock, time_s): (usize, f64)| clocks[clock].offset_s(time_s);
        self.difference_s() - (offset_s(self.arrival) - offset_s(self.start))
    }
}

/// Fits all known clocks to the comparisons, one clock after the other until the offsets converge.
///
/// Each segment gets an offset, and a drift if it has enough comparisons. The reference clock does not change. O(rounds
/// · comparisons).
pub(crate) fn fit(clocks: &mut [Clock], comparisons: &[Comparison], reference: usize) {
    for _ in 0..ROUNDS_MAX {
        let mut change_s = 0f64;
        for clock in (0..clocks.len()).filter(|&clock| clock != reference) {
            if !clocks[clock].is_determined {
                continue;
            }
            let points = clocks[clock].implied_offsets(clock, comparisons, clocks);
            for (index, points) in points.iter().enumerate().filter(|(_, points)| !points.is_empty()) {
                let fitted_segment = fit_line(points);
                let segment = &mut clocks[clock].segments[index].1;
                change_s = change_s.max((fitted_segment.offset_s - segment.offset_at_s(fitted_segment.middle_s)).abs());
                *segment = fitted_segment;
            }
        }
        if change_s < CHANGE_S_MAX {
            return;
        }
    }
}

/// Fits a line to points of time and offset by iteratively reweighted least squares with Huber weights.
///
/// The drift is 0 if the points are few or span a short time.
pub(crate) fn fit_line(points: &[(f64, f64)]) -> ClockSegment {
    let middle_s = median(points.iter().map(|point| point.0).collect());
    let span = points.iter().fold((f64::MAX, f64::MIN), |(low, high), point| (low.min(point.0), high.max(point.0)));
    let has_drift = points.len() >= DRIFT_COMPARISONS_MIN && span.1 - span.0 >= DRIFT_SPAN_S_MIN;
    let offset_s = median(points.iter().map(|point| point.1).collect());
    let mut segment = ClockSegment { middle_s, offset_s, drift: 0.0 };
    for _ in 0..5 {
        let residuals_s: Vec<f64> = points.iter().map(|point| (point.1 - segment.offset_at_s(point.0)).abs()).collect();
        let full_weight_s = (1.4826 * median(residuals_s.clone())).max(FULL_WEIGHT_S_MIN);
        let weights: Vec<f64> =
            residuals_s.iter().map(|residual_s| full_weight_s / residual_s.max(full_weight_s)).collect();
        let sum = |value: &dyn Fn((f64, f64)) -> f64| -> f64 {
            points.iter().zip(&weights).map(|(point, weight)| weight * value(*point)).sum()
        };
        let total = sum(&|_| 1.0);
        let (time_s, offset_s) = (sum(&|point| point.0 - middle_s) / total, sum(&|point| point.1) / total);
        let (covariance, variance) = (
            sum(&|point| (point.0 - middle_s - time_s) * (point.1 - offset_s)),
            sum(&|point| (point.0 - middle_s - time_s).powi(2)),
        );
        let drift = if has_drift && variance > 0.0 { covariance / variance } else { 0.0 };
        segment = ClockSegment { middle_s, offset_s: offset_s - drift * time_s, drift };
    }
    segment
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fit_finds_drift_and_steps_of_clocks_that_are_compared_in_a_chain() {
        // Clock 1 is right. Clock 0 is 2 s ahead and gains 20 ppm. Clock 2 is compared with clock 0 only; it is 3 s
        // behind until 4000 s.
        let offset = |clock: usize, time_s: f64| match clock {
            0 => 2.0 + 2e-5 * time_s,
            2 if time_s < 4000.0 => -3.0,
            2 => 0.5,
            _ => 0.0,
        };
        let reading = |clock: usize, true_s: f64| (clock, true_s + offset(clock, true_s));
        let mut comparisons = Vec::new();
        for n in 0..200 {
            let true_s = 40.0 * f64::from(n);
            // One message in ten is a late echo.
            let echo_delay_s = if n % 10 == 0 { 0.6 } else { 0.0 };
            let echo = |(clock, time_s): (usize, f64)| (clock, time_s + echo_delay_s);
            comparisons.push(Comparison { start: reading(1, true_s), arrival: echo(reading(0, true_s)) });
            comparisons.push(Comparison { start: reading(0, true_s + 7.0), arrival: reading(2, true_s + 7.0) });
        }
        let mut clocks =
            [Clock::constant(2.0, &[], true), Clock::constant(0.0, &[], true), Clock::constant(0.0, &[4000.0], true)];
        fit(&mut clocks, &comparisons, 1);
        for (clock, time_s, offset_s) in
            [(0, 100.0, 2.002), (0, 8000.0, 2.16), (1, 9.0, 0.0), (2, 100.0, -3.0), (2, 7000.0, 0.5)]
        {
            let found = clocks[clock].offset_s(time_s);
            assert!((found - offset_s).abs() < 0.01, "{clock} at {time_s}: {found}, expected {offset_s}");
        }
        assert!(comparisons[1].residual_s(&clocks).abs() < 0.01);
    }
}
