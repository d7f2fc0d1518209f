//! Locality regions: sets of events for a summary ([`crate::method::inducing_points`]).

use crate::error::{Result, not_negative, same_size};
use crate::inputs::{Inputs, spread_out};

/// Largest number of inputs that are tried as the centre of the busiest region.
const CENTRES_MAX: usize = 1000;

/// A region R(r, c): the inputs that lie within a radius r of a centre c.
#[derive(Debug, Clone, PartialEq)]
pub struct LocalityRegion {
    /// The centre c, d coordinates.
    pub centre: Vec<f64>,
    /// The radius r, in the unit of the inputs.
    pub radius: f64,
    /// Indices of the inputs inside, ascending.
    pub members: Vec<usize>,
}

impl LocalityRegion {
    /// Creates the region around a centre of d coordinates. O(Nd).
    ///
    /// ```
    /// use dgpc::{Inputs, LocalityRegion};
    ///
    /// let inputs = Inputs::from_rows(&[[0.0, 0.0], [3.0, 4.0], [0.5, 0.0]])?;
    /// assert_eq!(LocalityRegion::around(&inputs, &[0.0, 0.0], 1.0)?.members, [0, 2]);
    /// # Ok::<(), dgpc::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`crate::Error::SizeMismatch`] for a centre of another dimension, [`crate::Error::OutOfRange`] for a radius that
    /// is negative or not finite.
    pub fn around(inputs: &Inputs, centre: &[f64], radius: f64) -> Result<Self> {
        same_size("coordinates of a region's centre", inputs.dimension(), centre.len())?;
        not_negative("radius of a region", radius)?;
        Ok(Self::about(inputs, centre, radius))
    }

    fn about(inputs: &Inputs, centre: &[f64], radius: f64) -> Self {
        let inside = |&n: &usize| squared_distance(inputs.row(n), centre) <= radius * radius;
        Self { centre: centre.to_vec(), radius, members: (0..inputs.len()).filter(inside).collect() }
    }

    /// Returns the region around the input with the largest number of inputs within the radius; the first of equals.
    ///
    /// Of more than 1000 inputs, 1000 are tried as the centre, spread evenly but without a period. The result is `None`
    /// without inputs. O(Nd · min(N, 1000)).
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] for a radius that is negative or not finite.
    pub fn busiest(inputs: &Inputs, radius: f64) -> Result<Option<Self>> {
        not_negative("radius of a region", radius)?;
        let centres = spread_out(inputs.len(), CENTRES_MAX).into_iter();
        let regions = centres.map(|centre| Self::about(inputs, inputs.row(centre), radius));
        Ok(regions.reduce(|best, next| if next.members.len() > best.members.len() { next } else { best }))
    }

    /// Keeps the `count` members nearest to the centre, in ascending order.
    pub fn keep_nearest(&mut self, inputs: &Inputs, count: usize) {
        let distance = |n: &usize| squared_distance(inputs.row(*n), &self.centre);
        self.members.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
        self.members.truncate(count);
        self.members.sort_unstable();
    }
}

fn squared_distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_busiest_region_is_the_first_with_most_members() -> Result<()> {
        let inputs = Inputs::from_rows(&[[0.0], [10.0], [10.5], [11.0], [20.0], [20.5], [21.0]])?;
        let region = LocalityRegion::busiest(&inputs, 0.6)?.expect("there are inputs");
        assert_eq!((region.centre, region.members), (vec![10.5], vec![1, 2, 3]));
        assert_eq!(LocalityRegion::busiest(&Inputs::empty(1), 1.0)?, None);
        for radius in [-1.0, f64::NAN, f64::INFINITY] {
            assert!(LocalityRegion::busiest(&inputs, radius).is_err(), "{radius}");
            assert!(LocalityRegion::around(&inputs, &[0.0], radius).is_err(), "{radius}");
        }
        Ok(())
    }

    #[test]
    fn keep_nearest_keeps_the_members_closest_to_the_centre() -> Result<()> {
        let inputs = Inputs::from_rows(&[[3.0], [0.1], [-2.0], [0.0]])?;
        let mut region = LocalityRegion::around(&inputs, &[0.0], 5.0)?;
        region.keep_nearest(&inputs, 9);
        assert_eq!(region.members, [0, 1, 2, 3]);
        region.keep_nearest(&inputs, 3);
        assert_eq!(region.members, [1, 2, 3]);
        assert!(LocalityRegion::around(&inputs, &[0.0, 1.0], 5.0).is_err());
        Ok(())
    }
}
