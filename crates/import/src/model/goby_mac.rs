//! The schedule in a configuration of Goby's medium access control (MAC).
//!
//! The configuration is the text form of the protobuf message `MACConfig`, alone or within the configuration of a
//! process. The reader follows `amac_config.proto` and `mac_manager.cpp` of Goby 3. Cycles start at midnight UTC, or at
//! `fixed_ref_time`. It was not tested on the files of a mission.

use pingmap_agent::VehicleId;

use crate::model::modem_ids::ModemIds;
use crate::model::schedule::Schedule;

/// Largest number of parts of equal length that a cycle is divided into.
const PARTS_MAX: u64 = 100_000;

/// Whether a text contains a configuration of the MAC.
pub(crate) fn is_mac_config(text: &str) -> bool {
    let is_mentioned = ["MAC_FIXED_DECENTRALIZED", "MAC_POLLED"].iter().any(|name| text.contains(name));
    is_mentioned && !Block::parse_text(&spaced(text)).cycles().is_empty()
}

/// Removes remarks, and puts spaces around the marks of the text form.
fn spaced(text: &str) -> String {
    let without_remarks =
        text.lines().map(|line| line.split("//").next().unwrap_or("").split('#').next().unwrap_or(""));
    let text: String = without_remarks.flat_map(|line| [line, "\n"]).collect();
    text.replace('{', " { ").replace('}', " } ").replace(':', ": ").replace([',', ';'], " ")
}

/// A message in protobuf's text form. Other words are ignored.
#[derive(Debug, Default)]
struct Block<'a> {
    fields: Vec<(&'a str, &'a str)>,
    blocks: Vec<(&'a str, Block<'a>)>,
}

impl<'a> Block<'a> {
    /// Parses a text that [`spaced`] returned.
    fn parse_text(text: &'a str) -> Self {
        Self::parse(&mut text.split_whitespace(), DEPTH_MAX)
    }

    /// Returns all blocks with slots, at any depth.
    fn cycles(&self) -> Vec<&Self> {
        let mut cycles = Vec::new();
        self.find_cycles(&mut cycles);
        cycles
    }

    /// Parses words up to the end of the block.
    fn parse(words: &mut impl Iterator<Item = &'a str>, depth: usize) -> Self {
        let (mut block, mut latest) = (Self::default(), "");
        while let Some(word) = words.next() {
            match word {
                "}" => break,
                "{" if depth > 0 => block.blocks.push((latest.trim_end_matches(':'), Self::parse(words, depth - 1))),
                _ if latest.ends_with(':') => block.fields.push((latest.trim_end_matches(':'), word)),
                _ => {}
            }
            latest = word;
        }
        block
    }

    fn field(&self, name: &str) -> Option<&'a str> {
        self.fields.iter().find(|(field, _)| *field == name).map(|(_, value)| *value)
    }

    fn slots(&self) -> impl Iterator<Item = &Self> {
        self.blocks.iter().filter(|(name, _)| *name == "slot").map(|(_, slot)| slot)
    }

    fn find_cycles<'b>(&'b self, cycles: &mut Vec<&'b Self>) {
        let is_mac = self.field("type").is_some_and(|kind| kind.starts_with("MAC_"));
        if is_mac && self.slots().next().is_some() {
            cycles.push(self);
        }
        self.blocks.iter().for_each(|(_, block)| block.find_cycles(cycles));
    }
}

/// Deepest nesting of blocks.
const DEPTH_MAX: usize = 32;

/// Reads the schedule of a configuration.
///
/// # Errors
/// A description of the value that was found and what was expected.
pub(crate) fn read_mac_config(text: &str, ids: &ModemIds) -> Result<Schedule, String> {
    let text = spaced(text);
    let top = Block::parse_text(&text);
    let cycles = top.cycles();
    let [cycle] = cycles[..] else {
        return Err(format!("found {} MAC configurations with slots; expected one", cycles.len()));
    };
    if cycle.field("type") != Some("MAC_FIXED_DECENTRALIZED") {
        return Err(format!(
            "type: found {}; expected MAC_FIXED_DECENTRALIZED, or records of the transmissions (--sent)",
            cycle.field("type").unwrap_or_default()
        ));
    }
    let slots = cycle.slots().map(|slot| read_slot(slot, ids));
    let (order, duration_s) = equal_parts(&slots.collect::<Result<Vec<_>, _>>()?)?;
    let is_fixed = cycle.field("ref_time_type") == Some("REFERENCE_FIXED");
    let start_s = match cycle.field("fixed_ref_time") {
        Some(text) if is_fixed => {
            text.parse().map_err(|_| format!("fixed_ref_time: found {text}; expected seconds"))?
        }
        _ => 0.0,
    };
    Ok(Schedule::Cyclic { duration_s, restarts_daily: !is_fixed, orders: vec![(start_s, order)] })
}

