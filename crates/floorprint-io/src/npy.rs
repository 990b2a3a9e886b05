//! NumPy arrays (`.npy`, format versions 1 to 3) of numbers of any type, byte order and memory order.
//!
//! Source: numpy.lib.format, "NPY format".

use crate::budget::Budget;
use std::io::{self, Read};

/// Longest header that is accepted, bytes; NumPy's own stay below a kilobyte.
const LONGEST_HEADER: usize = 1 << 16;

/// Bytes decoded at a time.
const CHUNK: usize = 1 << 15;

/// An array's numbers, as they follow each other in the file.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Array<T> {
    /// Length of each axis; none for a single number.
    pub(crate) shape: Vec<usize>,
    /// Whether the first axis runs fastest.
    fortran_order: bool,
    values: Vec<T>,
}

/// A number type that arrays are decoded into.
pub(crate) trait Number: Copy {
    /// The nearest number of this type.
    fn from_f64(value: f64) -> Self;
}

impl Number for f32 {
    fn from_f64(value: f64) -> Self {
        value as f32
    }
}

impl Number for f64 {
    fn from_f64(value: f64) -> Self {
        value
    }
}

/// Why bytes are not an array of numbers.
#[derive(Debug)]
pub(crate) enum NpyError {
    /// Its numbers take more memory than they may.
    TooLarge,
    /// It is not what it should be.
    Other {
        /// What was found.
        found: String,
        /// What was expected instead.
        expected: &'static str,
    },
}

impl NpyError {
    fn new(found: impl Into<String>, expected: &'static str) -> Self {
        Self::Other { found: found.into(), expected }
    }
}

impl<T: Number> Array<T> {
    /// Decodes an array. Memory grows with the bytes that really come, not with what the header says; it is
    /// taken from `budget`. Numbers that are missing at the end are not numbers if it `may_break_off`.
    pub(crate) fn read(mut reader: impl Read, budget: &mut Budget, may_break_off: bool) -> Result<Self, NpyError> {
        let header = Header::read(&mut reader)?;
        let count = header
            .shape
            .iter()
            .try_fold(1_usize, |count, &length| count.checked_mul(length))
            .and_then(|count| count.checked_mul(header.element.size).map(|_| count))
            .ok_or_else(|| NpyError::new(format!("a shape of {:?}", header.shape), "an array that fits into memory"))?;
        let mut values = Vec::new();
        let mut chunk = [0_u8; CHUNK];
        let per_chunk = CHUNK / header.element.size;
        while values.len() < count {
            let numbers = per_chunk.min(count - values.len());
            budget.take::<T>(numbers).ok_or(NpyError::TooLarge)?;
            let bytes = &mut chunk[..numbers * header.element.size];
            if may_break_off {
                let came = read_as_far_as_it_goes(&mut reader, bytes);
                header.element.decode(&mut bytes[..came - came % header.element.size], &mut values);
                if came < bytes.len() {
                    budget.take::<T>(count - values.len()).ok_or(NpyError::TooLarge)?;
                    values.resize(count, T::from_f64(f64::NAN));
                }
                continue;
            }
            reader.read_exact(bytes).map_err(|error| {
                let found = match error.kind() {
                    io::ErrorKind::UnexpectedEof => {
                        format!("the data end within the first {} numbers", values.len() + per_chunk)
                    }
                    _ => error.to_string(),
                };
                NpyError::new(found, "as many numbers as the array's shape says")
            })?;
            header.element.decode(bytes, &mut values);
        }
        if may_break_off {
            return Ok(Self { shape: header.shape, fortran_order: header.fortran_order, values });
        }
        // Reading to the end also lets an archive check its sum.
        match reader.read(&mut chunk[..1]) {
            Ok(0) => {}
            Ok(_) => return Err(NpyError::new("more data than that", "as many numbers as the array's shape says")),
            Err(error) => return Err(NpyError::new(error.to_string(), "undamaged data")),
        }
        Ok(Self { shape: header.shape, fortran_order: header.fortran_order, values })
    }

    /// The only number of an array with a single one, whatever its shape.
    pub(crate) fn scalar(&self) -> Option<T> {
        match self.values[..] {
            [value] => Some(value),
            _ => None,
        }
    }

