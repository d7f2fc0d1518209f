//! Times of the process, printed by tests that are run on request.

use std::path::Path;
use std::sync::Arc;

use pingmap_agent::{Agent, AgentOptions, Event, Link, Position, VehicleId};
use pingmap_vehicle::{Identity, Store};
use serde_json::{Value, json};

use super::host::{HELLO, Host};
use super::mission::{Mission, VEHICLES, folder};

const QUERY: &str = r#"{"type":"predict","links":[{"from":{"x":400,"y":300},"to":{"x":600,"y":500}}]}"#;

/// Returns the CPU time of a process in seconds.
fn cpu_s(id: u32) -> f64 {
    let text = std::fs::read_to_string(format!("/proc/{id}/stat")).unwrap();
    let fields: Vec<&str> = text.rsplit(") ").next().unwrap().split(' ').collect();
    let ticks = |place: usize| fields[place].parse::<f64>().unwrap();
    // The kernel counts in hundredths of a second.
    (ticks(11) + ticks(12)) / 100.0
}

/// Returns a field of the status of a process in MB.
fn memory_mb(id: u32, field: &str) -> f64 {
    let text = std::fs::read_to_string(format!("/proc/{id}/status")).unwrap();
    let line = text.lines().find_map(|line| line.strip_prefix(field)).unwrap();
    line.trim_start_matches(':').trim().trim_end_matches(" kB").parse::<f64>().unwrap() / 1000.0
}

/// Fills the store of `auv1` with events.
fn store_events(folder: &Path, count: usize) {
    let team = Arc::new(pingmap::read_team(&folder.join("team.toml")).unwrap());
    let identity = Identity { vehicle: "auv1".into(), team_digest: team.digest() };
    let mut agent = Agent::new(VehicleId::new("auv1"), team, AgentOptions::default());
    let mut mission = Mission::new(1);
    let mut place = || Position::new(1000.0 * mission.uniform(), 600.0 * mission.uniform());
    let event = |n: usize| {
        let link = Link { transmitter: place(), receiver: place() };
        Event {
            time_s: 1000.0 + 10.0 * (3 * (n / 2) + 1 + n % 2) as f64,
            transmitter_id: VehicleId::new(VEHICLES[1 + n % 2]),
            receiver_id: VehicleId::new("auv1"),
            link,
            kind: None,
            success: link.range_m() < 450.0,
        }
    };
    let entries = agent.record((0..count).map(event)).unwrap();
    let records: Vec<Vec<u8>> = entries.iter().map(|entry| [&[0], entry.to_bytes().as_slice()].concat()).collect();
    let (mut store, _) = Store::open(&folder.join("auv1.redb"), &identity).unwrap();
    store.append(&records).unwrap();
}

/// Returns the CPU time from the start of a process to its first answer.
fn start_s(folder: &Path, events: usize) -> f64 {
    let mut host = Host::start(folder, &["vehicle"]);
    // Inputs that arrive meanwhile wait.
    for line in [HELLO, r#"{"type":"nav","time":2000000,"position":{"x":1,"y":1}}"#, QUERY] {
        host.send(line);
    }
    assert_eq!(host.next().unwrap()["events"], events);
    assert_eq!(host.next().unwrap()["type"], "ok");
    assert_eq!(host.next().unwrap()["type"], "prediction");
    let time_s = cpu_s(host.child.id());
    host.close();
    assert!(host.finish().0.success());
    time_s
}

#[test]
#[ignore = "measures CPU time"]
fn start_to_first_answer() {
    for (events, bar_s) in [(1_000, 2.0), (10_000, 10.0)] {
        let folder = folder();
        store_events(folder.path(), events);
        let from_entries_s = start_s(folder.path(), events);
        let from_base_s = start_s(folder.path(), events);
        eprintln!("{events} events: {from_entries_s:.2} s of CPU from entries, {from_base_s:.2} s from a base");
        assert!(from_entries_s.max(from_base_s) < bar_s, "more than {bar_s} s");
    }
}

/// Four processes, and the water between them.
struct Fleet {
    hosts: Vec<Host>,
    mission: Mission,
}

const FLEET: [&str; 4] = ["auv1", "auv2", "auv3", "auv4"];

/// Each vehicle has an event in three of four slots: one every 10 s.
const SLOT_S: f64 = 7.5;

impl Fleet {
    fn place(vehicle: usize, time_s: f64) -> (f64, f64) {
        let angle = time_s / (300.0 + 70.0 * vehicle as f64) + vehicle as f64;
        (500.0 + 400.0 * angle.cos(), 300.0 + 300.0 * (1.3 * angle).sin())
    }

