//! Team files: they hold the configuration of a team, and refuse what makes no team.

use crate::common::*;
use dgpc::{Correlation, Kernel, Prior, PriorMean, Shape, Term};
use pingmap_agent::*;

const SMALL: &str = "schema = 4\nmodel_file = \"model.toml\"\n[members]\nada = 4\nbob = 1\n[grid]\ncell_m = 25.0\n";

fn read(text: &str) -> Result<Team, TeamError> {
    TeamFile::parse(text)?.team(model(), None)
}

/// The small file with one line replaced.
fn with(line: &str, other: &str) -> String {
    assert!(SMALL.contains(line), "{line}");
    SMALL.replace(line, other)
}

#[test]
fn keys_that_a_team_file_leaves_out_have_defaults() {
    let team = read(SMALL).unwrap();
    let [ada, bob] = ["ada", "bob"].map(VehicleId::new);
    assert_eq!(
        team.members.iter().map(|(&n, id)| (n, id.clone())).collect::<Vec<_>>(),
        [(1, bob.clone()), (4, ada.clone())]
    );
    assert_eq!((team.number(&ada), team.number(&VehicleId::new("eve"))), (Some(4), None));
    assert_eq!((team.frame_bytes, team.epoch, team.packets_per_sender_max), (32, 0, 64));
    assert_eq!(team.grid, Grid { cell_m: 25.0, depth_cell_m: 1.0, start_s: 0.0, time_cell_s: 600.0 });
    assert_eq!(team.limits, Limits::default());
    assert_eq!((team.slots.duration_s, &team.slots.order), (10.0, &vec![bob, ada]));
    let same = Team::new(names(2), model(), []).unwrap();
    assert_eq!((team.min_gain_nats, team.exclusion_threshold_sd), (same.min_gain_nats, same.exclusion_threshold_sd));
    assert_eq!((team.transmissions_max, team.extrapolation_s_max), (same.transmissions_max, same.extrapolation_s_max));
    assert_eq!(
        (team.packets_per_sender_max, team.reports_per_sender_max),
        (same.packets_per_sender_max, same.reports_per_sender_max)
    );
    assert_eq!((team.piggyback, team.has_piggyback(), team.track_tolerance_m), (None, true, 12.5));
}

#[test]
fn a_written_team_file_is_read_back_to_the_same_team() {
    let mut written = team(3, model());
    let members = [(7, "a b"), (0, "\"quoted\""), (255, "wal.do")];
    written.members = Members::new(members.map(|(n, name)| (n, VehicleId::new(name))).into());
    written.grid = Grid { cell_m: 17.3, depth_cell_m: 2.1, start_s: 1.76e9, time_cell_s: 170.5 };
    (written.reports_per_sender_max, written.transmissions_max) = (77, 2);
    (written.track_tolerance_m, written.extrapolation_s_max) = (31.5, 45.0);
    let order = ["wal.do", "", "a b", "wal.do"].map(VehicleId::new);
    written.slots = Slots { start_s: 3.25, ..Slots::cycle(7.5, order.into()) };
    written.piggyback = Some(true);
    (written.frame_bytes, written.epoch, written.packets_per_sender_max) = (64, 9, 5);
    (written.min_gain_nats, written.exclusion_threshold_sd) = (1.25e-5, 5.5);
    written.limits = Limits {
        events_max: 1,
        dense_events_max: 2,
        inducing_points_max: 3,
        candidates_max: 4,
        pending_events_max: 5,
        report_window_slots: 6,
    };
    written.key = Some(key(3));
    let text = TeamFile::write(&written, "m.toml", Some("key.hex"), Some("c0ffee")).unwrap();
    let file = TeamFile::parse(&text).unwrap();
    assert_eq!((file.model_file.as_str(), file.key_file.as_deref()), ("m.toml", Some("key.hex")));
    assert_eq!(file.log_digest.as_deref(), Some("c0ffee"));
    let found = file.team(model(), Some(key(3))).unwrap();
    assert_eq!((&found.members, found.grid, &found.slots), (&written.members, written.grid, &written.slots));
    assert_eq!((found.frame_bytes, found.epoch, found.packets_per_sender_max), (64, 9, 5));
    let reports =
        (found.reports_per_sender_max, found.transmissions_max, found.track_tolerance_m, found.extrapolation_s_max);
    assert_eq!(reports, (77, 2, 31.5, 45.0));
    assert_eq!((found.piggyback, found.exclusion_threshold_sd), (Some(true), 5.5));
    assert_eq!((found.min_gain_nats, found.limits, found.digest()), (1.25e-5, written.limits, written.digest()));
    assert_eq!(TeamFile::write(&found, "m.toml", Some("key.hex"), Some("c0ffee")).unwrap(), text);
}

