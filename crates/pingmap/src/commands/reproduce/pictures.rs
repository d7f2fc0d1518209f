//! Figures: tracks with the events of one region, the chosen points, and the team's predictions.

use std::collections::BTreeMap;
use std::path::Path;

use pingmap_agent::Position;
use pingmap_trial::Score;
use pingmap_trial::paper::{AgentExample, Choice, DataSet, Example, Policy};

use super::exhibit::Exhibit;
use super::results::Computed;
use crate::figure::{Arrows, Figure, Mark, Panel, Style, link_panels};
use crate::files::write_file;
use crate::grid::Point;
use crate::tracks;

/// Width of the axes. The figure is as wide as a column of a two-column page, where its smallest letters have 7 points.
const AXES_PX: f64 = 350.0;

/// PNG pixels per SVG unit: 300 dots per inch at column width.
const PNG_SCALE: f32 = 2.5;

/// A figure with its file name and caption.
pub struct Picture {
    pub name: &'static str,
    pub caption: String,
    figure: Figure,
}

impl Picture {
    /// Writes the figure as SVG and PNG.
    pub fn write(&self, folder: &Path) -> anyhow::Result<()> {
        write_file(&folder.join(format!("{}.svg", self.name)), self.figure.svg(false).as_bytes())?;
        write_file(&folder.join(format!("{}.png", self.name)), &self.figure.png_scaled(PNG_SCALE)?)
    }
}

/// Draws the requested figures. Returns none if every permutation leaves a region without training or held-out events.
pub fn draw(results: &Computed, exhibit: Exhibit) -> Vec<Picture> {
    let (Some(set), Some(example)) = (results.experiment.sets().first(), &results.example) else {
        return Vec::new();
    };
    // The paper shows the second agent's region.
    let agent = 1.min(set.agents().len() - 1);
    let drawn = |one: Exhibit| exhibit == Exhibit::All || exhibit == one;
    let mut pictures = Vec::new();
    if drawn(Exhibit::Tracks) {
        pictures.push(tracks(set, agent, example));
    }
    if drawn(Exhibit::Points) {
        pictures.push(points(set, agent, example));
    }
    if drawn(Exhibit::Predictions) {
        pictures.push(predictions(set, example));
    }
    pictures
}

type Pair = (Point, Point);

const HEARD: Style = Style { color: "#1f78b4", width: 0.7, dash: &[], mark: Mark::Dot };
const MISSED: Style = Style { color: "#222222", width: 0.7, dash: &[3.0, 3.0], mark: Mark::Cross };
const CHOSEN: Style = Style { color: "#d7301f", width: 3.2, dash: &[], mark: Mark::None };
const RIGHT: Style = Style { color: "#1f78b4", width: 0.5, dash: &[], mark: Mark::Dot };
const WRONG: Style = Style { color: "#222222", width: 1.0, dash: &[3.0, 3.0], mark: Mark::Cross };

fn tracks(set: &DataSet, agent: usize, example: &Example) -> Picture {
    let tracks = tracks::tracks(&set.log().events);
    let series = tracks::tracks_as_series(&tracks);
    let local = LocalEvents::new(set, &example.agents[agent]);
    let (east, north) = tracks::widened(tracks.values().flatten().copied());
    let title = format!("Tracks, and events of one region of {}", set.agents()[agent].id);
    let panel = Panel { title: &title, tracks: &series, links: &local.arrows() };
    let caption = format!(
        "Tracks of the vehicles of {}, and the training events of {} in its region (permutation {}): from transmitter to receiver, \
         which is marked.",
        set.name,
        set.agents()[agent].id,
        example.permutation + 1
    );
    Picture { name: "tracks", caption, figure: link_panels(&[panel], east, north, AXES_PX) }
}

