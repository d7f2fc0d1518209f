//! Maps as files for other programs: tables, GeoJSON, KML, GeoTIFF.

mod antimeridian;
mod export;
mod bands;
mod table;
mod geojson;
mod lines;
mod kml;
mod geotiff;

pub use export::Export;
pub use geojson::geojson;
pub use geotiff::geotiff;
pub use kml::{kml, kml_of_lines};
pub use lines::{Line, Shape, geojson_of_lines};
pub use table::csv;
