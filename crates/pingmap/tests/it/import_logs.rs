//! `pingmap import` of MOOS logs, modem captures, ROS bags, archives and folders of tables.

use std::fs::File;
use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};

use crate::common::mission::*;
use crate::common::*;

#[test]
fn all_log_formats_give_the_same_mission() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    simulate(folder, "--clock-off-s 3 --files alog");
    let (moos, warnings) = import(folder, "mission --ids mission/ids.csv --correct-clocks auv1");
    // Modems record their transmissions and their activity, so no event is unknown. Only the clocks need an option.
    assert_eq!((compare(folder), moos["events"].as_u64()), (0, Some(800)));
    assert_eq!(moos["transmissions"]["recorded"], 400);
    assert!(moos["excluded"].as_object().unwrap().is_empty() && warnings.is_empty(), "{warnings}");
    assert!((moos["origin"][0].as_f64().unwrap() - 41.52).abs() < 1e-6, "{}", moos["origin"]);
    // A log of the shore station without records of reception has no effect.
    file(
        folder,
        "mission/shore.alog",
        "%% LOG FILE: shore\n%% LOGSTART 1777809600\n1 NODE_REPORT uF NAME=auv1,X=1,Y=2\n",
    );
    assert_eq!(import(folder, "mission --ids mission/ids.csv --correct-clocks auv1").0, moos);
    // Without the option the only warning is about the clocks.
    let (_, warnings) = import(folder, "mission --ids mission/ids.csv");
    assert!(warnings.contains("--correct-clocks") && warnings.lines().count() == 1, "{warnings}");
    std::fs::remove_file(folder.join("mission/shore.alog")).unwrap();
    // Without the table of ids the address of broadcasts is unknown.
    std::fs::rename(folder.join("mission/ids.csv"), folder.join("ids.csv")).unwrap();
    let arguments = ["import", "mission", "--correct-clocks", "auv1", "--overwrite"];
    let output = pingmap(folder, &arguments);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("to 63") && stderr(&output).contains("--ids"), "{}", stderr(&output));

    // Captures of the modem's serial line, with separate navigation: as files, or as one folder for each vehicle.
    simulate(folder, "--clock-off-s 3 --files capture");
    let nav = files(&["nav"]);
    let captures = [1, 2, 3].map(|id| format!("auv{id}=mission/auv{id}.nmea")).join(" ");
    let (captures_import, _) = import(folder, &format!("{captures} {nav} --correct-clocks auv1"));
    assert_eq!((compare(folder), &captures_import["pairs"]), (0, &moos["pairs"]));
    // Captures contain the id of the modem, and the table of ids contains the name.
    let captures = [1, 2, 3].map(|id| format!("mission/auv{id}.nmea")).join(" ");
    assert_eq!(import(folder, &format!("{captures} {nav} --correct-clocks auv1")).0, captures_import);
    for id in 1..=3 {
        std::fs::create_dir(folder.join(format!("auv{id}"))).unwrap();
        std::fs::copy(folder.join(format!("mission/auv{id}.nmea")), folder.join(format!("auv{id}/modem.txt"))).unwrap();
    }
    let (folders_import, _) = import(folder, &format!("auv1=auv1 auv2=auv2 auv3=auv3 {nav} --correct-clocks auv1"));
    assert_eq!(folders_import, captures_import);
    // Bags of ROS 2: only the topics name the vehicle.
    simulate(folder, "--clock-off-s 3 --files mcap");
    let bags = [1, 2, 3].map(|id| format!("auv{id}=mission/auv{id}.mcap")).join(" ");
    let options = "--ids mission/ids.csv --origin 41.52,-70.67 --correct-clocks auv1";
    let (bags_import, _) = import(folder, &format!("{bags} {options}"));
    assert_eq!((compare(folder), &bags_import["pairs"]), (0, &moos["pairs"]));
    let topics = [1, 2, 3].map(|id| format!("auv{id}=mission/auv{id}.mcap#/auv{id}/")).join(" ");
    assert_eq!(import(folder, &format!("{topics} {options}")).0, bags_import);
    archives_are_folders(folder, "--ids mission/ids.csv --correct-clocks auv1", &moos);
    // A mission may consist of a MOOS log and tables.
    simulate(folder, "--clock-off-s 3 --files alog");
    std::fs::rename(folder.join("mission/auv1.alog"), folder.join("one.alog")).unwrap();
    simulate(folder, "--clock-off-s 3 --with-sent");
    let of = |kind: &str| format!("--{kind} auv2=mission/auv2.{kind}.csv auv3=mission/auv3.{kind}.csv");
    let options = format!("one.alog {} {} {} --ids mission/ids.csv", of("nav"), of("heard"), of("sent"));
    let (mixed, _) = import(folder, &format!("{options} --correct-clocks auv1"));
    assert_eq!(compare(folder), count(&mixed, "not_recording"));
}

