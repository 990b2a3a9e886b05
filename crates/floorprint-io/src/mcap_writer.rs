//! Writes MCAP files: chunks with an index, so that viewers can seek and what was written so far can be read whenever the
//! process ends.
//!
//! Source: <https://mcap.dev/spec>.

use crate::error::WriteError;
use crate::foxglove::Schema;
use crate::replace::replace_file;
use flate2::Crc;
use lz4_flex::frame::FrameEncoder;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::Path;

const MAGIC: &[u8] = b"\x89MCAP0\r\n";
/// A chunk is written once it holds so many bytes.
const CHUNK_BYTES: usize = 1 << 20;

const HEADER: u8 = 1;
const FOOTER: u8 = 2;
const SCHEMA: u8 = 3;
const CHANNEL: u8 = 4;
const MESSAGE: u8 = 5;
const CHUNK: u8 = 6;
const MESSAGE_INDEX: u8 = 7;
const CHUNK_INDEX: u8 = 8;
const STATISTICS: u8 = 11;
const DATA_END: u8 = 15;

/// What the messages are for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Purpose {
    /// To be played by ROS 2 and read again; it is written while messages come, and therefore not packed.
    Ros2,
    /// To be looked at.
    Viewers,
}

/// Writes an MCAP file for viewers, which appears whole or not at all.
///
/// # Errors
/// When it cannot be written, and those of `fill`.
pub fn write_mcap(
    path: &Path,
    fill: impl FnOnce(&mut McapWriter<&mut dyn Write>) -> io::Result<()>,
) -> Result<(), WriteError> {
    replace_file(path, |file| {
        let mut writer = McapWriter::new(file, Purpose::Viewers)?;
        fill(&mut writer)?;
        writer.finish().map(drop)
    })
}

/// A file that is being written.
#[derive(Debug)]
pub struct McapWriter<W> {
    output: W,
    purpose: Purpose,
    written: u64,
    /// Schemas and channels, as they come again in the summary.
    definitions: Vec<u8>,
    channels: u16,
    messages: BTreeMap<u16, u64>,
    sequence: u32,
    chunk: Chunk,
    chunk_indexes: Vec<u8>,
    chunks: u32,
    /// Nanoseconds.
    span: Option<[u64; 2]>,
}

/// The chunk that is being filled.
#[derive(Debug, Default)]
struct Chunk {
    records: Vec<u8>,
    /// Time and place of each message, by channel.
    messages: BTreeMap<u16, Vec<(u64, u64)>>,
    span: Option<[u64; 2]>,
}

impl<W: Write> McapWriter<W> {
    /// Begins a file.
    pub(crate) fn new(output: W, purpose: Purpose) -> io::Result<Self> {
        let mut writer = Self {
            output,
            purpose,
            written: 0,
            definitions: Vec::new(),
            channels: 0,
            messages: BTreeMap::new(),
            sequence: 0,
            chunk: Chunk::default(),
            chunk_indexes: Vec::new(),
            chunks: 0,
            span: None,
        };
        let profile = if purpose == Purpose::Ros2 { "ros2" } else { "" };
        let header = [text(profile), text(concat!("floorprint ", env!("CARGO_PKG_VERSION")))].concat();
        writer.put(MAGIC)?;
        writer.put(&record(HEADER, &header))?;
        Ok(writer)
    }

    /// Adds a channel of messages of one type and gives its number. What is latched goes to whoever joins later when ROS 2
    /// plays it.
    pub fn add_channel(&mut self, topic: &str, schema: &Schema, is_latched: bool) -> u16 {
        self.channels += 1;
        let id = self.channels.to_le_bytes();
        let metadata = if self.purpose == Purpose::Ros2 { quality_of_service(is_latched) } else { Vec::new() };
        let Schema { name, encoding, description, message_encoding } = schema;
        let schema = [&id[..], &text(name), &text(encoding), &prefixed(description)].concat();
        let channel = [&id[..], &id, &text(topic), &text(message_encoding), &prefixed(&metadata)].concat();
        let definitions = [record(SCHEMA, &schema), record(CHANNEL, &channel)].concat();
        self.chunk.records.extend(&definitions);
        self.definitions.extend(definitions);
        self.messages.insert(self.channels, 0);
        self.channels
    }

