//! Decimal numbers from bytes, fast for the short ones that sensor logs are made of.

use crate::stamps::is_stamp;
use std::fmt::Write;

/// Powers of ten that a double holds exactly.
const POWERS_OF_TEN: [f64; 16] = [1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15];

/// Most digits whose integer surely fits the 53 bits of a double's mantissa.
const EXACT_DIGITS: usize = 15;

/// The number that the whole of `token` spells, correctly rounded.
///
/// Up to fifteen digits the digits' integer and the power of ten are both exact in a
/// double, so that one division rounds correctly; everything else (exponents, more
/// digits, `nan`, `inf`) goes the standard library's slower way.
pub(crate) fn parse_f64(token: &[u8]) -> Option<f64> {
    let (negative, digits) = match token {
        [b'-', rest @ ..] => (true, rest),
        rest => (false, rest),
    };
    let mut mantissa = 0_u64;
    let mut count = 0;
    let mut point = None;
    for (position, &byte) in digits.iter().enumerate() {
        let digit = byte.wrapping_sub(b'0');
        if digit < 10 && count < EXACT_DIGITS {
            mantissa = mantissa * 10 + u64::from(digit);
            count += 1;
        } else if byte == b'.' && point.is_none() {
            point = Some(position + 1);
        } else {
            return std::str::from_utf8(token).ok()?.parse().ok();
        }
    }
    if count == 0 {
        return None;
    }
    let decimals = point.map_or(0, |first| digits.len() - first);
    let value = mantissa as f64 / POWERS_OF_TEN[decimals];
    Some(if negative { -value } else { value })
}

/// Appends `value` with `decimals` digits behind the point, as `{:.decimals$}` does but for values half-way
/// between two last digits, and many times as fast.
pub(crate) fn push_fixed(text: &mut String, value: f64, decimals: usize) {
    let scaled = POWERS_OF_TEN.get(decimals).map_or(f64::INFINITY, |power| (value * power).round());
    // Up to here every whole number is a double.
    if scaled.is_nan() || scaled.abs() >= 9e15 {
        // Writing to a string cannot fail.
        let _ = write!(text, "{value:.decimals$}");
        return;
    }
    if scaled.is_sign_negative() {
        text.push('-');
    }
    let mut rest = scaled.abs() as u64;
    let mut digits = [b'0'; 32];
    let mut first = digits.len();
    while rest > 0 || digits.len() - first <= decimals {
        first -= 1;
        digits[first] = b'0' + (rest % 10) as u8;
        rest /= 10;
    }
    let (whole, fraction) = digits[first..].split_at(digits.len() - first - decimals);
    text.extend(whole.iter().map(|&digit| char::from(digit)));
    if decimals > 0 {
        text.push('.');
        text.extend(fraction.iter().map(|&digit| char::from(digit)));
    }
}

/// The number of up to seven digits and points that `bytes` begin with, where a separator follows it, and its length;
/// what is not that plain is left to others.
///
/// The eight bytes are worked on at once, as those of one 64-bit number (Lemire 2021, "Number parsing at a gigabyte per
/// second", has the digits' part).
#[inline]
fn short_number(bytes: &[u8]) -> Option<(f64, usize)> {
    const EACH: u64 = 0x0101_0101_0101_0101;
    const HIGH: u64 = 0x80 * EACH;
    let word = u64::from_le_bytes(*bytes.first_chunk::<8>()?);
    // The lowest byte below the point ends the number: separators are, digits are not.
    let ends = word.wrapping_sub(u64::from(b'.') * EACH) & !word & HIGH;
    let length = ends.trailing_zeros() as usize / 8;
    if length == 0 || ends == 0 || !bytes.get(length).is_some_and(|&byte| is_separator(byte)) {
        return None;
    }
    let number = word & ((1 << (8 * length)) - 1);
    let not_points = number ^ (u64::from(b'.') * EACH);
    let points = not_points.wrapping_sub(EACH) & !not_points & HIGH;
    let (digits, count, decimals) = if points == 0 {
        (number, length, 0)
    } else {
        let point = points.trailing_zeros() as usize / 8;
        let before = number & ((1 << (8 * point)) - 1);
        // Two shifts: by all eight bytes at once there is none.
        let behind = (number >> (8 * point) >> 8) << (8 * point);
        (before | behind, length - 1, length - 1 - point)
    };
    // The first digit is the lowest byte: zeros are put before it.
    let missing = 8 * (8 - count) as u32;
    let digits = digits.checked_shl(missing)? | (u64::from(b'0') * EACH).checked_shr(64 - missing).unwrap_or(0);
    let values = digits.wrapping_sub(u64::from(b'0') * EACH);
    if (values | digits.wrapping_add((0x7f - u64::from(b'9')) * EACH)) & HIGH != 0 {
        return None;
    }
    let pairs = values.wrapping_mul(10).wrapping_add(values >> 8);
    let low = (pairs & 0x0000_00ff_0000_00ff).wrapping_mul(0x000f_4240_0000_0064);
    let high = (pairs >> 16 & 0x0000_00ff_0000_00ff).wrapping_mul(0x0000_2710_0000_0001);
    let mantissa = low.wrapping_add(high) >> 32;
    Some((mantissa as f64 / POWERS_OF_TEN[decimals], length))
}

/// The count that the whole of `token` spells.
pub(crate) fn parse_count(token: &[u8]) -> Option<usize> {
    std::str::from_utf8(token).ok()?.parse().ok()
}

