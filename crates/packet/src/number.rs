//! Bounded numbers and their codes.

use crate::schema::Number;

impl Number {
    /// How many values there are.
    pub(crate) fn codes(&self) -> u64 {
        (libm::floor((self.max - self.min) / self.resolution + 1e-6) as u64).saturating_add(1)
    }

    /// The nearest multiple of the resolution, by DCCL's order of operations.
    pub(crate) fn quantise(&self, value: f64) -> f64 {
        let step = self.resolution;
        if self.integer && step >= 1.0 {
            let rest = libm::fmod(value, step);
            return value - rest + if rest >= step / 2.0 { step } else { 0.0 };
        }
        if step >= 1.0 {
            return libm::floor(value / step + 0.5) * step;
        }
        let inverse = 1.0 / step;
        libm::floor(value * inverse + 0.5) / inverse
    }

    /// The code of a value, or `None` outside the bounds and where bounds between the steps leave no code for it.
    pub(crate) fn code(&self, value: f64) -> Option<u64> {
        if !value.is_finite() || (self.integer && value != libm::floor(value)) {
            return None;
        }
        let quantised = self.quantise(value);
        if quantised < self.min || quantised > self.max {
            return None;
        }
        let offset = quantised - self.quantise(self.min);
        let code = if self.resolution >= 1.0 { offset / self.resolution } else { offset * (1.0 / self.resolution) };
        Some(libm::floor(code + 0.5) as u64).filter(|&code| code < self.codes())
    }

    /// The value of a code.
    pub(crate) fn value(&self, code: u64) -> f64 {
        let code = code as f64;
        let offset = if self.resolution >= 1.0 { code * self.resolution } else { code / (1.0 / self.resolution) };
        self.quantise(offset + self.quantise(self.min))
    }
}
