//! `pingmap packet`: decodes, encodes and describes packets.

pub mod report;
pub mod schema;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::{Args, Subcommand};
use pingmap_agent::{Agent, AgentOptions, Link, Time, VehicleId};
use pingmap_packet::{Block, Cell, Layout, MapMessage, Point, ReportLayout, from_hex, to_hex};
use schemars::JsonSchema;
use serde::de::IgnoredAny;
use serde::{Deserialize, Serialize};

use crate::output::{BadInput, Results, count, print, print_json, print_text, read_text, table};
use crate::team::{model_digest, read_team, team_digest};

/// Decode and encode packets, and print their fields and their .proto
#[derive(Args)]
#[command(
    after_long_help = "Examples:\n  pingmap packet schema --proto > pingmap.proto\n  pingmap packet decode --team team.toml --json 7f01… > packet.json\n  pingmap packet encode --team team.toml packet.json"
)]
pub struct Options {
    #[command(subcommand)]
    action: Action,
}

#[derive(Subcommand)]
pub enum Action {
    /// Decode a packet
    Decode(Decode),
    /// Encode a packet from JSON, as `decode --json` prints it
    Encode(Encode),
    /// Print the fields of the packets and their bits
    Schema(schema::Options),
}

#[derive(Args)]
#[command(after_help = "Example:\n  pingmap packet decode --team team.toml --json 7f01… > packet.json")]
pub struct Decode {
    /// The packet in hexadecimal digits
    pub hex: String,
    /// Team file: checks that the packet belongs to the team, and prints positions in metres
    #[arg(long, value_name = "FILE")]
    pub team: Option<PathBuf>,
    /// Print one JSON object instead of tables
    #[arg(long)]
    pub json: bool,
}

#[derive(Args)]
#[command(after_help = "Example:\n  pingmap packet encode --team team.toml packet.json")]
pub struct Encode {
    /// JSON file
    pub file: PathBuf,
    /// Team file: authenticates the packet, or adds the digest of the team's model
    #[arg(long, value_name = "FILE")]
    pub team: Option<PathBuf>,
    /// Print one JSON object instead of the bytes in hexadecimal
    #[arg(long)]
    pub json: bool,
}

impl Options {
    pub fn threads(&self) -> usize {
        1
    }

    pub fn run(&self, results: Results) -> anyhow::Result<()> {
        match &self.action {
            Action::Decode(options) => decode(options, results),
            Action::Encode(options) => encode(options, results),
            Action::Schema(options) => options.run(results),
        }
    }
}

/// Fields that decide how the rest is read.
#[derive(Deserialize)]
struct Named {
    schema: u32,
    message: String,
}

/// A packet as JSON with integer fields.
#[derive(Serialize, JsonSchema, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PacketJson {
    /// Version of this object.
    schema: u32,
    /// Version and command line that printed the JSON. They are not read.
    #[serde(default, skip_serializing, rename = "version")]
    #[schemars(skip)]
    _version: IgnoredAny,
    #[serde(default, skip_serializing, rename = "command")]
    #[schemars(skip)]
    _command: IgnoredAny,
    /// Digest of the team configuration, if a team file is given. Not read.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    team_digest: Option<String>,
    /// Digest of the model, if a team file is given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    model_digest: Option<String>,
    /// Name of the message in the `.proto`.
    message: String,
    /// Number of the sender in the team.
    sender: u8,
    /// Counter of the sender's packets.
    counter: u16,
    /// Check number of the team's model and of this packet. Authenticated packets have a tag instead.
    #[serde(default)]
    model: u16,
    /// Summaries of the sender's locality regions.
    blocks: Vec<BlockJson>,
}

#[derive(Serialize, JsonSchema, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BlockJson {
    /// Time cell of the block's posterior; 0 for no particular time.
    #[serde(default)]
    time: u8,
    /// Time in seconds, if a team file is given. Not read.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    time_s: Option<f64>,
    /// Inducing points of the block.
    points: Vec<PointJson>,
    /// Levels of the correlations between the points, row by row below the diagonal.
    correlations: Vec<i8>,
}

/// An inducing point: cells of both ends, and levels of information and mean. A cell has east, north and, in messages
/// with depths, depth. With a team file the positions in metres are added; they are not read.
#[derive(Serialize, JsonSchema, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PointJson {
    /// Cell of the transmitter.
    tx: Vec<u8>,
    /// Cell of the receiver.
    rx: Vec<u8>,
    /// Level of the information.
    information: u8,
    /// Level of the mean log-odds.
    mean: i8,
    /// Position of the transmitter in metres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    tx_m: Option<Vec<f64>>,
    /// Position of the receiver in metres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    rx_m: Option<Vec<f64>>,
}

