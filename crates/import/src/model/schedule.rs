//! TDMA schedules: the slots in which each vehicle may transmit.

use pingmap_agent::VehicleId;

/// Length of a day in seconds. Some schedules restart every day.
pub(crate) const DAY_S: f64 = 86_400.0;

/// A schedule of slots. Each slot is by its sender's own clock.
#[derive(Debug, Clone, PartialEq)]
pub enum Schedule {
    /// The members own the slots of a cycle in a fixed order.
    Cyclic {
        /// Length of a slot, in seconds.
        duration_s: f64,
        /// Whether a cycle starts at every midnight.
        restarts_daily: bool,
        /// The time from which each order applies. An empty name marks a slot without an owner.
        orders: Vec<(f64, Vec<VehicleId>)>,
    },
    /// A list of slots: start and owner.
    Explicit(Vec<(f64, VehicleId)>),
}

impl Schedule {
    /// Lists the owners of slots, with repetitions.
    pub fn senders(&self) -> impl Iterator<Item = &VehicleId> {
        let (orders, slots): (&[_], &[_]) = match self {
            Schedule::Cyclic { orders, .. } => (orders, &[]),
            Schedule::Explicit(slots) => (&[], slots),
        };
        let cyclic = orders.iter().flat_map(|(_, order)| order).filter(|name| !name.as_str().is_empty());
        cyclic.chain(slots.iter().map(|(_, sender)| sender))
    }

    /// Returns an upper limit of the number of slots between two times.
    pub fn slots_between(&self, from_s: f64, to_s: f64) -> f64 {
        match self {
            Schedule::Cyclic { duration_s, orders, .. } => {
                let start_s = orders.iter().map(|(start_s, _)| *start_s).fold(f64::INFINITY, f64::min);
                (to_s - from_s.max(start_s)) / duration_s
            }
            Schedule::Explicit(slots) => slots.len() as f64,
        }
    }

    /// Returns the starts of the slots that a sender owns between two times, in seconds.
    pub fn slot_starts_s(&self, sender: &VehicleId, from_s: f64, to_s: f64) -> Vec<f64> {
        let is_within = |time_s: &f64| (from_s..=to_s).contains(time_s);
        let Schedule::Cyclic { duration_s, restarts_daily, orders } = self else {
            let Schedule::Explicit(slots) = self else { return Vec::new() };
            return slots.iter().filter(|slot| slot.1 == *sender).map(|slot| slot.0).filter(is_within).collect();
        };
        let mut starts = Vec::new();
        for (index, (start_s, order)) in orders.iter().enumerate() {
            let end_s = orders.get(index + 1).map_or(f64::INFINITY, |next| next.0);
            // With a daily restart, earlier days have no effect on the requested one.
            let midnight_s = (from_s / DAY_S).floor() * DAY_S;
            let mut cycle_start_s = if *restarts_daily { start_s.max(midnight_s) } else { *start_s };
            while cycle_start_s < end_s.min(to_s) {
                let midnight_s = (cycle_start_s / DAY_S).floor() * DAY_S + DAY_S;
                let cycle_end_s = if *restarts_daily { midnight_s } else { f64::INFINITY };
                let last_s = cycle_end_s.min(end_s).min(to_s);
                let first = ((from_s - cycle_start_s) / duration_s).floor().max(0.0) as u64;
                let slots = (first..).map(|slot| (slot, cycle_start_s + slot as f64 * duration_s));
                let slots = slots.take_while(|slot| slot.1 < cycle_end_s.min(end_s) && slot.1 <= last_s);
                let own_slots = slots.filter(|slot| order[(slot.0 % order.len() as u64) as usize] == *sender);
                starts.extend(own_slots.map(|slot| slot.1).filter(is_within));
                cycle_start_s = cycle_end_s;
            }
        }
        starts
    }
}