    /// The numbers of an array with at most one axis that is longer than one.
    pub(crate) fn into_vector(self) -> Option<Vec<T>> {
        (self.shape.iter().filter(|&&length| length != 1).count() <= 1).then_some(self.values)
    }

    /// The columns of a matrix: for each index of the second axis the numbers along the first.
    pub(crate) fn into_columns(self) -> Option<Vec<Vec<T>>> {
        /// Rows copied together, so that each column is written a cache line at a time.
        const BLOCK: usize = 16;
        let &[rows, columns] = &self.shape[..] else { return None };
        if rows == 0 {
            return (columns == 0).then(Vec::new);
        }
        if self.fortran_order {
            return Some(self.values.chunks_exact(rows).map(<[T]>::to_vec).collect());
        }
        let mut result: Vec<Vec<T>> = Vec::with_capacity(columns);
        result.resize_with(columns, || Vec::with_capacity(rows));
        if columns > 0 {
            for block in self.values.chunks(BLOCK * columns) {
                for (index, column) in result.iter_mut().enumerate() {
                    column.extend(block[index..].iter().step_by(columns));
                }
            }
        }
        Some(result)
    }
}

/// Fills `bytes` from a reader that may end or fail before that; says how many came.
fn read_as_far_as_it_goes(reader: &mut impl Read, bytes: &mut [u8]) -> usize {
    let mut came = 0;
    while let Ok(more @ 1..) = reader.read(&mut bytes[came..]) {
        came += more;
    }
    came
}

/// What precedes an array's numbers.
struct Header {
    element: Element,
    fortran_order: bool,
    shape: Vec<usize>,
}

impl Header {
    fn read(reader: &mut impl Read) -> Result<Self, NpyError> {
        const EXPECTED: &str = "a NumPy array (.npy)";
        let truncated = |error: io::Error| NpyError::new(format!("a header that breaks off ({error})"), EXPECTED);
        let mut start = [0_u8; 8];
        reader.read_exact(&mut start).map_err(truncated)?;
        let [magic @ .., major, _minor] = start;
        if magic != *b"\x93NUMPY" {
            return Err(NpyError::new("no NumPy signature at its beginning", EXPECTED));
        }
        let mut length = [0_u8; 4];
        let length_bytes = if major == 1 { 2 } else { 4 };
        reader.read_exact(&mut length[..length_bytes]).map_err(truncated)?;
        let length = u32::from_le_bytes(length) as usize;
        if length > LONGEST_HEADER {
            return Err(NpyError::new(format!("a header of {length} bytes"), EXPECTED));
        }
        let mut text = vec![0; length];
        reader.read_exact(&mut text).map_err(truncated)?;
        let text = String::from_utf8_lossy(&text);
        Self::parse(&text).ok_or_else(|| {
            NpyError::new(format!("the header {}", text.trim()), "an array of integers or floating-point numbers")
        })
    }

    /// Parses the Python dictionary `{'descr': '<f8', 'fortran_order': False, 'shape': (3, 4), }`.
    fn parse(text: &str) -> Option<Self> {
        let value_of = |key: &str| Some(text.split_once(&format!("'{key}':"))?.1.trim_start());
        let fortran_order = match value_of("fortran_order")? {
            value if value.starts_with("True") => true,
            value if value.starts_with("False") => false,
            _ => return None,
        };
        let shape = value_of("shape")?.strip_prefix('(')?.split_once(')')?.0;
        let shape = shape
            .split(',')
            .map(str::trim)
            .filter(|length| !length.is_empty())
            .map(|length| length.trim_end_matches('L').parse().ok())
            .collect::<Option<Vec<usize>>>()?;
        let code = value_of("descr")?.strip_prefix('\'')?.split_once('\'')?.0;
        Some(Self { element: Element::parse(code)?, fortran_order, shape })
    }
}

/// How one number is stored.
#[derive(Clone, Copy)]
struct Element {
    kind: Kind,
    size: usize,
    big_endian: bool,
}

#[derive(Clone, Copy)]
enum Kind {
    Signed,
    Unsigned,
    Float,
}

