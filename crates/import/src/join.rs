//! From what vehicles recorded to events.

use std::collections::{BTreeMap, BTreeSet};

use pingmap_agent::{Event, Link, ReferenceSystem, VehicleId};
use pingmap_trial::EventLog;

use crate::clocks::Clocks;
use crate::error::ImportError;
use crate::fleet::Fleet;
use crate::listening::{Sending, unknown};
use crate::matching::{Matches, add_received, all_matches, doubt};
use crate::recording::Recordings;
use crate::reference::Reference;
use crate::report::{ClockFound, Imported, LeftOut, Pair, Proofs};
use crate::rules::{AlwaysSend, Rules};
use crate::schedule::Schedule;
use crate::time::time_in_words;
use crate::transmission::{Proof, Reception, Transmission, known, senders};

/// Matching and fitting clocks take turns so often at most.
const ROUNDS_MAX: usize = 30;

/// A schedule with more slots in a mission is a slip.
const SLOTS_MAX: f64 = 1e7;

/// Puts together what vehicles recorded: what was sent, who heard it, who could have. O(n log n) for n lines, times the vehicles.
///
/// # Errors
/// [`ImportError::Together`] where there is nobody who listened, nobody who moved, or a name that nobody has.
pub fn join(
    recordings: &Recordings,
    schedule: Option<&Schedule>,
    reference: &Reference,
    rules: &Rules,
) -> Result<Imported, ImportError> {
    let fleet = Fleet::new(recordings, reference, rules);
    check(&fleet, schedule)?;
    let mut sent = known(&fleet, schedule);
    let accounted = senders(&sent);
    let mut clocks = guess(&fleet, &sent, &accounted);
    check_reference(&fleet, &clocks)?;
    let mut matched = BTreeMap::new();
    for _ in 0..ROUNDS_MAX {
        let found = all_matches(&fleet, &clocks, &sent);
        if found == matched {
            break;
        }
        matched.clone_from(&found);
        clocks.improve(&fleet, &receptions(&fleet, &sent, &found));
    }
    let Unmatched { unexpected, strays } = unmatched(&fleet, &clocks, &mut sent, &accounted);
    let matches = all_matches(&fleet, &clocks, &sent);
    let whom_by_reception = prove(&fleet, &mut sent, &matches);
    let (mut log, mut pairs) = events(&fleet, &clocks, &sent, &matches);
    for ((receiver, sender), pair) in &mut pairs {
        pair.twice = fleet.twice.get(&(*receiver, *sender)).copied().unwrap_or(0);
        pair.stray = strays.get(&(*receiver, *sender)).copied().unwrap_or(0);
    }
    pairs.retain(|_, pair| *pair != Pair::default());
    let name = |vehicle: usize| fleet.vehicles[vehicle].name.clone();
    let overheard = pairs.values().map(|pair| pair.overheard).sum();
    log.reference = reference.system();
    let found = ClockFound::all(&fleet, &clocks, &receptions(&fleet, &sent, &matches));
    Ok(Imported {
        proofs: Proofs::of(&sent),
        left_out: LeftOut {
            strangers: fleet.strangers.clone(),
            to_strangers: fleet.to_strangers.clone(),
            twice: fleet.twice.values().sum(),
            own: fleet.own,
            overheard,
            unexpected,
            unplaced: fleet.vehicles.iter().map(|vehicle| vehicle.track.unplaced).sum(),
        },
        by_reception_alone: fleet.names(&senders(&sent).difference(&accounted).copied().collect()),
        whom_by_reception: fleet.names(&whom_by_reception),
        unused_turns: fleet.names(&unused(&sent)),
        delay_s: clocks.delay_s,
        doubts: clocks.doubts.clone(),
        clocks: found,
        log,
        pairs: pairs.into_iter().map(|((receiver, sender), pair)| ((name(sender), name(receiver)), pair)).collect(),
    })
}

