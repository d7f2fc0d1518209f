//! Draws, sweeps, fits and predictions.

use dgpc::{FitOptions, Gibbs, Posterior, fit, polya_gamma, spread_out};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::StandardNormal;

use crate::data::{loss, synthetic, truth};

const DRAWS: usize = 200_000;

/// Draws Pólya-Gamma variables at one tilt; returns their mean.
pub fn draws(tilt: f64) -> Box<dyn FnMut() -> f64> {
    draws_at(vec![tilt; DRAWS])
}

/// Draws Pólya-Gamma variables at the tilts of a typical sampler; returns their mean.
pub fn mixed_draws() -> Box<dyn FnMut() -> f64> {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    draws_at((0..DRAWS).map(|_| 2.0 * rng.sample::<f64, _>(StandardNormal)).collect())
}

fn draws_at(tilts: Vec<f64>) -> Box<dyn FnMut() -> f64> {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    Box::new(move || {
        let sum: f64 = tilts.iter().map(|&tilt| polya_gamma::sample(&mut rng, tilt).expect("a finite tilt")).sum();
        sum / tilts.len() as f64
    })
}

/// Runs sweeps of the Gibbs sampler.
pub fn sweeps(size: usize, repeats: usize) -> Box<dyn FnMut() -> f64> {
    let mut chain = Gibbs::new(&truth(), synthetic(size)).expect("events that fit the prior");
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    Box::new(move || {
        (0..repeats).for_each(|_| chain.sweep(&mut rng).expect("numbers of ordinary size"));
        f64::NAN
    })
}

/// Runs a dense fit under the true prior; returns its evidence.
pub fn fits(size: usize) -> Box<dyn FnMut() -> f64> {
    let (prior, events) = (truth(), synthetic(size));
    Box::new(move || fit(&prior, &events, &FitOptions::default().tolerance(1e-6)).expect("a fit").evidence())
}

/// Runs ten iterations of a sparse fit under the true prior with this number of inducing points; returns its evidence. The fit reads its
/// events twelve times.
pub fn sparse_iterations(size: usize, points: usize) -> Box<dyn FnMut() -> f64> {
    let (prior, events) = (truth(), synthetic(size));
    let points = events.inputs().select(&spread_out(size, points));
    Box::new(move || {
        let options = FitOptions::default().inducing_points(&points).tolerance(0.0).iterations_max(10);
        fit(&prior, &events, &options).expect("a fit").evidence()
    })
}

/// Makes 10 000 predictions from a fit of `size` events; returns their loss.
pub fn predictions(size: usize) -> Box<dyn FnMut() -> f64> {
    let (prior, test) = (truth(), synthetic(10_000));
    let fitted = fit(&prior, &synthetic(size), &FitOptions::default()).expect("a fit");
    let posterior = Posterior::of_sites(&prior, fitted.sites()).expect("a posterior");
    Box::new(move || loss(&posterior.latent(test.inputs()).expect("places that fit").probability(), &test))
}
