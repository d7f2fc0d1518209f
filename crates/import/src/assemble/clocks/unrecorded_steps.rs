//! Separate offsets before and after each step of a clock that no record shows.

use crate::assemble::clocks::fleet_clocks::FleetClocks;
use crate::assemble::clocks::step::{ClockStep, find_step};
use crate::assemble::vehicles::fleet::Fleet;
use crate::assemble::vehicles::transmission::Reception;

impl FleetClocks {
    /// Adds a segment to the clock with the clearest step, and returns whether any clock has a step.
    ///
    /// All clocks have constant offsets so far. A step of one clock also shows in the comparisons of every other clock
    /// with it, but less clearly. The reference clock has no step: if it seems to step, and the rules do not name it,
    /// another vehicle becomes the reference.
    pub(crate) fn split_at_step(&mut self, fleet: &Fleet, receptions: &[Reception]) -> bool {
        if fleet.rules.clock_offset_s_max == 0.0 {
            return false;
        }
        let comparisons: Vec<_> = self.comparisons(fleet, receptions).map(|(_, comparison)| comparison).collect();
        let candidates = (0..self.clocks.len()).filter(|&vehicle| {
            let is_free = vehicle != self.reference || fleet.reference_clock().is_none();
            is_free && self.clocks[vehicle].is_determined
        });
        let steps = candidates.flat_map(|vehicle| {
            let segments = self.clocks[vehicle].implied_offsets(vehicle, &comparisons, &self.clocks);
            segments.into_iter().filter_map(move |points| Some((vehicle, find_step(points)?)))
        });
        // Two vehicles alone show one step alike. It then belongs to the one that is not the reference.
        let rank = |&(vehicle, step): &(usize, ClockStep)| (step.gain, vehicle != self.reference);
        let clearest = steps.max_by(|a, b| rank(a).partial_cmp(&rank(b)).unwrap_or(std::cmp::Ordering::Equal));
        let Some((vehicle, step)) = clearest else { return false };
        self.clocks[vehicle].divide_segment(step.time_s, step.before_s, step.after_s);
        self.steps.push((vehicle, step));
        vehicle != self.reference || self.replace_reference(receptions)
    }

    /// Makes the vehicle with the most receptions, and without a step of its clock, the reference of all offsets.
    /// Returns whether one exists.
    fn replace_reference(&mut self, receptions: &[Reception]) -> bool {
        let count = |vehicle: usize| {
            receptions.iter().filter(|one| [one.transmission.clock, one.receiver].contains(&vehicle)).count()
        };
        let is_steady =
            |&vehicle: &usize| self.clocks[vehicle].is_determined && self.clocks[vehicle].segments().count() == 1;
        let steady = (0..self.clocks.len()).filter(is_steady);
        let Some(reference) = steady.max_by_key(|&vehicle| count(vehicle)) else { return false };
        let offset_s = self.clocks[reference].offset_s(0.0);
        self.clocks.iter_mut().for_each(|clock| clock.shift(-offset_s));
        self.reference = reference;
        true
    }
}
