//! The command line of Floorprint.

fn main() {}
