//! Inducing points as cells of the chart and levels.

/// Position of one end of a link, in cells of the chart.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct Cell {
    /// Cell from west to east.
    pub east: u8,
    /// Cell from south to north.
    pub north: u8,
    /// Cell from the surface down; 0 if the message has no depths.
    pub depth: u8,
}

/// An inducing point with its own information and mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Point {
    /// Cell of the transmitter.
    pub transmitter: Cell,
    /// Cell of the receiver.
    pub receiver: Cell,
    /// Level of the whitened precision's diagonal; 0 for an unused point.
    pub information: u8,
    /// Level of the whitened mean.
    pub mean: i8,
}
