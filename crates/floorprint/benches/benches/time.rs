//! Wall time of each kernel.

use criterion::{Criterion, criterion_group, criterion_main};
use floorprint_benches::{Inputs, KERNELS};

fn kernels(criterion: &mut Criterion) {
    match Inputs::new() {
        Ok(mut inputs) => {
            for (name, kernel) in KERNELS {
                criterion.bench_function(name, |bencher| bencher.iter(|| kernel(&mut inputs)));
            }
        }
        Err(error) => eprintln!("nothing to measure on: {error}"),
    }
}

criterion_group!(all, kernels);
criterion_main!(all);
