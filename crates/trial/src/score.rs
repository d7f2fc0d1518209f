//! Scores of predictions, and their errors.

/// Probabilities are clamped this far from 0 and 1 before the logarithm. A certain but wrong prediction therefore costs
/// about 28 nats, not infinity.
const PROBABILITY_MIN: f64 = 1e-12;

/// The score of one set of predictions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Score {
    /// Share of events whose more probable outcome occurred (p > ½ predicts success).
    pub accuracy: f64,
    /// Mean negative log-likelihood, in nats.
    pub nll: f64,
    /// Mean squared difference between probability and outcome.
    pub brier: f64,
    /// Regret of decisions, if the true probabilities are known ([`crate::Decisions`]): probability from the best
    /// position minus that from the chosen one.
    pub regret: Option<f64>,
}

impl Score {
    /// Scores `probabilities` of success against the outcomes; `None` without events.
    pub fn new(probabilities: &[f64], outcomes: &[bool]) -> Option<Self> {
        if outcomes.is_empty() {
            return None;
        }
        let (mut right, mut nll, mut brier) = (0.0, 0.0, 0.0);
        for (&p, &success) in probabilities.iter().zip(outcomes) {
            right += f64::from(u8::from((p > 0.5) == success));
            brier += (p - f64::from(u8::from(success))).powi(2);
            let p = p.clamp(PROBABILITY_MIN, 1.0 - PROBABILITY_MIN);
            nll -= if success { p.ln() } else { (-p).ln_1p() };
        }
        let count = outcomes.len() as f64;
        Some(Self { accuracy: right / count, nll: nll / count, brier: brier / count, regret: None })
    }

    /// Returns the mean of several scores; `None` without any.
    pub fn mean(scores: &[Score]) -> Option<Score> {
        let count = scores.len() as f64;
        let mean = |of: fn(&Score) -> f64| scores.iter().map(of).sum::<f64>() / count;
        let regrets: Option<Vec<f64>> = scores.iter().map(|score| score.regret).collect();
        (!scores.is_empty()).then(|| Score {
            accuracy: mean(|s| s.accuracy),
            nll: mean(|s| s.nll),
            brier: mean(|s| s.brier),
            regret: regrets.map(|regrets| regrets.iter().sum::<f64>() / count),
        })
    }
}

/// A mean over splits, permutations or trials.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// The mean.
    pub mean: f64,
    /// Standard error of the mean; `None` for a single value.
    pub se: Option<f64>,
    /// Number of values.
    pub count: usize,
}

impl Estimate {
    /// Returns the mean of independent values and its standard error s/√J; `None` without values. For divisions of one
    /// data set, the error is that of the limited number of divisions. It does not describe other data sets.
    pub fn over(values: &[f64]) -> Option<Self> {
        Self::overlapping(values, 0.0)
    }

    /// Returns the mean over J splits with overlapping training events; `None` without values. `test_share` is the
    /// number of held-out events divided by that of training events. The standard error is s·√(1/J + test share), after
    /// Nadeau and Bengio (2003), "Inference for the generalization error", Machine Learning 52.
    pub fn overlapping(values: &[f64], test_share: f64) -> Option<Self> {
        let count = values.len() as f64;
        let mean = values.iter().sum::<f64>() / count;
        let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
        let se = (values.len() > 1).then(|| (squares / (count - 1.0) * (1.0 / count + test_share)).sqrt());
        (!values.is_empty()).then_some(Self { mean, se, count: values.len() })
    }

    /// Whether the mean differs from 0 at the 5 % level of Student's t test, with one degree of freedom less than
    /// values. False for a single value.
    pub fn is_clear(&self) -> bool {
        self.se.is_some_and(|se| self.mean.abs() > two_sided_t(self.count - 1) * se)
    }
}

/// Returns the 97.5 % quantile of Student's t: tabulated, then by its expansion in 1/ν (error below .002).
fn two_sided_t(degrees: usize) -> f64 {
    const FIRST: [f64; 5] = [12.706, 4.303, 3.182, 2.776, 2.571];
    const NORMAL: f64 = 1.959_964;
    match degrees {
        0 => f64::INFINITY,
        1..=5 => FIRST[degrees - 1],
        _ => {
            let (z, v) = (NORMAL, degrees as f64);
            let first = (z.powi(3) + z) / 4.0;
            let second = (5.0 * z.powi(5) + 16.0 * z.powi(3) + 3.0 * z) / 96.0;
            let third = (3.0 * z.powi(7) + 19.0 * z.powi(5) + 17.0 * z.powi(3) - 15.0 * z) / 384.0;
            z + first / v + second / v.powi(2) + third / v.powi(3)
        }
    }
}

