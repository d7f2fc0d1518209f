//! Sentences between the host and the modem of a simulated vehicle, and logs that contain them.

use std::fmt::Write;

use pingmap_agent::{Event, VehicleId};
use pingmap_import::{nmea_checksum, time_in_words};
use pingmap_trial::simulate::{Simulated, Simulation};

/// Time in seconds from the start of a message until it is decoded and recorded.
pub const DELAY_S: f64 = 1.2;

/// Speed of sound in all files, in metres per second.
pub const SOUND_M_PER_S: f64 = 1500.0;

/// Broadcast address of the modems.
pub const BROADCAST: u32 = 63;

/// A sentence, its true time, and whether the host sent it.
pub struct ModemSentence {
    pub time_s: f64,
    pub by_host: bool,
    pub sentence: String,
}

/// Interval of the modem's status sentences in seconds.
const REVISION_EVERY_S: f64 = 60.0;

/// Time in seconds from the cycle packet to the data packet.
const CYCLE_S: f64 = 1.0;

/// Bytes of a frame at rate 0.
const FRAME_BYTES: usize = 32;

/// Returns all sentences at a vehicle in the order of time, until the vehicle stopped recording.
pub fn sentences(simulation: &Simulation, trial: &Simulated, vehicle: usize, until_s: f64) -> Vec<ModemSentence> {
    let mut all = Vec::new();
    let mut say = |time_s: f64, sentence: String| {
        let by_host = sentence.starts_with("CC");
        all.push(ModemSentence { time_s, by_host, sentence: format!("${sentence}*{:02X}", nmea_checksum(&sentence)) });
    };
    let id = vehicle + 1;
    say(0.2, "CCCFQ,SRC".into());
    say(0.3, format!("CACFG,SRC,{id}"));
    let end_s = simulation.slot_s * (simulation.slots as f64 + 0.9);
    for beat in 0..=(end_s / REVISION_EVERY_S) as usize {
        say(0.4 + REVISION_EVERY_S * beat as f64, "CAREV,120000,AUV,0.94.0.00".into());
    }
    say(end_s, "CAREV,120000,AUV,0.94.0.00".into());
    for slot in (0..simulation.slots).filter(|slot| slot % simulation.vehicles == vehicle) {
        send(simulation.slot_s * (slot + 1) as f64 - simulation.clock_ahead_s(vehicle), id, &mut say);
    }
    let name = &trial.vehicles[vehicle].0;
    for (number, event) in trial.log.events.iter().enumerate().filter(|(_, event)| event.receiver_id == *name) {
        receive(event, number, number_of(trial, &event.transmitter_id), &mut say);
    }
    all.retain(|sentence| sentence.time_s <= until_s);
    all.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    all
}

fn number_of(trial: &Simulated, name: &VehicleId) -> usize {
    trial.vehicles.iter().position(|(id, _)| id == name).unwrap_or_default() + 1
}

/// Adds the sentences of a cycle with one data frame at rate 0.
fn send(begin_s: f64, id: usize, say: &mut impl FnMut(f64, String)) {
    let data = "00".repeat(FRAME_BYTES);
    for (after_s, sentence) in [
        (-CYCLE_S, format!("CCCYC,0,{id},{BROADCAST},0,0,1")),
        (-0.95, format!("CACYC,0,{id},{BROADCAST},0,0,1")),
        (-0.9, "CATXP,1".into()),
        (-0.6, "CATXF,1".into()),
        (-0.5, format!("CADRQ,120000,{id},{BROADCAST},0,{FRAME_BYTES},1")),
        (-0.4, format!("CCTXD,{id},{BROADCAST},0,{data}")),
        (-0.3, format!("CATXD,{id},{BROADCAST},0,{FRAME_BYTES}")),
        (0.0, format!("CATXP,{FRAME_BYTES}")),
        (0.9, format!("CATXF,{FRAME_BYTES}")),
        (1.0, format!("CAXST,6,20260503,120000.0000,0,0,200,5000,25000,0,{id},{BROADCAST},0,1,1,2,{FRAME_BYTES}")),
    ] {
        say(begin_s + after_s, sentence);
    }
}

