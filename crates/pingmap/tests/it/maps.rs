//! `pingmap map`: every output format, positions and values.

use std::io::{Cursor, Write as _};
use std::path::Path;
use std::process::Command;

use crate::common::{QUICK, file, json, learn, log, opened_by_others, pingmap, stderr, stdout};
use serde_json::Value;
use tiff::decoder::{Decoder, DecodingResult};
use tiff::tags::Tag;

/// Options of every map in these tests, for a short computing time.
const COARSE: &[&str] = &["--cell-m", "50", "--overwrite"];

const MODEL: &[&str] = &["--model", "model.toml"];

/// Latitude and longitude of (0, 0) in these tests.
const ORIGIN: (f64, f64) = (42.3, -70.9);

/// Returns a folder with a log that has an origin, and a model.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let (latitude, longitude) = ORIGIN;
    file(folder.path(), "events.csv", format!("# reference system: {latitude},{longitude}\n{}", log(&["a", "b"], 120)));
    learn(folder.path(), QUICK, "model.toml");
    folder
}

fn draw(folder: &Path, arguments: &[&str]) -> Value {
    draw_with(folder, MODEL, arguments)
}

fn draw_with(folder: &Path, model: &[&str], arguments: &[&str]) -> Value {
    json(folder, &[&["map", "events.csv"], arguments, model, COARSE, &["--json"]].concat())
}

fn read(folder: &Path, name: &str) -> Vec<u8> {
    std::fs::read(folder.join(name)).unwrap()
}

/// Returns metres east and north of the origin by the radii of curvature of the ellipsoid. The error within two
/// kilometres is below a decimetre.
fn metres((latitude_deg, longitude_deg): (f64, f64)) -> (f64, f64) {
    let (a, f) = (6_378_137.0, 1.0 / 298.257_223_563);
    let e2: f64 = f * (2.0 - f);
    let at = |latitude_deg: f64| {
        let sin = latitude_deg.to_radians().sin();
        let w = (1.0 - e2 * sin * sin).sqrt();
        (a * (1.0 - e2) / w.powi(3), a / w)
    };
    // The meridian is evaluated at the middle latitude, the parallel at the latitude of the position.
    let (meridional, _) = at((latitude_deg + ORIGIN.0) / 2.0);
    let (_, normal) = at(latitude_deg);
    let (dlat, dlon) = ((latitude_deg - ORIGIN.0).to_radians(), (longitude_deg - ORIGIN.1).to_radians());
    let (sin, cos) = latitude_deg.to_radians().sin_cos();
    // The last term is the curvature of the parallel.
    (normal * cos * dlon, meridional * dlat + normal * sin * cos * dlon * dlon / 2.0)
}

/// Parses a table into its header and its rows.
fn columns(text: &str) -> (Vec<&str>, Vec<Vec<f64>>) {
    let mut lines = text.lines();
    let header = lines.next().unwrap().split(',').collect();
    (header, lines.map(|line| line.split(',').map(|field| field.parse().unwrap()).collect()).collect())
}

