//! How good predictions are: accuracy and negative log-likelihood.

/// Probabilities are held this far from 0 and 1 before the logarithm, so that one certain miss costs 28 nats, not
/// infinity.
const PROBABILITY_MIN: f64 = 1e-12;

/// The score of one set of predictions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Score {
    /// Share of events on the right side of ½ (p > ½ predicts success).
    pub accuracy: f64,
    /// Mean negative log-likelihood, in nats.
    pub nll: f64,
}

impl Score {
    /// Scores `probabilities` of success against what happened; `None` without events.
    pub fn new(probabilities: &[f64], outcomes: &[bool]) -> Option<Self> {
        if outcomes.is_empty() {
            return None;
        }
        let (mut right, mut nll) = (0.0, 0.0);
        for (&p, &success) in probabilities.iter().zip(outcomes) {
            right += f64::from(u8::from((p > 0.5) == success));
            let p = p.clamp(PROBABILITY_MIN, 1.0 - PROBABILITY_MIN);
            nll -= if success { p.ln() } else { (-p).ln_1p() };
        }
        let count = outcomes.len() as f64;
        Some(Self { accuracy: right / count, nll: nll / count })
    }

    /// The mean of several scores; `None` without any.
    pub fn mean(scores: &[Score]) -> Option<Score> {
        let count = scores.len() as f64;
        let mean = |of: fn(&Score) -> f64| scores.iter().map(of).sum::<f64>() / count;
        (!scores.is_empty()).then(|| Score { accuracy: mean(|s| s.accuracy), nll: mean(|s| s.nll) })
    }
}

/// A mean over splits or permutations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// The mean.
    pub mean: f64,
    /// Its standard error; `None` with a single value.
    pub se: Option<f64>,
}

impl Estimate {
    /// Mean and standard error; `None` without values.
    pub fn over(values: &[f64]) -> Option<Self> {
        let count = values.len() as f64;
        let mean = values.iter().sum::<f64>() / count;
        let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
        let se = (values.len() > 1).then(|| (squares / (count - 1.0) / count).sqrt());
        (!values.is_empty()).then_some(Self { mean, se })
    }
}

/// Scores over splits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeanScore {
    /// Mean accuracy.
    pub accuracy: f64,
    /// Standard error of the mean accuracy over splits; `None` with one split.
    pub accuracy_se: Option<f64>,
    /// Mean negative log-likelihood, in nats.
    pub nll: f64,
    /// Standard error of the mean negative log-likelihood over splits; `None` with one split.
    pub nll_se: Option<f64>,
}

impl MeanScore {
    /// Mean and standard error over splits; `None` without any.
    pub fn over(splits: &[Score]) -> Option<Self> {
        let over = |of: fn(&Score) -> f64| Estimate::over(&splits.iter().map(of).collect::<Vec<_>>());
        let (accuracy, nll) = (over(|score| score.accuracy)?, over(|score| score.nll)?);
        Some(Self { accuracy: accuracy.mean, accuracy_se: accuracy.se, nll: nll.mean, nll_se: nll.se })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn certain_and_wrong_is_dear_but_finite() {
        let score = Score::new(&[0.0, 1.0], &[true, true]).expect("two events");
        assert_eq!(score.accuracy, 0.5);
        assert!((score.nll - 0.5 * -1e-12f64.ln()).abs() < 1e-9);
        assert_eq!(Score::new(&[], &[]), None);
    }

    #[test]
    fn the_standard_error_is_that_of_a_mean() {
        let scores = [0.1, 0.2, 0.3].map(|nll| Score { accuracy: 1.0, nll });
        let mean = MeanScore::over(&scores).expect("three splits");
        assert!((mean.nll - 0.2).abs() < 1e-12);
        assert!((mean.nll_se.expect("three splits") - 0.1 / 3f64.sqrt()).abs() < 1e-12);
        assert_eq!(MeanScore::over(&scores[..1]).expect("one split").nll_se, None);
    }
}
