//! Progress that fits and learning report, and requests to stop them.

use std::ops::ControlFlow;
use std::sync::Mutex;

use dgpc::*;

/// Returns events along a line, successes in the middle.
fn events(count: usize) -> Observations {
    let inputs = Inputs::new((0..count).map(|n| n as f64 / count as f64 * 6.0 - 3.0).collect(), 1).unwrap();
    // Every seventh outcome is wrong.
    let outcomes = inputs.rows().enumerate().map(|(n, x)| (x[0].abs() < 1.5) != (n % 7 == 0)).collect();
    Observations::new(inputs, outcomes).unwrap()
}

fn prior() -> Prior {
    let kernel = Kernel::new(vec![Term::isotropic(Shape::Matern52, 4.0, 0.7, 1).unwrap()]).unwrap();
    Prior::new(kernel, PriorMean::Constant(0.0)).unwrap()
}

#[test]
fn a_fit_reports_every_iteration_and_stops_when_asked() {
    let (events, points) = (events(60), Inputs::from_rows(&[[-2.0], [-1.0], [0.0], [1.0], [2.0]]).unwrap());
    for options in [FitOptions::default(), FitOptions::default().inducing_points(&points)] {
        let seen = Mutex::new(Vec::new());
        let note = |progress| {
            seen.lock().unwrap().push(progress);
            ControlFlow::Continue(())
        };
        let fit = fit(&prior(), &events, &options.monitor(&note)).unwrap();
        let seen = seen.into_inner().unwrap();
        assert_eq!(seen.len(), fit.iterations());
        assert_eq!(seen.last(), Some(&Progress::Iteration { iterations: seen.len(), change: fit.change() }));

        let stop = |progress| match progress {
            Progress::Iteration { iterations, .. } if iterations > 1 => ControlFlow::Break(()),
            _ => ControlFlow::Continue(()),
        };
        assert_eq!(dgpc::fit(&prior(), &events, &options.monitor(&stop)).err(), Some(Error::Stopped));
    }
}

#[cfg(feature = "learn")]
#[test]
fn learning_stops_at_any_call() {
    let events = events(120);
    let count = |stop_at: usize, options: LearnOptions<'_>| {
        let calls = Mutex::new((0, 0));
        let note = |progress: Progress| {
            let mut calls = calls.lock().unwrap();
            calls.0 += 1;
            calls.1 += usize::from(matches!(progress, Progress::Evaluation { .. }));
            if calls.0 == stop_at { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        let learned = learn(&prior(), &events, &options.monitor(&note));
        (learned, calls.into_inner().unwrap())
    };
    // Dense searches, and sparse ones with a final fit of all events.
    for options in [LearnOptions::default(), LearnOptions::default().sparse_beyond(40, 12).search_events_max(80)] {
        let (learned, (calls, evaluations)) = count(usize::MAX, options);
        let learned = learned.unwrap();
        assert!(evaluations >= learned.evaluations && calls > 3 * evaluations, "{calls}, {evaluations}");
        // Parallel searches differ slightly in their number of calls.
        for stop_at in [1, 2, calls / 3, calls / 2] {
            let (stopped, (before, _)) = count(stop_at, options);
            assert_eq!(stopped.err(), Some(Error::Stopped), "at call {stop_at} of {calls}");
            // Other threads may have begun a call.
            assert!((stop_at..stop_at + 64).contains(&before), "{before} calls, stopped at {stop_at}");
        }
    }
}

#[test]
fn fits_end_at_the_precision_of_rounding() {
    let (events, points) = (events(80), Inputs::from_rows(&[[-2.0], [-1.0], [0.0], [1.0], [2.0]]).unwrap());
    for options in [FitOptions::default(), FitOptions::default().inducing_points(&points)] {
        let [usual, exact] = [options, options.tolerance(0.0)].map(|options| fit(&prior(), &events, &options).unwrap());
        assert_eq!(usual.stop(), FitStop::Converged);
        assert!(exact.stop() != FitStop::IterationsMax && exact.iterations() < 200, "{:?}", exact.stop());
        assert!(exact.change() < 1e-12, "{}", exact.change());
        let far = usual.mean().iter().zip(exact.mean()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(far < 1e-8, "{far}");
    }
}
