//! Where somebody was, by the knots that it told.

use std::collections::BTreeMap;
use std::ops::Range;

use pingmap_packet::Cell;

use crate::event::Position;
use crate::slots::Slots;
use crate::track::between;

/// What all reports of somebody say of where it was.
#[derive(Debug, Clone, Default)]
pub(crate) struct ToldTrack {
    /// Cells by slot: of different ones for one slot the first.
    knots: BTreeMap<u32, Cell>,
    /// Where legs begin, and how far the longest from there reaches. Only between neighbours in one report it went straight on: from
    /// the last of one report to the first of a later one there may be others, in reports that were lost.
    legs: BTreeMap<u32, u32>,
}

impl ToldTrack {
    /// Takes in the knots of a report, in the order of their slots.
    pub(crate) fn take(&mut self, knots: &[(u32, Cell)]) {
        for &(slot, cell) in knots {
            let known = self.knots.entry(slot).or_insert(cell);
            *known = cell.min(*known);
        }
        for leg in knots.windows(2) {
            let end = self.legs.entry(leg[0].0).or_default();
            *end = leg[1].0.max(*end);
        }
    }

    /// Cells by slot.
    pub(crate) fn knots(&self) -> &BTreeMap<u32, Cell> {
        &self.knots
    }

    /// Where it was at the beginning of a slot: straight along a leg; straight between knots that are no more than twice
    /// `onward_s_max` apart, whatever was told in between; and for `onward_s_max` straight on behind a leg, but no deeper nor higher.
    pub(crate) fn at(
        &self,
        slot: u32,
        slots: &Slots,
        place: &dyn Fn(Cell) -> Position,
        onward_s_max: f64,
    ) -> Option<Position> {
        let fix = |(&slot, &cell): (&u32, &Cell)| Some((slots.begin_s(slot)?, place(cell)));
        let before = self.knots.range(..=slot).next_back()?;
        let (time_s, from) = (slots.begin_s(slot)?, fix(before)?);
        if *before.0 == slot {
            return Some(from.1);
        }
        if let Some(after) = self.knots.range(slot..).next() {
            let to = fix(after)?;
            if self.is_leg(*before.0, *after.0) || to.0 - from.0 <= 2.0 * onward_s_max {
                return Some(between(&from, &to, time_s));
            }
        }
        if time_s - from.0 > onward_s_max {
            return None;
        }
        let earlier = self.knots.range(..before.0).next_back().filter(|earlier| self.is_leg(*earlier.0, *before.0));
        Some(match earlier {
            Some(earlier) => Position { depth_m: from.1.depth_m, ..between(&fix(earlier)?, &from, time_s) },
            None => from.1,
        })
    }

    /// Outside of these slots it was at the same places with these knots of one report beside all others as without them, whichever
    /// is the case now: from the knot before them to the second behind them, because behind a leg it goes on along it.
    pub(crate) fn moved_by(&self, knots: &[(u32, Cell)]) -> Range<u32> {
        let (Some(&(first, _)), Some(&(last, _))) = (knots.first(), knots.last()) else { return 0..0 };
        let before = self.knots.range(..first).next_back();
        let behind = self.knots.range(last.saturating_add(1)..).nth(1);
        before.map_or(first, |(&slot, _)| slot)..behind.map_or(u32::MAX, |(&slot, _)| slot)
    }

