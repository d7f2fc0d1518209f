//! A planned track, and the messages that are sent along it.

use pingmap_agent::Position;
use pingmap_import::{Reference, Waypoint};

use crate::output::BadInput;
use crate::reference::position;

/// Waypoints with straight lines between them.
#[derive(Debug, Clone, PartialEq)]
pub struct Route {
    /// Arrival time and position of each waypoint.
    pub waypoints: Vec<(f64, Position)>,
    /// Name of each waypoint, if given.
    pub names: Vec<Option<String>>,
}

/// A message that is sent along the track.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sending {
    /// Index of the waypoint at which the leg begins.
    pub leg: usize,
    pub time_s: f64,
    pub position: Position,
}

/// Largest number of messages of a plan.
const SENDINGS_MAX: f64 = 20_000.0;

impl Route {
    /// Creates a route. Waypoints without times are reached at the given speed, from time 0 on. Depths that are not
    /// given are `depth_m`.
    ///
    /// # Errors
    /// Fails for a single waypoint, for times at only some waypoints, for times that do not rise, and for places
    /// outside the reference system.
    pub fn new(
        list: &[Waypoint],
        reference: &Reference,
        speed_m_per_s: f64,
        depth_m: Option<f64>,
    ) -> Result<Self, BadInput> {
        let bad = |message: String| Err(BadInput(format!("--along: {message}")));
        if list.len() < 2 {
            return bad("one waypoint is not a track; expected at least two".into());
        }
        let timed = list.iter().filter(|waypoint| waypoint.time_s.is_some()).count();
        if timed != 0 && timed != list.len() {
            return bad(format!("{timed} of {} waypoints have a time; expected all, or none", list.len()));
        }
        let mut waypoints: Vec<(f64, Position)> = Vec::with_capacity(list.len());
        for waypoint in list {
            if waypoint.depth_m.is_some() && depth_m.is_none() {
                return bad("the log has no depths; expected waypoints without them".into());
            }
            let place = position("--along", waypoint.place, reference)?;
            let place = Position { depth_m: waypoint.depth_m.or(depth_m), ..place };
            let time_s = match (waypoint.time_s, waypoints.last()) {
                (Some(time_s), Some(&(before_s, _))) if time_s <= before_s => {
                    return bad(format!("a waypoint at {time_s} s follows one at {before_s} s; expected rising times"));
                }
                (Some(time_s), _) => time_s,
                (None, None) => 0.0,
                (None, Some(&(before_s, before))) => before_s + distance_m(before, place) / speed_m_per_s,
            };
            waypoints.push((time_s, place));
        }
        Ok(Self { waypoints, names: list.iter().map(|waypoint| waypoint.name.clone()).collect() })
    }

    /// Returns the time from the first to the last waypoint.
    pub fn duration_s(&self) -> f64 {
        self.waypoints[self.waypoints.len() - 1].0 - self.waypoints[0].0
    }

    /// Returns the length of the leg that begins at a waypoint.
    pub fn length_m(&self, leg: usize) -> f64 {
        distance_m(self.waypoints[leg].1, self.waypoints[leg + 1].1)
    }

    /// Returns the number of legs.
    pub fn legs(&self) -> usize {
        self.waypoints.len() - 1
    }

    /// Returns messages every `every_s` seconds, from the first waypoint on.
    ///
    /// # Errors
    /// Fails for more than 20,000 messages.
    pub fn sendings(&self, every_s: f64) -> Result<Vec<Sending>, BadInput> {
        let count = (self.duration_s() / every_s + 1e-9).floor() + 1.0;
        if count > SENDINGS_MAX {
            let message = format!("--every-s {every_s}: {count} messages; expected at most {SENDINGS_MAX}");
            return Err(BadInput(message));
        }
        let start_s = self.waypoints[0].0;
        let mut leg = 0;
        let at = |n: usize| {
            let time_s = start_s + n as f64 * every_s;
            while leg + 1 < self.legs() && time_s >= self.waypoints[leg + 1].0 {
                leg += 1;
            }
            Sending { leg, time_s, position: self.position(leg, time_s) }
        };
        Ok((0..count as usize).map(at).collect())
    }

