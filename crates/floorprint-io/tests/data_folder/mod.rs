//! Where the real data of the tests are.

use std::path::PathBuf;

/// The folder of real data, if it is on this machine.
pub fn data() -> Option<PathBuf> {
    let folder = std::env::var_os("FLOORPRINT_DATA")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"), PathBuf::from);
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("skipped: no real data at {} (set FLOORPRINT_DATA to where they are)", folder.display());
    None
}
