//! `pingmap schema`: prints the JSON Schema of each command's output.

use clap::Args;
use clap::builder::PossibleValuesParser;
use pingmap_vehicle::{Input, Message};
use schemars::generate::SchemaSettings;
use schemars::{JsonSchema, Schema};
use serde_json::json;

use super::{check, demo, fleet, import, learn, map, packet, plan};
use super::{predict, replay, reproduce, select, simulate, store, team};
use crate::output::{BadInput, Results, print};

/// Print the JSON Schema of the output of a command, or of the lines of `pingmap vehicle`
#[derive(Args)]
#[command(after_help = "Example: pingmap schema \"plan track\"")]
pub struct Options {
    /// The command; prints the names of all commands with a schema if not given
    #[arg(value_parser = PossibleValuesParser::new(SCHEMAS.iter().map(|(name, _)| *name)))]
    pub command: Option<String>,
}

/// Lines of the host protocol, in each direction.
const INPUT: &str = "vehicle (input)";
const MESSAGE: &str = "vehicle (message)";

/// Name of a command, and the schema of its output.
type Printed = (&'static str, fn() -> Schema);

const SCHEMAS: [Printed; 24] = [
    ("check", of::<check::CheckedJson>),
    ("demo", of::<demo::json::DemoJson>),
    ("fleet", of::<fleet::json::FleetJson>),
    ("import", of::<import::json::ImportJson>),
    ("learn", of::<learn::json::LearnJson>),
    ("learn --update", of::<learn::json::AddedJson>),
    ("map", of::<map::MapJson>),
    ("packet decode", of::<packet::PacketJson>),
    ("packet decode (report)", of::<packet::report::ReportJson>),
    ("packet encode", of::<packet::EncodedJson>),
    ("packet schema", of::<packet::schema::SchemaJson>),
    ("plan gateway", of::<plan::gateway::GatewayJson>),
    ("plan standoff", of::<plan::standoff::StandoffJson>),
    ("plan track", of::<plan::track::TrackJson>),
    ("predict", of::<predict::PredictionsJson>),
    ("replay", of::<replay::json::ReplayJson>),
    ("replay --online", of::<replay::online::OnlineJson>),
    ("reproduce", of::<reproduce::json::ReproductionJson>),
    ("select", of::<select::SelectedJson>),
    ("simulate", of::<simulate::SimulatedJson>),
    ("store check", of::<store::check::StoreJson>),
    ("team", of::<team::TeamJson>),
    (INPUT, || SchemaSettings::default().for_deserialize().into_generator().into_root_schema_for::<Input>()),
    (MESSAGE, || SchemaSettings::default().for_serialize().into_generator().into_root_schema_for::<Message>()),
];

impl Options {
    pub fn threads(&self) -> usize {
        1
    }

    pub fn run(&self, results: Results) -> anyhow::Result<()> {
        let Some(name) = &self.command else {
            let names: Vec<&str> = SCHEMAS.iter().map(|(name, _)| *name).collect();
            return print(results, &names.join("\n"));
        };
        let found = SCHEMAS.iter().find(|(known, _)| known == name);
        let (_, schema) = found.ok_or_else(|| BadInput(format!("no command {name} prints JSON")))?;
        let mut schema = schema();
        schema.insert("title".into(), format!("pingmap {name}").into());
        let description = match name.as_str() {
            INPUT => "One line from the host to pingmap vehicle.".to_owned(),
            MESSAGE => "One line from pingmap vehicle to the host.".to_owned(),
            _ => format!("Output of pingmap {name} with --json."),
        };
        schema.insert("description".into(), description.into());
        print(results, &serde_json::to_string_pretty(&schema)?)
    }
}

/// Returns the schema of a type, with the fields that all outputs have.
fn of<T: JsonSchema>() -> Schema {
    let mut schema = SchemaSettings::default().for_serialize().into_generator().into_root_schema_for::<T>();
    let of_all = [
        ("version", json!({"type": "string", "description": "Version of pingmap."})),
        (
            "command",
            json!({"type": "array", "items": {"type": "string"}, "description": "The command line that printed the object."}),
        ),
    ];
    for (name, property) in of_all {
        if let Some(properties) = schema.get_mut("properties").and_then(|properties| properties.as_object_mut()) {
            properties.insert(name.to_owned(), property);
        }
        if let Some(required) = schema.get_mut("required").and_then(|required| required.as_array_mut()) {
            required.push(name.into());
        }
    }
    schema
}
