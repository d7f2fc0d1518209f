//! The cost of each operation, counted in allocated bytes: unlike time, the count is the same on every machine.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use pingmap_agent::*;
use pingmap_packet::{Block, MapMessage, Outcome, Report, Waypoint};

use crate::common::{model, names};

/// Counts the bytes that the current thread allocates.
struct Counting;

thread_local! {
    static ALLOCATED: Cell<usize> = const { Cell::new(0) };
}

// SAFETY: every call is passed on to the system allocator unchanged; the counter needs no allocation and no destructor.
#[allow(unsafe_code)]
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATED.with(|allocated| allocated.set(allocated.get() + layout.size()));
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, place: *mut u8, layout: Layout) {
        unsafe { System.dealloc(place, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

/// The bytes that an operation allocates.
fn allocated<T>(operation: impl FnOnce() -> T) -> (T, usize) {
    let before = ALLOCATED.with(Cell::get);
    let result = operation();
    (result, ALLOCATED.with(Cell::get) - before)
}

/// Slots of ten seconds, in a cycle of three members.
const SLOT_S: f64 = 10.0;

/// The position of a member at a time: a slow circle of its own.
fn position(member: usize, time_s: f64) -> Position {
    let angle = time_s / 900.0 + member as f64;
    Position::new(400.0 * angle.sin(), 300.0 * (1.3 * angle).cos())
}

/// The event that a member records in a slot of another member.
fn event(receiver: usize, slot: usize) -> Event {
    let (transmitter, time_s) = (slot % 3, SLOT_S * slot as f64);
    let link = Link { transmitter: position(transmitter, time_s), receiver: position(receiver, time_s) };
    let [transmitter_id, receiver_id] = [transmitter, receiver].map(|member| names(3)[member].clone());
    Event { time_s, transmitter_id, receiver_id, link, kind: None, success: link.range_m() < 450.0 }
}

/// Events of a member from one slot on.
fn events(receiver: usize, slots: std::ops::Range<usize>) -> impl Iterator<Item = Event> {
    slots.filter(move |slot| slot % 3 != receiver).map(move |slot| event(receiver, slot))
}

/// Allocated bytes of each operation of a vehicle.
#[derive(Debug, PartialEq)]
struct Cost {
    record: usize,
    receive: usize,
    /// The first prediction after the first data of a peer.
    predict_with_first_peer: usize,
    predict: usize,
    predict_after_change: usize,
    next_frame: usize,
}

fn cost(count: usize) -> Cost {
    let team = std::sync::Arc::new(crate::common::team(3, model()));
    let slots = count * 3 / 2;
    let [mut agent, mut other] =
        [0, 1].map(|member| Agent::new(names(3)[member].clone(), team.clone(), AgentOptions::default()));
    // Four receptions outside of their slots, long ago.
    let late = (0..4).map(|n| Event {
        time_s: SLOT_S * (3 * n + 1) as f64 + 2.0 * SLOT_S,
        success: true,
        ..event(0, 3 * n + 1)
    });
    agent.record(late.chain(events(0, 12..slots))).unwrap();
    agent.refit().unwrap();
    other.record(events(1, slots - 60..slots - 6)).unwrap();
    other.refit().unwrap();
    let [first_frame, frame] = [slots, slots + 6].map(|end| {
        other.record(events(1, end - 6..end)).unwrap();
        other.next_frame(Some(SLOT_S * end as f64), 32).unwrap().unwrap().bytes
    });
    let query = event(0, slots + 1).query();
    agent.probability(query).unwrap();

    let mut records: Vec<usize> =
        events(0, slots..slots + 24).map(|event| allocated(|| agent.record([event]).unwrap()).1).collect();
    records.sort_unstable();
    let record = records[records.len() / 2];
    agent.probability(query).unwrap();
    assert_eq!(agent.receive(&first_frame, None).receipt, Receipt::Accepted);
    let predict_with_first_peer = allocated(|| agent.probability(query).unwrap()).1;
    let receive = allocated(|| assert_eq!(agent.receive(&frame, None).receipt, Receipt::Accepted)).1;
    let predict_after_change = allocated(|| agent.probability(query).unwrap()).1;
    let predict = allocated(|| agent.probability(query).unwrap()).1;
    let next_frame = allocated(|| agent.next_frame(Some(SLOT_S * (slots + 24) as f64), 32).unwrap().unwrap().bytes).1;
    Cost { record, receive, predict_with_first_peer, predict, predict_after_change, next_frame }
}

#[test]
fn operations_allocate_within_their_budgets() {
    for events in [1000, 10_000] {
        let cost = cost(events);
        let Cost { record, receive, predict_with_first_peer, predict, predict_after_change, next_frame } = cost;
        assert!(record < 4 << 10, "record: {record} bytes with {events} events");
        assert!(receive < 16 << 10, "receive: {receive} bytes with {events} events");
        // The fused posterior becomes a copy of the own one, which then grows.
        assert!(predict_with_first_peer < 24 << 20, "{predict_with_first_peer} bytes with {events} events");
        assert!(predict < 128 << 10, "predict: {predict} bytes with {events} events");
        assert!(
            predict_after_change < 4 << 20,
            "predict after a change: {predict_after_change} bytes with {events} events"
        );
        assert!(next_frame < 32 << 20, "next frame: {next_frame} bytes with {events} events");
    }
}

/// A report of member 1 about 110 slots, with two waypoints.
fn report(codec: &TeamCodec, first: u32, pattern: u32) -> Vec<u8> {
    let outcome = |n: u32| if (n ^ pattern).is_multiple_of(3) { Outcome::Heard } else { Outcome::Missed };
    let east = 40 + (pattern % 50) as u8;
    let report = Report {
        sender: 1,
        model: 0,
        first,
        includes_own_slots: false,
        outcomes: (0..110).map(outcome).collect(),
        waypoints: vec![
            Waypoint { slots: 0, east, north: 90, depth: 0 },
            Waypoint { slots: 110, east, north: 80, depth: 0 },
        ],
    };
    codec.write_report(&report).unwrap()
}

#[test]
fn a_flood_of_frames_of_one_member_leaves_memory_and_cost_within_their_bounds() {
    let team = std::sync::Arc::new(crate::common::team(3, model()));
    let mut agent = Agent::new(names(3)[0].clone(), team.clone(), AgentOptions::default());
    let slots = 20_000;
    let now_s = Some(SLOT_S * slots as f64);
    agent.record(events(0, 0..900)).unwrap();
    agent.record_positions([(0.0, position(0, 0.0)), (SLOT_S * slots as f64, position(0, 0.0))]).unwrap();
    let codec = agent.codec().clone();
    // Without a flood: as many reports as a member may have.
    for n in 0..256 {
        assert_eq!(agent.receive(&report(&codec, 78 * n, n), now_s).receipt, Receipt::Accepted);
    }
    agent.refit().unwrap();
    let before =
        (agent.snapshot().len(), allocated(|| agent.clone().next_frame(now_s, 32).unwrap().map(|frame| frame.bytes)).1);
    let layout = team.layout(32).unwrap();
    for n in 0..100_000u32 {
        // Slots and counters up to twice those that the clock allows.
        let frame = match n % 4 {
            0 => {
                let counter = (n.wrapping_mul(2_654_435_761) >> 16) as u16;
                let block = Block::empty(layout);
                codec
                    .write(layout, &MapMessage { sender: 1, counter, model: 0, blocks: vec![block; layout.blocks] })
                    .unwrap()
            }
            _ => report(&codec, n.wrapping_mul(2_654_435_761) % (2 * slots as u32), n),
        };
        agent.receive(&frame, now_s);
        if n % 1000 == 0 {
            agent.receive_piggyback(&names(3)[1], SLOT_S * f64::from(n % 40_000), u64::from(n), 64);
        }
    }
    agent.refit().unwrap();
    let after =
        (agent.snapshot().len(), allocated(|| agent.clone().next_frame(now_s, 32).unwrap().map(|frame| frame.bytes)).1);
    assert!(after.0 < 2 * before.0, "{before:?} {after:?}");
    assert!(after.1 < 2 * before.1, "{before:?} {after:?}");
}
