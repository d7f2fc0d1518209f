//! Special functions. None of them overflows.

/// Returns Φ(x), the standard normal distribution function.
pub(crate) fn normal_cdf(x: f64) -> f64 {
    0.5 * libm::erfc(-x * std::f64::consts::FRAC_1_SQRT_2)
}

/// Returns the standard normal density at x.
pub(crate) fn normal_density(x: f64) -> f64 {
    (-0.5 * x * x).exp() * (0.5 * std::f64::consts::FRAC_1_PI).sqrt()
}

/// Returns σ(f), the logistic function.
pub(crate) fn logistic(f: f64) -> f64 {
    if f >= 0.0 {
        1.0 / (1.0 + (-f).exp())
    } else {
        let odds = f.exp();
        odds / (1.0 + odds)
    }
}

/// Returns ln σ(f).
pub(crate) fn ln_logistic(f: f64) -> f64 {
    0.5 * f - ln_2_cosh(0.5 * f)
}

/// Returns ln(2 cosh x).
pub(crate) fn ln_2_cosh(x: f64) -> f64 {
    x.abs() + (-2.0 * x.abs()).exp().ln_1p()
}
