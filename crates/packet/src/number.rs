//! Bounded numbers and their codes.

use crate::schema::Number;

/// Largest distance of a bound from a multiple of the resolution. DCCL uses the same tolerance for rounding errors of
/// doubles.
const NEARLY: f64 = 1e-10;

impl Number {
    /// Returns whether both bounds are multiples of the resolution, up to rounding errors.
    pub(crate) fn has_bounds_on_steps(&self) -> bool {
        [self.min, self.max].iter().all(|bound| libm::fabs(self.nearest_multiple(*bound) - bound) < NEARLY)
    }

    /// Returns the number of values.
    pub(crate) fn codes(&self) -> u64 {
        self.steps(self.quantise(self.max) - self.quantise(self.min)).saturating_add(1)
    }

    /// Returns the nearest multiple of the resolution, computed in DCCL's order of operations.
    pub(crate) fn quantise(&self, value: f64) -> f64 {
        let step = self.resolution;
        if self.integer && step >= 1.0 {
            if step == 1.0 && value == libm::floor(value) {
                // The remainder is 0 here. Computing it would take most of the time of decoding a packet.
                return value;
            }
            let rest = libm::fmod(value, step);
            return value - rest + if rest >= step / 2.0 { step } else { 0.0 };
        }
        self.nearest_multiple(value)
    }

    /// Returns the nearest multiple by the rule for decimal numbers.
    fn nearest_multiple(&self, value: f64) -> f64 {
        let step = self.resolution;
        if step >= 1.0 {
            return libm::floor(value / step + 0.5) * step;
        }
        let inverse = 1.0 / step;
        libm::floor(value * inverse + 0.5) / inverse
    }

    /// Returns the code of a value, or `None` outside the quantised bounds. Quantising may move a bound by the last bit
    /// of a double, and the bound itself must have a code.
    pub(crate) fn code(&self, value: f64) -> Option<u64> {
        if !value.is_finite() || (self.integer && value != libm::floor(value)) {
            return None;
        }
        let (lowest, highest) = (self.quantise(self.min), self.quantise(self.max));
        let quantised = self.quantise(value);
        (lowest <= quantised && quantised <= highest).then(|| self.steps(quantised - lowest))
    }

    /// Returns the number of steps from the smallest value to a value `offset` above it.
    fn steps(&self, offset: f64) -> u64 {
        let steps = if self.resolution >= 1.0 { offset / self.resolution } else { offset * (1.0 / self.resolution) };
        // `floor(steps + 0.5)` gives the same result below 2^52, but loses the half above.
        libm::round(steps) as u64
    }

    /// Returns the value of a code.
    pub(crate) fn value(&self, code: u64) -> f64 {
        let code = code as f64;
        let offset = if self.resolution >= 1.0 { code * self.resolution } else { code / (1.0 / self.resolution) };
        self.quantise(offset + self.quantise(self.min))
    }
}
