//! Instructions of each kernel, counted by valgrind: the same on a busy machine as on an idle one.

use floorprint_benches::{Inputs, KERNELS};
use gungraun::{library_benchmark, library_benchmark_group, main};

type Prepared = Option<(Inputs, fn(&mut Inputs))>;

/// A kernel that has run once before, so that its maps hold the tiles that it writes to.
fn prepared(name: &str) -> Prepared {
    let mut inputs = Inputs::new().ok()?;
    let (_, kernel) = KERNELS.into_iter().find(|(known, _)| *known == name)?;
    kernel(&mut inputs);
    Some((inputs, kernel))
}

#[library_benchmark]
#[bench::ray(args = ("ray"), setup = prepared)]
#[bench::grid_scan(args = ("grid_scan"), setup = prepared)]
#[bench::surfaces(args = ("surfaces"), setup = prepared)]
#[bench::match_scan(args = ("match_scan"), setup = prepared)]
#[bench::search(args = ("search"), setup = prepared)]
#[bench::map_write(args = ("map_write"), setup = prepared)]
#[bench::map_carve(args = ("map_carve"), setup = prepared)]
#[bench::map_copy(args = ("map_copy"), setup = prepared)]
fn kernel(mut prepared: Prepared) -> Prepared {
    // The inputs are handed back, so that dropping them is not counted.
    if let Some((inputs, kernel)) = &mut prepared {
        kernel(inputs);
    }
    prepared
}

library_benchmark_group!(name = kernels, benchmarks = kernel);
main!(library_benchmark_groups = kernels);
