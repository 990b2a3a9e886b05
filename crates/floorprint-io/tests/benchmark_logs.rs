//! The public benchmark's logs are read whole, with their known traps.

use floorprint_io::{OpenOptions, open, read_relations};
use std::path::PathBuf;

/// The folder of real data, if it is on this machine.
fn data() -> Option<PathBuf> {
    let folder = std::env::var_os("FLOORPRINT_DATA")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"), PathBuf::from);
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("skipped: no real data at {} (set FLOORPRINT_DATA to where they are)", folder.display());
    None
}

#[test]
fn every_scan_of_the_benchmark_logs_is_read() {
    let Some(data) = data() else { return };
    for (name, scans, rays, no_return_m, relations) in
        [("intel", 13631, 180, 81.83, 2984), ("aces", 7374, 180, 50.0, 1279), ("mit-csail", 1988, 361, 81.91, 1172)]
    {
        let folder = data.join("relations").join(name);
        let log = open(&folder.join(format!("{name}.clf.gz")), &OpenOptions::default()).unwrap();
        assert_eq!(log.scans().count(), scans);
        assert_eq!(log.dropped.total(), 0);
        for scan in log.scans() {
            assert_eq!(scan.ranges_m.len(), rays);
            assert!(scan.odometry.is_some());
            let limit = scan.geometry.range_max_m;
            assert!(limit <= no_return_m && limit > no_return_m - 0.02, "{name}: {limit}");
        }
        assert_eq!(read_relations(&folder.join(format!("{name}.relations"))).unwrap().len(), relations);
    }
}
