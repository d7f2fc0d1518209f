//! The few knots that tell where a vehicle was.

use std::cell::OnceCell;
use std::collections::BTreeMap;

use pingmap_packet::Cell;

use crate::chart::Chart;
use crate::event::Position;
use crate::grid::Grid;
use crate::slots::Slots;
use crate::track::{Track, between};

/// Slots between two knots at most: what a knot has room for.
const LEG_SLOTS_MAX: u32 = u8::MAX as u32;

/// Where a vehicle was when a slot began.
struct Stop {
    slot: u32,
    time_s: f64,
    at: Position,
    /// The cell that holds it.
    own: Cell,
    /// Its place as others know it for a knot: it stays one.
    told: Option<Cell>,
    /// Where a knot of it may lie, the nearest first; found where somebody asks ([`Knots::vertices`]), which few of a long track do.
    vertices: OnceCell<Vec<Vertex>>,
    /// Whether it was nowhere that could be told in the slot before, or that was too long ago.
    is_new_run: bool,
}

/// A cell, its middle, and how far that is from where the vehicle was.
#[derive(Clone, Copy)]
struct Vertex {
    cell: Cell,
    middle: Position,
    off_m: f64,
}

/// How far a leg reaches: to which stop, and where it may end there.
struct Leg {
    to: usize,
    vertices: Vec<Vertex>,
}

/// A way to a place of a knot: how far off it is, squared and summed over its stops, and which place of the knot before it comes from.
#[derive(Clone, Copy)]
struct Way {
    off_m2: f64,
    from: usize,
}

/// How tracks are told.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Knots<'a> {
    pub(crate) slots: &'a Slots,
    pub(crate) grid: &'a Grid,
    pub(crate) chart: &'a Chart,
    pub(crate) has_depth: bool,
    /// How far a straight way between knots may be off.
    pub(crate) off_max_m: f64,
}

