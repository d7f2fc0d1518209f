//! Teams, events and vehicles to test with.

#![allow(dead_code, reason = "every test file needs a part of it")]

pub mod trip;

use std::sync::Arc;

use dgpc::Shape;
use pingmap_agent::*;
use pingmap_packet::{Block, MapMessage};
use proptest::collection::vec;
use proptest::prelude::*;

/// Half a side of the square where everything happens, in metres.
pub const REACH_M: f64 = 600.0;

/// So many random cases, times `CASES_TIMES` where that is set; failing ones are printed and not kept in files.
pub fn cases(count: u32) -> ProptestConfig {
    let times =
        std::env::var("CASES_TIMES").map_or(1, |times| times.parse::<u32>().expect("CASES_TIMES is a number").max(1));
    ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(count * times) }
}

pub fn names(count: usize) -> Vec<VehicleId> {
    (0..count).map(|n| VehicleId::new(format!("vehicle {n}"))).collect()
}

pub fn link(ends: [f64; 4]) -> Link {
    let [a, b, c, d] = ends;
    Link { transmitter: Position::new(a, b), receiver: Position::new(c, d) }
}

/// An even model of a region of this size.
pub fn model() -> Model {
    isotropic(Shape::Matern52, true, 300.0, 4.0)
}

pub fn isotropic(shape: Shape, reciprocal: bool, length_scale_m: f64, variance: f64) -> Model {
    let chart = Chart { scale_m: 500.0, ..Chart::about([]) };
    Model::isotropic(chart, InputSpec::Positions, shape, reciprocal, length_scale_m, variance).unwrap()
}

pub fn team(members: usize, model: Model) -> Team {
    let reach = [Position::new(-REACH_M, -REACH_M), Position::new(REACH_M, REACH_M)];
    Team::new(names(members), model, reach).unwrap()
}

/// One of several keys.
pub fn key(first: u8) -> Key {
    Key::new(std::array::from_fn(|place| first + place as u8)).unwrap()
}

/// Events of one receiver on a walk, heard when the ends are close.
pub fn walk(receiver: usize, count: usize, phase: f64) -> Vec<Event> {
    let event = |n: usize| {
        let t = n as f64 * 0.37 + phase;
        let ends = [500.0 * t.sin(), 400.0 * (0.7 * t).cos(), 450.0 * (1.3 * t).cos(), 350.0 * (0.9 * t).sin()];
        let link = link(ends);
        event_at(receiver, 10.0 * n as f64, link, link.range_m() < 450.0)
    };
    (0..count).map(event).collect()
}

pub fn event_at(receiver: usize, time_s: f64, link: Link, success: bool) -> Event {
    let (transmitter_id, receiver_id) = (VehicleId::new("somebody"), names(receiver + 1).remove(receiver));
    Event { time_s, transmitter_id, receiver_id, link, kind: None, success }
}

/// A vehicle by its number, or one that is no member beyond them, with its events.
pub fn vehicle(team: &Arc<Team>, number: usize, events: impl IntoIterator<Item = Event>) -> Agent {
    let mut agent = Agent::new(names(number + 1).remove(number), team.clone());
    agent.observe_all(events).unwrap();
    agent.refit().unwrap();
    agent
}

/// All events of a vehicle.
pub fn events(agent: &Agent) -> Vec<Event> {
    agent.events().cloned().collect()
}

/// What it remembers again after it lost everything but this.
pub fn restored(agent: &Agent, snapshot: &[u8]) -> Agent {
    let team = Arc::new(agent.team().clone());
    let mut again = Agent::restore(agent.id().clone(), team, snapshot).unwrap();
    again.refit().unwrap();
    again
}

/// A vehicle that has sent nothing but one frame, of this counter, that says nothing.
pub fn after_counter(mut agent: Agent, counter: u16) -> Agent {
    let sender = agent.team().number(agent.id()).unwrap();
    let layout = agent.team().layout(agent.team().frame_bytes).unwrap();
    let message = MapMessage { sender, counter, model: 0, blocks: vec![Block::silent(layout); layout.blocks] };
    let bytes = agent.write(layout, &message).unwrap();
    assert_eq!(agent.apply(Entry::Sent { number: 0, slot: None, bytes }).unwrap(), Receipt::Accepted);
    agent
}

