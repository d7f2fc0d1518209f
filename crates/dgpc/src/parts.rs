//! Splits work into parts. With the feature `parallel`, several threads share the parts.

use std::ops::Range;

/// Events in one block. A block needs 2 · 256 · M doubles, for the features and a scaled copy of them. They fit into
/// the second-level cache.
pub(crate) const BLOCK: usize = 256;

/// Largest number of parts. It is large enough to occupy the threads. It is small enough that the partial sums,
/// 128M² bytes for M inducing points, fit into memory.
const PARTS_MAX: usize = 16;

/// Smallest number of multiply-adds in one part, when there are several.
const PART_WORK: usize = 1 << 25;

/// Splits `events` into parts of whole blocks, in order. The number of parts depends on the work alone, not on the
/// number of threads. Sums over the parts therefore do not depend on the number of threads either.
pub(crate) fn parts(events: usize, work_each: usize) -> Vec<Range<usize>> {
    let count = (events.saturating_mul(work_each) / PART_WORK).clamp(1, PARTS_MAX);
    let length = events.div_ceil(count).next_multiple_of(BLOCK).max(BLOCK);
    stretches(0..events, length).collect()
}

/// Splits a part into blocks, in order.
pub(crate) fn blocks(part: Range<usize>) -> impl Iterator<Item = Range<usize>> {
    stretches(part, BLOCK)
}

/// Splits a range into stretches of the given length, in order. The last stretch may be shorter.
pub(crate) fn stretches(whole: Range<usize>, length: usize) -> impl Iterator<Item = Range<usize>> {
    whole.clone().step_by(length).map(move |first| first..whole.end.min(first + length))
}

/// Applies `work` to each part and returns the results in the order of the parts.
#[cfg(feature = "parallel")]
pub(crate) fn on_parts<P: Send, R: Send>(parts: Vec<P>, work: impl Fn(P) -> R + Send + Sync) -> Vec<R> {
    use rayon::prelude::*;
    if parts.len() < 2 {
        parts.into_iter().map(work).collect()
    } else {
        parts.into_par_iter().with_max_len(1).map(work).collect()
    }
}

/// Applies `work` to each part and returns the results in the order of the parts.
#[cfg(not(feature = "parallel"))]
pub(crate) fn on_parts<P: Send, R: Send>(parts: Vec<P>, work: impl Fn(P) -> R + Send + Sync) -> Vec<R> {
    parts.into_iter().map(work).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_cover_the_whole_in_whole_blocks() {
        for events in [0, 1, 255, 256, 257, 4000, 4097, 1_000_000] {
            for work_each in [1, 10_000, 65_536] {
                let parts = parts(events, work_each);
                assert!(parts.len() <= PARTS_MAX, "{events} {work_each}: {parts:?}");
                assert!(parts.iter().flat_map(Clone::clone).eq(0..events), "{events} {work_each}: {parts:?}");
                assert!(parts.iter().all(|part| part.start % BLOCK == 0));
                assert!(parts.iter().cloned().flat_map(blocks).flatten().eq(0..events));
            }
        }
        assert_eq!(parts(1000, 10_000).len(), 1, "little work stays in one part");
    }
}
