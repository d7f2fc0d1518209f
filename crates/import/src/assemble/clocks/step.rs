//! Steps of a clock that no record shows.

use crate::assemble::clocks::clock::{ClockSegment, fit_line};
use crate::assemble::clocks::peak::{CLEAR_FACTOR, HALF_WIDTH_S, RESIDUAL_S_MIN};

/// Smallest number of comparisons before and after a step.
const COMPARISONS_MIN: usize = 8;

/// A time at which the offset of a clock changes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ClockStep {
    /// Time of the step by this clock, in seconds.
    pub(crate) time_s: f64,
    /// Offset before the step, in seconds.
    pub(crate) before_s: f64,
    /// Offset after the step, in seconds.
    pub(crate) after_s: f64,
    /// Mean absolute residual of one line, divided by that of two lines.
    pub(crate) gain: f64,
}

impl ClockStep {
    /// Returns the change of the offset, in seconds.
    pub(crate) fn size_s(&self) -> f64 {
        self.after_s - self.before_s
    }
}

/// Finds the clearest step in the offsets of a clock over time.
///
/// Two lines must have clearly smaller residuals than one. Smaller steps than the spread of travel times do not count.
/// O(n log n).
pub(crate) fn find_step(mut points: Vec<(f64, f64)>) -> Option<ClockStep> {
    points.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let (before, after) = points.split_at(best_division(&points)?);
    let [line, line_before, line_after] = [&points, before, after].map(fit_line);
    let one_s = absolute_residuals_s(&points, &line) / points.len() as f64;
    let two_s =
        (absolute_residuals_s(before, &line_before) + absolute_residuals_s(after, &line_after)) / points.len() as f64;
    let time_s = (before.last()?.0 + after.first()?.0) / 2.0;
    let [before_s, after_s] = [line_before, line_after].map(|line| line.offset_at_s(time_s));
    let step = ClockStep { time_s, before_s, after_s, gain: one_s / two_s.max(RESIDUAL_S_MIN) };
    (step.gain >= CLEAR_FACTOR && step.size_s().abs() >= HALF_WIDTH_S).then_some(step)
}

/// Returns the index that divides sorted points into two parts with the least sum of squared deviations from the mean
/// of each part.
fn best_division(points: &[(f64, f64)]) -> Option<usize> {
    let total: f64 = points.iter().map(|point| point.1).sum();
    let count = points.len() as f64;
    let mut sum = 0.0;
    let between = points.iter().enumerate().map(|(index, point)| {
        let (before, before_sum) = (index as f64, sum);
        sum += point.1;
        // The deviations within the parts are least where those between them are largest.
        (index, before * (count - before) * (before_sum / before - (total - before_sum) / (count - before)).powi(2))
    });
    let is_inside =
        |(index, _): &(usize, f64)| (COMPARISONS_MIN..=points.len().saturating_sub(COMPARISONS_MIN)).contains(index);
    between.filter(is_inside).max_by(|a, b| a.1.total_cmp(&b.1)).map(|(index, _)| index)
}

fn absolute_residuals_s(points: &[(f64, f64)], line: &ClockSegment) -> f64 {
    points.iter().map(|point| (point.1 - line.offset_at_s(point.0)).abs()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(step_s: f64, spread_s: f64) -> Vec<(f64, f64)> {
        let offset = |n: usize| {
            let step_s = if n >= 30 { step_s } else { 0.0 };
            4.0 + 1e-5 * 20.0 * n as f64 + step_s + spread_s * ((7 * n) % 11) as f64 / 11.0
        };
        (0..100).map(|n| (20.0 * n as f64, offset(n))).collect()
    }

    #[test]
    fn a_step_divides_the_offsets_of_a_clock() {
        let found = find_step(points(-5.0, 0.1)).unwrap();
        assert!((found.time_s - 590.0).abs() < 1e-6 && (found.size_s() + 5.0).abs() < 0.1, "{found:?}");
        assert_eq!(find_step(points(0.0, 0.1)), None);
        assert_eq!(find_step(points(0.5, 0.01)), None);
        // The records of a receiver that polls its modem vary too much.
        assert_eq!(find_step(points(2.0, 2.0)), None);
        assert_eq!(find_step(points(-5.0, 0.1)[..35].to_vec()), None);
    }

    #[test]
    fn a_drift_is_no_step() {
        assert_eq!(find_step((0..200).map(|n| (20.0 * f64::from(n), 1e-3 * f64::from(n))).collect()), None);
    }
}
