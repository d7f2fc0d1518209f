//! Figures of a report.

use std::collections::BTreeMap;

use anyhow::Context;
use pingmap_agent::{Agent, Event, Link, Position, Time, VehicleId, Which};
use pingmap_trial::{Bin, Calibrated, Calibration, Mission, Plan, Preshared, RangeBin};

use super::replayed::Replayed;
use crate::area::Area;
use crate::cli_enums::Layer;
use crate::data_extent::DataExtent;
use crate::figure::{Arrows, Figure, Mark, Room, Series, Style, curves, link_map};
use crate::grid::Point;
use crate::map_figure::{FigureContent, figure};
use crate::reference::reference;
use crate::success_map::{HATCH_WIDTH, LEVELS, SuccessMap};
use crate::tracks;

/// Largest number of packets per vehicle behind the maps.
const FRAMES_SHOWN: usize = 10;

/// Largest number of packets per vehicle whose points are drawn; more points would hide each other.
pub const PACKETS_DRAWN: usize = 2;

/// Largest number of vehicles whose maps are drawn.
const MAPS_MAX: usize = 6;

/// Number of range bins.
const RANGE_BINS: usize = 12;

/// The map of a vehicle.
pub struct MapPicture {
    pub viewer: VehicleId,
    pub figure: Figure,
    /// The distance within which messages are heard.
    pub sentence: String,
}

pub struct Pictures {
    /// Number of packets per vehicle behind the maps.
    pub frames: usize,
    pub split: String,
    /// Maps of the first vehicles.
    pub maps: Vec<MapPicture>,
    /// Number of all vehicles.
    pub vehicles: usize,
    /// `None` if no packet contains inducing points.
    pub packets: Option<Figure>,
    pub over_range: Figure,
}

impl Pictures {
    /// Replays the first split again with at most [`FRAMES_SHOWN`] packets, and draws the vehicles' predictions.
    pub fn draw(replayed: &Replayed) -> anyhow::Result<Self> {
        let counts = replayed.replay.sharing.iter().map(|sharing| sharing.frames);
        let frames = counts.clone().filter(|&frames| frames <= FRAMES_SHOWN).max().or(counts.min()).unwrap_or(0);
        let split = replayed.splits.first().context("a replay has at least one split")?;
        // The team configuration of this split.
        let found = replayed.replay.splits.first().context("a replay has at least one split")?;
        let plan = Plan { preshared: Preshared::Team(Box::new((*found.team).clone())), ..replayed.plan.clone() };
        let mission = Mission::prepare(&replayed.log, split, &plan, frames)?;
        let mut team = mission.after_sharing(frames)?;
        let vehicles = team.len();
        let extent = DataExtent::of(&replayed.log.events, []);
        let mut maps = Vec::new();
        for agent in team.iter_mut().take(MAPS_MAX) {
            maps.push(map(agent, replayed, &extent)?);
        }
        let over_range = over_range(&mut team, replayed)?;
        let first = team.first().context("every log has a receiver")?;
        let mut sent = first.links_of_packets();
        sent.extend(mission.links_of_packets(0, frames));
        let is_sent = sent.iter().any(|(_, counter, _)| usize::from(*counter) < PACKETS_DRAWN);
        let packets = is_sent.then(|| packets_figure(replayed, &sent));
        Ok(Self { frames, split: split.name.clone(), maps, vehicles, packets, over_range })
    }
}

/// Draws the map of messages from a vehicle's last own position to typical receivers, at the time of its last own
/// event.
fn map(viewer: &mut Agent, replayed: &Replayed, extent: &DataExtent) -> anyhow::Result<MapPicture> {
    let events = &replayed.log.events;
    let last: Option<&Event> = viewer.events().last();
    let at = last.map_or(events[0].link.receiver, |event| event.link.receiver);
    let end_s = last.map(|event| event.time_s);
    let when = end_s.map_or(Time::Typical, Time::At);
    let ends = events.iter().flat_map(|event| event.link.ends());
    let area = Area::around(ends.chain([at]), None)?;
    let map = SuccessMap::of_messages(viewer, at.without_heading(), when, area, extent)?;
    let place = reference(replayed.log.reference)?;
    let content = FigureContent {
        events,
        log: &replayed.whole.name,
        levels: &LEVELS,
        layers: &[Layer::Probability],
        title: None,
        sentence: None,
        reference: Some(&place).filter(|place| place.system().is_known()),
        with_events: false,
        hatch_width: HATCH_WIDTH,
        lines: &[],
    };
    let reach = map.reach(&map.sides[0], LEVELS[1]);
    let sentence = format!("Messages from the last position of {}. {}", viewer.id(), reach.sentence());
    Ok(MapPicture { viewer: viewer.id().clone(), figure: figure(&map, &content, Room::SCREEN), sentence })
}

