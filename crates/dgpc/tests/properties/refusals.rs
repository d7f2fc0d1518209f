//! What is refused, and how.

use super::problems::*;
use dgpc::*;

#[test]
fn inputs_refuse_what_is_not_finite_or_whole() {
    for (value, name) in [(f64::NAN, "NaN"), (f64::INFINITY, "inf"), (f64::NEG_INFINITY, "-inf")] {
        let refused = Inputs::from_rows(&[[0.0, 1.0], [2.0, value]]).unwrap_err();
        assert!(matches!(refused, Error::NotFinite { row: 1, column: 1, .. }), "{refused}");
        assert!(refused.to_string().contains(name), "{refused}");
    }
    assert!(matches!(Inputs::new(vec![1.0; 5], 2), Err(Error::SizeMismatch { found: 5, .. })));
    assert!(matches!(Inputs::new(vec![1.0], 0), Err(Error::OutOfRange { .. })));
    let refused = line(&[0.0]).append(&Inputs::from_rows(&[[0.0, 1.0]]).unwrap());
    assert!(matches!(refused, Err(Error::SizeMismatch { expected: 1, found: 2, .. })));
}

#[test]
fn terms_refuse_what_is_not_positive() {
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY, -f64::INFINITY] {
        for refused in [
            Term::new(Shape::Matern32, bad, &[0], &[1.0]),
            Term::new(Shape::Matern32, 1.0, &[0, 1], &[1.0, bad]),
            Term::isotropic(Shape::SquaredExponential, 1.0, bad, 2),
        ] {
            assert!(matches!(refused, Err(Error::OutOfRange { .. })), "{bad}: {refused:?}");
        }
        let events = Observations::weighted(line(&[0.0]), vec![true], vec![bad]);
        assert!(matches!(events, Err(Error::OutOfRange { .. })), "{bad}: {events:?}");
        let sites = Sites::new(&Observations::new(line(&[0.0]), vec![true]).unwrap(), vec![bad]);
        assert!(matches!(sites, Err(Error::OutOfRange { .. })), "{bad}: {sites:?}");
    }
    assert!(matches!(Term::new(Shape::Matern32, 1.0, &[], &[]), Err(Error::OutOfRange { .. })));
    assert!(matches!(Term::new(Shape::Matern32, 1.0, &[0, 1], &[1.0]), Err(Error::SizeMismatch { .. })));
    assert!(matches!(
        Term::new(Shape::Matern32, 1.0, &[1, 1], &[1.0; 2]),
        Err(Error::RepeatedColumn { column: 1, .. })
    ));
    assert!(matches!(Kernel::new(vec![]), Err(Error::OutOfRange { .. })));
    assert!(matches!(Reflection::swap(&[(0, 1), (1, 2)]), Err(Error::RepeatedColumn { column: 1, .. })));
    assert!(matches!(Reflection::swap(&[(3, 3)]), Err(Error::RepeatedColumn { column: 3, .. })));
    assert!(matches!(Reflection::negate(&[2, 0, 2]), Err(Error::RepeatedColumn { column: 2, .. })));
}

#[test]
fn prior_means_refuse_what_is_not_finite_or_paired() {
    let kernel = || Kernel::new(vec![Term::isotropic(Shape::Matern32, 1.0, 1.0, 1).unwrap()]).unwrap();
    let range = |intercept, slope, to| PriorMean::Range { intercept, slope, from: vec![0], to };
    for bad in [f64::NAN, f64::INFINITY] {
        for mean in [PriorMean::Constant(bad), range(bad, 1.0, vec![1]), range(1.0, bad, vec![1])] {
            assert!(matches!(Prior::new(kernel(), mean), Err(Error::NotFinite { .. })));
        }
    }
    assert!(matches!(Prior::new(kernel(), range(1.0, 1.0, vec![1, 2])), Err(Error::SizeMismatch { .. })));
}

/// Every function that takes inputs refuses those without the columns that kernel or prior mean look at.
#[test]
fn missing_columns_are_refused() {
    let kernel = |column| Kernel::new(vec![Term::new(Shape::Matern52, 1.0, &[column], &[1.0]).unwrap()]).unwrap();
    let range = PriorMean::Range { intercept: 1.0, slope: 1.0, from: vec![0], to: vec![2] };
    let sites = line_sites();
    let observations = Observations::new(sites.inputs().clone(), vec![true; 12]).unwrap();
    let wide = Inputs::from_rows(&[[0.0, 1.0, 2.0]]).unwrap();
    for prior in [Prior::new(kernel(2), PriorMean::Zero).unwrap(), Prior::new(kernel(0), range).unwrap()] {
        let z = line(&[0.0]);
        let wide_summary = Summary::empty(&prior, &wide).unwrap();
        let fused = Posterior::fuse(&prior, &Sites::empty(3), &[&wide_summary]).unwrap();
        let refused: Vec<Error> = [
            Summary::variational(&prior, &sites, &z).err(),
            Summary::marginal(&prior, &sites, &z).err(),
            Certificate::new(&prior, &sites, &z).err(),
            log_evidence(&prior, &sites).err(),
            Posterior::fuse(&prior, &sites, &[]).err(),
            mean_field::dense(&prior, &observations, &Default::default()).err(),
            mean_field::sparse(&prior, &observations, &z, &Default::default()).err(),
            Gibbs::new(&prior, observations.clone()).err(),
            fused.latent(&z).err(),
            fused.probability(&z).err(),
        ]
        .into_iter()
        .enumerate()
        .map(|(which, error)| error.unwrap_or_else(|| panic!("call {which} did not refuse")))
        .collect();
        for error in refused {
            assert!(matches!(error, Error::BadColumn { column: 2, columns: 1, .. }), "{error}");
        }
    }
    let narrow = kernel(2);
    for refused in [
        narrow.gram(sites.inputs()).err(),
        narrow.cross(&wide, sites.inputs()).err(),
        narrow.cross(sites.inputs(), &wide).err(),
        narrow.diagonal(sites.inputs()).err(),
        Candidates::new(&narrow, sites.inputs()).err(),
        Candidates::given(&narrow, &wide, sites.inputs()).err(),
    ] {
        assert!(matches!(refused, Some(Error::BadColumn { column: 2, columns: 1, .. })), "{refused:?}");
    }
}

