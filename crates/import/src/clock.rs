//! How the clocks of vehicles differ, by what one sent and another one heard.

/// Slower than this no difference is told to drift: it takes so many comparisons over so many seconds.
const DRIFT_COMPARISONS_MIN: usize = 8;
const DRIFT_SPAN_S_MIN: f64 = 600.0;

/// Rounds in which clocks are fitted one after the other, at most, and the change at which they are done, in seconds.
const ROUNDS_MAX: usize = 200;
const CHANGE_S_MAX: f64 = 1e-6;

/// Half of the spread within which a comparison counts in full, at least.
const SPREAD_S_MIN: f64 = 1e-3;

/// Others that are nearly as good as the best make it unsure: by this share.
const NEARLY: f64 = 0.9;

/// A clock: how far ahead it is, straight between times when it was set.
#[derive(Debug, Clone, PartialEq)]
pub struct Clock {
    /// From when on, by this clock, and what holds from then.
    pieces: Vec<(f64, Piece)>,
    /// Whether anything is known of it.
    pub known: bool,
}

/// How far ahead a clock is between two times when it was set.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Piece {
    /// The time for which the offset holds.
    pub middle_s: f64,
    /// How far ahead, in seconds.
    pub ahead_s: f64,
    /// Seconds that it gains in a second.
    pub drift: f64,
}

impl Piece {
    fn ahead_at_s(&self, time_s: f64) -> f64 {
        self.ahead_s + self.drift * (time_s - self.middle_s)
    }
}

impl Clock {
    /// A clock that is so far ahead all the time, set at these times.
    pub(crate) fn ahead(ahead_s: f64, set_s: &[f64], known: bool) -> Self {
        let piece = Piece { ahead_s, ..Piece::default() };
        let starts = [f64::NEG_INFINITY].into_iter().chain(set_s.iter().copied());
        Self { pieces: starts.map(|start_s| (start_s, piece)).collect(), known }
    }

    /// How far ahead it is when it shows this time.
    pub fn ahead_s(&self, time_s: f64) -> f64 {
        self.pieces[self.piece(time_s)].1.ahead_at_s(time_s)
    }

    /// The pieces, in the order of time.
    pub fn pieces(&self) -> impl Iterator<Item = &Piece> {
        self.pieces.iter().map(|(_, piece)| piece)
    }

    fn piece(&self, time_s: f64) -> usize {
        self.pieces.partition_point(|(start_s, _)| *start_s <= time_s).saturating_sub(1)
    }

    /// Sets each piece of this clock, one among others, to where most comparisons lie, if so many lie anywhere.
    pub(crate) fn search(&mut self, own: usize, comparisons: &[Comparison], clocks: &[Clock], within_s: f64) {
        let mut differences_s: Vec<Vec<f64>> = vec![Vec::new(); self.pieces.len()];
        for Comparison { early, late } in comparisons {
            let (time_s, ahead_s) = if late.0 == own {
                (late.1, late.1 - early.1 + clocks[early.0].ahead_s(early.1))
            } else {
                (early.1, clocks[late.0].ahead_s(late.1) - (late.1 - early.1))
            };
            differences_s[self.piece(time_s)].push(ahead_s);
        }
        for ((_, piece), differences_s) in self.pieces.iter_mut().zip(differences_s) {
            if let Some(peak) = peak(differences_s, within_s) {
                *piece = Piece { ahead_s: peak.difference_s, ..Piece::default() };
            }
        }
    }
}

/// One message by two clocks, without the time that it took.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Comparison {
    /// Whose clock, and what it showed.
    pub(crate) early: (usize, f64),
    /// Whose clock showed how much more.
    pub(crate) late: (usize, f64),
}

impl Comparison {
    pub(crate) fn difference_s(&self) -> f64 {
        self.late.1 - self.early.1
    }

