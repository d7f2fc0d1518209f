//! What one faulty member does to the others, and what leaving it out saves, told by points, by reports, and by both:
//! `cargo run --release -p pingmap-trial --example faulty_member -- events.csv splits.csv [points|reports|both]`.
//!
//! In every split every vehicle in turn is the faulty one. The mean negative log-likelihood is that of all others over
//! all held-out events: by their own events alone, with everybody's ten sealed packets believed, and as a vehicle decides by
//! default; then how often the faulty one was left out and another one beside it, and the range of its surprise.

#![allow(clippy::print_stdout, reason = "what it measures is its output")]

use std::path::Path;
use std::sync::Arc;

use pingmap_agent::{Agent, AgentError, Event, Key, Learning, Team, Telling, VehicleId};
use pingmap_packet::{Block, Cell, MapMessage, Outcome as Heard, Point};
use pingmap_trial::{Agreed, EventLog, Mission, Plan, Score, Split, read_splits};
use rand::{Rng, RngExt, SeedableRng};

type Failure = Box<dyn std::error::Error + Send + Sync>;

const PACKETS: usize = 10;

/// What may be wrong with a member that tells by points or by reports, the last two by points alone.
const FAULTS: [&str; 8] =
    ["honest", "silent", "deaf", "random", "one lie", "contrary", "biased by 1/6", "biased by 1/2"];

/// What may be wrong with the ear of a member that tells what it heard as it does by default.
const FAULTY_EARS: [&str; 5] = ["honest", "silent", "deaf", "random", "contrary"];

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().collect();
    let ([_, events, splits] | [_, events, splits, _]) = arguments.as_slice() else {
        return Err("expected: events.csv splits.csv [points|reports|both]".into());
    };
    let log = EventLog::open(Path::new(events))?;
    let splits = read_splits(Path::new(splits), &log)?;
    let told: [(&str, Telling, &[&str]); 3] = [
        ("points", Telling { points: true, reports: false }, &FAULTS),
        ("reports", Telling { points: false, reports: true }, &FAULTS[..6]),
        ("both", Telling { points: true, reports: true }, &FAULTY_EARS),
    ];
    let wanted = arguments.get(3);
    for (title, telling, faults) in told.into_iter().filter(|(title, ..)| wanted.is_none_or(|wanted| wanted == title)) {
        table(&log, &splits, title, telling, faults)?;
    }
    Ok(())
}

fn table(log: &EventLog, splits: &[Split], title: &str, telling: Telling, faults: &[&str]) -> Result<(), Failure> {
    let mut plan = Plan::new(Learning::default(), 1);
    plan.key = Some(Key::new(*b"the secret of a team of vehicles")?);
    plan.telling = telling;
    let mut outcomes: Vec<Vec<Outcome>> = faults.iter().map(|_| Vec::new()).collect();
    for (number, split) in splits.iter().enumerate() {
        let mission = Mission::prepare(log, split, &plan, PACKETS)?;
        let believing = Team { surprise_max: 1e9, ..(*mission.team).clone() };
        let believing = Plan { agreed: Agreed::Team(Box::new(believing)), ..plan.clone() };
        let believing = Mission::prepare(log, split, &believing, 0)?.vehicles;
        for faulty in 0..mission.vehicles.len() {
            let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64((100 * number + faulty) as u64);
            for (fault, outcomes) in faults.iter().zip(&mut outcomes) {
                let said = said(log, &mission, telling, faulty, fault, &mut rng)?;
                for (listener, believing) in believing.iter().enumerate().filter(|&(listener, _)| listener != faulty) {
                    outcomes.push(listen(&mission, listener, believing, faulty, &said)?);
                }
            }
        }
    }
    println!("{title:15} {:>6} {:>8} {:>8} {:>5} {:>7}  surprise", "alone", "believed", "default", "out", "others");
    for (fault, outcomes) in faults.iter().zip(&outcomes) {
        println!("{}", row(fault, outcomes));
    }
    Ok(())
}

/// What became of a listener: NLL alone, believing all, and by default; members left out; the faulty one's surprise.
struct Outcome {
    nll: [f64; 3],
    is_out: bool,
    others_out: usize,
    surprise: f64,
}

fn row(fault: &str, outcomes: &[Outcome]) -> String {
    let mean = |of: &dyn Fn(&Outcome) -> f64| outcomes.iter().map(of).sum::<f64>() / outcomes.len() as f64;
    let surprises = || outcomes.iter().map(|outcome| outcome.surprise);
    format!(
        "{fault:15} {:>6.4} {:>8.4} {:>8.4} {:>5.2} {:>7.3}  {:.1} to {:.1}",
        mean(&|outcome| outcome.nll[0]),
        mean(&|outcome| outcome.nll[1]),
        mean(&|outcome| outcome.nll[2]),
        mean(&|outcome| f64::from(u8::from(outcome.is_out))),
        mean(&|outcome| outcome.others_out as f64),
        surprises().fold(f64::INFINITY, f64::min),
        surprises().fold(0.0, f64::max)
    )
}

fn listen(
    mission: &Mission,
    listener: usize,
    believing: &Agent,
    faulty: usize,
    said: &[Vec<u8>],
) -> Result<Outcome, AgentError> {
    let (mut believing, mut doubting) = (believing.clone(), mission.vehicles[listener].clone());
    let nll = |agent: &mut Agent| {
        let score = Score::new(&agent.probabilities(&mission.held_out)?, &mission.outcomes);
        Ok::<f64, AgentError>(score.map_or(f64::NAN, |score| score.nll))
    };
    let alone = nll(&mut doubting)?;
    for (sender, packets) in mission.packets.iter().enumerate().filter(|&(sender, _)| sender != listener) {
        for bytes in if sender == faulty { said } else { packets } {
            believing.receive(bytes, 0.0);
            doubting.receive(bytes, 0.0);
        }
    }
    believing.rebuild_posteriors()?;
    doubting.rebuild_posteriors()?;
    let nll = [alone, nll(&mut believing)?, nll(&mut doubting)?];
    let id: &VehicleId = mission.vehicles[faulty].id();
    let surprise = doubting.surprise(id)?.unwrap_or(0.0);
    let is_out = doubting.left_out().contains(&id);
    Ok(Outcome { nll, is_out, others_out: doubting.left_out().len() - usize::from(is_out), surprise })
}

