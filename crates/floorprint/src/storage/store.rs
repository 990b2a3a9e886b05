//! A place outside of memory.

use std::fmt::Debug;
use thiserror::Error;

/// Where bytes are put that are not needed now: a file, as a rule. This crate knows no files, so that whoever wants memory
/// to be bounded brings one (`floorprint_io::ScratchFile`).
pub trait Store: Debug + Send {
    /// Keeps bytes; gives the key by which they are found again.
    ///
    /// # Errors
    /// They cannot be kept, in words for the user: the bytes then stay in memory.
    fn put(&mut self, bytes: &[u8]) -> Result<u64, StoreError>;

    /// The `length` bytes that were put under a key.
    ///
    /// # Errors
    /// They cannot be had any more, in words for the user.
    fn get(&mut self, key: u64, length: usize) -> Result<Vec<u8>, StoreError>;

    /// Nobody asks for these bytes any more.
    fn free(&mut self, key: u64, length: usize);
}

/// Why bytes cannot be kept or had again, in words for the user.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{0}")]
pub struct StoreError(pub String);