#[test]
fn the_grid_contains_metres_degrees_and_predictions() {
    let folder = folder();
    let described = draw(folder.path(), &["--at", "500,200", "-o", "map.csv", "--as", "both"]);
    let grid = String::from_utf8(read(folder.path(), "map.csv")).unwrap();
    let (header, rows) = columns(&grid);
    let message =
        ["easting_m", "northing_m", "latitude_deg", "longitude_deg", "tx_probability", "tx_lower", "tx_upper"];
    assert_eq!(header[..7], message);
    assert_eq!(header[7..], ["tx_explained", "rx_probability", "rx_lower", "rx_upper", "rx_explained"]);
    let number = |key: &str| described[key].as_u64().unwrap() as usize;
    assert_eq!(rows.len(), number("columns") * number("rows"));
    for row in &rows {
        let (east_m, north_m) = metres((row[2], row[3]));
        assert!((east_m - row[0]).hypot(north_m - row[1]) < 1.0, "{row:?}: {east_m} {north_m}");
        for side in [&row[4..8], &row[8..12]] {
            let [probability, lower, upper, explained] = side else { panic!("{row:?}") };
            assert!(0.0 <= *lower && lower <= probability && probability <= upper && *upper <= 1.0, "{row:?}");
            assert!((0.0..=1.0).contains(explained), "{row:?}");
        }
    }
    // The explained share is large near events and small in the far corner.
    let explained = |east_m: f64, north_m: f64| {
        let away = |row: &&Vec<f64>| (row[0] - east_m).hypot(row[1] - north_m);
        rows.iter().min_by(|a, b| away(a).total_cmp(&away(b))).unwrap()[7]
    };
    assert!(explained(500.0, 600.0) > explained(0.0, 900.0), "{} {}", explained(500.0, 600.0), explained(0.0, 900.0));
    // The printed median width is that of the cells.
    let mut widths: Vec<f64> = rows.iter().map(|row| row[6] - row[5]).collect();
    widths.sort_by(f64::total_cmp);
    assert!((described["interval_width"].as_f64().unwrap() - widths[widths.len() / 2]).abs() < 1e-12);
    assert_eq!(described["reference_system"], "42.3,-70.9");
}

#[test]
fn places_in_degrees_and_in_metres_give_the_same_map() {
    let folder = folder();
    let shares = |at: &str| draw(folder.path(), &["--at", at, "-o", "map.csv"])["share_above"].clone();
    draw(folder.path(), &["--at", "42.3N,70.9W", "-o", "map.csv"]);
    let degrees = read(folder.path(), "map.csv");
    draw(folder.path(), &["--at", "0,0", "-o", "map.csv"]);
    assert_eq!(degrees, read(folder.path(), "map.csv"));
    assert_ne!(shares("0,0"), shares("500,200"));
    let within = draw(folder.path(), &["--at", "500,200", "--bounds", "100,0,600,250", "-o", "map.csv"]);
    assert_eq!((&within["columns"], &within["rows"]), (&Value::from(10), &Value::from(5)));
    assert_eq!((&within["east_m"][0], &within["north_m"][1]), (&Value::from(100.0), &Value::from(250.0)));
    // An origin that differs from that of the log is refused.
    let other = pingmap(folder.path(), &["map", "events.csv", "--at", "0,0", "--origin", "42,-70"]);
    assert!(other.status.code() == Some(2) && stderr(&other).contains("42.3,-70.9"), "{}", stderr(&other));
}

#[test]
fn joined_directions_and_places_are_bounds() {
    let folder = folder();
    learn(folder.path(), &[QUICK, &["--reciprocal", "no"]].concat(), "one-way.toml");
    let probabilities = |more: &[&str]| -> Vec<f64> {
        draw_with(folder.path(), &["--model", "one-way.toml"], &[&["-o", "map.csv"], more].concat());
        let text = String::from_utf8(read(folder.path(), "map.csv")).unwrap();
        columns(&text).1.iter().map(|row| row[4]).collect()
    };
    let holds = |a: &[f64], b: &[f64], what: &str| {
        assert!(a.iter().zip(b).all(|(a, b)| *a <= b + 1e-9), "{what}");
        assert!(a.iter().zip(b).any(|(a, b)| *a < b - 1e-3), "{what}: never less");
    };
    let at = ["--at", "500,200"];
    let (tx, rx) = (probabilities(&at), probabilities(&[&at[..], &["--as", "rx"]].concat()));
    let worst = probabilities(&[&at[..], &["--as", "worst"]].concat());
    assert!(worst.iter().zip(tx.iter().zip(&rx)).all(|(worst, (tx, rx))| (worst - tx.min(*rx)).abs() < 1e-12));
    let other = probabilities(&["--at", "100,700"]);
    let both = ["--at", "500,200", "--at", "100,700"];
    // The first place alone is mapped over the area of both places.
    let first = probabilities(&[&at[..], &["--bounds", "0,0,1000,900"]].concat());
    let (all, any) = (
        probabilities(&[&both[..], &["--bounds", "0,0,1000,900"]].concat()),
        probabilities(&[&both[..], &["--bounds", "0,0,1000,900", "--join", "any"]].concat()),
    );
    holds(&all, &first, "all of two places against one");
    holds(&first, &any, "one place against any of two");
    assert!(!other.is_empty());
}

