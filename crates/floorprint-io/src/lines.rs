//! Lines of a text of any length, one at a time.

use std::io::{self, Read};

/// Longest line that is looked at; what is longer is no line of a sensor log.
const LONGEST_LINE: usize = 1 << 20;

/// Bytes asked for at a time.
const CHUNK: usize = 1 << 17;

/// Hands out the lines of a reader from one reused buffer.
pub(crate) struct Lines<R> {
    reader: R,
    buffer: Vec<u8>,
    start: usize,
    end: usize,
    /// Number of the line handed out last, from 1.
    number: usize,
    finished: bool,
}

impl<R: Read> Lines<R> {
    /// The lines of `reader`.
    pub(crate) fn new(reader: R) -> Self {
        Self { reader, buffer: vec![0; CHUNK], start: 0, end: 0, number: 0, finished: false }
    }

    /// Number of the line handed out last, from 1; 0 before the first.
    pub(crate) fn number(&self) -> usize {
        self.number
    }

    /// The next line without its end; none at the end of the text.
    ///
    /// A line longer than a megabyte is handed out in pieces, which keeps memory bounded
    /// when the text is no text at all.
    pub(crate) fn next_line(&mut self) -> io::Result<Option<&[u8]>> {
        let mut searched = 0;
        let (length, end_of_line) = loop {
            let line = &self.buffer[self.start..self.end];
            if let Some(length) = memchr::memchr(b'\n', &line[searched..]) {
                break (searched + length, 1);
            }
            searched = line.len();
            if self.finished || searched >= LONGEST_LINE {
                break (searched, 0);
            }
            self.fill()?;
        };
        if length + end_of_line == 0 {
            return Ok(None);
        }
        let line = self.start..self.start + length;
        self.start = line.end + end_of_line;
        self.number += 1;
        Ok(Some(self.buffer[line].trim_ascii()))
    }

    /// Moves what is left to the front and reads more behind it.
    fn fill(&mut self) -> io::Result<()> {
        self.buffer.copy_within(self.start..self.end, 0);
        self.end -= self.start;
        self.start = 0;
        if self.buffer.len() - self.end < CHUNK / 2 {
            self.buffer.resize(self.buffer.len() + CHUNK, 0);
        }
        loop {
            match self.reader.read(&mut self.buffer[self.end..]) {
                Ok(count) => {
                    self.end += count;
                    self.finished = count == 0;
                    return Ok(());
                }
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn lines_of(text: &[u8]) -> Vec<Vec<u8>> {
        let mut lines = Lines::new(text);
        let mut found = Vec::new();
        while let Some(line) = lines.next_line().unwrap() {
            found.push(line.to_vec());
        }
        assert_eq!(lines.number(), found.len());
        found
    }

    #[test]
    fn the_last_line_needs_no_end() {
        assert_eq!(lines_of(b"a\r\n\nb"), [&b"a"[..], b"", b"b"]);
        assert_eq!(lines_of(b"a\n"), [b"a"]);
        assert!(lines_of(b"").is_empty());
    }

    #[test]
    fn a_text_without_line_ends_stays_bounded() {
        let mut lines = Lines::new(io::repeat(b'x').take(20 << 20));
        while lines.next_line().unwrap().is_some() {
            assert!(lines.buffer.len() <= 4 * LONGEST_LINE);
        }
    }

    proptest! {
        #[test]
        fn lines_are_the_standard_librarys(words in proptest::collection::vec("[a-z ]{0,3000}", 0..60)) {
            let text = words.join("\n");
            let expected: Vec<Vec<u8>> = text.lines().map(|line| line.trim().as_bytes().to_vec()).collect();
            prop_assert_eq!(lines_of(text.as_bytes()), expected);
        }
    }
}
