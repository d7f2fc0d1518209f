//! What is drawn, how it looks, and the finished figure.

use kuva::backend::raster::RasterBackend;
use kuva::prelude::SvgBackend;
use kuva::render::render::Scene;

use crate::contour::Point;

/// Size of ordinary letters.
pub(super) const FONT_PX: u32 = 12;

/// The shape of a marker.
#[derive(Clone, Copy, PartialEq)]
pub enum Mark {
    None,
    Dot,
    Square,
    Triangle,
    Diamond,
    Star,
    Cross,
}

/// How a line and its markers look; an empty `dash` is a solid line, a zero `width` is no line.
#[derive(Clone, Copy)]
pub struct Style<'a> {
    pub color: &'a str,
    pub width: f64,
    pub dash: &'a [f64],
    pub mark: Mark,
}

/// A named line with markers.
pub struct Series<'a> {
    pub name: &'a str,
    pub points: &'a [Point],
    pub style: Style<'a>,
}

/// Named lines from the first point of each pair to the second, with the style's marker at the second.
#[derive(Clone, Copy)]
pub struct Arrows<'a> {
    pub name: &'a str,
    pub pairs: &'a [(Point, Point)],
    pub style: Style<'a>,
    /// Whether they have heads.
    pub heads: bool,
}

/// What one of several maps of the same area shows.
pub struct Panel<'a> {
    pub title: &'a str,
    pub tracks: &'a [Series<'a>],
    pub links: &'a [Arrows<'a>],
}

/// A finished figure.
pub struct Figure(pub(super) Scene);

impl Figure {
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
}
