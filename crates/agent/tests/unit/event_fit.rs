//! Fits of own and remote events.

use super::*;
use dgpc::{FitOptions, Inputs, Kernel, PriorMean, Shape, Term};

fn observations(x: impl Iterator<Item = f64>) -> Observations {
    let rows: Vec<[f64; 1]> = x.map(|x| [x]).collect();
    let outcomes = rows.iter().map(|[x]| x.sin() > 0.3).collect();
    Observations::new(Inputs::from_rows(&rows).unwrap(), outcomes).unwrap()
}

/// Returns a sparse fit of 40 events. Every second event is an own event.
fn sparse_fit() -> EventFit {
    let kernel = Kernel::new(vec![Term::isotropic(Shape::SquaredExponential, 4.0, 1.0, 1).unwrap()]).unwrap();
    let prior = Prior::new(kernel, PriorMean::Zero).unwrap();
    let points = observations((0..8).map(f64::from)).inputs().clone();
    let options = FitOptions::default().inducing_points(&points);
    let fit = dgpc::fit(&prior, &observations((0..40).map(|n| 0.2 * f64::from(n))), &options).unwrap();
    let source = |n: u32| if n.is_multiple_of(2) { EventSource::Own(n.into()) } else { EventSource::Remote((1, n)) };
    let (sources, sites_id) = ((0..40).map(source).collect(), Arc::default());
    EventFit { fit, sources, changes_since_fit: 0, remote: Arc::default(), sites_id }
}

#[test]
fn an_updated_partial_summary_equals_a_new_one() {
    let numbers = |range: std::ops::Range<u64>| range.collect::<BTreeSet<u64>>();
    let latent = |partial: &PartialSummary| {
        let somewhere = observations((0..9).map(f64::from)).inputs().clone();
        partial.posterior_with(&[]).unwrap().latent(&somewhere).unwrap()
    };
    let is_equal_to_new = |fit: &EventFit, wanted: std::ops::Range<u64>, previous: &PartialSummary| {
        let wanted = numbers(wanted);
        let found =
            [Some(previous), None].map(|previous| latent(&fit.partial_summary(&wanted, previous).unwrap().unwrap()));
        let differences =
            |of: fn(&dgpc::Latent) -> &[f64]| of(&found[0]).iter().zip(of(&found[1])).map(|(a, b)| (a - b).abs());
        let variances = differences(|latent| &latent.variance);
        differences(|latent| &latent.mean).chain(variances).all(|difference| difference < 1e-8)
    };
    let fit = sparse_fit();
    // Events 40 and 42 are not in the fit yet.
    let previous = fit.partial_summary(&numbers(4..44), None).unwrap().unwrap();
    assert!(is_equal_to_new(&fit, 10..38, &previous));
    for removed in [EventSource::Remote((1, 7)), EventSource::Own(8)] {
        let mut kept: HashMap<EventSource, usize> = fit.sources.iter().copied().zip(0..).collect();
        kept.remove(&removed);
        let new = [40, 42].map(EventSource::Own);
        let more = observations([3.3, 5.1].into_iter());
        let amended = fit.amended(&kept, new.into_iter(), &more, &AcceptedData::default()).unwrap().unwrap();
        assert_eq!(amended.sources.len(), 41);
        assert!(is_equal_to_new(&amended, 4..44, &previous), "{removed:?}");
        assert!(is_equal_to_new(&amended, 0..41, &previous), "{removed:?}");
    }
}