fn check(fleet: &Fleet, schedule: Option<&Schedule>) -> Result<(), ImportError> {
    let fail = |text: String| Err(ImportError::Together(text));
    if fleet.receivers().next().is_none() {
        return fail("no record of what was heard; expected one of at least one vehicle (--heard NAME=FILE, or a log that holds its modem's words) and where all were (--nav)".into());
    }
    for vehicle in &fleet.vehicles {
        let name = vehicle.name;
        let Some((from_s, to_s)) = vehicle.track.span_s() else {
            return fail(format!(
                "{name}: no record of where it was; expected one (--nav {name}=FILE), or where it stays (--fixed)"
            ));
        };
        let heard = vehicle.recording.arrivals.iter().flatten().map(|arrival| arrival.time_s);
        let mut times = heard.chain(vehicle.recording.sent.iter().flatten().map(|sent| sent.time_s)).peekable();
        let off_s = fleet.rules.clock_off_s_max + fleet.rules.nav_gap_s_max;
        if times.peek().is_some() && !times.any(|time_s| from_s - off_s <= time_s && time_s <= to_s + off_s) {
            let [from, to] = [from_s, to_s].map(time_in_words);
            return fail(format!(
                "{name}: its navigation is from {from} to {to}, and nothing that it heard or sent is; expected times of one kind in both"
            ));
        }
    }
    let right = fleet.rules.right_clock.as_ref();
    if let Some(name) = right.filter(|name| fleet.number(name).is_none()) {
        return fail(format!("nobody is called {name}; expected one of {}", names(fleet)));
    }
    let nobody = |name: &&VehicleId| fleet.number(name).is_none();
    if let AlwaysSend::These(these) = &fleet.rules.always_send
        && let Some(name) = these.iter().find(nobody)
    {
        return fail(format!(
            "nobody is called {name}, who is said to use every turn; expected one of {}",
            names(fleet)
        ));
    }
    let (from_s, to_s) = fleet.span_s();
    let slots = schedule.map_or(0.0, |schedule| schedule.slots_between(from_s, to_s));
    if slots > SLOTS_MAX {
        let [from, to] = [from_s, to_s].map(time_in_words);
        return fail(format!(
            "the schedule has {slots:.0} slots between the first and the last thing recorded, {from} to {to}; expected at most {SLOTS_MAX:.0} (a time far from the rest?)"
        ));
    }
    if let Some(name) = schedule.and_then(|schedule| schedule.senders().find(nobody)) {
        return fail(format!(
            "the schedule has turns for {name}, of whom nothing was recorded; expected one of {} (or --ids)",
            names(fleet)
        ));
    }
    Ok(())
}

/// A clock that is compared with no other can be the measure of none.
fn check_reference(fleet: &Fleet, clocks: &Clocks) -> Result<(), ImportError> {
    let alone = clocks.clocks.len() > 1 && clocks.clocks.iter().filter(|clock| clock.known).count() == 1;
    match &fleet.rules.right_clock {
        Some(name) if alone => Err(ImportError::Together(format!(
            "no two messages compare {name}'s clock with another's, so none can be corrected to it; expected a vehicle that was heard by \
             others or heard them (or --clock-off-s-max 0, if clocks agree)"
        ))),
        _ => Ok(()),
    }
}

fn names(fleet: &Fleet) -> String {
    fleet.names(&(0..fleet.vehicles.len()).collect())
}

/// A first idea of clocks. Senders that kept no record and have no turns are known for that by what one receiver has of them.
fn guess(fleet: &Fleet, sent: &[Vec<Transmission>], accounted: &BTreeSet<usize>) -> Clocks {
    let messages =
        |receiver: usize, sender: usize| fleet.vehicles[receiver].messages.get(&sender).map_or(&[][..], Vec::as_slice);
    let mut provisional = sent.to_vec();
    for sender in (0..sent.len()).filter(|sender| !accounted.contains(sender)) {
        let Some(receiver) = fleet.receivers().max_by_key(|&receiver| messages(receiver, sender).len()) else {
            continue;
        };
        let behind =
            |message| Transmission::behind(message, receiver, fleet.travel_s(sender, receiver, message.time_s));
        provisional[sender] = messages(receiver, sender).iter().map(behind).collect();
        provisional[sender].sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    }
    let mut clocks = Clocks::guess(fleet, &provisional);
    clocks.search_pieces(fleet, &provisional);
    clocks
}

