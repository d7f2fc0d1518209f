//! Bounded numbers and their codes.

use crate::schema::Number;

/// How far the bounds may lie from multiples of the resolution: as far as DCCL lets them, for what doubles cannot hold.
const NEARLY: f64 = 1e-10;

impl Number {
    /// Whether both bounds are multiples of the resolution, as far as doubles can tell.
    pub(crate) fn has_bounds_on_steps(&self) -> bool {
        [self.min, self.max].iter().all(|bound| libm::fabs(self.nearest_multiple(*bound) - bound) < NEARLY)
    }

    /// How many values there are.
    pub(crate) fn codes(&self) -> u64 {
        self.steps(self.quantise(self.max) - self.quantise(self.min)).saturating_add(1)
    }

    /// The nearest multiple of the resolution, by DCCL's order of operations.
    pub(crate) fn quantise(&self, value: f64) -> f64 {
        let step = self.resolution;
        if self.integer && step >= 1.0 {
            if step == 1.0 && value == libm::floor(value) {
                // The remainder would be 0, and takes most of the time of decoding a packet.
                return value;
            }
            let rest = libm::fmod(value, step);
            return value - rest + if rest >= step / 2.0 { step } else { 0.0 };
        }
        self.nearest_multiple(value)
    }

    /// The same by the rule for numbers that need not be whole.
    fn nearest_multiple(&self, value: f64) -> f64 {
        let step = self.resolution;
        if step >= 1.0 {
            return libm::floor(value / step + 0.5) * step;
        }
        let inverse = 1.0 / step;
        libm::floor(value * inverse + 0.5) / inverse
    }

    /// The code of a value, or `None` outside the bounds. The quantised bounds count: quantising may move a bound by
    /// the last bit of a double, and the bound itself must have a code.
    pub(crate) fn code(&self, value: f64) -> Option<u64> {
        if !value.is_finite() || (self.integer && value != libm::floor(value)) {
            return None;
        }
        let (lowest, highest) = (self.quantise(self.min), self.quantise(self.max));
        let quantised = self.quantise(value);
        (lowest <= quantised && quantised <= highest).then(|| self.steps(quantised - lowest))
    }

    /// How many steps it is to a value this far above the smallest one.
    fn steps(&self, offset: f64) -> u64 {
        let steps = if self.resolution >= 1.0 { offset / self.resolution } else { offset * (1.0 / self.resolution) };
        // Not the floor after adding one half, which is lost beyond 2^52. Below that they are the same.
        libm::round(steps) as u64
    }

    /// The value of a code.
    pub(crate) fn value(&self, code: u64) -> f64 {
        let code = code as f64;
        let offset = if self.resolution >= 1.0 { code * self.resolution } else { code / (1.0 / self.resolution) };
        self.quantise(offset + self.quantise(self.min))
    }
}
