//! Session files: all that is needed to go on with a drive, in a file that other programs open as it is.
//!
//! An OGC GeoPackage 1.3, which is an SQLite database: tables of its own hold what a session is made of, the standard tables
//! show it to QGIS, GDAL and the like. SQLite's write-ahead log makes each save whole or not at all, whenever the process
//! ends.

mod geopackage;
mod layers;
#[cfg(test)]
mod tests;

use crate::annotations::Annotations;
use crate::error::{Problem, ReadError, WriteError};
use crate::exchange::rename_as_new;
use crate::replace::{hidden, sync_folder};
use crate::run_folder::is_at;
use floorprint::CompactScan;
use floorprint::back_end::Submap;
use floorprint::geometry::Pose2;
use floorprint::scan_matcher::MatcherConfig;
use floorprint::sensors::StampedPose;
use floorprint::session::{POSES_PER_BLOCK, Session, SessionState, StoredScan, unpack_poses};
use floorprint::texture::TextureMap;
use rusqlite::{Connection, OpenFlags, OptionalExtension, params};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The version of the tables; later versions read the files of all earlier ones.
const FORMAT_VERSION: i64 = 2;
/// Bytes of a pose in files of version 1: stamp, x, y, θ.
const POSE_BYTES: usize = 32;

/// Under what key it is noted what people say of the map.
pub const ANNOTATIONS: &str = "annotations";

