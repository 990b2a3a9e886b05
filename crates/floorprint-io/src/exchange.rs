//! What the system does in one step with two names.

use std::io;
use std::path::Path;

/// Lets what stands at `one` and at `other` change places: whoever looks sees both where they were or
/// both where they are to be, whenever the program or the machine is stopped.
///
/// # Errors
/// Of kind [`Unsupported`](io::ErrorKind::Unsupported) where the system or the file system cannot do that.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
pub(crate) fn exchange(one: &Path, other: &Path) -> io::Result<()> {
    rename(one, other, nix::fcntl::RenameFlags::RENAME_EXCHANGE)
}

/// Moves what stands at `from` to `to`, where nothing may stand.
///
/// # Errors
/// Of kind [`AlreadyExists`](io::ErrorKind::AlreadyExists) where something does; of kind
/// [`Unsupported`](io::ErrorKind::Unsupported) where the system or the file system cannot do that in one step.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
pub(crate) fn rename_as_new(from: &Path, to: &Path) -> io::Result<()> {
    rename(from, to, nix::fcntl::RenameFlags::RENAME_NOREPLACE)
}

#[cfg(all(target_os = "linux", target_env = "gnu"))]
fn rename(from: &Path, to: &Path, how: nix::fcntl::RenameFlags) -> io::Result<()> {
    use nix::errno::Errno;
    use nix::fcntl::{AT_FDCWD, renameat2};
    renameat2(AT_FDCWD, from, AT_FDCWD, to, how).map_err(|error| match error {
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

/// Moves what stands at `from` to `to`, where nothing may stand, in one step: this system cannot.
///
/// # Errors
/// Always of kind [`Unsupported`](io::ErrorKind::Unsupported).
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub(crate) fn rename_as_new(_from: &Path, _to: &Path) -> io::Result<()> {
    Err(io::ErrorKind::Unsupported.into())
}
