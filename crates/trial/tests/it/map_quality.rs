//! A regression gate on the quality of the team's map: mean NLL under a fixed model, for several numbers of frames of
//! 32 bytes.

use std::path::Path;

use pingmap_agent::{Learning, ModelFile};
use pingmap_trial::{EventLog, Mission, Plan, Preshared, Score, read_splits};

const FRAMES: [usize; 4] = [1, 2, 5, 10];

/// Largest change of the recorded values.
const TOLERANCE: f64 = 0.001;

/// The mean NLL of the team over the first two shipped splits, under the model learned from bay2.
fn team_nlls(trial: &str) -> [f64; 4] {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("data");
    let log = EventLog::open(&data.join(format!("{trial}.csv"))).unwrap();
    let splits = read_splits(&data.join(format!("{trial}.splits.csv")), &log).unwrap();
    let mut plan = Plan::new(Learning::default(), 1);
    plan.preshared = Preshared::Model(ModelFile::parse(include_str!("../golden/bay2.model.toml")).unwrap().model);
    let mut nlls = [0.0; 4];
    for split in &splits[..2] {
        let mission = Mission::prepare(&log, split, &plan, FRAMES[3]).unwrap();
        for (nll, frames) in nlls.iter_mut().zip(FRAMES) {
            let team = mission.predict_as_team(frames).unwrap();
            let scores: Vec<Score> = team.iter().filter_map(|p| Score::new(p, &mission.outcomes)).collect();
            *nll += Score::mean(&scores).unwrap().nll / 2.0;
        }
    }
    nlls
}

fn assert_recorded(trial: &str, recorded: [f64; 4]) {
    let found = team_nlls(trial);
    let is_near = found.iter().zip(&recorded).all(|(found, recorded)| (found - recorded).abs() <= TOLERANCE);
    assert!(is_near, "{trial} after {FRAMES:?} frames: {found:.4?}, recorded {recorded:.4?}");
}

#[test]
fn team_on_bay3_keeps_its_recorded_score() {
    assert_recorded("bay3", [0.3067, 0.2896, 0.2807, 0.2807]);
}

#[test]
fn team_on_lake2_keeps_its_recorded_score() {
    assert_recorded("lake2", [0.3472, 0.3445, 0.3449, 0.3393]);
}
