//! Compares the reported tracks of members with the positions at which the vehicle received them.

use std::collections::{BTreeMap, BTreeSet};

use pingmap_packet::Cell;

use crate::codec::team_codec::TeamCodec;
use crate::store::events::Events;
use crate::store::reports::Reports;
use crate::types::event::{Event, Position};

/// Minimum number of receptions that contradict a track.
const CONTRADICTIONS_MIN: usize = 3;

/// Returns the members whose reported tracks are wrong: most receptions of the member, and three at least, contradict
/// its track. Tracks of such members locate no events. O(own events · log waypoints).
///
/// A reception contradicts a track if the transmitter position in the vehicle's event is farther from the track than
/// [`tolerance_m`]. Slots between two reports and after the last waypoint are not compared, because the track is not
/// exact there.
pub(crate) fn members_with_wrong_tracks(codec: &TeamCodec, events: &Events, reports: &Reports) -> BTreeSet<u8> {
    let tolerance_m = tolerance_m(codec);
    let mut receptions = BTreeMap::<u8, (usize, usize)>::new();
    for recorded in events.recorded().iter().filter(|recorded| recorded.event.success) {
        let Some((_, slot)) = recorded.key else { continue };
        let Some(member) = codec.team.number(&recorded.event.transmitter_id) else { continue };
        let Some(distance_m) = distance_from_track_m(codec, reports, member, slot, &recorded.event) else { continue };
        let (all, contradictions) = receptions.entry(member).or_default();
        *all += 1;
        *contradictions += usize::from(distance_m > tolerance_m);
    }
    let is_wrong =
        |&(all, contradictions): &(usize, usize)| contradictions >= CONTRADICTIONS_MIN && 2 * contradictions > all;
    receptions.into_iter().filter(|(_, counts)| is_wrong(counts)).map(|(member, _)| member).collect()
}

/// Returns the largest distance, in metres, between a correct track and a position. It is twice the sum of the diagonal
/// of a waypoint cell and the tolerance of track simplification.
fn tolerance_m(codec: &TeamCodec) -> f64 {
    2.0 * (0.25 * codec.team.grid.cell_m * std::f64::consts::SQRT_2 + codec.team.track_tolerance_m)
}

/// Returns the horizontal distance between the transmitter position of an event and the member's reported track, in
/// metres.
fn distance_from_track_m(codec: &TeamCodec, reports: &Reports, member: u8, slot: u32, event: &Event) -> Option<f64> {
    if !reports.reports_of(member)?.track.is_exact_at(slot) {
        return None;
    }
    let at = reported_position(codec, reports, member, slot)?;
    Some(event.link.transmitter.distance_m(&at))
}

/// Returns the position of a member at the beginning of a slot, according to its reports. O(log waypoints).
pub(crate) fn reported_position(codec: &TeamCodec, reports: &Reports, member: u8, slot: u32) -> Option<Position> {
    let team = &codec.team;
    let centre = |cell: Cell| team.grid.waypoint_position(&team.model.chart, cell, team.model.inputs.has_depths());
    reports.reports_of(member)?.track.at(slot, &team.slots, &centre, team.extrapolation_s_max)
}
