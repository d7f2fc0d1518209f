//! Delays of pairs of clocks of which one was set during the mission.

use std::collections::BTreeMap;

use crate::assemble::clocks::fleet_clocks::FleetClocks;
use crate::assemble::clocks::peak::HALF_WIDTH_S;
use crate::assemble::median::median;
use crate::assemble::vehicles::fleet::Fleet;
use crate::assemble::vehicles::transmission::Reception;

/// Differences in the order of time: pairs of time and difference, in seconds.
type Differences = Vec<(f64, f64)>;

impl FleetClocks {
    /// Corrects the peaks of pairs whose two directions belong to different segments of a clock, and with them the
    /// delays and the offsets. Returns whether a pair has such peaks.
    ///
    /// The sum of the differences in both directions at nearly one time is free of the clock offset at that time.
    pub(crate) fn correct_round_trips(&mut self, fleet: &Fleet, receptions: &[Reception]) -> bool {
        let mut differences: BTreeMap<(usize, usize), Differences> = BTreeMap::new();
        for (reception, comparison) in self.comparisons(fleet, receptions) {
            if !reception.transmission.is_reception_time {
                let (time_s, difference_s) = comparison.point();
                let recorded_s = difference_s + self.delays.delay_s(reception.sender, reception.kind);
                differences.entry((reception.sender, reception.receiver)).or_default().push((time_s, recorded_s));
            }
        }
        differences.values_mut().for_each(|points| points.sort_by(|a, b| a.0.total_cmp(&b.0)));
        let mut is_changed = false;
        for (&(a, b), out) in differences.iter().filter(|((a, b), _)| a < b) {
            let Some(back) = differences.get(&(b, a)) else { continue };
            let Some(&back_s) = self.differences_s.get(&(b, a)) else { continue };
            let Some(out_s) = self.differences_s.get_mut(&(a, b)) else { continue };
            let sum_s = sum_of_neighbours_s(out, back);
            if (sum_s - *out_s - back_s).abs() > HALF_WIDTH_S {
                *out_s = sum_s - back_s;
                is_changed = true;
            }
        }
        if is_changed {
            self.set_offsets(fleet);
        }
        is_changed
    }
}

/// Returns the median sum of a difference and the nearest one in time of the opposite direction, over the half with the
/// smallest distances in time.
fn sum_of_neighbours_s(out: &Differences, back: &Differences) -> f64 {
    let sums = |points: &Differences, others: &Differences| -> Vec<(f64, f64)> {
        let with_nearest = |&(time_s, difference_s): &(f64, f64)| {
            let next = others.partition_point(|other| other.0 < time_s);
            let neighbours = others[next.saturating_sub(1)..others.len().min(next + 1)].iter();
            let distances = neighbours.map(|other| ((other.0 - time_s).abs(), difference_s + other.1));
            distances.min_by(|a, b| a.0.total_cmp(&b.0))
        };
        points.iter().filter_map(with_nearest).collect()
    };
    let mut sums: Vec<(f64, f64)> = [sums(out, back), sums(back, out)].concat();
    sums.sort_by(|a, b| a.0.total_cmp(&b.0));
    median(sums[..sums.len().div_ceil(2)].iter().map(|sum| sum.1).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sum_of_both_directions_is_free_of_a_step() {
        // The delays are 1 s and 2 s. The offset is 4 s, and 9 s from 1000 s on. The way back is heard in the first
        // half only.
        let offset_s = |time_s: f64| if time_s < 1000.0 { 4.0 } else { 9.0 };
        let out: Differences =
            (0..100).map(|n| 20.0 * f64::from(n)).map(|time_s| (time_s, 1.0 + offset_s(time_s))).collect();
        let back: Differences =
            (0..50).map(|n| 7.0 + 20.0 * f64::from(n)).map(|time_s| (time_s, 2.0 - offset_s(time_s))).collect();
        for (a, b) in [(&out, &back), (&back, &out)] {
            assert!((sum_of_neighbours_s(a, b) - 3.0).abs() < 1e-9);
        }
    }
}
