//! What can be written down is read back the same, and checked.

#![allow(clippy::unwrap_used)]

use dgpc::*;
use serde::{Serialize, de::DeserializeOwned};
use serde_json::{Value, json};

fn prior() -> Prior {
    let path = Correlation::isotropic(Shape::Matern32, &[0, 1], 1.5).unwrap();
    let noise = Correlation::new(Shape::RationalQuadratic { alpha: 0.7 }, &[2], &[0.4]).unwrap();
    let term = Term::of(2.0, path).unwrap().times(noise).unwrap();
    let term = term.reciprocal(Reflection::swap(&[(0, 1)]).unwrap()).unwrap();
    let other = Term::new(Shape::SquaredExponential, 0.5, &[1, 2], &[1.0, 3.0]).unwrap();
    let mean = PriorMean::range(1.0, 0.25, &[0], &[2]).unwrap();
    Prior::new(Kernel::new(vec![term, other]).unwrap(), mean).unwrap()
}

fn summary() -> Summary {
    let inputs = Inputs::from_rows(&[[0.0, 1.0, 2.0], [1.0, 0.5, -1.0], [2.0, 2.0, 0.0]]).unwrap();
    let observations = Observations::new(inputs.clone(), vec![true, false, true]).unwrap();
    let sites = Sites::new(&observations, vec![0.2; 3]).unwrap();
    Summary::marginal(&prior(), &sites, &inputs.select(&[0, 2])).unwrap()
}

fn there_and_back<T: Serialize + DeserializeOwned>(value: &T) -> T {
    serde_json::from_str(&serde_json::to_string(value).unwrap()).unwrap()
}

#[test]
fn everything_is_read_back_the_same() {
    let (prior, summary) = (prior(), summary());
    let again = there_and_back(&prior);
    assert_eq!(again, prior);
    assert_eq!(again.parameters(), prior.parameters());
    assert!(again.has_structure_of(&prior), "ties are written down too");
    for mean in [PriorMean::Zero, PriorMean::Constant(-0.5), prior.mean().clone()] {
        assert_eq!(there_and_back(&mean), mean);
    }
    let again = there_and_back(&summary);
    assert_eq!(again.prior(), summary.prior());
    assert_eq!(again.inducing_points(), summary.inducing_points());
    assert_eq!(again.whitened_precision(), summary.whitened_precision());
    assert_eq!(again.whitened_shift(), summary.whitened_shift());
    let factor = summary.factor().unwrap();
    assert_eq!(there_and_back(&factor), factor);
}

/// Changes one place of what is written down, and expects it to be refused for this reason.
fn refused<T: Serialize + DeserializeOwned>(value: &T, place: &str, bad: Value, why: &str) {
    let mut json = serde_json::to_value(value).unwrap();
    *json.pointer_mut(place).unwrap_or_else(|| panic!("no {place} in what is written down")) = bad;
    let error = serde_json::from_value::<T>(json).err().unwrap_or_else(|| panic!("{place} was taken"));
    assert!(error.to_string().contains(why), "{place}: {error}");
}

#[test]
fn everything_is_checked_when_it_is_read_back() {
    let (prior, summary) = (prior(), summary());
    refused(&prior, "/kernel/0/variance", json!(-1.0), "kernel variance");
    refused(&prior, "/kernel", json!([]), "number of kernel terms");
    refused(&prior, "/kernel/0/correlations", json!([]), "number of correlations");
    refused(&prior, "/kernel/0/correlations/0/length_scales/1", json!(2.0), "tied columns need equal length-scales");
    refused(&prior, "/kernel/0/correlations/0/shape", json!("cubic"), "no kernel shape is called \"cubic\"");
    refused(&prior, "/kernel/0/correlations/1/shape", json!("rational-quadratic:-2"), "rational quadratic");
    refused(&prior, "/kernel/0/reflection/0/source", json!(2), "must lead back");
    refused(&prior, "/kernel/1/correlations/0/columns/1", json!(1), "column 1 twice");
    refused(&prior, "/mean/range/to", json!([1, 2]), "columns of the two ends");
    refused(&summary, "/whitened_shift", json!([1.0]), "entries of a summary's shift");
    refused(&summary, "/whitened_precision/rows", json!(3), "entries of a matrix");
    refused(&summary, "/inducing_points/dimension", json!(0), "input dimension");
    refused(&summary.factor().unwrap(), "/shift", json!([]), "entries of a factor's shift");
}
