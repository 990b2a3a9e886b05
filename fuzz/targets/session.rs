#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| floorprint_fuzz::session(bytes));