/// Imports the same logs from archives of each kind.
fn archives_are_folders(folder: &Path, options: &str, expected: &serde_json::Value) {
    simulate(folder, "--clock-off-s 3 --files alog");
    let logs = [1, 2, 3].map(|id| format!("auv{id}.alog"));
    let text = |name: &String| std::fs::read(folder.join("mission").join(name)).unwrap();
    let mut zip = zip::ZipWriter::new(File::create(folder.join("all.zip")).unwrap());
    let tar = flate2::write::GzEncoder::new(File::create(folder.join("all.tgz")).unwrap(), flate2::Compression::fast());
    let (mut tar, mut plain) =
        (tar::Builder::new(tar), tar::Builder::new(File::create(folder.join("all.tar")).unwrap()));
    for name in &logs {
        zip.start_file(format!("logs/{name}"), zip::write::SimpleFileOptions::default()).unwrap();
        zip.write_all(&text(name)).unwrap();
        tar.append_path_with_name(folder.join("mission").join(name), format!("logs/{name}")).unwrap();
        plain.append_path_with_name(folder.join("mission").join(name), name).unwrap();
        let mut one = flate2::write::GzEncoder::new(
            File::create(folder.join(format!("{name}.gz"))).unwrap(),
            flate2::Compression::fast(),
        );
        one.write_all(&text(name)).unwrap();
        one.finish().unwrap();
    }
    zip.finish().unwrap();
    tar.into_inner().unwrap().finish().unwrap();
    plain.into_inner().unwrap();
    for given in ["all.zip", "all.tgz", "all.tar", "auv1.alog.gz auv2.alog.gz auv3.alog.gz"] {
        let found = import(folder, &format!("{given} {options}")).0;
        assert_eq!((&found["log_digest"], &found["pairs"]), (&expected["log_digest"], &expected["pairs"]), "{given}");
    }
    let whole = std::fs::read(folder.join("all.tgz")).unwrap();
    file(folder, "cut.tgz", "");
    std::fs::write(folder.join("cut.tgz"), &whole[..whole.len() / 2]).unwrap();
    let output = pingmap(folder, &["import", "cut.tgz", "--overwrite"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("cut.tgz") && stderr(&output).contains("unpacked"), "{}", stderr(&output));
}

#[test]
fn a_stopped_modem_is_not_a_deaf_receiver() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    simulate(folder, "--clock-off-s 2 --files alog --stops auv3=0.6");
    let (found, warnings) = import(folder, "mission --ids mission/ids.csv --correct-clocks auv1");
    let missing = compare(folder);
    let unexpected = found["left_out"]["unexpected"]["auv3"].as_u64().unwrap();
    // One vehicle stops recording for the last 160 of 400 messages. Its own transmissions among them, a third, are not
    // in the log.
    assert!((90..=120).contains(&count(&found, "not_recording")), "{found}");
    let recorded = found["transmissions"]["recorded"].as_u64().unwrap() as usize;
    assert_eq!(missing - count(&found, "not_recording"), 2 * (400 - recorded), "{found}");
    assert!(unexpected > 20 && warnings.contains("check the end of its records"), "{warnings}");
}