impl Element {
    /// Parses a type code such as `<f8`, `>i2` or `|u1`.
    fn parse(code: &str) -> Option<Self> {
        let (order, rest) = code.split_at_checked(1)?;
        let (kind, size) = rest.split_at_checked(1)?;
        let big_endian = match order {
            ">" => true,
            "<" | "|" | "=" => false,
            _ => return None,
        };
        let size: usize = size.parse().ok()?;
        let kind = match (kind, size) {
            ("i", 1 | 2 | 4 | 8) => Kind::Signed,
            ("u", 1 | 2 | 4 | 8) | ("b", 1) => Kind::Unsigned,
            ("f", 2 | 4 | 8) => Kind::Float,
            _ => return None,
        };
        Some(Self { kind, size, big_endian })
    }

    /// Appends the numbers in `bytes`, whose length is a multiple of this element's size.
    fn decode<T: Number>(self, bytes: &mut [u8], values: &mut Vec<T>) {
        if self.big_endian {
            bytes.chunks_exact_mut(self.size).for_each(<[u8]>::reverse);
        }
        let bytes = &*bytes;
        match (self.kind, self.size) {
            (Kind::Float, 8) => extend(values, bytes, f64::from_le_bytes),
            (Kind::Float, 4) => extend(values, bytes, |b| f64::from(f32::from_le_bytes(b))),
            (Kind::Float, _) => extend(values, bytes, |b| half_precision(u16::from_le_bytes(b))),
            (Kind::Signed, 1) => extend(values, bytes, |b| f64::from(i8::from_le_bytes(b))),
            (Kind::Signed, 2) => extend(values, bytes, |b| f64::from(i16::from_le_bytes(b))),
            (Kind::Signed, 4) => extend(values, bytes, |b| f64::from(i32::from_le_bytes(b))),
            (Kind::Signed, _) => extend(values, bytes, |b| i64::from_le_bytes(b) as f64),
            (Kind::Unsigned, 1) => extend(values, bytes, |b| f64::from(u8::from_le_bytes(b))),
            (Kind::Unsigned, 2) => extend(values, bytes, |b| f64::from(u16::from_le_bytes(b))),
            (Kind::Unsigned, 4) => extend(values, bytes, |b| f64::from(u32::from_le_bytes(b))),
            (Kind::Unsigned, _) => extend(values, bytes, |b| u64::from_le_bytes(b) as f64),
        }
    }
}

/// Appends numbers of `N` bytes each.
fn extend<T: Number, const N: usize>(values: &mut Vec<T>, bytes: &[u8], number: impl Fn([u8; N]) -> f64) {
    values.extend(bytes.as_chunks::<N>().0.iter().map(|&chunk| T::from_f64(number(chunk))));
}

