//! What is drawn, and how it looks.

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

/// Where the legend stands.
#[derive(Clone, Copy, PartialEq)]
pub enum LegendPlace {
    /// Right of the axes and of the colour bar, one entry below the other.
    Right,
    /// Below the axes, in two columns.
    Below,
    /// There is none.
    Nowhere,
}

/// What a figure may take up.
#[derive(Clone, Copy)]
pub struct Room {
    /// Pixels along the longer side of the axes.
    pub side: f64,
    pub legend: LegendPlace,
}

impl Room {
    /// Where nobody says how wide the figure is to be.
    pub const PLENTY: Room = Room { side: 640.0, legend: LegendPlace::Right };
}