#[test]
fn pictures_contain_their_labels() {
    let folder = folder();
    draw(folder.path(), &["--at", "500,200", "-o", "map.png", "--layers", "probability,width"]);
    assert!(read(folder.path(), "map.png").starts_with(b"\x89PNG"));
    let svg_with = |model: &[&str], more: &[&str]| {
        draw_with(folder.path(), model, &[&["--at", "500,200", "-o", "map.svg"], more].concat());
        String::from_utf8(read(folder.path(), "map.svg")).unwrap()
    };
    let svg = |more: &[&str]| svg_with(MODEL, more);
    learn(folder.path(), &[QUICK, &["--length-scale-m", "200"]].concat(), "short.toml");
    let plain = svg_with(&["--model", "short.toml"], &["--as", "rx", "--bounds=-1000,-1000,2500,2500"]);
    for message in [
        "receiver",
        "not known: interval wider than 0.5",
        "probability",
        "distance, every",
        "42°18",
        "70°54",
        "500 m",
        "viewBox",
    ] {
        assert!(plain.contains(message), "no {message}");
    }
    assert!(!plain.contains("rotate(-90"), "letters stand upright");
    let titled =
        svg(&["--title", "Bay & <quay>", "--with-events", "--levels", "0.25,0.75", "--layers", "probability,lower"]);
    for message in ["Bay &amp; &lt;quay&gt;", "heard, sent within", "missed, sent within", "contour 0.25", "lower end"]
    {
        assert!(titled.contains(message), "no {message}");
    }
    assert!(!titled.contains("contour 0.9"), "a contour that was not requested");
    // Long names are truncated.
    let long = "n".repeat(5000);
    file(folder.path(), "events.csv", log(&[&long, "b"], 60));
    let named = svg(&[]);
    assert!(named.contains(&format!("{}…", "n".repeat(19))) && !named.contains(&"n".repeat(60)));
}

/// Draws a map as a table. Returns its description, and easting, northing, lower and upper end of each cell.
fn cells(folder: &Path, arguments: &[&str]) -> (Value, Vec<[f64; 4]>) {
    let described = draw(folder, &[&["-o", "map.csv"], arguments].concat());
    let text = String::from_utf8(read(folder, "map.csv")).unwrap();
    let rows = columns(&text).1;
    (described, rows.iter().map(|row| [row[0], row[1], row[5], row[6]]).collect())
}

#[test]
fn cells_with_a_wide_interval_are_not_known() {
    let folder = folder();
    let share = |width: &str| {
        let (described, cells) = cells(folder.path(), &["--at", "500,200", "--hatch-width", width]);
        let wide = cells.iter().filter(|[.., lower, upper]| upper - lower > width.parse().unwrap()).count();
        let share = described["sides"][0]["share_not_known"].as_f64().unwrap();
        assert!((share - wide as f64 / cells.len() as f64).abs() < 1e-12, "{width}: {share}");
        share
    };
    let (many, few) = (share("0.2"), share("0.8"));
    assert!(many > few, "{many} {few}");
    // The same area is in the vector formats.
    draw(folder.path(), &["--at", "500,200", "--hatch-width", "0.2", "-o", "map.geojson"]);
    let map: Value = serde_json::from_slice(&read(folder.path(), "map.geojson")).unwrap();
    let is_unknown = |feature: &&Value| feature["properties"]["kind"] == "not_known";
    let unknown: Vec<&Value> = map["features"].as_array().unwrap().iter().filter(is_unknown).collect();
    assert!(unknown.len() == 1 && unknown[0]["properties"]["interval_wider_than"] == 0.2, "{unknown:?}");
    draw(folder.path(), &["--at", "500,200", "--hatch-width", "0.2", "-o", "map.kml"]);
    let kml = String::from_utf8(read(folder.path(), "map.kml")).unwrap();
    for message in ["not known: interval wider than 0.2", "0.5 by lower", "0.5 by upper"] {
        assert!(kml.contains(message), "no {message}");
    }
}

