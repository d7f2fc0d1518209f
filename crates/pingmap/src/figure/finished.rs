//! A finished figure, and its files.

use kuva::backend::raster::RasterBackend;
use kuva::prelude::SvgBackend;
use kuva::render::render::Scene;

use super::style::{LegendPlace, Room};

/// Pixels of a figure that make a millimetre on paper, where letters are as large as on a screen.
const PX_PER_MM: f64 = 96.0 / MM_PER_INCH;

const MM_PER_INCH: f64 = 25.4;

/// What journals print pictures with.
const DOTS_PER_INCH: f64 = 300.0;

/// Beside smaller maps there is no room for a legend: it stands below them.
const SIDE_NARROW: f64 = 340.0;

/// Smaller maps cannot be read: the whole figure is made smaller instead, with its letters.
const SIDE_MIN: f64 = 200.0;

/// A kind of file that a picture can be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Image {
    Png,
    Svg,
    Pdf,
}

impl Image {
    /// By the ending of a file's name, in small letters.
    pub fn of(ending: &str) -> Option<Self> {
        match ending {
            "png" => Some(Image::Png),
            "svg" => Some(Image::Svg),
            "pdf" => Some(Image::Pdf),
            _ => None,
        }
    }

    /// Whether this program can write it.
    pub fn is_possible(self) -> bool {
        self != Image::Pdf || cfg!(feature = "pdf")
    }
}

/// A finished figure.
pub struct Figure(pub(super) Scene);

impl Figure {
    /// What is drawn in some room; in print so wide that letters keep their size, as far as that leaves room for the map.
    pub fn fitted(width_mm: Option<f64>, draw: impl Fn(Room) -> Figure) -> Figure {
        let Some(width_mm) = width_mm else { return draw(Room::PLENTY) };
        // What stands beside the map keeps its width.
        let side = |legend| {
            let [large, small] = [Room::PLENTY.side, SIDE_NARROW].map(|side| draw(Room { side, legend }).0.width);
            let grows = (large - small) / (Room::PLENTY.side - SIDE_NARROW);
            Room::PLENTY.side + (width_mm * PX_PER_MM - large) / grows
        };
        let beside = side(LegendPlace::Right);
        if beside >= SIDE_NARROW {
            return draw(Room { side: beside, legend: LegendPlace::Right });
        }
        draw(Room { side: side(LegendPlace::Below).max(SIDE_MIN), legend: LegendPlace::Below })
    }

    /// The figure as a file, so wide in print if that is said.
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

    /// The figure as SVG; `embed_font` makes it independent of installed fonts (and 3.2 MB larger).
    pub fn svg(&self, embed_font: bool) -> String {
        let backend = SvgBackend::new().with_embedded_font(embed_font);
        let svg = backend.render_scene(&self.0);
        // Without it a picture that is shown smaller is cut off instead of drawn smaller.
        match svg.split_once("<svg ") {
            Some((before, rest)) if !rest.split('>').next().is_some_and(|head| head.contains("viewBox")) => {
                format!("{before}<svg viewBox=\"0 0 {} {}\" {rest}", self.0.width, self.0.height)
            }
            _ => svg,
        }
    }

    /// The figure as PNG bytes, two pixels per SVG unit.
    pub fn png(&self) -> anyhow::Result<Vec<u8>> {
        self.png_scaled(2.0)
    }

    /// The figure as PNG bytes, so many pixels per SVG unit.
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
    #[expect(clippy::unused_self, reason = "as where there is PDF")]
    fn pdf(&self, _: f64) -> anyhow::Result<Vec<u8>> {
        Err(anyhow::anyhow!("this pingmap was built without PDF"))
    }
}

/// An SVG of that size on paper.
fn with_width(svg: &str, width_mm: f64, height_mm: f64) -> String {
    let sized = svg.split_once(" width=\"").and_then(|(before, rest)| {
        // Between quotation marks: the width, `height=`, the height.
        let after = rest.splitn(4, '"').nth(3)?;
        Some(format!("{before} width=\"{width_mm:.2}mm\" height=\"{height_mm:.2}mm\"{after}"))
    });
    sized.unwrap_or_else(|| svg.to_owned())
}

/// A PNG that says how large it is on paper.
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
