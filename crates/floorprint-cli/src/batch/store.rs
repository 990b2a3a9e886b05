//! `results.sqlite`: a row for each run, and a view of the figures that most ask for.

use super::hex;
use super::job::{Job, Row, Status};
use crate::bench::today;
use anyhow::Context as _;
use rusqlite::{Connection, OptionalExtension as _, params};
use sha2::{Digest as _, Sha256};
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

/// The tables. `report` is all of `report.json`: `json_extract` reaches what the view leaves out.
const SCHEMA: &str = "
CREATE TABLE IF NOT EXISTS runs (
    id INTEGER PRIMARY KEY,
    log TEXT NOT NULL,
    input_sha256 TEXT NOT NULL,
    preset TEXT NOT NULL,
    settings TEXT NOT NULL,
    config_sha256 TEXT NOT NULL,
    seed INTEGER NOT NULL,
    version TEXT NOT NULL,
    status TEXT NOT NULL,
    error TEXT,
    wall_s REAL NOT NULL,
    date TEXT NOT NULL,
    folder TEXT,
    report TEXT,
    UNIQUE (input_sha256, config_sha256, seed, version)
);
CREATE TABLE IF NOT EXISTS inputs (
    path TEXT PRIMARY KEY,
    size INTEGER NOT NULL,
    changed TEXT NOT NULL,
    sha256 TEXT NOT NULL
);
CREATE VIEW IF NOT EXISTS results AS SELECT
    id, log, preset, settings, seed, version, status, error, wall_s,
    report ->> '$.input.format' AS format,
    report ->> '$.drive.poses' AS poses,
    report ->> '$.drive.length_m' AS length_m,
    report ->> '$.drive.duration_s' AS duration_s,
    COALESCE(report ->> '$.errors.relations.all.translation_m.mean',
             report ->> '$.errors.trajectory.translation_m.rmse') AS error_m,
    COALESCE(report ->> '$.errors.relations.all.rotation_deg.mean',
             report ->> '$.errors.trajectory.rotation_deg.rmse') AS error_deg,
    report ->> '$.errors.map.f1' AS map_f1,
    report ->> '$.dropped_share' AS dropped_share,
    report ->> '$.cost.cpu_s' AS cpu_s,
    report ->> '$.cost.peak_memory_bytes' AS peak_memory_bytes,
    folder
FROM runs;
";

/// The file with the results.
pub(super) struct Store {
    connection: Connection,
}

/// What a preset amounts to.
pub(super) struct Line {
    pub(super) preset: String,
    /// Runs by [`Status`].
    pub(super) counts: [u32; 4],
    pub(super) mean_error_m: Option<f64>,
    pub(super) cpu_s: Option<f64>,
}

impl Store {
    /// Opens the file, which is made where there is none.
    pub(super) fn open(path: &Path) -> anyhow::Result<Self> {
        let open = || -> rusqlite::Result<Connection> {
            let connection = Connection::open(path)?;
            // Another process that looks at the results meanwhile holds nothing up.
            connection.pragma_update(None, "journal_mode", "wal")?;
            connection.execute_batch(SCHEMA)?;
            Ok(connection)
        };
        let connection = open().with_context(|| format!("cannot keep results in {}", path.display()))?;
        Ok(Self { connection })
    }

    /// The hash of a log's content, which is read once only as long as size and time of change stay the same.
    pub(super) fn input_hash(&self, path: &Path) -> anyhow::Result<String> {
        let files = files_of(path)?;
        let mut size = 0;
        let mut changed = Sha256::new();
        for file in &files {
            let metadata = fs::metadata(file)?;
            size += metadata.len();
            let since = metadata.modified()?.duration_since(UNIX_EPOCH).unwrap_or_default();
            changed.update(format!("{} {} {}\n", file.display(), metadata.len(), since.as_nanos()));
        }
        let changed = hex(&changed.finalize());
        let name = fs::canonicalize(path)?.display().to_string();
        let known: Option<String> = self
            .connection
            .query_row("SELECT sha256 FROM inputs WHERE path = ? AND changed = ?", params![name, changed], |row| {
                row.get(0)
            })
            .optional()?;
        if let Some(known) = known {
            return Ok(known);
        }
        let sha256 = hash_of(path, &files)?;
        let insert = "INSERT OR REPLACE INTO inputs (path, size, changed, sha256) VALUES (?, ?, ?, ?)";
        self.connection.execute(insert, params![name, i64::try_from(size)?, changed, sha256])?;
        Ok(sha256)
    }