#[test]
fn the_stated_range_is_that_of_the_cells() {
    let folder = folder();
    let (described, cells) = cells(folder.path(), &["--at", "500,200", "--levels", "0.2,0.6"]);
    let reach = &described["sides"][0]["reach"];
    let yes_m = reach["yes_within_m"].as_f64().unwrap();
    let no_m = reach["no_beyond_m"].as_f64().unwrap_or(f64::INFINITY);
    assert_eq!(reach["probability"], 0.6);
    for [x, y, lower, upper] in &cells {
        let range_m = (x - 500.0).hypot(y - 200.0);
        assert!(range_m > yes_m || *lower >= 0.6, "{range_m} m: {lower}, {reach}");
        assert!(range_m < no_m || *upper < 0.6, "{range_m} m: {upper}, {reach}");
    }
    assert!(yes_m < no_m);
}

#[test]
fn a_place_far_from_all_data_is_not_known() {
    let folder = folder();
    let arguments = ["map", "events.csv", "--at", "9000,9000", "--bounds", "8500,8500,9500,9500", "--json"];
    let output = pingmap(folder.path(), &[&arguments[..], MODEL, COARSE, &["-o", "map.csv"]].concat());
    assert!(stderr(&output).contains("Not known: (9000, 9000) is "), "{}", stderr(&output));
    let described: Value = serde_json::from_str(&stdout(&output)).unwrap();
    assert_eq!(described["sides"][0]["share_not_known"], 1.0);
    // `predict` gives the same interval.
    file(
        folder.path(),
        "links.csv",
        "tx_easting_m,tx_northing_m,rx_easting_m,rx_northing_m\n9000,9000,9010,9000\n500,200,500,300\n",
    );
    let predicted =
        json(folder.path(), &[&["predict", "events.csv", "--links", "links.csv", "--json"], MODEL].concat());
    let ends = |n: usize| ["lower", "upper"].map(|key| predicted["predictions"][n][key].as_f64().unwrap());
    assert_eq!(ends(0), [0.0, 1.0]);
    assert!(ends(1)[0] > 0.0 && ends(1)[1] < 1.0, "{:?}", ends(1));
}

#[test]
fn a_picture_names_its_log_place_date_and_range() {
    let folder = folder();
    let later = log(&["a", "b"], 120);
    let later = later.lines().enumerate().map(|(n, line)| match (n, line.split_once(',')) {
        (1.., Some((time, rest))) => format!("{},{rest}\n", 1_777_809_600.0 + time.parse::<f64>().unwrap()),
        _ => format!("{line}\n"),
    });
    file(folder.path(), "events.csv", later.collect::<String>());
    let words = |more: &[&str]| {
        draw(folder.path(), &[&["--at", "500,200", "-o", "map.svg"], more].concat());
        let svg = String::from_utf8(read(folder.path(), "map.svg")).unwrap();
        let texts = svg.split("<text ").skip(1).filter_map(|text| text.split_once('>')?.1.split_once("</text>"));
        texts.map(|(text, _)| text).collect::<Vec<_>>().join("\n")
    };
    let plain = words(&[]);
    for message in ["events.csv: 42°18", ", 2026-05-03", "Heard with 0.9", "200 m"] {
        assert!(plain.contains(message), "no {message}: {plain}");
    }
    // Each layer has its own title.
    let all = words(&["--layers", "probability,lower,upper,width"]);
    for message in ["Probability that", "Lower end", "Upper end", "Width"] {
        assert!(all.contains(message), "no {message}: {all}");
    }
}

