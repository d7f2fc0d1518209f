//! Every work, by criterion: before a change with `--save-baseline before`, after it with `--baseline before`.

use std::time::Duration;

use criterion::{BenchmarkId, Criterion, SamplingMode, Throughput, criterion_group, criterion_main};
use pingmap_bench::WORKS;

fn works(criterion: &mut Criterion) {
    for (group, short) in [("short", true), ("long", false)] {
        let mut group = criterion.benchmark_group(group);
        group.sampling_mode(SamplingMode::Flat).sample_size(if short { 20 } else { 10 });
        group.warm_up_time(Duration::from_millis(200)).measurement_time(Duration::from_millis(1500));
        for work in WORKS.iter().filter(|work| work.short == short) {
            group.throughput(Throughput::Elements(work.repeats as u64));
            group.bench_function(BenchmarkId::from_parameter(work.name), |bencher| {
                let mut run = (work.start)();
                bencher.iter(&mut run);
            });
        }
        group.finish();
    }
}

/// As the program `pingmap` has it.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

criterion_group!(all, works);
criterion_main!(all);
