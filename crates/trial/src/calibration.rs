//! Calibration of probabilities: reliability, and coverage of intervals.

use dgpc::Latent;

/// Number of bins of the predicted probability.
const BINS: usize = 10;

/// Central intervals of the latent posterior: their probability, and their half-width in standard deviations.
pub const INTERVALS: [(f64, f64); 2] = [(0.5, 0.674_490), (0.9, 1.644_854)];

/// True probabilities are clamped this far from 0 and 1 before their log-odds are computed.
const TRUTH_MIN: f64 = 1e-6;

/// Counts of predictions and outcomes.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// Ten bins of the predicted probability, each a tenth wide.
    pub bins: [Bin; BINS],
    /// Number of events with known true log-odds.
    known: usize,
    /// Number of those events within each of [`INTERVALS`].
    within: [usize; INTERVALS.len()],
}

/// Events whose predicted probability lies within a tenth.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Bin {
    /// Number of events.
    pub events: usize,
    /// Sum of their predicted probabilities.
    probability: f64,
    /// Number of events that were heard.
    heard: usize,
}

impl Bin {
    /// Returns the mean predicted probability; `None` without events.
    pub fn predicted(&self) -> Option<f64> {
        (self.events > 0).then(|| self.probability / self.events as f64)
    }

    /// Returns the share of heard events; `None` without events.
    pub fn heard(&self) -> Option<f64> {
        (self.events > 0).then(|| self.heard as f64 / self.events as f64)
    }
}

impl Calibration {
    /// Returns counts of no events.
    pub fn new() -> Self {
        Self { bins: [Bin::default(); BINS], known: 0, within: [0; INTERVALS.len()] }
    }

    /// Counts predictions and outcomes. If the true probabilities are known, also counts how often the intervals of
    /// `wide` contain the true log-odds.
    pub fn count(&mut self, predicted: &[f64], wide: &Latent, outcomes: &[bool], truth: Option<&[f64]>) {
        for (&p, &success) in predicted.iter().zip(outcomes) {
            let bin = &mut self.bins[((p * BINS as f64) as usize).min(BINS - 1)];
            bin.events += 1;
            bin.probability += p;
            bin.heard += usize::from(success);
        }
        for ((&mean, &variance), &truth) in wide.mean.iter().zip(&wide.variance).zip(truth.unwrap_or_default()) {
            let truth = truth.clamp(TRUTH_MIN, 1.0 - TRUTH_MIN);
            let away = ((truth / (1.0 - truth)).ln() - mean).abs() / variance.sqrt();
            self.known += 1;
            for (within, (_, reach)) in self.within.iter_mut().zip(INTERVALS) {
                *within += usize::from(away <= reach);
            }
        }
    }

    /// Adds the counts of another calibration.
    pub fn add(&mut self, other: &Self) {
        for (bin, more) in self.bins.iter_mut().zip(&other.bins) {
            bin.events += more.events;
            bin.probability += more.probability;
            bin.heard += more.heard;
        }
        self.known += other.known;
        self.within.iter_mut().zip(other.within).for_each(|(within, more)| *within += more);
    }

    /// Returns the expected calibration error: the difference between mean prediction and share of heard events in a
    /// bin, averaged over events. 0 without events.
    pub fn expected_error(&self) -> f64 {
        let events: usize = self.bins.iter().map(|bin| bin.events).sum();
        let off = self.bins.iter().map(|bin| (bin.probability - bin.heard as f64).abs()).sum::<f64>();
        off / events.max(1) as f64
    }

    /// Returns the coverage of each of [`INTERVALS`]; `None` if no true log-odds are known.
    pub fn coverage(&self) -> Option<[f64; INTERVALS.len()]> {
        (self.known > 0).then(|| self.within.map(|within| within as f64 / self.known as f64))
    }
}

impl Default for Calibration {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::streams::stream;
    use rand::RngExt;

    /// Returns counts for latent functions with variance 1, and true log-odds drawn from them.
    fn drawn(count: usize, overconfidence: f64) -> Calibration {
        let mut rng = stream(3, 0);
        // The sum of twelve uniform numbers, minus six, is nearly standard normal.
        let mut normal = || (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0;
        let means: Vec<f64> = (0..count).map(|_| 1.5 * normal()).collect();
        let truth: Vec<f64> = means.iter().map(|mean| 1.0 / (1.0 + (-(mean + normal())).exp())).collect();
        let outcomes: Vec<bool> = truth.iter().map(|&p| rng.random::<f64>() < p).collect();
        let latent = Latent {
            mean: means.iter().map(|mean| overconfidence * mean).collect(),
            variance: vec![1.0 / overconfidence; count],
        };
        let mut calibration = Calibration::new();
        calibration.count(&latent.probability(), &latent, &outcomes, Some(&truth));
        calibration
    }

    #[test]
    fn outcomes_drawn_from_predictions_are_calibrated() {
        let calibration = drawn(20_000, 1.0);
        let [half, most] = calibration.coverage().expect("truth");
        assert!((half - 0.5).abs() < 0.015 && (most - 0.9).abs() < 0.01, "{half} {most}");
        assert!(calibration.expected_error() < 0.012, "{}", calibration.expected_error());
        assert_eq!(calibration.bins.iter().map(|bin| bin.events).sum::<usize>(), 20_000);
        let bin = calibration.bins[9];
        assert!((bin.predicted().expect("events") - bin.heard().expect("events")).abs() < 0.02);
    }

    #[test]
    fn overconfidence_shows_in_both() {
        let (good, bad) = (drawn(20_000, 1.0), drawn(20_000, 3.0));
        assert!(bad.expected_error() > 4.0 * good.expected_error());
        assert!(bad.coverage().expect("truth")[1] < 0.75);
    }

    #[test]
    fn counts_add_up_and_may_be_empty() {
        let part = drawn(100, 1.0);
        let mut sum = part.clone();
        sum.add(&part);
        assert_eq!(sum.expected_error(), part.expected_error());
        assert_eq!(sum.coverage(), part.coverage());
        assert_eq!((Calibration::new().coverage(), Calibration::new().expected_error()), (None, 0.0));
        assert!(Calibration::new().bins[0].predicted().is_none());
    }
}