/// Scores over splits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeanScore {
    /// Accuracy.
    pub accuracy: Estimate,
    /// Negative log-likelihood, in nats.
    pub nll: Estimate,
    /// Brier score.
    pub brier: Estimate,
    /// Regret of decisions, if known.
    pub regret: Option<Estimate>,
}

impl MeanScore {
    /// Returns means over splits with the errors of [`Estimate::overlapping`]; `None` without any.
    pub fn over(splits: &[Score], test_share: f64) -> Option<Self> {
        let over =
            |of: fn(&Score) -> f64| Estimate::overlapping(&splits.iter().map(of).collect::<Vec<_>>(), test_share);
        let regrets: Option<Vec<f64>> = splits.iter().map(|score| score.regret).collect();
        Some(Self {
            accuracy: over(|score| score.accuracy)?,
            nll: over(|score| score.nll)?,
            brier: over(|score| score.brier)?,
            regret: regrets.and_then(|regrets| Estimate::overlapping(&regrets, test_share)),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::streams::stream;
    use rand::RngExt;

    #[test]
    fn certain_but_wrong_predictions_have_finite_nll() {
        let score = Score::new(&[0.0, 1.0], &[true, true]).expect("two events");
        assert_eq!((score.accuracy, score.brier), (0.5, 0.5));
        assert!((score.nll - 0.5 * -1e-12f64.ln()).abs() < 1e-9);
        assert_eq!(Score::new(&[], &[]), None);
    }

    #[test]
    fn the_standard_error_is_that_of_a_mean() {
        let mean = Estimate::over(&[0.1, 0.2, 0.3]).expect("three values");
        assert!((mean.mean - 0.2).abs() < 1e-12);
        assert!((mean.se.expect("three values") - 0.1 / 3f64.sqrt()).abs() < 1e-12);
        let single = Estimate::over(&[0.1]).expect("one value");
        assert!(single.se.is_none() && !single.is_clear());
        assert_eq!(Estimate::over(&[]), None);
    }

    #[test]
    fn overlapping_splits_have_larger_errors() {
        // With 35 held out of 100 events, the error is 2.5 times that of independent values for ten splits, and 7.4
        // times for a hundred.
        for (count, times) in [(10, 2.53), (100, 7.41)] {
            let values: Vec<f64> = (0..count).map(|n| f64::from(n % 7)).collect();
            let [naive, corrected] = [0.0, 35.0 / 65.0].map(|share| Estimate::overlapping(&values, share));
            let ratio = corrected.expect("values").se.expect("several") / naive.expect("values").se.expect("several");
            assert!((ratio - times).abs() < 0.01, "{ratio}");
        }
    }

    /// Two methods are equally good on average, on data sets of 100 events. Counts how often ten random splits of a
    /// data set show a significant difference. Here splits overlap only in their held-out events. With learning they
    /// also overlap in their training events.
    #[test]
    fn significant_differences_are_rarely_chance() {
        let (mut clear, mut naive) = (0, 0);
        let trials = 400;
        for trial in 0..trials {
            let mut rng = stream(7, trial);
            // Losses differ only by noise. The noise is symmetric, so neither method is better.
            let losses: Vec<f64> = (0..100).map(|_| rng.random::<f64>() - 0.5).collect();
            let differences: Vec<f64> = (0..10)
                .map(|_| {
                    let held_out = rand::seq::index::sample(&mut rng, 100, 35);
                    held_out.iter().map(|n| losses[n]).sum::<f64>() / 35.0
                })
                .collect();
            clear += u32::from(Estimate::overlapping(&differences, 35.0 / 65.0).expect("ten").is_clear());
            naive += u32::from(Estimate::over(&differences).expect("ten").is_clear());
        }
        // The 5 % level is 20 of 400. The naive error is too small in a third of all cases or more.
        assert!(clear <= 36, "{clear}");
        assert!(naive > 100, "{naive}");
    }

    #[test]
    fn few_splits_need_wide_margins() {
        let tabulated = [(1, 12.706), (5, 2.571), (6, 2.447), (9, 2.262), (19, 2.093), (99, 1.984)];
        for (degrees, expected) in tabulated {
            assert!((two_sided_t(degrees) - expected).abs() < 0.002, "{degrees}: {}", two_sided_t(degrees));
        }
        assert!(two_sided_t(0).is_infinite());
    }
}
