//! The extent of positions, and the tracks of vehicles as lines of a figure.

use std::collections::BTreeMap;

use pingmap_agent::{Event, Link, VehicleId};

use crate::figure::{Mark, Series, Style};
use crate::grid::Point;

/// Returns the extent of positions with a margin of a twentieth, at least 50 m. The shorter side is at least half the
/// longer one, so that a straight survey line makes a usable figure.
pub fn widened(places: impl Iterator<Item = Point>) -> (Point, Point) {
    let (mut east, mut north) = ((f64::MAX, f64::MIN), (f64::MAX, f64::MIN));
    for place in places {
        east = (east.0.min(place.0), east.1.max(place.0));
        north = (north.0.min(place.1), north.1.max(place.1));
    }
    let longest = (east.1 - east.0).max(north.1 - north.0);
    let widen = |(low, high): (f64, f64)| {
        let margin = f64::max(f64::max(50.0, 0.05 * longest), 0.5 * (0.5 * longest - (high - low)));
        (low - margin, high + margin)
    };
    (widen(east), widen(north))
}

/// Returns the positions of each vehicle in order of time. Successive equal positions are merged, so a stationary
/// vehicle has one position.
pub fn tracks(events: &[Event]) -> BTreeMap<&VehicleId, Vec<Point>> {
    let mut in_time: Vec<&Event> = events.iter().collect();
    in_time.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    let mut tracks: BTreeMap<&VehicleId, Vec<Point>> = BTreeMap::new();
    for event in in_time {
        let Link { transmitter, receiver } = &event.link;
        for (id, end) in [(&event.transmitter_id, transmitter), (&event.receiver_id, receiver)] {
            let track = tracks.entry(id).or_default();
            let point = (end.east_m, end.north_m);
            if track.last() != Some(&point) {
                track.push(point);
            }
        }
    }
    tracks
}

/// Colours that differ in lightness, dashes and markers.
const COLORS: [&str; 4] = ["#d7301f", "#1b9e77", "#984ea3", "#ff7f00"];
const DASHES: [&[f64]; 4] = [&[], &[8.0, 4.0], &[2.0, 3.0], &[10.0, 3.0, 2.0, 3.0]];
const MARKS: [Mark; 4] = [Mark::Square, Mark::Triangle, Mark::Diamond, Mark::Dot];

/// Returns the style of the n-th vehicle. Of the first sixteen, no two share colour and marker, nor colour and dashes.
pub fn style(n: usize) -> Style<'static> {
    let round = n / COLORS.len();
    let pick = |shift: usize| (n + shift) % COLORS.len();
    Style { color: COLORS[pick(0)], width: 1.6, dash: DASHES[pick(2 * round + round / 2)], mark: MARKS[pick(round)] }
}

/// Returns the tracks as series of a figure.
pub fn tracks_as_series<'a>(tracks: &'a BTreeMap<&VehicleId, Vec<Point>>) -> Vec<Series<'a>> {
    let series = tracks.iter().enumerate();
    series.map(|(n, (id, points))| Series { name: id.as_str(), points, style: style(n) }).collect()
}
