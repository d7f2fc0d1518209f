//! The paper's claims and their tests: paired differences over permutations, and rank correlations.

use super::choice::{Choice, Policy};
use crate::score::Estimate;

/// A claim that one choice is better than another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Claim {
    /// The choice that is claimed to be better.
    pub better: Choice,
    /// The choice that is claimed to be worse.
    pub worse: Choice,
}

impl Claim {
    /// Returns all claims: two good points beat one; at two points and at one, good beats random and random beats bad.
    pub fn all() -> Vec<Claim> {
        let claim = |(better, points), (worse, others)| Claim {
            better: Choice { policy: better, points },
            worse: Choice { policy: worse, points: others },
        };
        let mut claims = vec![claim((Policy::Good, 2), (Policy::Good, 1))];
        for points in [2, 1] {
            claims.push(claim((Policy::Good, points), (Policy::Random, points)));
            claims.push(claim((Policy::Random, points), (Policy::Bad, points)));
        }
        claims
    }

    /// Returns the claim as text.
    pub fn text(&self) -> String {
        let Claim { better, worse } = self;
        if better.policy == worse.policy {
            return format!("two {} points beat one", better.policy.name());
        }
        let points = if better.points == 1 { "one point" } else { "two points" };
        format!("{} beats {} at {points}", better.policy.name(), worse.policy.name())
    }

    /// Returns the cost of `worse` minus the cost of `better`, over permutations. The difference is positive if the
    /// claim holds. `cost` returns the cost of a choice in each permutation: NLL, or negative accuracy.
    pub fn difference(&self, cost: impl Fn(Choice) -> Vec<f64>) -> Option<Estimate> {
        let (better, worse) = (cost(self.better), cost(self.worse));
        Estimate::over(&worse.iter().zip(&better).map(|(worse, better)| worse - better).collect::<Vec<_>>())
    }
}

/// Returns Spearman's rank correlation; equal values share their mean rank. Returns `None` if either side has only one
/// value.
pub fn rank_correlation(a: &[f64], b: &[f64]) -> Option<f64> {
    let (a, b) = (ranks(a), ranks(b));
    let middle = (a.len() as f64 - 1.0) / 2.0;
    let product = |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).map(|(a, b)| (a - middle) * (b - middle)).sum() };
    let spread = product(&a, &a) * product(&b, &b);
    (spread > 0.0).then(|| product(&a, &b) / spread.sqrt())
}

fn ranks(values: &[f64]) -> Vec<f64> {
    let rank = |value: &f64| {
        let below = values.iter().filter(|other| *other < value).count() as f64;
        let equal = values.iter().filter(|other| *other == value).count() as f64;
        below + (equal - 1.0) / 2.0
    };
    values.iter().map(rank).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rank_correlation_depends_only_on_order() {
        assert_eq!(rank_correlation(&[1.0, 2.0, 30.0], &[-5.0, 0.0, 0.1]), Some(1.0));
        assert_eq!(rank_correlation(&[1.0, 2.0, 30.0], &[3.0, 2.0, 1.0]), Some(-1.0));
        assert_eq!(rank_correlation(&[1.0, 1.0], &[3.0, 2.0]), None);
        assert_eq!(rank_correlation(&[], &[]), None);
        // By hand: ranks 0, 1.5, 1.5, 3 and 0, 2, 1, 3 have covariance 4.5 and squared norms 4.5 and 5.
        let found = rank_correlation(&[0.0, 1.0, 1.0, 2.0], &[0.0, 2.0, 1.0, 3.0]).expect("both vary");
        assert!((found - 4.5 / (4.5f64 * 5.0).sqrt()).abs() < 1e-12, "{found}");
    }

    #[test]
    fn a_claim_that_holds_has_a_positive_difference() {
        let claim = Claim::all()[1];
        assert_eq!(claim.text(), "good beats random at two points");
        let nll = |choice: Choice| match choice.policy {
            Policy::Good => vec![0.1, 0.2, 0.3],
            _ => vec![0.2, 0.4, 0.3],
        };
        let difference = claim.difference(nll).expect("three permutations");
        assert!((difference.mean - 0.1).abs() < 1e-12);
        assert!((difference.se.expect("three permutations") - 0.1 / 3f64.sqrt()).abs() < 1e-12);
    }
}