impl Knots<'_> {
    /// Knots of a track from its first slot that is not before `begin` to its last, in runs: as few as a search from the beginning on
    /// finds, in which every leg reaches as far as any can from where it may begin, and then as near to the track as so many can
    /// be. What was a knot once stays one (`told`): what others made of it must not change. A run ends where the grid does not hold
    /// the next place: nobody says that it went straight on to where it came back. O(slots · slots of a leg).
    pub(crate) fn of(&self, track: &Track, told: &BTreeMap<u32, Cell>, begin: u32) -> Vec<Vec<(u32, Cell)>> {
        let stops = self.stops(track, told, begin);
        stops.chunk_by(|_, next| !next.is_new_run).map(|run| self.knots_of_run(run)).collect()
    }

    fn knots_of_run(&self, stops: &[Stop]) -> Vec<(u32, Cell)> {
        let mut places = Vec::new();
        let mut here = Leg { to: 0, vertices: self.vertices(&stops[0]).to_vec() };
        loop {
            let legs = here.vertices.iter().map(|vertex| self.leg(stops, here.to, vertex));
            let Some(leg) = legs.reduce(|best, leg| if leg.to > best.to { leg } else { best }) else {
                return self.nearest(stops, &places);
            };
            places.push(here.to);
            here = leg;
        }
    }

    /// Knots at these stops: of the ways through them that are straight enough that which is nearest to where it was, in the mean
    /// square over all stops. O(stops · places of a knot²).
    fn nearest(&self, stops: &[Stop], places: &[usize]) -> Vec<(u32, Cell)> {
        let begin = |vertex: &Vertex| Way { off_m2: vertex.off_m.powi(2), from: 0 };
        let mut ways: Vec<Vec<Way>> = vec![self.vertices(&stops[places[0]]).iter().map(begin).collect()];
        for leg in places.windows(2) {
            let onward = self.onward(&stops[leg[0]..=leg[1]], &ways[ways.len() - 1]);
            ways.push(onward);
        }
        let last = ways.last().into_iter().flatten().enumerate();
        let mut at = last.min_by(|a, b| a.1.off_m2.total_cmp(&b.1.off_m2)).map_or(0, |(at, _)| at);
        let mut knots = Vec::new();
        for (&place, ways) in places.iter().zip(&ways).rev() {
            knots.push((stops[place].slot, self.vertices(&stops[place])[at].cell));
            at = ways[at].from;
        }
        knots.reverse();
        knots
    }

    /// The best ways to the places of the last of these stops, by the leg from the first, of whose places these are the best.
    fn onward(&self, stops: &[Stop], ways: &[Way]) -> Vec<Way> {
        let [from, between @ .., to] = stops else { return ways.to_vec() };
        let best = |end: &Vertex| {
            let mut best = Way { off_m2: f64::INFINITY, from: 0 };
            for (from_place, (begin, way)) in self.vertices(from).iter().zip(ways).enumerate() {
                let ends = [(from.time_s, begin.middle), (to.time_s, end.middle)];
                let off_m2 = self.off_m2(&ends, between).map_or(f64::INFINITY, |leg_m2| way.off_m2 + leg_m2);
                if off_m2 < best.off_m2 {
                    best = Way { off_m2, from: from_place };
                }
            }
            Way { off_m2: best.off_m2 + end.off_m.powi(2), ..best }
        };
        self.vertices(to).iter().map(best).collect()
    }

    /// The stops of a track: every slot that anybody may send in, of several at one time the first.
    fn stops(&self, track: &Track, told: &BTreeMap<u32, Cell>, begin: u32) -> Vec<Stop> {
        let Some((first_s, last_s)) = track.span_s() else { return Vec::new() };
        let begin = self.slots.number(first_s).unwrap_or(0).max(begin - begin % self.slots.at_once() as u32);
        let slots = (begin..self.slots.end()).map_while(|slot| {
            let time_s = self.slots.begin_s(slot).filter(|&time_s| time_s <= last_s)?;
            Some((slot, time_s))
        });
        let slots = slots.step_by(self.slots.at_once());
        let mut stops: Vec<Stop> = Vec::new();
        let mut is_away = false;
        for (slot, time_s) in slots.filter(|&(slot, _)| self.slots.sender(slot).is_some()) {
            let told = told.get(&slot).copied();
            let found = track.at(time_s).and_then(|at| Some((at, self.grid.knot_cell(self.chart, &at)?)));
            let Some((at, own)) = found else {
                is_away = true;
                continue;
            };
            let is_new_run = is_away || stops.last().is_some_and(|last| slot - last.slot > LEG_SLOTS_MAX);
            stops.push(Stop { slot, time_s, at, own, told, vertices: OnceCell::new(), is_new_run });
            is_away = false;
        }
        stops
    }

    /// Where a knot of a stop may lie: in the cell that holds it, and in others that are near enough; where it was told.
    fn vertices<'s>(&self, stop: &'s Stop) -> &'s [Vertex] {
        let vertex = |cell| {
            let middle = self.grid.knot_position(self.chart, cell, self.has_depth);
            Vertex { cell, middle, off_m: off_m(&middle, &stop.at) }
        };
        stop.vertices.get_or_init(|| {
            if let Some(told) = stop.told {
                return vec![vertex(told)];
            }
            let about = self.grid.knot_cells_about(stop.own, self.off_max_m).map(vertex);
            let mut vertices: Vec<Vertex> =
                about.filter(|vertex| vertex.cell == stop.own || vertex.off_m <= self.off_max_m).collect();
            vertices.sort_by(|a, b| a.off_m.total_cmp(&b.off_m));
            vertices
        })
    }

    /// The leg that reaches farthest from a place of a stop.
    fn leg(&self, stops: &[Stop], from: usize, vertex: &Vertex) -> Leg {
        let begin = (stops[from].time_s, vertex.middle);
        // To the next stop everything is straight.
        let next = from + 1;
        let Some(after) = stops.get(next) else { return Leg { to: from, vertices: Vec::new() } };
        for to in (next + 1..=self.in_reach(stops, from, &begin)).rev() {
            let is_straight =
                |end: &&Vertex| self.off_m2(&[begin, (stops[to].time_s, end.middle)], &stops[next..to]).is_some();
            let vertices: Vec<Vertex> = self.vertices(&stops[to]).iter().filter(is_straight).copied().collect();
            if !vertices.is_empty() {
                return Leg { to, vertices };
            }
        }
        Leg { to: next, vertices: self.vertices(after).to_vec() }
    }

    /// The farthest stop that a leg from here could reach as far as its speed east, and north, goes: at every stop on the way
    /// these have to be in a range.
    fn in_reach(&self, stops: &[Stop], from: usize, begin: &(f64, Position)) -> usize {
        let (mut east, mut north) = ((f64::NEG_INFINITY, f64::INFINITY), (f64::NEG_INFINITY, f64::INFINITY));
        let mut to = from;
        for stop in &stops[from + 1..] {
            if stop.slot - stops[from].slot > LEG_SLOTS_MAX {
                break;
            }
            to += 1;
            let took_s = stop.time_s - begin.0;
            let narrow = |range: &mut (f64, f64), way_m: f64| {
                *range =
                    (range.0.max((way_m - self.off_max_m) / took_s), range.1.min((way_m + self.off_max_m) / took_s));
                range.0 <= range.1
            };
            let is_in_reach = narrow(&mut east, stop.at.east_m - begin.1.east_m)
                & narrow(&mut north, stop.at.north_m - begin.1.north_m);
            if stop.told.is_some() || !is_in_reach {
                break;
            }
        }
        to
    }

    /// How far the straight way between two places is from where it was at these stops, squared and summed; none where it is too far
    /// at any.
    fn off_m2(&self, ends: &[(f64, Position); 2], stops: &[Stop]) -> Option<f64> {
        stops.iter().try_fold(0.0, |sum, stop| {
            let told = between(&ends[0], &ends[1], stop.time_s);
            let deep_m = told.depth_m.zip(stop.at.depth_m).map_or(0.0, |(a, b)| (a - b).abs());
            let off_m = off_m(&told, &stop.at);
            (off_m <= self.off_max_m && deep_m <= self.grid.depth_cell_m).then_some(sum + off_m.powi(2))
        })
    }
}

