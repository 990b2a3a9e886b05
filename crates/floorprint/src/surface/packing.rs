//! Numbers and marks as bytes, to the bit.

/// Appends marks, a bit each.
pub(crate) fn push_marks(bytes: &mut Vec<u8>, marks: &[bool]) {
    bytes.extend(marks.chunks(8).map(|eight| eight.iter().rev().fold(0, |byte, &mark| byte << 1 | u8::from(mark))));
}

/// Takes so many marks from the front of bytes; `None` if there are not so many.
pub(crate) fn take_marks<'a>(bytes: &mut &'a [u8], count: usize) -> Option<impl Iterator<Item = bool> + use<'a>> {
    let (marks, rest) = bytes.split_at_checked(count.div_ceil(8))?;
    *bytes = rest;
    Some((0..count).map(|mark| marks[mark / 8] >> (mark % 8) & 1 == 1))
}

/// Takes so many bytes from the front; `None` if there are not so many.
pub(crate) fn take_array<const N: usize>(bytes: &mut &[u8]) -> Option<[u8; N]> {
    let (taken, rest) = bytes.split_first_chunk()?;
    *bytes = rest;
    Some(*taken)
}

/// A number such that numbers next to each other differ by one: −0 and 0 are next to each other, too.
fn order(number: f32) -> i32 {
    let bits = number.to_bits() as i32;
    if bits < 0 { !(bits & i32::MAX) } else { bits }
}

fn disorder(order: i32) -> f32 {
    f32::from_bits(if order < 0 { !order | i32::MIN } else { order } as u32)
}

/// Appends rows of four numbers: how each differs from the one before it in its column, in units in the last place, in as
/// many bytes as that takes.
pub(crate) fn push_rows(bytes: &mut Vec<u8>, rows: impl Iterator<Item = [f32; 4]>) {
    let mut before = [0_i32; 4];
    for row in rows {
        let lengths_at = bytes.len();
        bytes.push(0);
        for (axis, (number, before)) in row.into_iter().zip(&mut before).enumerate() {
            let here = order(number);
            let difference = here.wrapping_sub(*before);
            let zigzag = (difference << 1 ^ difference >> 31) as u32;
            *before = here;
            let length = (4 - zigzag.leading_zeros() as usize / 8).max(1);
            bytes[lengths_at] |= (length as u8 - 1) << (2 * axis);
            bytes.extend_from_slice(&zigzag.to_le_bytes()[..length]);
        }
    }
}

/// Takes so many rows from the front of bytes, as columns; `None` if these are none.
pub(crate) fn take_columns(bytes: &mut &[u8], rows: usize) -> Option<[Vec<f32>; 4]> {
    // Each row takes five bytes at least: no count claims more memory than the bytes are worth.
    if rows > bytes.len() / 5 {
        return None;
    }
    let mut columns: [Vec<f32>; 4] = std::array::from_fn(|_| Vec::with_capacity(rows));
    let mut before = [0_i32; 4];
    for _ in 0..rows {
        let [lengths] = take_array(bytes)?;
        for (axis, before) in before.iter_mut().enumerate() {
            let length = usize::from(lengths >> (2 * axis) & 3) + 1;
            let (taken, rest) = bytes.split_at_checked(length)?;
            *bytes = rest;
            let mut four = [0; 4];
            four[..length].copy_from_slice(taken);
            let zigzag = u32::from_le_bytes(four);
            *before = before.wrapping_add((zigzag >> 1) as i32 ^ -((zigzag & 1) as i32));
            columns[axis].push(disorder(*before));
        }
    }
    Some(columns)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn any_numbers_come_back_to_the_bit(rows in prop::collection::vec(any::<[u32; 4]>(), 0..40)) {
            let columns: [Vec<f32>; 4] =
                std::array::from_fn(|axis| rows.iter().map(|row| f32::from_bits(row[axis])).collect());
            let mut bytes = Vec::new();
            push_rows(&mut bytes, rows.iter().map(|row| row.map(f32::from_bits)));
            bytes.push(7);
            let mut rest = &bytes[..];
            let back = take_columns(&mut rest, rows.len()).unwrap();
            let bits = |columns: &[Vec<f32>; 4]| columns.each_ref().map(|column| column.iter().map(|x| x.to_bits()).collect::<Vec<_>>());
            prop_assert_eq!(bits(&back), bits(&columns));
            prop_assert_eq!(rest, &[7][..]);
        }

        #[test]
        fn marks_come_back(marks in prop::collection::vec(any::<bool>(), 0..40)) {
            let mut bytes = Vec::new();
            push_marks(&mut bytes, &marks);
            prop_assert_eq!(bytes.len(), marks.len().div_ceil(8));
            prop_assert_eq!(take_marks(&mut &bytes[..], marks.len()).unwrap().collect::<Vec<_>>(), marks);
        }

        #[test]
        fn any_bytes_are_survived(bytes in prop::collection::vec(any::<u8>(), 0..60), rows in 0_usize..20) {
            let _ = take_columns(&mut &bytes[..], rows);
            let _ = take_marks(&mut &bytes[..], rows).map(Iterator::count);
        }
    }
}