/// A line of the small file, its replacement, and a part of the error.
const REFUSED: &[(&str, &str, &str)] = &[
    ("schema = 4", "schema = 5", "schema 5, but this version reads schema 4"),
    (
        "schema = 4",
        "schema = 4\nreports_per_sender_max = 0",
        "reports_per_sender_max must be a whole number from 1 to 1024",
    ),
    (
        "schema = 4",
        "schema = 4\ntrack_tolerance_m = 0.0",
        "track_tolerance_m must be a number of metres from 1e-6 to 1e9",
    ),
    ("schema = 4", "schema = 4\nextrapolation_s_max = -1.0", "extrapolation_s_max must be a number of seconds from 0"),
    ("schema = 4", "schema = 4\nexclusion_threshold_sd = 0.5", "exclusion_threshold_sd must be a number from 1"),
    ("schema = 4", "schema = 4\ncolour = \"red\"", "colour"),
    ("cell_m = 25.0", "cell_m = 25.0\nwidth = 3", "width"),
    ("schema = 4\n", "", "schema"),
    ("model_file = \"model.toml\"\n", "", "model_file"),
    ("bob = 1", "bob = 4", "ada and bob both have number 4"),
    ("bob = 1", "bob = 256", "256"),
    ("bob = 1", "ada = 1", "duplicate"),
    ("ada = 4\nbob = 1\n", "", "1 to 256 members, found 0"),
    ("schema = 4", "schema = 4\nframe_bytes = 16", "frame_bytes must be at least 32, found 16"),
    (
        "schema = 4",
        "schema = 4\npackets_per_sender_max = 0",
        "packets_per_sender_max must be a whole number from 1 to 1024, found 0",
    ),
    (
        "schema = 4",
        "schema = 4\nmin_gain_nats = -1.0",
        "min_gain_nats must be a number above 0, at most 1000, found -1",
    ),
    ("cell_m = 25.0", "cell_m = 0.0", "grid.cell_m must be a number of metres from 1e-6 to 1e9, found 0"),
    ("cell_m = 25.0", "cell_m = nan", "grid.cell_m"),
    ("cell_m = 25.0", "cell_m = 1.0\ndepth_cell_m = -2.0", "grid.depth_cell_m"),
    ("[grid]", "[slots]\norder = [\"ada\", \"eve\"]\n[grid]", "slots: eve is not a member"),
    (
        "[grid]",
        "[limits]\npending_events_max = 0\n[grid]",
        "limits.pending_events_max must be a whole number from 1 to 1000",
    ),
    (
        "[grid]",
        "[limits]\nreport_window_slots = 262145\n[grid]",
        "limits.report_window_slots must be a whole number from 1 to 262144",
    ),
    ("[grid]", "[slots]\nduration_s = 0.0\n[grid]", "slots.duration_s"),
    ("schema = 4", "schema = 4\nframe_bytes = 65537", "frame_bytes must be a whole number from 32 to 65536"),
    (
        "[grid]",
        "[limits]\ninducing_points_max = 9223372036854775807\n[grid]",
        "limits.inducing_points_max must be a whole number from 1 to 4000",
    ),
    ("[grid]", "[limits]\ndense_events_max = 1000000\n[grid]", "limits.dense_events_max must be a whole number"),
    ("[grid]", "[limits]\ncandidates_max = 1000000\n[grid]", "limits.candidates_max must be a whole number"),
    ("cell_m = 25.0", "cell_m = 1e300", "grid.cell_m"),
    ("[grid]", "[slots]\nstart_s = inf\n[grid]", "slots.start_s must be a finite number of seconds"),
    (
        "[grid]",
        "[limits]\nevents_max = 0\n[grid]",
        "limits.events_max must be a whole number from 1 to 10000000, found 0",
    ),
];