/// Draws the share of heard events over range, and the receivers' mean predictions for the same events.
fn over_range(team: &mut [Agent], replayed: &Replayed) -> anyhow::Result<Figure> {
    let mut events: Vec<&Event> = replayed.log.events.iter().collect();
    events.sort_by(|a, b| a.link.range_m().total_cmp(&b.link.range_m()));
    let mut predicted = vec![0.0; events.len()];
    for viewer in team {
        let own: Vec<usize> = (0..events.len()).filter(|&n| events[n].receiver_id == *viewer.id()).collect();
        let predictions = viewer.predict(own.iter().map(|&n| events[n].query()), Which::Fused)?;
        own.into_iter().zip(predictions).for_each(|(n, prediction)| predicted[n] = prediction.probability);
    }
    let (mut heard, mut mean_predicted) = (Vec::new(), Vec::new());
    let mut first = 0;
    for RangeBin { from_m, to_m, events, heard: hits } in replayed.log.over_range(RANGE_BINS) {
        let middle_m = (from_m + to_m) / 2.0;
        let of_bin = &predicted[first..first + events];
        first += events;
        heard.push((middle_m, hits as f64 / events as f64));
        mean_predicted.push((middle_m, of_bin.iter().sum::<f64>() / events as f64));
    }
    let series = [
        Series { name: "heard", points: &heard, style: Style { mark: Mark::Square, ..HEARD } },
        Series { name: "predicted by the maps", points: &mean_predicted, style: PREDICTED },
    ];
    Ok(curves("Share heard over range", ["range (m)", "share heard"], &series, Room::SCREEN, 320.0))
}

/// Draws the share of heard events over the predicted probability. Calibrated probabilities lie on the diagonal.
pub fn calibration(calibrated: &Calibrated) -> Figure {
    let points = |calibration: &Calibration| -> Vec<Point> {
        calibration.bins.iter().filter_map(|bin: &Bin| bin.predicted().zip(bin.heard())).collect()
    };
    let Calibrated { own, team, centralised, .. } = calibrated;
    let (own, team, centralised) = (points(own), points(team), points(centralised));
    let diagonal = [(0.0, 0.0), (1.0, 1.0)];
    let series = [
        Series { name: "perfect calibration", points: &diagonal, style: DIAGONAL },
        Series { name: "own events only", points: &own, style: OWN },
        Series { name: "team", points: &team, style: Style { mark: Mark::Dot, ..PREDICTED } },
        Series { name: "all events in one place", points: &centralised, style: Style { mark: Mark::Square, ..HEARD } },
    ];
    curves(
        "Predicted probability and share heard",
        ["predicted probability", "share heard"],
        &series,
        Room::SCREEN,
        Room::SCREEN.side,
    )
}

const HEARD: Style = Style { color: "#404040", width: 1.6, dash: &[7.0, 4.0], mark: Mark::Square };
const PREDICTED: Style = Style { color: "#0571b0", width: 2.2, dash: &[], mark: Mark::Dot };
const OWN: Style = Style { color: "#d7301f", width: 1.6, dash: &[2.0, 3.0], mark: Mark::Triangle };
const DIAGONAL: Style = Style { color: "#999999", width: 1.0, dash: &[], mark: Mark::None };

/// The links of packets, by sender and counter.
type Sent = Vec<(VehicleId, u16, Vec<Link>)>;

/// Draws the inducing points of the first packets as arrows from transmitter to receiver, over the tracks.
fn packets_figure(replayed: &Replayed, sent: &Sent) -> Figure {
    let mut arrows: BTreeMap<&VehicleId, Vec<(Point, Point)>> = BTreeMap::new();
    for (sender, _, links) in sent.iter().filter(|(_, counter, _)| usize::from(*counter) < PACKETS_DRAWN) {
        let end = |place: Position| (place.east_m, place.north_m);
        let pairs = links.iter().map(|link| (end(link.transmitter), end(link.receiver)));
        arrows.entry(sender).or_default().extend(pairs);
    }
    let tracks = tracks::tracks(&replayed.log.events);
    let place = |id: &VehicleId| tracks.keys().position(|other| *other == id).unwrap_or_default();
    let names: Vec<String> = arrows.keys().map(|id| format!("sent by {id}")).collect();
    let groups: Vec<Arrows> = arrows
        .iter()
        .zip(&names)
        .map(|((id, pairs), name)| {
            let style = Style { mark: Mark::None, ..tracks::style(place(id)) };
            Arrows { name, pairs, style, heads: true }
        })
        .collect();
    let ends = replayed.log.events.iter().flat_map(|event| event.link.ends());
    let (east, north) = tracks::widened(ends.map(|end| (end.east_m, end.north_m)));
    link_map(
        "The first inducing points: links that represent the others",
        east,
        north,
        &groups,
        &tracks::tracks_as_series(&tracks),
        Room::SCREEN.side,
    )
}
