//! Work on parts of a whole, on several threads where the feature `parallel` is on.

use std::ops::Range;

/// Events that one block takes: twice M × 256 doubles, features and what is made of them, stay in the second-level cache.
pub(crate) const BLOCK: usize = 256;

/// Parts of a whole, at most: enough to share out, few enough that the sums of all, 128M² bytes for M inducing points, fit into
/// memory.
const PARTS_MAX: usize = 16;

/// Multiply-adds that a part is worth making for.
const PART_WORK: usize = 1 << 25;

/// `events` in parts of whole blocks, in order. How many there are depends on the work alone and not on the number of
/// threads, and so do sums over them.
pub(crate) fn parts(events: usize, work_each: usize) -> Vec<Range<usize>> {
    let count = (events.saturating_mul(work_each) / PART_WORK).clamp(1, PARTS_MAX);
    let length = events.div_ceil(count).next_multiple_of(BLOCK).max(BLOCK);
    stretches(0..events, length).collect()
}

/// Blocks of a part, in order.
pub(crate) fn blocks(part: Range<usize>) -> impl Iterator<Item = Range<usize>> {
    stretches(part, BLOCK)
}

/// Stretches of this length, in order, of which the last may be shorter.
pub(crate) fn stretches(whole: Range<usize>, length: usize) -> impl Iterator<Item = Range<usize>> {
    whole.clone().step_by(length).map(move |first| first..whole.end.min(first + length))
}

/// What `work` makes of each part, in their order.
#[cfg(feature = "parallel")]
pub(crate) fn on_parts<P: Send, R: Send>(parts: Vec<P>, work: impl Fn(P) -> R + Send + Sync) -> Vec<R> {
    use rayon::prelude::*;
    if parts.len() < 2 {
        parts.into_iter().map(work).collect()
    } else {
        parts.into_par_iter().with_max_len(1).map(work).collect()
    }
}

/// What `work` makes of each part, in their order.
#[cfg(not(feature = "parallel"))]
pub(crate) fn on_parts<P: Send, R: Send>(parts: Vec<P>, work: impl Fn(P) -> R + Send + Sync) -> Vec<R> {
    parts.into_iter().map(work).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_the_whole_in_whole_blocks() {
        for events in [0, 1, 255, 256, 257, 4000, 4097, 1_000_000] {
            for work_each in [1, 10_000, 65_536] {
                let parts = parts(events, work_each);
                assert!(parts.len() <= PARTS_MAX, "{events} {work_each}: {parts:?}");
                assert!(parts.iter().flat_map(Clone::clone).eq(0..events), "{events} {work_each}: {parts:?}");
                assert!(parts.iter().all(|part| part.start % BLOCK == 0));
                assert!(parts.iter().cloned().flat_map(blocks).flatten().eq(0..events));
            }
        }
        assert_eq!(parts(1000, 10_000).len(), 1, "a small one is not worth sharing out");
    }
}
