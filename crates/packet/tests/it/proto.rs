//! The `.proto` file of the crate matches the schemas, and every form of the map message fits its frame.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use pingmap_packet::{
    Field, Kind, LAYOUTS, Layout, OUTCOME_BYTES_MAX, OutcomeCounts, PROTO, REPORT_LAYOUTS, ReportLayout, Rule, Schema,
    WAYPOINTS_MAX,
};

use crate::golden;

/// The text between the comment at the top and the messages.
const HEADER: &str = r#"syntax = "proto2";

import "dccl/option_extensions.proto";

package pingmap;
"#;

#[test]
fn the_proto_file_matches_the_schemas() {
    let maps = LAYOUTS.iter().map(|layout| format!("\n{}", rendered(layout)));
    let reports = REPORT_LAYOUTS.iter().map(|layout| format!("\n{}", rendered_report(layout)));
    let comment = &PROTO[..PROTO.find("syntax").unwrap()];
    golden::check("proto/pingmap.proto", &(comment.to_owned() + HEADER + &maps.chain(reports).collect::<String>()));
}

/// A form of the map message as proto2 text.
fn rendered(layout: &Layout) -> String {
    let schema = layout.schema();
    let blocks = if layout.blocks == 1 { "block" } else { "blocks" };
    let depth = if layout.has_depth { "with" } else { "without" };
    let form = if layout.is_authenticated { "authenticated" } else { "plain" };
    let mut text = format!(
        "// {} bytes, {depth} depth, {form}: {} {blocks} of {} points.\n",
        layout.frame_bytes, layout.blocks, layout.points
    );
    text += &rendered_schema(&schema);
    text
}

/// A form of the report as proto2 text.
fn rendered_report(layout: &ReportLayout) -> String {
    let depth = if layout.has_depth { "with" } else { "without" };
    let form = if layout.is_authenticated { "authenticated" } else { "plain" };
    format!("// Any length, {depth} depth, {form}.\n") + &rendered_schema(&layout.schema())
}

fn rendered_schema(schema: &Schema) -> String {
    let id = schema.id.unwrap();
    let mut text = format!("message {} {{\n", schema.name);
    writeln!(text, "  option (dccl.msg) = {{ codec_version: 4 id: {id} max_bytes: {} }};", schema.bytes_max).unwrap();
    for field in &schema.fields {
        if let Kind::Message(inside) = &field.kind {
            writeln!(text, "  message {} {{", capital(&field.name)).unwrap();
            for (place, field) in inside.iter().enumerate() {
                writeln!(text, "    {}", rendered_field(field, place + 1)).unwrap();
            }
            text += "  }\n";
        }
    }
    for (place, field) in schema.fields.iter().enumerate() {
        writeln!(text, "  {}", rendered_field(field, place + 1)).unwrap();
    }
    text + "}\n"
}

fn capital(name: &str) -> String {
    name[..1].to_uppercase() + &name[1..]
}

fn rendered_field(field: &Field, tag: usize) -> String {
    assert!(!field.presence && field.oneof.is_none());
    let (kind, mut options) = match &field.kind {
        Kind::Number(number) => {
            assert!(number.integer && number.resolution == 1.0);
            let kind = if number.min >= 0.0 { "uint32" } else { "int32" };
            (kind.to_owned(), vec![format!("min: {} max: {}", number.min, number.max)])
        }
        Kind::Bool => ("bool".to_owned(), vec![]),
        Kind::Bytes { length_max } => ("bytes".to_owned(), vec![format!("max_length: {length_max}")]),
        Kind::Message(_) => (capital(&field.name), vec![]),
        other => panic!("{}: no message of this crate has a field of kind {other:?}", field.name),
    };
    let rule = match field.rule {
        Rule::Required => "required",
        Rule::Optional => "optional",
        Rule::Repeated { min, max } => {
            options.push(format!("min_repeat: {min} max_repeat: {max}"));
            "repeated"
        }
    };
    if field.in_head {
        options.push("in_head: true".to_owned());
    }
    let options = options.join(" ");
    let options = if options.is_empty() { options } else { format!(" [(dccl.field) = {{ {options} }}]") };
    format!("{rule} {kind} {} = {tag}{options};", field.name)
}

#[test]
fn every_form_fits_its_frame() {
    for layout in &LAYOUTS {
        let schema = layout.schema();
        assert_eq!(schema.check(), Ok(()), "{}", layout.name);
        assert!(schema.length() <= layout.frame_bytes, "{}", layout.name);
        assert!(id_bits(layout) + field_bits(layout) <= 8 * layout.frame_bytes, "{}", layout.name);
        assert_eq!(schema.bytes_max, layout.frame_bytes, "{}", layout.name);
    }
}

