//! Cuts lines and areas at the antimeridian (RFC 7946, section 3.1.9).
//!
//! Longitudes jump from 180 to -180 degrees there, and programs draw a line across the jump around the world.

use geo_types::{Coord, LineString, MultiPolygon, Polygon};
use i_overlay::core::fill_rule::FillRule;
use i_overlay::core::overlay_rule::OverlayRule;
use i_overlay::float::single::SingleFloatOverlay;

/// Cuts a line of longitudes and latitudes. Each piece ends at the antimeridian where the next one starts.
pub(super) fn cut_line(line: Vec<Coord<f64>>) -> Vec<Vec<Coord<f64>>> {
    let line = continuous(&line, line.first().map_or(0.0, |first| first.x));
    let mut pieces: Vec<Vec<Coord<f64>>> = Vec::new();
    let mut sheet = None;
    for (n, &point) in line.iter().enumerate() {
        let from_sheet = sheet.unwrap_or_else(|| sheet_of(point.x));
        if sheet.is_none() {
            pieces.push(Vec::new());
        }
        let to_sheet = sheet_of(point.x);
        if to_sheet != from_sheet {
            let edge = 360.0 * from_sheet.max(to_sheet) - 180.0;
            let before = line[n - 1];
            let share = (edge - before.x) / (point.x - before.x);
            let crossing = Coord { x: edge, y: before.y + share * (point.y - before.y) };
            add(&mut pieces, crossing, from_sheet);
            pieces.push(Vec::new());
            add(&mut pieces, crossing, to_sheet);
        }
        add(&mut pieces, point, to_sheet);
        sheet = Some(to_sheet);
    }
    // A line that touches the antimeridian has a piece of one point there.
    if pieces.len() > 1 {
        pieces.retain(|piece| piece.len() > 1);
    }
    pieces
}

/// Adds a point to the latest piece, with its longitude from -180 to 180 degrees. Repeated points are left out.
fn add(pieces: &mut [Vec<Coord<f64>>], point: Coord<f64>, sheet: f64) {
    let point = Coord { x: point.x - 360.0 * sheet, y: point.y };
    if let Some(piece) = pieces.last_mut().filter(|piece| piece.last() != Some(&point)) {
        piece.push(point);
    }
}

/// Cuts areas of longitudes and latitudes. Outer rings run counter-clockwise, holes clockwise.
pub(super) fn cut_areas(areas: MultiPolygon<f64>) -> MultiPolygon<f64> {
    areas.into_iter().flat_map(cut_area).collect()
}

/// Cuts an area as [`cut_areas`] does.
pub(super) fn cut_area(area: Polygon<f64>) -> Vec<Polygon<f64>> {
    let from_deg = area.exterior().0.first().map_or(0.0, |first| first.x);
    let rings: Vec<Vec<[f64; 2]>> = std::iter::once(area.exterior())
        .chain(area.interiors())
        .map(|ring| continuous(&ring.0, from_deg).iter().map(|point| [point.x, point.y]).collect())
        .collect();
    let corners = || rings.iter().flatten();
    let (west, east) =
        corners().fold((f64::INFINITY, f64::NEG_INFINITY), |(west, east), &[x, _]| (west.min(x), east.max(x)));
    let (south, north) =
        corners().fold((f64::INFINITY, f64::NEG_INFINITY), |(south, north), &[_, y]| (south.min(y), north.max(y)));
    let (first, last) = (sheet_of(west), sheet_of(east));
    if first == last {
        return vec![area];
    }
    let mut parts = Vec::new();
    for sheet in [first, last] {
        let (from, to) = ((360.0 * sheet - 180.0).max(west), (360.0 * sheet + 180.0).min(east));
        let window = vec![[from, south], [to, south], [to, north], [from, north]];
        // 64-bit integers resolve far less than a millimetre.
        for shape in rings.overlay_as::<i64>(&window, OverlayRule::Intersect, FillRule::EvenOdd) {
            let mut rings = shape.into_iter().map(|ring| {
                let corners = ring.into_iter().map(|[x, y]| Coord { x: (x - 360.0 * sheet).clamp(-180.0, 180.0), y });
                LineString(corners.collect())
            });
            parts.extend(rings.next().map(|exterior| Polygon::new(exterior, rings.collect())));
        }
    }
    parts
}

