//! Site priors: data of one mission are prior knowledge on the next.

use std::sync::Arc;

use crate::common::*;
use pingmap_agent::*;
use proptest::prelude::*;

fn links_of(events: &[Event]) -> Vec<Link> {
    events.iter().map(|event| event.link).collect()
}

/// The team with a site prior from these events.
fn with_site_prior(team: &Team, events: &[Event], points: usize) -> Team {
    let mut before = vehicle(&Arc::new(team.clone()), 0, events.iter().cloned());
    before.rebuild().unwrap();
    let posterior = before.posterior(Which::Fused).unwrap();
    let model = team.model.with_site_prior(posterior, &links_of(events), points).unwrap();
    Team { model, ..team.clone() }
}

proptest! {
    #![proptest_config(cases(24))]

    #[test]
    fn a_vehicle_with_a_site_prior_predicts_as_the_last_mission(model in models(), events in events_of(0, 3..25)) {
        let team = team(2, model);
        let mut before = vehicle(&Arc::new(team.clone()), 0, events.iter().cloned());
        before.rebuild().unwrap();
        let team = with_site_prior(&team, &events, events.len());
        let site = team.model.site.clone().unwrap();
        let mut new = vehicle(&Arc::new(team), 0, []);
        let ((mean, variance), (expected_mean, expected_variance)) =
            (latent(&mut new, site.links()), latent(&mut before, site.links()));
        prop_assert!(largest_difference(&mean, &expected_mean) < 1e-4, "{:?} {:?}", mean, expected_mean);
        prop_assert!(largest_difference(&variance, &expected_variance) < 1e-4);
        // All members have the site prior, so that it is not worth a frame.
        prop_assert_eq!(new.next_frame(None, 32).unwrap(), None);
        prop_assert_eq!(new.status().longest_link_m, site.links().iter().map(Link::range_m).reduce(f64::max));
    }

    #[test]
    fn two_missions_predict_nearly_as_one(model in models(), events in events_of(0, 6..30), first in 2..25usize) {
        let team = team(2, model);
        let first = first.min(events.len() - 1);
        let mut one = vehicle(&Arc::new(team.clone()), 0, events.iter().cloned());
        let second = Arc::new(with_site_prior(&team, &events[..first], first));
        let mut second = vehicle(&second, 0, events[first..].iter().cloned());
        let p = [&mut one, &mut second].map(rebuilt_probabilities);
        prop_assert!(largest_difference(&p[0], &p[1]) < 0.12, "{:?}", p);
        // Its packets bring a listener with the same site prior nearer.
        let mut listener = vehicle(&Arc::new(second.team().clone()), 1, []);
        let packets = frames(&mut second, 12);
        let links = links_of(&events);
        let expected = probabilities(&mut second, &links);
        let before = largest_difference(&probabilities(&mut listener, &links), &expected);
        receive_all(&mut listener, &packets);
        let after = largest_difference(&probabilities(&mut listener, &links), &expected);
        prop_assert!(after <= before + 0.05, "{} {}", before, after);
    }

    #[test]
    fn model_files_hold_the_site_prior_and_the_digest_includes_it(
        model in models(), events in events_of(0, 3..20), points in 1..12usize,
    ) {
        let without = team(2, model);
        let with = with_site_prior(&without, &events, points);
        prop_assert_ne!(without.digest(), with.digest());
        let file = ModelFile { model: with.model.clone(), learned: None, site_log_digests: Vec::new() };
        let again = ModelFile::parse(&file.write().unwrap()).unwrap();
        prop_assert_eq!(&again, &file);
        prop_assert_eq!(Team { model: again.model, ..with.clone() }.digest(), with.digest());
    }
}

#[test]
fn an_incomplete_site_prior_in_a_file_is_refused() {
    let team = with_site_prior(&team(2, model()), &walk(0, 12, 0.0), 2);
    let text = ModelFile { model: team.model, learned: None, site_log_digests: Vec::new() }.write().unwrap();
    let site = &text[text.find("[site_prior]").unwrap()..];
    let of = |name: &str| site.lines().find(|line| line.starts_with(name)).unwrap().to_owned();
    let [links, shift, precision] = ["links", "shift", "precision"].map(of);
    let cases = [
        (&links, "links = []", "from 1 to 256"),
        (&links, "links = [[1.0, 2.0, 3.0], [1.0, 2.0, 3.0, 4.0]]", "expected 4 numbers for a link, found 3"),
        (&links, "links = [[1.0, 2.0, 3.0, 1e99], [1.0, 2.0, 3.0, 4.0]]", "coordinate of site_prior.links"),
        (&shift, "shift = [1.0]", "expected 2 entries of shift"),
        (&shift, "shift = [nan, 1.0]", "entry of site_prior.shift"),
        (&precision, "precision = [[1.0], [1.0]]", "expected 2 entries of shift and rows of precision"),
        (&precision, "precision = [[1.0], [5.0, 1.0]]", "eigenvalue"),
        (&precision, "precision = [[1.0], [inf, 1.0]]", "entry of site_prior.shift or site_prior.precision"),
    ];
    for (line, other, expected) in cases {
        let error = ModelFile::parse(&text.replace(line.as_str(), other)).unwrap_err().to_string();
        assert!(error.contains(expected), "{other}: {error}");
    }
    assert!(ModelFile::parse(&text).is_ok());
}

#[test]
fn a_site_prior_from_another_prior_is_refused() {
    let events = walk(0, 12, 0.0);
    let mut agent = vehicle(&Arc::new(team(2, model())), 0, events.iter().cloned());
    let other = isotropic(dgpc::Shape::Matern52, true, 300.0, 2.0);
    assert!(other.with_site_prior(agent.posterior(Which::Fused).unwrap(), &links_of(&events), 4).is_err());
}
