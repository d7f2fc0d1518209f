//! Results are bitwise the same for every number of threads.

use dgpc::*;

#[test]
fn sparse_fits_do_not_depend_on_the_number_of_threads() {
    // A wave over the square with random outcomes: enough events for several parts of several blocks.
    let number = |n: usize, factor: f64| (n as f64 * factor).fract();
    let places: Vec<f64> = (0..4000).flat_map(|n| [number(n, 0.618_034), number(n, 0.754_878)]).collect();
    let wave = |n: usize| (9.0 * places[2 * n]).sin() * (7.0 * places[2 * n + 1]).cos();
    let outcomes = (0..4000).map(|n| number(n, 0.569_84) < 0.5 + 0.45 * wave(n)).collect();
    let events = Observations::new(Inputs::new(places, 2).unwrap(), outcomes).unwrap();
    let points = events.inputs().select(&spread_out(4000, 200));
    let kernel = Kernel::new(vec![Term::isotropic(Shape::Matern32, 2.0, 0.2, 2).unwrap()]).unwrap();
    let prior = Prior::new(kernel, PriorMean::Constant(0.3)).unwrap();
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let options = FitOptions::default().inducing_points(&points);
        pool.install(|| evidence(&prior, &events, &options).unwrap())
    };
    let (one, three) = (on(1), on(3));
    assert!(one.fit.converged() && one.fit.iterations() > 3);
    assert_eq!(one.fit.evidence().to_bits(), three.fit.evidence().to_bits());
    assert_eq!(one.gradient, three.gradient);
    assert_eq!((one.fit.mean(), one.fit.variance()), (three.fit.mean(), three.fit.variance()));

    // The posterior of the fit equals the posterior of its sites, summarised at the same points.
    let summary = Summary::variational(&prior, one.fit.sites(), &points).unwrap();
    let posterior = Posterior::fuse(&prior, &Sites::empty(2), &[&summary]).unwrap();
    let places = events.inputs().select(&[7, 1234, 3999]);
    let [fitted, fused] = [one.fit.posterior().unwrap(), posterior].map(|posterior| posterior.latent(&places).unwrap());
    let far = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(far(&fitted.mean, &fused.mean) < 1e-9 && far(&fitted.variance, &fused.variance) < 1e-9);
}

#[cfg(feature = "learn")]
#[test]
fn learned_priors_do_not_depend_on_the_number_of_threads() {
    // Waves of different lengths along two axes, with several starts, some of which lead to the same end.
    let number = |n: usize, factor: f64| 4.0 * (n as f64 * factor).fract();
    let places: Vec<f64> = (0..200).flat_map(|n| [number(n, 0.618_034), number(n, 0.754_878)]).collect();
    let outcomes = (0..200).map(|n| places[2 * n].sin() + (2.0 * places[2 * n + 1]).sin() > 0.3).collect();
    let events = Observations::new(Inputs::new(places, 2).unwrap(), outcomes).unwrap();
    let kernel = Kernel::new(vec![Term::new(Shape::Matern52, 4.0, &[0, 1], &[1.0; 2]).unwrap()]).unwrap();
    let template = Prior::new(kernel, PriorMean::Constant(0.0)).unwrap();
    let further = [0.3, 3.0].map(|factor| template.with_length_scales_times(factor).unwrap());
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let mut options = LearnOptions::default();
        options.start_events_max = 80;
        options.further_starts = &further;
        pool.install(|| learn(&template, &events, &options).unwrap())
    };
    let one = on(1);
    for threads in [2, 4] {
        let more = on(threads);
        assert_eq!(one.prior, more.prior, "{threads} threads");
        assert_eq!(one.starts, more.starts, "{threads} threads");
        assert_eq!(one.optimum_evidence.to_bits(), more.optimum_evidence.to_bits(), "{threads} threads");
        assert_eq!((one.evaluations, one.stop.clone()), (more.evaluations, more.stop), "{threads} threads");
    }
}