/// What was received and fits nothing that was sent.
struct Unmatched {
    /// Of senders of whom it is recorded what they sent, or when it was their turn.
    unexpected: BTreeMap<VehicleId, usize>,
    /// Of senders that recorded all that they sent, by receiver and sender.
    strays: BTreeMap<(usize, usize), usize>,
}

/// Adds what is known by a reception alone to what was sent, or puts what was sent in doubt.
fn unmatched(fleet: &Fleet, clocks: &Clocks, sent: &mut [Vec<Transmission>], accounted: &BTreeSet<usize>) -> Unmatched {
    let (mut unexpected, mut strays) = (BTreeMap::new(), BTreeMap::new());
    for (sender, sent) in sent.iter_mut().enumerate() {
        let added = match fleet.vehicles[sender].recording.sent {
            // Its record tells all that it sent: what fits none of that is not another transmission, and puts the nearest in doubt.
            Some(_) => {
                let of_sender = doubt(fleet, clocks, sender, sent);
                let all = of_sender.values().sum();
                strays.extend(of_sender.into_iter().map(|(receiver, number)| ((receiver, sender), number)));
                all
            }
            None => add_received(fleet, clocks, sender, sent),
        };
        if added > 0 && accounted.contains(&sender) {
            unexpected.insert(fleet.vehicles[sender].name.clone(), added);
        }
    }
    Unmatched { unexpected, strays }
}

/// Each message that has a transmission.
fn receptions<'a>(
    fleet: &Fleet,
    sent: &'a [Vec<Transmission>],
    found: &BTreeMap<(usize, usize), Matches>,
) -> Vec<Reception<'a>> {
    let mut receptions = Vec::new();
    for (&(receiver, sender), matches) in found {
        let messages = &fleet.vehicles[receiver].messages[&sender];
        receptions.extend(matches.iter().map(|(&place, &message)| {
            let time_s = messages[message].time_s;
            Reception { sender, sent: &sent[sender][place], receiver, time_s }
        }));
    }
    receptions
}

/// Whatever somebody received was sent; to whom and as what kind of message its receivers say, if its sender does not. What they say holds
/// for everybody, so that what is left out is left out heard and missed alike. Returned are those of whom only receivers say to whom they
/// sent: what nobody received of them may have been to anybody.
fn prove(
    fleet: &Fleet,
    sent: &mut [Vec<Transmission>],
    matches: &BTreeMap<(usize, usize), Matches>,
) -> BTreeSet<usize> {
    let is_recorded = |is_said: fn(&Transmission) -> bool| -> Vec<bool> {
        let says = |sent: &Vec<Transmission>| sent.iter().any(|sent| sent.proof == Proof::Recorded && is_said(sent));
        sent.iter().map(says).collect()
    };
    let destinations_recorded = is_recorded(|sent| sent.destination.is_some());
    let kinds_recorded = is_recorded(|sent| sent.kind.is_some());
    let (mut heard, mut whom_by_reception) = (BTreeSet::new(), BTreeSet::new());
    for (&(receiver, sender), matches) in matches {
        for (&place, &message) in matches {
            let message = &fleet.vehicles[receiver].messages[&sender][message];
            let sent = &mut sent[sender][place];
            sent.proof = sent.proof.min(Proof::Received);
            sent.destination = sent
                .destination
                .take()
                .or_else(|| message.destination.clone().filter(|_| !destinations_recorded[sender]));
            sent.kind = sent.kind.take().or_else(|| message.kind.clone().filter(|_| !kinds_recorded[sender]));
            heard.insert((sender, place));
        }
    }
    for (sender, all) in sent.iter_mut().enumerate() {
        if !destinations_recorded[sender] && all.iter().any(|sent| sent.destination.is_some()) {
            let unheard = all.iter_mut().enumerate().filter(|(place, _)| !heard.contains(&(sender, *place)));
            unheard.for_each(|(_, sent)| sent.destination_unknown = true);
            whom_by_reception.extend(all.iter().any(|sent| sent.destination_unknown).then_some(sender));
        }
        // A kind that only heard messages have would say that it is always heard.
        let lacks_kind = |sent: &Transmission| sent.kind.is_none() && sent.proof != Proof::Nothing;
        if !kinds_recorded[sender] && all.iter().any(lacks_kind) {
            all.iter_mut().for_each(|sent| sent.kind = None);
        }
    }
    whom_by_reception
}