#[test]
fn pictures_have_the_requested_width() {
    let folder = folder();
    let drawn = |name: &str, width_mm: &str| {
        draw(folder.path(), &["--at", "500,200", "-o", name, "--width-mm", width_mm]);
        read(folder.path(), name)
    };
    // A figure has 96 pixels an inch, so letters have the same size as on a screen.
    let pixels = |width_mm: &str| -> f64 {
        let svg = String::from_utf8(drawn("map.svg", width_mm)).unwrap();
        let head = svg.split('>').next().unwrap();
        assert!(head.contains(&format!(" width=\"{width_mm}.00mm\"")), "{head}");
        head.split("viewBox=\"0 0 ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap()
    };
    for (width_mm, expected) in [("180", 180.0), ("250", 250.0)] {
        let width = pixels(width_mm) * 25.4 / 96.0;
        assert!((width - expected).abs() < 2.0, "{width} mm for {expected}");
    }
    // The map has a minimum width.
    assert!(pixels("40") * 25.4 / 96.0 > 80.0);
    let png = drawn("map.png", "180");
    let reader = png::Decoder::new(Cursor::new(png)).read_info().unwrap();
    assert_eq!(reader.info().pixel_dims.map(|dots| dots.xppu), Some(11811), "300 dots an inch");
    assert!(reader.info().width.abs_diff(2126) <= 1, "{}", reader.info().width);
    // The command replaces its file with --overwrite.
    drawn("map.png", "90");
    let arguments = ["map", "events.csv", "--at", "500,200", "-o", "map.pdf", "--width-mm", "180"];
    let output = pingmap(folder.path(), &[&arguments[..], MODEL, COARSE].concat());
    if cfg!(feature = "pdf") {
        assert!(output.status.success(), "{}", stderr(&output));
        let pdf = String::from_utf8_lossy(&read(folder.path(), "map.pdf")).into_owned();
        assert!(pdf.starts_with("%PDF") && pdf.contains("/MediaBox [0 0 510.2"), "{}", &pdf[..2000]);
        drawn("map.pdf", "90");
    } else {
        assert_eq!(output.status.code(), Some(2));
        assert!(stderr(&output).contains("built without PDF") && !folder.path().join("map.pdf").exists());
    }
}

/// Returns all positions of some coordinates, in metres.
fn points(coordinates: &Value) -> Vec<(f64, f64)> {
    match (coordinates[0].as_f64(), coordinates[1].as_f64()) {
        (Some(longitude), Some(latitude)) => vec![metres((latitude, longitude))],
        _ => coordinates.as_array().unwrap().iter().flat_map(points).collect(),
    }
}

#[test]
fn geojson_areas_cover_the_map_once_at_its_position() {
    let folder = folder();
    draw(folder.path(), &["--at", "500,200", "-o", "map.geojson", "--levels", "0.3,0.8"]);
    let map: Value = serde_json::from_slice(&read(folder.path(), "map.geojson")).unwrap();
    let features = map["features"].as_array().unwrap();
    let of = |kind: &str| features.iter().filter(|feature| feature["properties"]["kind"] == kind).collect::<Vec<_>>();
    let place = &of("place")[0]["geometry"]["coordinates"];
    let (east_m, north_m) = metres((place[1].as_f64().unwrap(), place[0].as_f64().unwrap()));
    assert!((east_m - 500.0).hypot(north_m - 200.0) < 1.0, "{east_m} {north_m}");
    assert_eq!((of("area").len(), of("contour").len(), of("track").len()), (3, 6, 2));
    let by: Vec<&Value> = of("contour").iter().map(|contour| &contour["properties"]["by"]).collect();
    assert_eq!(by, ["probability", "probability", "lower", "lower", "upper", "upper"]);
    // The areas sum to the area of the map. Rings are counter-clockwise and holes clockwise.
    let mut whole_m2 = 0.0;
    for area in of("area") {
        for polygon in area["geometry"]["coordinates"].as_array().unwrap() {
            for (n, ring) in polygon.as_array().unwrap().iter().enumerate() {
                let corner = |at: &Value| metres((at[1].as_f64().unwrap(), at[0].as_f64().unwrap()));
                let corners: Vec<(f64, f64)> = ring.as_array().unwrap().iter().map(corner).collect();
                assert_eq!(corners.first(), corners.last());
                let area_m2: f64 =
                    corners.windows(2).map(|pair| pair[0].0 * pair[1].1 - pair[1].0 * pair[0].1).sum::<f64>() / 2.0;
                assert!((area_m2 > 0.0) == (n == 0), "ring {n}: {area_m2}");
                whole_m2 += area_m2;
            }
        }
    }
    // Contours are the edges of areas.
    let near = |line: &Value, area: &Value| {
        let (a, b) = (points(line), points(area));
        a.iter().filter(|p| b.iter().any(|q| (p.0 - q.0).hypot(p.1 - q.1) < 15.0)).count() as f64 / a.len() as f64
    };
    let contour = &of("contour")[0]["geometry"]["coordinates"];
    let share = near(contour, &of("area")[0]["geometry"]["coordinates"]);
    assert!(share > 0.9, "{share} of the contour of 0.3 is near the edge of the area below it");
    let described = draw(folder.path(), &["--at", "500,200", "-o", "map.csv"]);
    let side = |key: &str| described[key][1].as_f64().unwrap() - described[key][0].as_f64().unwrap();
    let exact_m2 = side("east_m") * side("north_m");
    assert!((whole_m2 / exact_m2 - 1.0).abs() < 0.02, "{whole_m2} of {exact_m2}");
}

#[test]
fn a_geotiff_has_the_cells_and_the_position_of_the_map() {
    let folder = folder();
    let described = draw(folder.path(), &["--at", "500,200", "-o", "map.tif"]);
    draw(folder.path(), &["--at", "500,200", "-o", "map.csv"]);
    let bytes = read(folder.path(), "map.tif");
    let mut decoder = Decoder::new(Cursor::new(&bytes)).unwrap();
    let (columns_wide, rows_high) = decoder.dimensions().unwrap();
    assert_eq!(
        (u64::from(columns_wide), u64::from(rows_high)),
        (described["columns"].as_u64().unwrap(), described["rows"].as_u64().unwrap())
    );
    assert_eq!(decoder.get_tag_f64_vec(Tag::ModelPixelScaleTag).unwrap(), [50.0, 50.0, 0.0]);
    let corner = decoder.get_tag_f64_vec(Tag::ModelTiepointTag).unwrap();
    assert_eq!(
        (corner[3], corner[4]),
        (described["east_m"][0].as_f64().unwrap(), described["north_m"][1].as_f64().unwrap())
    );
    assert_eq!(decoder.get_tag_f64_vec(Tag::GeoDoubleParamsTag).unwrap()[..2], [-70.9, 42.3]);
    let DecodingResult::F32(pixels) = decoder.read_image().unwrap() else { panic!("32-bit numbers") };
    let text = String::from_utf8(read(folder.path(), "map.csv")).unwrap();
    let (_, rows) = columns(&text);
    // The first pixel is in the north-west, and the first row of the table in the south-west.
    let north_west = &rows[(rows_high as usize - 1) * columns_wide as usize];
    assert!(pixels[..4].iter().zip(&north_west[4..]).all(|(a, b)| (f64::from(*a) - b).abs() < 1e-6));
}

/// Returns the output of an installed program, or prints that the check is skipped.
fn output_of(program: &str, arguments: &[&str], folder: &Path) -> Option<String> {
    let Ok(output) = Command::new(program).args(arguments).current_dir(folder).output() else {
        let message = format!("skipped: there is no {program}\n");
        std::io::stderr().write_all(message.as_bytes()).unwrap();
        return None;
    };
    assert!(output.status.success(), "{program} {arguments:?}: {}", stderr(&output));
    Some(stdout(&output) + &stderr(&output))
}

#[test]
fn other_programs_open_maps() {
    let folder = folder();
    for name in ["map.tif", "map.geojson", "map.kml"] {
        draw(folder.path(), &["--at", "500,200", "--bounds", "0,0,1000,1000", "-o", name]);
    }
    if let Some(message) = output_of("gdalinfo", &["map.tif"], folder.path()) {
        assert!(
            message.contains("Transverse")
                && message.contains("Description = probability")
                && !message.contains("ERROR"),
            "{message}"
        );
        // Upper left corner in degrees, minutes and seconds: 1000 m north of the origin.
        assert!(message.contains("70d54' 0.00\"W, 42d18'32."), "{message}");
    }
    for (name, layer) in [("map.geojson", "map"), ("map.kml", "Tracks")] {
        if let Some(message) = output_of("ogrinfo", &["-al", "-so", name], folder.path()) {
            assert!(message.contains(layer) && !message.contains("ERROR") && !message.contains("Warning"), "{message}");
            let features: u32 = message
                .lines()
                .filter_map(|line| line.strip_prefix("Feature Count: ")?.trim().parse::<u32>().ok())
                .sum();
            assert!(features >= 6, "{message}");
        }
    }
    if let Some(message) = opened_by_others(folder.path(), &["map.tif", "map.geojson", "map.kml"]) {
        let grid = &message["map.tif"];
        let first = ["degrees", "metres"].map(|key| [0, 1].map(|n: usize| grid[key][n].as_f64().unwrap()));
        let [[longitude, latitude], [east_m, north_m]] = first;
        // PROJ and the ellipsoid give the same centre of the north-western cell.
        let (x_m, y_m) = metres((latitude, longitude));
        assert!((x_m - east_m).hypot(y_m - north_m) < 1.0 && (east_m, north_m) == (25.0, 975.0), "{grid}");
        assert_eq!(grid["bands"], serde_json::json!(["probability", "lower", "upper", "explained"]));
        assert_eq!(message["map.kml"]["schema_errors"], serde_json::json!([]));
        let shapes = |layer: &Value| layer["shapes"].as_u64().unwrap();
        for name in ["map.geojson", "map.kml"] {
            let layers = message[name]["layers"].as_object().unwrap();
            assert!(layers.values().map(shapes).sum::<u64>() >= 6, "{name}: {layers:?}");
        }
    }
    let kml = String::from_utf8(read(folder.path(), "map.kml")).unwrap();
    // The standard prescribes the order of elements.
    for placemark in kml.split("<Placemark>").skip(1).filter(|placemark| placemark.contains("<styleUrl>")) {
        let shape =
            ["<MultiGeometry>", "<Polygon>", "<LineString>"].iter().filter_map(|shape| placemark.find(shape)).min();
        assert!(shape.is_some() && placemark.find("<styleUrl>") < shape, "{placemark}");
    }
    assert!(kml.contains("<styleUrl>#"));
    let parsed: kml::Kml<f64> = kml.parse().unwrap();
    assert!(
        matches!(parsed, kml::Kml::KmlDocument(_))
            && kml.contains("<outerBoundaryIs>")
            && kml.contains("<name>a</name>")
    );
}

#[test]
fn a_map_has_the_digest_of_the_whole_log_and_refuses_distant_places() {
    let folder = folder();
    let digest = |command: &[&str]| json(folder.path(), command)["log_digest"].as_str().unwrap().to_owned();
    let whole = digest(&["check", "events.csv", "--json"]);
    let of_part = [&["map", "events.csv", "--at", "0,0", "--events-max", "50"], MODEL, COARSE, &["--json"]].concat();
    assert_eq!(digest(&of_part), whole);
    // A place in another hemisphere is refused.
    let (latitude, longitude) = ORIGIN;
    let at = format!("{latitude}N,{}E", longitude.abs());
    let output = pingmap(folder.path(), &["map", "events.csv", "--at", &at, "--overwrite"]);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(2) && message.contains("--at") && message.contains("100 km"), "{message}");
    // A large file is replaced with --overwrite only.
    let geojson = ["-o", "map.geojson", "--at", "500,200", "--cell-m", "12", "--as", "both"];
    let levels = ["--levels", ".05,.1,.15,.2,.25,.3,.35,.4,.45,.5,.55,.6,.65,.7,.75,.8,.85,.9,.95", "--json"];
    let large = [&["map", "events.csv"], &geojson[..], MODEL, &levels].concat();
    json(folder.path(), &large);
    assert!(read(folder.path(), "map.geojson").len() > 1 << 20);
    assert_eq!(pingmap(folder.path(), &large).status.code(), Some(2));
    json(folder.path(), &[&large[..], &["--overwrite"]].concat());
}

