//! Measures the damage by one faulty member, and the benefit of excluding it, with summaries, with reports, and with
//! both.
//!
//! In every split each vehicle in turn is the faulty member. With `majority`, every member but one has the fault. The
//! program prints the mean NLL of all other vehicles over all held-out events: from own events alone, from the ten
//! authenticated packets of every member, and with exclusion by default. Three more columns follow: how often the
//! faulty member was excluded, how many other members were excluded, and the range of the faulty member's discrepancy.
//!
//! `cargo run --release -p pingmap-trial --example faulty_member -- events.csv splits.csv
//! [summaries|reports|both|majority]`

#![allow(clippy::print_stdout, reason = "what it measures is its output")]

use std::path::Path;
use std::sync::Arc;

use pingmap_agent::{
    Agent, AgentError, AgentOptions, Event, IgnoreReason, Key, Learning, PredictOptions, Sharing, Team, VehicleId,
};
use pingmap_packet::{Block, Cell, MapMessage, Outcome as Reported, Point, Waypoint};
use pingmap_trial::{Agreed, EventLog, Mission, Plan, Score, Split, read_splits};
use rand::{Rng, RngExt, SeedableRng};

type Failure = Box<dyn std::error::Error + Send + Sync>;

const PACKETS: usize = 10;

/// Faults of a member that sends summaries.
const FAULTS: [&str; 8] =
    ["honest", "silent", "deaf", "random", "one lie", "reversed", "biased by 1/6", "biased by 1/2"];

/// Faults of a member that sends reports.
const REPORT_FAULTS: [&str; 12] = [
    "honest",
    "silent",
    "deaf",
    "all heard",
    "random",
    "reversed",
    "1/5 reversed",
    "300 m east",
    "mirrored",
    "random track",
    "claims",
    "mirrored, claims",
];

/// Faults of a receiver, with both kinds of packets.
const FAULTY_RECEIVERS: [&str; 5] = ["honest", "silent", "deaf", "random", "reversed"];

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().collect();
    let ([_, events, splits] | [_, events, splits, _]) = arguments.as_slice() else {
        return Err("expected: events.csv splits.csv [summaries|reports|both|majority]".into());
    };
    let log = EventLog::open(Path::new(events))?;
    let splits = read_splits(Path::new(splits), &log)?;
    let tables: [(&str, Sharing, &[&str]); 4] = [
        ("summaries", Sharing::summaries(), &FAULTS),
        ("reports", Sharing::reports(), &REPORT_FAULTS),
        ("both", Sharing::default(), &FAULTY_RECEIVERS),
        ("majority", Sharing::reports(), &REPORT_FAULTS),
    ];
    let wanted = arguments.get(3);
    for (title, sharing, faults) in tables.into_iter().filter(|(title, ..)| wanted.is_none_or(|wanted| wanted == title))
    {
        table(&log, &splits, title, sharing, faults)?;
    }
    Ok(())
}

fn table(log: &EventLog, splits: &[Split], title: &str, sharing: Sharing, faults: &[&str]) -> Result<(), Failure> {
    let mut plan = Plan::new(Learning::default(), 1);
    plan.key = Some(Key::new(*b"the secret of a team of vehicles")?);
    plan.sharing = sharing;
    let mut outcomes: Vec<Vec<Outcome>> = faults.iter().map(|_| Vec::new()).collect();
    for (number, split) in splits.iter().enumerate() {
        let mission = Mission::prepare(log, split, &plan, PACKETS)?;
        let believing = Team { exclusion_threshold_sd: 1e9, ..(*mission.team).clone() };
        let believing = Plan { agreed: Agreed::Team(Box::new(believing)), ..plan.clone() };
        let believing = Mission::prepare(log, split, &believing, 0)?.vehicles;
        for faulty in 0..mission.vehicles.len() {
            let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64((100 * number + faulty) as u64);
            for (fault, outcomes) in faults.iter().zip(&mut outcomes) {
                if title == "majority" {
                    let mut of = |member: usize| packets(log, &mission, sharing, member, fault, &mut rng);
                    let all = (0..mission.vehicles.len()).map(&mut of).collect::<Result<Vec<_>, _>>()?;
                    let of_fault = |sender: usize| &all[sender];
                    outcomes.push(listen(&mission, faulty, &believing[faulty], (faulty + 1) % all.len(), &of_fault)?);
                    continue;
                }
                let packets = packets(log, &mission, sharing, faulty, fault, &mut rng)?;
                let sent = |sender: usize| if sender == faulty { &packets } else { &mission.packets[sender] };
                for (listener, believing) in believing.iter().enumerate().filter(|&(listener, _)| listener != faulty) {
                    outcomes.push(listen(&mission, listener, believing, faulty, &sent)?);
                }
            }
        }
    }
    println!(
        "{title:15} {:>6} {:>8} {:>8} {:>8} {:>7}  discrepancy",
        "alone", "believed", "default", "excluded", "others"
    );
    for (fault, outcomes) in faults.iter().zip(&outcomes) {
        println!("{}", row(fault, outcomes));
    }
    Ok(())
}