const TABLES: &str = "
CREATE TABLE floorprint_meta (key TEXT PRIMARY KEY NOT NULL, value TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE floorprint_key_scans (
    number INTEGER PRIMARY KEY, frame INTEGER NOT NULL, is_drawn INTEGER NOT NULL, points BLOB NOT NULL);
CREATE TABLE floorprint_state (id INTEGER PRIMARY KEY CHECK (id = 1), format INTEGER NOT NULL, value BLOB NOT NULL);
";

/// What came with version 2: poses in packed blocks (`floorprint::session::pack_poses`), and submaps one by one, so that a save
/// writes what changed since the one before. Version 1 has `floorprint_poses`, and the submaps in the state.
const TABLES_OF_VERSION_2: &str = "
DROP TABLE IF EXISTS floorprint_poses;
CREATE TABLE IF NOT EXISTS floorprint_packed_poses (block INTEGER PRIMARY KEY, poses BLOB NOT NULL);
CREATE TABLE IF NOT EXISTS floorprint_submaps (number INTEGER PRIMARY KEY, value BLOB NOT NULL);
UPDATE floorprint_meta SET value = '2' WHERE key = 'format';
";

/// A session's file, open.
#[derive(Debug)]
pub struct SessionFile {
    path: PathBuf,
    connection: Connection,
    /// The version of its tables.
    version: i64,
    /// What it holds; `None` before the first save.
    saved: Option<Saved>,
    /// Where it lies until something is saved.
    unborn: Option<Unborn>,
}

/// What a file holds.
#[derive(Debug, Default)]
struct Saved {
    /// Frames whose poses do not change any more.
    settled: usize,
    /// The frames of the key scans.
    scans: Vec<usize>,
    submaps: Vec<Arc<Submap>>,
}

/// A file that is not where it is to be yet: hidden, and removed when it comes to nothing.
///
/// It is locked as long as it is made, so that no other process writes into it, and one that a killed process left is used.
#[derive(Debug)]
struct Unborn {
    path: PathBuf,
    /// None where the file system knows no locks.
    lock: Option<File>,
}

impl Unborn {
    /// The hidden file, empty, for what is to be at `target`.
    fn claim(target: &Path) -> Result<Self, WriteError> {
        let path = hidden(target, "new");
        let refused = |error: io::Error| WriteError::io(target, &error);
        loop {
            let file =
                File::options().create(true).truncate(false).read(true).write(true).open(&path).map_err(refused)?;
            let lock = match file.try_lock() {
                Ok(()) => Some(file),
                Err(TryLockError::Error(_)) => None,
                Err(TryLockError::WouldBlock) => {
                    return Err(Problem::new(target, "another process is writing it")
                        .advice("Wait for it, or choose another file")
                        .into());
                }
            };
            // Whoever had it may have finished in between.
            if lock.as_ref().is_some_and(|file| !is_at(file, &path)) {
                continue;
            }
            File::options().write(true).truncate(true).open(&path).map_err(refused)?;
            return Ok(Self { path, lock });
        }
    }
}

impl Drop for Unborn {
    fn drop(&mut self) {
        // Only while it is locked and has not been moved to its place: what is there now may be another process's.
        if self.lock.as_ref().is_none_or(|file| is_at(file, &self.path)) {
            let _ = fs::remove_file(&self.path);
        }
    }
}

impl SessionFile {
    /// Makes the file. It stands at `path` once something was saved, so that whenever the process ends there is a session
    /// or nothing.
    ///
    /// # Errors
    /// When there is a file already, or it cannot be written.
    pub fn create(path: &Path) -> Result<Self, WriteError> {
        refuse_taken(path)?;
        let (connection, unborn) = Self::make(path)?;
        Ok(Self { path: path.to_path_buf(), connection, version: FORMAT_VERSION, saved: None, unborn: Some(unborn) })
    }

    /// The tables of a file that is to be at `path`.
    fn make(path: &Path) -> Result<(Connection, Unborn), WriteError> {
        let unborn = Unborn::claim(path)?;
        let make = || -> rusqlite::Result<Connection> {
            let connection = Connection::open(&unborn.path)?;
            // If it is cut off it is thrown away: no journal needs to outlive the process.
            connection.pragma_update(None, "journal_mode", "MEMORY")?;
            geopackage::initialise(&connection)?;
            connection.execute_batch(TABLES)?;
            connection.execute(
                "INSERT INTO floorprint_meta VALUES ('format', ?1), ('program', ?2)",
                params![FORMAT_VERSION.to_string(), env!("CARGO_PKG_VERSION")],
            )?;
            Ok(connection)
        };
        Ok((make().map_err(|error| write_error(path, &error))?, unborn))
    }

    /// Puts the file where it is to be, now that it holds something.
    fn bring_forth(&mut self) -> Result<(), WriteError> {
        let Some(unborn) = self.unborn.take() else { return Ok(()) };
        let path = &self.path;
        let refused = |error: rusqlite::Error| write_error(path, &error);
        let nothing = Connection::open_in_memory().map_err(refused)?;
        std::mem::replace(&mut self.connection, nothing).close().map_err(|(_, error)| refused(error))?;
        put_as_new(&unborn.path, path)?;
        let open = || -> rusqlite::Result<Connection> {
            let connection = Connection::open(path)?;
            // A killed process loses nothing that was saved; the file is consistent even after a loss of power.
            connection.pragma_update(None, "journal_mode", "WAL")?;
            connection.pragma_update(None, "synchronous", "NORMAL")?;
            Ok(connection)
        };
        self.connection = open().map_err(refused)?;
        Ok(())
    }

    /// Writes a session as the file at `path`, which appears whole or not at all, in place of one that is there.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write(path: &Path, session: &Session, matcher: &MatcherConfig) -> Result<(), WriteError> {
        Self::write_with_notes(path, session, matcher, &[])
    }

    /// The same with [notes](Self::note), pairs of key and value.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write_with_notes(
        path: &Path,
        session: &Session,
        matcher: &MatcherConfig,
        notes: &[(&str, String)],
    ) -> Result<(), WriteError> {
        let unborn = Self::write_unborn(path, session, None, matcher, notes)?;
        settle_log(path)?;
        put(&unborn.path, path)
    }

    /// Writes a session with pictures and notes as the file at `path`, which appears whole or not at all, in place of one that
    /// is there.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write_over(
        path: &Path,
        layers: &Layers<'_>,
        matcher: &MatcherConfig,
        notes: &[(&str, String)],
    ) -> Result<(), WriteError> {
        let unborn = Self::write_unborn(path, layers.session, Some(layers), matcher, notes)?;
        settle_log(path)?;
        put(&unborn.path, path)
    }

    /// Writes a session with pictures and notes as the file at `path`, which appears whole or not at all.
    ///
    /// # Errors
    /// When there is a file already, or it cannot be written.
    pub fn write_new(
        path: &Path,
        layers: &Layers<'_>,
        matcher: &MatcherConfig,
        notes: &[(&str, String)],
    ) -> Result<(), WriteError> {
        refuse_taken(path)?;
        let unborn = Self::write_unborn(path, layers.session, Some(layers), matcher, notes)?;
        put_as_new(&unborn.path, path)
    }

    /// All of a session in a file that is not in its place at `path` yet.
    fn write_unborn(
        path: &Path,
        session: &Session,
        layers: Option<&Layers<'_>>,
        matcher: &MatcherConfig,
        notes: &[(&str, String)],
    ) -> Result<Unborn, WriteError> {
        let (mut connection, unborn) = Self::make(path)?;
        let mut write = || -> rusqlite::Result<()> {
            notes.iter().try_for_each(|(key, value)| note(&connection, key, value))?;
            append(&mut connection, None, session, matcher)?;
            layers.map_or(Ok(()), |layers| draw(&mut connection, layers))
        };
        write().map_err(|error| write_error(path, &error))?;
        connection.close().map_err(|(_, error)| write_error(path, &error))?;
        Ok(unborn)
    }

    /// Opens the file of an earlier drive.
    ///
    /// # Errors
    /// When it is not there, or is no session of this version or an earlier one.
    pub fn open(path: &Path) -> Result<Self, ReadError> {
        Self::open_with(path, OpenFlags::SQLITE_OPEN_READ_WRITE)
    }

    /// The session in the file of an earlier drive, which is not changed.
    ///
    /// # Errors
    /// As [`open`](Self::open) and [`load`](Self::load).
    pub fn read(path: &Path) -> Result<Session, ReadError> {
        Self::open_with(path, OpenFlags::SQLITE_OPEN_READ_ONLY)?.load()
    }

    fn open_with(path: &Path, access: OpenFlags) -> Result<Self, ReadError> {
        if !path.is_file() {
            let found = if path.exists() { "no file" } else { "there is nothing" };
            return Err(Problem::new(path, found).expected("the session.gpkg of a run").into());
        }
        let flags = access | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let format = |connection: &Connection| -> rusqlite::Result<Option<String>> {
            connection.pragma_update(None, "trusted_schema", false)?;
            connection
                .query_row("SELECT value FROM floorprint_meta WHERE key = 'format'", [], |row| row.get(0))
                .optional()
        };
        let connection = Connection::open_with_flags(path, flags).map_err(|error| read_error(path, &error))?;
        let version = format(&connection).map_err(|error| read_error(path, &error))?;
        let version = match version.as_deref().map(str::parse::<i64>) {
            Some(Ok(version @ 1..=FORMAT_VERSION)) => version,
            Some(Ok(version)) => {
                let found = format!("a session of version {version}, written by a newer floorprint");
                return Err(Problem::new(path, found).advice("Use that version or a later one").into());
            }
            _ => return Err(no_session(path)),
        };
        Ok(Self { path: path.to_path_buf(), connection, version, saved: None, unborn: None })
    }

    /// Where it is.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Saves what is new, in one piece: after this it is safe.
    ///
    /// # Errors
    /// When it cannot be written; the file is then as it was before.
    pub fn save(&mut self, session: &Session, matcher: &MatcherConfig) -> Result<(), WriteError> {
        let saved = append(&mut self.connection, self.saved.as_ref(), session, matcher);
        self.saved = Some(saved.map_err(|error| write_error(&self.path, &error))?);
        self.version = FORMAT_VERSION;
        self.bring_forth()
    }

    /// Notes something about the session: the configuration, where the data came from.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn note(&self, key: &str, value: &str) -> Result<(), WriteError> {
        note(&self.connection, key, value).map_err(|error| write_error(&self.path, &error))
    }

    /// What was noted about the session.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn notes(&self) -> Result<BTreeMap<String, String>, ReadError> {
        let read = || -> rusqlite::Result<BTreeMap<String, String>> {
            let mut rows = self.connection.prepare("SELECT key, value FROM floorprint_meta")?;
            rows.query_map([], |row| Ok((row.get(0)?, row.get(1)?)))?.collect()
        };
        read().map_err(|error| read_error(&self.path, &error))
    }

    /// What people said of the map.
    ///
    /// # Errors
    /// When it cannot be read, or is damaged.
    pub fn annotations(&self) -> Result<Annotations, ReadError> {
        let notes = self.notes()?;
        let Some(text) = notes.get(ANNOTATIONS) else { return Ok(Annotations::default()) };
        Annotations::from_geojson(text)
            .map_err(|error| Problem::new(&self.path, error.to_string()).advice("Take an earlier copy of it").into())
    }

    /// The same of a file that is not changed.
    ///
    /// # Errors
    /// As [`open`](Self::open) and [`annotations`](Self::annotations).
    pub fn read_annotations(path: &Path) -> Result<Annotations, ReadError> {
        Self::open_with(path, OpenFlags::SQLITE_OPEN_READ_ONLY)?.annotations()
    }

    /// Keeps what people say of the map, in place of what they said before.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn annotate(&self, annotations: &Annotations) -> Result<(), WriteError> {
        self.note(ANNOTATIONS, &annotations.to_geojson())
    }

    /// The session as of the last save.
    ///
    /// # Errors
    /// When the file is damaged, or its parts do not belong together.
    pub fn load(&self) -> Result<Session, ReadError> {
        let sql = |error: rusqlite::Error| read_error(&self.path, &error);
        let value: Option<Vec<u8>> = self
            .connection
            .query_row("SELECT value FROM floorprint_state WHERE id = 1", [], |row| row.get(0))
            .optional()
            .map_err(sql)?;
        let damaged = |what: String| -> ReadError {
            Problem::new(&self.path, what).expected("a whole session").advice("Take an earlier copy of it").into()
        };
        let value = value.ok_or_else(|| damaged("nothing was saved in it yet".to_owned()))?;
        let mut state: SessionState =
            rmp_serde::from_slice(&value).map_err(|error| damaged(format!("its state is damaged: {error}")))?;
        let poses = if self.version == 1 { self.poses_of_version_1() } else { self.poses() };
        let poses = poses.map_err(sql)?.ok_or_else(|| damaged("its poses are damaged".to_owned()))?;
        if self.version > 1 {
            let submaps = self.submaps().map_err(sql)?;
            state.set_submaps(submaps.map_err(|error| damaged(format!("its submaps are damaged: {error}")))?);
        }
        let scans = self.key_scans().map_err(sql)?.ok_or_else(|| damaged("its key scans are damaged".to_owned()))?;
        Session::restore(state, poses, scans).map_err(|error| damaged(error.to_string()))
    }

    fn poses(&self) -> rusqlite::Result<Option<Vec<StampedPose>>> {
        let mut select = self.connection.prepare("SELECT poses FROM floorprint_packed_poses ORDER BY block")?;
        let mut poses = Vec::new();
        for bytes in select.query_map([], |row| row.get::<_, Vec<u8>>(0))? {
            match unpack_poses(&bytes?) {
                Some(block) if poses.len() % POSES_PER_BLOCK == 0 => poses.extend(block),
                _ => return Ok(None),
            }
        }
        Ok(Some(poses))
    }

    fn submaps(&self) -> rusqlite::Result<Result<Vec<Submap>, rmp_serde::decode::Error>> {
        let mut select = self.connection.prepare("SELECT value FROM floorprint_submaps ORDER BY number")?;
        let values = select.query_map([], |row| row.get::<_, Vec<u8>>(0))?;
        values.map(|value| value.map(|value| rmp_serde::from_slice(&value))).collect()
    }

    fn poses_of_version_1(&self) -> rusqlite::Result<Option<Vec<StampedPose>>> {
        let mut select = self.connection.prepare("SELECT poses FROM floorprint_poses ORDER BY row")?;
        let mut poses = Vec::new();
        for bytes in select.query_map([], |row| row.get::<_, Vec<u8>>(0))? {
            let bytes = bytes?;
            if bytes.len() % POSE_BYTES != 0 || poses.len() % POSES_PER_BLOCK != 0 {
                return Ok(None);
            }
            poses.extend(bytes.chunks_exact(POSE_BYTES).map(|pose| {
                let number = |at: usize| {
                    let mut eight = [0; 8];
                    eight.copy_from_slice(&pose[8 * at..8 * at + 8]);
                    f64::from_le_bytes(eight)
                };
                StampedPose { stamp_s: number(0), pose: Pose2::new(number(1), number(2), number(3)) }
            }));
        }
        Ok(Some(poses))
    }

    fn key_scans(&self) -> rusqlite::Result<Option<Vec<StoredScan>>> {
        let mut select =
            self.connection.prepare("SELECT frame, is_drawn, points FROM floorprint_key_scans ORDER BY number")?;
        let rows = select.query_map([], |row| Ok((row.get::<_, i64>(0)?, row.get(1)?, row.get::<_, Vec<u8>>(2)?)))?;
        let mut scans = Vec::new();
        for row in rows {
            let (frame, is_drawn, points) = row?;
            let scan = usize::try_from(frame).ok().zip(CompactScan::from_bytes(&points));
            let Some((frame, points)) = scan else { return Ok(None) };
            scans.push(StoredScan { frame, points, is_drawn });
        }
        Ok(Some(scans))
    }

    /// The colours of the floor that were drawn last; `None` where none were painted.
    ///
    /// # Errors
    /// When the file is damaged.
    pub fn floor(&self) -> Result<Option<TextureMap>, ReadError> {
        let picture = geopackage::picture(&self.connection, "floor").map_err(|error| read_error(&self.path, &error))?;
        Ok(picture.map(|picture| {
            picture.map(|index, _| {
                let [red, green, blue, opacity] = picture.cells[index];
                (opacity > 0).then_some([red, green, blue])
            })
        }))
    }

    /// Draws the session into the standard tables, in place of what is drawn there: the occupancy map and the
    /// floor's colours as tile pyramids; trajectory, submaps and closures as features.
    ///
    /// # Errors
    /// When it cannot be written; the file is then as it was before.
    pub fn draw(&mut self, layers: &Layers<'_>) -> Result<(), WriteError> {
        draw(&mut self.connection, layers).map_err(|error| write_error(&self.path, &error))
    }

    /// Puts everything into the one file and closes it; says where it is.
    ///
    /// # Errors
    /// When it cannot be written; what was saved is then where it was.
    pub fn close(self) -> Result<PathBuf, WriteError> {
        let Self { path, connection, unborn: _unborn, .. } = self;
        connection.pragma_update(None, "journal_mode", "DELETE").map_err(|error| write_error(&path, &error))?;
        connection.close().map_err(|(_, error)| write_error(&path, &error))?;
        Ok(path)
    }
}