/// Those of whom turns are left that nobody can vouch for.
fn unused(sent: &[Vec<Transmission>]) -> BTreeSet<usize> {
    let open = |sender: &usize| sent[*sender].iter().any(|sent| sent.proof == Proof::Nothing);
    (0..sent.len()).filter(open).collect()
}

/// Every transmission, by everybody who could have heard it: events, and what is known of each receiver and sender.
fn events(
    fleet: &Fleet,
    clocks: &Clocks,
    sent: &[Vec<Transmission>],
    matches: &BTreeMap<(usize, usize), Matches>,
) -> (EventLog, BTreeMap<(usize, usize), Pair>) {
    let sending = Sending::of(fleet, clocks, sent);
    let mut events = Vec::new();
    let mut pairs: BTreeMap<(usize, usize), Pair> = BTreeMap::new();
    for (sender, all) in sent.iter().enumerate() {
        for receiver in fleet.receivers().filter(|&receiver| receiver != sender) {
            let [from, to] = [sender, receiver].map(|vehicle| fleet.vehicles[vehicle].name.clone());
            let pair = pairs.entry((receiver, sender)).or_default();
            for (place, sent) in all.iter().enumerate() {
                let message = matches.get(&(receiver, sender)).and_then(|matches| matches.get(&place));
                let message = message.map(|&message| &fleet.vehicles[receiver].messages[&sender][message]);
                if sent.destination.as_ref().is_some_and(|destination| *destination != to) && !fleet.rules.overhear {
                    pair.overheard += 1;
                    continue;
                }
                let (time_s, link) = time_and_place(fleet, clocks, (sender, sent), receiver);
                if let Some(reason) = unknown(fleet, clocks, &sending, (sender, sent), (receiver, link)) {
                    *pair.unknown.entry(reason).or_default() += 1;
                    continue;
                }
                let Some(link) = link else { continue };
                let success = message.is_some_and(|message| message.is_heard(sent.frames, fleet.rules.any_frame));
                *if success { &mut pair.heard } else { &mut pair.missed } += 1;
                let kind = sent.kind.clone();
                let [transmitter_id, receiver_id] = [from.clone(), to.clone()];
                events.push(Event { time_s, transmitter_id, receiver_id, link, kind, success });
            }
        }
    }
    events.sort_by(|a, b| {
        let by_time = a.time_s.total_cmp(&b.time_s);
        by_time.then_with(|| (&a.transmitter_id, &a.receiver_id).cmp(&(&b.transmitter_id, &b.receiver_id)))
    });
    (log_of(events), pairs)
}

/// Depths count where all places have one.
fn log_of(mut events: Vec<Event>) -> EventLog {
    let mut ends = events.iter().flat_map(|event| event.link.ends());
    let has_depths = !events.is_empty() && ends.all(|end| end.depth_m.is_some());
    if !has_depths {
        for event in &mut events {
            let Link { transmitter, receiver } = &mut event.link;
            (transmitter.depth_m, receiver.depth_m) = (None, None);
        }
    }
    EventLog {
        events,
        true_probability: None,
        has_depths,
        unknown_columns: Vec::new(),
        reference: ReferenceSystem::Unknown,
    }
}

/// When a transmission began, and where both were then: by the right clock, if one is; as recorded, if none is.
fn time_and_place(
    fleet: &Fleet,
    clocks: &Clocks,
    (sender, sent): (usize, &Transmission),
    receiver: usize,
) -> (f64, Option<Link>) {
    let recorded_s = clocks.begin_s(sent);
    let corrected = fleet.rules.right_clock.is_some();
    let time_s = if corrected { clocks.true_s(sent) } else { recorded_s };
    let at = |vehicle: usize| {
        let local_s = if corrected { clocks.local_s(sent, vehicle) } else { recorded_s };
        fleet.vehicles[vehicle].track.at(local_s, fleet.rules.nav_gap_s_max)
    };
    let link = at(sender).zip(at(receiver)).map(|(transmitter, receiver)| Link { transmitter, receiver });
    (time_s, link)
}
