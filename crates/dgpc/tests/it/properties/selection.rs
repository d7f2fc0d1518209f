//! Selection against brute force.

use super::problems::*;
use crate::common::*;
use dgpc::*;
use proptest::collection::vec;
use proptest::prelude::*;

/// Returns whether every chosen point keeps more than [`DISTINCT_SHARE`] of its prior variance given the others.
fn distinct(gram: &Dense, prior: &[f64], chosen: &[usize], margin: f64) -> bool {
    (0..chosen.len()).all(|place| {
        let mut others = chosen.to_vec();
        let own = others.remove(place);
        conditional(gram, &others)[own][own] >= DISTINCT_SHARE * prior[own] * margin
    })
}

/// Returns the events plus copies of some of them, exact or slightly shifted.
fn crowded(problem: &Problem, copies: &[(usize, f64)]) -> Inputs {
    let inputs = problem.inputs();
    let mut crowd = inputs.clone();
    for &(which, offset) in copies {
        let row: Vec<f64> = inputs.row(which % inputs.len()).iter().map(|value| value + offset).collect();
        crowd.append(&Inputs::new(row, inputs.dimension()).unwrap()).unwrap();
    }
    crowd
}

fn copies() -> impl Strategy<Value = Vec<(usize, f64)>> {
    vec((0..20usize, prop_oneof![Just(0.0), Just(1e-4), Just(0.05)]), 0..4)
}

