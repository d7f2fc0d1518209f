//! Tests of parts of figures in their SVG.

use super::*;

/// Returns the numbers in the attributes `names` of all elements of a kind, such as `<rect x="1" …/>`.
fn elements(svg: &str, kind: &str, names: &[&str]) -> Vec<Vec<f64>> {
    let opening = format!("<{kind} ");
    let one = |text: &str| {
        let text = text.split('>').next().unwrap_or_default();
        let number = |name: &&str| text.split(&format!(" {name}=\"")).nth(1)?.split('"').next()?.parse().ok();
        names.iter().map(|name| number(&name.trim_start())).collect::<Option<Vec<f64>>>()
    };
    svg.split(&opening).skip(1).filter_map(|text| one(&format!(" {text}"))).collect()
}

/// Draws a map with a cell of each shade, and a track.
fn drawn(track: &[Point], style: Style) -> String {
    let (columns, rows) = (20, 10);
    let values: Vec<f64> = (0..columns * rows).map(|n| (n * 7 % 200) as f64 / 200.0).collect();
    let grid = Grid { columns, values: &values, east: (0.0, 2000.0), north: (0.0, 1000.0) };
    let map = GridMap {
        title: "A map",
        notes: &[],
        bar: "probability of success",
        palette: Palette::BlueToYellow,
        grid,
        contours: &[],
        graticule: &[],
        hatched: (&[], ""),
        tracks: &[Series { name: "auv1", points: track, style }],
        links: &[],
        places: &[],
        lines: &[],
    };
    grid_map(&map, Room::SCREEN).svg(false)
}

const DASHED: Style = Style { color: "#d7301f", width: 1.6, dash: &[6.0, 4.0], mark: Mark::None };

/// Returns the rectangles of the map, and those of the colour bar: left, top, width, height.
fn rectangles(svg: &str) -> (Vec<Vec<f64>>, Vec<Vec<f64>>) {
    let groups: Vec<&str> = svg.split("shape-rendering=\"crispEdges\"").skip(1).collect();
    let of =
        |group: &str| elements(group.split("</g>").next().unwrap_or_default(), "rect", &["x", "y", "width", "height"]);
    (of(groups[0]), of(groups[1]))
}

#[test]
fn cells_leave_no_seams_and_the_bar_is_as_high_as_the_axes() {
    let svg = drawn(&[(100.0, 500.0), (1900.0, 500.0)], DASHED);
    let (cells, bar) = rectangles(&svg);
    assert!(cells.len() > 150 && bar.len() == 128, "{} {}", cells.len(), bar.len());
    let edge = |all: &[Vec<f64>], of: fn(&[f64]) -> f64, better: fn(f64, f64) -> f64| {
        all.iter().map(|one| of(one)).reduce(better).unwrap_or(f64::NAN)
    };
    let (left, right) = (edge(&cells, |c| c[0], f64::min), edge(&cells, |c| c[0] + c[2], f64::max));
    let (top, bottom) = (edge(&cells, |c| c[1], f64::min), edge(&cells, |c| c[1] + c[3], f64::max));
    // Every point inside lies in a cell. Adjacent cells overlap.
    for row in 0..100 {
        for column in 0..200 {
            let x = left + (right - left - 1.0) * (f64::from(column) + 0.37) / 200.0;
            let y = top + (bottom - top - 1.0) * (f64::from(row) + 0.41) / 100.0;
            let is_in = |c: &Vec<f64>| c[0] <= x && x <= c[0] + c[2] && c[1] <= y && y <= c[1] + c[3];
            assert!(cells.iter().any(is_in), "a seam at {x}, {y}");
        }
    }
    assert!((edge(&bar, |c| c[1], f64::min) - top).abs() <= 1.0);
    assert!((edge(&bar, |c| c[1] + c[3], f64::max) - bottom).abs() <= 1.0);
    assert!(edge(&bar, |c| c[0], f64::min) > right);
}

#[test]
fn a_track_has_its_start_its_direction_north_and_a_scale() {
    let svg = drawn(&[(100.0, 500.0), (1900.0, 500.0)], DASHED);
    let rings = elements(&svg, "circle", &["cx", "cy", "r"]);
    let (cells, _) = rectangles(&svg);
    let left = cells.iter().map(|c| c[0]).fold(f64::MAX, f64::min);
    let right = cells.iter().map(|c| c[0] + c[2]).fold(0.0, f64::max);
    let start_x = left + (right - left) * 100.0 / 2000.0;
    assert!(rings.iter().any(|ring| ring[2] == 8.0 && (ring[0] - start_x).abs() < 2.0), "{rings:?}: {start_x}");
    assert!(svg.contains(">N</text>") && svg.contains(">500 m</text>"), "north and scale");
    // The scale bar has the stated length.
    let length_px = (right - left) * 500.0 / 2000.0;
    let lines = svg.split(" d=\"").skip(1).map(|text| text.split('"').next().unwrap_or_default());
    let of = |line: &str| -> Vec<f64> { line.split(' ').filter_map(|number| number.parse().ok()).collect() };
    let is_scale =
        |line: &Vec<f64>| line.len() == 8 && (line[4] - line[2] - length_px).abs() < 1.5 && line[3] == line[5];
    assert!(lines.map(of).any(|line| is_scale(&line)), "a scale of {length_px} pixels");
}

#[test]
fn dashes_survive_a_track_that_is_driven_twice() {
    let dashes = |track: &[Point]| {
        let svg = drawn(track, DASHED);
        svg.split("<path ")
            .skip(1)
            .filter(|line| line.split('>').next().is_some_and(|line| line.contains("#d7301f")))
            .count()
    };
    let there = [(100.0, 500.0), (1900.0, 500.0)];
    let and_back = [there[0], there[1], there[0]];
    let (once, twice) = (dashes(&there), dashes(&and_back));
    // The same dashes appear, except a few at the turn and below the arrow heads back.
    assert!(once > 30 && twice.abs_diff(once) <= once / 5, "{once} {twice}");
}

#[test]
fn print_is_regular_and_names_are_shortened() {
    let svg = drawn(&[(100.0, 500.0), (1900.0, 500.0)], DASHED);
    assert!(!svg.contains("rotate(-90") && !svg.contains("font-weight=\"bold\""), "upright and regular");
    assert_eq!(shortened(&"n".repeat(5000)).chars().count(), shortened(&"n".repeat(60)).chars().count());
}
