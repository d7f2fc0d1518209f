//! Statistics and columns of the tables.

use pingmap_trial::{Estimate, Score};

/// Returns the mean; NaN without values.
pub(crate) fn mean(values: impl IntoIterator<Item = f64>) -> f64 {
    let values: Vec<f64> = values.into_iter().collect();
    Estimate::over(&values).map_or(f64::NAN, |estimate| estimate.mean)
}

/// Returns the mean of each column.
pub(crate) fn column_means<const N: usize>(rows: &[[f64; N]]) -> [f64; N] {
    std::array::from_fn(|column| mean(rows.iter().map(|row| row[column])))
}

/// Returns the mean negative log-likelihood of outcomes; NaN without outcomes.
pub(crate) fn nll(probabilities: &[f64], outcomes: &[bool]) -> f64 {
    Score::new(probabilities, outcomes).map_or(f64::NAN, |score| score.nll)
}

/// Returns a statistic of `count` parts, and its jackknife standard error. The argument of `statistic` is the part to
/// omit, if any.
pub(crate) fn jackknife(count: usize, statistic: impl Fn(Option<usize>) -> f64) -> (f64, f64) {
    let without: Vec<f64> = (0..count).map(|part| statistic(Some(part))).collect();
    let center = mean(without.iter().copied());
    let squares: f64 = without.iter().map(|one| (one - center).powi(2)).sum();
    (statistic(None), (squares * (count as f64 - 1.0) / count as f64).sqrt())
}

/// Formats numbers with this many decimals, separated by two spaces.
pub(crate) fn columns(numbers: &[f64], decimals: usize) -> String {
    let cells: Vec<String> = numbers.iter().map(|number| format!("{number:.decimals$}")).collect();
    cells.join("  ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_are_by_column() {
        assert_eq!(column_means(&[[1.0, 4.0], [3.0, 0.0]]), [2.0, 2.0]);
        assert!(mean([]).is_nan());
    }

    #[test]
    fn certain_outcomes_have_no_loss() {
        assert!(nll(&[1.0, 0.0], &[true, false]) < 1e-9);
        assert!((nll(&[0.5], &[true]) - std::f64::consts::LN_2).abs() < 1e-12);
        assert!(nll(&[], &[]).is_nan());
    }

    #[test]
    fn the_jackknife_error_of_a_mean_is_its_standard_error() {
        let values = [0.1, 0.2, 0.6, 0.4];
        let without = |omitted: Option<usize>| {
            mean(values.iter().enumerate().filter(|&(n, _)| Some(n) != omitted).map(|(_, &value)| value))
        };
        let (value, se) = jackknife(values.len(), without);
        let expected = Estimate::over(&values).expect("four values");
        assert!((value - expected.mean).abs() < 1e-12);
        assert!((se - expected.se.expect("four values")).abs() < 1e-12, "{se} {expected:?}");
    }

    #[test]
    fn columns_have_fixed_decimals() {
        assert_eq!(columns(&[0.25, 1.0], 3), "0.250  1.000");
    }
}
