//! Bytes of a recording, in order: how far they go, and what is packed inside them.

use bzip2::read::MultiBzDecoder;
use lz4_flex::frame::FrameDecoder as Lz4Decoder;
use ruzstd::decoding::{FrameDecoder as ZstdFrameDecoder, StreamingDecoder};
use std::io::{self, BufRead, BufReader, Cursor, Read};

/// Bytes asked for at a time.
const BUFFER_BYTES: usize = 1 << 17;

/// How zstd data begin.
pub(super) const ZSTD_MAGIC: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];

/// Why no more can be read.
#[derive(Debug)]
pub(super) enum Stop {
    /// The input ends here, between two records.
    End,
    /// The input ends in the middle of something.
    CutOff,
    /// The input cannot be read or unpacked.
    Failed(io::Error),
}

/// A reader that knows where it is.
pub(super) struct Input<R> {
    reader: BufReader<R>,
    position: u64,
}

impl<R: Read> Input<R> {
    /// From the first byte on.
    pub(super) fn new(reader: R) -> Self {
        Self { reader: BufReader::with_capacity(BUFFER_BYTES, reader), position: 0 }
    }

    /// How many bytes were read.
    pub(super) fn position(&self) -> u64 {
        self.position
    }

    /// Puts the next `count` bytes into `buffer`, which then holds nothing else. Of an input that ends early
    /// it holds what is there. A size that a damaged file states costs no memory: the buffer grows with the bytes.
    pub(super) fn take_into(&mut self, count: u64, buffer: &mut Vec<u8>) -> Result<(), Stop> {
        buffer.clear();
        let result = (&mut self.reader).take(count).read_to_end(buffer);
        self.position += buffer.len() as u64;
        match result {
            Err(error) => Err(Stop::Failed(error)),
            Ok(_) if buffer.len() as u64 == count => Ok(()),
            Ok(0) => Err(Stop::End),
            Ok(_) => Err(Stop::CutOff),
        }
    }

    /// The next `N` bytes.
    pub(super) fn array<const N: usize>(&mut self) -> Result<[u8; N], Stop> {
        let mut array = [0; N];
        let mut filled = 0;
        while filled < N {
            match self.reader.read(&mut array[filled..]) {
                Ok(0) if filled == 0 => return Err(Stop::End),
                Ok(0) => return Err(Stop::CutOff),
                Ok(count) => filled += count,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(Stop::Failed(error)),
            }
        }
        self.position += N as u64;
        Ok(array)
    }
}

/// What was packed as `compression` says; `None` for a compression that is not known.
pub(super) fn unpacked(compression: &str, packed: Vec<u8>) -> Option<Box<dyn Read>> {
    let packed = Cursor::new(packed);
    Some(match compression {
        "" | "none" => Box::new(packed),
        "bz2" => Box::new(MultiBzDecoder::new(packed)),
        "lz4" => Box::new(Lz4Decoder::new(packed)),
        "zstd" => Box::new(ZstdFrames::new(packed)),
        _ => return None,
    })
}

/// Unpacks zstd data of one or several frames.
pub(super) struct ZstdFrames<R: BufRead>(ZstdState<R>);

enum ZstdState<R: BufRead> {
    Between(R),
    Within(Box<StreamingDecoder<R, ZstdFrameDecoder>>),
    Finished,
}

impl<R: BufRead> ZstdFrames<R> {
    /// From a frame's beginning on.
    pub(super) fn new(packed: R) -> Self {
        Self(ZstdState::Between(packed))
    }
}

impl<R: BufRead> Read for ZstdFrames<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if buffer.is_empty() {
            return Ok(0);
        }
        loop {
            // Whatever fails here leaves the data finished.
            match std::mem::replace(&mut self.0, ZstdState::Finished) {
                ZstdState::Finished => return Ok(0),
                ZstdState::Between(mut packed) => {
                    if packed.fill_buf()?.is_empty() {
                        return Ok(0);
                    }
                    self.0 = ZstdState::Within(Box::new(StreamingDecoder::new(packed).map_err(io::Error::other)?));
                }
                ZstdState::Within(mut frame) => match frame.read(buffer)? {
                    0 => self.0 = ZstdState::Between(frame.into_inner()),
                    count => {
                        self.0 = ZstdState::Within(frame);
                        return Ok(count);
                    }
                },
            }
        }
    }
}

/// What is wrong with a recording: the first place in words, and how many there are.
#[derive(Debug, Clone, Default)]
pub(super) struct Damage {
    first: Option<String>,
    further: usize,
}

impl Damage {
    /// One more place.
    pub(super) fn add(&mut self, what: impl FnOnce() -> String) {
        if self.first.is_some() {
            self.further += 1;
        } else {
            self.first = Some(what());
        }
    }

    /// Why a container could not be read on, unless it was at its end.
    pub(super) fn add_stop(&mut self, stop: &Stop, position: u64) {
        match stop {
            Stop::End => {}
            Stop::CutOff => self.add(|| format!("cut off at byte {position}; what comes before is used")),
            Stop::Failed(error) => self.add(|| format!("unreadable from byte {position} on ({error})")),
        }
    }

    /// All of it in a sentence.
    pub(super) fn sentence(&self) -> Option<String> {
        let first = self.first.as_ref()?;
        Some(match self.further {
            0 => first.clone(),
            further => format!("{first}; damaged in {further} more places"),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_input_that_ends_early_gives_what_is_there() {
        let mut input = Input::new(&[1_u8, 2, 3, 4, 5][..]);
        assert_eq!(input.array().unwrap(), [1_u8, 2]);
        let mut rest = Vec::new();
        assert!(matches!(input.take_into(u64::MAX, &mut rest), Err(Stop::CutOff)));
        assert_eq!((rest, input.position()), (vec![3, 4, 5], 5));
        assert!(matches!(input.array::<1>(), Err(Stop::End)));
    }

    #[test]
    fn frames_of_zstd_follow_each_other() {
        // Two frames of one raw block each: "hi" and "you".
        let frame = |text: &[u8]| {
            let size = text.len() as u8;
            [&ZSTD_MAGIC[..], &[0x20, size], &[(size << 3) | 1, 0, 0], text].concat()
        };
        let mut text = String::new();
        ZstdFrames::new(&[frame(b"hi "), frame(b"you")].concat()[..]).read_to_string(&mut text).unwrap();
        assert_eq!(text, "hi you");
        assert!(ZstdFrames::new(&frame(b"hi")[..7]).read_to_end(&mut Vec::new()).is_err());
    }
}
