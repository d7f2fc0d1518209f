use std::path::Path;

use super::host::{HELLO, Host};
use super::mission::{Mission, configure, folder};
use crate::common::{file, pingmap, stderr, stdout};

/// Asserts that the process does not start, with exit status 2 and a message that has these texts.
fn refused(folder: &Path, texts: &[&str]) {
    for arguments in [&["vehicle"][..], &["vehicle", "--check"]] {
        let output = pingmap(folder, arguments);
        let message = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {message}");
        for text in texts {
            assert!(message.contains(text), "{arguments:?}: no {text:?} in {message}");
        }
    }
}

#[test]
fn a_wrong_configuration_is_refused_with_its_key() {
    let folder = folder();
    let folder = folder.path();
    for (more, text) in [
        ("stoer = 1", "stoer"),
        ("[host]\nqueue = 0", "host.queue must be a whole number from 1"),
        ("[host]\nlisten = \"serial\"", "host.listen must be stdio, unix:PATH, or tcp:ADDRESS:PORT"),
        ("[store]\nsnapshot_interval_s = nan", "store.snapshot_interval_s"),
        ("[log]\nlevel = \"loud\"", "log.level must be error, warn"),
        ("muted = [\"auv9\"]", "muted names \"auv9\""),
        ("[store]\npath = \"nowhere/auv1.redb\"", "there is no folder"),
        ("[store]\npath = \"model.toml\"", "is not a store"),
        ("[store]\npath = \".\"\nsnapshot = \"s\"", "is a folder"),
        ("[store]\nsnapshot = \"nowhere/auv1.snapshot\"", "there is no folder"),
        ("[store]\nsnapshot = \"auv1.redb\"", "would replace the store"),
        ("[store]\npath = \"auv1.new\"\nsnapshot = \"./auv1\"", "would replace the store"),
    ] {
        configure(folder, more);
        refused(folder, &[text]);
    }
    file(folder, "vehicle.toml", "schema = 2\nvehicle = \"auv1\"\nteam = \"team.toml\"\n");
    refused(folder, &["vehicle.toml", "reads schema 1"]);
    file(folder, "vehicle.toml", "schema = 1\nvehicle = \"auv9\"\nteam = \"team.toml\"\n");
    refused(folder, &["\"auv9\" is not a member of the team (auv1, auv2, auv3)", "Correct the key vehicle"]);
    file(folder, "vehicle.toml", "schema = 1\nvehicle = \"auv1\"\nteam = \"nowhere.toml\"\n");
    refused(folder, &["nowhere.toml"]);
    std::fs::remove_file(folder.join("vehicle.toml")).unwrap();
    refused(folder, &["vehicle.toml"]);
}

#[cfg(unix)]
#[test]
fn a_key_that_others_can_read_is_refused() {
    use std::os::unix::fs::PermissionsExt;
    let folder = folder();
    let folder = folder.path();
    let key = file(folder, "key.hex", "0123456789abcdef".repeat(4));
    let team = std::fs::read_to_string(folder.join("team.toml")).unwrap();
    file(folder, "team.toml", team.replacen("epoch", "key_file = \"key.hex\"\nepoch", 1));
    std::fs::set_permissions(&key, std::fs::Permissions::from_mode(0o640)).unwrap();
    refused(folder, &["key.hex", "others on this machine can read the key", "chmod 600"]);
    std::fs::set_permissions(&key, std::fs::Permissions::from_mode(0o600)).unwrap();
    let checked = pingmap(folder, &["vehicle", "--check"]);
    assert!(stdout(&checked).contains("with a key"), "{}", stderr(&checked));
    assert!(pingmap(folder, &["vehicle"]).status.success());
}

#[test]
fn a_store_that_is_not_for_this_vehicle_is_refused() {
    let folder = folder();
    let folder = folder.path();
    let mut host = Host::start(folder, &["vehicle"]);
    assert_eq!(host.ask(HELLO)["type"], "hello");
    refused(folder, &["auv1.redb is in use", "Stop the other process"]);
    let mut mission = Mission::new(5);
    (0..40).flat_map(|_| mission.next()).for_each(|line| drop(host.ask(&line)));
    // Entries after the base are adopted, too.
    host.kill();
    let events = |team: &str| stdout(&pingmap(folder, &["store", "export", "auv1.redb", "--team", team]));
    let exported = events("team.toml");
    assert!(exported.lines().count() > 8, "{exported}");

    file(folder, "vehicle.toml", "schema = 1\nvehicle = \"auv2\"\nteam = \"team.toml\"\nstore.path = \"auv1.redb\"\n");
    refused(folder, &["belongs to the vehicle \"auv1\"", "Choose the store of this vehicle"]);

    configure(folder, "");
    let team = std::fs::read_to_string(folder.join("team.toml")).unwrap();
    std::fs::copy(folder.join("team.toml"), folder.join("old.toml")).unwrap();
    file(folder, "team.toml", team.replace("epoch = 0", "epoch = 1"));
    refused(folder, &["was recorded with the team configuration", "--adopt-store"]);
    let output = pingmap(folder, &["store", "export", "auv1.redb"]);
    assert!(output.status.code() == Some(2) && stderr(&output).contains("digest"), "{}", stderr(&output));
    let adopted = pingmap(folder, &["vehicle", "--adopt-store"]);
    assert!(adopted.status.success() && stderr(&adopted).contains("the store was adopted"), "{}", stderr(&adopted));
    assert_eq!(events("team.toml"), exported);
    assert_eq!(events("old.toml"), "");
    // It belongs to this team from now on.
    assert!(pingmap(folder, &["vehicle"]).status.success());
}
