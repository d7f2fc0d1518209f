//! A map as a table.

use super::export::Export;
use crate::output::csv_text;

/// Names of a cell's quantities.
const NUMBERS: [&str; 4] = ["probability", "lower", "upper", "explained"];

/// Returns the grid as CSV: the centre of every cell in metres, and in degrees if known; and the cell's quantities.
pub fn csv(export: &Export) -> anyhow::Result<Vec<u8>> {
    let map = export.map;
    let mut header = vec!["easting_m".to_owned(), "northing_m".to_owned()];
    if export.has_degrees() {
        header.extend(["latitude_deg".to_owned(), "longitude_deg".to_owned()]);
    }
    for side in &map.sides {
        let prefix = export.prefix(side);
        header.extend(NUMBERS.map(|name| format!("{prefix}{name}")));
    }
    let row = |cell: usize| -> anyhow::Result<Vec<f64>> {
        let (east_m, north_m) = map.area.middle(cell);
        let mut row = vec![east_m, north_m];
        if export.has_degrees() {
            let place = export.degrees(east_m, north_m)?;
            row.extend([place.latitude_deg, place.longitude_deg]);
        }
        for cell in map.sides.iter().map(|side| side.cells[cell]) {
            row.extend([cell.probability, cell.lower, cell.upper, cell.explained]);
        }
        Ok(row)
    };
    let rows = (0..map.area.cells()).map(row).collect::<anyhow::Result<Vec<_>>>()?;
    let header: Vec<&str> = header.iter().map(String::as_str).collect();
    Ok(csv_text(&header, &rows)?.into_bytes())
}
