//! How much memory the data of a file may take: archives can be made that unpack to a thousandfold.

use crate::error::Problem;
use std::path::Path;

/// How many times its size on disk a file may take in memory, unless the user says otherwise.
///
/// Logs of numbers are packed to a tenth, those of a robot that stands still to a fiftieth.
pub const USUAL_EXPANSION: f64 = 64.0;

/// What any file may take besides, bytes.
const FREE_BYTES: f64 = 256e6;

/// Memory that the data of one file may still take.
#[derive(Debug, Clone)]
pub(crate) struct Budget {
    most_bytes: f64,
    taken_bytes: f64,
    file_bytes: f64,
}

impl Budget {
    /// For a file of `file_bytes` on disk.
    pub(crate) fn new(file_bytes: usize, max_expansion: f64) -> Self {
        let file_bytes = file_bytes as f64;
        Self { most_bytes: FREE_BYTES + max_expansion * file_bytes, taken_bytes: 0.0, file_bytes }
    }

    /// Of so many bytes.
    #[cfg(test)]
    pub(crate) fn of(most_bytes: usize) -> Self {
        Self { most_bytes: most_bytes as f64, taken_bytes: 0.0, file_bytes: 3000.0 }
    }

    /// Takes memory for so many values; `None` when that is too much.
    pub(crate) fn take<T>(&mut self, values: usize) -> Option<()> {
        self.taken_bytes += values as f64 * size_of::<T>() as f64;
        (self.taken_bytes <= self.most_bytes).then_some(())
    }

    /// Why a file that takes more is refused.
    pub(crate) fn exceeded(&self, path: &Path) -> Problem {
        let megabytes = |bytes: f64| bytes / 1e6;
        Problem::new(
            path,
            format!(
                "{:.1} MB that unpack to more than {:.0} MB",
                megabytes(self.file_bytes),
                megabytes(self.most_bytes)
            ),
        )
        .expected("data that hardly grow")
        .advice(format!(
            "If you trust the file, allow more with --max-expansion {:.0}",
            2.0 * (self.most_bytes / self.file_bytes.max(1.0)).ceil()
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_may_be_taken_grows_with_the_file() {
        let mut small = Budget::new(1000, USUAL_EXPANSION);
        assert_eq!(small.take::<f64>(32_000_000), Some(()));
        assert_eq!(small.take::<f64>(9_000), None);
        assert!(small.exceeded(Path::new("a.gz")).to_string().contains("--max-expansion"));
        assert_eq!(Budget::new(100_000_000, USUAL_EXPANSION).take::<f64>(800_000_000), Some(()));
    }
}
