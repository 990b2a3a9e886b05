//! Writes messages in the encoding of Protocol Buffers.
//!
//! Source: <https://protobuf.dev/programming-guides/encoding>.

/// Kinds of fields on the wire.
const VARINT: u32 = 0;
const FIXED_64: u32 = 1;
const LENGTH_DELIMITED: u32 = 2;
const FIXED_32: u32 = 5;

/// A message that is being written. Fields come in any order; those that are left out have the value zero.
#[derive(Debug, Default)]
pub(super) struct ProtobufWriter {
    bytes: Vec<u8>,
}

impl ProtobufWriter {
    /// The bytes of a message whose fields `fill` writes.
    pub(super) fn message(fill: impl FnOnce(&mut Self)) -> Vec<u8> {
        let mut writer = Self::default();
        fill(&mut writer);
        writer.bytes
    }

    fn varint(&mut self, mut value: u64) {
        while value >= 0x80 {
            self.bytes.push(value as u8 | 0x80);
            value >>= 7;
        }
        self.bytes.push(value as u8);
    }

    fn tag(&mut self, field: u32, kind: u32) {
        self.varint(u64::from(field << 3 | kind));
    }

    /// A whole number, a truth value or a name of an enumeration.
    pub(super) fn integer(&mut self, field: u32, value: i64) {
        self.tag(field, VARINT);
        // Negative numbers take ten bytes, in two's complement.
        self.varint(value as u64);
    }

    /// A `fixed32`.
    pub(super) fn fixed32(&mut self, field: u32, value: u32) {
        self.tag(field, FIXED_32);
        self.bytes.extend(value.to_le_bytes());
    }

    /// A `double`.
    pub(super) fn double(&mut self, field: u32, value: f64) {
        self.tag(field, FIXED_64);
        self.bytes.extend(value.to_le_bytes());
    }

    /// `bytes`.
    pub(super) fn bytes(&mut self, field: u32, value: &[u8]) {
        self.tag(field, LENGTH_DELIMITED);
        self.varint(value.len() as u64);
        self.bytes.extend(value);
    }

    /// A `string`.
    pub(super) fn text(&mut self, field: u32, value: &str) {
        self.bytes(field, value.as_bytes());
    }

    /// A message within the message; one of several where the field is repeated.
    pub(super) fn nested(&mut self, field: u32, fill: impl FnOnce(&mut Self)) {
        let nested = Self::message(fill);
        self.bytes(field, &nested);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_examples_of_the_encodings_guide_come_out() {
        assert_eq!(ProtobufWriter::message(|message| message.integer(1, 150)), [0x08, 0x96, 0x01]);
        let text = ProtobufWriter::message(|message| message.text(2, "testing"));
        assert_eq!(text, b"\x12\x07testing");
        let nested = ProtobufWriter::message(|message| message.nested(3, |nested| nested.integer(1, 150)));
        assert_eq!(nested, [0x1a, 0x03, 0x08, 0x96, 0x01]);
        let negative = ProtobufWriter::message(|message| message.integer(1, -2));
        assert_eq!(negative, [0x08, 0xfe, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x01]);
    }
}
