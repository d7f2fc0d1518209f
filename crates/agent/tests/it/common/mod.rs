//! Teams, events and vehicles for tests.

#![allow(dead_code, reason = "some helpers serve few files")]

pub mod trip;

use std::sync::Arc;

use dgpc::Shape;
use pingmap_agent::*;
use pingmap_packet::{Block, MapMessage};
use proptest::collection::vec;
use proptest::prelude::*;

/// Half a side of the square in which all test vehicles move, in metres.
pub const REACH_M: f64 = 600.0;

/// Returns a configuration with this number of random cases, times `CASES_TIMES` if that is set. Failing cases are
/// printed and not stored.
pub fn cases(count: u32) -> ProptestConfig {
    let times =
        std::env::var("CASES_TIMES").map_or(1, |times| times.parse::<u32>().expect("CASES_TIMES is a number").max(1));
    ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(count * times) }
}

/// Returns the number of received packets of a class.
pub fn count(agent: &Agent, class: &str) -> u64 {
    agent.status().counts.get(class).copied().unwrap_or_default()
}

pub fn names(count: usize) -> Vec<VehicleId> {
    (0..count).map(name).collect()
}

pub fn name(number: usize) -> VehicleId {
    VehicleId::new(format!("vehicle {number}"))
}

pub fn link(ends: [f64; 4]) -> Link {
    let [a, b, c, d] = ends;
    Link { transmitter: Position::new(a, b), receiver: Position::new(c, d) }
}

/// A reciprocal model with a length-scale of half the region.
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

/// Options of a vehicle that sends reports alone.
pub fn reports_alone() -> AgentOptions {
    AgentOptions { sharing: Sharing::reports(), ..AgentOptions::default() }
}

/// Options of a vehicle that sends summaries alone.
pub fn summaries_alone() -> AgentOptions {
    AgentOptions { sharing: Sharing::summaries(), ..AgentOptions::default() }
}

/// Events of one receiver along a walk. It hears transmitters within 450 m. The transmitter is not a member of the
/// team, so that the events have no slots.
pub fn walk(receiver: usize, count: usize, phase: f64) -> Vec<Event> {
    let event = |n: usize| {
        let t = n as f64 * 0.37 + phase;
        let ends = [500.0 * t.sin(), 400.0 * (0.7 * t).cos(), 450.0 * (1.3 * t).cos(), 350.0 * (0.9 * t).sin()];
        let link = link(ends);
        event_at(receiver, 10.0 * n as f64, link, link.range_m() < 450.0)
    };
    (0..count).map(event).collect()
}

/// An event whose transmitter is not a member of the team.
pub fn event_at(receiver: usize, time_s: f64, link: Link, success: bool) -> Event {
    Event { time_s, transmitter_id: VehicleId::new("buoy"), receiver_id: name(receiver), link, kind: None, success }
}

/// A vehicle with default options. A number that is not smaller than the size of the team is the number of no member.
pub fn vehicle(team: &Arc<Team>, number: usize, events: impl IntoIterator<Item = Event>) -> Agent {
    vehicle_with(team, number, AgentOptions::default(), events)
}

/// A vehicle with these options.
pub fn vehicle_with(
    team: &Arc<Team>,
    number: usize,
    options: AgentOptions,
    events: impl IntoIterator<Item = Event>,
) -> Agent {
    let mut agent = Agent::new(name(number), team.clone(), options);
    agent.record(events).unwrap();
    agent.refit().unwrap();
    agent
}

/// A vehicle that is not a member and recorded the events of every receiver. It fitted them from nothing.
pub fn station(team: &Arc<Team>, events: impl IntoIterator<Item = Event>) -> Agent {
    let options = AgentOptions { record_all_receivers: true, ..AgentOptions::default() };
    let mut agent = Agent::new(VehicleId::new("shore"), team.clone(), options);
    agent.record(events).unwrap();
    agent.rebuild().unwrap();
    agent
}

/// Copies of all own events of a vehicle.
pub fn events(agent: &Agent) -> Vec<Event> {
    agent.events().cloned().collect()
}

/// A vehicle restored from a snapshot with the options of `agent`.
pub fn restored(agent: &Agent, snapshot: &[u8]) -> Agent {
    let team = Arc::new(agent.team().clone());
    let mut restored = Agent::restore(agent.id().clone(), team, agent.options, snapshot).unwrap();
    restored.refit().unwrap();
    restored
}

/// A summary packet without content.
pub fn empty_packet(team: &Arc<Team>, sender: u8, counter: u16) -> Vec<u8> {
    let layout = team.layout(team.frame_bytes).unwrap();
    let message = MapMessage { sender, counter, model: 0, blocks: vec![Block::empty(layout); layout.blocks] };
    vehicle(team, 0, []).codec().write(layout, &message).unwrap()
}

/// A vehicle that has sent one frame without content under this counter.
pub fn after_counter(mut agent: Agent, counter: u16) -> Agent {
    let sender = agent.team().number(agent.id()).unwrap();
    let bytes = empty_packet(&Arc::new(agent.team().clone()), sender, counter);
    assert_eq!(
        agent.apply(Entry::Sent { number: 0, state: FrameState::Proposed, slot: None, bytes }).unwrap(),
        Receipt::Accepted
    );
    agent
}

/// Fifteen links in the region of [`walk`], between those of its events.
pub fn test_links() -> Vec<Link> {
    walk(0, 15, 0.21).into_iter().map(|event| event.link).collect()
}

/// The next frames, `frames_max` at most. They leave at unknown times.
pub fn frames(agent: &mut Agent, frames_max: usize) -> Vec<Vec<u8>> {
    agent.refit().unwrap();
    (0..frames_max)
        .map_while(|_| agent.next_frame(None, agent.team().frame_bytes).unwrap().map(|frame| frame.bytes))
        .collect()
}

