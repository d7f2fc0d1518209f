//! Baselines: the base rate, and logistic regression on the distance.

use pingmap_agent::Link;

/// Returns the share of successes. Half an event of each kind is added, so that the share is never 0 or 1.
pub fn base_rate(outcomes: &[bool]) -> f64 {
    let successes = outcomes.iter().filter(|&&success| success).count();
    (successes as f64 + 0.5) / (outcomes.len() as f64 + 1.0)
}

/// Logistic regression of success on the distance between the ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DistanceOnly {
    intercept: f64,
    /// Log-odds per `unit_m`.
    slope: f64,
    /// Mean distance of the training links. Dividing by it makes the fit independent of the scale of the site.
    unit_m: f64,
}

/// Precision of the normal prior of the slope, which keeps the slope finite if distance separates the classes.
const SLOPE_PRECISION: f64 = 0.01;

/// Precision of the normal prior of the intercept. It matters only for logs with one class.
const INTERCEPT_PRECISION: f64 = 1e-4;

impl DistanceOnly {
    /// Fits by Newton's method. The penalised likelihood is concave, and steps are halved until it rises, so the method
    /// converges from zero. O(N) per step.
    pub fn fit(links: &[Link], outcomes: &[bool]) -> Self {
        let mean_m = links.iter().map(Link::range_m).sum::<f64>() / links.len().max(1) as f64;
        let mut fit = Self { intercept: 0.0, slope: 0.0, unit_m: if mean_m > 0.0 { mean_m } else { 1.0 } };
        let ranges: Vec<f64> = links.iter().map(|link| link.range_m() / fit.unit_m).collect();
        let mut objective = fit.objective(&ranges, outcomes);
        for _ in 0..100 {
            let (mut gradient, mut h) = (
                [-INTERCEPT_PRECISION * fit.intercept, -SLOPE_PRECISION * fit.slope],
                [INTERCEPT_PRECISION, 0.0, SLOPE_PRECISION],
            );
            for (&range, &success) in ranges.iter().zip(outcomes) {
                let p = fit.probability_at(range);
                let error = f64::from(u8::from(success)) - p;
                gradient = [gradient[0] + error, gradient[1] + error * range];
                let weight = p * (1.0 - p);
                h = [h[0] + weight, h[1] + weight * range, h[2] + weight * range * range];
            }
            let determinant = h[0] * h[2] - h[1] * h[1];
            let step = [
                (h[2] * gradient[0] - h[1] * gradient[1]) / determinant,
                (h[0] * gradient[1] - h[1] * gradient[0]) / determinant,
            ];
            let Some((next, risen)) = fit.best_along(step, objective, &ranges, outcomes) else { break };
            let settled = risen - objective < 1e-12 * objective.abs();
            (fit, objective) = (next, risen);
            if settled {
                break;
            }
        }
        fit
    }

    /// Returns the first of the whole step, its half, its quarter … that raises the objective.
    fn best_along(self, step: [f64; 2], objective: f64, ranges: &[f64], outcomes: &[bool]) -> Option<(Self, f64)> {
        let mut share = 1.0;
        while share > 1e-6 {
            let next =
                Self { intercept: self.intercept + share * step[0], slope: self.slope + share * step[1], ..self };
            let risen = next.objective(ranges, outcomes);
            if risen > objective {
                return Some((next, risen));
            }
            share *= 0.5;
        }
        None
    }

    /// Returns the penalised log-likelihood.
    fn objective(&self, ranges: &[f64], outcomes: &[bool]) -> f64 {
        let log_likelihood: f64 = ranges
            .iter()
            .zip(outcomes)
            .map(|(range, &success)| {
                let odds = self.intercept + self.slope * range;
                let odds = if success { odds } else { -odds };
                // This is ln σ(odds) without overflow.
                odds.min(0.0) - (-odds.abs()).exp().ln_1p()
            })
            .sum();
        let penalty = INTERCEPT_PRECISION * self.intercept.powi(2) + SLOPE_PRECISION * self.slope.powi(2);
        log_likelihood - 0.5 * penalty
    }

    fn probability_at(&self, range: f64) -> f64 {
        1.0 / (1.0 + (-self.intercept - self.slope * range).exp())
    }

    /// Returns the probability of success over a link.
    pub fn probability(&self, link: &Link) -> f64 {
        self.probability_at(link.range_m() / self.unit_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pingmap_agent::Position;

    fn links(ranges_m: &[f64]) -> Vec<Link> {
        let link =
            |&range_m: &f64| Link { transmitter: Position::new(0.0, 0.0), receiver: Position::new(0.0, range_m) };
        ranges_m.iter().map(link).collect()
    }

    #[test]
    fn the_gradient_vanishes_at_the_fit() {
        let links = links(&[100.0, 300.0, 500.0, 700.0, 900.0, 1100.0]);
        let outcomes = [true, true, false, true, false, false];
        let fit = DistanceOnly::fit(&links, &outcomes);
        let residual: f64 = links.iter().zip(outcomes).map(|(l, y)| f64::from(u8::from(y)) - fit.probability(l)).sum();
        assert!((residual - INTERCEPT_PRECISION * fit.intercept).abs() < 1e-6, "{residual}");
        assert!(fit.slope < 0.0);
    }

    #[test]
    fn separable_and_one_sided_logs_stay_finite() {
        let links = links(&[100.0, 200.0, 800.0, 900.0]);
        for outcomes in [[true, true, false, false], [true; 4], [false; 4]] {
            let fit = DistanceOnly::fit(&links, &outcomes);
            for (link, outcome) in links.iter().zip(outcomes) {
                let p = fit.probability(link);
                assert!(p.is_finite() && (p > 0.5) == outcome, "{fit:?} {p}");
            }
        }
        assert!(base_rate(&[true; 4]) < 1.0 && base_rate(&[]) == 0.5);
    }
}
