//! Problems without events, inducing points or candidates.

use super::problems::*;
use crate::common::*;
use dgpc::*;

#[test]
fn fitting_no_events_gives_the_prior() {
    let prior = line_prior(Shape::Matern52);
    let none = Sites::empty(1);
    let nothing = Observations::new(line(&[]), vec![]).unwrap();
    let z = line(&[0.0, 1.0]);
    let expected = Latent { mean: vec![0.2; 2], variance: vec![2.0; 2] };

    let fit = dgpc::fit(&prior, &nothing, &FitOptions::default()).unwrap();
    assert!(fit.converged() && fit.sites().is_empty() && fit.evidence() == 0.0);
    let fit = dgpc::fit(&prior, &nothing, &FitOptions::default().inducing_points(&z)).unwrap();
    assert!(fit.converged() && fit.sites().is_empty() && fit.evidence() == 0.0);
    assert_eq!(log_evidence(&prior, &none).unwrap(), 0.0);
    let certificate = Certificate::new(&prior, &none, &z).unwrap();
    assert_eq!(
        (certificate.trace, certificate.gap, certificate.closed_form, certificate.paper_closed_form),
        (0.0, 0.0, 0.0, 0.0)
    );

    let empty = Summary::empty(&prior, &z).unwrap();
    for summary in [Summary::variational(&prior, &none, &z).unwrap(), Summary::marginal(&prior, &none, &z).unwrap()] {
        assert_same_message(&summary, &empty, 0.0);
    }
    let pointless = Summary::empty(&prior, &line(&[])).unwrap();
    for posterior in [
        Posterior::fuse(&prior, &none, &[]).unwrap(),
        Posterior::fuse(&prior, &none, &[&empty]).unwrap(),
        Posterior::fuse(&prior, &none, &[&pointless, &empty]).unwrap(),
    ] {
        assert_same_latent(&posterior.latent(&z).unwrap(), &expected, 1e-14);
        assert_eq!(posterior.latent(&line(&[])).unwrap().mean, Vec::<f64>::new());
        assert_same_message(&posterior.summarise(&z).unwrap(), &empty, 1e-12);
        assert!(posterior.summarise(&line(&[])).unwrap().is_empty());
    }
}

#[test]
fn no_events_concatenate_to_the_prior() {
    let prior = line_prior(Shape::Matern52);
    let z = line(&[0.0, 1.0]);
    let empty = Summary::empty(&prior, &z).unwrap();
    for stacked in [Concatenation::new(&prior, &[]).unwrap(), Concatenation::new(&prior, &[&empty]).unwrap()] {
        let expected = Latent { mean: vec![0.2; 2], variance: vec![2.0; 2] };
        assert_same_latent(&stacked.latent(&z).unwrap(), &expected, 1e-14);
        assert_eq!(stacked.latent(&line(&[])).unwrap().mean, Vec::<f64>::new());
    }
}

#[test]
fn no_packets_concatenate_to_the_prior_in_any_dimension() {
    let kernel = Kernel::new(vec![Term::isotropic(Shape::Matern52, 2.0, 1.0, 2).unwrap()]).unwrap();
    let prior = Prior::new(kernel, PriorMean::Zero).unwrap();
    let latent = Concatenation::new(&prior, &[])
        .and_then(|posterior| posterior.latent(&Inputs::from_rows(&[[0.0, 1.0]]).unwrap()));
    assert_eq!(latent, Ok(Latent { mean: vec![0.0], variance: vec![2.0] }));
}

#[test]
fn no_inducing_points_give_empty_summaries() {
    let (prior, sites) = (line_prior(Shape::Matern52), line_sites());
    let nowhere = line(&[]);
    for summarise in [Summary::variational, Summary::marginal] {
        assert!(summarise(&prior, &sites, &nowhere).unwrap().is_empty());
    }
    let certificate = Certificate::new(&prior, &sites, &nowhere).unwrap();
    assert_near("trace", &[certificate.trace], &[24.0], 1e-12);
    let observations = Observations::new(sites.inputs().clone(), vec![true; 12]).unwrap();
    let fit = dgpc::fit(&prior, &observations, &FitOptions::default().inducing_points(&nowhere)).unwrap();
    assert_near("prior mean", fit.mean(), &[0.2; 12], 1e-12);
    assert_near("prior variance", fit.variance(), &[2.0; 12], 1e-12);
}

#[test]
fn no_candidates_or_no_points_give_an_empty_selection() {
    let prior = line_prior(Shape::Matern52);
    let no_candidates = Candidates::new(prior.kernel(), &line(&[])).unwrap();
    let two_candidates = Candidates::given(prior.kernel(), &line(&[0.0, 1.0]), &line(&[])).unwrap();
    assert!(no_candidates.is_empty() && two_candidates.len() == 2);
    for points in 0..4 {
        let nothing = Selection { indices: vec![], trace: 0.0 };
        assert_eq!(no_candidates.minimise_trace(points), nothing);
        assert_eq!(no_candidates.maximise_trace(points), nothing);
        assert_eq!(no_candidates.greedy(points), nothing);
        assert_eq!(no_candidates.random(points, &mut seeded(1)), nothing);
        assert_eq!(two_candidates.minimise_trace(points).indices.len(), points.min(2));
    }
    assert_eq!(two_candidates.minimise_trace(0).trace, 4.0);
}

#[test]
fn a_mean_field_starts_from_the_given_tilts() {
    let sites = line_sites();
    let observations = Observations::new(sites.inputs().clone(), (0..12).map(|n| n < 5).collect()).unwrap();
    let prior = line_prior(Shape::Matern52);
    let cold = dgpc::fit(&prior, &observations, &FitOptions::default()).unwrap();
    let options = FitOptions::default().start(cold.tilts());
    let warm = dgpc::fit(&prior, &observations, &options).unwrap();
    assert!(warm.iterations() <= 2 && cold.iterations() > 3, "{} after {}", warm.iterations(), cold.iterations());
    assert_near("mean", warm.mean(), cold.mean(), 1e-9);
    let options = FitOptions::default().iterations_max(1);
    let stopped = dgpc::fit(&prior, &observations, &options).unwrap();
    assert!(!stopped.converged() && stopped.iterations() == 1 && stopped.change() > 1e-3);
}