pub use layers::Layers;

/// Brings the tables from what they hold (`saved`; `None` before the first save) to `session`, in one piece.
fn append(
    connection: &mut Connection,
    saved: Option<&Saved>,
    session: &Session,
    matcher: &MatcherConfig,
) -> rusqlite::Result<Saved> {
    let state = encode(&session.state(matcher))?;
    let transaction = connection.transaction()?;
    let is_first = saved.is_none();
    if is_first {
        transaction.execute_batch(TABLES_OF_VERSION_2)?;
    }
    let nothing = Saved::default();
    let saved = saved.unwrap_or(&nothing);
    {
        let mut insert =
            transaction.prepare_cached("INSERT OR REPLACE INTO floorprint_packed_poses VALUES (?1, ?2)")?;
        for block in saved.settled / POSES_PER_BLOCK..session.frames().div_ceil(POSES_PER_BLOCK) {
            insert.execute(params![block as i64, &session.packed_poses(block)[..]])?;
        }
    }
    save_key_scans(&transaction, is_first, &saved.scans, session.scans())?;
    save_submaps(&transaction, is_first, &saved.submaps, session.submaps())?;
    transaction
        .execute("INSERT OR REPLACE INTO floorprint_state VALUES (1, ?1, ?2)", params![FORMAT_VERSION, state])?;
    transaction.commit()?;
    Ok(Saved {
        settled: session.settled_frames(),
        scans: session.scans().iter().map(|scan| scan.frame).collect(),
        submaps: session.submaps().to_vec(),
    })
}

