//! One cursor for both serialisations of ROS messages.
//!
//! | | ROS 1 | CDR (ROS 2) |
//! |---|---|---|
//! | beginning | – | four bytes: byte order and kind |
//! | numbers | packed | aligned to their size (XCDR2: to 4 bytes at the most) |
//! | texts | length, bytes | length with a final NUL, bytes, NUL |
//! | `std_msgs/Header` | number, stamp, frame | stamp, frame |
//!
//! Sources: <https://wiki.ros.org/roscpp/Overview/MessagesSerializationAndAdaptingTypes>; OMG DDS-XTypes 1.3, 7.4.

/// Reads the fields of a message in order. Every read is `None` once the message ends too early.
pub(super) struct Cursor<'a> {
    bytes: &'a [u8],
    position: usize,
    /// Largest alignment of a number; 1 in ROS 1.
    alignment: usize,
    is_cdr: bool,
    big_endian: bool,
}

/// What every stamped message begins with.
pub(super) struct Header<'a> {
    /// Seconds.
    pub(super) stamp_s: f64,
    /// The frame in which the message's numbers are.
    pub(super) frame: &'a str,
}

impl<'a> Cursor<'a> {
    /// A message as ROS 1 writes it.
    pub(super) fn ros1(bytes: &'a [u8]) -> Self {
        Self { bytes, position: 0, alignment: 1, is_cdr: false, big_endian: false }
    }

    /// A message in CDR; `None` when its first bytes announce something else.
    pub(super) fn cdr(bytes: &'a [u8]) -> Option<Self> {
        let (&[0, kind, _, _], bytes) = bytes.split_first_chunk()? else { return None };
        let alignment = match kind {
            // CDR and PLAIN_CDR2, big and little endian each.
            0 | 1 => 8,
            6 | 7 => 4,
            _ => return None,
        };
        Some(Self { bytes, position: 0, alignment, is_cdr: true, big_endian: kind % 2 == 0 })
    }

    /// The next `count` elements of `size` bytes each.
    fn take(&mut self, count: usize, size: usize) -> Option<&'a [u8]> {
        if count == 0 {
            return Some(&[]);
        }
        let start = self.position.next_multiple_of(size.min(self.alignment));
        let end = start.checked_add(count.checked_mul(size)?)?;
        let bytes = self.bytes.get(start..end)?;
        self.position = end;
        Some(bytes)
    }

    fn number<const N: usize>(&mut self) -> Option<[u8; N]> {
        let mut bytes: [u8; N] = self.take(1, N)?.try_into().ok()?;
        if self.big_endian {
            bytes.reverse();
        }
        Some(bytes)
    }

    /// An unsigned number of 8 bits.
    pub(super) fn u8(&mut self) -> Option<u8> {
        self.number().map(u8::from_le_bytes)
    }

    /// An unsigned number of 32 bits.
    pub(super) fn u32(&mut self) -> Option<u32> {
        self.number().map(u32::from_le_bytes)
    }

    /// A number of 32 bits.
    pub(super) fn f32(&mut self) -> Option<f32> {
        self.number().map(f32::from_le_bytes)
    }

    /// A number of 64 bits.
    pub(super) fn f64(&mut self) -> Option<f64> {
        self.number().map(f64::from_le_bytes)
    }

    /// As many numbers of 64 bits.
    pub(super) fn f64s<const N: usize>(&mut self) -> Option<[f64; N]> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.f64()?;
        }
        Some(values)
    }

    /// A list of numbers of 32 bits.
    pub(super) fn f32_list(&mut self) -> Option<Vec<f32>> {
        let count = self.u32()? as usize;
        let bytes = self.take(count, 4)?;
        let big_endian = self.big_endian;
        let number = |&bytes: &[u8; 4]| if big_endian { f32::from_be_bytes(bytes) } else { f32::from_le_bytes(bytes) };
        Some(bytes.as_chunks().0.iter().map(number).collect())
    }

    /// A list of bytes.
    pub(super) fn byte_list(&mut self) -> Option<&'a [u8]> {
        let count = self.u32()? as usize;
        self.take(count, 1)
    }

    /// A text.
    pub(super) fn text(&mut self) -> Option<&'a str> {
        let bytes = self.byte_list()?;
        let bytes = if self.is_cdr { bytes.strip_suffix(b"\0").unwrap_or(bytes) } else { bytes };
        std::str::from_utf8(bytes).ok()
    }

    /// A list of things, each read by `read`.
    pub(super) fn list<T>(&mut self, mut read: impl FnMut(&mut Self) -> Option<T>) -> Option<Vec<T>> {
        let count = self.u32()?;
        // Memory follows what is there, not what is announced.
        let mut things = Vec::new();
        for _ in 0..count {
            things.push(read(self)?);
        }
        Some(things)
    }

    /// A time, seconds.
    pub(super) fn time_s(&mut self) -> Option<f64> {
        let (seconds, nanoseconds) = (self.u32()?, self.u32()?);
        // ROS 2 has a sign.
        let seconds = if self.is_cdr { f64::from(seconds.cast_signed()) } else { f64::from(seconds) };
        Some(seconds + f64::from(nanoseconds) * 1e-9)
    }

    /// A `std_msgs/Header`.
    pub(super) fn header(&mut self) -> Option<Header<'a>> {
        if !self.is_cdr {
            self.u32()?;
        }
        Some(Header { stamp_s: self.time_s()?, frame: frame_name(self.text()?) })
    }
}

/// A frame's name without the slash that old recordings put before it.
pub(super) fn frame_name(name: &str) -> &str {
    name.strip_prefix('/').unwrap_or(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_packed_in_ros_1_and_aligned_in_cdr() {
        let mut packed = vec![7];
        packed.extend(1.5_f64.to_le_bytes());
        packed.extend([2, 0, 0, 0, b'o', b'k']);
        let mut cursor = Cursor::ros1(&packed);
        assert_eq!((cursor.u8(), cursor.f64(), cursor.text()), (Some(7), Some(1.5), Some("ok")));
        for (kind, padding) in [(0_u8, 7), (1, 7), (6, 3), (7, 3)] {
            let mut aligned = vec![0, kind, 0, 0, 7];
            aligned.resize(5 + padding, 0);
            let big = kind % 2 == 0;
            aligned.extend(if big { 1.5_f64.to_be_bytes() } else { 1.5_f64.to_le_bytes() });
            aligned.extend(if big { 3_u32.to_be_bytes() } else { 3_u32.to_le_bytes() });
            aligned.extend(b"ok\0");
            let mut cursor = Cursor::cdr(&aligned).unwrap();
            assert_eq!((cursor.u8(), cursor.f64(), cursor.text()), (Some(7), Some(1.5), Some("ok")), "kind {kind}");
        }
        assert!(Cursor::cdr(&[0x28, 0xb5, 0x2f, 0xfd]).is_none());
    }

    #[test]
    fn announced_lengths_cost_no_memory() {
        let many = u32::MAX.to_le_bytes();
        assert!(Cursor::ros1(&many).f32_list().is_none());
        assert!(Cursor::ros1(&many).list(|cursor| cursor.u8()).is_none());
    }
}
