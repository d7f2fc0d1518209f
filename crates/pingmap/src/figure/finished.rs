//! A finished figure and its file formats.

use kuva::backend::raster::RasterBackend;
use kuva::prelude::SvgBackend;
use kuva::render::render::Scene;

use super::style::{LegendPlace, Room};

/// Pixels of a figure per millimetre of print. Printed letters then have the size that they have on a screen of 96
/// pixels an inch.
const PX_PER_MM: f64 = 96.0 / MM_PER_INCH;

const MM_PER_INCH: f64 = 25.4;

/// Resolution of printed figures.
const DOTS_PER_INCH: f64 = 300.0;

/// Smaller maps have their legend below instead of at the right.
const SIDE_NARROW: f64 = 340.0;

/// A side of a map at which the width of its figure is measured.
const SIDE_LARGE: f64 = 640.0;

/// Smallest side of a map. If the figure must be smaller, it is scaled with its letters.
const SIDE_MIN: f64 = 200.0;

/// An image format.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Image {
    Png,
    Svg,
    Pdf,
}

impl Image {
    /// Returns the format of a file extension in lower case.
    pub fn of(ending: &str) -> Option<Self> {
        match ending {
            "png" => Some(Image::Png),
            "svg" => Some(Image::Svg),
            "pdf" => Some(Image::Pdf),
            _ => None,
        }
    }

    /// Whether this program can write the format.
    pub fn is_possible(self) -> bool {
        self != Image::Pdf || cfg!(feature = "pdf")
    }
}

/// A finished figure.
pub struct Figure(pub(super) Scene);

impl Figure {
    /// Draws a figure. In print the map is as large as the width allows, and letters keep their size.
    pub fn fitted(width_mm: Option<f64>, draw: impl Fn(Room) -> Figure) -> Figure {
        let Some(width_mm) = width_mm else { return draw(Room::SCREEN) };
        // The parts next to the map keep their width.
        let side = |legend| {
            let [large, small] = [SIDE_LARGE, SIDE_NARROW].map(|side| draw(Room { side, legend }).0.width);
            let grows = (large - small) / (SIDE_LARGE - SIDE_NARROW);
            SIDE_LARGE + (width_mm * PX_PER_MM - large) / grows
        };
        let right_side = side(LegendPlace::Right);
        if right_side >= SIDE_NARROW {
            return draw(Room { side: right_side, legend: LegendPlace::Right });
        }
        draw(Room { side: side(LegendPlace::Below).max(SIDE_MIN), legend: LegendPlace::Below })
    }

    /// Returns the figure as a file, with this width in print if given.
    pub fn file(&self, image: Image, width_mm: Option<f64>) -> anyhow::Result<Vec<u8>> {
        let Some(width_mm) = width_mm else {
            return match image {
                Image::Png => self.png(),
                Image::Svg => Ok(self.svg(true).into_bytes()),
                Image::Pdf => self.pdf(self.0.width / PX_PER_MM),
            };
        };
        match image {
            Image::Png => {
                let dots = width_mm / MM_PER_INCH * DOTS_PER_INCH;
                with_dots_per_inch(&self.png_scaled((dots / self.0.width) as f32)?, DOTS_PER_INCH)
            }
            Image::Svg => Ok(with_width(&self.svg(true), width_mm, self.height_mm(width_mm)).into_bytes()),
            Image::Pdf => self.pdf(width_mm),
        }
    }

    fn height_mm(&self, width_mm: f64) -> f64 {
        width_mm * self.0.height / self.0.width
    }

    /// Returns the figure as SVG. `embed_font` makes the SVG independent of installed fonts, and 3.2 MB larger.
    pub fn svg(&self, embed_font: bool) -> String {
        let backend = SvgBackend::new().with_embedded_font(embed_font);
        let svg = backend.render_scene(&self.0);
        // Without a viewBox, a figure that is shown smaller is cut off instead of scaled.
        match svg.split_once("<svg ") {
            Some((before, rest)) if !rest.split('>').next().is_some_and(|head| head.contains("viewBox")) => {
                format!("{before}<svg viewBox=\"0 0 {} {}\" {rest}", self.0.width, self.0.height)
            }
            _ => svg,
        }
    }

    /// Returns the figure as PNG bytes, three pixels per SVG unit.
    pub fn png(&self) -> anyhow::Result<Vec<u8>> {
        self.png_scaled(3.0)
    }

    /// Returns the figure as PNG bytes, `scale` pixels per SVG unit.
    pub fn png_scaled(&self, scale: f32) -> anyhow::Result<Vec<u8>> {
        let raster = RasterBackend::new().with_scale(scale);
        raster.render_scene(&self.0).map_err(|error| anyhow::anyhow!("cannot draw: {error}"))
    }

    #[cfg(feature = "pdf")]
    fn pdf(&self, width_mm: f64) -> anyhow::Result<Vec<u8>> {
        let [width, height] = [width_mm, self.height_mm(width_mm)].map(|mm| mm / MM_PER_INCH * 72.0);
        let page = kuva::PdfBackend::new().with_page_size(kuva::backend::pdf::PageSize::points(width, height));
        page.render_scenes(std::slice::from_ref(&self.0)).map_err(|error| anyhow::anyhow!("cannot draw: {error}"))
    }

    #[cfg(not(feature = "pdf"))]
    #[expect(clippy::unused_self, reason = "same signature as with PDF")]
    fn pdf(&self, _: f64) -> anyhow::Result<Vec<u8>> {
        Err(anyhow::anyhow!("this pingmap was built without PDF"))
    }
}

/// Sets the size of an SVG in print.
fn with_width(svg: &str, width_mm: f64, height_mm: f64) -> String {
    let sized = svg.split_once(" width=\"").and_then(|(before, rest)| {
        // The four parts between quotation marks: the width, `height=`, the height, the rest.
        let after = rest.splitn(4, '"').nth(3)?;
        Some(format!("{before} width=\"{width_mm:.2}mm\" height=\"{height_mm:.2}mm\"{after}"))
    });
    sized.unwrap_or_else(|| svg.to_owned())
}

/// Sets the resolution of a PNG.
fn with_dots_per_inch(bytes: &[u8], dots_per_inch: f64) -> anyhow::Result<Vec<u8>> {
    let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info()?;
    let mut pixels = vec![0; reader.output_buffer_size().unwrap_or_default()];
    reader.next_frame(&mut pixels)?;
    let mut info = reader.info().clone();
    let per_metre = (dots_per_inch * 1000.0 / MM_PER_INCH).round() as u32;
    info.pixel_dims = Some(png::PixelDimensions { xppu: per_metre, yppu: per_metre, unit: png::Unit::Meter });
    let mut sized = Vec::new();
    png::Encoder::with_info(&mut sized, info)?.write_header()?.write_image_data(&pixels)?;
    Ok(sized)
}
