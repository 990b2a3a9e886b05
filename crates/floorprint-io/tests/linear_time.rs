//! Readers take time in proportion to what they read, also for logs made to be slow.

#![expect(clippy::unwrap_used, reason = "a test ends where a step fails")]

use floorprint_io::{OpenOptions, open, read_g2o, read_relations, read_trajectory};
use std::fs;
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Four times as much may take so many times as long: caches and the machine's other work add to four.
const MOST: f64 = 6.0;

/// How long a text takes to read, the quickest of several times.
fn quickest(text: &str, name: &str, read: &dyn Fn(&Path)) -> Duration {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    fs::write(&path, text).unwrap();
    let times = (0..3).map(|_| {
        let started = Instant::now();
        read(&path);
        started.elapsed()
    });
    times.min().unwrap()
}

/// Checks that time grows no faster than size, from a size at which it can be measured.
fn grows_linearly(what: &str, name: &str, text_of: &dyn Fn(usize) -> String, read: &dyn Fn(&Path)) {
    // One measurement at a time: the others would take its core and its cache.
    static TURN: Mutex<()> = Mutex::new(());
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let mut size = 50;
    while quickest(&text_of(size), name, read) < Duration::from_millis(15) && size <= 400_000 {
        size *= 2;
    }
    // The machine may be busy: one quiet moment is enough.
    let (small, large) = (text_of(size), text_of(4 * size));
    let ratio = (0..4).map(|_| {
        let [once, four_times] = [&small, &large].map(|text| quickest(text, name, read).as_secs_f64());
        four_times / once
    });
    let ratios: Vec<f64> =
        ratio.scan(true, |goes_on, ratio| goes_on.then(|| (*goes_on = ratio >= MOST, ratio).1)).collect();
    let best = ratios.iter().copied().fold(f64::INFINITY, f64::min);
    assert!(best < MOST, "{what}: four times {size} lines take {ratios:.1?} times as long");
}

fn opens(path: &Path) {
    open(path, &OpenOptions::default()).unwrap();
}

/// Numbers that look drawn at random, from 0 to 1.
fn scattered(index: usize) -> f64 {
    (index as f64 * 0.618_033_988_749_894_9).fract()
}

#[test]
fn logs_of_readings_that_all_differ() {
    let line = |scan: usize| {
        let ranges: String = (0..181).map(|ray| format!("{:.6} ", 40.0 + 39.0 * scattered(scan * 181 + ray))).collect();
        format!("FLASER 181 {ranges}0 0 0 0 0 0 {:.1} h 1\n", scan as f64 * 0.1)
    };
    grows_linearly("readings that differ", "log.clf", &|size| (0..size).map(line).collect(), &opens);
}

#[test]
fn logs_whose_scans_all_have_a_geometry_of_their_own() {
    let line = |scan: usize| {
        let start_rad = -1.57 + scan as f64 * 1e-7;
        format!(
            "ROBOTLASER1 0 {start_rad:.9} 3.14 0.5 81.9 0.01 0 7 1 2 3 4 3 2 1 0 0 0 0 0 0 0 0.1 0.2 0.3 0.4 0.5 {scan}.5 h 5\n"
        )
    };
    grows_linearly("geometries that differ", "log.clf", &|size| (0..size).map(line).collect(), &opens);
}

#[test]
fn logs_whose_stamps_run_backwards() {
    let lines = |size: usize| -> String {
        let ranges = "1000 ".repeat(682);
        (0..size).map(|scan| format!("{} 0 {scan} {scan} {ranges}\n", (size - scan) * 1000)).collect()
    };
    grows_linearly("stamps that run backwards", "log.dat", &lines, &opens);
}

#[test]
fn trajectories_relations_and_graphs() {
    let poses = |size: usize| -> String { (0..size).map(|k| format!("{}.5 {k} 0 0 0 0 0 1\n", size - k)).collect() };
    grows_linearly("trajectories", "t.tum", &poses, &|path| drop(read_trajectory(path)));
    let relations = |size: usize| -> String { (0..size).map(|k| format!("{k} {size} 1 2 0 0 0 1.5\n")).collect() };
    grows_linearly("relations", "r.relations", &relations, &|path| drop(read_relations(path)));
    let graph = |size: usize| -> String {
        let vertices = (0..size).map(|k| format!("VERTEX_SE2 {} {k} 0 0\n", size - k));
        let edges = (1..size).map(|k| format!("EDGE_SE2 {k} {} 1 0 0 1 0 0 1 0 1\n", k + 1));
        vertices.chain(edges).collect()
    };
    grows_linearly("graphs", "g.g2o", &graph, &|path| drop(read_g2o(path).unwrap()));
}