/// Draws the standard tables, in one piece.
fn draw(connection: &mut Connection, layers: &Layers<'_>) -> rusqlite::Result<()> {
    let transaction = connection.transaction()?;
    layers.draw(&transaction)?;
    transaction.commit()
}

fn note(connection: &Connection, key: &str, value: &str) -> rusqlite::Result<()> {
    connection.execute("INSERT OR REPLACE INTO floorprint_meta VALUES (?1, ?2)", params![key, value]).map(drop)
}

/// What SQLite keeps beside a file until it is closed.
fn logs_of(path: &Path) -> [PathBuf; 3] {
    ["-wal", "-shm", "-journal"].map(|ending| {
        let mut name = path.file_name().unwrap_or_default().to_os_string();
        name.push(ending);
        path.with_file_name(name)
    })
}

/// Takes away what SQLite would read into the file that is put at `path`: the log that a killed process left. What it says
/// goes into the file to which it belongs, if that is still there.
fn settle_log(path: &Path) -> Result<(), WriteError> {
    if logs_of(path).iter().all(|log| fs::symlink_metadata(log).is_err()) {
        return Ok(());
    }
    if path.is_file()
        && let Ok(connection) = Connection::open(path)
    {
        // What is no database has no log either.
        let _ = connection.query_row("PRAGMA wal_checkpoint(TRUNCATE)", [], |_| Ok(()));
        let _ = connection.close();
    }
    for log in logs_of(path) {
        match fs::remove_file(&log) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(WriteError::io(&log, &error)),
            _ => {}
        }
    }
    Ok(())
}

