//! Where a vehicle was: what its navigation says, and the few knots that tell it.

use std::collections::BTreeMap;

use pingmap_packet::Cell;

use crate::chart::Chart;
use crate::event::Position;
use crate::grid::Grid;
use crate::slots::Slots;

/// Slots between two knots at most: what a knot has room for.
const LEG_SLOTS_MAX: u32 = u8::MAX as u32;

/// Slots beyond the farthest that one leg was found to reach that are tried too: what is off for a moment may come back.
const TRIED_BEYOND: usize = 16;

/// Positions at times, in the order of time.
#[derive(Debug, Clone, Default)]
pub(crate) struct Track(Vec<(f64, Position)>);

impl Track {
    /// Of several positions at one time the first counts, in the order of their numbers.
    pub(crate) fn new(mut fixes: Vec<(f64, Position)>) -> Self {
        let numbers = |position: &Position| {
            [position.east_m, position.north_m, position.depth_m.unwrap_or(f64::NEG_INFINITY)].map(f64::to_bits)
        };
        fixes.sort_by(|a, b| a.0.total_cmp(&b.0).then_with(|| numbers(&a.1).cmp(&numbers(&b.1))));
        fixes.dedup_by(|later, kept| later.0 == kept.0);
        Self(fixes)
    }

    /// The positions.
    pub(crate) fn fixes(self) -> Vec<(f64, Position)> {
        self.0
    }

    /// From the first position to the last.
    pub(crate) fn span_s(&self) -> Option<(f64, f64)> {
        Some((self.0.first()?.0, self.0.last()?.0))
    }

    /// The time of the first position at this time or later.
    pub(crate) fn next_s(&self, time_s: f64) -> Option<f64> {
        self.0.get(self.0.partition_point(|fix| fix.0 < time_s)).map(|fix| fix.0)
    }

    /// Where it was, on the straight way between the positions before and after; `None` before the first and behind the last.
    pub(crate) fn at(&self, time_s: f64) -> Option<Position> {
        self.at_within(time_s, f64::INFINITY)
    }

    /// The same where these two are no more than so many seconds apart.
    pub(crate) fn at_within(&self, time_s: f64, apart_s_max: f64) -> Option<Position> {
        let after = self.0.partition_point(|fix| fix.0 < time_s);
        let next = self.0.get(after)?;
        if next.0 == time_s {
            return Some(next.1);
        }
        let before = self.0.get(after.checked_sub(1)?)?;
        (next.0 - before.0 <= apart_s_max).then(|| between(before, next, time_s))
    }
}

/// Where it was on the straight way from one place to another, or behind it; of two places at one time the latter.
pub(crate) fn between(from: &(f64, Position), to: &(f64, Position), time_s: f64) -> Position {
    let share = if to.0 > from.0 { (time_s - from.0) / (to.0 - from.0) } else { 1.0 };
    let along = |a: f64, b: f64| a + share * (b - a);
    Position {
        east_m: along(from.1.east_m, to.1.east_m),
        north_m: along(from.1.north_m, to.1.north_m),
        depth_m: from.1.depth_m.zip(to.1.depth_m).map(|(a, b)| along(a, b)),
    }
}

/// Where a vehicle was when a slot began.
struct Stop {
    slot: u32,
    time_s: f64,
    at: Position,
    cell: Cell,
    /// The middle of the cell.
    middle: Position,
    /// Whether it was nowhere that could be told in the slot before, or that was too long ago.
    is_new_run: bool,
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
    /// Knots of a track from its first slot to its last, in runs: as few as a search from the beginning on finds, every leg as long
    /// as it may be. What was a knot once stays one (`told`): what others made of it must not change. A run ends where the grid does
    /// not hold the next place: nobody says that it went straight on to where it came back. O(slots · slots of a leg).
    pub(crate) fn of(&self, track: &Track, told: &BTreeMap<u32, Cell>) -> Vec<Vec<(u32, Cell)>> {
        let stops = self.stops(track);
        let runs = stops.chunk_by(|_, next| !next.is_new_run);
        runs.map(|run| self.knots_of_run(run, told)).collect()
    }