/// What a member with this fault says.
fn said(
    log: &EventLog,
    mission: &Mission,
    telling: Telling,
    faulty: usize,
    fault: &str,
    rng: &mut impl Rng,
) -> Result<Vec<Vec<u8>>, AgentError> {
    let (member, honest) = (&mission.vehicles[faulty], &mission.packets[faulty]);
    let (by_points, by_both) = (!telling.reports, telling.points && telling.reports);
    let ear = |hears: &mut dyn FnMut(bool) -> bool| with_ear(log, member, telling, hears);
    let turned = |count: usize, turn: &dyn Fn(&mut Point), say: &mut dyn FnMut(bool) -> bool| {
        let turned = honest.iter().take(count).map(|bytes| {
            if by_points { turned_points(member, bytes, turn) } else { turned_report(member, bytes, say) }
        });
        turned.chain(honest.iter().skip(count).cloned().map(Ok)).collect::<Result<Vec<_>, AgentError>>()
    };
    let lower = |levels: i8| move |point: &mut Point| point.mean = (point.mean - levels).max(-15);
    let lie = |point: &mut Point| (point.information, point.mean) = (31, if point.mean > 0 { -15 } else { 15 });
    match fault {
        "silent" => Ok(Vec::new()),
        "deaf" if telling.points => ear(&mut |_| false),
        "random" if by_both => ear(&mut |_| rng.random()),
        "contrary" if by_both => ear(&mut |heard| !heard),
        "deaf" => turned(PACKETS, &|_| (), &mut |_| false),
        "random" if by_points => (0..PACKETS).map(|counter| random(member, counter as u16, rng)).collect(),
        "random" => turned(PACKETS, &|_| (), &mut |_| rng.random()),
        "one lie" => turned(1, &lie, &mut |heard| !heard),
        "contrary" => turned(PACKETS, &|point| point.mean = -point.mean, &mut |heard| !heard),
        "biased by 1/6" => turned(PACKETS, &lower(1), &mut |heard| heard),
        "biased by 1/2" => turned(PACKETS, &lower(3), &mut |heard| heard),
        _ => Ok(honest.clone()),
    }
}

/// What a member tells that hears something else than there was to hear.
fn with_ear(
    log: &EventLog,
    member: &Agent,
    telling: Telling,
    hears: &mut dyn FnMut(bool) -> bool,
) -> Result<Vec<Vec<u8>>, AgentError> {
    let mut faulty = Agent::new(member.id().clone(), Arc::new(member.team().clone())).telling(telling);
    faulty.navigate(log.track(member.id()))?;
    faulty.observe_all(member.events().map(|event| Event { success: hears(event.success), ..event.clone() }))?;
    faulty.refit()?;
    let mut packets = Vec::new();
    while packets.len() < PACKETS
        && let Some(packet) = faulty.next_packet(0.0, member.team().frame_bytes)?
    {
        packets.push(packet);
    }
    Ok(packets)
}

/// A valid packet whose every number is random.
fn random(member: &Agent, counter: u16, rng: &mut impl Rng) -> Result<Vec<u8>, AgentError> {
    let layout = member.team().layout(member.team().frame_bytes)?;
    let mut cell = || Cell { east: rng.random_range(0..64), north: rng.random_range(0..64), depth: 0 };
    let places: Vec<[Cell; 2]> = (0..layout.points_in_all()).map(|_| [cell(), cell()]).collect();
    let point = |[transmitter, receiver]: [Cell; 2]| Point {
        transmitter,
        receiver,
        information: rng.random_range(0..32),
        mean: rng.random_range(-15..=15),
    };
    let points: Vec<Point> = places.into_iter().map(point).collect();
    let blocks = points.chunks(layout.points).map(|points| Block {
        time: rng.random_range(0..64),
        points: points.to_vec(),
        correlations: (0..layout.correlations()).map(|_| rng.random_range(-3..=3)).collect(),
    });
    let sender = member.team().number(member.id()).unwrap_or_default();
    Ok(member.write(layout, &MapMessage { sender, counter, model: 0, blocks: blocks.collect() })?)
}

/// A map message with other numbers at the points of which it says something.
fn turned_points(member: &Agent, bytes: &[u8], turn: &dyn Fn(&mut Point)) -> Result<Vec<u8>, AgentError> {
    let Ok((layout, mut message)) = member.read(bytes) else { return Ok(bytes.to_vec()) };
    let points = message.blocks.iter_mut().flat_map(|block| &mut block.points);
    points.filter(|point| point.information > 0).for_each(turn);
    Ok(member.write(layout, &message)?)
}

/// A report that says otherwise of what it heard and missed.
fn turned_report(member: &Agent, bytes: &[u8], say: &mut dyn FnMut(bool) -> bool) -> Result<Vec<u8>, AgentError> {
    let Ok((_, mut report, _)) = member.read_report(bytes) else { return Ok(bytes.to_vec()) };
    for outcome in report.outcomes.iter_mut().filter(|outcome| **outcome != Heard::Untold) {
        *outcome = if say(*outcome == Heard::Heard) { Heard::Heard } else { Heard::Missed };
    }
    Ok(member.write_report(&report)?)
}
