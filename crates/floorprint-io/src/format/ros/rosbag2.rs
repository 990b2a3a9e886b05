//! rosbag2's own storage: SQLite databases (`.db3`), read row by row in the order in which they were written.
//!
//! Source: `rosbag2_storage_sqlite3`, schema versions 1 to 4: tables `topics (id, name, type,
//! serialization_format, …)` and `messages (id, topic_id, timestamp, data)`, times in nanoseconds.

use super::input::Damage;
use super::{Channel, Encoding, MessageSource, RawMessage};
use rusqlite::{Connection, OpenFlags, OptionalExtension as _};
use std::collections::BTreeMap;
use std::path::Path;

/// How a database begins.
pub(super) const MAGIC: &[u8] = b"SQLite format 3\0";

/// The messages of a database.
pub(super) struct Rosbag2 {
    database: Option<Connection>,
    channels: BTreeMap<i64, Channel>,
    row: i64,
    data: Vec<u8>,
    /// Topic and log time of the message in `data`.
    current: Option<(i64, f64)>,
    damage: Damage,
}

impl Rosbag2 {
    /// The messages of the database at `path`.
    pub(super) fn new(path: &Path) -> Self {
        let mut damage = Damage::default();
        let opened = open(path).and_then(|database| Ok((channels(&database)?, database)));
        let (channels, database) = match opened {
            Ok((channels, database)) => (channels, Some(database)),
            Err(error) => {
                damage.add(|| format!("its table of topics cannot be read ({error})"));
                (BTreeMap::new(), None)
            }
        };
        Self { database, channels, row: i64::MIN, data: Vec::new(), current: None, damage }
    }

    /// Reads the next row; its topic and log time, nanoseconds.
    fn next_row(&mut self) -> rusqlite::Result<Option<(i64, i64)>> {
        let Some(database) = &self.database else { return Ok(None) };
        // A statement for each row rather than one for all: a row then lives no longer than this call.
        let mut statement = database.prepare_cached(
            "SELECT rowid, topic_id, timestamp, data FROM messages WHERE rowid > ?1 ORDER BY rowid LIMIT 1",
        )?;
        let (row, data) = (&mut self.row, &mut self.data);
        let found = statement.query_row([*row], |columns| {
            *row = columns.get(0)?;
            data.clear();
            data.extend_from_slice(columns.get_ref(3)?.as_bytes()?);
            Ok((columns.get(1)?, columns.get(2)?))
        });
        found.optional()
    }
}

/// Opens a database that nobody writes to in a way that needs no rights to write beside it.
fn open(path: &Path) -> rusqlite::Result<Connection> {
    let mut log = path.as_os_str().to_owned();
    log.push("-wal");
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    if Path::new(&log).exists() {
        return Connection::open_with_flags(path, flags);
    }
    let mut uri = "file:".to_owned();
    for &byte in path.as_os_str().as_encoded_bytes() {
        match byte {
            b'/' | b'-' | b'_' | b'.' | b'0'..=b'9' | b'a'..=b'z' | b'A'..=b'Z' => uri.push(byte.into()),
            byte => uri.push_str(&format!("%{byte:02x}")),
        }
    }
    Connection::open_with_flags(uri + "?immutable=1", flags | OpenFlags::SQLITE_OPEN_URI)
}

fn channels(database: &Connection) -> rusqlite::Result<BTreeMap<i64, Channel>> {
    let mut statement = database.prepare("SELECT id, name, type, serialization_format FROM topics")?;
    let rows = statement.query_map([], |columns| {
        let encoding: String = columns.get(3)?;
        let channel =
            Channel { topic: columns.get(1)?, type_name: columns.get(2)?, encoding: Encoding::named(&encoding) };
        Ok((columns.get(0)?, channel))
    })?;
    rows.collect()
}

impl MessageSource for Rosbag2 {
    fn advance(&mut self) -> bool {
        loop {
            match self.next_row() {
                Ok(Some((topic, log_time_ns))) => {
                    if self.channels.contains_key(&topic) {
                        self.current = Some((topic, log_time_ns as f64 * 1e-9));
                        return true;
                    }
                }
                Ok(None) => return false,
                Err(error) => {
                    let row = self.row.max(0);
                    self.damage.add(|| format!("unreadable behind message {row} ({error}); what comes before is used"));
                    self.database = None;
                    return false;
                }
            }
        }
    }

    fn message(&self) -> Option<RawMessage<'_>> {
        let (topic, log_time_s) = self.current?;
        Some(RawMessage { channel: self.channels.get(&topic)?, log_time_s, bytes: &self.data })
    }

    fn damage(&self) -> Option<String> {
        self.damage.sentence()
    }
}