/// Adds the sentences of a reception. A missed message leaves no trace, a damaged packet, a timeout or only a cycle
/// packet.
fn receive(event: &Event, number: usize, source: usize, say: &mut impl FnMut(f64, String)) {
    let arrival_s = event.time_s + event.link.range_m() / SOUND_M_PER_S;
    let statistics = |mode: usize| {
        let (source, bad) = if mode == 2 { (String::new(), 0) } else { (source.to_string(), mode) };
        format!(
            "CACST,6,{mode},20260503120000.0000,0,9000,60,200,150,0,0,0,0,0,0,{source},{BROADCAST},0,2,1,{bad},120,15,-1,-1,-1,180,0.0,60,25000,5000"
        )
    };
    let cycle = format!("CACYC,0,{source},{BROADCAST},0,0,1");
    let mut heard = vec![(-0.6, cycle), (0.1, "CARXP,0".into())];
    match (event.success, number % 4) {
        (true, _) => heard.extend([
            (DELAY_S, format!("CARXD,{source},{BROADCAST},0,1,{}", "00".repeat(FRAME_BYTES))),
            (DELAY_S + 0.05, statistics(0)),
        ]),
        (false, 0) => heard.clear(),
        (false, 1) => heard.extend([(DELAY_S, "CAMSG,BAD_CRC,1".into()), (DELAY_S + 0.05, statistics(1))]),
        (false, 2) => heard.extend([(DELAY_S + 2.0, "CAMSG,PACKET_TIMEOUT,1".into()), (DELAY_S + 2.05, statistics(2))]),
        (false, _) => heard.truncate(1),
    }
    for (after_s, sentence) in heard {
        say(arrival_s + after_s, sentence);
    }
}

/// Formats the sentences as a capture: each after the host's time.
pub fn capture(sentences: &[ModemSentence], start_s: f64, ahead_s: f64) -> String {
    let line = |sentence: &ModemSentence| {
        format!("{} {}\n", time_in_words(start_s + sentence.time_s + ahead_s), sentence.sentence)
    };
    sentences.iter().map(line).collect()
}

/// A position that a vehicle recorded.
pub struct Fix {
    pub time_s: f64,
    pub east_m: f64,
    pub north_m: f64,
    pub depth_m: f64,
    pub latitude_deg: f64,
    pub longitude_deg: f64,
}

/// Formats the sentences and positions as a MOOS log. The log also contains announced slots and the reports of other
/// vehicles, which no modem received.
pub fn moos_log(name: &str, sentences: &[ModemSentence], fixes: &[Fix], (start_s, ahead_s): (f64, f64)) -> String {
    let mut rows: Vec<(f64, String)> = Vec::new();
    for Fix { time_s, east_m, north_m, depth_m, latitude_deg, longitude_deg } in fixes {
        let mut row =
            |variable: &str, value: String| rows.push((time_s + ahead_s, format!("{variable:<20} pNav {value}")));
        row("NAV_X", format!("{east_m:.3}"));
        row("NAV_Y", format!("{north_m:.3}"));
        row("NAV_LAT", format!("{latitude_deg:.7}"));
        row("NAV_LONG", format!("{longitude_deg:.7}"));
        row("NAV_DEPTH", format!("{depth_m:.1}"));
        if time_s % 10.0 == 0.0 {
            row("NODE_REPORT_LOCAL", format!("NAME={name},TYPE=uuv,X={east_m:.1},Y={north_m:.1},DEP={depth_m:.1}"));
            row("NODE_REPORT", "NAME=shore,TYPE=ship,X=0,Y=0".into());
            row("ACOMMS_MAC_SLOT_START", "src: 1 type: SLOT_DATA".into());
        }
    }
    for ModemSentence { time_s, by_host, sentence } in sentences {
        let variable = if *by_host { "ACOMMS_NMEA_OUT" } else { "ACOMMS_NMEA_IN" };
        rows.push((time_s + ahead_s, format!("{variable:<20} pAcommsHandler {sentence}")));
    }
    rows.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut text = format!("%%%%%%%%\n%% LOG FILE:       ./{name}.alog\n%% LOGSTART        {start_s:.3}\n%%%%%%%%\n");
    for (time_s, row) in rows {
        let _ = writeln!(text, "{time_s:<12.3} {row}");
    }
    text
}
