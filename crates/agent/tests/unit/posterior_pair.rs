//! Pairs of the own and the fused posterior.

use super::*;
use dgpc::{Inputs, Kernel, Latent, Prior, PriorMean, Shape, Term};

fn prior(variance: f64) -> Prior {
    let kernel = Kernel::new(vec![Term::isotropic(Shape::SquaredExponential, variance, 1.0, 1).unwrap()]).unwrap();
    Prior::new(kernel, PriorMean::Zero).unwrap()
}

fn observations(x: &[f64]) -> Observations {
    let rows: Vec<[f64; 1]> = x.iter().map(|&x| [x]).collect();
    let outcomes = x.iter().map(|x| x.sin() > 0.3).collect();
    Observations::new(Inputs::from_rows(&rows).unwrap(), outcomes).unwrap()
}

fn moments(pair: &PosteriorPair) -> [Latent; 2] {
    let points = Inputs::from_rows(&[[-0.5], [0.4], [2.2]]).unwrap();
    [&pair.own, pair.fused()].map(|posterior| posterior.latent(&points).unwrap())
}

#[test]
fn a_pair_stored_once_has_the_bits_of_two_posteriors() {
    let prior = prior(4.0);
    let alone = Posterior::prior_alone(&prior, 1);
    let theirs = observations(&[1.0, 1.5, 2.5]);
    let sites = dgpc::sites_given(&alone, &theirs).unwrap();
    let summary = Summary::marginal(&prior, &sites, &Inputs::from_rows(&[[1.2], [2.4]]).unwrap()).unwrap();
    let mut once = PosteriorPair::new(alone.clone(), None);
    let mut twice = PosteriorPair::new(alone.clone(), Some(alone.clone()));
    let mut never_received = PosteriorPair::new(alone, None);
    for step in 0..9 {
        for pair in [&mut once, &mut twice] {
            match step {
                3 => pair.absorb_summaries(&[&summary]).unwrap(),
                6 => pair.absorb_remote(&theirs).unwrap(),
                _ => pair.absorb_own(&observations(&[0.4 * f64::from(step)])).unwrap(),
            }
            // No evidence of others.
            pair.absorb_summaries(&[]).unwrap();
            pair.absorb_remote(&observations(&[])).unwrap();
        }
        if ![3, 6].contains(&step) {
            never_received.absorb_own(&observations(&[0.4 * f64::from(step)])).unwrap();
        }
        assert_eq!(once.fused.is_some(), step >= 3);
        assert_eq!(moments(&once), moments(&twice), "step {step}");
        assert_eq!(moments(&once)[0], moments(&never_received)[0], "step {step}");
        assert_eq!(moments(&once)[0] == moments(&once)[1], step < 3, "step {step}");
    }
}

#[test]
fn under_an_own_model_an_event_has_the_site_of_that_model() {
    let event = observations(&[0.7]);
    let [teams, owns] = [1.0, 9.0].map(|variance| Posterior::prior_alone(&prior(variance), 1));
    let mut pair = PosteriorPair::new(teams, Some(owns.clone()));
    pair.absorb_own(&event).unwrap();
    let mut expected = owns;
    dgpc::absorb_observations(&mut expected, &event).unwrap();
    assert_eq!(moments(&pair)[1], moments(&PosteriorPair::new(expected, None))[0]);
}
