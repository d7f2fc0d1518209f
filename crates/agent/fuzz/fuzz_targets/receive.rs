//! Receives any bytes as frames and as piggybacked outcomes. Every prediction stays a probability, and refused bytes
//! change nothing.

#![no_main]

use std::cell::RefCell;
use std::sync::Arc;

use libfuzzer_sys::fuzz_target;
use pingmap_agent::{
    Agent, AgentOptions, Chart, InputSpec, Key, Link, Model, Position, Receipt, Refusal, Team, VehicleId, Which,
};

/// First byte of piggybacked outcomes in the input of this target.
const PIGGYBACK: u8 = 0xff;

/// Largest number of frames for one vehicle.
const FRAMES_MAX: usize = 16;

fn listener(inputs: InputSpec, length_scale_m: f64, key: Option<Key>) -> Agent {
    let shape = dgpc::Shape::Matern32;
    let model = Model::isotropic(Chart::about([]), inputs, shape, true, length_scale_m, 4.0).expect("numbers in range");
    let reach = [-500.0, 500.0].map(|east_m| Position { depth_m: Some(50.0), ..Position::new(east_m, 0.0) });
    let names = (0..4).map(|n| VehicleId::new(format!("vehicle {n}")));
    let team = Team { key, ..Team::new(names, model, reach).expect("four members") };
    Agent::new(VehicleId::new("vehicle 0"), Arc::new(team), AgentOptions::default())
}

thread_local! {
    static LISTENERS: RefCell<Vec<Agent>> = RefCell::new(vec![
        listener(InputSpec::Positions, 300.0, None),
        listener(InputSpec::Positions, 1e6, None),
        listener(InputSpec::PositionsAndDepths, 1.0, None),
        listener(InputSpec::Positions, 300.0, Some(Key::new(*b"the secret of a team of vehicles").expect("no weak key"))),
    ]);
}

fuzz_target!(|bytes: &[u8]| {
    LISTENERS.with_borrow(|listeners| listeners.iter().for_each(|listener| receive(listener.clone(), bytes)));
});

/// Receives frames of 32 bytes, and a shorter last one.
fn receive(mut agent: Agent, bytes: &[u8]) {
    let fixes =
        [0.0, 60.0, 120.0].map(|time_s| (time_s, Position { depth_m: Some(5.0), ..Position::new(9.0, time_s) }));
    agent.record_positions(fixes).expect("times and places");
    for frame in bytes.chunks(32).take(FRAMES_MAX) {
        let before = agent.snapshot();
        let receipt = match *frame {
            [PIGGYBACK, sender, n_bits, a, b, c, d, e, f, g, h, ref time @ ..] if time.len() >= 8 => {
                let sender = VehicleId::new(format!("vehicle {}", sender % 5));
                let time_s = f64::from_le_bytes(std::array::from_fn(|place| time[place]));
                agent
                    .receive_piggyback(&sender, time_s, u64::from_le_bytes([a, b, c, d, e, f, g, h]), n_bits.into())
                    .receipt
            }
            _ => receive_frame(&mut agent, frame),
        };
        let is_stored = matches!(
            receipt,
            Receipt::Accepted
                | Receipt::Refused(
                    Refusal::OwnNumber(_)
                        | Refusal::OwnReport
                        | Refusal::Conflict(_)
                        | Refusal::CounterAhead { .. }
                        | Refusal::SlotAhead { .. }
                )
        );
        assert!(is_stored || agent.snapshot() == before, "{receipt:?}");
    }
    let team = Arc::new(agent.team().clone());
    let restored = Agent::restore(agent.id().clone(), team, agent.options, &agent.snapshot());
    assert_eq!(remote_events(&restored.expect("its own snapshot")), remote_events(&agent));
    let place = |east_m| Position::new(east_m, 10.0);
    let sent = agent.links_of_packets().into_iter().flat_map(|(_, _, links)| links);
    let links: Vec<Link> = sent.chain([Link { transmitter: place(-40.0), receiver: place(200.0) }]).collect();
    let predictions = agent.predict(&links, Which::Fused).expect("accepted packets leave a posterior");
    assert!(predictions.iter().all(|prediction| (0.0..=1.0).contains(&prediction.probability)), "{predictions:?}");
}

fn receive_frame(agent: &mut Agent, frame: &[u8]) -> Receipt {
    let mut frame = frame.to_vec();
    match agent.receive(&frame, None).receipt {
        // A fuzzer cannot guess the check number. Its bits begin in byte 3 of a report and in byte 4 of a summary.
        Receipt::Refused(Refusal::OtherTeam { found: Some(found), expected }) => {
            let first = if pingmap_packet::ReportLayout::of(&frame).is_some() { 3 } else { 4 };
            let [low, high] = (found ^ expected).to_le_bytes();
            (frame[first], frame[first + 1]) = (frame[first] ^ low, frame[first + 1] ^ high);
            agent.receive(&frame, None).receipt
        }
        receipt => receipt,
    }
}

/// Numbers of located and of unlocated events of other members.
fn remote_events(agent: &Agent) -> (usize, usize) {
    let status = agent.status();
    (status.located_events, status.unlocated_events)
}