/// Links between those of a walk.
pub fn somewhere() -> Vec<Link> {
    walk(0, 15, 0.21).into_iter().map(|event| event.link).collect()
}

/// Up to so many packets, fewer where there is no more to tell.
pub fn sent(agent: &mut Agent, packets_max: usize) -> Vec<Vec<u8>> {
    agent.refit().unwrap();
    (0..packets_max).map_while(|n| agent.next_packet(n as f64, agent.team().frame_bytes).unwrap()).collect()
}

pub fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|value| value.to_bits()).collect()
}

pub fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// Latent variances that a vehicle has over some links.
pub fn variances(agent: &mut Agent, links: &[Link]) -> Vec<f64> {
    let inputs = agent.model().inputs(links).unwrap();
    agent.posterior().unwrap().latent(&inputs).unwrap().variance
}

/// The links that the packets of one vehicle speak of, in the order of sending.
pub fn told_by(agent: &Agent, sender: usize) -> Vec<Vec<Link>> {
    let name = names(sender + 1).remove(sender);
    agent.links_of_packets().into_iter().filter(|(id, _, _)| *id == name).map(|(_, _, links)| links).collect()
}

/// Vehicles and what each of them saw.
#[derive(Debug, Clone)]
pub struct Fleet {
    pub team: Arc<Team>,
    pub events: Vec<Vec<Event>>,
}

impl Fleet {
    pub fn vehicle(&self, number: usize) -> Agent {
        vehicle(&self.team, number, self.events[number].iter().cloned())
    }

    /// What everybody sends of its own events, up to so many packets each.
    pub fn packets(&self, each_max: usize) -> Vec<Vec<u8>> {
        (0..self.events.len()).flat_map(|number| sent(&mut self.vehicle(number), each_max)).collect()
    }
}

pub fn shapes() -> impl Strategy<Value = Shape> {
    prop::sample::select(vec![Shape::SquaredExponential, Shape::Matern32, Shape::Matern52])
}

/// One isotropic term, or any structure as it is before anything is learned.
pub fn models() -> impl Strategy<Value = Model> {
    let isotropic = (shapes(), any::<bool>(), 1.0f64..8.0, 0.5f64..8.0)
        .prop_map(|(shape, reciprocal, scale, variance)| isotropic(shape, reciprocal, 20.0 * scale.exp2(), variance));
    let template =
        (prop::sample::select(Given::default().many()), 100.0f64..1500.0).prop_map(|(structure, scale_m)| {
            let chart = Chart { scale_m, ..Chart::about([]) };
            Model::new(chart, InputSpec::Positions, structure.template(InputSpec::Positions, scale_m).unwrap())
        });
    prop_oneof![isotropic, template]
}

/// Links within the region.
pub fn links() -> impl Strategy<Value = Link> {
    prop::array::uniform4(-REACH_M..REACH_M).prop_map(link)
}

/// Events of a receiver: heard within a range, but for one in eight that is as chance has it.
pub fn events_of(receiver: usize, count: std::ops::Range<usize>) -> impl Strategy<Value = Vec<Event>> {
    let outcome = (0..8u8, any::<bool>());
    (vec((0.0f64..1000.0, links(), outcome), count), 200.0f64..900.0).prop_map(move |(all, range_m)| {
        let event = |(time_s, link, (chance, odd)): (f64, Link, (u8, bool))| {
            event_at(receiver, time_s, link, if chance == 0 { odd } else { link.range_m() < range_m })
        };
        all.into_iter().map(event).collect()
    })
}

/// Two to four vehicles with 5 to 39 events each.
pub fn fleets() -> impl Strategy<Value = Fleet> {
    (2..5usize, models()).prop_flat_map(|(members, model)| {
        let team = Arc::new(team(members, model));
        let events: Vec<_> = (0..members).map(|number| events_of(number, 5..40)).collect();
        events.prop_map(move |events| Fleet { team: team.clone(), events })
    })
}