/// Results of a listener.
struct Outcome {
    /// NLL from own events, without exclusion, and by default.
    nll: [f64; 3],
    is_excluded: bool,
    others_excluded: usize,
    discrepancy: f64,
}

fn row(fault: &str, outcomes: &[Outcome]) -> String {
    let mean = |value: &dyn Fn(&Outcome) -> f64| outcomes.iter().map(value).sum::<f64>() / outcomes.len() as f64;
    let discrepancies = || outcomes.iter().map(|outcome| outcome.discrepancy);
    format!(
        "{fault:15} {:>6.4} {:>8.4} {:>8.4} {:>8.2} {:>7.3}  {:.1} to {:.1}",
        mean(&|outcome| outcome.nll[0]),
        mean(&|outcome| outcome.nll[1]),
        mean(&|outcome| outcome.nll[2]),
        mean(&|outcome| f64::from(u8::from(outcome.is_excluded))),
        mean(&|outcome| outcome.others_excluded as f64),
        discrepancies().fold(f64::INFINITY, f64::min),
        discrepancies().fold(0.0, f64::max)
    )
}

fn listen<'a>(
    mission: &Mission,
    listener: usize,
    believing: &Agent,
    faulty: usize,
    sent: &dyn Fn(usize) -> &'a Vec<Vec<u8>>,
) -> Result<Outcome, AgentError> {
    let (mut believing, mut doubting) = (believing.clone(), mission.vehicles[listener].clone());
    let nll = |agent: &mut Agent| {
        let predictions = agent.predict(&mission.held_out, PredictOptions::default())?;
        let predicted: Vec<f64> = predictions.iter().map(|prediction| prediction.probability).collect();
        Ok::<f64, AgentError>(Score::new(&predicted, &mission.outcomes).map_or(f64::NAN, |score| score.nll))
    };
    let alone = nll(&mut doubting)?;
    for sender in (0..mission.packets.len()).filter(|&sender| sender != listener) {
        for bytes in sent(sender) {
            believing.receive(bytes, Some(mission.end_s));
            doubting.receive(bytes, Some(mission.end_s));
        }
    }
    believing.rebuild()?;
    doubting.rebuild()?;
    let nll = [alone, nll(&mut believing)?, nll(&mut doubting)?];
    let id: &VehicleId = mission.vehicles[faulty].id();
    let discrepancy = doubting.discrepancy(id)?.unwrap_or(0.0);
    let members = doubting.status().members;
    let is_excluded = members.get(id).is_some_and(|member| member.is_ignored(IgnoreReason::Contradicts));
    let excluded = members.values().filter(|member| member.is_ignored(IgnoreReason::Contradicts)).count();
    Ok(Outcome { nll, is_excluded, others_excluded: excluded - usize::from(is_excluded), discrepancy })
}

/// Returns the packets of a member with this fault.
fn packets(
    log: &EventLog,
    mission: &Mission,
    sharing: Sharing,
    faulty: usize,
    fault: &str,
    rng: &mut impl Rng,
) -> Result<Vec<Vec<u8>>, AgentError> {
    let (member, honest) = (&mission.vehicles[faulty], &mission.packets[faulty]);
    let (summaries_alone, both) = (!sharing.reports, sharing.summaries && sharing.reports);
    let record = |hear: &mut dyn FnMut(bool) -> bool| with_receiver(log, member, sharing, hear);
    let changed = |count: usize, change: &dyn Fn(&mut Point), report: &mut dyn FnMut(bool) -> bool| {
        let changed = honest.iter().take(count).map(|bytes| {
            if summaries_alone { changed_summary(member, bytes, change) } else { changed_report(member, bytes, report) }
        });
        changed.chain(honest.iter().skip(count).cloned().map(Ok)).collect::<Result<Vec<_>, AgentError>>()
    };
    let lower = |levels: i8| move |point: &mut Point| point.mean = (point.mean - levels).max(-15);
    let lie = |point: &mut Point| (point.information, point.mean) = (31, if point.mean > 0 { -15 } else { 15 });
    let tracks = |change: &mut dyn FnMut(&mut Waypoint)| {
        let changed = honest.iter().map(|bytes| changed_track(member, bytes, change));
        changed.collect::<Result<Vec<_>, AgentError>>()
    };
    let cells = (300.0 / (0.25 * member.team().grid.cell_m)).min(120.0) as u8;
    let mut mirror = |point: &mut Waypoint| (point.east, point.north) = (u8::MAX - point.east, u8::MAX - point.north);
    match fault {
        "all heard" => changed(PACKETS, &|_| (), &mut |_| true),
        "1/5 reversed" => changed(PACKETS, &|_| (), &mut |heard| heard != rng.random_bool(0.2)),
        "300 m east" => tracks(&mut |point| point.east = point.east.saturating_add(cells)),
        "mirrored" => tracks(&mut mirror),
        "random track" => tracks(&mut |point| (point.east, point.north) = (rng.random(), rng.random())),
        "claims" => Ok([honest.clone(), claims(member)?].concat()),
        "mirrored, claims" => Ok([tracks(&mut mirror)?, claims(member)?].concat()),
        "silent" => Ok(Vec::new()),
        "deaf" if sharing.summaries => record(&mut |_| false),
        "random" if both => record(&mut |_| rng.random()),
        "reversed" if both => record(&mut |heard| !heard),
        "deaf" => changed(PACKETS, &|_| (), &mut |_| false),
        "random" if summaries_alone => (0..PACKETS).map(|counter| random(member, counter as u16, rng)).collect(),
        "random" => changed(PACKETS, &|_| (), &mut |_| rng.random()),
        "one lie" => changed(1, &lie, &mut |heard| !heard),
        "reversed" => changed(PACKETS, &|point| point.mean = -point.mean, &mut |heard| !heard),
        "biased by 1/6" => changed(PACKETS, &lower(1), &mut |heard| heard),
        "biased by 1/2" => changed(PACKETS, &lower(3), &mut |heard| heard),
        _ => Ok(honest.clone()),
    }
}