#[test]
fn report_schemas_are_valid_and_have_the_counted_length() {
    for layout in &REPORT_LAYOUTS {
        let schema = layout.schema();
        assert_eq!(schema.check(), Ok(()), "{}", layout.name);
        let outcomes = OutcomeCounts { reported: 8 * OUTCOME_BYTES_MAX, unreported: 0 };
        assert_eq!(layout.length(outcomes, WAYPOINTS_MAX), schema.length(), "{}", layout.name);
    }
}

/// Fields that do not belong to points.
const OVERHEAD: [&str; 5] = ["sender", "counter", "model", "tag_low", "tag_high"];

/// Lengths are computed without building the schema.
#[test]
fn lengths_equal_those_of_the_schema() {
    for layout in &LAYOUTS {
        for blocks in [0, 1, layout.blocks, 20] {
            for points in [0, 1, layout.points, 9] {
                let layout = Layout { blocks, points, ..*layout };
                let schema = layout.schema();
                assert_eq!(layout.length(), schema.length(), "{layout:?}");
                let bits_of = |is_wanted: fn(&str) -> bool| -> u64 {
                    schema.bits().iter().filter(|(name, _)| is_wanted(name)).map(|(_, bits)| bits).sum()
                };
                let overhead = bits_of(|name| OVERHEAD.contains(&name));
                assert_eq!(layout.overhead_bits(), schema.id_bits() + overhead, "{layout:?}");
                let locations = bits_of(|name| name.starts_with("tx_") || name.starts_with("rx_"));
                assert_eq!(layout.location_bits() * layout.points_in_all() as u64, locations, "{layout:?}");
            }
        }
    }
    let largest = Layout { blocks: usize::MAX, points: usize::MAX, ..LAYOUTS[0] };
    assert!(largest.length() > LAYOUTS[0].length());
}

#[test]
fn no_form_has_room_for_another_block_or_larger_blocks() {
    for layout in &LAYOUTS {
        let more_blocks = Layout { blocks: layout.blocks + 1, ..*layout };
        let more_points = Layout { points: layout.points + 1, ..*layout };
        for larger in [more_blocks, more_points] {
            assert!(larger.schema().length() > layout.frame_bytes, "{} has room for {larger:?}", layout.name);
        }
    }
}

#[test]
fn forms_for_32_bytes_leave_few_bits_unused() {
    let unused = |layout: &Layout| 8 * layout.frame_bytes - id_bits(layout) - field_bits(layout);
    let unused = LAYOUTS.iter().filter(|layout| layout.frame_bytes == 32).map(|layout| (layout.name, unused(layout)));
    let expected = [("Map32", 4), ("MapAuthenticated32", 0), ("MapDepth32", 10), ("MapDepthAuthenticated32", 13)];
    assert_eq!(unused.collect::<Vec<_>>(), expected);
}

#[test]
fn forms_for_32_bytes_have_3_to_5_points() {
    let points = |has_depth, is_authenticated| Layout::for_frame(32, has_depth, is_authenticated).unwrap().points;
    assert_eq!(points(false, false), 5);
    assert_eq!(points(false, true), 4);
    assert!(points(true, false) < points(false, false));
    assert!(points(true, true) < points(false, true));
}

#[test]
fn ids_are_distinct_and_in_the_private_range() {
    let maps = LAYOUTS.iter().map(|layout| (layout.id, layout.name));
    let reports = REPORT_LAYOUTS.iter().map(|layout| (layout.id, layout.name));
    let (ids, names): (BTreeSet<u16>, BTreeSet<&str>) = maps.chain(reports).unzip();
    let all = LAYOUTS.len() + REPORT_LAYOUTS.len();
    assert_eq!((ids.len(), names.len()), (all, all));
    assert!(ids.iter().all(|id| (124..=255).contains(id)), "{ids:?}");
}

#[test]
fn the_largest_form_that_fits_is_chosen() {
    for layout in &LAYOUTS {
        let chosen = |frame_bytes| Layout::for_frame(frame_bytes, layout.has_depth, layout.is_authenticated);
        assert_eq!(chosen(layout.frame_bytes), Some(layout));
        assert_eq!(chosen(layout.frame_bytes + 1), Some(layout));
        assert_ne!(chosen(layout.frame_bytes - 1), Some(layout));
    }
    assert_eq!(Layout::for_frame(31, false, false), None);
}

fn id_bits(layout: &Layout) -> usize {
    if layout.id < 128 { 8 } else { 16 }
}

fn field_bits(layout: &Layout) -> usize {
    layout.schema().bits().iter().map(|(_, bits)| *bits as usize).sum()
}
