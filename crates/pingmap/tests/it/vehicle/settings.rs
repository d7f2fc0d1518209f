use pingmap_agent::VehicleId;
use pingmap_vehicle::{VEHICLE_EXAMPLE, VehicleConfig};
use toml::{Table, Value};

use super::mission::{configure, folder};
use crate::common::{json, pingmap, stderr, stdout};

/// The names of all keys, with the tables above them.
fn keys(table: &Table, above: &str) -> Vec<String> {
    let names = |(name, value): (&String, &Value)| match value {
        Value::Table(table) => keys(table, &format!("{above}{name}.")),
        _ => vec![format!("{above}{name}")],
    };
    table.iter().flat_map(names).collect()
}

#[test]
fn the_example_has_every_key_and_its_default() {
    let folder = folder();
    let printed = stdout(&pingmap(folder.path(), &["vehicle", "--example"]));
    assert_eq!(printed.trim(), VEHICLE_EXAMPLE.trim());
    let defaults = VehicleConfig::new(VehicleId::new("auv1"), "team.toml".into());
    assert_eq!(VehicleConfig::parse(&printed).unwrap(), defaults);
    // With the keys that have no fixed default, it has the keys of a configuration in which all have a value.
    let is_key = |line: &&str| line.split_once(" = ").is_some_and(|(key, _)| !key[2..].contains(' '));
    let with_all = |line: &str| match line.strip_prefix("# ").filter(|_| is_key(&line)) {
        Some(key) => format!("{key}\n"),
        None => format!("{line}\n"),
    };
    let with_all: String = printed.lines().map(with_all).collect();
    let config = VehicleConfig::parse(&with_all).unwrap();
    let all = Table::try_from(&config).unwrap();
    assert_eq!(keys(&with_all.parse().unwrap(), ""), keys(&all, ""));
    assert_eq!(keys(&all, "").len(), 23, "{:?}", keys(&all, ""));
    assert!(config.store.path.is_some() && config.store.snapshot.is_some() && config.clock.sigma_max_s.is_some());
}

#[test]
fn a_check_reads_everything_and_writes_nothing() {
    let folder = folder();
    let folder = folder.path();
    let files = || std::fs::read_dir(folder).unwrap().count();
    let before = files();
    let check = || stdout(&pingmap(folder, &["vehicle", "--check"]));
    assert!(check().contains("auv1.redb: new"), "{}", check());
    assert_eq!(files(), before);
    assert!(pingmap(folder, &["vehicle"]).status.success());
    let text = check();
    assert!(text.contains("0 entries") && text.contains("snapshot  auv1.snapshot: present"), "{text}");
    let store = json(folder, &["store", "check", "auv1.redb", "--json"]);
    assert_eq!((&store["vehicle"], &store["records"]), (&"auv1".into(), &0.into()), "{store}");
    assert!(text.contains(store["team_digest"].as_str().unwrap()), "{text}");
    std::fs::write(folder.join("auv1.redb"), "x".repeat(9000)).unwrap();
    let refused = pingmap(folder, &["vehicle", "--check"]);
    assert_eq!(refused.status.code(), Some(2), "{}", stderr(&refused));
    configure(folder, "[log]\nformat = \"json\"\n[store]\npath = \"other.redb\"\nsnapshot = \"other.snapshot\"");
    let log = stderr(&pingmap(folder, &["vehicle"]));
    let line: serde_json::Value = serde_json::from_str(log.lines().next().unwrap()).unwrap();
    assert_eq!(line["message"], "ready", "{log}");
}
