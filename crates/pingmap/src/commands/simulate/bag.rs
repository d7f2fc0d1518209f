//! ROS 2 bags as simulated vehicles would have recorded them.

use std::collections::BTreeMap;
use std::io::Cursor;

use mcap::records::MessageHeader;
use mcap::{McapResult, Writer};

use super::modem::{Fix, ModemSentence};

/// Definitions of the message types in ROS 2.
const NAV_SAT_FIX: &str = "std_msgs/Header header\nsensor_msgs/NavSatStatus status\nfloat64 latitude\nfloat64 longitude\nfloat64 altitude\n\
    float64[9] position_covariance\nuint8 position_covariance_type\n";
const ODOMETRY: &str = "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\n\
    geometry_msgs/TwistWithCovariance twist\n";
const STRING: &str = "string data\n";

/// CDR encoding: each field at a multiple of its size, after a header of four bytes.
struct Cdr(Vec<u8>);

impl Cdr {
    fn new() -> Self {
        Self(vec![0, 1, 0, 0])
    }

    fn put(&mut self, bytes: &[u8]) {
        let end = 4 + (self.0.len() - 4).next_multiple_of(bytes.len());
        self.0.resize(end, 0);
        self.0.extend(bytes);
    }

    fn text(&mut self, text: &str) {
        self.put(&(text.len() as u32 + 1).to_le_bytes());
        self.0.extend(text.as_bytes());
        self.0.push(0);
    }
}

/// Starts a message with the header of all positions.
fn headed(time_ns: u64, frame: &str) -> Cdr {
    let mut cdr = Cdr::new();
    cdr.put(&((time_ns / 1_000_000_000) as u32).to_le_bytes());
    cdr.put(&((time_ns % 1_000_000_000) as u32).to_le_bytes());
    cdr.text(frame);
    cdr
}

fn nav_sat_fix(time_ns: u64, fix: &Fix) -> Vec<u8> {
    let mut cdr = headed(time_ns, "gps");
    cdr.put(&0i8.to_le_bytes());
    cdr.put(&1u16.to_le_bytes());
    // The altitude above the ellipsoid and the covariance are unknown.
    for number in [fix.latitude_deg, fix.longitude_deg, 0.0].into_iter().chain([0.0; 9]) {
        cdr.put(&number.to_le_bytes());
    }
    cdr.put(&[0]);
    cdr.0
}

fn odometry(time_ns: u64, fix: &Fix) -> Vec<u8> {
    let mut cdr = headed(time_ns, "odom");
    cdr.text("base_link");
    // Orientation, pose covariance, twist and twist covariance.
    let rest = [0.0, 0.0, 0.0, 1.0].into_iter().chain([0.0; 36]).chain([0.0; 6]).chain([0.0; 36]);
    for number in [fix.east_m, fix.north_m, -fix.depth_m].into_iter().chain(rest) {
        cdr.put(&number.to_le_bytes());
    }
    cdr.0
}

/// Writes the bag of a vehicle. Its topics are `NAME/odom`, `NAME/fix`, and `NAME/modem` with the sentences between
/// host and modem.
pub fn bag(
    name: &str,
    sentences: &[ModemSentence],
    fixes: &[Fix],
    (start_s, ahead_s): (f64, f64),
) -> McapResult<Vec<u8>> {
    let time_ns = |time_s: f64| ((start_s + time_s + ahead_s) * 1e3).round().max(0.0) as u64 * 1_000_000;
    let mut bytes = Vec::new();
    let mut writer = Writer::new(Cursor::new(&mut bytes))?;
    let mut channel = |topic: &str, kind: &str, fields: &str| {
        let schema = writer.add_schema(kind, "ros2msg", fields.as_bytes())?;
        writer.add_channel(schema, &format!("/{name}/{topic}"), "cdr", &BTreeMap::new())
    };
    let odometry_channel = channel("odom", "nav_msgs/msg/Odometry", ODOMETRY)?;
    let fix_channel = channel("fix", "sensor_msgs/msg/NavSatFix", NAV_SAT_FIX)?;
    let modem_channel = channel("modem", "std_msgs/msg/String", STRING)?;
    let text = |sentence: &ModemSentence| {
        let mut cdr = Cdr::new();
        cdr.text(&sentence.sentence);
        cdr.0
    };
    let fixes = fixes.iter().flat_map(|fix| {
        let time_ns = time_ns(fix.time_s);
        [(time_ns, odometry_channel, odometry(time_ns, fix)), (time_ns, fix_channel, nav_sat_fix(time_ns, fix))]
    });
    let mut messages: Vec<(u64, u16, Vec<u8>)> = fixes
        .chain(sentences.iter().map(|sentence| (time_ns(sentence.time_s), modem_channel, text(sentence))))
        .collect();
    messages.sort_by_key(|message| message.0);
    for (number, (log_time, channel_id, data)) in messages.into_iter().enumerate() {
        let header = MessageHeader { channel_id, sequence: number as u32, log_time, publish_time: log_time };
        writer.write_to_known_channel(&header, &data)?;
    }
    writer.finish()?;
    drop(writer);
    Ok(bytes)
}