/// How far apart two places are on the chart.
fn off_m(a: &Position, b: &Position) -> f64 {
    (a.east_m - b.east_m).hypot(a.north_m - b.north_m)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::event::VehicleId;
    use crate::told_track::ToldTrack;
    use proptest::prelude::*;

    fn with_knots(fixes: Vec<(f64, Position)>, off_max_m: f64) -> (Track, BTreeMap<u32, Cell>, Grid, Chart, Slots) {
        let chart = Chart::about(fixes.iter().map(|fix| fix.1));
        let grid = Grid::covering(&chart, fixes.iter().map(|fix| fix.1));
        let slots = Slots::in_turn(10.0, ["a", "b"].map(VehicleId::new).into());
        let track = Track::new(fixes);
        let knots = Knots { slots: &slots, grid: &grid, chart: &chart, has_depth: false, off_max_m };
        let found = knots.of(&track, &BTreeMap::new(), 0).into_iter().flatten().collect();
        (track, found, grid, chart, slots)
    }

    #[test]
    fn straight_legs_take_two_knots_each_and_no_slot_is_off() {
        // East, north, and a circle.
        let position = |t: f64| match t {
            ..1000.0 => Position::new(1.5 * t, 0.0),
            ..2000.0 => Position::new(1500.0, 1.5 * (t - 1000.0)),
            _ => Position::new(1300.0 + 200.0 * (t / 150.0).cos(), 1500.0 + 200.0 * (t / 150.0).sin()),
        };
        let fixes: Vec<(f64, Position)> = (0..600).map(|n| 5.0 * f64::from(n)).map(|t| (t, position(t))).collect();
        let (track, knots, grid, chart, slots) = with_knots(fixes, 15.0);
        assert!(knots.keys().filter(|&&slot| slot < 199).count() <= 4, "{knots:?}");
        let place = |cell| grid.knot_position(&chart, cell, false);
        let mut told_track = ToldTrack::default();
        told_track.take(&knots.into_iter().collect::<Vec<_>>());
        let at = |slot, onward_s_max| told_track.at(slot, &slots, &place, onward_s_max);
        for slot in 0..300 {
            let (told, is) = (at(slot, 0.0).unwrap(), track.at(10.0 * f64::from(slot)).unwrap());
            let off_m = (told.east_m - is.east_m).hypot(told.north_m - is.north_m);
            // The jump to the circle takes a single slot.
            assert!(off_m <= 15.0, "slot {slot} is off by {off_m} m");
        }
        assert_eq!(at(300, 0.0), None);
    }

    #[test]
    fn who_stays_takes_a_knot_now_and_then() {
        let fixes = vec![(0.0, Position::new(5.0, 5.0)), (9990.0, Position::new(5.0, 5.0))];
        let (_, knots, ..) = with_knots(fixes, 1.0);
        assert_eq!(knots.keys().copied().collect::<Vec<_>>(), [0, 255, 510, 765, 999]);
    }

    #[test]
    fn knots_that_were_told_stay_knots() {
        let fixes: Vec<(f64, Position)> =
            (0..500).map(|n| (10.0 * f64::from(n), Position::new(15.0 * f64::from(n), 0.0))).collect();
        let (track, knots, grid, chart, slots) = with_knots(fixes, 20.0);
        let told: BTreeMap<u32, Cell> = [17, 300]
            .map(|slot| (slot, grid.knot_cell(&chart, &track.at(10.0 * f64::from(slot)).unwrap()).unwrap()))
            .into();
        assert!(!knots.contains_key(&17));
        let ways = Knots { slots: &slots, grid: &grid, chart: &chart, has_depth: false, off_max_m: 20.0 };
        let again: BTreeMap<u32, Cell> = ways.of(&track, &told, 0).into_iter().flatten().collect();
        assert!(told.iter().all(|(slot, cell)| again.get(slot) == Some(cell)), "{again:?}");
    }

    #[test]
    fn nobody_went_straight_where_the_grid_does_not_reach() {
        let (_, _, grid, chart, slots) = with_knots(vec![(0.0, Position::new(0.0, 0.0))], 15.0);
        // Out of the grid and back elsewhere, and away for longer than a leg may be.
        let far_m = 1e3 * grid.cell_m;
        let north_m = |slot: u32| if slot < 700 { 0.0 } else { grid.cell_m };
        let east_m = |slot: u32| if (100..120).contains(&slot) || (300..700).contains(&slot) { far_m } else { 0.0 };
        let fix = |slot: u32| (10.0 * f64::from(slot), Position::new(east_m(slot), north_m(slot)));
        let track = Track::new((0..800).map(fix).collect());
        let knots = Knots { slots: &slots, grid: &grid, chart: &chart, has_depth: false, off_max_m: 15.0 };
        let runs = knots.of(&track, &BTreeMap::new(), 0);
        let ends = |run: &Vec<(u32, Cell)>| (run[0].0, run[run.len() - 1].0);
        assert_eq!(runs.iter().map(ends).collect::<Vec<_>>(), [(0, 99), (120, 299), (700, 799)]);
        assert!(runs.iter().all(|run| run.windows(2).all(|leg| leg[1].0 - leg[0].0 <= LEG_SLOTS_MAX)));
    }

    /// Legs of random length and direction, at times a loop, that begin in the middle of nowhere.
    fn any_track() -> impl Strategy<Value = Vec<(f64, Position)>> {
        let leg = (10.0..400.0f64, -0.02..0.02f64, -0.5..0.5f64);
        prop::collection::vec(leg, 1..12).prop_map(|legs| {
            let (mut time_s, mut at, mut heading) =
                (0.0, Position { depth_m: Some(20.0), ..Position::new(0.0, 0.0) }, 0.0f64);
            let mut fixes = vec![(time_s, at)];
            for (took_s, turn_per_s, climb) in legs {
                for _ in 0..(took_s / 5.0) as usize {
                    (time_s, heading) = (time_s + 5.0, heading + 5.0 * turn_per_s);
                    let depth_m = at.depth_m.map(|depth_m| (depth_m + climb).clamp(0.0, 40.0));
                    at = Position {
                        depth_m,
                        ..Position::new(at.east_m + 7.0 * heading.cos(), at.north_m + 7.0 * heading.sin())
                    };
                    fixes.push((time_s, at));
                }
            }
            fixes
        })
    }

    proptest! {
        #[test]
        fn no_slot_is_farther_off_than_it_may_be(fixes in any_track(), off_cells in 0.3..2.0f64, told_share in 0.0..1.0f64) {
            let chart = Chart::about(fixes.iter().map(|fix| fix.1));
            let grid = Grid::covering(&chart, fixes.iter().map(|fix| fix.1));
            let slots = Slots::in_turn(10.0, ["a", "b"].map(VehicleId::new).into());
            let knots = Knots { slots: &slots, grid: &grid, chart: &chart, has_depth: true, off_max_m: off_cells * grid.cell_m };
            // What is told of the first part stays.
            let told_fixes = fixes[..(told_share * fixes.len() as f64) as usize].to_vec();
            let told: BTreeMap<u32, Cell> =
                knots.of(&Track::new(told_fixes), &BTreeMap::new(), 0).into_iter().flatten().collect();
            let track = Track::new(fixes);
            let runs = knots.of(&track, &told, 0);
            prop_assert_eq!(runs.len(), 1);
            prop_assert!(told.iter().all(|knot| runs[0].contains(&(*knot.0, *knot.1))));
            // From what was told on it is the same, whatever was before.
            if let Some((&begin, _)) = told.last_key_value() {
                let onward: Vec<_> = runs[0].iter().copied().filter(|knot| knot.0 >= begin).collect();
                prop_assert_eq!(&knots.of(&track, &told, begin), &[onward]);
            }
            let mut told_track = ToldTrack::default();
            told_track.take(&runs[0]);
            for slot in runs[0][0].0..=runs[0][runs[0].len() - 1].0 {
                let place = |cell| grid.knot_position(&chart, cell, true);
                let found = told_track.at(slot, &slots, &place, 0.0).unwrap();
                let is = track.at(10.0 * f64::from(slot)).unwrap();
                prop_assert!(off_m(&found, &is) <= knots.off_max_m, "slot {} is off by {} m", slot, off_m(&found, &is));
                let deep_m = found.depth_m.unwrap() - is.depth_m.unwrap();
                prop_assert!(deep_m.abs() <= grid.depth_cell_m, "slot {} is {} m too deep", slot, deep_m);
            }
        }
    }

    #[test]
    fn a_circle_takes_fewer_knots_than_places_on_it() {
        let (radius_m, off_max_m, step, stops) = (200.0f64, 15.0, 0.05, 2000u32);
        let position = |angle: f64| Position::new(radius_m * angle.cos(), radius_m * angle.sin());
        let fixes = (0..stops).map(|slot| (10.0 * f64::from(slot), position(step * f64::from(slot))));
        let (_, knots, ..) = with_knots(fixes.collect(), off_max_m);
        // A chord from place to place is farthest inside in its middle; one from outside to outside is that far off on both sides.
        let whole_steps = |half_cosine: f64| (2.0 * half_cosine.acos() / step).floor();
        let (on_it, outside) =
            (whole_steps(1.0 - off_max_m / radius_m), whole_steps((radius_m - off_max_m) / (radius_m + off_max_m)));
        assert_eq!((on_it, outside), (15.0, 21.0));
        let steps = f64::from(stops - 1) / (knots.len() - 1) as f64;
        assert!((1.2 * on_it..=outside).contains(&steps), "{steps} steps a leg");
    }
}