    /// What the clocks leave of the difference.
    pub(crate) fn residual_s(&self, clocks: &[Clock]) -> f64 {
        let ahead_s = |(clock, time_s): (usize, f64)| clocks[clock].ahead_s(time_s);
        self.difference_s() - (ahead_s(self.late) - ahead_s(self.early))
    }
}

/// Where most differences of two clocks lie.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Peak {
    pub(crate) difference_s: f64,
    pub(crate) count: usize,
    /// Another place where nearly as many lie.
    pub(crate) other_s: Option<f64>,
}

/// The difference about which, give or take `within_s`, most lie; of nearly as many the smallest. `None` where fewer than two do.
pub(crate) fn peak(mut differences_s: Vec<f64>, within_s: f64) -> Option<Peak> {
    differences_s.sort_by(f64::total_cmp);
    let mut end = 0;
    let windows: Vec<(f64, usize)> = (0..differences_s.len())
        .map(|begin| {
            while end < differences_s.len() && differences_s[end] <= differences_s[begin] + 2.0 * within_s {
                end += 1;
            }
            (differences_s[begin + (end - begin) / 2], end - begin)
        })
        .collect();
    let most = windows.iter().map(|window| window.1).max().filter(|most| *most >= 2)?;
    let good = || windows.iter().filter(|window| window.1 as f64 >= NEARLY * most as f64);
    let smallest = good().min_by(|a, b| a.0.abs().total_cmp(&b.0.abs()))?.0;
    // Of those about the smallest the fullest, or else its slope would do.
    let about = good().filter(|window| (window.0 - smallest).abs() <= 2.0 * within_s);
    let (difference_s, count) = *about.max_by_key(|window| window.1)?;
    let other = good().map(|window| window.0).find(|other_s| (other_s - difference_s).abs() > 4.0 * within_s);
    Some(Peak { difference_s, count, other_s: other })
}

/// Fits clocks one after the other until nothing changes: an offset for each time that it was set, and a drift where there are
/// enough comparisons. The reference stays as it is. O(rounds · comparisons).
pub(crate) fn fit(clocks: &mut [Clock], comparisons: &[Comparison], reference: usize) {
    for _ in 0..ROUNDS_MAX {
        let mut change_s = 0f64;
        for clock in (0..clocks.len()).filter(|&clock| clock != reference) {
            if !clocks[clock].known {
                continue;
            }
            let mut points: Vec<Vec<(f64, f64)>> = vec![Vec::new(); clocks[clock].pieces.len()];
            for comparison in comparisons {
                let Comparison { early, late } = *comparison;
                let (time_s, ahead_s) = match (early.0 == clock, late.0 == clock) {
                    (false, true) => (late.1, comparison.difference_s() + clocks[early.0].ahead_s(early.1)),
                    (true, false) => (early.1, clocks[late.0].ahead_s(late.1) - comparison.difference_s()),
                    _ => continue,
                };
                points[clocks[clock].piece(time_s)].push((time_s, ahead_s));
            }
            for (piece, points) in points.iter().enumerate().filter(|(_, points)| !points.is_empty()) {
                let found = line(points);
                let known = &mut clocks[clock].pieces[piece].1;
                change_s = change_s.max((found.ahead_s - known.ahead_at_s(found.middle_s)).abs());
                *known = found;
            }
        }
        if change_s < CHANGE_S_MAX {
            return;
        }
    }
}

