//! Figures of the paper's scheme: inducing points by policy, and the concatenated posterior of the team.

use std::collections::BTreeMap;

use anyhow::Context;
use dgpc::{Concatenation, Summary, success_probability};
use pingmap_agent::{INTERVAL_WIDENING, Link, LinkQuery, Position, Time, VehicleId};
use pingmap_trial::paper::Policy;
use pingmap_trial::{Mission, Package, Plan, Preshared};

use crate::area::Area;
use crate::commands::replay::Replayed;
use crate::figure::{Arrows, Figure, GridMap, Mark, Palette, Panel, Room, Series, Style, grid_map, link_panels};
use crate::grid::Point;
use crate::page::Page;
use crate::success_map::{HATCH_WIDTH, LEVELS};
use crate::tracks;

/// Width of the axes of a panel.
const AXES_PX: f64 = 350.0;

/// Standard deviations to either side of the mean that a 90 % interval of the log-odds contains.
const INTERVAL_REACH: f64 = 1.645 * INTERVAL_WIDENING;

/// The scheme's figures for one split.
pub struct Pictures {
    points: Figure,
    posterior: Figure,
    packets: usize,
}

/// Links of the inducing points of each vehicle.
type Points = BTreeMap<VehicleId, Vec<(Point, Point)>>;

impl Pictures {
    /// Forms the packages of the first split again, for each policy.
    pub fn draw(replayed: &Replayed, packets: usize) -> anyhow::Result<Self> {
        let split = replayed.splits.first().context("a replay has at least one split")?;
        let found = replayed.replay.splits.first().context("a replay has at least one split")?;
        let plan = Plan { preshared: Preshared::Team(Box::new((*found.team).clone())), ..replayed.plan.clone() };
        let mission = Mission::prepare(&replayed.log, split, &plan, 0)?;
        let [good, random, bad] = Policy::ALL.map(|policy| Package::of_team(&mission, packets, policy));
        let (good, random, bad) = (good?, random?, bad?);
        let points = points(replayed, &[&good, &random, &bad].map(|packages| by_sender(packages)));
        Ok(Self { points, posterior: posterior(replayed, &mission, &good)?, packets })
    }

    /// Adds the figures to the report.
    pub fn section(&self, page: &mut Page) {
        let packets = self.packets;
        page.heading("The paper's scheme");
        page.figure(
            &self.points,
            &format!(
                "Inducing points of {packets} packets of each vehicle, as arrows from transmitter to receiver. Good points minimise tr K̃. \
                 They lie amid the events and represent them all. Bad points maximise tr K̃ and crowd together. The table of other uses of \
                 the same bytes has the scores of all three."
            ),
        );
        page.figure(
            &self.posterior,
            &format!(
                "The concatenated posterior of the team: probability that a message from the star is received, from {packets} packages of \
                 each vehicle at good points. Arrows are the points. The map is hatched where the 90 % interval of the probability is wider than {HATCH_WIDTH}."
            ),
        );
    }
}

fn by_sender(packages: &[Package]) -> Points {
    let mut points = Points::new();
    let end = |place: Position| (place.east_m, place.north_m);
    for Package { sender, links, .. } in packages {
        let pairs = links.iter().map(|link| (end(link.transmitter), end(link.receiver)));
        points.entry(sender.clone()).or_default().extend(pairs);
    }
    points
}

/// Returns the points as arrows in the style of their sender.
fn arrows<'a>(points: &'a Points, names: &'a [String]) -> Vec<Arrows<'a>> {
    let groups = points.values().zip(names).enumerate();
    groups.map(|(n, (pairs, name))| Arrows { name, pairs, style: tracks::style(n), heads: true }).collect()
}

fn names(points: &Points) -> Vec<String> {
    points.keys().map(|id| format!("points of {id}")).collect()
}

fn points(replayed: &Replayed, by_policy: &[Points; 3]) -> Figure {
    let tracks = tracks::tracks(&replayed.log.events);
    let faint = |n| Style { color: "#aaaaaa", width: 0.8, mark: Mark::None, ..tracks::style(n) };
    let track_names: Vec<String> = tracks.keys().map(|id| format!("track of {id}")).collect();
    let lines = tracks.values().zip(&track_names).enumerate();
    let series: Vec<Series> = lines.map(|(n, (points, name))| Series { name, points, style: faint(n) }).collect();
    let titles = Policy::ALL.map(|policy| format!("{} points", policy.name()));
    let names = by_policy.each_ref().map(names);
    let links: Vec<Vec<Arrows>> = by_policy.iter().zip(&names).map(|(points, names)| arrows(points, names)).collect();
    let panels: Vec<Panel> =
        titles.iter().zip(&links).map(|(title, links)| Panel { title, tracks: &series, links }).collect();
    let (east, north) = tracks::widened(tracks.values().flatten().copied());
    link_panels(&panels, east, north, AXES_PX)
}

/// Draws the probability of messages from the last own position of the first vehicle.
fn posterior(replayed: &Replayed, mission: &Mission, packages: &[Package]) -> anyhow::Result<Figure> {
    let model = &mission.team.model;
    let events = &replayed.log.events;
    let viewer = mission.vehicles.first().context("every log has a receiver")?;
    let last = viewer.events().last().context("the first vehicle has events")?;
    let transmitter = last.link.receiver.without_heading();
    let area = Area::around(events.iter().flat_map(|event| event.link.ends()), None)?;
    let query = |cell| {
        let (east_m, north_m) = area.middle(cell);
        let receiver = Position { depth_m: transmitter.depth_m, ..Position::new(east_m, north_m) };
        let link = Link { transmitter, receiver };
        LinkQuery { transmitter: viewer.id().into(), when: Time::At(last.time_s), ..LinkQuery::from(link) }
    };
    let inputs = model.inputs((0..area.cells()).map(query).collect::<Vec<_>>())?;
    let summaries: Vec<&Summary> = packages.iter().map(|package| &package.summary).collect();
    let latent = Concatenation::new(&model.prior, &summaries)?.latent(&inputs)?;
    let moments = latent.mean.iter().zip(&latent.variance);
    let probability: Vec<f64> = moments.map(|(&mean, &variance)| success_probability(mean, variance)).collect();
    let end = |mean: f64, reach: f64| success_probability(mean + INTERVAL_REACH * reach, 0.0);
    let moments = latent.mean.iter().zip(&latent.variance).map(|(&mean, variance)| (mean, variance.sqrt()));
    let unknown = moments.map(|(mean, deviation)| end(mean, deviation) - end(mean, -deviation) > HATCH_WIDTH);
    let points = by_sender(packages);
    let names = names(&points);
    Ok(grid_map(
        &GridMap {
            title: "Concatenated posterior of the team",
            notes: &[],
            bar: "probability",
            palette: Palette::BlueToYellow,
            grid: area.grid(&probability),
            graticule: &[],
            contours: &LEVELS,
            hatched: (&unknown.collect::<Vec<_>>(), &format!("not known: interval wider than {HATCH_WIDTH}")),
            tracks: &[],
            links: &arrows(&points, &names),
            places: &[("transmitter".to_owned(), (transmitter.east_m, transmitter.north_m))],
            lines: &[],
        },
        Room::SCREEN,
    ))
}
