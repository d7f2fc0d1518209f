//! Mutated files of every format: no reader panics, hangs, or takes much memory.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use pingmap_agent::VehicleId;
use pingmap_import::{
    EventRecords, FileSource, ModemIds, RecordReader, Recordings, Reference, Rules, Schedule, join, resolve_modem_ids,
};

use crate::random::Random;

/// Longest time for one file, and largest memory of the process in bytes.
const TIME_MAX: Duration = Duration::from_secs(10);
const MEMORY_BYTES_MAX: u64 = 512 << 20;

/// Texts that numbers and fields are replaced with.
const FRAGMENTS: [&[u8]; 12] = [
    b"-1",
    b"1e308",
    b"nan",
    b"99999999999999999999",
    b",,,,",
    b";",
    b"$CARXD,2,63,0,1,00",
    b"\xff\xff\xff\x7f",
    b"\0\0\0\0",
    b"03.05.2026 12:00:00",
    b"slot { src: 1 slot_seconds: 1e-9 }",
    b"{\"source\":2}",
];

/// Small files of formats that the test data do not contain.
const TEXTS: [(&str, &str); 5] = [
    ("auv1.nav.csv", "time;lat [deg];lon;depth\n2026-05-03 12:00:00;43,8;-70,3;5\n1777809610000;43,8;289,7;5\n"),
    ("auv1.heard.csv", "time,source,good,frame,frames\n1,2,ok,1,2\n2,3,0,,\n"),
    ("events.csv", "time,tx,rx,tx_lat,tx_lon,rx_lat,rx_lon,heard\n1,a,b,43,-70,43,-70.1,yes\n"),
    (
        "schedule.toml",
        "[slots]\nstart_s = 0\nduration_s = 10\norder = ['1', '2']\n[[slots.changes]]\nfrom_s = 50\norder = ['2']\n",
    ),
    (
        "auv.cfg",
        "mac { type: MAC_FIXED_DECENTRALIZED slot { src: 1 slot_seconds: 10 } slot { src: 2 slot_seconds: 15 } }\n",
    ),
];

/// A file that is mutated.
type Seed = (PathBuf, Vec<u8>);

fn seeds() -> Vec<Seed> {
    let mut folders = vec![Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data")];
    let mut seeds: Vec<Seed> =
        TEXTS.iter().map(|(name, text)| (PathBuf::from(name), text.as_bytes().to_vec())).collect();
    while let Some(folder) = folders.pop() {
        let mut paths: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
        paths.sort();
        for path in paths {
            match path.is_dir() {
                true => folders.push(path),
                false => seeds.push((path.file_name().unwrap().into(), std::fs::read(&path).unwrap())),
            }
        }
    }
    seeds
}

/// Changes a file in a few places.
fn mutate(random: &mut Random, seeds: &[Seed], bytes: &mut Vec<u8>) {
    for _ in 0..1 + random.index(6) {
        let at = random.index(bytes.len());
        let length = random.index(24).min(bytes.len() - at);
        match random.index(7) {
            0 if !bytes.is_empty() => bytes[at] ^= 1 << random.index(8),
            1 => drop(bytes.drain(at..at + length)),
            2 => bytes.truncate(at),
            3 => {
                let copy = bytes[at..at + length].to_vec();
                bytes.splice(at..at, copy.repeat(1 + random.index(3)));
            }
            4 => {
                let other = &seeds[random.index(seeds.len())].1;
                let from = random.index(other.len());
                bytes.splice(at..at + length, other[from..].iter().take(200).copied());
            }
            _ => drop(bytes.splice(at..at + length, FRAGMENTS[random.index(FRAGMENTS.len())].iter().copied())),
        }
    }
}

/// Reads a file in every role that it may have.
fn read(reader: &RecordReader, (name, bytes): &Seed) {
    let mut recordings = Recordings::new();
    let vehicle = VehicleId::new("auv1");
    let source = FileSource { path: None, name, vehicle: Some(&vehicle), topics: "" };
    let _ = reader.read_record(bytes.as_slice(), &source, &mut recordings);
    let _ = resolve_modem_ids(&mut recordings);
    let ids = ModemIds::read(bytes.as_slice(), name).unwrap_or_default();
    let schedule = Schedule::read(bytes.as_slice(), name, &ids).ok();
    let _ = join(&recordings, schedule.as_ref(), &Reference::unknown(), &Rules::default());
    let _ = reader.read_events(bytes.as_slice(), name, &mut EventRecords::default());
    let _ = RecordReader::default().read_lcm_types(bytes.as_slice(), name);
}

/// Reads mutated files, and returns the longest time of one.
fn longest_time(seed: u64, inputs: usize) -> Duration {
    let seeds = seeds();
    let mut reader = RecordReader::default();
    for (name, bytes) in seeds.iter().filter(|(name, _)| name.extension().is_some_and(|extension| extension == "lcm")) {
        reader.read_lcm_types(bytes.as_slice(), name).unwrap();
    }
    let mut random = Random::new(seed);
    let mut longest = Duration::ZERO;
    for _ in 0..inputs {
        let mut file = seeds[random.index(seeds.len())].clone();
        mutate(&mut random, &seeds, &mut file.1);
        let start = Instant::now();
        read(&reader, &file);
        longest = longest.max(start.elapsed());
    }
    longest
}

/// Returns the largest memory of this process so far in bytes, where the system states it.
fn peak_memory_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    Some(1024 * line.trim().strip_suffix(" kB")?.parse::<u64>().ok()?)
}

#[test]
fn no_mutated_file_makes_a_reader_panic() {
    assert!(longest_time(1, 1500) < TIME_MAX);
}

#[test]
#[ignore = "a million files; run by .ci/full"]
fn a_million_mutated_files_take_little_time_and_memory() {
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let longest = std::thread::scope(|scope| {
        let run =
            |thread: usize| scope.spawn(move || longest_time(1000 + thread as u64, 1_000_000_usize.div_ceil(threads)));
        let running: Vec<_> = (0..threads).map(run).collect();
        running.into_iter().map(|thread| thread.join().unwrap()).max().unwrap()
    });
    eprintln!("longest time of one file: {longest:?}, memory: {:?} bytes", peak_memory_bytes());
    assert!(longest < TIME_MAX && peak_memory_bytes().is_none_or(|bytes| bytes < MEMORY_BYTES_MAX));
}
