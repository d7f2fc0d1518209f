//! Effective sample size of a Markov chain (Geyer 1992).

/// Returns the number of independent draws that would estimate the mean as well as these draws of a chain do.
///
/// The estimate is n / (1 + 2 Σ ρ_t) with the autocorrelations ρ_t (Geyer's initial monotone sequence). The sum ends
/// where the sum of a pair of neighbours is no longer positive, and the sums of pairs are made to decrease
/// monotonically. The result is at most n·log₁₀ n. It is n for draws that are all equal, and for fewer than four draws.
/// O(n²) at worst.
///
/// ```
/// // When every value is repeated four times, the effective sample size is about a quarter.
/// let independent = [0.3, -1.2, 0.8, 0.1, -0.4, 1.5, -0.9, 0.6, -0.2, -0.7, 1.1, -1.4, 0.9, 0.2, -0.6, 0.5];
/// let repeated: Vec<f64> = independent.iter().flat_map(|&x| [x; 4]).collect();
/// let share = dgpc::effective_sample_size(&repeated) / 64.0;
/// assert!(share < 0.5);
/// ```
pub fn effective_sample_size(draws: &[f64]) -> f64 {
    let count = draws.len() as f64;
    let mean = draws.iter().sum::<f64>() / count.max(1.0);
    let covariance = |lag: usize| -> f64 {
        let pairs = draws.iter().zip(&draws[lag..]);
        pairs.map(|(a, b)| (a - mean) * (b - mean)).sum::<f64>() / count
    };
    if draws.len() < 4 || covariance(0) <= f64::MIN_POSITIVE {
        return count;
    }
    let variance = covariance(0);
    let mut previous = f64::INFINITY;
    let mut sum_of_pairs = 0.0;
    for lag in (0..draws.len() - 1).step_by(2) {
        let pair = (covariance(lag) + covariance(lag + 1)) / variance;
        if pair <= 0.0 {
            break;
        }
        previous = pair.min(previous);
        sum_of_pairs += previous;
    }
    // 2(ρ₀ + ρ₁ + …) − 1 = 1 + 2 Σ ρ_t, because ρ₀ = 1.
    count / (2.0 * sum_of_pairs - 1.0).max(1.0 / count.log10())
}

#[cfg(test)]
mod tests {
    use rand::RngExt;
    use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
    use rand_distr::StandardNormal;

    use super::*;

    /// Simulates an autoregressive chain with the given correlation between neighbours.
    fn chain(correlation: f64, count: usize, seed: u64) -> Vec<f64> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut state: f64 = rng.sample(StandardNormal);
        let step = |_| {
            let noise: f64 = rng.sample(StandardNormal);
            state = correlation * state + (1.0 - correlation * correlation).sqrt() * noise;
            state
        };
        (0..count).map(step).collect()
    }

    #[test]
    fn the_effective_sample_size_of_an_autoregressive_chain_agrees_with_theory() {
        for correlation in [-0.5, 0.0, 0.5, 0.9] {
            let count = 40_000;
            let expected = count as f64 * (1.0 - correlation) / (1.0 + correlation);
            // The mean of the chain has variance 1/ESS. At this length, ESS is estimated with an error below 10 %.
            let found: Vec<f64> = (0..8).map(|seed| effective_sample_size(&chain(correlation, count, seed))).collect();
            let mean = found.iter().sum::<f64>() / 8.0;
            let expected = expected.min(count as f64 * (count as f64).log10());
            assert!((mean / expected - 1.0).abs() < 0.1, "{correlation}: {mean} of {expected}");
        }
    }

    #[test]
    fn constant_chains_and_short_chains_do_not_divide_by_zero() {
        assert_eq!(effective_sample_size(&[]), 0.0);
        assert_eq!(effective_sample_size(&[2.0]), 1.0);
        assert_eq!(effective_sample_size(&[2.0; 50]), 50.0);
        // Alternating draws estimate the mean better than independent ones.
        let alternating: Vec<f64> = (0..100).map(|n| f64::from(n % 2)).collect();
        assert_eq!(effective_sample_size(&alternating), 200.0);
    }
}
