//! Invalid arguments and the errors that refuse them.

use super::problems::*;
use dgpc::*;

#[test]
fn inputs_must_be_finite_and_complete() {
    for (value, name) in [(f64::NAN, "NaN"), (f64::INFINITY, "inf"), (f64::NEG_INFINITY, "-inf")] {
        let refused = Inputs::from_rows(&[[0.0, 1.0], [2.0, value]]).unwrap_err();
        assert!(matches!(refused, Error::NotFinite { place: Place::Entry { row: 1, column: 1 }, .. }), "{refused}");
        assert!(refused.to_string().contains(name), "{refused}");
    }
    assert!(matches!(Inputs::new(vec![1.0; 5], 2), Err(Error::SizeMismatch { found: 5, .. })));
    assert!(matches!(Inputs::new(vec![1.0], 0), Err(Error::OutOfRange { .. })));
    let refused = line(&[0.0]).append(&Inputs::from_rows(&[[0.0, 1.0]]).unwrap());
    assert!(matches!(refused, Err(Error::SizeMismatch { expected: 1, found: 2, .. })));
}

#[test]
fn terms_must_have_positive_parameters() {
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
fn prior_means_must_be_finite_and_paired() {
    let kernel = || Kernel::new(vec![Term::isotropic(Shape::Matern32, 1.0, 1.0, 1).unwrap()]).unwrap();
    let range = |intercept, slope, to: &[usize]| PriorMean::range(intercept, slope, &[0], to);
    for bad in [f64::NAN, f64::INFINITY] {
        let constant = Prior::new(kernel(), PriorMean::Constant(bad)).err();
        for refused in [constant, range(bad, 1.0, &[1]).err(), range(1.0, bad, &[1]).err()] {
            assert!(matches!(refused, Some(Error::NotFinite { place: Place::Alone, .. })), "{refused:?}");
        }
    }
    assert!(matches!(range(1.0, 1.0, &[1, 2]), Err(Error::SizeMismatch { .. })));
    assert!(matches!(PriorMean::range(1.0, 1.0, &[], &[]), Err(Error::OutOfRange { .. })));
    assert!(matches!(PriorMean::range(1.0, 1.0, &[0, 1], &[2, 2]), Err(Error::RepeatedColumn { column: 2, .. })));
    // These columns exceed the largest allowed column. The number of columns would overflow.
    assert!(matches!(range(1.0, 1.0, &[usize::MAX]), Err(Error::OutOfRange { what: "column", .. })));
    let far = Term::new(Shape::Matern32, 1.0, &[usize::MAX], &[1.0]);
    assert!(matches!(far, Err(Error::OutOfRange { what: "column", .. })));
    assert!(matches!(Reflection::negate(&[usize::MAX]), Err(Error::OutOfRange { what: "column", .. })));
}

#[test]
fn shape_parameters_must_be_in_range() {
    for alpha in [0.0, -1.0, 1e-4, 1e4, f64::NAN] {
        let term = Term::isotropic(Shape::RationalQuadratic { alpha }, 1.0, 1.0, 1);
        assert!(matches!(term, Err(Error::OutOfRange { .. })), "{alpha}: {term:?}");
    }
    for text in ["", "matern", "Matern32", "matern32:", "matern32:2", "rational-quadratic:x", "rational-quadratic:1:2"]
    {
        assert!(text.parse::<Shape>().is_err(), "{text:?}");
    }
    for &shape in Shape::ALL {
        assert_eq!(shape.to_string().parse(), Ok(shape));
        assert_eq!(shape.name().parse(), Ok(shape));
    }
    let refused = "rational-quadratic:x".parse::<Shape>().unwrap_err();
    assert!(matches!(refused, Error::BadShapeParameter { .. }) && refused.to_string().contains("\"x\""), "{refused}");
    assert_eq!("rational-quadratic:0.25".parse(), Ok(Shape::RationalQuadratic { alpha: 0.25 }));
}

#[test]
fn reflections_must_be_involutions() {
    let image = |column, source, negated| Image { column, source, negated };
    for images in [
        vec![image(0, 1, false)],
        vec![image(0, 1, false), image(1, 2, false), image(2, 0, false)],
        vec![image(0, 1, true), image(1, 0, false)],
    ] {
        let refused = Reflection::new(images);
        assert!(matches!(refused, Err(Error::NotAnInvolution { column: 0 })), "{refused:?}");
    }
    assert!(Reflection::new(vec![image(0, 1, true), image(1, 0, true)]).is_ok());
}

/// Every function that takes inputs refuses inputs without the columns that the kernel or the prior mean uses.
#[test]
fn missing_columns_are_refused() {
    let kernel = |column| Kernel::new(vec![Term::new(Shape::Matern52, 1.0, &[column], &[1.0]).unwrap()]).unwrap();
    let range = PriorMean::range(1.0, 1.0, &[0], &[2]).unwrap();
    let sites = line_sites();
    let observations = Observations::new(sites.inputs().clone(), vec![true; 12]).unwrap();
    let wide = Inputs::from_rows(&[[0.0, 1.0, 2.0]]).unwrap();
    for prior in [Prior::new(kernel(2), PriorMean::Zero).unwrap(), Prior::new(kernel(0), range).unwrap()] {
        let z = line(&[0.0]);
        let alone = Posterior::prior_alone(&prior, 3);
        let refused: Vec<Error> = [
            Summary::variational(&prior, &sites, &z).err(),
            Summary::marginal(&prior, &sites, &z).err(),
            Certificate::new(&prior, &sites, &z).err(),
            log_evidence(&prior, &sites).err(),
            Posterior::fuse(&prior, &sites, &[]).err(),
            dgpc::fit(&prior, &observations, &FitOptions::default()).err(),
            dgpc::fit(&prior, &observations, &FitOptions::default().inducing_points(&z)).err(),
            Gibbs::new(&prior, observations.clone()).err(),
            alone.latent(&z).err(),
            alone.probability(&z).err(),
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
    let range = PriorMean::range(1.0, 1.0, &[0], &[2]).unwrap();
    for prior in [Prior::new(kernel(2), PriorMean::Zero).unwrap(), Prior::new(kernel(0), range).unwrap()] {
        let wide = Summary::empty(&prior, &Inputs::from_rows(&[[0.0, 1.0, 2.0]]).unwrap()).unwrap();
        let posterior = Posterior::fuse(&prior, &Sites::empty(3), &[&wide]).unwrap();
        let z = line(&[0.0]);
        for refused in
            [Summary::empty(&prior, &z).err(), Summary::from_whitened(&prior, &z, Matrix::zeros(1, 1), vec![0.0]).err()]
        {
            assert!(matches!(refused, Some(Error::BadColumn { column: 2, columns: 1, .. })), "{refused:?}");
        }
        let refused = posterior.summarise(&z).err();
        assert!(matches!(refused, Some(Error::SizeMismatch { expected: 3, found: 1, .. })), "{refused:?}");
    }
}

#[test]
fn points_with_more_or_fewer_columns_than_the_support_are_refused() {
    let prior = line_prior(Shape::Matern52);
    let summary = Summary::empty(&prior, &Inputs::from_rows(&[[0.0, 1.0]]).unwrap()).unwrap();
    let posterior = Posterior::of_summaries(&prior, &[&summary]).unwrap();
    let concatenation = Concatenation::new(&prior, &[&summary]).unwrap();
    for width in [1, 3] {
        let points = Inputs::new(vec![0.5; 20 * width], width).unwrap();
        for refused in [
            posterior.latent(&points).err(),
            posterior.joint(&points).err(),
            posterior.summarise(&points).err(),
            PosteriorAtPoints::new(&posterior, &points).err(),
            concatenation.latent(&points).err(),
        ] {
            assert!(
                matches!(refused, Some(Error::SizeMismatch { expected: 2, found, .. }) if found == width),
                "{refused:?}"
            );
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
    mismatched(Concatenation::new(&prior, &[&narrow, &wide]).err());
}

#[test]
fn different_priors_and_points_are_refused() {
    let (prior, other) = (line_prior(Shape::Matern52), line_prior(Shape::Matern32));
    let z = line(&[0.0, 1.0]);
    let mut summary = Summary::empty(&prior, &z).unwrap();
    let moved = Summary::empty(&prior, &line(&[0.0, 1.5])).unwrap();
    let foreign = Summary::empty(&other, &z).unwrap();
    assert!(matches!(summary.merge(&moved), Err(Error::DifferentInducingPoints)));
    assert!(matches!(summary.subtract(&moved), Err(Error::DifferentInducingPoints)));
    assert!(matches!(summary.merge(&foreign), Err(Error::DifferentPriors { .. })));
    assert!(matches!(summary.subtract(&foreign), Err(Error::DifferentPriors { .. })));
    let refused = Posterior::fuse(&prior, &Sites::empty(1), &[&summary, &foreign]);
    assert!(matches!(refused, Err(Error::DifferentPriors { .. })));
    assert!(matches!(Concatenation::new(&prior, &[&foreign]), Err(Error::DifferentPriors { .. })));
    assert!(summary.merge(&foreign.under(&prior).unwrap()).is_ok());
}

#[test]
fn invalid_messages_are_refused() {
    let prior = line_prior(Shape::Matern52);
    let (z, none) = (line(&[0.0, 1.0]), Sites::empty(1));
    let diagonal = |value| Matrix::from_fn(2, 2, |i, j| if i == j { value } else { 0.0 });
    for value in [-2.0, -1e-3, f64::NAN, f64::INFINITY] {
        let message = Summary::from_whitened(&prior, &z, diagonal(value), vec![0.0; 2]);
        let refused = message.and_then(|message| Posterior::fuse(&prior, &none, &[&message]).map(drop));
        assert!(refused.is_err(), "precision {value}");
    }
    for value in [f64::NAN, f64::INFINITY] {
        let refused = Summary::from_whitened(&prior, &z, diagonal(1.0), vec![0.0, value]).unwrap_err();
        assert!(
            matches!(refused, Error::NotFinite { what: "summary shift", place: Place::Element(1), .. }),
            "{refused}"
        );
        let factor = Factor::new(z.clone(), diagonal(1.0), vec![0.0, value]).unwrap_err();
        assert!(matches!(factor, Error::NotFinite { place: Place::Element(1), .. }), "{factor}");
        let factor = Factor::new(z.clone(), diagonal(value), vec![0.0; 2]).unwrap_err();
        assert!(matches!(factor, Error::NotFinite { place: Place::Entry { row: 0, column: 0 }, .. }), "{factor}");
    }
}

/// A bound that would overflow is refused.
#[test]
fn certificates_that_overflow_are_refused() {
    let kernel = Kernel::new(vec![Term::isotropic(Shape::Matern52, 1.0, 1.0, 1).unwrap()]).unwrap();
    let prior = Prior::new(kernel, PriorMean::Constant(1e200)).unwrap();
    let refused = Certificate::new(&prior, &line_sites(), &line(&[0.0]));
    assert!(matches!(refused, Err(Error::NotFinite { .. })), "{refused:?}");
    let refused = log_evidence(&prior, &line_sites());
    assert!(matches!(refused, Err(Error::NotFinite { .. })), "{refused:?}");
}

#[test]
fn posteriors_of_different_priors_have_no_residual() {
    let [one, other] =
        [Shape::Matern32, Shape::Matern52].map(|shape| Posterior::of_sites(&line_prior(shape), &line_sites()).unwrap());
    let z = line(&[0.0]);
    assert!(matches!(Candidates::for_residual(&one, &other, &z), Err(Error::DifferentPriors { .. })));
    assert!(matches!(one.residual(&other, &z), Err(Error::DifferentPriors { .. })));
}