fn decode(options: &Decode, results: Results) -> anyhow::Result<()> {
    let bytes = bytes_of(&options.hex)?;
    let listener = options.team.as_deref().map(listener).transpose()?;
    if ReportLayout::of(&bytes).is_some() {
        return report::decode(&bytes, listener.as_ref(), options.json, results);
    }
    let (layout, message) = match &listener {
        Some(listener) => listener.codec().read(&bytes).map_err(|refusal| BadInput(refusal.to_string()))?,
        None => read_alone(&bytes)?,
    };
    let json = PacketJson {
        schema: 1,
        _version: IgnoredAny,
        _command: IgnoredAny,
        team_digest: listener.as_ref().map(team_digest),
        model_digest: listener.as_ref().map(model_digest),
        message: layout.name.to_owned(),
        sender: message.sender,
        counter: message.counter,
        model: message.model,
        blocks: message.blocks.iter().map(|block| block_json(block, layout, listener.as_ref())).collect(),
    };
    if options.json {
        return print_json(results, &json);
    }
    let sender = listener.as_ref().and_then(|listener| listener.team().members.get(&message.sender));
    let sender = sender.map_or_else(|| format!("vehicle {}", message.sender), ToString::to_string);
    let points = json.blocks.iter().flat_map(|block| block.points.iter().map(move |point| (block, point)));
    let points = points.filter(|(_, point)| point.information > 0);
    let rows = points.enumerate().map(|(place, (block, point))| point_row(place + 1, block, point));
    let rows: Vec<Vec<String>> = rows.collect();
    let header = match listener {
        Some(_) => ["point", "time, s", "transmitter, m", "receiver, m", "information", "mean"],
        None => ["point", "time, cell", "transmitter, cell", "receiver, cell", "information", "mean"],
    };
    print_text(
        results,
        &format!(
            "{} of {sender}, number {}, {}\n\n{}",
            layout.name,
            message.counter,
            count(bytes.len(), "byte"),
            table(&header, &rows)
        ),
    )
}

/// Decodes a packet without a team. Authenticated packets need the team.
fn read_alone(bytes: &[u8]) -> anyhow::Result<(&'static Layout, MapMessage)> {
    MapMessage::decode(bytes, None).map_err(|error| {
        let hint = match error {
            pingmap_packet::Error::Authentication(_) => "; expected --team with the team that formed it",
            _ => "",
        };
        BadInput(format!("{error}{hint}")).into()
    })
}

fn encode(options: &Encode, results: Results) -> anyhow::Result<()> {
    let bad = |problem: &dyn std::fmt::Display| BadInput(format!("{}: {problem}", options.file.display()));
    let text = read_text(&options.file)?;
    let named: Named = serde_json::from_str(&text).map_err(|error| bad(&error))?;
    let listener = options.team.as_deref().map(listener).transpose()?;
    if named.schema > 1 {
        return Err(bad(&format_args!("schema {}, but this version reads schema 1", named.schema)).into());
    }
    if named.message.starts_with("Report") {
        let (layout, bytes) = report::encode(&text, listener.as_ref()).map_err(|problem| bad(&problem))?;
        return print_bytes(options, (layout.name, &bytes), listener.as_ref(), results);
    }
    let json: PacketJson = serde_json::from_str(&text).map_err(|error| bad(&error))?;
    let layout = pingmap_packet::LAYOUTS.iter().find(|layout| layout.name == json.message);
    let layout = layout.ok_or_else(|| {
        let names: Vec<&str> = pingmap_packet::LAYOUTS.iter().map(|layout| layout.name).collect();
        bad(&format_args!("unknown message {:?}; expected one of {}", json.message, names.join(", ")))
    })?;
    let blocks = json.blocks.iter().map(|block| block_of(block, layout)).collect::<Result<_, _>>();
    let message = MapMessage {
        sender: json.sender,
        counter: json.counter,
        model: json.model,
        blocks: blocks.map_err(|problem: String| bad(&problem))?,
    };
    let bytes = match &listener {
        Some(listener) => {
            let bytes = listener.codec().write(layout, &message).map_err(|error| bad(&error))?;
            // A packet that members of the team would refuse is an error here.
            listener.codec().read(&bytes).map_err(|refusal| bad(&refusal))?;
            bytes
        }
        None => message.encode(layout, None).map_err(|error| bad(&error))?,
    };
    print_bytes(options, (layout.name, &bytes), listener.as_ref(), results)
}