    /// Adds a message at a time in nanoseconds.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write(&mut self, channel: u16, time_ns: u64, message: &[u8]) -> io::Result<()> {
        let time = time_ns.to_le_bytes();
        let place = self.chunk.records.len() as u64;
        let head = [&channel.to_le_bytes()[..], &self.sequence.to_le_bytes(), &time, &time].concat();
        self.chunk.records.push(MESSAGE);
        self.chunk.records.extend(((head.len() + message.len()) as u64).to_le_bytes());
        self.chunk.records.extend(head);
        self.chunk.records.extend(message);
        self.chunk.messages.entry(channel).or_default().push((time_ns, place));
        widen(&mut self.chunk.span, time_ns);
        widen(&mut self.span, time_ns);
        *self.messages.entry(channel).or_default() += 1;
        self.sequence = self.sequence.wrapping_add(1);
        if self.chunk.records.len() >= CHUNK_BYTES { self.flush() } else { Ok(()) }
    }

    /// Writes what is there as a chunk.
    pub(crate) fn flush(&mut self) -> io::Result<()> {
        let Chunk { records, messages, span } = std::mem::take(&mut self.chunk);
        if records.is_empty() {
            return self.output.flush();
        }
        let [first, last] = span.unwrap_or_default().map(u64::to_le_bytes);
        let length = (records.len() as u64).to_le_bytes();
        let (compression, packed) = match self.purpose {
            Purpose::Ros2 => ("", Cow::Borrowed(&records[..])),
            Purpose::Viewers => ("lz4", Cow::Owned(lz4(&records)?)),
        };
        let packed_length = (packed.len() as u64).to_le_bytes();
        let crc = crc(&records).to_le_bytes();
        let head = [&first[..], &last, &length, &crc, &text(compression), &packed_length].concat();
        let start = self.written;
        self.put(&[CHUNK])?;
        self.put(&((head.len() + packed.len()) as u64).to_le_bytes())?;
        self.put(&head)?;
        self.put(&packed)?;
        let chunk_length = self.written - start;
        let mut offsets = Vec::new();
        let indexes = self.written;
        for (channel, messages) in &messages {
            offsets.extend(channel.to_le_bytes());
            offsets.extend(self.written.to_le_bytes());
            let entries: Vec<u8> =
                messages.iter().flat_map(|(time, place)| [time.to_le_bytes(), place.to_le_bytes()].concat()).collect();
            self.put(&record(MESSAGE_INDEX, &[&channel.to_le_bytes()[..], &prefixed(&entries)].concat()))?;
        }
        let index = [
            &first[..],
            &last,
            &start.to_le_bytes(),
            &chunk_length.to_le_bytes(),
            &prefixed(&offsets),
            &(self.written - indexes).to_le_bytes(),
            &text(compression),
            &packed_length,
            &length,
        ];
        self.chunk_indexes.extend(record(CHUNK_INDEX, &index.concat()));
        self.chunks += 1;
        self.output.flush()
    }

    /// Ends the file and gives what it was written to.
    pub(crate) fn finish(mut self) -> io::Result<W> {
        self.flush()?;
        self.put(&record(DATA_END, &0_u32.to_le_bytes()))?;
        let summary_start = self.written;
        let [first, last] = self.span.unwrap_or_default();
        let total: u64 = self.messages.values().sum();
        let counts: Vec<u8> = self
            .messages
            .iter()
            .flat_map(|(channel, count)| [&channel.to_le_bytes()[..], &count.to_le_bytes()].concat())
            .collect();
        let statistics = [
            &total.to_le_bytes()[..],
            &self.channels.to_le_bytes(),
            &u32::from(self.channels).to_le_bytes(),
            // Neither attachments nor metadata.
            &[0; 8],
            &self.chunks.to_le_bytes(),
            &first.to_le_bytes(),
            &last.to_le_bytes(),
            &prefixed(&counts),
        ];
        let summary = [
            std::mem::take(&mut self.definitions),
            std::mem::take(&mut self.chunk_indexes),
            record(STATISTICS, &statistics.concat()),
        ]
        .concat();
        self.put(&summary)?;
        // No offsets of groups and no checksum: both are optional.
        self.put(&record(FOOTER, &[&summary_start.to_le_bytes()[..], &[0; 12]].concat()))?;
        self.put(MAGIC)?;
        self.output.flush()?;
        Ok(self.output)
    }

    fn put(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.output.write_all(bytes)?;
        self.written += bytes.len() as u64;
        Ok(())
    }
}

fn widen(span: &mut Option<[u64; 2]>, time_ns: u64) {
    *span = Some(span.map_or([time_ns; 2], |[first, last]| [first.min(time_ns), last.max(time_ns)]));
}

fn lz4(bytes: &[u8]) -> io::Result<Vec<u8>> {
    let mut encoder = FrameEncoder::new(Vec::new());
    encoder.write_all(bytes)?;
    encoder.finish().map_err(io::Error::other)
}

/// How ROS 2 offers a channel's messages when it plays them.
fn quality_of_service(is_latched: bool) -> Vec<u8> {
    let durability = if is_latched { 1 } else { 2 };
    let qos = format!(
        "- history: 3\n  depth: 0\n  reliability: 1\n  durability: {durability}\n  deadline:\n    sec: 9223372036\n    nsec: 854775807\n  lifespan:\n    sec: 9223372036\n    nsec: 854775807\n  liveliness: 1\n  liveliness_lease_duration:\n    sec: 9223372036\n    nsec: 854775807\n  avoid_ros_namespace_conventions: false"
    );
    [text("offered_qos_profiles"), text(&qos)].concat()
}

fn crc(bytes: &[u8]) -> u32 {
    let mut crc = Crc::new();
    crc.update(bytes);
    crc.sum()
}

/// A record: its opcode, its length, its body.
fn record(opcode: u8, body: &[u8]) -> Vec<u8> {
    [&[opcode][..], &(body.len() as u64).to_le_bytes(), body].concat()
}

/// Bytes after their number.
fn prefixed(bytes: &[u8]) -> Vec<u8> {
    [&(bytes.len() as u32).to_le_bytes()[..], bytes].concat()
}

fn text(text: &str) -> Vec<u8> {
    prefixed(text.as_bytes())
}
