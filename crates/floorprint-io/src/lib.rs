//! Readers and writers: everything of Floorprint that touches files.
