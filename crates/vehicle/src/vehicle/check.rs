//! Checks of the values in messages.

use pingmap_agent::{Event, Geographic, Position, VehicleId, bounds};

use crate::protocol::fault::{Fault, FaultCode};
use crate::protocol::place::Place;
use crate::vehicle::ledger::LEAD_S_MAX;
use crate::vehicle::state::Vehicle;

impl Vehicle {
    /// Checks the time of an input. Times may be late: a host may report a position or a reception after others.
    pub(crate) fn check_time(&self, field: &str, time_s: f64) -> Result<(), Fault> {
        self.check_any_time(field, time_s)?;
        let first_s = self.unconfirmed.as_ref().map(|first| first.nav.time);
        let before_s = self.ledger.clock_s().into_iter().chain(first_s).reduce(f64::max);
        match before_s {
            Some(before_s) if time_s - before_s > LEAD_S_MAX => {
                let expected = format!("at most a day after {before_s}, the time of the last nav");
                Err(Fault::of_field(FaultCode::WrongTime, field, time_s, expected))
            }
            _ => Ok(()),
        }
    }

    /// Checks that a time is within bounds, without a limit relative to the clock.
    pub(crate) fn check_any_time(&self, field: &str, time_s: f64) -> Result<(), Fault> {
        match bounds::TIME_S.check(time_s) {
            Some(_) => Ok(()),
            None => Err(Fault::of_field(FaultCode::OutOfBounds, field, time_s, bounds::TIME_S)),
        }
    }

    /// Checks that an interval does not end before it begins.
    pub(crate) fn check_interval(&self, from_s: f64, to_s: f64) -> Result<(), Fault> {
        self.check_time("from", from_s)?;
        self.check_time("to", to_s)?;
        if to_s < from_s {
            return Err(Fault::of_field(FaultCode::OutOfBounds, "to", to_s, format!("at least from, {from_s}")));
        }
        Ok(())
    }

    /// Checks a standard deviation, if there is one.
    pub(crate) fn check_sigma(&self, field: &str, sigma: Option<f64>) -> Result<(), Fault> {
        match sigma.filter(|&sigma| bounds::NOT_NEGATIVE.check(sigma).is_none()) {
            Some(sigma) => Err(Fault::of_field(FaultCode::OutOfBounds, field, sigma, bounds::NOT_NEGATIVE)),
            None => Ok(()),
        }
    }

    /// Checks that a vehicle is another member of the team.
    pub(crate) fn check_peer(&self, field: &str, id: &VehicleId) -> Result<(), Fault> {
        let team = self.agent.team();
        if team.is_member(id) && id != self.id() {
            return Ok(());
        }
        let others = team.members.values().filter(|id| *id != self.id());
        let others: Vec<&str> = others.map(VehicleId::as_str).collect();
        let expected = format!("another member of the team: {}", others.join(", "));
        Err(Fault::of_field(FaultCode::UnknownMember, field, id.as_str(), expected))
    }

    /// Returns a place in metres of the chart.
    pub(crate) fn position(&self, field: &str, place: &Place) -> Result<Position, Fault> {
        let wrong = |found: String, expected: &str| Fault::of_field(FaultCode::WrongPlace, field, found, expected);
        let found = || serde_json::to_string(place).unwrap_or_default();
        let (east_m, north_m) = match (place.x.zip(place.y), place.lat.zip(place.lon)) {
            (Some(metres), None) if place.lat.is_none() && place.lon.is_none() => metres,
            (None, Some((latitude, longitude))) if place.x.is_none() && place.y.is_none() => {
                let degrees = Geographic::new(latitude, longitude)
                    .ok_or_else(|| wrong(found(), "a latitude from -90 to 90 and a longitude from -180 to 360"))?;
                let place = pingmap_import::Place::Degrees(degrees);
                self.reference.metres(place).ok_or_else(|| {
                    wrong(found(), "x and y, because the model of the team has no reference system for degrees")
                })?
            }
            _ => return Err(wrong(found(), "either x and y in metres, or lat and lon in degrees")),
        };
        for (name, value) in [("x", Some(east_m)), ("y", Some(north_m)), ("depth", place.depth)] {
            if let Some(value) = value.filter(|&value| bounds::COORDINATE_M.check(value).is_none()) {
                let field = format!("{field}.{name}");
                return Err(Fault::of_field(FaultCode::OutOfBounds, &field, value, bounds::COORDINATE_M));
            }
        }
        if let Some(heading) = place.heading.filter(|&heading| bounds::HEADING_DEG.check(heading).is_none()) {
            let field = format!("{field}.heading");
            return Err(Fault::of_field(FaultCode::OutOfBounds, &field, heading, bounds::HEADING_DEG));
        }
        let position = Position { east_m, north_m, depth_m: place.depth, heading_deg: place.heading };
        if self.is_off_chart(&position) {
            let expected = format!("a place within {:.0} km of the origin of the chart", self.reach_m() / 1000.0);
            return Err(wrong(found(), &expected));
        }
        Ok(position)
    }

    /// Returns whether a place is so far from the chart of the team that it must be wrong.
    fn is_off_chart(&self, position: &Position) -> bool {
        position.distance_m(&self.agent.team().model.chart.origin) > self.reach_m()
    }

    fn reach_m(&self) -> f64 {
        (30.0 * self.agent.team().model.chart.scale_m).max(50_000.0)
    }

    /// Returns whether the model can use an event: it has the depths that the model needs.
    pub(crate) fn is_usable(&self, event: &Event) -> bool {
        let has_depths = event.link.ends().iter().all(|end| end.depth_m.is_some());
        has_depths || !self.agent.team().model.inputs.has_depths()
    }
}
