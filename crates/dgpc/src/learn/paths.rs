//! Paths of searches from several starts. The searches may run in parallel; the result does not depend on that.

use std::sync::OnceLock;

use crate::error::Result;

/// The reason why a search ended.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Stop {
    /// The gradient and the curvature of the evidence E predict almost no further gain, or E no longer changes.
    Converged,
    /// The search took the largest allowed number of steps.
    IterationsMax,
    /// No step along the search direction increased E, or E could not be computed there. The text is the optimiser's
    /// message. The best place so far is kept.
    NoProgress(String),
}

/// A place on a path that is better than all places before it.
pub(super) struct Step {
    pub(super) coordinates: Vec<f64>,
    /// E plus the log density of the hyperprior.
    pub(super) objective: f64,
    /// Number of evaluations up to this place.
    pub(super) evaluations: usize,
}

/// The path of one search.
pub(super) struct Path {
    /// The steps, at least one.
    pub(super) steps: Vec<Step>,
    /// Tilts of the fit at the last step.
    pub(super) tilts: Vec<f64>,
    pub(super) evaluations: usize,
    pub(super) stop: Stop,
}

impl Path {
    /// Returns the index of the first step that leads to one of `ends`.
    fn first_to(&self, ends: &[&Step], leads_to: impl Fn(&Step, &Step) -> bool) -> Option<usize> {
        self.steps.iter().position(|step| ends.iter().any(|end| leads_to(step, end)))
    }
}

/// The paths of all starts, as far as they are finished.
pub(super) struct Paths(Vec<OnceLock<Result<Path>>>);

impl Paths {
    pub(super) fn new(starts: usize) -> Self {
        Self((0..starts).map(|_| OnceLock::new()).collect())
    }

    /// Stores the path of a start. The first stored path of a start counts.
    pub(super) fn set(&self, start: usize, path: Result<Path>) {
        let _ = self.0[start].set(path);
    }

    /// Returns the ends of the finished paths from earlier starts, without those that led to the end of a still earlier
    /// path. Ends in this list stay in it when more paths finish.
    pub(super) fn ends_before(&self, start: usize, leads_to: impl Fn(&Step, &Step) -> bool) -> Vec<&Step> {
        let mut ends = Vec::new();
        for path in self.0[..start].iter().map_while(OnceLock::get).flatten() {
            if path.first_to(&ends, &leads_to).is_none() {
                ends.extend(path.steps.last());
            }
        }
        ends
    }

    /// Returns all finished paths. Each comes with the index of its first step that leads to the end of an earlier
    /// path, if there is one.
    pub(super) fn settled(self, leads_to: impl Fn(&Step, &Step) -> bool) -> Vec<Result<(Path, Option<usize>)>> {
        let first_known = |(start, path): (usize, &OnceLock<Result<Path>>)| {
            path.get()?.as_ref().ok()?.first_to(&self.ends_before(start, &leads_to), &leads_to)
        };
        let known: Vec<Option<usize>> = self.0.iter().enumerate().map(first_known).collect();
        let paths = self.0.into_iter().filter_map(OnceLock::into_inner);
        paths.zip(known).map(|(path, known)| Ok((path?, known))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn path(places: &[f64]) -> Result<Path> {
        let step =
            |(n, &place): (usize, &f64)| Step { coordinates: vec![place], objective: n as f64, evaluations: n + 1 };
        let steps: Vec<Step> = places.iter().enumerate().map(step).collect();
        Ok(Path { evaluations: steps.len(), steps, tilts: Vec::new(), stop: Stop::Converged })
    }

    fn are_near(step: &Step, end: &Step) -> bool {
        (step.coordinates[0] - end.coordinates[0]).abs() < 0.5
    }

    #[test]
    fn known_ends_do_not_depend_on_the_order_of_the_searches() {
        // Path 1 passes the end of path 0, path 2 leads to the point where path 1 ended later, and path 3 to path 2's
        // end.
        let ways: [&[f64]; 4] = [&[0.0, 1.0], &[3.0, 1.2, 5.0], &[9.0, 5.1], &[4.0, 5.0]];
        let expected = [None, Some(1), None, Some(1)];
        for order in [[0, 1, 2, 3], [3, 2, 1, 0], [1, 3, 0, 2]] {
            let paths = Paths::new(4);
            for start in order {
                let before: Vec<f64> =
                    paths.ends_before(start, are_near).iter().map(|end| end.coordinates[0]).collect();
                assert!([1.0, 5.1].starts_with(&before), "{order:?} {start}: {before:?}");
                paths.set(start, path(ways[start]));
            }
            let known: Vec<Option<usize>> =
                paths.settled(are_near).into_iter().map(|path| path.ok().and_then(|(_, known)| known)).collect();
            assert_eq!(known, expected, "{order:?}");
        }
    }
}
