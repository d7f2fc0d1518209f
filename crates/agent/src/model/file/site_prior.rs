//! The site prior in a model file.

use dgpc::{Matrix, Summary};
use serde::{Deserialize, Serialize};

use crate::model::file::error::{ModelFileError, check_bounds};
use crate::model::link_model::Model;
use crate::model::site_prior::SitePrior;
use crate::types::bounds;
use crate::types::event::{Link, Position};

/// The layout of a site prior in a model file.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SitePriorLayout {
    /// Digests of the logs that the site prior was learned from.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) log_digests: Vec<String>,
    /// Coordinates of both ends of each link: east, north (and depth), in metres.
    links: Vec<Vec<f64>>,
    shift: Vec<f64>,
    /// Whitened precision, as the rows of its lower triangle.
    precision: Vec<Vec<f64>>,
}

impl SitePriorLayout {
    pub(crate) fn write(site: &SitePrior, log_digests: &[String]) -> Self {
        let end = |end: Position| [Some(end.east_m), Some(end.north_m), end.depth_m].into_iter().flatten();
        Self {
            log_digests: log_digests.to_vec(),
            links: site.links().iter().map(|link| link.ends().into_iter().flat_map(end).collect()).collect(),
            shift: site.summary().whitened_shift().to_vec(),
            precision: site.precision_rows().collect(),
        }
    }

    pub(crate) fn read(&self, model: &Model) -> Result<SitePrior, ModelFileError> {
        let points = self.links.len();
        let size = points as f64;
        check_bounds("number of site_prior.links", bounds::SITE_PRIOR_POINTS, size)?;
        let is_triangle = self.precision.len() == points && (1..).zip(&self.precision).all(|(n, row)| row.len() == n);
        if !is_triangle || self.shift.len() != points {
            return Err(ModelFileError::UnevenSitePrior { points });
        }
        let links = self.links.iter().map(|link| read_link(link, model)).collect::<Result<Vec<_>, _>>()?;
        for &entry in self.shift.iter().chain(self.precision.iter().flatten()) {
            check_bounds("entry of site_prior.shift or site_prior.precision", bounds::INFORMATION, entry)?;
        }
        let precision = Matrix::from_fn(points, points, |i, j| self.precision[i.max(j)][i.min(j)]);
        let summary = Summary::from_whitened(&model.prior, &model.inputs(&links)?, precision, self.shift.clone())?;
        Ok(SitePrior::new(links, summary)?)
    }
}

/// Returns the link with these coordinates.
fn read_link(numbers: &[f64], model: &Model) -> Result<Link, ModelFileError> {
    let width = if model.inputs.has_depths() { 3 } else { 2 };
    if numbers.len() != 2 * width {
        return Err(ModelFileError::LinkOfSitePrior { expected: 2 * width, found: numbers.len() });
    }
    for &number in numbers {
        check_bounds("coordinate of site_prior.links", bounds::COORDINATE_M, number)?;
    }
    let end = |end: &[f64]| Position { depth_m: end.get(2).copied(), ..Position::new(end[0], end[1]) };
    Ok(Link { transmitter: end(&numbers[..width]), receiver: end(&numbers[width..]) })
}
