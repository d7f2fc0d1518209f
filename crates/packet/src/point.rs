//! Inducing points on the water: cells of the chart, and levels.

/// Where one end of a link lies, in cells of the chart.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct Cell {
    /// From west to east.
    pub east: u8,
    /// From south to north.
    pub north: u8,
    /// From the surface down; 0 where the message has no depths.
    pub depth: u8,
}

/// An inducing point, and what is said about it by itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Point {
    /// Transmitter.
    pub transmitter: Cell,
    /// Receiver.
    pub receiver: Cell,
    /// Level of the whitened precision's diagonal; 0 for a point of which nothing is said.
    pub information: u8,
    /// Level of the whitened mean.
    pub mean: i8,
}