/// Returns the packets of a member with a faulty receiver: `hear` maps each true outcome to the recorded one.
fn with_receiver(
    log: &EventLog,
    member: &Agent,
    sharing: Sharing,
    hear: &mut dyn FnMut(bool) -> bool,
) -> Result<Vec<Vec<u8>>, AgentError> {
    let options = AgentOptions { sharing, ..AgentOptions::default() };
    let mut faulty = Agent::new(member.id().clone(), Arc::new(member.team().clone()), options);
    faulty.record_positions(log.track(member.id()))?;
    faulty.record_all(member.events().map(|event| Event { success: hear(event.success), ..event.clone() }))?;
    faulty.refit()?;
    let mut packets = Vec::new();
    while packets.len() < PACKETS
        && let Some(packet) = faulty.next_frame(None, member.team().frame_bytes)?
    {
        packets.push(packet);
    }
    Ok(packets)
}

/// Returns a valid packet with random numbers.
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
    Ok(member.codec().write(layout, &MapMessage { sender, counter, model: 0, blocks: blocks.collect() })?)
}

/// Returns a summary with changed points.
fn changed_summary(member: &Agent, bytes: &[u8], change: &dyn Fn(&mut Point)) -> Result<Vec<u8>, AgentError> {
    let Ok((layout, mut message)) = member.codec().read(bytes) else { return Ok(bytes.to_vec()) };
    let points = message.blocks.iter_mut().flat_map(|block| &mut block.points);
    points.filter(|point| point.information > 0).for_each(change);
    Ok(member.codec().write(layout, &message)?)
}

/// Returns reports that claim every slot of the member as unused.
fn claims(member: &Agent) -> Result<Vec<Vec<u8>>, AgentError> {
    let options = AgentOptions { sharing: Sharing::reports(), ..AgentOptions::default() };
    let mut agent = Agent::new(member.id().clone(), Arc::new(member.team().clone()), options);
    let slots = &member.team().slots;
    let times = (0..slots.end()).filter(|&slot| slots.sender(slot) == Some(member.id()));
    let times: Vec<f64> = times.filter_map(|slot| slots.begin_s(slot)).collect();
    agent.record_unused_slots(times.iter().copied())?;
    agent.record_positions(member.events().map(|event| (event.time_s, event.link.receiver)))?;
    let mut reports = Vec::new();
    while let Some(report) = agent.next_frame(None, member.team().frame_bytes)? {
        reports.push(report);
    }
    Ok(reports)
}

/// Returns a report with changed waypoints.
fn changed_track(member: &Agent, bytes: &[u8], change: &mut dyn FnMut(&mut Waypoint)) -> Result<Vec<u8>, AgentError> {
    let Ok((_, mut report, _)) = member.codec().read_report(bytes) else { return Ok(bytes.to_vec()) };
    report.waypoints.iter_mut().for_each(change);
    Ok(member.codec().write_report(&report)?)
}

/// Returns a report with changed outcomes.
fn changed_report(member: &Agent, bytes: &[u8], change: &mut dyn FnMut(bool) -> bool) -> Result<Vec<u8>, AgentError> {
    let Ok((_, mut report, _)) = member.codec().read_report(bytes) else { return Ok(bytes.to_vec()) };
    for outcome in report.outcomes.iter_mut().filter(|outcome| **outcome != Reported::Unreported) {
        *outcome = if change(*outcome == Reported::Heard) { Reported::Heard } else { Reported::Missed };
    }
    Ok(member.codec().write_report(&report)?)
}