/// Returns the number of full turns to a longitude: 0 from -180 to 180 degrees.
fn sheet_of(longitude_deg: f64) -> f64 {
    ((longitude_deg + 180.0) / 360.0).floor()
}

/// Continues longitudes beyond 180 degrees, so that neighbours differ by at most 180 degrees. The first longitude is
/// near `from_deg`.
fn continuous(points: &[Coord<f64>], from_deg: f64) -> Vec<Coord<f64>> {
    let mut latest_deg = from_deg;
    let continued = points.iter().map(|point| {
        latest_deg += (point.x - latest_deg + 180.0).rem_euclid(360.0) - 180.0;
        Coord { x: latest_deg, y: point.y }
    });
    continued.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn coords(points: &[(f64, f64)]) -> Vec<Coord<f64>> {
        points.iter().map(|&(x, y)| Coord { x, y }).collect()
    }

    /// Twice the signed area of a ring, positive if it runs counter-clockwise.
    fn twice_the_area(ring: &LineString<f64>) -> f64 {
        ring.lines().map(|line| line.start.x * line.end.y - line.end.x * line.start.y).sum()
    }

    #[test]
    fn lines_are_cut_where_they_cross_and_others_stay() {
        let plain = coords(&[(10.0, 1.0), (11.0, 2.0)]);
        assert_eq!(cut_line(plain.clone()), [plain]);
        let crossing = coords(&[(179.0, 0.0), (-179.0, 2.0), (-178.0, 2.0), (179.0, 5.0)]);
        let expected = [
            coords(&[(179.0, 0.0), (180.0, 1.0)]),
            coords(&[(-180.0, 1.0), (-179.0, 2.0), (-178.0, 2.0), (-180.0, 4.0)]),
            coords(&[(180.0, 4.0), (179.0, 5.0)]),
        ];
        assert_eq!(cut_line(crossing), expected);
        assert_eq!(cut_line(coords(&[(179.0, 0.0), (180.0, 1.0)])), [coords(&[(179.0, 0.0), (180.0, 1.0)])]);
        assert_eq!(cut_line(Vec::new()), Vec::<Vec<Coord<f64>>>::new());
    }

    #[test]
    fn areas_are_cut_into_valid_parts_of_the_same_total_area() {
        // A square with a square hole, both across the antimeridian, and a second hole on one side.
        let square = |west: f64, east: f64, south: f64, north: f64| {
            LineString(coords(&[(west, south), (east, south), (east, north), (west, north), (west, south)]))
        };
        let hole = |west: f64, east: f64, south: f64, north: f64| {
            let mut ring = square(west, east, south, north);
            ring.0.reverse();
            ring
        };
        let area = Polygon::new(
            square(178.0, -178.0, 0.0, 4.0),
            vec![hole(179.0, -179.0, 1.0, 2.0), hole(-179.5, -178.5, 3.0, 3.5)],
        );
        let parts = cut_areas(MultiPolygon(vec![area]));
        assert_eq!(parts.0.len(), 2);
        let mut total = 0.0;
        for part in &parts {
            assert!(twice_the_area(part.exterior()) > 0.0);
            assert!(part.interiors().iter().all(|ring| twice_the_area(ring) < 0.0));
            total += twice_the_area(part.exterior()) / 2.0;
            total += part.interiors().iter().map(|ring| twice_the_area(ring) / 2.0).sum::<f64>();
            for line in part.exterior().lines().chain(part.interiors().iter().flat_map(LineString::lines)) {
                assert!((line.start.x - line.end.x).abs() <= 180.0);
            }
        }
        assert!((total - (16.0 - 2.0 - 0.5)).abs() < 1e-9, "{total}");
        let plain = MultiPolygon(vec![Polygon::new(square(1.0, 2.0, 1.0, 2.0), Vec::new())]);
        assert_eq!(cut_areas(plain.clone()), plain);
    }
}