/// Moves a whole file to its place.
fn put(from: &Path, path: &Path) -> Result<(), WriteError> {
    fs::rename(from, path)
        .and_then(|()| sync_folder(path.parent().unwrap_or(Path::new(""))))
        .map_err(|error| WriteError::io(path, &error))
}

/// Moves a whole file to its place, at which nothing may stand.
fn put_as_new(from: &Path, path: &Path) -> Result<(), WriteError> {
    refuse_taken(path)?;
    settle_log(path)?;
    match rename_as_new(from, path) {
        Ok(()) => sync_folder(path.parent().unwrap_or(Path::new(""))).map_err(|error| WriteError::io(path, &error)),
        Err(error) if error.kind() == io::ErrorKind::Unsupported => put(from, path),
        // Somebody was quicker.
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => Err(taken(path)),
        Err(error) => Err(WriteError::io(path, &error)),
    }
}

/// Brings the table of key scans from what it holds (`before`: their frames) to `scans`. A key scan's number is that of its
/// frame; in earlier files they were counted, so that the first save writes all anew.
fn save_key_scans(
    connection: &Connection,
    is_first: bool,
    before: &[usize],
    scans: &[StoredScan],
) -> rusqlite::Result<()> {
    if is_first {
        connection.execute("DELETE FROM floorprint_key_scans", [])?;
    }
    let mut before = before.iter().copied().peekable();
    let mut remove = connection.prepare_cached("DELETE FROM floorprint_key_scans WHERE number = ?1")?;
    let mut insert = connection.prepare_cached("INSERT INTO floorprint_key_scans VALUES (?1, ?2, ?3, ?4)")?;
    for scan in scans {
        while let Some(gone) = before.next_if(|&frame| frame < scan.frame) {
            remove.execute([gone as i64])?;
        }
        if before.next_if_eq(&scan.frame).is_none() {
            let frame = scan.frame as i64;
            insert.execute(params![frame, frame, scan.is_drawn, &scan.points.bytes()[..]])?;
        }
    }
    for gone in before {
        remove.execute([gone as i64])?;
    }
    Ok(())
}

