//! The inputs of events: N points of d coordinates.

use crate::error::{Error, Place, Result, same_size};

/// The largest column index in kernels and prior means. This bound catches typing errors; it does not restrict use.
pub const COLUMN_MAX: usize = 65_535;

/// N finite points of dimension d, stored row by row.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(try_from = "Parts", into = "Parts"))]
pub struct Inputs {
    values: Vec<f64>,
    dimension: usize,
}

impl Inputs {
    /// Interprets `values`, of length N·d, as N rows of `dimension` coordinates.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for dimension 0, [`Error::SizeMismatch`] if the last row is incomplete, and
    /// [`Error::NotFinite`] with row and column of the first NaN or infinity.
    pub fn new(values: Vec<f64>, dimension: usize) -> Result<Self> {
        if dimension == 0 {
            return Err(Error::OutOfRange { what: "input dimension", expected: "at least 1", value: 0.0 });
        }
        same_size("numbers in whole rows of inputs", values.len() / dimension * dimension, values.len())?;
        if let Some(bad) = values.iter().position(|v| !v.is_finite()) {
            let place = Place::Entry { row: bad / dimension, column: bad % dimension };
            return Err(Error::NotFinite { what: "input", place, value: values[bad] });
        }
        Ok(Self { values, dimension })
    }

    /// Builds the points from one array per row. See [`Inputs::new`].
    ///
    /// # Errors
    /// [`Error::NotFinite`] with row and column of the first NaN or infinity.
    pub fn from_rows<const D: usize>(rows: &[[f64; D]]) -> Result<Self> {
        Self::new(rows.iter().flatten().copied().collect(), D)
    }

    /// Returns an empty set of points of dimension `dimension`. Dimension 0 counts as 1.
    pub fn empty(dimension: usize) -> Self {
        Self { values: Vec::new(), dimension: dimension.max(1) }
    }

    /// Returns the number of points N.
    pub fn len(&self) -> usize {
        self.values.len() / self.dimension
    }

    /// Returns whether there are no points.
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// Returns the number of coordinates d.
    pub fn dimension(&self) -> usize {
        self.dimension
    }

    /// Returns point `n`, d coordinates.
    ///
    /// # Panics
    /// If `n` is not below the number of points.
    pub fn row(&self, n: usize) -> &[f64] {
        &self.values[n * self.dimension..(n + 1) * self.dimension]
    }

    /// Returns an iterator over all points, in order.
    pub fn rows(&self) -> impl ExactSizeIterator<Item = &[f64]> {
        self.values.chunks_exact(self.dimension)
    }

    /// Checks that `points` have as many columns as these. Without points here, every number is right.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`].
    pub(crate) fn check_dimension(&self, points: &Inputs) -> Result<()> {
        if self.is_empty() { Ok(()) } else { same_size("input dimension", self.dimension, points.dimension) }
    }

    /// Returns the points at `indices`, in that order.
    ///
    /// # Panics
    /// If an index is not below the number of points.
    pub fn select(&self, indices: &[usize]) -> Self {
        let values = indices.iter().flat_map(|&n| self.row(n)).copied().collect();
        Self { values, dimension: self.dimension }
    }

    /// Returns the points in `range`, in order.
    ///
    /// # Panics
    /// If the range ends beyond the last point.
    pub fn slice(&self, range: std::ops::Range<usize>) -> Self {
        let values = self.values[range.start * self.dimension..range.end * self.dimension].to_vec();
        Self { values, dimension: self.dimension }
    }

    /// Returns a range of columns of every point.
    ///
    /// # Panics
    /// If the range is empty or ends beyond the last column.
    pub fn columns(&self, columns: std::ops::Range<usize>) -> Self {
        assert!(!columns.is_empty(), "points need at least one column");
        let dimension = columns.len();
        let values = self.rows().flat_map(|row| &row[columns.clone()]).copied().collect();
        Self { values, dimension }
    }

    /// Appends the points of `other`.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] if the dimensions differ.
    pub fn append(&mut self, other: &Inputs) -> Result<()> {
        same_size("input dimension", self.dimension, other.dimension)?;
        self.values.extend_from_slice(&other.values);
        Ok(())
    }
}

/// Checks that a column index is at most [`COLUMN_MAX`].
pub(crate) fn check_column(column: usize) -> Result<()> {
    let (what, expected) = ("column", "at most 65535");
    if column <= COLUMN_MAX { Ok(()) } else { Err(Error::OutOfRange { what, expected, value: column as f64 }) }
}

/// Returns at most `count_max` of the indices below `count`, in ascending order and spread over the whole range.
///
/// The indices look random but are always the same. A periodic schedule of events therefore does not alias with them.
/// If fewer than a third of the indices are wanted, the range is cut into `count_max` equal parts and one index comes
/// from each. Otherwise every index is equally likely.
///
/// ```
/// assert_eq!(dgpc::spread_out(3, 5), [0, 1, 2]);
/// assert_eq!(dgpc::spread_out(1000, 10).len(), 10);
/// ```
pub fn spread_out(count: usize, count_max: usize) -> Vec<usize> {
    if count <= count_max {
        return (0..count).collect();
    }
    if count / PART_MIN < count_max {
        return drawn(count, count_max);
    }
    let part = |i: usize| {
        // 128-bit arithmetic does not overflow here.
        let start = |i: usize| (i as u128 * count as u128 / count_max as u128) as usize;
        let (first, end) = (start(i), start(i + 1));
        first + (scrambled(i as u64) % (end - first) as u64) as usize
    };
    (0..count_max).map(part).collect()
}

/// Smallest length of a part. The parts differ in length by one, which matters little from this length on.
const PART_MIN: usize = 3;

/// Draws a subset of `wanted` of the indices below `count`. Every index is equally likely.
fn drawn(count: usize, mut wanted: usize) -> Vec<usize> {
    let mut places = Vec::with_capacity(wanted);
    for place in 0..count {
        let left = (count - place) as u128;
        // True for a share wanted/left of all hash values.
        if (u128::from(scrambled(place as u64)) * left) >> 64 < wanted as u128 {
            places.push(place);
            wanted -= 1;
        }
    }
    places
}

/// The output function of the generator SplitMix64 (Steele, Lea and Flood 2014).
fn scrambled(number: u64) -> u64 {
    let mut z = number.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// The serialised form of [`Inputs`].
#[cfg(feature = "serde")]
#[derive(serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Parts {
    dimension: usize,
    values: Vec<f64>,
}

#[cfg(feature = "serde")]
impl TryFrom<Parts> for Inputs {
    type Error = Error;

    fn try_from(Parts { dimension, values }: Parts) -> Result<Self> {
        Self::new(values, dimension)
    }
}

#[cfg(feature = "serde")]
impl From<Inputs> for Parts {
    fn from(Inputs { values, dimension }: Inputs) -> Self {
        Self { dimension, values }
    }
}
