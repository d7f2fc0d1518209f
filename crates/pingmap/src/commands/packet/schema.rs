//! `pingmap packet schema`: prints the fields of messages and their bits.

use clap::Args;
use pingmap_packet::{Layout, OutcomeCounts, PROTO, ReportLayout};
use schemars::JsonSchema;
use serde::Serialize;

use crate::cli_parsers::frame_bytes;
use crate::output::{BadInput, Results, count, print, print_json, print_text, table};

#[derive(Args)]
#[command(after_help = "Example:\n  pingmap packet schema --proto > pingmap.proto")]
pub struct Options {
    /// Bytes of a frame
    #[arg(long, default_value_t = 32, value_parser = frame_bytes)]
    pub frame_bytes: usize,
    /// Print the report, whose length varies, instead of the map message
    #[arg(long, conflicts_with = "frame_bytes")]
    pub report: bool,
    /// Include the authentication tag
    #[arg(long)]
    pub authenticated: bool,
    /// Include depths
    #[arg(long)]
    pub depth: bool,
    /// Print the .proto of all packets, which Goby and other users of DCCL load
    #[arg(long, conflicts_with_all = ["json", "authenticated", "depth", "frame_bytes", "report"])]
    pub proto: bool,
    /// Print one JSON object instead of tables
    #[arg(long)]
    pub json: bool,
}

/// Fields of a message in JSON.
#[derive(Serialize, JsonSchema)]
pub struct SchemaJson {
    /// Version of this object.
    schema: u32,
    /// Name of the message in the `.proto`.
    message: &'static str,
    /// DCCL id of the message.
    id: u16,
    /// Smallest length of a report in bytes.
    #[serde(skip_serializing_if = "Option::is_none")]
    bytes_min: Option<usize>,
    /// Largest length of the message in bytes.
    bytes: usize,
    /// Whether the message ends with an authentication tag.
    authenticated: bool,
    /// Whether positions have depths.
    depth: bool,
    /// Bits of the DCCL id.
    id_bits: u64,
    /// Largest number of bits of all fields and the DCCL id.
    bits_used: u64,
    /// All fields in their order in the message.
    fields: Vec<FieldJson>,
    #[serde(flatten)]
    points: Option<PointsJson>,
}

/// Points of a map message.
#[derive(Serialize, JsonSchema)]
pub struct PointsJson {
    /// Bytes of the frame for which the message is made.
    frame_bytes: usize,
    /// Largest number of blocks.
    blocks: usize,
    /// Number of points of each block.
    points_per_block: usize,
    /// Number of points of all blocks.
    points: usize,
}

#[derive(Serialize, JsonSchema)]
pub struct FieldJson {
    /// Name of the field in the `.proto`.
    name: String,
    /// Largest number of bits.
    bits: u64,
    /// Whether the field is in the head of the message, which DCCL encodes separately.
    in_head: bool,
}

impl Options {
    pub fn run(&self, results: Results) -> anyhow::Result<()> {
        if self.proto {
            return print(results, PROTO);
        }
        let json = if self.report { self.report() } else { self.map_message()? };
        if self.json { print_json(results, &json) } else { print_text(results, &text(&json)) }
    }

    fn map_message(&self) -> anyhow::Result<SchemaJson> {
        let layout = Layout::for_frame(self.frame_bytes, self.depth, self.authenticated);
        let layout = layout.ok_or_else(|| BadInput(format!("no packet fits into {} bytes", self.frame_bytes)))?;
        let points = PointsJson {
            frame_bytes: layout.frame_bytes,
            blocks: layout.blocks,
            points_per_block: layout.points,
            points: layout.points_in_all(),
        };
        Ok(SchemaJson { points: Some(points), ..self.of(layout.name, layout.id, &layout.schema()) })
    }

    fn report(&self) -> SchemaJson {
        let layout = ReportLayout::new(self.depth, self.authenticated);
        let bytes_min = layout.length(OutcomeCounts::default(), 0);
        SchemaJson { bytes_min: Some(bytes_min), ..self.of(layout.name, layout.id, &layout.schema()) }
    }

    fn of(&self, message: &'static str, id: u16, schema: &pingmap_packet::Schema) -> SchemaJson {
        let in_head = |name: &str| schema.fields.iter().any(|field| field.name == name && field.in_head);
        let field = |(name, bits): (&str, u64)| FieldJson { name: name.to_owned(), bits, in_head: in_head(name) };
        let fields: Vec<FieldJson> = schema.bits().into_iter().map(field).collect();
        SchemaJson {
            schema: 1,
            message,
            id,
            bytes_min: None,
            bytes: schema.length(),
            authenticated: self.authenticated,
            depth: self.depth,
            id_bits: schema.id_bits(),
            bits_used: schema.id_bits() + fields.iter().map(|field| field.bits).sum::<u64>(),
            fields,
            points: None,
        }
    }
}

fn text(json: &SchemaJson) -> String {
    let SchemaJson { message, id, bytes, bits_used, .. } = json;
    let size = match &json.points {
        Some(PointsJson { frame_bytes, blocks, points, .. }) => format!(
            "{bytes} of {frame_bytes} bytes, {bits_used} bits used; {} in {}",
            count(*points, "inducing point"),
            count(*blocks, "block")
        ),
        None => format!("{} to {bytes} bytes; fields at most", json.bytes_min.unwrap_or_default()),
    };
    let mut rows = vec![vec!["(message id)".to_owned(), "head".to_owned(), json.id_bits.to_string()]];
    rows.extend(json.fields.iter().map(|field| {
        let part = if field.in_head { "head" } else { "body" };
        vec![field.name.clone(), part.to_owned(), field.bits.to_string()]
    }));
    format!("{message}, DCCL id {id}: {size}\n\n{}", table(&["field", "part", "bits"], &rows))
}