/// Receives frames at unknown times.
pub fn receive_all<'a>(agent: &mut Agent, frames: impl IntoIterator<Item = &'a Vec<u8>>) {
    frames.into_iter().for_each(|frame| drop(agent.receive(frame, None).receipt));
}

/// Receives frames at a time.
pub fn receive_all_at<'a>(agent: &mut Agent, frames: impl IntoIterator<Item = &'a Vec<u8>>, time_s: f64) {
    frames.into_iter().for_each(|frame| drop(agent.receive(frame, Some(time_s)).receipt));
}

/// Predicted probabilities.
pub fn probabilities(agent: &mut Agent, queries: impl IntoIterator<Item = impl Into<LinkQuery>>) -> Vec<f64> {
    let predictions = agent.predict(queries, Which::Fused).unwrap();
    predictions.into_iter().map(|prediction| prediction.probability).collect()
}

/// Predicted probabilities of [`test_links`].
pub fn test_probabilities(agent: &mut Agent) -> Vec<f64> {
    probabilities(agent, test_links())
}

/// Predicted probabilities of [`test_links`] after a fit from nothing.
pub fn rebuilt_probabilities(agent: &mut Agent) -> Vec<f64> {
    agent.rebuild().unwrap();
    test_probabilities(agent)
}

/// Mean and variance of the log-odds of some links under the fused posterior, without a cap.
pub fn latent(agent: &mut Agent, links: &[Link]) -> (Vec<f64>, Vec<f64>) {
    let inputs = agent.team().model.inputs(links).unwrap();
    let latent = agent.posterior(Which::Fused).unwrap().latent(&inputs).unwrap();
    (latent.mean, latent.variance)
}

/// Variances of the log-odds of some links.
pub fn variances(agent: &mut Agent, links: &[Link]) -> Vec<f64> {
    latent(agent, links).1
}

/// Numbers of located and of unlocated remote events.
pub fn remote_events(agent: &Agent) -> (usize, usize) {
    let status = agent.status();
    (status.located_events, status.unlocated_events)
}

/// Members that the vehicle excludes.
pub fn excluded(agent: &Agent) -> Vec<VehicleId> {
    let members = agent.status().members.into_iter();
    members.filter(|(_, member)| member.is_ignored(IgnoreReason::Contradicts)).map(|(id, _)| id).collect()
}

/// The status of one member.
pub fn member(agent: &Agent, id: &VehicleId) -> MemberStatus {
    agent.status().members.remove(id).expect("another member of the team")
}

pub fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|value| value.to_bits()).collect()
}

pub fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// The links of the inducing points in each summary packet of one sender, in the order of counters.
pub fn summarised_links(agent: &Agent, sender: usize) -> Vec<Vec<Link>> {
    let name = name(sender);
    agent.links_of_packets().into_iter().filter(|(id, _, _)| *id == name).map(|(_, _, links)| links).collect()
}

/// Vehicles and the events of each.
#[derive(Debug, Clone)]
pub struct Fleet {
    pub team: Arc<Team>,
    pub events: Vec<Vec<Event>>,
}

impl Fleet {
    pub fn vehicle(&self, number: usize) -> Agent {
        vehicle(&self.team, number, self.events[number].iter().cloned())
    }

    /// Packets of every vehicle about its own events, `each_max` at most of each.
    pub fn packets(&self, each_max: usize) -> Vec<Vec<u8>> {
        (0..self.events.len()).flat_map(|number| frames(&mut self.vehicle(number), each_max)).collect()
    }
}

pub fn shapes() -> impl Strategy<Value = Shape> {
    prop::sample::select(vec![Shape::SquaredExponential, Shape::Matern32, Shape::Matern52])
}

/// The default structure, and structures that differ from it in one part of the kernel.
pub fn structures() -> Vec<Structure> {
    let default = Structure::default();
    vec![
        default,
        Structure { shape: Shape::Matern52, ..default },
        Structure { shape: Shape::SquaredExponential, ..default },
        Structure { path_inputs: PathInputs::Raw, ..default },
    ]
}

/// One isotropic term, or any structure before it is learned.
pub fn models() -> impl Strategy<Value = Model> {
    let isotropic = (shapes(), any::<bool>(), 1.0f64..8.0, 0.5f64..8.0)
        .prop_map(|(shape, reciprocal, scale, variance)| isotropic(shape, reciprocal, 20.0 * scale.exp2(), variance));
    let structures = prop::sample::select(structures());
    let template = (structures, 100.0f64..1500.0).prop_map(|(structure, scale_m)| {
        let chart = Chart { scale_m, ..Chart::about([]) };
        Model::new(chart, InputSpec::Positions, structure.template(InputSpec::Positions, scale_m).unwrap())
    });
    prop_oneof![isotropic, template]
}

/// Links within the region.
pub fn links() -> impl Strategy<Value = Link> {
    prop::array::uniform4(-REACH_M..REACH_M).prop_map(link)
}

/// Events of a receiver that hears within a range. One outcome in eight is random.
pub fn events_of(receiver: usize, count: std::ops::Range<usize>) -> impl Strategy<Value = Vec<Event>> {
    let outcome = (0..8u8, any::<bool>());
    (vec((0.0f64..1000.0, links(), outcome), count), 200.0f64..900.0).prop_map(move |(all, range_m)| {
        let event = |(time_s, link, (chance, random)): (f64, Link, (u8, bool))| {
            event_at(receiver, time_s, link, if chance == 0 { random } else { link.range_m() < range_m })
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
