//! The fixed point of a sparse mean field, in what its events say at the inducing points (section 2 of
//! [`crate::method`]).

use super::anderson::Anderson;
use super::mean_field::{MeanField, TILT_MIN, omega, omega_and_ln_2_cosh};
use super::options::FitOptions;
use super::sparse::{Site, Sparse};
use crate::cross::Sums;
use crate::error::{Result, finite};
use crate::likelihood::Likelihood;
use crate::linalg::Matrix;
use crate::prior::Prior;
use crate::sites::Sites;

/// Walks from one posterior to the next until no tilt changes. When it returns, the engine holds the posterior of the sites it found.
pub(super) fn iterate(
    engine: &mut Sparse<'_>,
    prior: &Prior,
    likelihood: &Likelihood<'_>,
    options: &FitOptions<'_>,
) -> Result<MeanField> {
    let weights = likelihood.observations.weights();
    let begun = begin(engine, prior, likelihood, options)?;
    let scale = Scale::of(&begun);
    let (mut at, mut plain, mut is_plain) = (begun, None, true);
    let mut anderson = Anderson::new();
    let (mut best, mut iterations) = (f64::NEG_INFINITY, 0);
    let mut was_taken_back = false;
    loop {
        iterations += 1;
        let walk = engine.walk(|n, site, pull, explained| move_site(site, weights[n], pull, explained))?;
        let evidence = match engine.take(&walk.said) {
            Err(_) if !is_plain => f64::NAN,
            taken => taken.map(|()| engine.evidence(walk.bound))?,
        };
        // Plain steps never lower E. Another one that led to less is taken back for the plain one, and acceleration
        // starts anew.
        let went_astray = !evidence.is_finite() || evidence < best - 1e-10 * best.abs();
        if let Some(plain) = plain.take_if(|_| !is_plain && went_astray) {
            engine.take(&plain)?;
            (at, is_plain, was_taken_back) = (plain, true, true);
            anderson.restart();
            continue;
        }
        best = best.max(finite("evidence bound", evidence)?);
        // After a step that was taken back, tilts changed from where it led.
        let converged = walk.change <= options.tolerance && !was_taken_back;
        was_taken_back = false;
        if converged || iterations >= options.iterations_max {
            let found = Found { evidence, iterations, change: walk.change, converged, said: walk.said };
            return found.mean_field(engine, likelihood);
        }
        // The last step is plain: nothing could take another one back any more.
        let mut step = None;
        if iterations + 1 < options.iterations_max {
            let image = scale.coordinates(&walk.said);
            let next = anderson.propose(&scale.coordinates(&at), &image);
            step = Some(next).filter(|next| *next != image).map(|next| scale.sums(&next));
        }
        if let Some(next) = &step
            && engine.take(next).is_err()
        {
            engine.take(&walk.said)?;
            anderson.restart();
            step = None;
        }
        is_plain = step.is_none();
        at = step.unwrap_or_else(|| walk.said.clone());
        plain = Some(walk.said);
    }
}

/// Takes the posterior of the sites at the tilts to start from, and says what they say.
fn begin(
    engine: &mut Sparse<'_>,
    prior: &Prior,
    likelihood: &Likelihood<'_>,
    options: &FitOptions<'_>,
) -> Result<Sums> {
    options.check(likelihood.events())?;
    let weights = likelihood.observations.weights();
    // A site remembers its tilt by its moments.
    let begun = engine.begin(prior, |n, site| {
        (site.mean, site.variance) = (options.start.map_or(1.0, |start| start[n]), 0.0);
        site.omega = omega(weights[n], tilt(site));
    })?;
    engine.take(&begun.said)?;
    Ok(begun.said)
}

/// Where the iteration ended.
struct Found {
    evidence: f64,
    iterations: usize,
    change: f64,
    converged: bool,
    said: Sums,
}

impl Found {
    fn mean_field(self, engine: &mut Sparse<'_>, likelihood: &Likelihood<'_>) -> Result<MeanField> {
        let Found { evidence, iterations, change, converged, said } = self;
        let tilts = engine.sites.iter().map(tilt).collect();
        if !converged {
            // The moments that the tilts are of are not yet those of the posterior.
            engine.walk(|_, site, pull, explained| {
                (site.mean, site.variance) = (site.prior_mean + pull, site.residual + explained);
                (0.0, 0.0)
            })?;
        }
        let of_sites = |entry: fn(&Site) -> f64| engine.sites.iter().map(entry).collect::<Vec<f64>>();
        Ok(MeanField {
            sites: Sites::new(likelihood.observations, of_sites(|site| site.omega))?,
            mean: of_sites(|site| site.mean),
            variance: of_sites(|site| site.variance),
            residual: of_sites(|site| site.residual),
            tilts,
            evidence,
            iterations,
            change,
            converged,
            jitter: engine.cholesky.jitter(),
            weights: likelihood.observations.weights().to_vec(),
            condensed: Some((said.precision, said.shift)),
        })
    }
}

/// c = √E\[f²\].
fn tilt(site: &Site) -> f64 {
    (site.mean * site.mean + site.variance).sqrt().max(TILT_MIN)
}

/// The site of an event with these posterior moments, its terms of E, and how far its tilt went.
fn move_site(site: &mut Site, weight: f64, pull: f64, explained: f64) -> (f64, f64) {
    let before = tilt(site);
    (site.mean, site.variance) = (site.prior_mean + pull, site.residual + explained);
    let after = tilt(site);
    let (omega, ln_2_cosh) = omega_and_ln_2_cosh(weight, after);
    site.omega = omega;
    let tilted = 0.5 * omega * (after * after - site.residual) - weight * ln_2_cosh;
    let about_mean = (site.kappa - 0.5 * site.omega * site.prior_mean) * site.prior_mean;
    (tilted + about_mean, (after - before).abs())
}

/// Ĝ and b̂ as coordinates in which steps of different directions can be compared: in units of the precision at the start.
struct Scale(Vec<f64>);

impl Scale {
    fn of(said: &Sums) -> Self {
        Self(said.precision.diagonal().into_iter().map(|precision| (1.0 + precision).sqrt().recip()).collect())
    }

    /// Entries of the lower triangle, column by column, those off the diagonal for two; then b̂.
    fn coordinates(&self, said: &Sums) -> Vec<f64> {
        let points = self.0.len();
        let entry = |row: usize, column: usize| said.precision[(row, column)] * self.of_entry(row, column);
        let triangle = (0..points).flat_map(|column| (column..points).map(move |row| (row, column)));
        let shift = said.shift.iter().zip(&self.0).map(|(shift, scale)| shift * scale);
        triangle.map(|(row, column)| entry(row, column)).chain(shift).collect()
    }

    fn sums(&self, coordinates: &[f64]) -> Sums {
        let points = self.0.len();
        let (triangle, shift) = coordinates.split_at(coordinates.len() - points);
        let (mut precision, mut entries) = (Matrix::zeros(points, points), triangle.iter());
        for column in 0..points {
            for (row, entry) in (column..points).zip(&mut entries) {
                precision[(row, column)] = entry / self.of_entry(row, column);
            }
        }
        precision.mirror_lower();
        Sums { precision, shift: shift.iter().zip(&self.0).map(|(shift, scale)| shift / scale).collect() }
    }

    fn of_entry(&self, row: usize, column: usize) -> f64 {
        let twice = if row == column { 1.0 } else { std::f64::consts::SQRT_2 };
        twice * self.0[row] * self.0[column]
    }
}