/// Returns the owner and the length of a slot in milliseconds. The owner is empty for a slot without data.
fn read_slot(slot: &Block, ids: &ModemIds) -> Result<(VehicleId, u64), String> {
    let seconds = slot.field("slot_seconds").ok_or("a slot lacks slot_seconds; expected its length in seconds")?;
    let length_ms = seconds.parse::<f64>().ok().map(|seconds| (1e3 * seconds).round());
    let length_ms = length_ms.filter(|length_ms| (10.0..=86_400_000.0).contains(length_ms));
    let length_ms = length_ms.ok_or_else(|| format!("slot_seconds: found {seconds}; expected 0.01 s to a day"))?;
    let has_data = slot.field("type").is_none_or(|kind| kind.ends_with("DATA"));
    let owner = slot.field("src").filter(|source| has_data && *source != "0").and_then(|source| ids.resolve(source));
    Ok((owner.unwrap_or_else(|| VehicleId::new("")), length_ms as u64))
}

/// Divides slots of different lengths into parts of equal length. The first part of a slot has its owner.
fn equal_parts(slots: &[(VehicleId, u64)]) -> Result<(Vec<VehicleId>, f64), String> {
    let divisor = |mut a: u64, mut b: u64| {
        while b > 0 {
            (a, b) = (b, a % b);
        }
        a
    };
    let part_ms = slots.iter().fold(0, |part_ms, (_, length_ms)| divisor(part_ms, *length_ms)).max(1);
    let parts: u64 = slots.iter().map(|(_, length_ms)| length_ms / part_ms).sum();
    if parts > PARTS_MAX {
        return Err(format!("the lengths of the slots have {parts} common parts; expected at most {PARTS_MAX}"));
    }
    let mut order = Vec::new();
    for (owner, length_ms) in slots {
        order.push(owner.clone());
        order.extend((1..length_ms / part_ms).map(|_| VehicleId::new("")));
    }
    Ok((order, part_ms as f64 / 1e3))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn read(text: &str) -> Result<Schedule, String> {
        let ids = ModemIds::read("id,name\n1,ada\n3,bob\n".as_bytes(), Path::new("ids")).unwrap();
        read_mac_config(text, &ids)
    }

    const CONFIG: &str = "ProcessConfig = pAcommsHandler\n{\n  AppTick = 4 // fast\n  driver_cfg { driver_type: DRIVER_WHOI_MICROMODEM }\n  \
        mac_cfg {\n    type: MAC_FIXED_DECENTRALIZED  # TDMA\n    slot { src: 1 dest: 0 rate: 1 type: DATA slot_seconds: 10 }\n    \
        slot { src:3, rate: 1; slot_seconds:15.5 }\n    slot { src: 1 type: DRIVER_SPECIFIC slot_seconds: 4.5 }\n  }\n}\n";

    #[test]
    fn slots_have_their_lengths_from_midnight_on() {
        let schedule = read(CONFIG).unwrap();
        let starts = |name: &str, from_s: f64| schedule.slot_starts_s(&VehicleId::new(name), from_s, from_s + 61.0);
        assert_eq!(starts("ada", 86_400.0), [86_400.0, 86_430.0, 86_460.0]);
        assert_eq!(starts("bob", 86_400.0), [86_410.0, 86_440.0]);
        let fixed = CONFIG.replace("mac_cfg {", "mac_cfg { ref_time_type: REFERENCE_FIXED fixed_ref_time: 7");
        assert_eq!(read(&fixed).unwrap().slot_starts_s(&VehicleId::new("bob"), 0.0, 50.0), [17.0, 47.0]);
    }

    #[test]
    fn other_configurations_are_refused() {
        for (text, words) in [
            (CONFIG.replace("MAC_FIXED_DECENTRALIZED", "MAC_POLLED"), "found MAC_POLLED"),
            (CONFIG.replace("slot_seconds: 10", ""), "lacks slot_seconds"),
            (CONFIG.replace("15.5", "-1"), "slot_seconds: found -1"),
            (CONFIG.replace("slot {", "turn {"), "found 0 MAC configurations"),
            (CONFIG.repeat(2), "found 2 MAC configurations"),
            (CONFIG.replace("10 }", "10.001 }").replace("15.5", "86000"), "common parts"),
        ] {
            let error = read(&text).unwrap_err();
            assert!(error.contains(words), "{error}");
        }
        assert!(read(&"{".repeat(100_000)).is_err());
    }
}
