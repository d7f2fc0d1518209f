//! Elements of figures and their style.

use crate::grid::Point;

/// Size of ordinary letters in pixels.
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

/// Style of a line and its markers. An empty `dash` is a solid line, a zero `width` is no line.
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
    /// Whether the lines have arrow heads.
    pub heads: bool,
}

/// One of several maps of an area.
pub struct Panel<'a> {
    pub title: &'a str,
    pub tracks: &'a [Series<'a>],
    pub links: &'a [Arrows<'a>],
}

/// Position of the legend.
#[derive(Clone, Copy, PartialEq)]
pub enum LegendPlace {
    /// At the right of the axes and of the colour bar, in one column.
    Right,
    /// Below the axes, in two columns.
    Below,
    /// No legend.
    Nowhere,
}

/// Colours of the values of a map.
#[derive(Clone, Copy, PartialEq)]
pub enum Palette {
    /// Dark blue to yellow.
    BlueToYellow,
    /// Violet over green to yellow.
    VioletToGreen,
    /// Violet over red to yellow.
    VioletToRed,
    /// White to black.
    WhiteToBlack,
}

/// Available room for a figure.
#[derive(Clone, Copy)]
pub struct Room {
    /// Pixels along the longer side of the axes.
    pub side: f64,
    pub legend: LegendPlace,
}

impl Room {
    /// Room of a figure without a given width. Its letters are readable on a page that is 400 pixels wide.
    pub const SCREEN: Room = Room { side: 350.0, legend: LegendPlace::Below };
}
