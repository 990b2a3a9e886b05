//! Writes messages of ROS 2 in CDR: numbers aligned to their size, texts with a final NUL.
//!
//! The counterpart of the cursor by which recordings are read. Source: OMG DDS-XTypes 1.3, 7.4.

/// What announces little-endian CDR.
const HEADER: [u8; 4] = [0, 1, 0, 0];

/// A message that is being written.
#[derive(Debug)]
pub(super) struct CdrWriter {
    bytes: Vec<u8>,
}

impl CdrWriter {
    /// A message with its header and no field yet.
    pub(super) fn new() -> Self {
        Self { bytes: HEADER.to_vec() }
    }

    /// The message's bytes.
    pub(super) fn into_bytes(self) -> Vec<u8> {
        self.bytes
    }

    fn number<const N: usize>(&mut self, bytes: [u8; N]) {
        // Alignment counts from behind the header.
        let fields = self.bytes.len() - HEADER.len();
        self.bytes.resize(HEADER.len() + fields.next_multiple_of(N), 0);
        self.bytes.extend(bytes);
    }

    /// An unsigned number of 8 bits; also a truth value.
    pub(super) fn u8(&mut self, value: u8) {
        self.bytes.push(value);
    }

    /// A number of 32 bits.
    pub(super) fn i32(&mut self, value: i32) {
        self.number(value.to_le_bytes());
    }

    /// An unsigned number of 32 bits.
    pub(super) fn u32(&mut self, value: u32) {
        self.number(value.to_le_bytes());
    }

    /// A number of 32 bits.
    pub(super) fn f32(&mut self, value: f32) {
        self.number(value.to_le_bytes());
    }

    /// A number of 64 bits.
    pub(super) fn f64(&mut self, value: f64) {
        self.number(value.to_le_bytes());
    }

    /// Numbers of 64 bits, as many as the type says.
    pub(super) fn f64s(&mut self, values: &[f64]) {
        values.iter().for_each(|&value| self.f64(value));
    }

    /// How many elements a list has, which follow.
    pub(super) fn count(&mut self, count: usize) {
        self.u32(u32::try_from(count).unwrap_or(u32::MAX));
    }

    /// A list of numbers of 32 bits.
    pub(super) fn f32_list(&mut self, values: &[f32]) {
        self.count(values.len());
        values.iter().for_each(|&value| self.f32(value));
    }

    /// A list of numbers of 64 bits.
    pub(super) fn f64_list(&mut self, values: &[f64]) {
        self.count(values.len());
        self.f64s(values);
    }

    /// A list of bytes.
    pub(super) fn byte_list(&mut self, bytes: &[u8]) {
        self.count(bytes.len());
        self.bytes.extend(bytes);
    }

    /// A text.
    pub(super) fn text(&mut self, text: &str) {
        self.count(text.len() + 1);
        self.bytes.extend(text.as_bytes());
        self.bytes.push(0);
    }
}
