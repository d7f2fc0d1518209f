//! The most frequent difference between two clocks.

use crate::assemble::clocks::clock::fit_line;
use crate::assemble::median::median;

/// Half of the width of a window of differences, in seconds. It covers the drift of a clock and the spread of travel
/// times.
pub(crate) const HALF_WIDTH_S: f64 = 1.0;

/// Smallest distance between two candidates, in seconds.
const SEPARATION_S: f64 = 6.0 * HALF_WIDTH_S;

/// A window is a candidate if it holds at least this share of the differences of the fullest one.
const CANDIDATE_SHARE: f64 = 0.9;

/// A candidate is dismissed if another one has residuals smaller by this factor.
pub(crate) const CLEAR_FACTOR: f64 = 3.0;

/// Smallest number of differences whose residuals are compared.
const COUNT_FOR_RESIDUALS_MIN: usize = 8;

/// Lower limit of the scale of residuals, in seconds: the resolution of recorded times.
pub(crate) const RESIDUAL_S_MIN: f64 = 1e-3;

/// The most frequent difference of two clocks.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Peak {
    /// The difference in seconds.
    pub(crate) difference_s: f64,
    /// Number of differences in its window.
    pub(crate) count: usize,
    /// Other differences that fit as well. Slots that repeat leave the difference known only up to their period.
    pub(crate) rivals_s: Vec<f64>,
}

/// A window with many differences.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    difference_s: f64,
    count: usize,
    /// Median absolute residual of a line through the window's differences over time, in seconds.
    residual_s: f64,
}

/// Finds the difference that most messages share, from the time and the difference of each possible assignment.
///
/// Among windows with nearly as many differences, the one with clearly smaller residuals is chosen: only the right
/// assignment accounts for the travel time of every message. If the residuals do not decide, the smallest absolute
/// difference within `limit_s` is chosen, and the others within it are its rivals. Few differences are searched within
/// `limit_s` only. Returns `None` if no two differences lie close to each other. O(n log n) for each candidate.
pub(crate) fn find_peak(mut points: Vec<(f64, f64)>, limit_s: f64) -> Option<Peak> {
    points.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.0.total_cmp(&b.0)));
    let mut windows = fullest_windows(&points);
    let count_max = windows.first().map_or(0, |&(first, end)| end - first);
    if count_max < COUNT_FOR_RESIDUALS_MIN {
        points.retain(|point| point.1.abs() <= limit_s);
        windows = fullest_windows(&points);
    }
    let mut candidates: Vec<Candidate> = windows.into_iter().map(|window| candidate(&points, window)).collect();
    let residual_s_min = candidates.iter().map(|candidate| candidate.residual_s).fold(f64::INFINITY, f64::min);
    if count_max >= COUNT_FOR_RESIDUALS_MIN {
        candidates.retain(|candidate| candidate.residual_s <= CLEAR_FACTOR * residual_s_min);
    }
    if candidates.iter().any(|candidate| candidate.difference_s.abs() <= limit_s) {
        candidates.retain(|candidate| candidate.difference_s.abs() <= limit_s);
    }
    candidates.sort_by(|a, b| a.difference_s.abs().total_cmp(&b.difference_s.abs()));
    let (best, rivals) = candidates.split_first()?;
    let rivals_s = rivals.iter().map(|rival| rival.difference_s).collect();
    Some(Peak { difference_s: best.difference_s, count: best.count, rivals_s })
}

/// Returns the fullest windows, as ranges of indices, at least [`SEPARATION_S`] apart.
fn fullest_windows(points: &[(f64, f64)]) -> Vec<(usize, usize)> {
    let mut end = 0;
    let mut windows: Vec<(usize, usize)> = (0..points.len())
        .map(|first| {
            end += points[end..].iter().take_while(|point| point.1 <= points[first].1 + 2.0 * HALF_WIDTH_S).count();
            (first, end)
        })
        .collect();
    windows.sort_by_key(|&(first, end)| (std::cmp::Reverse(end - first), first));
    let count_max = windows.first().map_or(0, |&(first, end)| end - first);
    let mut chosen: Vec<(usize, usize)> = Vec::new();
    let is_full =
        |&&(first, end): &&(usize, usize)| count_max >= 2 && (end - first) as f64 >= CANDIDATE_SHARE * count_max as f64;
    for &(first, end) in windows.iter().take_while(is_full) {
        let difference_s = points[first].1;
        if chosen.iter().all(|window| (points[window.0].1 - difference_s).abs() >= SEPARATION_S) {
            chosen.push((first, end));
        }
    }
    chosen
}

fn candidate(points: &[(f64, f64)], (first, end): (usize, usize)) -> Candidate {
    let window = &points[first..end];
    let line = fit_line(window);
    let residuals_s = window.iter().map(|point| (point.1 - line.offset_at_s(point.0)).abs()).collect();
    Candidate {
        difference_s: points[first + (end - first) / 2].1,
        count: end - first,
        residual_s: median(residuals_s).max(RESIDUAL_S_MIN),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cluster(middle: f64, count: usize, spread_s: f64) -> impl Iterator<Item = (f64, f64)> {
        (0..count).map(move |n| (20.0 * n as f64, middle + spread_s * ((7 * n) % 11) as f64))
    }

    #[test]
    fn the_peak_is_the_fullest_window() {
        let found = find_peak(cluster(3.0, 20, 0.02).chain(cluster(-4.0, 5, 0.02)).collect(), 10.0).unwrap();
        assert!((found.difference_s - 3.1).abs() < 0.02 && found.count == 20 && found.rivals_s.is_empty(), "{found:?}");
        assert_eq!(find_peak(vec![(0.0, 1.0), (1.0, 5.0)], 10.0), None);
        assert_eq!(find_peak(Vec::new(), 10.0), None);
    }

    #[test]
    fn residuals_decide_between_offsets_that_differ_by_a_period() {
        let found = find_peak(cluster(-2.0, 20, 0.02).chain(cluster(18.0, 20, 0.001)).collect(), 10.0).unwrap();
        assert!((found.difference_s - 18.0).abs() < 0.02 && found.rivals_s.is_empty(), "{found:?}");
        // If the residuals are similar, the smallest offset is chosen, and its rival is named.
        let found = find_peak(cluster(-7.0, 20, 0.02).chain(cluster(3.0, 19, 0.02)).collect(), 10.0).unwrap();
        assert!((found.difference_s - 3.1).abs() < 0.02 && found.rivals_s.len() == 1, "{found:?}");
    }
}
