//! Detects that rounding errors prevent an iteration from coming closer to its fixed point.

/// The iteration stagnates if this number of iterations brought no smaller change.
const ITERATIONS: usize = 20;

/// Largest relative gain of the evidence bound over these iterations.
const GAIN: f64 = 1e-12;

/// The reason why a fit ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum FitStop {
    /// No tilt changed by more than the tolerance.
    Converged,
    /// Neither the change of the tilts fell nor E rose over 20 iterations. Rounding errors prevent a smaller change.
    Stagnated,
    /// The fit made the largest allowed number of iterations.
    IterationsMax,
}

/// The smallest change of an iteration so far.
pub(super) struct Stagnation {
    change: f64,
    /// E when the change was smallest.
    evidence: f64,
    /// Number of iterations since then.
    iterations: usize,
}

impl Stagnation {
    pub(super) fn new() -> Self {
        Self { change: f64::INFINITY, evidence: f64::NEG_INFINITY, iterations: 0 }
    }

    /// Records an iteration, and returns whether the iteration stagnates.
    pub(super) fn record(&mut self, change: f64, evidence: f64) -> bool {
        let gain = evidence - self.evidence;
        if change < self.change {
            *self = Self { change, evidence, iterations: 0 };
        } else if gain > GAIN * evidence.abs() {
            (self.evidence, self.iterations) = (evidence, 0);
        } else {
            self.iterations += 1;
        }
        self.iterations >= ITERATIONS
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_iteration_stagnates_if_neither_change_nor_evidence_improves() {
        let run = |change: &dyn Fn(i32) -> f64, evidence: &dyn Fn(i32) -> f64| {
            let mut stagnation = Stagnation::new();
            (0..500).position(|n| stagnation.record(change(n), evidence(n)))
        };
        let falling = |n: i32| 0.99f64.powi(n);
        let rounded = |n: i32| falling(n).max(1e-2) * if n % 2 == 0 { 1.0 } else { 1.5 };
        let rising = |n: i32| -1000.0 - 1e-6 * falling(n);
        assert_eq!(run(&falling, &|_| -1000.0), None, "the change falls slowly");
        assert_eq!(run(&|_| 0.1, &rising), None, "the evidence rises slowly");
        assert_eq!(run(&|_| 0.1, &|_| -1000.0), Some(20));
        let stop = run(&rounded, &|n| -1000.0 - 1e-6 * falling(4 * n)).expect("both end");
        assert!((460..=482).contains(&stop), "{stop}");
    }
}
