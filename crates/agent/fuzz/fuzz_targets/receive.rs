//! Any bytes as what a vehicle hears, in frames and in spare bits: whatever they are, a probability stays a probability.

#![no_main]

use std::cell::RefCell;
use std::sync::Arc;

use libfuzzer_sys::fuzz_target;
use pingmap_agent::{Agent, Chart, InputSpec, Key, Link, Model, Position, Receipt, Refusal, Team, VehicleId};

/// What spare bits begin with here.
const SPARE: u8 = 0xff;

/// Frames that one vehicle hears at most.
const FRAMES_MAX: usize = 16;

fn listener(inputs: InputSpec, length_scale_m: f64, key: Option<Key>) -> Agent {
    let shape = dgpc::Shape::Matern32;
    let model = Model::isotropic(Chart::about([]), inputs, shape, true, length_scale_m, 4.0).expect("numbers in range");
    let reach = [-500.0, 500.0].map(|east_m| Position { depth_m: Some(50.0), ..Position::new(east_m, 0.0) });
    let names = (0..4).map(|n| VehicleId::new(format!("vehicle {n}")));
    let team = Team { key, ..Team::new(names, model, reach).expect("four members") };
    Agent::new(VehicleId::new("vehicle 0"), Arc::new(team))
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
    LISTENERS.with_borrow(|listeners| listeners.iter().for_each(|listener| hear(listener.clone(), bytes)));
});

/// Frames of 32 bytes, one after the other, and a last shorter one.
fn hear(mut agent: Agent, bytes: &[u8]) {
    // When others were seen decides where spare bits lie.
    let seen = [0.0, 60.0, 120.0].map(|time_s| (time_s, Position { depth_m: Some(5.0), ..Position::new(9.0, time_s) }));
    agent.navigate(seen).expect("times and places");
    for frame in bytes.chunks(32).take(FRAMES_MAX) {
        let before = agent.snapshot();
        let receipt = match *frame {
            [SPARE, sender, n_bits, a, b, c, d, e, f, g, h, ref time @ ..] if time.len() >= 8 => {
                let sender = VehicleId::new(format!("vehicle {}", sender % 5));
                let time_s = f64::from_le_bytes(std::array::from_fn(|place| time[place]));
                agent.receive_recent(&sender, time_s, u64::from_le_bytes([a, b, c, d, e, f, g, h]), n_bits.into())
            }
            _ => hear_frame(&mut agent, frame),
        };
        let is_kept = matches!(
            receipt,
            Receipt::Accepted
                | Receipt::Refused(
                    Refusal::OwnNumber { .. }
                        | Refusal::OwnReport
                        | Refusal::Conflict { .. }
                        | Refusal::Unconfirmed { .. }
                )
        );
        assert!(is_kept || agent.snapshot() == before, "{receipt:?}");
    }
    let known = agent.told_events();
    let restored = Agent::restore(agent.id().clone(), Arc::new(agent.team().clone()), &agent.snapshot());
    assert_eq!(restored.expect("its own snapshot").told_events(), known);
    let place = |east_m| Position::new(east_m, 10.0);
    let sent = agent.links_of_packets().into_iter().flat_map(|(_, _, links)| links);
    let links: Vec<Link> = sent.chain([Link { transmitter: place(-40.0), receiver: place(200.0) }]).collect();
    let probabilities = agent.probabilities(&links).expect("packets that count leave a posterior");
    assert!(probabilities.iter().all(|p| (0.0..=1.0).contains(p)), "{probabilities:?}");
}

fn hear_frame(agent: &mut Agent, frame: &[u8]) -> Receipt {
    let mut frame = frame.to_vec();
    match agent.receive(&frame, 0.0) {
        // The bits of the check number are not for a fuzzer to guess: they begin in byte 3 of reports and 4 of others.
        Receipt::Refused(Refusal::OtherTeam { found: Some(found), expected }) => {
            let first = if pingmap_packet::ReportLayout::of(&frame).is_some() { 3 } else { 4 };
            let [low, high] = (found ^ expected).to_le_bytes();
            (frame[first], frame[first + 1]) = (frame[first] ^ low, frame[first + 1] ^ high);
            agent.receive(&frame, 0.0)
        }
        receipt => receipt,
    }
}
