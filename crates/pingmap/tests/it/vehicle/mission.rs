//! A team of three vehicles, and the inputs of a simulated mission.

use std::path::Path;
use std::sync::{Arc, OnceLock};

use pingmap_import::Reference;
use pingmap_vehicle::{Contents, Vehicle, VehicleConfig, read_store};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use serde_json::{Value, json};
use tempfile::TempDir;

use crate::common::{QUICK, file, learn, log, pingmap, stderr};

/// Start of the first slot, and its length, in seconds.
const START_S: f64 = 1000.0;
pub const SLOT_S: f64 = 10.0;

pub const VEHICLES: [&str; 3] = ["auv1", "auv2", "auv3"];

/// Returns a folder with `model.toml`, `team.toml` and `vehicle.toml` of `auv1`.
pub fn folder() -> TempDir {
    static TEMPLATE: OnceLock<TempDir> = OnceLock::new();
    let template = TEMPLATE.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path();
        file(path, "events.csv", log(&VEHICLES, 60));
        learn(path, QUICK, "model.toml");
        let output = pingmap(path, &["team", "events.csv", "--frame-bytes", "64"]);
        assert!(output.status.success(), "{}", stderr(&output));
        let team = std::fs::read_to_string(path.join("team.toml")).unwrap();
        let (before, _) = team.split_once("[slots]").unwrap();
        let (_, limits) = team.split_once("[limits]").unwrap();
        let slots = format!("[slots]\nstart_s = {START_S:.1}\nduration_s = {SLOT_S:.1}\norder = {VEHICLES:?}\n\n");
        // Few outcomes fit into reports, so that summaries with counters are sent, too.
        let limits = limits.replace("report_window_slots = 16384", "report_window_slots = 4");
        let before = before.replace("transmissions_max = 8", "transmissions_max = 1");
        file(path, "team.toml", format!("{before}{slots}[limits]{limits}"));
        folder
    });
    let folder = tempfile::tempdir().unwrap();
    for name in ["model.toml", "team.toml"] {
        std::fs::copy(template.path().join(name), folder.path().join(name)).unwrap();
    }
    configure(folder.path(), "");
    folder
}

/// Writes `vehicle.toml` of `auv1` with more keys.
pub fn configure(folder: &Path, more: &str) {
    file(folder, "vehicle.toml", format!("schema = 1\nvehicle = \"auv1\"\nteam = \"team.toml\"\n{more}\n"));
}

/// Returns the vehicle that these contents of a store give, in this process.
pub fn restored(folder: &Path, contents: &Contents) -> Vehicle {
    let text = std::fs::read_to_string(folder.join("vehicle.toml")).unwrap();
    let config = VehicleConfig::parse(&text).unwrap();
    let team = pingmap::read_team(&folder.join("team.toml")).unwrap();
    let reference = Reference::new(team.model.chart.reference).unwrap();
    Vehicle::restore(config, Arc::new(team), reference, contents).unwrap()
}

/// Returns the content of the store of `auv1`.
pub fn contents(folder: &Path) -> Contents {
    read_store(&folder.join("auv1.redb")).unwrap().1
}

/// Random inputs of `auv1`, second by second.
pub struct Mission {
    random: ChaCha8Rng,
    pub time_s: f64,
    pub slot_s: f64,
}

impl Mission {
    pub fn new(seed: u64) -> Self {
        Self { random: ChaCha8Rng::seed_from_u64(seed), time_s: START_S, slot_s: SLOT_S }
    }

    /// A number from 0 to 1.
    pub fn uniform(&mut self) -> f64 {
        f64::from(self.random.next_u32()) / 4_294_967_296.0
    }

    fn place(&self, vehicle: usize) -> Value {
        let angle = self.time_s / (300.0 + 70.0 * vehicle as f64) + vehicle as f64;
        json!({ "x": 500.0 + 400.0 * angle.cos(), "y": 300.0 + 300.0 * (1.3 * angle).sin() })
    }

    /// Returns the inputs of the next half slot.
    pub fn next(&mut self) -> Vec<String> {
        self.time_s += 0.5 * self.slot_s;
        let slot = ((self.time_s - START_S) / self.slot_s).floor();
        let begin_s = START_S + slot * self.slot_s;
        let sender = slot as usize % VEHICLES.len();
        let time = self.time_s;
        let mut inputs = vec![json!({ "type": "nav", "time": time, "position": self.place(0) })];
        for member in [1, 2] {
            let position = self.place(member);
            let source = "other";
            inputs.push(json!({ "type": "peer", "time": time, "member": VEHICLES[member], "position": position, "source": source }));
        }
        let is_second_half = time - begin_s >= 0.5 * self.slot_s - 1e-6;
        if sender == 0 && !is_second_half && slot % 12.0 == 0.0 {
            inputs.extend(vec![json!({ "type": "frame_request", "time": time, "bytes": 64 }); 4]);
            inputs.push(json!({ "type": "sent", "time": begin_s }));
        } else if sender == 0 && !is_second_half {
            inputs.push(json!({ "type": "sent", "time": begin_s }));
        } else if is_second_half && sender != 0 && self.uniform() < 0.6 {
            inputs.push(json!({ "type": "heard", "time": begin_s + 0.5, "from": VEHICLES[sender] }));
        }
        if self.uniform() < 0.05 {
            let to = json!({ "x": 400.0, "y": 300.0 });
            inputs.push(json!({ "type": "predict", "links": [{ "from": "auv1", "to": to }] }));
        }
        inputs.iter().map(Value::to_string).collect()
    }
}