#[test]
fn a_log_in_utm_coordinates_has_correct_degrees() {
    let folder = tempfile::tempdir().unwrap();
    // 42.3 N, 69 W is on the central meridian of zone 19.
    let plain = log(&["a", "b"], 60);
    let shifted = plain.lines().enumerate().map(|(n, line)| {
        if n == 0 {
            return format!("{line}\n");
        }
        let fields: Vec<&str> = line.split(',').collect();
        let at = |n: usize, by: f64| fields[n].parse::<f64>().unwrap() + by;
        let places =
            [at(3, 500_000.0), at(4, 4_683_000.0), at(5, 500_000.0), at(6, 4_683_000.0)].map(|m| m.to_string());
        format!("{},{},{}\n", fields[..3].join(","), places.join(","), fields[7])
    });
    file(folder.path(), "events.csv", shifted.collect::<String>());
    learn(folder.path(), QUICK, "model.toml");
    draw(folder.path(), &["--at", "500500,4683200", "--crs", "EPSG:32619", "-o", "map.csv"]);
    let text = String::from_utf8(read(folder.path(), "map.csv")).unwrap();
    let (_, rows) = columns(&text);
    // The width of a cell is 50 m / .9996 on the ground.
    let (a, b) = (&rows[0], &rows[1]);
    let parallel_m =
        6_378_137.0 * a[2].to_radians().cos() / (1.0 - 0.006_694_38 * a[2].to_radians().sin().powi(2)).sqrt();
    assert!(((b[3] - a[3]).to_radians() * parallel_m - 50.0 / 0.9996).abs() < 0.05, "{a:?} {b:?}");
    draw(folder.path(), &["--at", "500500,4683200", "--crs", "EPSG:32619", "-o", "map.tif"]);
    if let Some(message) = output_of("gdalinfo", &["map.tif"], folder.path()) {
        assert!(message.contains("UTM zone 19N") && message.contains("69d"), "{message}");
    }
}