    fn start(folder: &Path) -> Self {
        let team = std::fs::read_to_string(folder.join("team.toml")).unwrap();
        let team = team.replace("auv3 = 2\n", "auv3 = 2\nauv4 = 3\n").replace("duration_s = 10.0", "duration_s = 7.5");
        let team = team.replace(r#""auv3"]"#, r#""auv3", "auv4"]"#);
        let team = team.replace("report_window_slots = 4\n", "report_window_slots = 16384\n");
        std::fs::write(folder.join("team.toml"), team).unwrap();
        let start = |id: &&str| {
            let config = format!("{id}.toml");
            std::fs::write(folder.join(&config), format!("schema = 1\nvehicle = \"{id}\"\nteam = \"team.toml\"\n"))
                .unwrap();
            let mut host = Host::start(folder, &["vehicle", "--config", &config]);
            assert_eq!(host.ask(HELLO)["type"], "hello");
            host
        };
        Self { hosts: FLEET.iter().map(start).collect(), mission: Mission::new(9) }
    }

    fn ask(&mut self, vehicle: usize, input: &Value) -> Value {
        let answer = self.hosts[vehicle].ask(&input.to_string());
        assert_ne!(answer["type"], "error", "{input}: {answer}");
        answer
    }

    /// Plays one slot.
    fn slot(&mut self, slot: usize) {
        let (sender, time) = (slot % FLEET.len(), 1000.0 + SLOT_S * slot as f64);
        let places: Vec<(f64, f64)> = (0..FLEET.len()).map(|vehicle| Self::place(vehicle, time)).collect();
        let place = |vehicle: usize| json!({ "x": places[vehicle].0, "y": places[vehicle].1 });
        for vehicle in 0..FLEET.len() {
            self.ask(vehicle, &json!({ "type": "nav", "time": time, "position": place(vehicle) }));
            // The host knows where the sender is, so that every slot is predicted before it is learned.
            if vehicle != sender {
                let (member, position) = (FLEET[sender], place(sender));
                self.ask(
                    vehicle,
                    &json!({ "type": "peer", "time": time, "member": member, "position": position, "source": "other" }),
                );
            }
        }
        let frame = self.ask(sender, &json!({ "type": "frame_request", "time": time + 1.0, "bytes": 64 }));
        let frames: Vec<&Value> = Some(&frame["bytes"]).filter(|_| frame["type"] == "frame").into_iter().collect();
        if frame["type"] == "frame" {
            self.ask(sender, &json!({ "type": "departed", "token": frame["token"], "time": time + 1.0 }));
        }
        self.ask(sender, &json!({ "type": "sent", "time": time + 1.0 }));
        for vehicle in (0..FLEET.len()).filter(|vehicle| *vehicle != sender) {
            let range_m = (places[vehicle].0 - places[sender].0).hypot(places[vehicle].1 - places[sender].1);
            if self.mission.uniform() < 1.0 / (1.0 + ((range_m - 450.0) / 60.0).exp()) {
                let (input, from) = (time + 1.5, FLEET[sender]);
                let line = json!({ "type": "heard", "time": input, "from": from, "frames": frames });
                self.hosts[vehicle].send(&line.to_string());
                // An acknowledgement for the frame comes before the ok.
                while self.hosts[vehicle].next().unwrap()["type"] != "ok" {}
            }
        }
    }
}

#[test]
#[ignore = "an hour"]
fn a_day_of_four_vehicles() {
    let hours: usize = std::env::var("PINGMAP_HOURS").map_or(24, |hours| hours.parse().unwrap());
    let folder = folder();
    let mut fleet = Fleet::start(folder.path());
    let id = fleet.hosts[0].child.id();
    let slots_per_hour = (3600.0 / SLOT_S) as usize;
    let (mut before_s, mut by_hour) = (cpu_s(id), Vec::new());
    eprintln!("hour  own events  located  CPU ms per own event  resident MB  store MB");
    for hour in 0..hours {
        (hour * slots_per_hour..(hour + 1) * slots_per_hour).for_each(|slot| fleet.slot(slot));
        let status = fleet.ask(0, &json!({ "type": "status" }));
        let now_s = cpu_s(id);
        let per_event_ms = 1000.0 * (now_s - before_s) / (0.75 * slots_per_hour as f64);
        let store_mb = std::fs::metadata(folder.path().join("auv1.redb")).unwrap().len() as f64 / 1e6;
        let (own, located) = (&status["own_events"], &status["located_events"]);
        let resident_mb = memory_mb(id, "VmRSS");
        eprintln!("{:4}  {own:>10}  {located:>7}  {per_event_ms:20.1}  {resident_mb:11.1}  {store_mb:8.1}", hour + 1);
        before_s = now_s;
        by_hour.push((per_event_ms, resident_mb));
    }
    // From the sixth hour on, limits are reached. The machine may be slower at times.
    let most =
        by_hour.iter().take(6).fold((0.0, 0.0), |most: (f64, f64), hour| (most.0.max(hour.0), most.1.max(hour.1)));
    for (per_event_ms, resident_mb) in by_hour.iter().skip(6) {
        assert!(*per_event_ms < 2.0 * most.0 && *resident_mb < 1.5 * most.1, "{by_hour:?}");
    }
    eprintln!("CPU {:.0} s, peak {:.0} MB of one process", cpu_s(id), memory_mb(id, "VmHWM"));
    let report = fleet.ask(0, &json!({ "type": "status" }));
    eprintln!("{report}");
}
