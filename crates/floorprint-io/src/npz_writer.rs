//! Archives of NumPy arrays (`.npz`), written number by number.
//!
//! Source: numpy.lib.format, "NPY format", version 1.0.

use std::fs::File;
use std::io::{self, BufWriter, Write};
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
    archive: ZipWriter<BufWriter<File>>,
}

impl NpzWriter {
    /// An empty archive in the file at `path`.
    pub(crate) fn create(path: &Path) -> io::Result<Self> {
        Ok(Self { archive: ZipWriter::new(BufWriter::new(File::create(path)?)) })
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
        self.archive.finish()?.into_inner()?.sync_all()
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