fn print_bytes(
    options: &Encode,
    (message, bytes): (&str, &[u8]),
    listener: Option<&Agent>,
    results: Results,
) -> anyhow::Result<()> {
    let hex = to_hex(bytes);
    if options.json {
        let (team_digest, model_digest) = (listener.map(team_digest), listener.map(model_digest));
        let encoded = EncodedJson { schema: 1, message, bytes: bytes.len(), hex, team_digest, model_digest };
        return print_json(results, &encoded);
    }
    print(results, &hex)
}

/// An encoded packet in JSON.
#[derive(Serialize, JsonSchema)]
pub struct EncodedJson<'a> {
    /// Version of this object.
    schema: u32,
    /// Name of the message in the `.proto`.
    message: &'a str,
    /// Length in bytes.
    bytes: usize,
    /// The packet in hexadecimal digits.
    hex: String,
    /// Digest of the team configuration, if a team file is given.
    #[serde(skip_serializing_if = "Option::is_none")]
    team_digest: Option<String>,
    /// Digest of the model, if a team file is given.
    #[serde(skip_serializing_if = "Option::is_none")]
    model_digest: Option<String>,
}

/// Returns an agent that can decode the packets of a team.
fn listener(path: &Path) -> anyhow::Result<Agent> {
    Ok(Agent::new(VehicleId::new("listener"), Arc::new(read_team(path)?), AgentOptions::default()))
}

fn block_json(block: &Block, layout: &Layout, listener: Option<&Agent>) -> BlockJson {
    let cells = |cell: Cell| {
        if layout.has_depth { vec![cell.east, cell.north, cell.depth] } else { vec![cell.east, cell.north] }
    };
    let links: Vec<Option<Link>> = match listener {
        Some(listener) => listener.team().quantizer().links(&block.points).into_iter().map(Some).collect(),
        None => vec![None; block.points.len()],
    };
    let metres = |end: pingmap_agent::Position| {
        [Some(end.east_m), Some(end.north_m), end.depth_m].into_iter().flatten().collect()
    };
    let point = |(point, link): (&Point, Option<Link>)| PointJson {
        tx: cells(point.transmitter),
        rx: cells(point.receiver),
        information: point.information,
        mean: point.mean,
        tx_m: link.map(|link| metres(link.transmitter)),
        rx_m: link.map(|link| metres(link.receiver)),
    };
    let when = listener.map(|listener| listener.team().grid.when(block.time));
    BlockJson {
        time: block.time,
        time_s: when.and_then(|when| if let Time::At(time_s) = when { Some(time_s) } else { None }),
        points: block.points.iter().zip(links).map(point).collect(),
        correlations: block.correlations.clone(),
    }
}

fn block_of(json: &BlockJson, layout: &Layout) -> Result<Block, String> {
    let cell = |name: &str, cells: &[u8]| match (cells, layout.has_depth) {
        (&[east, north], false) => Ok(Cell { east, north, depth: 0 }),
        (&[east, north, depth], true) => Ok(Cell { east, north, depth }),
        (other, has_depth) => {
            let expected = if has_depth { 3 } else { 2 };
            Err(format!("{name}: expected {expected} cells in {}, found {}", layout.name, other.len()))
        }
    };
    let point = |point: &PointJson| {
        let PointJson { information, mean, .. } = *point;
        Ok(Point { transmitter: cell("tx", &point.tx)?, receiver: cell("rx", &point.rx)?, information, mean })
    };
    let points = json.points.iter().map(point).collect::<Result<_, String>>()?;
    Ok(Block { time: json.time, points, correlations: json.correlations.clone() })
}

fn point_row(number: usize, block: &BlockJson, point: &PointJson) -> Vec<String> {
    let place = |cells: &[u8], metres: &Option<Vec<f64>>| match metres {
        Some(metres) => metres.iter().map(|metres| format!("{metres:.0}")).collect::<Vec<_>>().join(", "),
        None => cells.iter().map(u8::to_string).collect::<Vec<_>>().join(", "),
    };
    let time = match (block.time, block.time_s) {
        (0, _) => "–".to_owned(),
        (_, Some(time_s)) => format!("{time_s:.0}"),
        (cell, None) => cell.to_string(),
    };
    vec![
        number.to_string(),
        time,
        place(&point.tx, &point.tx_m),
        place(&point.rx, &point.rx_m),
        point.information.to_string(),
        point.mean.to_string(),
    ]
}

/// Parses hexadecimal digits.
fn bytes_of(hex: &str) -> anyhow::Result<Vec<u8>> {
    let hex: String = hex.split_whitespace().collect();
    Ok(from_hex(&hex).ok_or_else(|| BadInput(format!("{hex:?}: expected pairs of hexadecimal digits")))?)
}