proptest! {
    #![proptest_config(cases(300))]

    #[test]
    fn one_and_two_points_are_exact(problem in problems(1..=14), copies in copies(), known in points(2, 4)) {
        let inputs = crowded(&problem, &copies);
        let kernel = problem.prior.kernel();
        let known = Inputs::new(known.rows().flat_map(|row| row[..inputs.dimension()].to_vec()).collect(), inputs.dimension());
        let known = known.unwrap();
        for known in [Inputs::empty(inputs.dimension()), known] {
            let candidates = Candidates::given(kernel, &inputs, &known).unwrap();
            // Compute the candidates' covariance given the known points.
            let mut everything = inputs.clone();
            everything.append(&known).unwrap();
            let places: Vec<usize> = (inputs.len()..everything.len()).collect();
            let gram = conditional(&rows(&kernel.gram(&everything).unwrap()), &places);
            let gram: Dense = gram[..inputs.len()].iter().map(|row| row[..inputs.len()].to_vec()).collect();
            let prior = kernel.diagonal(&inputs).unwrap();
            let total = trace(&gram);
            assert_near("trace", &[candidates.trace()], &[total], 1e-9);

            for points in [1, 2] {
                let sets: Vec<Vec<usize>> = if points == 1 {
                    (0..inputs.len()).map(|i| vec![i]).collect()
                } else {
                    (0..inputs.len()).flat_map(|j| (0..j).map(move |i| vec![i, j])).collect()
                };
                // Sets within rounding of the distinctness limit would be ambiguous. These cases contain none.
                let allowed = |margin: f64| -> Vec<f64> {
                    let sets = sets.iter().filter(|set| distinct(&gram, &prior, set, margin));
                    sets.map(|set| trace(&conditional(&gram, set))).collect()
                };
                let traces = allowed(1.0);
                prop_assert_eq!(traces.len(), allowed(1.0 + 1e-6).len());
                if traces.is_empty() {
                    continue;
                }
                let smallest = traces.iter().copied().fold(f64::INFINITY, f64::min);
                let largest = traces.iter().copied().fold(0.0, f64::max);
                for (selection, expected) in [(candidates.minimise_trace(points), smallest), (candidates.maximise_trace(points), largest)] {
                    prop_assert_eq!(selection.indices.len(), points);
                    prop_assert!(distinct(&gram, &prior, &selection.indices, 1.0));
                    let achieved = trace(&conditional(&gram, &selection.indices));
                    let slack = 1e-8 * trace(&rows(&kernel.gram(&inputs).unwrap()));
                    prop_assert!((selection.trace - achieved).abs() < slack, "{} is {}", selection.trace, achieved);
                    prop_assert!((achieved - expected).abs() < slack, "{} instead of {}", achieved, expected);
                }
            }
        }
    }

    #[test]
    fn no_swap_improves_more_points(problem in problems(3..=14), copies in copies()) {
        let inputs = crowded(&problem, &copies);
        let kernel = problem.prior.kernel();
        let candidates = Candidates::new(kernel, &inputs).unwrap();
        let gram = rows(&kernel.gram(&inputs).unwrap());
        let prior = kernel.diagonal(&inputs).unwrap();
        let slack = 1e-8 * trace(&gram);
        for points in [3, 4] {
            let (good, greedy, bad) = (candidates.minimise_trace(points), candidates.greedy(points), candidates.maximise_trace(points));
            prop_assert_eq!(good.indices.len(), greedy.indices.len());
            prop_assert!(good.trace <= greedy.trace + slack, "{} after {}", good.trace, greedy.trace);
            // If few points explain everything, no further point is distinct. The bad choice may then have more points.
            let comparable = bad.indices.len() <= good.indices.len();
            prop_assert!(!comparable || bad.trace >= good.trace - slack, "{:?}, {:?}", good, bad);
            // A greedy choice of fewer points is a prefix of the greedy choice.
            prop_assert_eq!(&greedy.indices[..1], &candidates.greedy(1).indices[..]);
            for (selection, direction) in [(&good, 1.0), (&bad, -1.0)] {
                let achieved = trace(&conditional(&gram, &selection.indices));
                prop_assert!((selection.trace - achieved).abs() < slack, "{} is {}", selection.trace, achieved);
                for place in 0..selection.indices.len() {
                    for replacement in (0..inputs.len()).filter(|n| !selection.indices.contains(n)) {
                        let mut others = selection.indices.clone();
                        others.remove(place);
                        others.push(replacement);
                        // Sets with a point that the others make redundant may be refused.
                        if distinct(&gram, &prior, &others, 1.0 + 1e-6) {
                            let swapped = trace(&conditional(&gram, &others));
                            let gain = direction * (selection.trace - swapped);
                            prop_assert!(gain < slack, "{:?} is improved by {} through {:?}", selection, gain, others);
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn judged_choices_agree_with_choices_in_memory(problem in problems(3..=14), copies in copies()) {
        let inputs = crowded(&problem, &copies);
        let kernel = problem.prior.kernel();
        let gram = rows(&kernel.gram(&inputs).unwrap());
        let slack = 1e-8 * trace(&gram);
        for points in 0..5 {
            // If all inputs are judges, the result is that of the greedy choice in memory, except for ties within
            // rounding.
            let whole = Candidates::new(kernel, &inputs).unwrap().greedy(points);
            let judged = dgpc::greedy_judged(kernel, &inputs, points, inputs.len()).unwrap();
            prop_assert!((judged.trace - whole.trace).abs() < 1e-6 * trace(&gram), "{judged:?}, {whole:?}");
            let few = dgpc::greedy_judged(kernel, &inputs, points, 2).unwrap();
            let cheap = dgpc::greedy_by_variance(kernel, &inputs, points).unwrap();
            prop_assert!(few.indices.len() == points || few.trace < 1e-3 * trace(&gram), "{few:?} of {points}");
            for selection in [&judged, &few, &cheap] {
                let achieved = trace(&conditional(&gram, &selection.indices));
                prop_assert!((selection.trace - achieved).abs() < slack, "{selection:?} is {achieved}");
            }
            // The cheap rule chooses a point of the largest variance given the points before it.
            for (place, &index) in cheap.indices.iter().enumerate() {
                let remaining = conditional(&gram, &cheap.indices[..place]);
                prop_assert!((0..inputs.len()).all(|other| remaining[other][other] <= remaining[index][index] + slack));
            }
        }
    }

    #[test]
    fn conditioning_agrees_with_known_points(problem in problems(2..=16), seed in any::<u64>(), count in 1..5usize) {
        let kernel = problem.prior.kernel();
        let fresh = Candidates::new(kernel, problem.inputs()).unwrap();
        let random = fresh.random(count, &mut seeded(seed));
        let gram = problem.gram();
        let scale = trace(&gram);
        // If points keep only 1e-2 of their variance, elimination loses up to four digits.
        prop_assert!((random.trace - trace(&conditional(&gram, &random.indices))).abs() < 1e-8 * scale);
        prop_assert!(random.trace >= fresh.minimise_trace(random.indices.len()).trace - 1e-8 * scale || random.indices.len() > 2);

        let mut conditioned = fresh.clone();
        conditioned.condition_on(&random.indices);
        let given = Candidates::given(kernel, problem.inputs(), &problem.inputs().select(&random.indices)).unwrap();
        prop_assert!((conditioned.trace() - given.trace()).abs() < 1e-8 * scale);
        prop_assert!((conditioned.trace() - random.trace).abs() < 1e-12 * scale);
        for points in 1..4 {
            let mut choices = Vec::new();
            for candidates in [&conditioned, &given] {
                choices.push([candidates.minimise_trace(points), candidates.maximise_trace(points), candidates.greedy(points)]);
            }
            for selection in choices.iter().flatten() {
                let again = selection.indices.iter().any(|index| random.indices.contains(index));
                prop_assert!(!again, "{:?} although {:?} are known", selection, random.indices);
                let known = [selection.indices.as_slice(), &random.indices].concat();
                let achieved = trace(&conditional(&gram, &known));
                prop_assert!((selection.trace - achieved).abs() < 1e-7 * scale, "{:?} is {}", selection, achieved);
            }
            // Beyond two points the choice is a local optimum, which can depend on rounding.
            if points <= 2 {
                for (conditioned, given) in choices[0].iter().zip(&choices[1]) {
                    prop_assert!((conditioned.trace - given.trace).abs() < 1e-7 * scale, "{:?}, {:?}", conditioned, given);
                }
            }
        }
    }

    #[test]
    fn no_point_is_chosen_twice(problem in problems(1..=4), seed in any::<u64>()) {
        // Every event occurs three times.
        let inputs = problem.inputs();
        let tripled = inputs.select(&(0..3 * inputs.len()).map(|n| n % inputs.len()).collect::<Vec<_>>());
        let candidates = Candidates::new(problem.prior.kernel(), &tripled).unwrap();
        for points in 0..=6 {
            let choices = [
                candidates.minimise_trace(points),
                candidates.maximise_trace(points),
                candidates.greedy(points),
                candidates.random(points, &mut seeded(seed)),
            ];
            for selection in choices {
                prop_assert!(selection.indices.len() <= points.min(inputs.len()));
                prop_assert!(!selection.indices.is_empty() || points == 0);
                let mut places: Vec<usize> = selection.indices.iter().map(|n| n % inputs.len()).collect();
                places.sort_unstable();
                places.dedup();
                prop_assert_eq!(places.len(), selection.indices.len());
                prop_assert!(selection.trace.is_finite() && selection.trace >= -1e-9);
            }
        }
    }
}

#[test]
fn known_points_are_not_chosen_as_a_pair() {
    // The conditional variance of a known point is a rounding error of either sign. Two negative variances have a
    // positive determinant.
    for seed in 0..2000 {
        use rand::RngExt;
        let mut rng = seeded(seed);
        let inputs = line(&(0..6).map(|_| rng.random_range(-2.0..2.0)).collect::<Vec<f64>>());
        let kernel = line_prior(Shape::Matern32).kernel().clone();
        let candidates = Candidates::given(&kernel, &inputs, &inputs.slice(0..4)).unwrap();
        for selection in [candidates.minimise_trace(2), candidates.maximise_trace(2)] {
            assert!(selection.indices.iter().all(|&index| index >= 4), "seed {seed}: {selection:?}");
        }
    }
}

#[test]
fn exchange_reports_the_trace_of_its_points() {
    // Three of the points are so close that the middle one is almost redundant given the outer two.
    let inputs = line(&[
        0.882_815_316_476_661_4,
        0.784_191_639_164_795_3,
        0.906_343_886_324_464_9,
        0.0,
        -0.833_606_508_175_062_1,
    ]);
    let kernel = Kernel::new(vec![Term::isotropic(Shape::Matern32, 0.5, 1.451_442_318_530_819_6, 1).unwrap()]).unwrap();
    let candidates = Candidates::new(&kernel, &inputs).unwrap();
    let gram = rows(&kernel.gram(&inputs).unwrap());
    for points in 1..=5 {
        for selection in [candidates.minimise_trace(points), candidates.maximise_trace(points)] {
            let achieved = trace(&conditional(&gram, &selection.indices));
            assert!((selection.trace - achieved).abs() < 1e-10, "{points} points: {selection:?} is {achieved}");
        }
    }
}