#[test]
fn refusals_of_log_import_name_the_missing_information() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    simulate(folder, "--slots 60 --files alog");
    let refused = |options: &str, words: &[&str]| {
        let output = pingmap(folder, &["import"].into_iter().chain(options.split_whitespace()).collect::<Vec<_>>());
        assert_eq!(output.status.code(), Some(2), "{options}: {}", stderr(&output));
        for word in words {
            assert!(stderr(&output).contains(word), "{options}: expected {word} in {}", stderr(&output));
        }
    };
    file(folder, "letter.txt", "Dear all, the vehicles are safe.\n");
    refused("letter.txt", &["letter.txt", "unknown kind of file", "--heard"]);
    file(folder, "mission/more.csv", "id,name\n9,buoy\n");
    refused(
        "mission",
        &["mission/ids.csv", "mission/more.csv", "are files of one kind (vehicle of each modem id)", "--ids"],
    );
    std::fs::remove_file(folder.join("mission/more.csv")).unwrap();
    refused("nowhere", &["nowhere", "cannot be read"]);
    file(folder, "late.alog", "%% LOG FILE: a\n1.5 NAV_X p 1\n");
    refused("late.alog", &["late.alog", "line 2", "LOGSTART"]);
    let text = std::fs::read_to_string(folder.join("mission/auv1.alog")).unwrap();
    file(folder, "nobody.alog", text.replace("NODE_REPORT_LOCAL", "OTHER"));
    refused("nobody.alog", &["nobody.alog", "NAME=", "--ids"]);
    refused("mission one=nobody.alog", &["auv1 and one", "id is 1"]);
    // The logs and a mission file have different origins.
    file(folder, "other.moos", "LatOrigin = 41.53\nLongOrigin = -70.67\n");
    refused("mission other.moos --ids mission/ids.csv", &["other.moos", "41.53000,-70.67000", "--origin"]);
    let options = "mission other.moos --ids mission/ids.csv --origin 41.52,-70.67";
    import(folder, options);
    compare(folder);
    // For logs in metres the mission file contains the origin.
    for id in 1..=3 {
        let text = std::fs::read_to_string(folder.join(format!("mission/auv{id}.alog"))).unwrap();
        file(folder, &format!("auv{id}.alog"), text.replace("NAV_LAT", "NAV_SOG").replace("NAV_LONG", "NAV_COG"));
    }
    let (found, _) = import(folder, "auv1.alog auv2.alog auv3.alog other.moos --ids mission/ids.csv");
    assert_eq!(found["origin"][0], 41.53);
    compare(folder);
}

#[test]
fn a_folder_of_tables_is_recognised_and_the_roles_of_files_are_printed() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    simulate(folder, "--clock-off-s 3 --with-sent --slots 300");
    let options = "--origin 41.52,-70.67 --correct-clocks auv1";
    let (by_options, _) = import(folder, &(files(&["nav", "heard", "sent"]) + " --correct-clocks auv1"));
    // The folder contains files that do not belong to the mission.
    file(folder, "mission/places.csv", "name,latitude,longitude\nquay,41.5,-70.6\n");
    std::fs::copy(folder.join("events.csv"), folder.join("mission/events.csv")).unwrap();
    let whole = import(folder, &format!("mission {options}")).0;
    assert_eq!((&whole["log_digest"], &whole["pairs"]), (&by_options["log_digest"], &by_options["pairs"]));
    assert_eq!(whole["left_out"]["files"], 2);
    let arguments = format!("import mission {options} --overwrite");
    let warnings = stderr(&pingmap(folder, &arguments.split_whitespace().collect::<Vec<_>>()));
    for line in [
        "auv2.sent.csv: transmissions of auv2",
        "auv1.nav.csv: navigation of auv1",
        "ids.csv: vehicle of each modem id",
        "schedule.toml: schedule",
    ] {
        assert!(warnings.contains(line), "{line}: {warnings}");
    }
    // One folder for each vehicle, a modem id in place of a name, and an archive on standard input.
    for (id, name) in [(1, "auv1"), (2, "auv2"), (3, "3")] {
        std::fs::create_dir_all(folder.join("sorted").join(name)).unwrap();
        for kind in ["nav", "heard", "sent"] {
            let to = folder.join("sorted").join(name).join(format!("{kind}.csv"));
            std::fs::rename(folder.join(format!("mission/auv{id}.{kind}.csv")), to).unwrap();
        }
    }
    let sorted = import(folder, &format!("sorted --ids mission/ids.csv {options}")).0;
    assert_eq!((&sorted["log_digest"], &sorted["pairs"]), (&by_options["log_digest"], &by_options["pairs"]));
    let mut tar = tar::Builder::new(File::create(folder.join("sorted.tar")).unwrap());
    tar.append_dir_all(".", folder.join("sorted")).unwrap();
    tar.into_inner().unwrap();
    let child = |arguments: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_pingmap"));
        command
            .current_dir(folder)
            .args(arguments.split_whitespace())
            .stdin(File::open(folder.join("sorted.tar")).unwrap());
        command.stdout(Stdio::piped()).stderr(Stdio::piped()).output().unwrap()
    };
    let output = child(&format!("import - --ids mission/ids.csv {options} --json --overwrite"));
    let piped: serde_json::Value = serde_json::from_str(&stdout(&output)).unwrap();
    assert_eq!(piped["log_digest"], by_options["log_digest"], "{}", stderr(&output));
    assert!(stderr(&output).contains("standard input/3/nav.csv: navigation of auv3"), "{}", stderr(&output));
    // Standard input and standard output can be named once.
    for (arguments, words) in
        [("import - - --overwrite", "named twice"), ("import sorted -o - --json", "--json and -o -")]
    {
        let output = child(arguments);
        assert!(output.status.code() == Some(2) && stderr(&output).contains(words), "{}", stderr(&output));
    }
    // The vehicle and the kind of a single table must be given.
    std::fs::copy(folder.join("sorted/auv1/nav.csv"), folder.join("nav.csv")).unwrap();
    std::fs::copy(folder.join("sorted/auv1/heard.csv"), folder.join("auv1.csv")).unwrap();
    for (arguments, words) in
        [("import nav.csv --overwrite", "NAME="), ("import auv1.csv --overwrite", "unknown kind of file")]
    {
        let output = pingmap(folder, &arguments.split_whitespace().collect::<Vec<_>>());
        assert!(output.status.code() == Some(2) && stderr(&output).contains(words), "{}", stderr(&output));
    }
}