    /// Which of the runs there are already.
    pub(super) fn known(&self, jobs: &[Job]) -> anyhow::Result<Vec<bool>> {
        let query = "SELECT 1 FROM runs WHERE input_sha256 = ? AND config_sha256 = ? AND seed = ? AND version = ?";
        let mut query = self.connection.prepare(query)?;
        let mut is_known = |job: &Job| {
            let (input, config, seed) = job.key();
            anyhow::Ok(query.exists(params![input, config, i64::try_from(seed)?, env!("CARGO_PKG_VERSION")])?)
        };
        jobs.iter().map(&mut is_known).collect()
    }

    /// Takes out the rows of these runs that have no report.
    pub(super) fn forget_what_was_not_done(&self, jobs: &[Job]) -> anyhow::Result<()> {
        let delete = "DELETE FROM runs WHERE input_sha256 = ? AND config_sha256 = ? AND seed = ? AND status != 'done'";
        let mut delete = self.connection.prepare(delete)?;
        for job in jobs {
            let (input, config, seed) = job.key();
            delete.execute(params![input, config, i64::try_from(seed)?])?;
        }
        Ok(())
    }

    /// Adds what became of a run.
    pub(super) fn add(&self, job: &Job, row: &Row) -> anyhow::Result<()> {
        let (input, config, seed) = job.key();
        self.connection.execute(
            "INSERT INTO runs (log, input_sha256, preset, settings, config_sha256, seed, version, status, error, wall_s, \
             date, folder, report) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
            params![
                job.log.display().to_string(),
                input,
                job.preset.name(),
                serde_json::to_string(&job.set)?,
                config,
                i64::try_from(seed)?,
                env!("CARGO_PKG_VERSION"),
                row.status.name(),
                row.error,
                row.wall_s,
                today(),
                row.folder.as_ref().map(|folder| folder.display().to_string()),
                row.report,
            ],
        )?;
        Ok(())
    }

    /// All there is, by preset.
    pub(super) fn summary(&self) -> anyhow::Result<Vec<Line>> {
        let query = "SELECT preset, SUM(status = ?), SUM(status = ?), SUM(status = ?), SUM(status = ?), AVG(error_m), \
                     SUM(cpu_s) FROM results GROUP BY preset ORDER BY preset";
        let mut query = self.connection.prepare(query)?;
        let names = Status::ALL.map(Status::name);
        let lines = query.query_map(names, |row| {
            Ok(Line {
                preset: row.get(0)?,
                counts: [row.get(1)?, row.get(2)?, row.get(3)?, row.get(4)?],
                mean_error_m: row.get(5)?,
                cpu_s: row.get(6)?,
            })
        })?;
        Ok(lines.collect::<rusqlite::Result<_>>()?)
    }
}

/// All files of a log, in the order of their names.
fn files_of(path: &Path) -> io::Result<Vec<PathBuf>> {
    if !path.is_dir() {
        return Ok(vec![path.to_path_buf()]);
    }
    let mut entries: Vec<PathBuf> = fs::read_dir(path)?.map(|entry| Ok(entry?.path())).collect::<io::Result<_>>()?;
    entries.sort();
    let mut files = Vec::new();
    for entry in entries {
        files.extend(files_of(&entry)?);
    }
    Ok(files)
}

/// SHA-256 of a file's content; of a folder that of a list of its files. Images count with their size, as they do for the
/// hash in a run's report.
fn hash_of(path: &Path, files: &[PathBuf]) -> anyhow::Result<String> {
    let content = |file: &Path| -> anyhow::Result<String> {
        let mut hash = Sha256::new();
        let mut file = File::open(file)?;
        let mut buffer = vec![0; 1 << 20];
        loop {
            match io::Read::read(&mut file, &mut buffer)? {
                0 => return Ok(hex(&hash.finalize())),
                length => hash.update(&buffer[..length]),
            }
        }
    };
    if let [file] = files
        && path == file
    {
        return content(file);
    }
    let mut list = Sha256::new();
    for file in files {
        let is_image = file.extension().is_some_and(|ending| ending == "png" || ending == "jpg");
        let what = if is_image { fs::metadata(file)?.len().to_string() } else { content(file)? };
        list.update(format!("{what}  {}\n", file.strip_prefix(path).unwrap_or(file).display()));
    }
    Ok(hex(&list.finalize()))
}
