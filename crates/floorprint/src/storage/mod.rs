//! Where settled parts of a session lie: in memory, or put away in a store when there are too many of them.

mod part;
mod shelf;
mod store;

pub(crate) use part::Part;
pub(crate) use shelf::Shelf;
pub use shelf::StorageTrouble;
pub use store::{Store, StoreError};