/// Places of the first picture of README.md, in metres east and north, with the probability that it shows there.
const README_PLACES: [(f64, f64, f64); 9] = [
    (199.5, 199.5, 0.984),
    (199.5, 694.5, 0.992),
    (199.5, 1200.5, 0.868),
    (694.5, 199.5, 0.998),
    (694.5, 694.5, 1.0),
    (694.5, 1200.5, 0.964),
    (1200.5, 199.5, 0.556),
    (1200.5, 694.5, 0.656),
    (1200.5, 1200.5, 0.108),
];

#[test]
fn the_first_picture_of_the_readme_shows_these_probabilities() {
    let folder = tempfile::tempdir().unwrap();
    let log = Path::new(env!("CARGO_MANIFEST_DIR")).join("../trial/data/bay3.csv");
    // The command of docs/make-pictures.
    let log = log.to_str().unwrap();
    let drawn = pingmap(folder.path(), &["map", log, "--at", "700,510", "-o", "map.csv"]);
    assert!(drawn.status.success(), "{}", stderr(&drawn));
    let table = String::from_utf8(read(folder.path(), "map.csv")).unwrap();
    let cells: Vec<Vec<f64>> =
        table.lines().skip(1).map(|line| line.split(',').map(|field| field.parse().unwrap()).collect()).collect();
    for (east_m, north_m, expected) in README_PLACES {
        let distance_m = |cell: &Vec<f64>| (cell[0] - east_m).hypot(cell[1] - north_m);
        let nearest = cells.iter().min_by(|a, b| distance_m(a).total_cmp(&distance_m(b))).unwrap();
        assert!(distance_m(nearest) < 1.0 && (nearest[2] - expected).abs() < 0.03, "{nearest:?}: {expected}");
    }
}