#[test]
fn inducing_points_without_a_column_of_the_prior_are_refused() {
    let kernel = |column| Kernel::new(vec![Term::new(Shape::Matern52, 1.0, &[column], &[1.0]).unwrap()]).unwrap();
    let range = PriorMean::Range { intercept: 1.0, slope: 1.0, from: vec![0], to: vec![2] };
    for prior in [Prior::new(kernel(2), PriorMean::Zero).unwrap(), Prior::new(kernel(0), range).unwrap()] {
        let wide = Summary::empty(&prior, &Inputs::from_rows(&[[0.0, 1.0, 2.0]]).unwrap()).unwrap();
        let posterior = Posterior::fuse(&prior, &Sites::empty(3), &[&wide]).unwrap();
        let z = line(&[0.0]);
        for refused in [
            Summary::empty(&prior, &z).err(),
            Summary::from_whitened(&prior, &z, Matrix::zeros(1, 1), vec![0.0]).err(),
            posterior.summarise(&z).err(),
        ] {
            assert!(matches!(refused, Some(Error::BadColumn { column: 2, columns: 1, .. })), "{refused:?}");
        }
    }
}

#[test]
fn sizes_that_differ_are_refused() {
    let prior = line_prior(Shape::Matern52);
    let sites = line_sites();
    let mismatched =
        |refused: Option<Error>| assert!(matches!(refused, Some(Error::SizeMismatch { .. })), "{refused:?}");
    mismatched(Observations::new(line(&[0.0]), vec![]).err());
    mismatched(Observations::weighted(line(&[0.0]), vec![true], vec![1.0; 2]).err());
    mismatched(Sites::new(&Observations::new(line(&[0.0]), vec![true]).unwrap(), vec![]).err());
    mismatched(sites.clone().append(&Sites::empty(2)).err());
    let z = line(&[0.0, 1.0]);
    mismatched(Summary::from_whitened(&prior, &z, Matrix::zeros(1, 2), vec![0.0; 2]).err());
    mismatched(Summary::from_whitened(&prior, &z, Matrix::zeros(2, 1), vec![0.0; 2]).err());
    mismatched(Summary::from_whitened(&prior, &z, Matrix::zeros(2, 2), vec![0.0]).err());
    let wide = Summary::empty(&prior, &Inputs::from_rows(&[[0.0, 1.0]]).unwrap()).unwrap();
    mismatched(Posterior::fuse(&prior, &sites, &[&wide]).err());
    let narrow = Summary::empty(&prior, &z).unwrap();
    mismatched(Posterior::concatenate(&prior, &[&narrow, &wide]).err());
}

#[test]
fn different_priors_and_points_are_refused() {
    let (prior, other) = (line_prior(Shape::Matern52), line_prior(Shape::Matern32));
    let z = line(&[0.0, 1.0]);
    let mut summary = Summary::empty(&prior, &z).unwrap();
    let moved = Summary::empty(&prior, &line(&[0.0, 1.5])).unwrap();
    let foreign = Summary::empty(&other, &z).unwrap();
    assert!(matches!(summary.merge(&moved), Err(Error::Different { of: "inducing points", .. })));
    assert!(matches!(summary.subtract(&moved), Err(Error::Different { of: "inducing points", .. })));
    assert!(matches!(summary.merge(&foreign), Err(Error::Different { of: "priors", .. })));
    assert!(matches!(summary.subtract(&foreign), Err(Error::Different { of: "priors", .. })));
    let refused = Posterior::fuse(&prior, &Sites::empty(1), &[&summary, &foreign]);
    assert!(matches!(refused, Err(Error::Different { of: "priors", .. })));
    assert!(matches!(Posterior::concatenate(&prior, &[&foreign]), Err(Error::Different { of: "priors", .. })));
    assert!(summary.merge(&foreign.under(&prior).unwrap()).is_ok());
}

#[test]
fn messages_that_are_none_are_refused() {
    let prior = line_prior(Shape::Matern52);
    let (z, none) = (line(&[0.0, 1.0]), Sites::empty(1));
    let diagonal = |value| Matrix::from_fn(2, 2, |i, j| if i == j { value } else { 0.0 });
    for value in [-2.0, -1e-3, f64::NAN, f64::INFINITY] {
        let message = Summary::from_whitened(&prior, &z, diagonal(value), vec![0.0; 2]);
        let refused = message.and_then(|message| Posterior::fuse(&prior, &none, &[&message]).map(drop));
        assert!(refused.is_err(), "precision {value}");
    }
    for value in [f64::NAN, f64::INFINITY] {
        let message = Summary::from_whitened(&prior, &z, diagonal(1.0), vec![value, 0.0]);
        let result = message.and_then(|message| Posterior::fuse(&prior, &none, &[&message]));
        if let Ok(posterior) = result {
            let latent = posterior.latent(&z);
            assert!(
                latent.is_ok_and(|latent| latent.mean.iter().all(|mean| !mean.is_nan())),
                "shift {value} gives NaN"
            );
        }
    }
}