/// Imports a gigabyte with an address space of 220 MB.
#[cfg(target_os = "linux")]
#[test]
#[ignore = "writes a gigabyte to the temporary folder"]
fn a_gigabyte_of_logs_is_imported_in_bounded_memory() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    simulate(folder, "--vehicles 2 --slots 4000 --files alog");
    for id in 1..=2 {
        let path = folder.join(format!("mission/auv{id}.alog"));
        let text = std::fs::read_to_string(&path).unwrap();
        let mut all = std::io::BufWriter::new(File::create(&path).unwrap());
        // Each useful line is followed by a hundred lines of other variables.
        let times = (500 << 20) / 100 / text.lines().count() + 1;
        for line in text.lines() {
            writeln!(all, "{line}").unwrap();
            if let Some(time) = line.split_whitespace().next().filter(|time| time.parse::<f64>().is_ok()) {
                for n in 0..times {
                    let row = format!("{time} DESIRED_{n} pHelmIvP {}", "0123456789".repeat(7));
                    writeln!(all, "{row}").unwrap();
                }
            }
        }
    }
    let size: u64 =
        [1, 2].map(|id| folder.join(format!("mission/auv{id}.alog")).metadata().unwrap().len()).iter().sum();
    assert!(size > 900 << 20, "{size}");
    let command = "ulimit -v 220000; exec \"$0\" import mission -o events.csv";
    let output =
        Command::new("sh").current_dir(folder).args(["-c", command, env!("CARGO_BIN_EXE_pingmap")]).output().unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(read(folder, "events.csv").events.len() > 3000);
}

#[test]
fn other_files_in_a_mission_folder_are_ignored() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    simulate(folder, "--with-sent --slots 120");
    let without_other_files = import(folder, "mission").0;
    // The folder contains a broken archive, a backup file and a team file.
    std::fs::write(folder.join("mission/photos.zip"), b"PK\x03\x04nothing").unwrap();
    std::fs::copy(folder.join("mission/auv1.heard.csv"), folder.join("mission/auv1.heard.csv~")).unwrap();
    std::fs::write(
        folder.join("mission/team.toml"),
        "model_file = \"m.toml\"\n[slots]\nstart_s = 0\nduration_s = 1\norder = []\n",
    )
    .unwrap();
    let (with_other_files, warnings) = import(folder, "mission");
    assert_eq!(
        (&with_other_files["log_digest"], &with_other_files["left_out"]["files"]),
        (&without_other_files["log_digest"], &2.into())
    );
    assert!(warnings.contains("mission/photos.zip: cannot be unpacked"), "{warnings}");
    std::fs::rename(folder.join("mission/auv1.nav.csv"), folder.join("mission/auv1.nav.xyz~")).unwrap();
    let output = pingmap(folder, &["import", "mission", "--ids", "mission/ids.csv", "--overwrite"]);
    assert!(output.status.code() == Some(2) && stderr(&output).contains("nav.xyz~"), "{}", stderr(&output));
    std::fs::rename(folder.join("mission/auv1.nav.xyz~"), folder.join("mission/auv1.nav.csv")).unwrap();
}
