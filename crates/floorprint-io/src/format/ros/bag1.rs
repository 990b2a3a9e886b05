//! ROS 1 bags, version 2.0: read from front to back, so that bags without an index, damaged ones and
//! those that are still being recorded (`.bag.active`) are read as far as they go.
//!
//! A bag is a line of text and then records: a header of `name=value` fields and data, each with its
//! length. Chunks hold further records and may be packed as `bz2` or `lz4`. Indexes are not needed.
//!
//! Source: <https://wiki.ros.org/Bags/Format/2.0>.

use super::input::{Damage, Input, Stop, unpacked};
use super::{Channel, Encoding, MessageSource, RawMessage};
use std::collections::BTreeMap;
use std::io::Read;

/// How a bag begins.
pub(super) const MAGIC: &[u8] = b"#ROSBAG V2.0\n";

/// Longest header of a record that is believed, bytes.
const LONGEST_HEADER: u32 = 1 << 20;

/// Largest message, bytes: what ROS 1 itself accepts.
const LARGEST_MESSAGE: u32 = 1_000_000_000;

/// Kinds of records, by their field `op`.
const MESSAGE: u8 = 2;
const BAG_HEADER: u8 = 3;
const INDEX: u8 = 4;
const CHUNK: u8 = 5;
const CHUNK_INFO: u8 = 6;
const CONNECTION: u8 = 7;

/// The messages of a bag.
pub(super) struct Bag1<R> {
    input: Input<R>,
    /// The chunk that is being read.
    chunk: Option<Input<Box<dyn Read>>>,
    /// Where that chunk begins.
    chunk_start: u64,
    channels: BTreeMap<u32, Channel>,
    header: Vec<u8>,
    data: Vec<u8>,
    /// Connection and log time of the message in `data`.
    current: Option<(u32, f64)>,
    damage: Damage,
    finished: bool,
}

/// Why a record could not be read.
enum Trouble {
    Stop(Stop),
    /// It is no record.
    Malformed,
}

impl From<Stop> for Trouble {
    fn from(stop: Stop) -> Self {
        Self::Stop(stop)
    }
}

impl<R: Read> Bag1<R> {
    /// The messages of a bag that begins here.
    pub(super) fn new(reader: R) -> Self {
        let mut input = Input::new(reader);
        let mut damage = Damage::default();
        let mut magic = Vec::new();
        let begins_well = input.take_into(MAGIC.len() as u64, &mut magic).is_ok() && magic == MAGIC;
        if !begins_well {
            damage.add(|| "it does not begin as a bag does".to_owned());
        }
        Self {
            input,
            chunk: None,
            chunk_start: 0,
            channels: BTreeMap::new(),
            header: Vec::new(),
            data: magic,
            current: None,
            damage,
            finished: !begins_well,
        }
    }

    /// Reads one record; true when it is a message.
    fn step(&mut self) -> Result<bool, Trouble> {
        let start = self.input.position();
        let op = match &mut self.chunk {
            Some(chunk) => read_record(chunk, &mut self.header, &mut self.data)?,
            None => read_record(&mut self.input, &mut self.header, &mut self.data)?,
        };
        match op {
            MESSAGE => {
                let header = Fields(&self.header);
                let connection = header.number("conn").ok_or(Trouble::Malformed)?;
                let [seconds, nanoseconds] = header.pair("time").ok_or(Trouble::Malformed)?;
                let log_time_s = f64::from(seconds) + f64::from(nanoseconds) * 1e-9;
                self.current = self.channels.contains_key(&connection).then_some((connection, log_time_s));
                Ok(self.current.is_some())
            }
            CONNECTION => {
                let id = Fields(&self.header).number("conn").ok_or(Trouble::Malformed)?;
                let topic = Fields(&self.header).text("topic").ok_or(Trouble::Malformed)?;
                let type_name = Fields(&self.data).text("type").ok_or(Trouble::Malformed)?;
                self.channels.entry(id).or_insert_with(|| Channel { topic, type_name, encoding: Encoding::Ros1 });
                Ok(false)
            }
            CHUNK => {
                self.enter_chunk(start)?;
                Ok(false)
            }
            BAG_HEADER => {
                let index = Fields(&self.header).value("index_pos");
                if index.is_some_and(|position| position.iter().all(|&byte| byte == 0)) {
                    self.damage.add(|| "its recording was not finished".to_owned());
                }
                Ok(false)
            }
            _ => Ok(false),
        }
    }

