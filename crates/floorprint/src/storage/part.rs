//! Bytes that do not change any more.

use super::Shelf;
use std::fmt;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

/// Bytes that do not change any more, and may have been put away. Copies are the same part.
#[derive(Clone)]
pub(crate) struct Part(Arc<PartInner>);

pub(super) struct PartInner {
    length: usize,
    place: Mutex<Place>,
    /// Who sees to it that not too much lies in memory; nobody where that is not bounded.
    shelf: OnceLock<Arc<Shelf>>,
}

/// Where the bytes are: in memory, in the store, or in both.
#[derive(Default)]
pub(super) struct Place {
    pub(super) bytes: Option<Arc<[u8]>>,
    /// Under which key they are in the store.
    pub(super) key: Option<u64>,
    /// When they were used last, by the shelf's clock.
    pub(super) used: u64,
}

impl Part {
    /// A part in memory.
    pub(crate) fn new(bytes: impl Into<Arc<[u8]>>) -> Self {
        let bytes = bytes.into();
        let (length, place) = (bytes.len(), Place { bytes: Some(bytes), ..Place::default() });
        Self(Arc::new(PartInner { length, place: Mutex::new(place), shelf: OnceLock::new() }))
    }

    /// Its length, bytes.
    pub(crate) fn len(&self) -> usize {
        self.0.length
    }

    /// The bytes, brought back if they were put away. Empty where they are lost, which the shelf remembers.
    pub(crate) fn bytes(&self) -> Arc<[u8]> {
        let mut place = self.0.lock();
        if let Some(bytes) = &place.bytes {
            let bytes = Arc::clone(bytes);
            place.used = self.0.shelf.get().map_or(0, |shelf| shelf.tick());
            return bytes;
        }
        drop(place);
        self.0.shelf.get().map_or_else(Arc::default, |shelf| shelf.bring_back(&self.0))
    }

    /// Bytes of it that are in memory.
    pub(crate) fn held_bytes(&self) -> usize {
        if self.0.lock().bytes.is_some() { self.0.length } else { 0 }
    }

    /// Leaves it to a shelf how long the bytes stay in memory; the first shelf counts.
    pub(crate) fn lay_on(&self, shelf: &Arc<Shelf>) {
        if self.0.length > 0 && self.0.shelf.set(Arc::clone(shelf)).is_ok() {
            shelf.take(&self.0);
        }
    }
}

impl PartInner {
    pub(super) fn lock(&self) -> MutexGuard<'_, Place> {
        self.place.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn length(&self) -> usize {
        self.length
    }
}

impl Drop for PartInner {
    fn drop(&mut self) {
        if let Some(shelf) = self.shelf.get() {
            let place = self.place.get_mut().unwrap_or_else(PoisonError::into_inner);
            shelf.forget(self.length, place.bytes.is_some(), place.key);
        }
    }
}

impl fmt::Debug for Part {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{} bytes", self.len())
    }
}

impl Default for Part {
    fn default() -> Self {
        Self::new(Vec::new())
    }
}