/// A number in IEEE 754 half precision.
fn half_precision(bits: u16) -> f64 {
    let sign = if bits & 0x8000 == 0 { 1.0 } else { -1.0 };
    let exponent = i32::from(bits >> 10 & 0x1f);
    let fraction = f64::from(bits & 0x3ff) / 1024.0;
    sign * match exponent {
        0 => fraction * 2.0_f64.powi(-14),
        31 if fraction == 0.0 => f64::INFINITY,
        31 => f64::NAN,
        _ => (1.0 + fraction) * 2.0_f64.powi(exponent - 15),
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::budget::USUAL_EXPANSION;
    use proptest::prelude::*;

    /// The bytes of a `.npy` file.
    pub(crate) fn npy(code: &str, fortran_order: bool, shape: &str, data: &[u8]) -> Vec<u8> {
        let order = if fortran_order { "True" } else { "False" };
        let header = format!("{{'descr': '{code}', 'fortran_order': {order}, 'shape': {shape}, }}\n");
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.as_bytes());
        bytes.extend(data);
        bytes
    }

    fn read<T: Number>(bytes: &[u8]) -> Result<Array<T>, NpyError> {
        Array::read(bytes, &mut Budget::new(bytes.len(), USUAL_EXPANSION), false)
    }

    fn values(code: &str, data: &[u8]) -> Vec<f64> {
        let count = data.len() / code[2..].parse::<usize>().unwrap();
        read::<f64>(&npy(code, false, &format!("({count},)"), data)).unwrap().into_vector().unwrap()
    }

    #[test]
    fn every_number_type_is_understood() {
        assert_eq!(values("|i1", &[255, 1]), [-1.0, 1.0]);
        assert_eq!(values("|u1", &[255]), [255.0]);
        assert_eq!(values("|b1", &[1, 0]), [1.0, 0.0]);
        assert_eq!(values("<i2", &(-300_i16).to_le_bytes()), [-300.0]);
        assert_eq!(values(">i2", &(-300_i16).to_be_bytes()), [-300.0]);
        assert_eq!(values(">u4", &4_000_000_000_u32.to_be_bytes()), [4e9]);
        assert_eq!(values("<i8", &(-5_i64).to_le_bytes()), [-5.0]);
        assert_eq!(values("<u8", &5_u64.to_le_bytes()), [5.0]);
        assert_eq!(values("<u2", &5_u16.to_le_bytes()), [5.0]);
        assert_eq!(values("<i4", &(-7_i32).to_le_bytes()), [-7.0]);
        assert_eq!(values(">f4", &1.5_f32.to_be_bytes()), [1.5]);
        assert_eq!(values(">f8", &1.5_f64.to_be_bytes()), [1.5]);
        // 1.5, -2^-24 (the smallest half) and infinity.
        assert_eq!(values("<f2", &[0x00, 0x3e, 0x01, 0x80, 0x00, 0x7c]), [1.5, -(2.0_f64.powi(-24)), f64::INFINITY]);
        assert!(values("<f2", &[0x01, 0x7c])[0].is_nan());
    }

    #[test]
    fn single_numbers_may_have_any_shape() {
        for shape in ["()", "(1,)", "(1, 1)"] {
            let array = read::<f64>(&npy("<f8", false, shape, &2.5_f64.to_le_bytes())).unwrap();
            assert_eq!(array.scalar(), Some(2.5), "{shape}");
        }
    }

    #[test]
    fn columns_do_not_depend_on_memory_order() {
        let (rows, columns) = (37_u8, 5_u8);
        let by_rows: Vec<u8> = (0..rows).flat_map(|r| (0..columns).map(move |c| r * columns + c)).collect();
        let by_columns: Vec<u8> = (0..columns).flat_map(|c| (0..rows).map(move |r| r * columns + c)).collect();
        let columns_of =
            |fortran, data: &[u8]| read::<f32>(&npy("|u1", fortran, "(37, 5)", data)).unwrap().into_columns().unwrap();
        let result = columns_of(false, &by_rows);
        assert_eq!(result, columns_of(true, &by_columns));
        assert_eq!((result.len(), result[3].len(), result[3][2]), (5, 37, 13.0));
    }

    #[test]
    fn a_shape_that_lies_costs_no_memory() {
        for shape in ["(1000000000000,)", "(99999999999, 99999999999)", "(1152921504606846976, 2)"] {
            assert!(read::<f64>(&npy("<f8", false, shape, &[0; 64])).is_err());
        }
    }

    #[test]
    fn what_is_no_array_of_numbers_is_refused() {
        for code in ["|O", "<U3", "<c16", "<f16", "", "x", "<f", "é8"] {
            assert!(read::<f64>(&npy(code, false, "(1,)", &[0; 16])).is_err(), "{code}");
        }
        assert!(read::<f64>(b"PK").is_err());
    }

    #[test]
    fn an_array_that_breaks_off_is_filled_up() {
        let bytes = npy("<i2", true, "(2, 3)", &[1, 0, 2, 0, 3, 0, 4]);
        let budget = &mut Budget::new(bytes.len(), USUAL_EXPANSION);
        let columns = Array::<f32>::read(&bytes[..], budget, true).unwrap().into_columns().unwrap();
        assert_eq!((columns[0][..].to_vec(), columns[1][0]), (vec![1.0, 2.0], 3.0));
        assert!(columns[1][1].is_nan() && columns[2].iter().all(|value| value.is_nan()));
        let huge = npy("<i2", false, "(1152921504606846976,)", &[1; 64]);
        assert!(matches!(Array::<f32>::read(&huge[..], budget, true), Err(NpyError::TooLarge)));
    }

    proptest! {
        #[test]
        fn damaged_arrays_are_errors(
            cut in 0..200_usize, position in 0..200_usize, byte in any::<u8>(), columns in any::<bool>()
        ) {
            let mut bytes = npy("<i2", false, "(3, 20)", &[7; 120]);
            let position = position % bytes.len();
            bytes[position] = byte;
            bytes.truncate(bytes.len().saturating_sub(cut % 3 * cut));
            if let Ok(array) = read::<f32>(&bytes) {
                let _ = array.scalar();
                let _ = if columns { array.into_columns().is_some() } else { array.into_vector().is_some() };
            }
        }
    }
}
