//! Recordings with any damage: never a panic, and never memory out of proportion to what is there.

#![allow(
    clippy::panic,
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::print_stdout,
    reason = "a test ends where a step fails"
)]

mod bag_writers;

use bag_writers::{Message, Rays, mcap, odometry, ros1_bag, scan, sqlite, transform};
use floorprint_io::{OpenOptions, open};
use proptest::prelude::*;
use std::alloc::{GlobalAlloc, Layout, System};
use std::fs;
use std::sync::atomic::{AtomicUsize, Ordering};

/// The system's allocator, with the largest piece that was asked for.
struct Watched;

static LARGEST: AtomicUsize = AtomicUsize::new(0);

// SAFETY: everything is handed on to the system's allocator as it is.
unsafe impl GlobalAlloc for Watched {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        LARGEST.fetch_max(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's promises are handed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller's promises are handed on.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Watched = Watched;

/// Buffers of the readers and of the libraries that unpack take no more than this, whatever is read, bytes: the
/// largest is a window of zstd.
const BUFFERS: usize = 12 << 20;

fn messages() -> Vec<Message> {
    let rays = Rays {
        angle_min_rad: -1.5,
        angle_increment_rad: 0.1,
        time_increment_s: 1e-4,
        scan_time_s: 0.1,
        range_min_m: 0.1,
        range_max_m: 30.0,
    };
    let step = |step: u32| {
        let stamp_ns = 1_700_000_000_000_000_000 + u64::from(step) * 100_000_000;
        let x = f64::from(step) * 0.1;
        [
            odometry("/odom", stamp_ns, "base_link", [x, 0.0, 0.0]),
            transform("/tf", stamp_ns, "base_link", "laser", [0.1, 0.0, 0.2], [0.0, 0.0]),
            scan("/scan", stamp_ns, "laser", &rays, &[1.0 + step as f32; 31]),
        ]
    };
    (0..12).flat_map(step).collect()
}

fn recordings() -> Vec<(&'static str, Vec<u8>)> {
    let messages = messages();
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("drive.db3");
    sqlite(&database, &messages, <[u8]>::to_vec);
    vec![
        ("none.bag", ros1_bag(&messages, "none", 10)),
        ("bz2.bag", ros1_bag(&messages, "bz2", 10)),
        ("lz4.bag", ros1_bag(&messages, "lz4", 10)),
        ("none.mcap", mcap(&messages, "", 10, false)),
        ("lz4.mcap", mcap(&messages, "lz4", 10, true)),
        ("zstd.mcap", mcap(&messages, "zstd", 10, false)),
        ("drive.db3", fs::read(database).unwrap()),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn any_damage_is_survived(
        cut in 0.0..1.2_f64,
        flips in proptest::collection::vec((0.0..1.0_f64, any::<u8>()), 0..6),
        number in proptest::option::of((0.0..1.0_f64, prop_oneof![Just(u32::MAX), Just(0x7fff_ffff_u32), any::<u32>()])),
    ) {
        let folder = tempfile::tempdir().unwrap();
        for (name, whole) in recordings() {
            let mut bytes = whole;
            let at = |share: f64| (share * bytes.len() as f64) as usize;
            let flips: Vec<(usize, u8)> = flips.iter().map(|&(share, flip)| (at(share), flip)).collect();
            // A length that is far too large.
            let number = number.map(|(share, number)| (at(share), number));
            let end = at(cut);
            for (place, flip) in flips {
                bytes[place] ^= flip;
            }
            if let Some((place, number)) = number
                && let Some(length) = bytes[place..].first_chunk_mut()
            {
                *length = number.to_le_bytes();
            }
            bytes.truncate(end);
            let path = folder.path().join(name);
            fs::write(&path, &bytes).unwrap();
            LARGEST.store(0, Ordering::Relaxed);
            let result = open(&path, &OpenOptions::default());
            let largest = LARGEST.load(Ordering::Relaxed);
            prop_assert!(largest <= BUFFERS, "{name}: {largest} bytes at once for a file of {}", bytes.len());
            if let Ok(data_set) = result {
                prop_assert!(data_set.records.len() <= 24, "{name}: {}", data_set.records.len());
            }
        }
    }
}