#[test]
fn a_file_that_makes_no_team_is_refused_with_the_name_of_the_key() {
    for (line, other, expected) in REFUSED {
        let error = read(&with(line, other)).unwrap_err().to_string();
        assert!(error.contains(expected), "{other}: {error}");
    }
}

#[test]
fn keys_of_removed_features_are_refused() {
    for key in ["tellings_max", "track_off_max_m", "onward_s_max", "worth_nats", "surprise_max", "repeats_max"] {
        let error = read(&with("schema = 4", &format!("schema = 4\n{key} = 1"))).unwrap_err().to_string();
        assert!(error.contains(key), "{error}");
    }
    for (line, key) in
        [("at_will = true", "at_will"), ("may_be_silent = [\"ada\"]", "may_be_silent"), ("changes = []", "changes")]
    {
        let error = read(&with("[grid]", &format!("[slots]\n{line}\n[grid]"))).unwrap_err().to_string();
        assert!(error.contains(key), "{error}");
    }
}

#[test]
fn a_newer_team_file_is_refused_with_its_version() {
    let text = with("schema = 4", "schema = 5\nfuture = true");
    assert_eq!(read(&text).unwrap_err(), TeamError::Newer(5));
    assert!(read(&text).unwrap_err().to_string().contains("schema 5"));
}

#[test]
fn an_older_team_file_is_refused_with_its_version() {
    for text in [with("schema = 4", "schema = 3"), with("schema = 4", "schema = 3\ntellings_max = 8")] {
        let error = read(&text).unwrap_err().to_string();
        assert!(error.contains("schema 3") && error.contains('4'), "{error}");
    }
}

#[test]
fn a_team_has_one_to_256_members_with_different_names() {
    assert_eq!(Team::new([], model(), []).unwrap_err(), TeamError::Members(0));
    assert_eq!(Team::new(names(257), model(), []).unwrap_err(), TeamError::Members(257));
    assert_eq!(Team::new(names(256), model(), []).unwrap().members.len(), 256);
    let twins = [name(0), name(1), name(0)];
    assert_eq!(Team::new(twins, model(), []).unwrap_err(), TeamError::SameName(name(0)));
}

/// A schedule of one transmission with this number of listeners.
fn explicit(listeners: usize) -> std::sync::Arc<[ScheduledTransmission]> {
    [ScheduledTransmission { time_s: 4.0, sender: name(0), listeners: names(listeners) }].into()
}