/// Writes the submaps that are not the ones of `before`.
fn save_submaps(
    connection: &Connection,
    is_first: bool,
    before: &[Arc<Submap>],
    submaps: &[Arc<Submap>],
) -> rusqlite::Result<()> {
    if is_first || submaps.len() < before.len() {
        connection
            .execute("DELETE FROM floorprint_submaps WHERE number >= ?1", [submaps.len().min(before.len()) as i64])?;
    }
    let mut insert = connection.prepare_cached("INSERT OR REPLACE INTO floorprint_submaps VALUES (?1, ?2)")?;
    for (number, submap) in submaps.iter().enumerate() {
        if !before.get(number).is_some_and(|before| Arc::ptr_eq(before, submap)) {
            insert.execute(params![number as i64, encode(submap.as_ref())?])?;
        }
    }
    Ok(())
}

fn refuse_taken(path: &Path) -> Result<(), WriteError> {
    if fs::symlink_metadata(path).is_err() { Ok(()) } else { Err(taken(path)) }
}

fn taken(path: &Path) -> WriteError {
    Problem::new(path, "a file stands there").advice("Choose another name, or remove it").into()
}

fn encode<T: Serialize>(value: &T) -> rusqlite::Result<Vec<u8>> {
    rmp_serde::to_vec_named(value).map_err(|error| rusqlite::Error::ToSqlConversionFailure(Box::new(error)))
}

fn no_session(path: &Path) -> ReadError {
    Problem::new(path, "it is no session of floorprint").expected("the session.gpkg of a run").into()
}

fn read_error(path: &Path, error: &rusqlite::Error) -> ReadError {
    use rusqlite::ErrorCode::{NotADatabase, SystemIoFailure};
    match error.sqlite_error_code() {
        Some(NotADatabase) => no_session(path),
        Some(SystemIoFailure) => Problem::new(path, error.to_string()).into(),
        _ if error.to_string().contains("no such table") => no_session(path),
        _ => Problem::new(path, error.to_string())
            .advice("The file may be damaged or in use: see PRAGMA integrity_check")
            .into(),
    }
}

fn write_error(path: &Path, error: &rusqlite::Error) -> WriteError {
    use rusqlite::ErrorCode::{DiskFull, ReadOnly};
    let advice = match error.sqlite_error_code() {
        Some(DiskFull) => "Make room on the disk",
        Some(ReadOnly) => "Make the folder writable",
        _ => "",
    };
    Problem::new(path, error.to_string()).advice(advice).into()
}
