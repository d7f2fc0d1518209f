//! Simplifies a track to few waypoints: a minimum-link path within a tolerance (Imai and Iri), then dynamic programming
//! over grid cells.

use std::cell::OnceCell;
use std::collections::BTreeMap;

use pingmap_packet::Cell;

use crate::team::grid::Grid;
use crate::team::slots::Slots;
use crate::track::position_track::{Track, interpolate};
use crate::types::chart::Chart;
use crate::types::event::Position;

/// Largest number of slots between two waypoints: the range of the field in a report.
const SEGMENT_SLOTS_MAX: u32 = u8::MAX as u32;

/// Position of the vehicle at the beginning of a slot.
struct Sample {
    slot: u32,
    time_s: f64,
    at: Position,
    own: Cell,
    /// Cell of a waypoint that was sent before. It stays a waypoint.
    fixed: Option<Cell>,
    /// Cells in which a waypoint may lie, the nearest first. They are computed on demand.
    vertices: OnceCell<Vec<Vertex>>,
    /// Whether the track is interrupted before this sample: outside the grid, or for longer than a segment.
    begins_part: bool,
}

/// A cell, its centre, and the distance of the centre from the sample's position.
#[derive(Clone, Copy)]
struct Vertex {
    cell: Cell,
    centre: Position,
    deviation_m: f64,
}

/// End of a segment: the index of its last sample, and the cells in which it may end there.
struct Segment {
    to: usize,
    vertices: Vec<Vertex>,
}

/// Cost of the best path to a cell: sum of squared deviations, and the cell of the waypoint before it.
#[derive(Clone, Copy)]
struct PathCost {
    deviation_m2: f64,
    from: usize,
}

/// Simplifies tracks under one schedule and grid.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TrackSimplifier<'a> {
    pub(crate) slots: &'a Slots,
    pub(crate) grid: &'a Grid,
    pub(crate) chart: &'a Chart,
    pub(crate) has_depth: bool,
    /// Largest deviation of a segment from the track, in metres.
    pub(crate) tolerance_m: f64,
}

