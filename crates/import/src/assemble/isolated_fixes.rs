//! Exclusion of isolated positions that lie far from the rest of a track.

use pingmap_agent::VehicleId;

use crate::model::recording::{Fix, Recordings};
use crate::model::reference::Place;

/// Smallest jump to an isolated position, in metres. Dead reckoning is corrected by shorter jumps.
const JUMP_MIN_M: f64 = 5_000.0;

/// Largest speed of a vehicle, in metres per second.
const SPEED_MAX_M_PER_S: f64 = 20.0;

/// Largest share of a vehicle's positions that are isolated.
const SHARE_MAX: f64 = 0.1;

/// The positions of one vehicle that were excluded.
#[derive(Debug, Clone, PartialEq)]
pub struct IsolatedFixes {
    /// The vehicle that recorded them.
    pub vehicle: VehicleId,
    /// Number of positions.
    pub fixes: usize,
    /// The first of them.
    pub first: Fix,
    /// Distance in metres of the first to the rest of the track.
    pub distance_m: f64,
}

/// Removes isolated positions from all tracks. O(n log n).
///
/// A track is divided where a vehicle would have to move impossibly fast over more than 5 km. The longest part stays.
/// A shorter part is removed if it holds a single position, or at most a tenth of them.
pub fn exclude_isolated_fixes(recordings: &mut Recordings) -> Vec<IsolatedFixes> {
    let mut excluded = Vec::new();
    for (vehicle, recording) in recordings {
        recording.fixes.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        let all = recording.fixes.len();
        let parts: Vec<&[Fix]> = recording.fixes.chunk_by(|a, b| !is_jump(a, b)).collect();
        let longest = parts.iter().map(|part| part.len()).max().unwrap_or(0);
        let is_small =
            |part: &[Fix]| part.len() < longest && (part.len() == 1 || part.len() as f64 <= SHARE_MAX * all as f64);
        let mut kept = Vec::with_capacity(all);
        let mut isolated: Option<IsolatedFixes> = None;
        for (n, part) in parts.iter().enumerate() {
            // The nearest larger parts decide, because neighbours may be isolated, too.
            let before = parts[..n].iter().rev().find(|part| !is_small(part)).zip(part.first());
            let after = parts[n + 1..].iter().find(|part| !is_small(part)).zip(part.last());
            let before = before.and_then(|(larger, first)| Some((larger.last()?, first)));
            let after = after.and_then(|(larger, last)| Some((last, larger.first()?)));
            let is_connected = [before, after].into_iter().flatten().any(|(a, b)| !is_jump(a, b));
            if !is_small(part) || is_connected {
                kept.extend_from_slice(part);
                continue;
            }
            let distances_m = [before, after].into_iter().flatten().filter_map(|(a, b)| distance_m(a, b));
            let distance_m = distances_m.fold(f64::INFINITY, f64::min);
            let new = IsolatedFixes { vehicle: vehicle.clone(), fixes: 0, first: part[0], distance_m };
            isolated.get_or_insert(new).fixes += part.len();
        }
        excluded.extend(isolated);
        if kept.len() < all {
            recording.fixes = kept;
        }
    }
    excluded
}

/// Whether no vehicle can move from one position to the next.
fn is_jump(a: &Fix, b: &Fix) -> bool {
    distance_m(a, b)
        .is_some_and(|distance_m| distance_m > JUMP_MIN_M && distance_m > SPEED_MAX_M_PER_S * (b.time_s - a.time_s))
}

/// Returns the horizontal distance of two positions; `None` if one is in degrees and the other in metres.
fn distance_m(a: &Fix, b: &Fix) -> Option<f64> {
    match (a.place, b.place) {
        (Place::Degrees(a), Place::Degrees(b)) => Some(a.distance_m(&b)),
        (Place::Metres(a_east_m, a_north_m), Place::Metres(b_east_m, b_north_m)) => {
            Some((a_east_m - b_east_m).hypot(a_north_m - b_north_m))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::recording::Recording;

    /// Excludes isolated positions from a track with one position each ten seconds, and returns their times.
    fn excluded_s(east_m: &[f64]) -> (Vec<f64>, usize) {
        let fix = |(n, east_m): (usize, &f64)| Fix {
            time_s: 10.0 * n as f64,
            place: Place::Metres(*east_m, 0.0),
            depth_m: None,
        };
        let recording = Recording { fixes: east_m.iter().enumerate().map(fix).collect(), ..Recording::default() };
        let mut recordings = Recordings::from([(VehicleId::new("a"), recording)]);
        let excluded = exclude_isolated_fixes(&mut recordings);
        let left = recordings.values().map(|recording| recording.fixes.len()).sum();
        assert_eq!(excluded.iter().map(|fixes| fixes.fixes).sum::<usize>(), east_m.len() - left);
        (excluded.iter().map(|fixes| fixes.first.time_s).collect(), left)
    }

    #[test]
    fn isolated_positions_are_excluded_wherever_they_are() {
        let track = |far: &[usize]| -> Vec<f64> {
            (0..40).map(|n| if far.contains(&n) { 90_000.0 } else { 15.0 * f64::from(n as u32) }).collect()
        };
        assert_eq!(excluded_s(&track(&[])), (vec![], 40));
        assert_eq!(excluded_s(&track(&[0])), (vec![0.0], 39));
        assert_eq!(excluded_s(&track(&[39])), (vec![390.0], 39));
        assert_eq!(excluded_s(&track(&[7, 20, 21])), (vec![70.0], 37));
        // A position between two isolated ones stays.
        assert_eq!(excluded_s(&track(&[20, 22])), (vec![200.0], 38));
    }

    #[test]
    fn tracks_at_two_sites_and_short_jumps_stay() {
        let mut two_sites = vec![0.0; 20];
        two_sites.extend([90_000.0; 15]);
        assert_eq!(excluded_s(&two_sites), (vec![], 35));
        assert_eq!(excluded_s(&[0.0, 0.0, 4_000.0, 0.0]), (vec![], 4));
        // Two positions contradict each other, and none of them is more plausible.
        assert_eq!(excluded_s(&[0.0, 90_000.0]), (vec![], 2));
        assert_eq!(excluded_s(&[]), (vec![], 0));
    }
}