    /// Reads a chunk's packed bytes, whose header was just read, as far as they go.
    fn enter_chunk(&mut self, start: u64) -> Result<(), Trouble> {
        let length = self.input.array().map(u32::from_le_bytes).map_err(inside)?;
        let compression = Fields(&self.header).text("compression").ok_or(Trouble::Malformed)?;
        if self.chunk.is_some() {
            return Err(Trouble::Malformed);
        }
        self.chunk_start = start;
        // A recorder that was killed left the length of its last chunk open: it goes on to the end of the file.
        let open = length == 0;
        if open && compression == "none" {
            return Ok(());
        }
        let mut packed = Vec::new();
        let cut_off = match self.input.take_into(if open { u64::MAX } else { length.into() }, &mut packed) {
            Err(Stop::CutOff) if open => None,
            result => result.err(),
        };
        match unpacked(&compression, packed) {
            Some(reader) => self.chunk = Some(Input::new(reader)),
            None => self.damage.add(|| format!("a chunk at byte {start} is packed as \"{compression}\"")),
        }
        if let Some(stop) = cut_off {
            self.damage.add_stop(&inside(stop), self.input.position());
        }
        Ok(())
    }

    /// What remains to be read after trouble: the chunks behind a damaged one, or nothing.
    fn recover(&mut self, trouble: &Trouble) {
        if self.chunk.take().is_some() {
            let start = self.chunk_start;
            match trouble {
                Trouble::Stop(Stop::End) => {}
                Trouble::Stop(Stop::Failed(error)) => {
                    self.damage.add(|| format!("the chunk at byte {start} cannot be unpacked to its end ({error})"));
                }
                Trouble::Stop(Stop::CutOff) => {
                    self.damage.add(|| format!("the chunk at byte {start} breaks off in the middle of a message"));
                }
                Trouble::Malformed => self.damage.add(|| format!("the chunk at byte {start} is garbled")),
            }
            return;
        }
        self.finished = true;
        let position = self.input.position();
        match trouble {
            Trouble::Stop(stop) => self.damage.add_stop(stop, position),
            Trouble::Malformed => {
                self.damage.add(|| format!("garbled near byte {position}; what comes before is used"))
            }
        }
    }
}

impl<R: Read> MessageSource for Bag1<R> {
    fn advance(&mut self) -> bool {
        while !self.finished {
            match self.step() {
                Ok(true) => return true,
                Ok(false) => {}
                Err(trouble) => self.recover(&trouble),
            }
        }
        false
    }

    fn message(&self) -> Option<RawMessage<'_>> {
        let (connection, log_time_s) = self.current?;
        Some(RawMessage { channel: self.channels.get(&connection)?, log_time_s, bytes: &self.data })
    }

    fn damage(&self) -> Option<String> {
        self.damage.sentence()
    }
}

/// Reads a record's header and, but for chunks, its data; says what kind it is of.
fn read_record<R: Read>(input: &mut Input<R>, header: &mut Vec<u8>, data: &mut Vec<u8>) -> Result<u8, Trouble> {
    let length = u32::from_le_bytes(input.array()?);
    if length > LONGEST_HEADER {
        return Err(Trouble::Malformed);
    }
    input.take_into(length.into(), header).map_err(inside)?;
    let op = match Fields(header).value("op") {
        Some(&[op @ MESSAGE..=CONNECTION]) => op,
        _ => return Err(Trouble::Malformed),
    };
    if op == CHUNK {
        return Ok(op);
    }
    let length = input.array().map(u32::from_le_bytes).map_err(inside)?;
    if length > LARGEST_MESSAGE && matches!(op, MESSAGE | CONNECTION | INDEX | CHUNK_INFO) {
        return Err(Trouble::Malformed);
    }
    input.take_into(length.into(), data).map_err(inside)?;
    Ok(op)
}

/// In the middle of a record there is no good end.
fn inside(stop: Stop) -> Stop {
    match stop {
        Stop::End => Stop::CutOff,
        stop => stop,
    }
}

/// A record's header: fields of `name=value`, each with its length.
struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    fn value(&self, wanted: &str) -> Option<&'a [u8]> {
        let mut rest = self.0;
        while let Some((length, behind)) = rest.split_first_chunk() {
            let (field, behind) = behind.split_at_checked(u32::from_le_bytes(*length) as usize)?;
            let equals = memchr::memchr(b'=', field)?;
            if &field[..equals] == wanted.as_bytes() {
                return Some(&field[equals + 1..]);
            }
            rest = behind;
        }
        None
    }

    fn number(&self, wanted: &str) -> Option<u32> {
        self.value(wanted)?.try_into().ok().map(u32::from_le_bytes)
    }

    fn pair(&self, wanted: &str) -> Option<[u32; 2]> {
        let &[a, b, c, d, e, f, g, h] = self.value(wanted)? else { return None };
        Some([u32::from_le_bytes([a, b, c, d]), u32::from_le_bytes([e, f, g, h])])
    }

    fn text(&self, wanted: &str) -> Option<String> {
        String::from_utf8(self.value(wanted)?.to_vec()).ok()
    }
}
