//! Serialised values are read back unchanged, and invalid ones are refused.

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

fn sites() -> Sites {
    let inputs = Inputs::from_rows(&[[0.0, 1.0, 2.0], [1.0, 0.5, -1.0], [2.0, 2.0, 0.0]]).unwrap();
    let observations = Observations::new(inputs, vec![true, false, true]).unwrap();
    Sites::new(&observations, vec![0.2; 3]).unwrap()
}

fn summary() -> Summary {
    let sites = sites();
    Summary::marginal(&prior(), &sites, &sites.inputs().select(&[0, 2])).unwrap()
}

fn round_trip<T: Serialize + DeserializeOwned>(value: &T) -> T {
    serde_json::from_str(&serde_json::to_string(value).unwrap()).unwrap()
}

#[test]
fn all_types_round_trip() {
    let (prior, summary) = (prior(), summary());
    let again = round_trip(&prior);
    assert_eq!(again, prior);
    assert_eq!(again.parameters(), prior.parameters());
    assert!(again.has_structure_of(&prior), "ties are serialised, too");
    for mean in [PriorMean::Zero, PriorMean::Constant(-0.5), prior.mean().clone()] {
        assert_eq!(round_trip(&mean), mean);
    }
    let again = round_trip(&summary);
    assert_eq!(again.prior(), summary.prior());
    assert_eq!(again.inducing_points(), summary.inducing_points());
    assert_eq!(again.whitened_precision(), summary.whitened_precision());
    assert_eq!(again.whitened_shift(), summary.whitened_shift());
    assert_eq!(round_trip(&sites()), sites());
    let factor = summary.factor().unwrap();
    assert_eq!(round_trip(&factor), factor);
}

/// Replaces one value in the serialised form, and asserts that it is refused for the given reason.
fn refused<T: Serialize + DeserializeOwned>(value: &T, place: &str, bad: Value, why: &str) {
    let mut json = serde_json::to_value(value).unwrap();
    *json.pointer_mut(place).unwrap_or_else(|| panic!("no {place} in the serialised form")) = bad;
    let error = serde_json::from_value::<T>(json).err().unwrap_or_else(|| panic!("{place} was accepted"));
    assert!(error.to_string().contains(why), "{place}: {error}");
}

#[test]
fn deserialisation_checks_values() {
    let (prior, summary) = (prior(), summary());
    refused(&prior, "/kernel/0/variance", json!(-1.0), "kernel variance");
    refused(&prior, "/kernel", json!([]), "number of kernel terms");
    refused(&prior, "/kernel/0/correlations", json!([]), "number of correlations");
    refused(&prior, "/kernel/0/correlations/0/length_scales/1", json!(2.0), "tied columns need equal length-scales");
    refused(&prior, "/kernel/0/correlations/0/shape", json!("cubic"), "no kernel shape is called \"cubic\"");
    refused(&prior, "/kernel/0/correlations/1/shape", json!("rational-quadratic:-2"), "rational quadratic");
    refused(&prior, "/kernel/0/reflection/0/source", json!(2), "must be an involution");
    refused(&prior, "/kernel/1/correlations/0/columns/1", json!(1), "column 1 twice");
    refused(&prior, "/mean/range/to", json!([1, 2]), "columns of the two ends");
    refused(&summary, "/whitened_shift", json!([1.0]), "entries of a summary's shift");
    refused(&summary, "/whitened_precision/rows", json!(3), "entries of a matrix");
    refused(&summary, "/inducing_points/dimension", json!(0), "input dimension");
    refused(&sites(), "/omega/1", json!(-0.1), "Pólya-Gamma variable ω must be");
    refused(&sites(), "/omega", json!([0.2]), "Pólya-Gamma variables, one per site");
    refused(&sites(), "/kappa", json!([0.5, 0.5, 0.5, 0.5]), "κ, one per site: expected 3, found 4");
    refused(&summary.factor().unwrap(), "/shift", json!([]), "entries of a factor's shift");
}
