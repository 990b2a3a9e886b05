//! Grey pictures as PGM files, plain (P2) and binary (P5), also with 16 bits.

use crate::number::Tokens;
use std::io::{self, Write};

/// Grey levels with their scale.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Graymap {
    /// Columns.
    pub(crate) width: usize,
    /// Rows.
    pub(crate) height: usize,
    /// What white is.
    pub(crate) white: u16,
    /// Grey levels, row by row from the top left.
    pub(crate) levels: Vec<u16>,
}

/// Writes a binary PGM of 8 bits.
pub(crate) fn write_pgm(file: &mut dyn Write, width: usize, height: usize, levels: &[u8]) -> io::Result<()> {
    write!(file, "P5\n{width} {height}\n255\n")?;
    file.write_all(levels)
}

/// Decodes a PGM file's bytes; the error says what was found instead.
pub(crate) fn parse_pgm(bytes: &[u8]) -> Result<Graymap, String> {
    let mut header = Header { rest: bytes };
    let magic = header.word().unwrap_or_default();
    if magic != b"P2" && magic != b"P5" {
        return Err("no PGM signature (P2 or P5) at its beginning".to_owned());
    }
    let (Some(width), Some(height), Some(white)) = (header.number(), header.number(), header.number()) else {
        return Err("a header without width, height and white level".to_owned());
    };
    let white = u16::try_from(white).ok().filter(|&white| white > 0).ok_or(format!("a white level of {white}"))?;
    let count = width.checked_mul(height).filter(|&count| count > 0).ok_or(format!("{width}×{height} pixels"))?;
    let levels: Vec<u16> = if magic == b"P2" {
        let plain = without_comments(header.rest);
        let levels = plain.split(|&byte| byte == b'\n').flat_map(Tokens::new).map(parse_level);
        levels.take(count).collect::<Option<_>>().ok_or("a grey level that is no number")?
    } else {
        // A single blank ends the header; what follows are pixels, whatever they look like.
        let pixels = header.rest.get(1..).unwrap_or_default();
        if white < 256 {
            pixels.iter().take(count).map(|&level| u16::from(level)).collect()
        } else {
            pixels.as_chunks().0.iter().take(count).map(|&pair| u16::from_be_bytes(pair)).collect()
        }
    };
    if levels.len() < count {
        return Err(format!("{} of {width}×{height} pixels", levels.len()));
    }
    Ok(Graymap { width, height, white, levels })
}

fn parse_level(token: &[u8]) -> Option<u16> {
    std::str::from_utf8(token).ok()?.parse().ok()
}

/// The text with everything from each `#` to the end of its line left out.
fn without_comments(text: &[u8]) -> Vec<u8> {
    let mut kept = Vec::with_capacity(text.len());
    for line in text.split(|&byte| byte == b'\n') {
        kept.extend(line.iter().take_while(|&&byte| byte != b'#'));
        kept.push(b'\n');
    }
    kept
}

/// Words of a header, between which comments may stand.
struct Header<'a> {
    rest: &'a [u8],
}

impl<'a> Header<'a> {
    fn word(&mut self) -> Option<&'a [u8]> {
        self.rest = self.rest.trim_ascii_start();
        while self.rest.starts_with(b"#") {
            let end = self.rest.iter().position(|&byte| byte == b'\n')?;
            self.rest = self.rest[end..].trim_ascii_start();
        }
        let end =
            self.rest.iter().position(|byte| byte.is_ascii_whitespace() || *byte == b'#').unwrap_or(self.rest.len());
        let (word, rest) = self.rest.split_at(end);
        self.rest = rest;
        (!word.is_empty()).then_some(word)
    }

    fn number(&mut self) -> Option<usize> {
        std::str::from_utf8(self.word()?).ok()?.parse().ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn plain_pictures_may_hold_comments() {
        let picture = parse_pgm(b"P2 # made by hand\n# size\n3 2\n10\n0 5 10 # first row\n10 5 0\n").unwrap();
        assert_eq!(picture, Graymap { width: 3, height: 2, white: 10, levels: vec![0, 5, 10, 10, 5, 0] });
    }

    #[test]
    fn binary_pictures_may_have_sixteen_bits() {
        let picture = parse_pgm(b"P5\n2 1\n1000\n\x03\xe8\x00\x23").unwrap();
        assert_eq!((picture.white, picture.levels), (1000, vec![1000, 35]));
    }

    #[test]
    fn what_is_no_whole_picture_is_refused() {
        for bytes in [
            &b""[..],
            b"P6\n1 1\n255\n...",
            b"P5\n2 2\n255\n123",
            b"P2\n2 2\n255\n1 2 x 4",
            b"P5\n99999999999 99999999999\n255\n",
        ] {
            assert!(parse_pgm(bytes).is_err(), "{}", bytes.escape_ascii());
        }
    }

    proptest! {
        #[test]
        fn pictures_are_read_as_written(width in 1..9_usize, height in 1..9_usize, level in any::<u8>()) {
            let levels: Vec<u8> = (0..width * height).map(|i| level.wrapping_add((37 * i) as u8)).collect();
            let mut bytes = Vec::new();
            write_pgm(&mut bytes, width, height, &levels).unwrap();
            let read = parse_pgm(&bytes).unwrap();
            prop_assert_eq!((read.width, read.height, read.white), (width, height, 255));
            prop_assert!(read.levels.iter().zip(&levels).all(|(&a, &b)| a == u16::from(b)));
        }

        #[test]
        fn any_bytes_are_a_picture_or_an_error(bytes in proptest::collection::vec(any::<u8>(), 0..60), binary in any::<bool>()) {
            let mut file = if binary { b"P5 ".to_vec() } else { b"P2 ".to_vec() };
            file.extend(bytes);
            let _ = parse_pgm(&file);
        }
    }
}