    /// Whether it went straight from one slot to a later one. No leg is longer than the number of slots from knot to knot can say.
    fn is_leg(&self, from: u32, to: u32) -> bool {
        let first = to.saturating_sub(u8::MAX.into());
        first <= from && self.legs.range(first..=from).any(|(_, &end)| end >= to)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::event::VehicleId;
    use proptest::prelude::*;

    /// Ten metres a cell eastwards.
    fn place(cell: Cell) -> Position {
        Position::new(10.0 * f64::from(cell.east), 0.0)
    }

    fn track(reports: &[&[(u32, u8)]]) -> ToldTrack {
        let mut track = ToldTrack::default();
        for report in reports {
            let knots = report.iter().map(|&(slot, east)| (slot, Cell { east, north: 0, depth: 0 }));
            track.take(&knots.collect::<Vec<_>>());
        }
        track
    }

    fn east_m(track: &ToldTrack, slot: u32) -> Option<f64> {
        let slots = Slots::in_turn(10.0, ["a", "b"].map(VehicleId::new).into());
        track.at(slot, &slots, &place, 40.0).map(|at| at.east_m.round())
    }

    #[test]
    fn between_reports_nobody_went_straight() {
        let (first, lost, last): ([_; 2], [_; 3], [_; 2]) =
            ([(0, 0), (20, 20)], [(20, 20), (40, 20), (60, 0)], [(60, 0), (80, 40)]);
        let heard = track(&[&first, &last]);
        assert_eq!(east_m(&heard, 10), Some(100.0));
        assert_eq!(east_m(&heard, 70), Some(200.0));
        // Straight on for 40 s, and then who knows.
        assert_eq!(east_m(&heard, 24), Some(240.0));
        assert_eq!((25..60).find_map(|slot| east_m(&heard, slot)), None);
        // In any order, when the one in between comes again.
        let all = [track(&[&first, &last, &lost]), track(&[&lost, &last, &first, &lost])];
        for track in all {
            let found = [24, 30, 50, 59].map(|slot| east_m(&track, slot).unwrap());
            assert_eq!(found, [200.0, 200.0, 100.0, 10.0]);
        }
    }

    #[test]
    fn reports_may_be_farther_apart_than_any_leg_is_long() {
        let heard = track(&[&[(0, 0), (255, 51)], &[(1000, 51), (1255, 0)]]);
        let found = [100, 255, 259, 500, 1000, 1005].map(|slot| east_m(&heard, slot));
        assert_eq!(found, [Some(200.0), Some(510.0), Some(518.0), None, Some(510.0), Some(500.0)]);
    }

    #[test]
    fn knots_soon_after_each_other_say_enough() {
        let heard = track(&[&[(0, 0), (20, 20)], &[(28, 12), (40, 0)]]);
        assert_eq!(east_m(&heard, 24), Some(160.0));
        let heard = track(&[&[(0, 0), (20, 20)], &[(29, 12), (40, 0)]]);
        assert_eq!(east_m(&heard, 24), Some(240.0));
    }

    proptest! {
        /// A report that comes or goes moves nobody outside of the slots that it says it does.
        #[test]
        fn a_report_moves_its_sender_for_a_while(
            steps in prop::collection::vec(prop::collection::vec((1..9u32, 0..50u8), 1..4), 1..6), begins in prop::collection::vec(0..40u32, 6),
        ) {
            let report = |(steps, begin): (&Vec<(u32, u8)>, &u32)| {
                let slots = steps.iter().scan(*begin, |slot, step| { *slot += step.0; Some(*slot) });
                slots.zip(steps).map(|(slot, step)| (slot, step.1)).collect::<Vec<_>>()
            };
            let reports: Vec<Vec<(u32, u8)>> = steps.iter().zip(&begins).map(report).collect();
            let all: Vec<&[(u32, u8)]> = reports.iter().map(Vec::as_slice).collect();
            let (with, without) = (track(&all), track(&all[1..]));
            let knots: Vec<(u32, Cell)> = all[0].iter().map(|&(slot, east)| (slot, Cell { east, north: 0, depth: 0 })).collect();
            prop_assert_eq!(with.moved_by(&knots), without.moved_by(&knots));
            let moved = with.moved_by(&knots);
            prop_assert!((0..80).filter(|slot| !moved.contains(slot)).all(|slot| east_m(&with, slot) == east_m(&without, slot)));
        }
    }

    #[test]
    fn behind_the_last_leg_it_goes_on_for_a_while() {
        let heard = track(&[&[(0, 0), (20, 20)]]);
        assert_eq!([23, 24, 25].map(|slot| east_m(&heard, slot)), [Some(230.0), Some(240.0), None]);
        // Of whom one place is known nobody knows where it went.
        assert_eq!(east_m(&track(&[&[(20, 20)]]), 23), Some(200.0));
        assert_eq!(east_m(&track(&[&[(20, 20)]]), 19), None);
    }
}
