//! What is known of a place, as it stands in a model file.

use dgpc::Matrix;
use serde::{Deserialize, Serialize};

use crate::bounds::{self, Bounds};
use crate::event::{Link, Position};
use crate::model::Model;
use crate::model_file_error::ModelFileError;
use crate::place::Place;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PlaceLayout {
    /// Of the logs that it was learned from.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) log_digests: Vec<String>,
    /// Both ends of each link: east, north (and depth).
    links: Vec<Vec<f64>>,
    shift: Vec<f64>,
    /// Rows of the lower triangle.
    precision: Vec<Vec<f64>>,
}

impl PlaceLayout {
    pub(crate) fn write(place: &Place, log_digests: &[String]) -> Self {
        let end = |end: Position| [Some(end.east_m), Some(end.north_m), end.depth_m].into_iter().flatten();
        Self {
            log_digests: log_digests.to_vec(),
            links: place.links().iter().map(|link| link.ends().into_iter().flat_map(end).collect()).collect(),
            shift: place.summary().whitened_shift().to_vec(),
            precision: place.precision_rows().collect(),
        }
    }

    /// The place under this model.
    ///
    /// # Errors
    /// [`ModelFileError`] for lists that do not go together, numbers out of range, and a precision that is none.
    pub(crate) fn read(&self, model: &Model) -> Result<Place, ModelFileError> {
        let points = self.links.len();
        let size = points as f64;
        checked("number of place.links", bounds::PLACE_POINTS, size)?;
        let is_triangle = self.precision.len() == points && (1..).zip(&self.precision).all(|(n, row)| row.len() == n);
        if !is_triangle || self.shift.len() != points {
            return Err(ModelFileError::UnevenPlace { points });
        }
        let links = self.links.iter().map(|link| read_link(link, model)).collect::<Result<Vec<_>, _>>()?;
        for &entry in self.shift.iter().chain(self.precision.iter().flatten()) {
            checked("entry of place.shift or place.precision", bounds::INFORMATION, entry)?;
        }
        let precision = Matrix::from_fn(points, points, |i, j| self.precision[i.max(j)][i.min(j)]);
        let inputs = model.inputs(&links)?;
        Ok(Place::new(&model.prior, links, &inputs, precision, self.shift.clone())?)
    }
}

fn read_link(numbers: &[f64], model: &Model) -> Result<Link, ModelFileError> {
    let width = if model.inputs.has_depths() { 3 } else { 2 };
    if numbers.len() != 2 * width {
        return Err(ModelFileError::LinkOfPlace { expected: 2 * width, found: numbers.len() });
    }
    for &number in numbers {
        checked("coordinate of place.links", bounds::COORDINATE_M, number)?;
    }
    let end = |end: &[f64]| Position { depth_m: end.get(2).copied(), ..Position::new(end[0], end[1]) };
    Ok(Link { transmitter: end(&numbers[..width]), receiver: end(&numbers[width..]) })
}

fn checked(key: &'static str, bounds: Bounds, value: f64) -> Result<f64, ModelFileError> {
    bounds.check(value).ok_or(ModelFileError::OutOfRange { key, expected: bounds, value })
}