impl TrackSimplifier<'_> {
    /// Returns the waypoints of a track from slot `begin` on, by connected parts. A part ends where the track leaves
    /// the grid.
    ///
    /// Each segment reaches as far as the tolerance allows. Among paths with that number of segments, the result has
    /// the smallest sum of squared deviations. Waypoints that were sent before (`fixed`) stay. O(slots · slots of a
    /// segment).
    pub(crate) fn simplify(&self, track: &Track, fixed: &BTreeMap<u32, Cell>, begin: u32) -> Vec<Vec<(u32, Cell)>> {
        let samples = self.samples(track, fixed, begin);
        samples.chunk_by(|_, next| !next.begins_part).map(|part| self.waypoints_of_part(part)).collect()
    }

    fn waypoints_of_part(&self, samples: &[Sample]) -> Vec<(u32, Cell)> {
        let mut indices = Vec::new();
        let mut end = Segment { to: 0, vertices: self.vertices(&samples[0]).to_vec() };
        loop {
            let segments = end.vertices.iter().map(|vertex| self.longest_segment(samples, end.to, vertex));
            let Some(segment) = segments.reduce(|best, segment| if segment.to > best.to { segment } else { best })
            else {
                return self.shortest_path(samples, &indices);
            };
            indices.push(end.to);
            end = segment;
        }
    }

    /// Returns the path of smallest cost through the samples with these indices. O(samples · cells of a waypoint²).
    fn shortest_path(&self, samples: &[Sample], indices: &[usize]) -> Vec<(u32, Cell)> {
        let begin = |vertex: &Vertex| PathCost { deviation_m2: vertex.deviation_m.powi(2), from: 0 };
        let mut costs: Vec<Vec<PathCost>> = vec![self.vertices(&samples[indices[0]]).iter().map(begin).collect()];
        for segment in indices.windows(2) {
            let onward = self.relax(&samples[segment[0]..=segment[1]], &costs[costs.len() - 1]);
            costs.push(onward);
        }
        let last = costs.last().into_iter().flatten().enumerate();
        let mut vertex = last.min_by(|a, b| a.1.deviation_m2.total_cmp(&b.1.deviation_m2)).map_or(0, |(nth, _)| nth);
        let mut waypoints = Vec::new();
        for (&index, costs) in indices.iter().zip(&costs).rev() {
            waypoints.push((samples[index].slot, self.vertices(&samples[index])[vertex].cell));
            vertex = costs[vertex].from;
        }
        waypoints.reverse();
        waypoints
    }

    /// Returns the costs of the cells of the last sample, given the costs of the cells of the first one.
    fn relax(&self, samples: &[Sample], costs: &[PathCost]) -> Vec<PathCost> {
        let [from, between @ .., to] = samples else { return costs.to_vec() };
        let best = |end: &Vertex| {
            let mut best = PathCost { deviation_m2: f64::INFINITY, from: 0 };
            for (vertex, (begin, cost)) in self.vertices(from).iter().zip(costs).enumerate() {
                let ends = [(from.time_s, begin.centre), (to.time_s, end.centre)];
                let deviation_m2 = self
                    .deviation_m2(&ends, between)
                    .map_or(f64::INFINITY, |segment_m2| cost.deviation_m2 + segment_m2);
                if deviation_m2 < best.deviation_m2 {
                    best = PathCost { deviation_m2, from: vertex };
                }
            }
            PathCost { deviation_m2: best.deviation_m2 + end.deviation_m.powi(2), ..best }
        };
        self.vertices(to).iter().map(best).collect()
    }

    /// Returns the samples of a track: one for each slot with a sender.
    fn samples(&self, track: &Track, fixed: &BTreeMap<u32, Cell>, begin: u32) -> Vec<Sample> {
        let Some((first_s, last_s)) = track.span_s() else { return Vec::new() };
        let begin = self.slots.number(first_s).unwrap_or(0).max(begin);
        let slots = (begin..self.slots.end()).map_while(|slot| {
            let time_s = self.slots.begin_s(slot).filter(|&time_s| time_s <= last_s)?;
            Some((slot, time_s))
        });
        let mut samples: Vec<Sample> = Vec::new();
        let mut is_interrupted = false;
        for (slot, time_s) in slots.filter(|&(slot, _)| self.slots.sender(slot).is_some()) {
            let fixed = fixed.get(&slot).copied();
            let at = track.at(time_s).map(|at| Position { depth_m: at.depth_m.filter(|_| self.has_depth), ..at });
            let found = at.and_then(|at| Some((at, self.grid.waypoint_cell(self.chart, &at)?)));
            let Some((at, own)) = found else {
                is_interrupted = true;
                continue;
            };
            let begins_part = is_interrupted || samples.last().is_some_and(|last| slot - last.slot > SEGMENT_SLOTS_MAX);
            samples.push(Sample { slot, time_s, at, own, fixed, vertices: OnceCell::new(), begins_part });
            is_interrupted = false;
        }
        samples
    }

    /// Returns the cells in which a waypoint of a sample may lie: its own cell, and others within the tolerance.
    fn vertices<'s>(&self, sample: &'s Sample) -> &'s [Vertex] {
        let vertex = |cell| {
            let centre = self.grid.waypoint_position(self.chart, cell, self.has_depth);
            Vertex { cell, centre, deviation_m: centre.distance_m(&sample.at) }
        };
        sample.vertices.get_or_init(|| {
            if let Some(fixed) = sample.fixed {
                return vec![vertex(fixed)];
            }
            let about = self.grid.waypoint_cells_about(sample.own, self.tolerance_m).map(vertex);
            let mut vertices: Vec<Vertex> =
                about.filter(|vertex| vertex.cell == sample.own || vertex.deviation_m <= self.tolerance_m).collect();
            vertices.sort_by(|a, b| a.deviation_m.total_cmp(&b.deviation_m));
            vertices
        })
    }

    /// Returns the segment that reaches farthest from a cell of a sample.
    fn longest_segment(&self, samples: &[Sample], from: usize, vertex: &Vertex) -> Segment {
        let begin = (samples[from].time_s, vertex.centre);
        // A segment to the next sample has no samples between its ends, so it always fits.
        let next = from + 1;
        let Some(after) = samples.get(next) else { return Segment { to: from, vertices: Vec::new() } };
        for to in (next + 1..=self.farthest_reachable(samples, from, &begin)).rev() {
            let is_within_tolerance = |end: &&Vertex| {
                self.deviation_m2(&[begin, (samples[to].time_s, end.centre)], &samples[next..to]).is_some()
            };
            let vertices: Vec<Vertex> =
                self.vertices(&samples[to]).iter().filter(is_within_tolerance).copied().collect();
            if !vertices.is_empty() {
                return Segment { to, vertices };
            }
        }
        Segment { to: next, vertices: self.vertices(after).to_vec() }
    }

    /// Returns the index of the farthest sample that a segment of constant velocity can reach within the tolerance.
    fn farthest_reachable(&self, samples: &[Sample], from: usize, begin: &(f64, Position)) -> usize {
        let (mut east, mut north) = ((f64::NEG_INFINITY, f64::INFINITY), (f64::NEG_INFINITY, f64::INFINITY));
        let mut to = from;
        for sample in &samples[from + 1..] {
            if sample.slot - samples[from].slot > SEGMENT_SLOTS_MAX {
                break;
            }
            to += 1;
            let duration_s = sample.time_s - begin.0;
            // Range of velocities along one axis that stay within the tolerance.
            let narrow = |range: &mut (f64, f64), distance_m: f64| {
                *range = (
                    range.0.max((distance_m - self.tolerance_m) / duration_s),
                    range.1.min((distance_m + self.tolerance_m) / duration_s),
                );
                range.0 <= range.1
            };
            let is_reachable = narrow(&mut east, sample.at.east_m - begin.1.east_m)
                & narrow(&mut north, sample.at.north_m - begin.1.north_m);
            if sample.fixed.is_some() || !is_reachable {
                break;
            }
        }
        to
    }

    /// Returns the sum of squared deviations of a segment at these samples, in m². `None` if one deviation exceeds the
    /// tolerance.
    fn deviation_m2(&self, ends: &[(f64, Position); 2], samples: &[Sample]) -> Option<f64> {
        samples.iter().try_fold(0.0, |sum, sample| {
            let at = interpolate(&ends[0], &ends[1], sample.time_s);
            let vertical_m = at.depth_m.zip(sample.at.depth_m).map_or(0.0, |(a, b)| (a - b).abs());
            let horizontal_m = at.distance_m(&sample.at);
            let is_within_tolerance = horizontal_m <= self.tolerance_m && vertical_m <= self.grid.depth_cell_m;
            is_within_tolerance.then_some(sum + horizontal_m.powi(2))
        })
    }
}

#[cfg(test)]
#[path = "../../tests/unit/simplification.rs"]
mod tests;
