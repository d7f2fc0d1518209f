//! Models: the columns of a link, structures, and the digest of a model.

use crate::common::*;
use pingmap_agent::*;

/// Every structure, with its template on a chart of 500 m.
pub fn all_templates() -> Vec<(Structure, Model)> {
    let mut all = structures();
    all.push(Structure { mean: MeanStructure::Conservative { range_m: 400.0, slope_per_m: 0.01 }, ..all[0] });
    let template = |structure: Structure| {
        let prior = structure.template(InputSpec::Positions, 500.0).unwrap();
        (structure, Model::new(Chart::about([]), InputSpec::Positions, prior))
    };
    all.into_iter().map(template).collect()
}

#[test]
fn columns_follow_from_the_positions_of_both_ends() {
    let deep = |east_m, north_m, depth_m| Position { depth_m: Some(depth_m), ..Position::new(east_m, north_m) };
    let link = Link { transmitter: deep(3.0, 0.0, 12.0), receiver: deep(0.0, 4.0, 0.0) };
    let spec = InputSpec::PositionsAndDepths;
    let prior = Structure::default().template(spec, 10.0).unwrap();
    let inputs = Model::new(Chart::about([]), spec, prior).inputs([&link]).unwrap();
    assert_eq!(spec.column_names().len(), inputs.dimension());
    assert_eq!(inputs.row(0)[spec.ends()], [3.0, 0.0, 12.0, 0.0, 4.0, 0.0]);
    assert_eq!(inputs.row(0)[spec.range()], 13.0);
    let half = 0.5f64.sqrt();
    let expected = [3.0, 4.0, 12.0, 3.0, -4.0, 12.0].map(|value| value * half);
    for (found, expected) in inputs.row(0)[spec.link_coordinates()].iter().zip(expected) {
        assert!((found - expected).abs() < 1e-12, "{found} {expected}");
    }
}

#[test]
fn the_path_term_is_symmetric_only_in_reciprocal_structures() {
    let one = link([10.0, 200.0, 430.0, -50.0]);
    let other = link([-100.0, 250.0, 300.0, 90.0]);
    for (structure, model) in all_templates() {
        let inputs = model.inputs([&one, &one.swapped(), &other]).unwrap();
        // The other terms depend on the direction: noise at the receiver for example.
        let path = dgpc::Kernel::new(model.prior.kernel().terms()[..1].to_vec()).unwrap();
        let gram = path.gram(&inputs).unwrap();
        assert_eq!((gram[(0, 2)] - gram[(1, 2)]).abs() < 1e-12, structure.reciprocal, "{structure}");
    }
}

#[test]
fn a_conservative_mean_has_even_odds_at_its_range() {
    let mean = MeanStructure::Conservative { range_m: 500.0, slope_per_m: 0.008 };
    let structure = Structure { mean, ..Structure::default() };
    let prior = structure.template(InputSpec::Positions, 300.0).unwrap();
    let model = Model::new(Chart::about([]), InputSpec::Positions, prior);
    let links = [link([0.0, 0.0, 300.0, 400.0]), link([0.0, 0.0, 0.0, 250.0])];
    let mean = model.prior.mean().values(&model.inputs(links).unwrap()).unwrap();
    assert!(mean[0].abs() < 1e-12 && (mean[1] - 2.0).abs() < 1e-12, "{mean:?}");
}

#[test]
fn given_hyperparameters_are_kept_in_a_fit() {
    let learning = Learning { variance: Some(3.0), length_scale_m: Some(250.0), ..Learning::default() };
    let events = walk(0, 60, 0.0);
    let fit = learning.fit(&learning.structure, Chart::about([]), InputSpec::Positions, &events, &[], None).unwrap();
    let term = &fit.model.prior.kernel().terms()[0];
    assert!((term.variance() - 3.0).abs() < 1e-12);
    assert!(term.correlations()[0].length_scales().iter().all(|l| (l - 250.0).abs() < 1e-9));
}

#[test]
fn the_digest_of_a_model_depends_on_its_predictions_alone() {
    let digest = |change: &dyn Fn(&mut Model)| {
        let mut model = model();
        change(&mut model);
        model.digest()
    };
    let plain = digest(&|_| {});
    assert!(plain.len() == 32 && plain == digest(&|_| {}));
    // The scale of the chart matters for learning alone.
    assert_eq!(plain, digest(&|model| model.chart.scale_m *= 2.0));
    let others = [
        digest(&|model| model.chart.origin.east_m += 1.0),
        digest(&|model| model.chart.reference = ReferenceSystem::Epsg(32619)),
        digest(&|model| model.fading = Fading::NONE),
        digest(&|model| model.inputs = InputSpec::PositionsAndDepths),
    ];
    for (n, other) in others.iter().enumerate() {
        assert!(*other != plain && !others[..n].contains(other), "{n}");
    }
}

#[test]
fn a_model_with_depths_added_is_equal_on_links_of_one_depth() {
    let additions = OptionalTerm::ALL.into_iter().filter(|&term| term != OptionalTerm::Vertical);
    for (structure, _) in all_templates() {
        let structure =
            additions.clone().filter(|&term| structure.can_have(term)).fold(structure, |all, term| all.with(term));
        let prior = structure.template(InputSpec::Positions, 500.0).unwrap();
        let flat = Model::new(Chart::about([]), InputSpec::Positions, prior);
        let links = [link([10.0, 200.0, 430.0, -50.0]), link([-100.0, 250.0, 300.0, 90.0])];
        let flat = flat.with_site_prior(&flat.prior_posterior(), &links, 2).unwrap();
        let deep = flat.with_depths().unwrap();
        assert!(deep.inputs.has_depths() && deep.with_depths().unwrap() == deep);
        let at_depth = |depth_m: f64| {
            links.map(|link| {
                let [transmitter, receiver] = link.ends().map(|end| Position { depth_m: Some(depth_m), ..end });
                Link { transmitter, receiver }
            })
        };
        let moments = |model: &Model, links: &[Link]| {
            let inputs = model.inputs(links).unwrap();
            let gram = model.prior.kernel().gram(&inputs).unwrap()[(0, 1)];
            let latent = model.prior_posterior().latent(&inputs).unwrap();
            [vec![gram], model.prior.mean().values(&inputs).unwrap(), latent.mean, latent.variance].concat()
        };
        for depth_m in [0.0, 40.0] {
            let pairs = moments(&flat, &links).into_iter().zip(moments(&deep, &at_depth(depth_m)));
            pairs.for_each(|(flat, deep)| assert!((flat - deep).abs() < 1e-6, "{structure}: {flat} {deep}"));
        }
    }
}
