//! Two folders that change places in one step.

use std::io;
use std::path::Path;

/// Lets what stands at `one` and at `other` change places: whoever looks sees both where they were or
/// both where they are to be, whenever the program or the machine is stopped.
///
/// # Errors
/// Of kind [`Unsupported`](io::ErrorKind::Unsupported) where the system or the file system cannot do that.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
pub(crate) fn exchange(one: &Path, other: &Path) -> io::Result<()> {
    use nix::errno::Errno;
    use nix::fcntl::{AT_FDCWD, RenameFlags, renameat2};
    renameat2(AT_FDCWD, one, AT_FDCWD, other, RenameFlags::RENAME_EXCHANGE).map_err(|error| match error {
        Errno::EINVAL | Errno::ENOSYS | Errno::EOPNOTSUPP => io::ErrorKind::Unsupported.into(),
        error => error.into(),
    })
}

/// Lets what stands at `one` and at `other` change places in one step: this system cannot.
///
/// # Errors
/// Always of kind [`Unsupported`](io::ErrorKind::Unsupported).
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub(crate) fn exchange(_one: &Path, _other: &Path) -> io::Result<()> {
    Err(io::ErrorKind::Unsupported.into())
}
