//! Archives of NumPy arrays (`.npz`), written number by number.
//!
//! Source: numpy.lib.format, "NPY format", version 1.0.

use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::Path;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

/// A number type that arrays are made of.
pub(crate) trait Element: Copy {
    /// NumPy's name of the type.
    const DESCRIPTION: &'static str;
    /// Writes the number in little-endian order.
    fn write_to(self, writer: &mut impl Write) -> io::Result<()>;
}

impl Element for f64 {
    const DESCRIPTION: &'static str = "<f8";

    fn write_to(self, writer: &mut impl Write) -> io::Result<()> {
        writer.write_all(&self.to_le_bytes())
    }
}

impl Element for i16 {
    const DESCRIPTION: &'static str = "<i2";

    fn write_to(self, writer: &mut impl Write) -> io::Result<()> {
        writer.write_all(&self.to_le_bytes())
    }
}

/// An archive that arrays are added to.
pub(crate) struct NpzWriter {
    archive: ZipWriter<UntilFailure<BufWriter<File>>>,
}

/// Hands on what is written until that fails once; from then on all is taken and goes nowhere. An archive that is given
/// up writes its directory all the same, and would say on stderr that it cannot.
struct UntilFailure<W> {
    writer: W,
    /// Where in the file the next byte lies, bytes, or would lie if nothing had failed.
    at: u64,
    has_failed: bool,
}

impl<W: Write + Seek> UntilFailure<W> {
    fn new(writer: W) -> Self {
        Self { writer, at: 0, has_failed: false }
    }

    /// Passes a result on, and remembers a failure.
    fn noted<T>(&mut self, result: io::Result<T>) -> io::Result<T> {
        self.has_failed |= result.is_err();
        result
    }
}

impl<W: Write + Seek> Write for UntilFailure<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = if self.has_failed { Ok(bytes.len()) } else { self.writer.write(bytes) };
        self.at += *written.as_ref().unwrap_or(&0) as u64;
        self.noted(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        let flushed = if self.has_failed { Ok(()) } else { self.writer.flush() };
        self.noted(flushed)
    }
}

impl<W: Write + Seek> Seek for UntilFailure<W> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let position = match to {
            _ if !self.has_failed => self.writer.seek(to),
            SeekFrom::Start(position) => Ok(position),
            SeekFrom::Current(offset) | SeekFrom::End(offset) => Ok(self.at.saturating_add_signed(offset)),
        };
        self.at = *position.as_ref().unwrap_or(&self.at);
        self.noted(position)
    }
}

impl NpzWriter {
    /// An empty archive in the file at `path`.
    pub(crate) fn create(path: &Path) -> io::Result<Self> {
        Ok(Self { archive: ZipWriter::new(UntilFailure::new(BufWriter::new(File::create(path)?))) })
    }

    /// Adds an array whose first axis runs fastest: a matrix is given column by column.
    pub(crate) fn array<T: Element>(
        &mut self,
        name: &str,
        shape: &[usize],
        values: impl IntoIterator<Item = T>,
    ) -> io::Result<()> {
        // Archives of long drives pass the 4 GB of the old format.
        let options = SimpleFileOptions::default().compression_method(CompressionMethod::Deflated).large_file(true);
        self.archive.start_file(format!("{name}.npy"), options)?;
        let mut writer = BufWriter::new(&mut self.archive);
        writer.write_all(&header(T::DESCRIPTION, shape))?;
        for value in values {
            value.write_to(&mut writer)?;
        }
        writer.flush()
    }

    /// Writes the archive's directory.
    pub(crate) fn finish(self) -> io::Result<()> {
        self.archive.finish()?.writer.into_inner()?.sync_all()
    }
}

/// The signature, the version and a Python dictionary, padded to a multiple of 64 bytes.
fn header(description: &str, shape: &[usize]) -> Vec<u8> {
    let lengths: String = shape.iter().map(|length| format!("{length},")).collect();
    let order = if shape.len() > 1 { "True" } else { "False" };
    let mut text = format!("{{'descr': '{description}', 'fortran_order': {order}, 'shape': ({lengths}), }}");
    let unpadded = 10 + text.len() + 1;
    text.push_str(&" ".repeat(unpadded.next_multiple_of(64) - unpadded));
    text.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((text.len() as u16).to_le_bytes());
    bytes.extend(text.bytes());
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    /// A disk with room for so many bytes.
    struct Disk<'a>(Cursor<&'a mut [u8]>);

    impl Write for Disk<'_> {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            match self.0.write(bytes)? {
                0 if !bytes.is_empty() => Err(io::ErrorKind::StorageFull.into()),
                written => Ok(written),
            }
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    impl Seek for Disk<'_> {
        fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
            self.0.seek(to)
        }
    }

    #[test]
    fn an_archive_on_a_full_disk_says_so_once() {
        for room in [0, 10, 100, 1000] {
            let mut bytes = vec![0; room];
            let mut archive = ZipWriter::new(UntilFailure::new(Disk(Cursor::new(&mut bytes))));
            let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored).large_file(true);
            let started = archive.start_file("a.npy", options);
            let failure = started.err().map(io::Error::from).or_else(|| archive.write_all(&[7; 2000]).err());
            assert_eq!(failure.map(|failure| failure.kind()), Some(io::ErrorKind::StorageFull), "room for {room}");
            // What it does when it is dropped: a failure would be printed.
            archive.finish().unwrap();
        }
    }
}
