//! Maps in every form, and where things are on them.

#![allow(clippy::unwrap_used)]

mod common;

use std::io::{Cursor, Write as _};
use std::path::Path;
use std::process::Command;

use common::{file, json, log, opened_by_others, pingmap, stderr, stdout};
use serde_json::Value;
use tiff::decoder::{Decoder, DecodingResult};
use tiff::tags::Tag;

/// What stands beside every map of these tests: quick to learn with.
const QUICK: &[&str] = &["--terms", "path", "--additions", "none", "--kernel", "matern32", "--cell-m", "50"];

/// (0, 0) of the log of these tests.
const ORIGIN: (f64, f64) = (42.3, -70.9);

/// A folder with a log that knows where it is.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let (latitude, longitude) = ORIGIN;
    file(folder.path(), "events.csv", format!("# reference system: {latitude},{longitude}\n{}", log(&["a", "b"], 120)));
    folder
}

fn draw(folder: &Path, arguments: &[&str]) -> Value {
    json(folder, &[&["map", "events.csv"], arguments, QUICK, &["--json"]].concat())
}

fn read(folder: &Path, name: &str) -> Vec<u8> {
    std::fs::read(folder.join(name)).unwrap()
}

/// Metres east and north of the origin by the radii of curvature of the ellipsoid there: no projection, and right to a decimetre within
/// two kilometres.
fn metres((latitude_deg, longitude_deg): (f64, f64)) -> (f64, f64) {
    let (a, f) = (6_378_137.0, 1.0 / 298.257_223_563);
    let e2: f64 = f * (2.0 - f);
    let at = |latitude_deg: f64| {
        let sin = latitude_deg.to_radians().sin();
        let w = (1.0 - e2 * sin * sin).sqrt();
        (a * (1.0 - e2) / w.powi(3), a / w)
    };
    // North over the middle latitude, east over that of the place itself.
    let (meridional, _) = at((latitude_deg + ORIGIN.0) / 2.0);
    let (_, normal) = at(latitude_deg);
    let (dlat, dlon) = ((latitude_deg - ORIGIN.0).to_radians(), (longitude_deg - ORIGIN.1).to_radians());
    let (sin, cos) = latitude_deg.to_radians().sin_cos();
    // A parallel is no straight line: it bends towards the pole.
    (normal * cos * dlon, meridional * dlat + normal * sin * cos * dlon * dlon / 2.0)
}

/// A table by its columns.
fn columns(text: &str) -> (Vec<&str>, Vec<Vec<f64>>) {
    let mut lines = text.lines();
    let header = lines.next().unwrap().split(',').collect();
    (header, lines.map(|line| line.split(',').map(|field| field.parse().unwrap()).collect()).collect())
}

#[test]
fn the_grid_has_metres_degrees_and_what_is_known() {
    let folder = folder();
    let described = draw(folder.path(), &["--at", "500,200", "-o", "map.csv", "--as", "both"]);
    let grid = String::from_utf8(read(folder.path(), "map.csv")).unwrap();
    let (header, rows) = columns(&grid);
    let said = ["easting_m", "northing_m", "latitude_deg", "longitude_deg", "tx_probability", "tx_lower", "tx_upper"];
    assert_eq!(header[..7], said);
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
    // Much is known where events took place, little in the far corner.
    let explained = |east_m: f64, north_m: f64| {
        let away = |row: &&Vec<f64>| (row[0] - east_m).hypot(row[1] - north_m);
        rows.iter().min_by(|a, b| away(a).total_cmp(&away(b))).unwrap()[7]
    };
    assert!(explained(500.0, 600.0) > explained(0.0, 900.0), "{} {}", explained(500.0, 600.0), explained(0.0, 900.0));
    // What was said of it agrees with its cells.
    let mut widths: Vec<f64> = rows.iter().map(|row| row[6] - row[5]).collect();
    widths.sort_by(f64::total_cmp);
    assert!((described["interval_width"].as_f64().unwrap() - widths[widths.len() / 2]).abs() < 1e-12);
    assert_eq!(described["reference_system"], "42.3,-70.9");
}

#[test]
fn places_in_degrees_and_in_metres_are_the_same() {
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
    // Another origin than the log's own is a contradiction.
    let other = pingmap(folder.path(), &["map", "events.csv", "--at", "0,0", "--origin", "42,-70"]);
    assert!(other.status.code() == Some(2) && stderr(&other).contains("42.3,-70.9"), "{}", stderr(&other));
}

