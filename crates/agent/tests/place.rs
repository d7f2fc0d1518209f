//! What one mission learned of a place is known beforehand on the next.

#![allow(clippy::unwrap_used)]

mod common;

use std::sync::Arc;

use common::*;
use pingmap_agent::*;
use proptest::prelude::*;

/// The links of these events, as often as they were tried.
fn links_of(events: &[Event]) -> Vec<Link> {
    events.iter().map(|event| event.link).collect()
}

fn with_place(team: &Team, events: &[Event], points: usize) -> Team {
    let mut before = vehicle(&Arc::new(team.clone()), 0, events.iter().cloned());
    before.rebuild_posteriors().unwrap();
    let model = team.model.with_place(before.posterior().unwrap(), &links_of(events), points).unwrap();
    Team { model, ..team.clone() }
}

fn latent(agent: &mut Agent, links: &[Link]) -> (Vec<f64>, Vec<f64>) {
    let inputs = agent.model().inputs(links).unwrap();
    let latent = agent.posterior().unwrap().latent(&inputs).unwrap();
    (latent.mean, latent.variance)
}

proptest! {
    #![proptest_config(cases(24))]

    #[test]
    fn a_new_vehicle_knows_the_place_as_the_last_one_did(model in models(), events in events_of(0, 3..25)) {
        let team = team(2, model);
        let mut before = vehicle(&Arc::new(team.clone()), 0, events.iter().cloned());
        before.rebuild_posteriors().unwrap();
        let team = with_place(&team, &events, events.len());
        let place = team.model.place.clone().unwrap();
        let mut new = Agent::new(names(1).remove(0), Arc::new(team));
        let ((found, found_variance), (expected, expected_variance)) = (latent(&mut new, place.links()), latent(&mut before, place.links()));
        prop_assert!(largest_difference(&found, &expected) < 1e-4, "{:?} {:?}", found, expected);
        prop_assert!(largest_difference(&found_variance, &expected_variance) < 1e-4);
        // And it is nothing that it has to tell.
        prop_assert_eq!(new.next_packet(0.0, 32).unwrap(), None);
        prop_assert_eq!(new.longest_m(), place.links().iter().map(Link::range_m).reduce(f64::max));
    }

    /// In the sum it does not matter much which mission an event was of.
    #[test]
    fn two_missions_are_nearly_one(model in models(), events in events_of(0, 6..30), first in 2..25usize) {
        let team = team(2, model);
        let first = first.min(events.len() - 1);
        let mut all = vehicle(&Arc::new(team.clone()), 0, events.iter().cloned());
        all.rebuild_posteriors().unwrap();
        let mut second = vehicle(&Arc::new(with_place(&team, &events[..first], first)), 0, events[first..].iter().cloned());
        second.rebuild_posteriors().unwrap();
        let p = [&mut all, &mut second].map(|agent| agent.probabilities(somewhere()).unwrap());
        prop_assert!(largest_difference(&p[0], &p[1]) < 0.12, "{:?}", p);
        // What it tells somebody who knows the place, too, brings that one near.
        let mut listener = vehicle(&Arc::new(second.team().clone()), 1, []);
        let before = largest_difference(&listener.probabilities(links_of(&events)).unwrap(), &second.probabilities(links_of(&events)).unwrap());
        for packet in sent(&mut second, 12) {
            listener.receive(&packet, 0.0);
        }
        let after = largest_difference(&listener.probabilities(links_of(&events)).unwrap(), &second.probabilities(links_of(&events)).unwrap());
        prop_assert!(after <= before + 0.05, "{} {}", before, after);
    }

    #[test]
    fn files_hold_the_place_and_the_digest_knows_it(model in models(), events in events_of(0, 3..20), points in 1..12usize) {
        let without = team(2, model);
        let with = with_place(&without, &events, points);
        prop_assert_ne!(without.digest(), with.digest());
        let file = ModelFile { model: with.model.clone(), learned: None, place_log_digests: Vec::new() };
        let again = ModelFile::parse(&file.write().unwrap()).unwrap();
        prop_assert_eq!(&again, &file);
        prop_assert_eq!(Team { model: again.model, ..with.clone() }.digest(), with.digest());
    }
}

#[test]
fn no_file_says_half_a_place() {
    let team = with_place(&team(2, model()), &walk(0, 12, 0.0), 2);
    let text = ModelFile { model: team.model, learned: None, place_log_digests: Vec::new() }.write().unwrap();
    let place = &text[text.find("[place]").unwrap()..];
    let of = |name: &str| place.lines().find(|line| line.starts_with(name)).unwrap().to_owned();
    let [links, shift, precision] = ["links", "shift", "precision"].map(of);
    let cases = [
        (&links, "links = []", "from 1 to 256"),
        (&links, "links = [[1.0, 2.0, 3.0], [1.0, 2.0, 3.0, 4.0]]", "expected 4 numbers for a link, found 3"),
        (&links, "links = [[1.0, 2.0, 3.0, 1e99], [1.0, 2.0, 3.0, 4.0]]", "coordinate of place.links"),
        (&shift, "shift = [1.0]", "expected 2 entries of shift"),
        (&shift, "shift = [nan, 1.0]", "entry of place.shift"),
        (&precision, "precision = [[1.0], [1.0]]", "expected 2 entries of shift and rows of precision"),
        (&precision, "precision = [[1.0], [5.0, 1.0]]", "eigenvalue"),
        (&precision, "precision = [[1.0], [inf, 1.0]]", "entry of place.shift or place.precision"),
    ];
    for (line, other, expected) in cases {
        let error = ModelFile::parse(&text.replace(line.as_str(), other)).unwrap_err().to_string();
        assert!(error.contains(expected), "{other}: {error}");
    }
    assert!(ModelFile::parse(&text).is_ok());
}

#[test]
fn a_place_is_learned_under_its_own_prior() {
    let events = walk(0, 12, 0.0);
    let mut agent = vehicle(&Arc::new(team(2, model())), 0, events.iter().cloned());
    let other = isotropic(dgpc::Shape::Matern52, true, 300.0, 2.0);
    assert!(other.with_place(agent.posterior().unwrap(), &links_of(&events), 4).is_err());
}