    fn position(&self, leg: usize, time_s: f64) -> Position {
        let [(from_s, from), (to_s, to)] = [self.waypoints[leg], self.waypoints[leg + 1]];
        let share = if to_s > from_s { ((time_s - from_s) / (to_s - from_s)).clamp(0.0, 1.0) } else { 0.0 };
        let between = |a: f64, b: f64| a + (b - a) * share;
        Position {
            east_m: between(from.east_m, to.east_m),
            north_m: between(from.north_m, to.north_m),
            depth_m: from.depth_m.zip(to.depth_m).map(|(a, b)| between(a, b)),
            heading_deg: from.course_deg(&to),
        }
    }
}

fn distance_m(a: Position, b: Position) -> f64 {
    let down_m = a.depth_m.zip(b.depth_m).map_or(0.0, |(a, b)| a - b);
    (a.east_m - b.east_m).hypot(a.north_m - b.north_m).hypot(down_m)
}

#[cfg(test)]
mod tests {
    use super::*;
    use pingmap_import::Place;

    fn waypoint(east_m: f64, north_m: f64, time_s: Option<f64>) -> Waypoint {
        Waypoint { name: None, time_s, place: Place::Metres(east_m, north_m), depth_m: None }
    }

    fn route(list: &[Waypoint]) -> Result<Route, BadInput> {
        Route::new(list, &Reference::unknown(), 2.0, None)
    }

    #[test]
    fn messages_are_sent_along_straight_legs() {
        let route =
            route(&[waypoint(0.0, 0.0, None), waypoint(30.0, 40.0, None), waypoint(30.0, 140.0, None)]).unwrap();
        assert_eq!((route.duration_s(), route.length_m(1), route.legs()), (75.0, 100.0, 2));
        let sendings = route.sendings(12.5).unwrap();
        assert_eq!(sendings.len(), 7);
        let course_deg = 30f64.atan2(40.0).to_degrees();
        let heading = |heading_deg, position| Position { heading_deg: Some(heading_deg), ..position };
        let position = heading(course_deg, Position::new(15.0, 20.0));
        assert_eq!(sendings[1], Sending { leg: 0, time_s: 12.5, position });
        // A leg begins at its waypoint. The last message is sent at the end.
        assert_eq!((sendings[2].leg, sendings[2].position), (1, heading(0.0, Position::new(30.0, 40.0))));
        assert_eq!((sendings[6].leg, sendings[6].position), (1, heading(0.0, Position::new(30.0, 140.0))));
    }

    #[test]
    fn invalid_tracks_are_refused() {
        let (here, there) = (waypoint(0.0, 0.0, Some(5.0)), waypoint(9.0, 0.0, Some(5.0)));
        assert!(route(std::slice::from_ref(&here)).unwrap_err().0.contains("at least two"));
        assert!(route(&[here.clone(), there]).unwrap_err().0.contains("rising"));
        assert!(route(&[here.clone(), waypoint(9.0, 0.0, None)]).unwrap_err().0.contains("1 of 2"));
        let timed = route(&[here.clone(), waypoint(9.0, 0.0, Some(1e7))]).unwrap();
        assert!(timed.sendings(1.0).unwrap_err().0.contains("--every-s"));
        let deep = Waypoint { depth_m: Some(3.0), ..here };
        assert!(route(&[deep, waypoint(9.0, 0.0, Some(9.0))]).unwrap_err().0.contains("no depths"));
        // Two waypoints at one position are a leg of length 0, which divides nothing by 0.
        let stop = route(&[waypoint(0.0, 0.0, None), waypoint(0.0, 0.0, None)]).unwrap();
        assert_eq!(stop.sendings(10.0).unwrap()[0].position, Position::new(0.0, 0.0));
    }
}
