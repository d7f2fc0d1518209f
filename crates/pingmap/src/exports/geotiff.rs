//! A map as GeoTIFF (OGC 19-008r4): 32-bit numbers, one band per quantity, rows from the north-west.

use std::io::Cursor;

use pingmap_agent::{Geographic, ReferenceSystem};
use tiff::encoder::colortype::Gray32Float;
use tiff::encoder::{Compression, TiffEncoder};
use tiff::tags::{ExtraSamples, Tag};

use super::export::{Export, Quantity};
use crate::output::BadInput;

/// Bands of a side.
const BANDS: [Quantity; 4] = [
    ("probability", |cell| cell.probability),
    ("lower", |cell| cell.lower),
    ("upper", |cell| cell.upper),
    ("explained", |cell| cell.explained),
];

/// GDAL's tag for the names of bands.
const GDAL_METADATA: Tag = Tag::Unknown(42112);

/// Returns every cell, with a band for each quantity, in the log's reference system.
pub fn geotiff(export: &Export) -> anyhow::Result<Vec<u8>> {
    let map = export.map;
    let area = &map.area;
    let mut names = Vec::new();
    let mut pixels = Vec::with_capacity(area.cells() * BANDS.len() * map.sides.len());
    for side in &map.sides {
        names.extend(BANDS.map(|(name, _)| export.prefix(side) + name));
    }
    for row in (0..area.rows).rev() {
        for column in 0..area.columns {
            let cells = map.sides.iter().map(|side| &side.cells[row * area.columns + column]);
            pixels.extend(cells.flat_map(|cell| BANDS.map(|(_, of)| of(cell) as f32)));
        }
    }
    let keys = GeoKeys::of(export.reference.system())?;
    let mut bytes = Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut bytes)?.with_compression(Compression::Uncompressed);
    let mut image = encoder.new_image::<Gray32Float>(area.columns as u32, area.rows as u32)?;
    image.extra_samples(&vec![ExtraSamples::Unspecified; names.len() - 1])?;
    let tags = image.encoder();
    tags.write_tag(Tag::Software, "pingmap")?;
    tags.write_tag(Tag::ModelPixelScaleTag, &[area.cell_m, area.cell_m, 0.0][..])?;
    tags.write_tag(Tag::ModelTiepointTag, &[0.0, 0.0, 0.0, area.east.0, area.north.1, 0.0][..])?;
    tags.write_tag(Tag::GeoKeyDirectoryTag, &keys.directory[..])?;
    if !keys.doubles.is_empty() {
        tags.write_tag(Tag::GeoDoubleParamsTag, &keys.doubles[..])?;
    }
    tags.write_tag(GDAL_METADATA, &descriptions(&names)[..])?;
    image.write_data(&pixels)?;
    Ok(bytes.into_inner())
}

fn descriptions(names: &[String]) -> String {
    let item = |(n, name): (usize, &String)| {
        format!("<Item name=\"DESCRIPTION\" sample=\"{n}\" role=\"description\">{name}</Item>")
    };
    format!("<GDALMetadata>{}</GDALMetadata>", names.iter().enumerate().map(item).collect::<String>())
}

/// The reference system as GeoTIFF keys.
struct GeoKeys {
    directory: Vec<u16>,
    doubles: Vec<f64>,
}

/// Keys of OGC 19-008r4, annex B.
mod key {
    pub const MODEL_TYPE: u16 = 1024;
    pub const RASTER_TYPE: u16 = 1025;
    pub const GEODETIC_CRS: u16 = 2048;
    pub const PROJECTED_CRS: u16 = 3072;
    pub const PROJECTION: u16 = 3074;
    pub const PROJECTION_METHOD: u16 = 3075;
    pub const LINEAR_UNITS: u16 = 3076;
    pub const NATURAL_ORIGIN_LONGITUDE: u16 = 3080;
    pub const NATURAL_ORIGIN_LATITUDE: u16 = 3081;
    pub const FALSE_EASTING: u16 = 3082;
    pub const FALSE_NORTHING: u16 = 3083;
    pub const SCALE_AT_NATURAL_ORIGIN: u16 = 3092;
}

/// Code of a value that the file itself defines.
const USER_DEFINED: u16 = 32767;

impl GeoKeys {
    fn of(system: ReferenceSystem) -> Result<Self, BadInput> {
        // Projected; cells are areas.
        let mut shorts = vec![(key::MODEL_TYPE, 1), (key::RASTER_TYPE, 1)];
        let mut doubles = Vec::new();
        match system {
            ReferenceSystem::Unknown => {
                return Err(BadInput("a .tif map needs the position of (0, 0): --origin or --crs".into()));
            }
            ReferenceSystem::Epsg(code) => {
                let code = u16::try_from(code).map_err(|_| BadInput(format!("a .tif map has no room for {system}")))?;
                shorts.push((key::PROJECTED_CRS, code));
            }
            ReferenceSystem::About(Geographic { latitude_deg, longitude_deg }) => {
                // WGS 84 with a transverse Mercator projection in metres.
                shorts.extend([(key::GEODETIC_CRS, 4326), (key::PROJECTED_CRS, USER_DEFINED)]);
                shorts.extend([
                    (key::PROJECTION, USER_DEFINED),
                    (key::PROJECTION_METHOD, 1),
                    (key::LINEAR_UNITS, 9001),
                ]);
                doubles.extend([
                    (key::NATURAL_ORIGIN_LONGITUDE, longitude_deg),
                    (key::NATURAL_ORIGIN_LATITUDE, latitude_deg),
                    (key::FALSE_EASTING, 0.0),
                    (key::FALSE_NORTHING, 0.0),
                    (key::SCALE_AT_NATURAL_ORIGIN, 1.0),
                ]);
            }
        }
        // The header contains version 1.1.0. Each key then contains its value, or the index of its value in the
        // doubles.
        let mut directory = vec![1, 1, 0, (shorts.len() + doubles.len()) as u16];
        shorts.iter().for_each(|&(key, value)| directory.extend([key, 0, 1, value]));
        let of_doubles = Tag::GeoDoubleParamsTag.to_u16();
        let places = doubles.iter().enumerate();
        places.for_each(|(place, &(key, _))| directory.extend([key, of_doubles, 1, place as u16]));
        Ok(Self { directory, doubles: doubles.into_iter().map(|(_, value)| value).collect() })
    }
}