    fn knots_of_run(&self, stops: &[Stop], told: &BTreeMap<u32, Cell>) -> Vec<(u32, Cell)> {
        let mut knots = Vec::new();
        let mut from = 0;
        while let Some(begin) = stops.get(from) {
            knots.push((begin.slot, told.get(&begin.slot).copied().unwrap_or(begin.cell)));
            from = if from + 1 == stops.len() { stops.len() } else { self.leg(stops, from, told) };
        }
        knots
    }

    /// The stops of a track: every slot that anybody may send in, of several at one time the first.
    fn stops(&self, track: &Track) -> Vec<Stop> {
        let Some((first_s, last_s)) = track.span_s() else { return Vec::new() };
        let begin = self.slots.number(first_s).unwrap_or(0);
        let slots = (begin..self.slots.end()).map_while(|slot| {
            let time_s = self.slots.begin_s(slot).filter(|&time_s| time_s <= last_s)?;
            Some((slot, time_s))
        });
        let slots = slots.step_by(self.slots.at_once());
        let place = |time_s| {
            let at = track.at(time_s)?;
            Some((at, self.grid.knot_cell(self.chart, &at)?))
        };
        let mut stops: Vec<Stop> = Vec::new();
        let mut is_away = false;
        for (slot, time_s) in slots.filter(|&(slot, _)| self.slots.sender(slot).is_some()) {
            let Some((at, cell)) = place(time_s) else {
                is_away = true;
                continue;
            };
            let is_new_run = is_away || stops.last().is_some_and(|last| slot - last.slot > LEG_SLOTS_MAX);
            let middle = self.grid.knot_position(self.chart, cell, self.has_depth);
            stops.push(Stop { slot, time_s, at, cell, middle, is_new_run });
            is_away = false;
        }
        stops
    }

    /// Where a leg from this stop ends.
    fn leg(&self, stops: &[Stop], from: usize, told: &BTreeMap<u32, Cell>) -> usize {
        let mut reached = from + 1;
        let mut to = from + 1;
        while to < stops.len() && to <= reached + TRIED_BEYOND && stops[to].slot - stops[from].slot <= LEG_SLOTS_MAX {
            if self.is_straight(&stops[from..=to]) {
                reached = to;
            }
            if told.contains_key(&stops[to].slot) {
                return reached;
            }
            to += 1;
        }
        reached
    }

    /// Whether the straight way between the cells of the first and the last stop is nowhere too far from where it was.
    fn is_straight(&self, stops: &[Stop]) -> bool {
        let (Some(from), Some(to)) = (stops.first(), stops.last()) else { return true };
        let ends = [(from.time_s, from.middle), (to.time_s, to.middle)];
        stops.iter().all(|stop| {
            let told = between(&ends[0], &ends[1], stop.time_s);
            let off_m = (told.east_m - stop.at.east_m).hypot(told.north_m - stop.at.north_m);
            let deep_m = told.depth_m.zip(stop.at.depth_m).map_or(0.0, |(a, b)| (a - b).abs());
            off_m <= self.off_max_m && deep_m <= self.grid.depth_cell_m
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::event::VehicleId;
    use crate::told_track::ToldTrack;

    fn with_knots(fixes: Vec<(f64, Position)>, off_max_m: f64) -> (Track, BTreeMap<u32, Cell>, Grid, Chart, Slots) {
        let chart = Chart::about(fixes.iter().map(|fix| fix.1));
        let grid = Grid::covering(&chart, fixes.iter().map(|fix| fix.1));
        let slots = Slots::in_turn(10.0, ["a", "b"].map(VehicleId::new).into());
        let track = Track::new(fixes);
        let knots = Knots { slots: &slots, grid: &grid, chart: &chart, has_depth: false, off_max_m };
        let found = knots.of(&track, &BTreeMap::new()).into_iter().flatten().collect();
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
        let again: BTreeMap<u32, Cell> = ways.of(&track, &told).into_iter().flatten().collect();
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
        let runs = knots.of(&track, &BTreeMap::new());
        let ends = |run: &Vec<(u32, Cell)>| (run[0].0, run[run.len() - 1].0);
        assert_eq!(runs.iter().map(ends).collect::<Vec<_>>(), [(0, 99), (120, 299), (700, 799)]);
        assert!(runs.iter().all(|run| run.windows(2).all(|leg| leg[1].0 - leg[0].0 <= LEG_SLOTS_MAX)));
    }
}