/// A straight line through points, least squares in which points far off count less (Huber); level where they are few or close.
fn line(points: &[(f64, f64)]) -> Piece {
    let middle_s = median(points.iter().map(|point| point.0).collect());
    let span = points.iter().fold((f64::MAX, f64::MIN), |(low, high), point| (low.min(point.0), high.max(point.0)));
    let drifts = points.len() >= DRIFT_COMPARISONS_MIN && span.1 - span.0 >= DRIFT_SPAN_S_MIN;
    let mut piece = Piece { middle_s, ahead_s: median(points.iter().map(|point| point.1).collect()), drift: 0.0 };
    for _ in 0..5 {
        let off_s: Vec<f64> = points.iter().map(|point| (point.1 - piece.ahead_at_s(point.0)).abs()).collect();
        let full_s = (1.4826 * median(off_s.clone())).max(SPREAD_S_MIN);
        let weights: Vec<f64> = off_s.iter().map(|off_s| full_s / off_s.max(full_s)).collect();
        let sum = |value: &dyn Fn((f64, f64)) -> f64| -> f64 {
            points.iter().zip(&weights).map(|(point, weight)| weight * value(*point)).sum()
        };
        let total = sum(&|_| 1.0);
        let (time_s, ahead_s) = (sum(&|point| point.0 - middle_s) / total, sum(&|point| point.1) / total);
        let (across, along) = (
            sum(&|point| (point.0 - middle_s - time_s) * (point.1 - ahead_s)),
            sum(&|point| (point.0 - middle_s - time_s).powi(2)),
        );
        let drift = if drifts && along > 0.0 { across / along } else { 0.0 };
        piece = Piece { middle_s, ahead_s: ahead_s - drift * time_s, drift };
    }
    piece
}

pub(crate) fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    match values.len() {
        0 => 0.0,
        count if count % 2 == 1 => values[count / 2],
        count => (values[count / 2 - 1] + values[count / 2]) / 2.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fullest_place_is_found_and_doubt_is_said() {
        let around = |middle: f64, count: usize| (0..count).map(move |n| middle + 0.01 * n as f64);
        let found = peak(around(3.0, 20).chain(around(-4.0, 5)).collect(), 0.5).unwrap();
        assert!((found.difference_s - 3.1).abs() < 0.02 && found.count == 20 && found.other_s.is_none(), "{found:?}");
        // A cycle of ten seconds, of which all but the ends fit as well: the smallest is taken, and the other named.
        let found = peak(around(-7.0, 20).chain(around(3.0, 19)).collect(), 0.5).unwrap();
        assert!((found.difference_s - 3.1).abs() < 0.02 && found.other_s.is_some(), "{found:?}");
        assert_eq!(peak(vec![1.0, 5.0], 0.5), None);
    }

    #[test]
    fn clocks_are_found_that_drift_are_set_and_compared_in_a_chain() {
        // 1 is right; 0 is 2 s ahead and gains 20 ppm; 2, compared with 0 only, is 3 s behind until it is set at 4000 s.
        let ahead = |clock: usize, time_s: f64| match clock {
            0 => 2.0 + 2e-5 * time_s,
            2 if time_s < 4000.0 => -3.0,
            2 => 0.5,
            _ => 0.0,
        };
        let at = |clock: usize, true_s: f64| (clock, true_s + ahead(clock, true_s));
        let mut comparisons = Vec::new();
        for n in 0..200 {
            let true_s = 40.0 * f64::from(n);
            // One in ten is an echo, and late.
            let late_s = if n % 10 == 0 { 0.6 } else { 0.0 };
            let echo = |(clock, time_s): (usize, f64)| (clock, time_s + late_s);
            comparisons.push(Comparison { early: at(1, true_s), late: echo(at(0, true_s)) });
            comparisons.push(Comparison { early: at(0, true_s + 7.0), late: at(2, true_s + 7.0) });
        }
        let mut clocks =
            [Clock::ahead(2.0, &[], true), Clock::ahead(0.0, &[], true), Clock::ahead(0.0, &[4000.0], true)];
        fit(&mut clocks, &comparisons, 1);
        for (clock, time_s, ahead_s) in
            [(0, 100.0, 2.002), (0, 8000.0, 2.16), (1, 9.0, 0.0), (2, 100.0, -3.0), (2, 7000.0, 0.5)]
        {
            let found = clocks[clock].ahead_s(time_s);
            assert!((found - ahead_s).abs() < 0.01, "{clock} at {time_s}: {found}, expected {ahead_s}");
        }
        assert!(comparisons[1].residual_s(&clocks).abs() < 0.01);
    }
}