fn points(set: &DataSet, agent: usize, example: &Example) -> Picture {
    let local = LocalEvents::new(set, &example.agents[agent]);
    let chosen = Policy::ALL.map(|policy| {
        let chosen = &example.agents[agent].points[&Choice { policy, points: 2 }];
        chosen.iter().map(|&event| ends(set, event)).collect::<Vec<Pair>>()
    });
    let titles = Policy::ALL.map(|policy| format!("Two {} points", policy.name()));
    let links: Vec<Vec<Arrows>> = chosen
        .iter()
        .map(|pairs| {
            let mut links = local.arrows().to_vec();
            links.push(Arrows { name: "inducing point", pairs, style: CHOSEN, heads: true });
            links
        })
        .collect();
    let panels: Vec<Panel> =
        titles.iter().zip(&links).map(|(title, links)| Panel { title, tracks: &[], links }).collect();
    let (east, north) = extent(local.heard.iter().chain(&local.missed));
    let caption = format!(
        "The same events, and the two points that each policy chooses, as arrows from transmitter to receiver ({}, {}).",
        set.name,
        set.agents()[agent].id
    );
    Picture { name: "points", caption, figure: link_panels(&panels, east, north, AXES_PX) }
}

fn predictions(set: &DataSet, example: &Example) -> Picture {
    let split = |predicted: &[(usize, f64)]| {
        let is_right = |&(event, p): &(usize, f64)| (p > 0.5) == set.log().events[event].success;
        let (right, wrong): (Vec<_>, Vec<_>) = predicted.iter().copied().partition(is_right);
        let pairs =
            |events: Vec<(usize, f64)>| events.iter().map(|&(event, _)| ends(set, event)).collect::<Vec<Pair>>();
        (pairs(right), pairs(wrong))
    };
    let parts: BTreeMap<Policy, (Vec<Pair>, Vec<Pair>)> =
        example.predictions.iter().map(|(&policy, predicted)| (policy, split(predicted))).collect();
    let title = |(policy, predicted): (&Policy, &Vec<(usize, f64)>)| {
        let (right, all) = (parts[policy].0.len(), predicted.len());
        let (probabilities, outcomes): (Vec<f64>, Vec<bool>) =
            predicted.iter().map(|&(event, p)| (p, set.log().events[event].success)).unzip();
        let nll =
            Score::new(&probabilities, &outcomes).map_or(String::new(), |score| format!(", NLL {:.3}", score.nll));
        format!("Two {} points: {right} of {all} right{nll}", policy.name())
    };
    let titles: Vec<String> = example.predictions.iter().map(title).collect();
    let links: Vec<[Arrows; 2]> = parts
        .values()
        .map(|(right, wrong)| {
            [
                Arrows { name: "predicted right", pairs: right, style: RIGHT, heads: false },
                Arrows { name: "predicted wrong", pairs: wrong, style: WRONG, heads: false },
            ]
        })
        .collect();
    let panels: Vec<Panel> =
        titles.iter().zip(&links).map(|(title, links)| Panel { title, tracks: &[], links }).collect();
    let (east, north) = extent(parts.values().flat_map(|(right, wrong)| right.iter().chain(wrong)));
    let caption = format!(
        "Predictions of the team of {} for the held-out events of all regions, from two points of every agent, concatenated, at p > ½ \
         (permutation {}). The receiver is marked.",
        set.name,
        example.permutation + 1
    );
    Picture { name: "predictions", caption, figure: link_panels(&panels, east, north, AXES_PX) }
}

/// Training events of a region.
struct LocalEvents {
    heard: Vec<Pair>,
    missed: Vec<Pair>,
}

impl LocalEvents {
    fn new(set: &DataSet, agent: &AgentExample) -> Self {
        let (heard, missed): (Vec<usize>, Vec<usize>) =
            agent.part.training.iter().partition(|&&event| set.log().events[event].success);
        let pairs = |events: Vec<usize>| events.into_iter().map(|event| ends(set, event)).collect();
        Self { heard: pairs(heard), missed: pairs(missed) }
    }

    fn arrows(&self) -> [Arrows<'_>; 2] {
        [
            Arrows { name: "heard", pairs: &self.heard, style: HEARD, heads: false },
            Arrows { name: "missed", pairs: &self.missed, style: MISSED, heads: false },
        ]
    }
}

fn ends(set: &DataSet, event: usize) -> Pair {
    let point = |end: Position| (end.east_m, end.north_m);
    let link = set.log().events[event].link;
    (point(link.transmitter), point(link.receiver))
}

/// Returns the extent of some links with a margin; the shorter side is at least half the longer one.
fn extent<'a>(pairs: impl Iterator<Item = &'a Pair>) -> (Point, Point) {
    tracks::widened(pairs.flat_map(|&(from, to)| [from, to]))
}