fn is_separator(byte: u8) -> bool {
    matches!(byte, b' ' | b'\t' | b',' | b'\r')
}

/// The tokens of a line, separated by spaces, tabs or commas.
#[derive(Clone)]
pub(crate) struct Tokens<'a> {
    rest: &'a [u8],
}

impl<'a> Tokens<'a> {
    /// The tokens of `line`.
    pub(crate) fn new(line: &'a [u8]) -> Self {
        Self { rest: line }
    }

    /// The next token as a number: what [`parse_f64`] makes of it, in one go where it is plain.
    pub(crate) fn number(&mut self) -> Option<f64> {
        let start = self.rest.iter().position(|byte| !is_separator(*byte))?;
        let rest = &self.rest[start..];
        if let Some((value, length)) = short_number(rest) {
            self.rest = &rest[length..];
            return Some(value);
        }
        let (mut mantissa, mut digits, mut decimals, mut length) = (0_u64, 0, 0, 0);
        let mut behind_point = 0;
        for &byte in rest {
            let digit = byte.wrapping_sub(b'0');
            if digit < 10 {
                mantissa = mantissa.wrapping_mul(10).wrapping_add(u64::from(digit));
                digits += 1;
                decimals += behind_point;
            } else if byte == b'.' && behind_point == 0 {
                behind_point = 1;
            } else {
                break;
            }
            length += 1;
        }
        let is_plain = (1..=EXACT_DIGITS).contains(&digits) && rest.get(length).is_none_or(|&byte| is_separator(byte));
        if !is_plain {
            return parse_f64(self.next()?);
        }
        self.rest = &rest[length..];
        Some(mantissa as f64 / POWERS_OF_TEN[decimals])
    }

    /// The next token as a finite number.
    pub(crate) fn finite(&mut self) -> Option<f64> {
        self.number().filter(|value| value.is_finite())
    }

    /// The next token as a stamp, seconds.
    pub(crate) fn stamp(&mut self) -> Option<f64> {
        self.number().filter(|&number| is_stamp(number))
    }

    /// The next token as a count.
    pub(crate) fn count(&mut self) -> Option<usize> {
        parse_count(self.next()?)
    }

    /// The next three tokens as finite numbers.
    pub(crate) fn triple(&mut self) -> Option<[f64; 3]> {
        Some([self.finite()?, self.finite()?, self.finite()?])
    }
}

impl<'a> Iterator for Tokens<'a> {
    type Item = &'a [u8];

    fn next(&mut self) -> Option<&'a [u8]> {
        let start = self.rest.iter().position(|byte| !is_separator(*byte))?;
        let rest = &self.rest[start..];
        let end = rest.iter().position(|byte| is_separator(*byte)).unwrap_or(rest.len());
        let (token, rest) = rest.split_at(end);
        self.rest = rest;
        Some(token)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn what_is_no_number_is_refused() {
        for token in ["", "-", ".", "-.", "1.2.3", "1x", "0x10", "--1", "1-"] {
            assert_eq!(parse_f64(token.as_bytes()), None, "{token}");
        }
    }

    #[test]
    fn tokens_are_split_at_blanks_and_commas() {
        let tokens: Vec<_> = Tokens::new(b"  a\tb, c\r").collect();
        assert_eq!(tokens, [b"a", b"b", b"c"]);
    }

    proptest! {
        #[test]
        fn numbers_are_the_standard_librarys(text in r"-?[0-9]{0,20}\.?[0-9]{0,20}(e-?[0-9]{1,2})?") {
            prop_assert_eq!(parse_f64(text.as_bytes()), text.parse::<f64>().ok());
        }

        #[test]
        fn the_next_number_is_the_next_token_s(text in r"[ ,]{0,2}([0-9.x/:]{1,7} )?(-?[0-9]{0,18}\.?[0-9]{0,4}(e-?[0-9])?[ ,x]){1,4}") {
            let (mut numbers, tokens) = (Tokens::new(text.as_bytes()), Tokens::new(text.as_bytes()));
            for token in tokens {
                prop_assert_eq!(numbers.number(), parse_f64(token));
            }
            prop_assert_eq!(numbers.number(), None);
        }

        #[test]
        fn fixed_decimals_are_the_standard_librarys(value in prop_oneof![-1e3..1e3_f64, -2e9..2e9_f64, any::<f64>()], decimals in 0..10_usize) {
            let mut text = String::new();
            push_fixed(&mut text, value, decimals);
            // A double times a power of ten is rounded: what is all but half-way may go either way.
            let truth = format!("{value:.decimals$}");
            let scaled = (value * 10_f64.powi(decimals as i32)).abs();
            let is_half_way = ((scaled - scaled.floor()) - 0.5).abs() <= 1e-6_f64.max(scaled * f64::EPSILON);
            let off = (text.parse::<f64>().unwrap() - truth.parse::<f64>().unwrap()).abs();
            prop_assert!(text == truth || (is_half_way && off < 1.5 * 0.1_f64.powi(decimals as i32)), "{} is not {}", text, truth);
            prop_assert_eq!(text.split_once('.').map_or(0, |(_, fraction)| fraction.len()), if value.is_finite() { decimals } else { 0 });
        }

        #[test]
        fn any_bytes_are_a_number_or_none(bytes in proptest::collection::vec(any::<u8>(), 0..40)) {
            let _ = parse_f64(&bytes);
        }
    }
}
