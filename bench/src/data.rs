//! Synthetic events with known truth: f ~ GP with variance 4 and length-scales .5, .7, 1 and 1.5 on [−1.5, 1.5]⁴, drawn by
//! random Fourier features; heard with probability 1/(1+exp(−f)).

use std::io::{BufWriter, Write};
use std::path::Path;

use dgpc::{Inputs, Kernel, Observations, Prior, PriorMean, Shape, Term};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::StandardNormal;

const LENGTH_SCALES: [f64; 4] = [0.5, 0.7, 1.0, 1.5];
const VARIANCE: f64 = 4.0;
const FEATURES: usize = 2000;

/// The data sets that peers read: how many events each has. The last is to test with.
pub const SIZES: [usize; 7] = [200, 446, 1000, 2000, 10_000, 100_000, 5000];

/// The prior that the events were drawn from.
pub fn truth() -> Prior {
    prior(VARIANCE, &LENGTH_SCALES)
}

/// The prior that learning begins at.
pub fn template() -> Prior {
    prior(1.0, &[1.0; 4])
}

fn prior(variance: f64, length_scales: &[f64; 4]) -> Prior {
    let term = Term::new(Shape::SquaredExponential, variance, &[0, 1, 2, 3], length_scales).expect("sensible numbers");
    Prior::new(Kernel::new(vec![term]).expect("a term"), PriorMean::Zero).expect("no mean to refuse")
}

/// Returns `count` events of one random function. Each `count` has its own random stream.
pub fn synthetic(count: usize) -> Observations {
    let mut of_function = ChaCha8Rng::seed_from_u64(0);
    let mut normal = || -> f64 { of_function.sample(StandardNormal) };
    let frequencies: Vec<[f64; 4]> = (0..FEATURES).map(|_| LENGTH_SCALES.map(|scale| normal() / scale)).collect();
    let amplitudes: Vec<[f64; 2]> = (0..FEATURES).map(|_| [normal(), normal()]).collect();
    let mut rng = ChaCha8Rng::seed_from_u64(count as u64);
    let (mut places, mut outcomes) = (Vec::with_capacity(4 * count), Vec::with_capacity(count));
    for _ in 0..count {
        let place: [f64; 4] = std::array::from_fn(|_| 3.0 * rng.random::<f64>() - 1.5);
        let wave = |(frequency, amplitude): (&[f64; 4], &[f64; 2])| {
            let phase: f64 = frequency.iter().zip(&place).map(|(w, x)| w * x).sum();
            amplitude[0] * phase.cos() + amplitude[1] * phase.sin()
        };
        let sum: f64 = frequencies.iter().zip(&amplitudes).map(wave).sum();
        let latent = sum * (VARIANCE / FEATURES as f64).sqrt();
        outcomes.push(rng.random::<f64>() < 1.0 / (1.0 + (-latent).exp()));
        places.extend(place);
    }
    Observations::new(Inputs::new(places, 4).expect("whole rows"), outcomes).expect("one outcome each")
}

/// Returns the mean negative log probability of the outcomes.
pub fn loss(probabilities: &[f64], events: &Observations) -> f64 {
    let of_one = |(p, &heard): (&f64, &bool)| -if heard { p.ln() } else { (1.0 - p).ln() };
    probabilities.iter().zip(events.outcomes()).map(of_one).sum::<f64>() / events.len() as f64
}

/// Writes all data sets to a folder, for `peers`: `N.csv` with four columns of places and the outcome.
///
/// # Errors
/// Errors of the file system.
pub fn write_all(folder: &Path) -> std::io::Result<()> {
    std::fs::create_dir_all(folder)?;
    for count in SIZES {
        let events = synthetic(count);
        let mut file = BufWriter::new(std::fs::File::create(folder.join(format!("{count}.csv")))?);
        for (place, &heard) in events.inputs().rows().zip(events.outcomes()) {
            let [a, b, c, d] = [place[0], place[1], place[2], place[3]];
            writeln!(file, "{a},{b},{c},{d},{}", u8::from(heard))?;
        }
        file.flush()?;
    }
    Ok(())
}