#[test]
fn directions_and_several_places_bound_one_another() {
    let folder = folder();
    let probabilities = |more: &[&str]| -> Vec<f64> {
        draw(folder.path(), &[&["-o", "map.csv", "--reciprocal", "no"], more].concat());
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
    // The area grows with the places: the first alone, over the area of both.
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
fn pictures_say_what_is_known() {
    let folder = folder();
    draw(folder.path(), &["--at", "500,200", "-o", "map.png", "--layers", "probability,width"]);
    assert!(read(folder.path(), "map.png").starts_with(b"\x89PNG"));
    let svg = |more: &[&str]| {
        draw(folder.path(), &[&["--at", "500,200", "-o", "map.svg"], more].concat());
        String::from_utf8(read(folder.path(), "map.svg")).unwrap()
    };
    let plain = svg(&["--as", "rx", "--length-scale-m", "200", "--bounds=-1000,-1000,2500,2500"]);
    for said in
        ["receiver", "little known beyond the prior", "probability of success", "42°18", "70°54", "500 m", "viewBox"]
    {
        assert!(plain.contains(said), "no {said}");
    }
    assert!(!plain.contains("rotate(-90"), "letters stand upright");
    let titled =
        svg(&["--title", "Bay & <quay>", "--with-events", "--levels", "0.25,0.75", "--layers", "probability,lower"]);
    for said in ["Bay &amp; &lt;quay&gt;", "heard here", "missed here", "contour 0.25", "lower end"] {
        assert!(titled.contains(said), "no {said}");
    }
    assert!(!titled.contains("contour 0.9"), "a contour nobody asked for");
    // A name as long as a page is cut.
    let long = "n".repeat(5000);
    file(folder.path(), "events.csv", log(&[&long, "b"], 60));
    let named = svg(&[]);
    assert!(named.contains(&format!("{}…", "n".repeat(19))) && !named.contains(&"n".repeat(60)));
}

#[test]
fn pictures_for_print_are_as_wide_as_was_said() {
    let folder = folder();
    let drawn = |name: &str, width_mm: &str| {
        draw(folder.path(), &["--at", "500,200", "-o", name, "--width-mm", width_mm]);
        read(folder.path(), name)
    };
    // As wide as the figure is in its own pixels, 96 an inch, letters are as large as on a screen.
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
    // But not so that nothing is left for the map.
    assert!(pixels("40") * 25.4 / 96.0 > 80.0);
    let png = drawn("map.png", "180");
    let reader = png::Decoder::new(Cursor::new(png)).read_info().unwrap();
    assert_eq!(reader.info().pixel_dims.map(|dots| dots.xppu), Some(11811), "300 dots an inch");
    assert!(reader.info().width.abs_diff(2126) <= 1, "{}", reader.info().width);
    // Its own file again.
    drawn("map.png", "90");
    let arguments = ["map", "events.csv", "--at", "500,200", "-o", "map.pdf", "--width-mm", "180"];
    let output = pingmap(folder.path(), &[&arguments[..], QUICK].concat());
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

/// All positions within some coordinates, in metres.
fn points(coordinates: &Value) -> Vec<(f64, f64)> {
    match (coordinates[0].as_f64(), coordinates[1].as_f64()) {
        (Some(longitude), Some(latitude)) => vec![metres((latitude, longitude))],
        _ => coordinates.as_array().unwrap().iter().flat_map(points).collect(),
    }
}

#[test]
fn geojson_is_filled_and_lies_where_it_should() {
    let folder = folder();
    draw(folder.path(), &["--at", "500,200", "-o", "map.geojson", "--levels", "0.3,0.8"]);
    let map: Value = serde_json::from_slice(&read(folder.path(), "map.geojson")).unwrap();
    let features = map["features"].as_array().unwrap();
    let of = |kind: &str| features.iter().filter(|feature| feature["properties"]["kind"] == kind).collect::<Vec<_>>();
    let place = &of("place")[0]["geometry"]["coordinates"];
    let (east_m, north_m) = metres((place[1].as_f64().unwrap(), place[0].as_f64().unwrap()));
    assert!((east_m - 500.0).hypot(north_m - 200.0) < 1.0, "{east_m} {north_m}");
    assert_eq!((of("area").len(), of("contour").len(), of("track").len()), (3, 2, 2));
    // Areas fill the map once: together as large as it is, each ring counter-clockwise and its holes clockwise.
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
    // Areas end where contours run.
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
fn a_geotiff_has_its_cells_and_its_place() {
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
    // The first pixel is that of the north-west, the first row of the table of the south-west.
    let north_west = &rows[(rows_high as usize - 1) * columns_wide as usize];
    assert!(pixels[..4].iter().zip(&north_west[4..]).all(|(a, b)| (f64::from(*a) - b).abs() < 1e-6));
}

/// What a program that nobody here wrote says of a file; says so where there is none.
fn said_by(program: &str, arguments: &[&str], folder: &Path) -> Option<String> {
    let Ok(output) = Command::new(program).args(arguments).current_dir(folder).output() else {
        let message = format!("skipped: there is no {program}\n");
        std::io::stderr().write_all(message.as_bytes()).unwrap();
        return None;
    };
    assert!(output.status.success(), "{program} {arguments:?}: {}", stderr(&output));
    Some(stdout(&output) + &stderr(&output))
}

#[test]
fn other_programs_open_them() {
    let folder = folder();
    for name in ["map.tif", "map.geojson", "map.kml"] {
        draw(folder.path(), &["--at", "500,200", "--bounds", "0,0,1000,1000", "-o", name]);
    }
    if let Some(said) = said_by("gdalinfo", &["map.tif"], folder.path()) {
        assert!(
            said.contains("Transverse") && said.contains("Description = probability") && !said.contains("ERROR"),
            "{said}"
        );
        // Upper left corner in degrees, minutes and seconds: 1000 m north of the origin.
        assert!(said.contains("70d54' 0.00\"W, 42d18'32."), "{said}");
    }
    for (name, layer) in [("map.geojson", "map"), ("map.kml", "Tracks")] {
        if let Some(said) = said_by("ogrinfo", &["-al", "-so", name], folder.path()) {
            assert!(said.contains(layer) && !said.contains("ERROR") && !said.contains("Warning"), "{said}");
            let features: u32 =
                said.lines().filter_map(|line| line.strip_prefix("Feature Count: ")?.trim().parse::<u32>().ok()).sum();
            assert!(features >= 6, "{said}");
        }
    }
    if let Some(said) = opened_by_others(folder.path(), &["map.tif", "map.geojson", "map.kml"]) {
        let grid = &said["map.tif"];
        let first = ["degrees", "metres"].map(|key| [0, 1].map(|n: usize| grid[key][n].as_f64().unwrap()));
        let [[longitude, latitude], [east_m, north_m]] = first;
        // The middle of the cell in the north-west, by PROJ, and by the ellipsoid.
        let (x_m, y_m) = metres((latitude, longitude));
        assert!((x_m - east_m).hypot(y_m - north_m) < 1.0 && (east_m, north_m) == (25.0, 975.0), "{grid}");
        assert_eq!(grid["bands"], serde_json::json!(["probability", "lower", "upper", "explained"]));
        assert_eq!(said["map.kml"]["schema_errors"], serde_json::json!([]));
        let shapes = |layer: &Value| layer["shapes"].as_u64().unwrap();
        for name in ["map.geojson", "map.kml"] {
            let layers = said[name]["layers"].as_object().unwrap();
            assert!(layers.values().map(shapes).sum::<u64>() >= 6, "{name}: {layers:?}");
        }
    }
    let kml = String::from_utf8(read(folder.path(), "map.kml")).unwrap();
    // The order that the standard asks for.
    for placemark in kml.split("<Placemark>").skip(1).filter(|placemark| placemark.contains("<styleUrl>")) {
        assert!(placemark.find("<styleUrl>") < placemark.find("<MultiGeometry>"), "{placemark}");
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
fn what_a_map_is_of_is_all_of_a_log_and_what_is_far_from_it_is_refused() {
    let folder = folder();
    let digest = |command: &[&str]| json(folder.path(), command)["log_digest"].as_str().unwrap().to_owned();
    let whole = digest(&["check", "events.csv", "--json"]);
    let of_part = [&["map", "events.csv", "--at", "0,0", "--events-max", "50"], QUICK, &["--json"]].concat();
    assert_eq!(digest(&of_part), whole);
    // Another hemisphere.
    let (latitude, longitude) = ORIGIN;
    let at = format!("{latitude}N,{}E", longitude.abs());
    let output = pingmap(folder.path(), &["map", "events.csv", "--at", &at]);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(2) && said.contains("--at") && said.contains("100 km"), "{said}");
    // A large file is known again, whatever stands in its first megabyte.
    let (learning, _) = QUICK.split_at(QUICK.len() - 2);
    let geojson = ["-o", "map.geojson", "--at", "500,200", "--cell-m", "12", "--as", "both"];
    let levels = ["--levels", ".05,.1,.15,.2,.25,.3,.35,.4,.45,.5,.55,.6,.65,.7,.75,.8,.85,.9,.95", "--json"];
    for _ in 0..2 {
        json(folder.path(), &[&["map", "events.csv"], &geojson[..], learning, &levels].concat());
    }
    assert!(read(folder.path(), "map.geojson").len() > 1 << 20);
}

#[test]
fn a_log_in_utm_is_on_the_same_map() {
    let folder = tempfile::tempdir().unwrap();
    // 42.3 N, 69 W lies on the central meridian of zone 19.
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
    draw(folder.path(), &["--at", "500500,4683200", "--crs", "EPSG:32619", "-o", "map.csv"]);
    let text = String::from_utf8(read(folder.path(), "map.csv")).unwrap();
    let (_, rows) = columns(&text);
    // One cell east is 50 m / .9996 on the ground.
    let (a, b) = (&rows[0], &rows[1]);
    let parallel_m =
        6_378_137.0 * a[2].to_radians().cos() / (1.0 - 0.006_694_38 * a[2].to_radians().sin().powi(2)).sqrt();
    assert!(((b[3] - a[3]).to_radians() * parallel_m - 50.0 / 0.9996).abs() < 0.05, "{a:?} {b:?}");
    draw(folder.path(), &["--at", "500500,4683200", "--crs", "EPSG:32619", "-o", "map.tif"]);
    if let Some(said) = said_by("gdalinfo", &["map.tif"], folder.path()) {
        assert!(said.contains("UTM zone 19N") && said.contains("69d"), "{said}");
    }
}