#[test]
fn the_digest_includes_everything_that_gives_packets_their_meaning_and_nothing_else() {
    let team = team(3, model());
    let cell_m = team.grid.cell_m;
    let members = [name(0), VehicleId::new("another name"), name(2)];
    let members = Members::new(members.into_iter().enumerate().map(|(n, id)| (n as u8, id)).collect());
    let other = [
        Team { model: isotropic(Shape::Matern52, true, 300.0001, 4.0), ..team.clone() },
        Team { grid: Grid { cell_m: cell_m * 1.01, ..team.grid }, ..team.clone() },
        Team { grid: Grid { depth_cell_m: 3.0, ..team.grid }, ..team.clone() },
        Team { grid: Grid { start_s: 1.0, ..team.grid }, ..team.clone() },
        Team { grid: Grid { time_cell_s: 60.0, ..team.grid }, ..team.clone() },
        Team { epoch: 1, ..team.clone() },
        Team { packets_per_sender_max: 3, ..team.clone() },
        Team { frame_bytes: 64, ..team.clone() },
        Team { slots: Slots { start_s: 0.5, ..team.slots.clone() }, ..team.clone() },
        Team { slots: Slots { duration_s: 9.0, ..team.slots.clone() }, ..team.clone() },
        Team { slots: Slots { order: names(2), ..team.slots.clone() }, ..team.clone() },
        Team { slots: Slots { explicit: Some(explicit(3)), ..team.slots.clone() }, ..team.clone() },
        Team { slots: Slots { explicit: Some(explicit(2)), ..team.slots.clone() }, ..team.clone() },
        Team { reports_per_sender_max: 255, ..team.clone() },
        Team { key: Some(key(1)), ..team.clone() },
        Team { key: Some(key(2)), ..team.clone() },
        Team { members, ..team.clone() },
    ];
    let mut digests: Vec<_> = other.iter().chain([&team]).map(Team::digest).collect();
    digests.sort_unstable();
    digests.dedup();
    assert_eq!(digests.len(), other.len() + 1);
    let mut same = Team {
        min_gain_nats: 1.0,
        exclusion_threshold_sd: 9.0,
        transmissions_max: 1,
        track_tolerance_m: 99.0,
        extrapolation_s_max: 1.0,
        limits: Limits { events_max: 5, ..team.limits },
        ..team.clone()
    };
    same.model.chart.scale_m = 7.0;
    assert_eq!(same.digest(), team.digest());
    // Minus zero is zero.
    same.model.chart.origin.east_m = -0.0;
    assert_eq!(same.digest(), team.digest());
    // Ties of length-scales matter for learning alone.
    let tied = |ties: &[usize]| {
        let path = Correlation::new(Shape::Matern32, &[4, 5], &[200.0, 200.0]).unwrap().tied(ties).unwrap();
        let kernel = Kernel::new(vec![Term::of(4.0, path).unwrap()]).unwrap();
        let prior = Prior::new(kernel, PriorMean::Zero).unwrap();
        Team { model: Model::new(team.model.chart, team.model.inputs, prior), ..team.clone() }.digest()
    };
    assert_eq!(tied(&[0, 0]), tied(&[0, 1]));
}

#[test]
fn a_team_that_no_file_can_hold_is_not_written() {
    let good = team(2, model());
    let write = |team: &Team, key_file| TeamFile::write(team, "m.toml", key_file, None);
    let cell = |cell_m: f64| Team { grid: Grid { cell_m, ..good.grid }, ..good.clone() };
    let slots = |order: Vec<VehicleId>| Team { slots: Slots { order, ..good.slots.clone() }, ..good.clone() };
    let twins = Members::new([(0, "ada"), (1, "ada")].map(|(number, name)| (number, VehicleId::new(name))).into());
    let explicit = Slots { explicit: Some(explicit(2)), ..good.slots.clone() };
    let bad = [
        (cell(f64::NAN), None),
        (cell(0.0), None),
        (Team { frame_bytes: 20, ..good.clone() }, None),
        (Team { packets_per_sender_max: 2000, ..good.clone() }, None),
        (Team { key: Some(key(1)), ..good.clone() }, None),
        (good.clone(), Some("key.hex")),
        (slots(vec![VehicleId::new("eve")]), None),
        (slots(Vec::new()), None),
        (Team { slots: explicit, ..good.clone() }, None),
        (Team { members: twins, ..good.clone() }, None),
        (Team { min_gain_nats: -1.0, ..good.clone() }, None),
    ];
    for (number, (team, key_file)) in bad.iter().enumerate() {
        let error = write(team, *key_file).unwrap_err();
        assert!(matches!(error, TeamError::Unwritable(_)), "{number}: {error}");
    }
    assert!(write(&good, None).is_ok());
}
