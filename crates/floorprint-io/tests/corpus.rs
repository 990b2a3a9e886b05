//! What fuzzing found, and what it begins with, is looked at once in every test run.

#![expect(clippy::expect_used, reason = "a test ends where a step fails")]

#[path = "../../../fuzz/src/lib.rs"]
mod targets;

use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

#[test]
fn no_input_of_the_corpus_hurts() {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus");
    for (name, look) in targets::TARGETS {
        let mut inputs: Vec<_> = fs::read_dir(corpus.join(name)).unwrap().map(|entry| entry.unwrap().path()).collect();
        inputs.sort();
        assert!(!inputs.is_empty(), "{name}");
        for input in inputs {
            let bytes = fs::read(&input).unwrap();
            let started = Instant::now();
            look(&bytes);
            let took = started.elapsed();
            assert!(took < Duration::from_secs(10), "{} takes {took:?}", input.display());
        }
    }
}
