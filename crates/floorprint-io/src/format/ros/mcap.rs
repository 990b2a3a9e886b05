//! MCAP files: read from front to back, so that files without a summary, damaged ones and those that
//! break off are read as far as they go.
//!
//! A file is a mark and then records of an opcode, a length and a body. Chunks hold further records and may
//! be packed as `lz4` or `zstd`. Indexes and the summary are not needed.
//!
//! Source: <https://mcap.dev/spec>.

use super::input::{Damage, Input, Stop, unpacked};
use super::{Channel, Encoding, MessageSource, RawMessage};
use std::collections::BTreeMap;
use std::io::{self, Read};

/// How a file begins.
pub(super) const MAGIC: &[u8] = b"\x89MCAP0\r\n";

/// Largest record but for chunks that is believed, bytes.
const LARGEST_RECORD: u64 = 1 << 30;

/// Opcodes of the records that matter.
const SCHEMA: u8 = 3;
const CHANNEL: u8 = 4;
const MESSAGE: u8 = 5;
const CHUNK: u8 = 6;
const DATA_END: u8 = 15;

/// The messages of a file.
pub(super) struct Mcap<R> {
    input: Input<R>,
    /// The chunk that is being read, and where it begins.
    chunk: Option<(u64, Input<Box<dyn Read>>)>,
    /// Names of the schemas.
    schemas: BTreeMap<u16, String>,
    channels: BTreeMap<u16, Channel>,
    record: Vec<u8>,
    /// Channel and log time of the message in `record`.
    current: Option<(u16, f64)>,
    damage: Damage,
    finished: bool,
}

/// A message's bytes come behind its channel, number and two times.
const MESSAGE_HEAD: usize = 2 + 4 + 8 + 8;

impl<R: Read> Mcap<R> {
    /// The messages of a file that begins here.
    pub(super) fn new(reader: R) -> Self {
        let mut input = Input::new(reader);
        let mut damage = Damage::default();
        let begins_well = input.array::<8>().is_ok_and(|magic| magic == MAGIC);
        if !begins_well {
            damage.add(|| "it does not begin as an MCAP file does".to_owned());
        }
        Self {
            input,
            chunk: None,
            schemas: BTreeMap::new(),
            channels: BTreeMap::new(),
            record: Vec::new(),
            current: None,
            damage,
            finished: !begins_well,
        }
    }

    /// Reads one record; true when it is a message.
    fn step(&mut self) -> Result<bool, Stop> {
        let start = self.input.position();
        let (opcode, whole) = match &mut self.chunk {
            Some((_, chunk)) => read_record(chunk, &mut self.record)?,
            // Whoever finishes a file writes an end of data.
            None => read_record(&mut self.input, &mut self.record).map_err(inside)?,
        };
        match whole {
            // What there is of the last chunk is used.
            Err(stop) if opcode == CHUNK && self.chunk.is_none() => {
                self.damage.add_stop(&stop, self.input.position());
            }
            whole => whole?,
        }
        let mut body = Body(&self.record);
        match opcode {
            SCHEMA => {
                if let (Some(id), Some(name)) = (body.number(), body.text()) {
                    self.schemas.insert(id, name);
                }
            }
            CHANNEL => {
                let ids = (body.number(), body.number());
                if let ((Some(id), Some(schema)), Some(topic), Some(encoding)) = (ids, body.text(), body.text()) {
                    let type_name = self.schemas.get(&schema).cloned().unwrap_or_default();
                    self.channels.insert(id, Channel { topic, type_name, encoding: Encoding::named(&encoding) });
                }
            }
            MESSAGE => {
                let head = (body.number(), body.bytes(4), body.bytes(8));
                if let (Some(channel), Some(_), Some(&[a, b, c, d, e, f, g, h])) = head
                    && self.record.len() >= MESSAGE_HEAD
                {
                    let log_time_s = u64::from_le_bytes([a, b, c, d, e, f, g, h]) as f64 * 1e-9;
                    self.current = self.channels.contains_key(&channel).then_some((channel, log_time_s));
                    return Ok(self.current.is_some());
                }
            }
            CHUNK if self.chunk.is_none() => {
                let head = (body.bytes(8 + 8 + 8 + 4), body.text(), body.bytes(8));
                let (Some(_), Some(compression), Some(_length)) = head else {
                    self.damage.add(|| format!("the chunk at byte {start} is garbled"));
                    return Ok(false);
                };
                match unpacked(&compression, body.0.to_vec()) {
                    Some(reader) => self.chunk = Some((start, Input::new(reader))),
                    None => self.damage.add(|| format!("the chunk at byte {start} is packed as \"{compression}\"")),
                }
            }
            DATA_END if self.chunk.is_none() => self.finished = true,
            _ => {}
        }
        Ok(false)
    }

    /// What remains to be read after trouble: the chunks behind a damaged one, or nothing.
    fn recover(&mut self, stop: &Stop) {
        if let Some((start, _)) = self.chunk.take() {
            match stop {
                Stop::End => {}
                Stop::CutOff => self.damage.add(|| format!("the chunk at byte {start} breaks off")),
                Stop::Failed(error) => {
                    self.damage.add(|| format!("the chunk at byte {start} cannot be unpacked to its end ({error})"));
                }
            }
            return;
        }
        self.finished = true;
        self.damage.add_stop(stop, self.input.position());
    }
}

impl<R: Read> MessageSource for Mcap<R> {
    fn advance(&mut self) -> bool {
        while !self.finished {
            match self.step() {
                Ok(true) => return true,
                Ok(false) => {}
                Err(stop) => self.recover(&stop),
            }
        }
        false
    }

    fn message(&self) -> Option<RawMessage<'_>> {
        let (channel, log_time_s) = self.current?;
        let bytes = self.record.get(MESSAGE_HEAD..)?;
        Some(RawMessage { channel: self.channels.get(&channel)?, log_time_s, bytes })
    }

    fn damage(&self) -> Option<String> {
        self.damage.sentence()
    }
}

/// Reads a record: its opcode, and whether all of its body could be put into `body`.
fn read_record<R: Read>(input: &mut Input<R>, body: &mut Vec<u8>) -> Result<(u8, Result<(), Stop>), Stop> {
    let [opcode, length @ ..] = input.array::<9>()?;
    let length = u64::from_le_bytes(length);
    if opcode != CHUNK && length > LARGEST_RECORD {
        return Err(Stop::Failed(io::Error::other(format!("a record of {length} bytes"))));
    }
    Ok((opcode, input.take_into(length, body).map_err(inside)))
}

/// In the middle of a record there is no good end.
fn inside(stop: Stop) -> Stop {
    match stop {
        Stop::End => Stop::CutOff,
        stop => stop,
    }
}

/// The body of a record, taken apart from its front.
struct Body<'a>(&'a [u8]);

impl<'a> Body<'a> {
    fn bytes(&mut self, count: usize) -> Option<&'a [u8]> {
        let (bytes, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(bytes)
    }

    fn number(&mut self) -> Option<u16> {
        self.bytes(2)?.try_into().ok().map(u16::from_le_bytes)
    }

    fn text(&mut self) -> Option<String> {
        let length = u32::from_le_bytes(self.bytes(4)?.try_into().ok()?);
        String::from_utf8(self.bytes(length as usize)?.to_vec()).ok()
    }
}
