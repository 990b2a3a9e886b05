//! `floorprint live`: a robot's sensors as they come, or a recording as if it came.

mod change;
pub(crate) mod housekeeper;
mod page;
mod results;
#[cfg(feature = "ros2")]
mod ros;
mod sources;
mod watch;

use crate::config::Settings;
use crate::interrupt::Interrupt;
use crate::localize::{parse_start, read_any_map};
use crate::map::{is_session, map_path};
use crate::memory::{Memory, StorageWatch};
use crate::number::number;
use crate::outcome::{BadArguments, Outcome};
use crate::run_folder;
use crate::session_keeper::SessionKeeper;
use crate::solve;
use crate::terminal::Terminal;
use crate::topics::Topics;
use anyhow::{Context as _, ensure};
use clap::Args;
use floorprint::Config;
use floorprint::front_end::FilterKind;
use floorprint::localization::{Localizer, Start};
use floorprint::odometry::OdometryCorrections;
use floorprint::sensors::Record;
use floorprint_io::ros::{LiveSession, Recorder};
use floorprint_io::{FileLock, SessionFile, free_beside};
use floorprint_live::{
    Board, Counts, Delays, Engine, Event, Inbox, MapPicture, Mode, Picture, SensorClock, Situation, Step,
};
use housekeeper::Housekeeper;
pub(crate) use page::Page;
use results::Results;
use sources::Source;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::SyncSender;
use std::time::{Duration, Instant};
use watch::Watch;

/// Map, extend a map or localise while records come in.
///
/// Everything goes through the same engine as `run`: what --record writes gives with `run` the same bytes. Ctrl-C and
/// SIGTERM end it within a second, with everything saved.
#[derive(Args)]
pub(crate) struct Arguments {
    /// Where records come from: `-` for lines of JSON on standard input (docs/live.md says what is in them).
    #[arg(value_name = "-", conflicts_with = "play")]
    input: Option<String>,
    /// Play a recording, any that `run` reads.
    #[arg(long, value_name = "PATH")]
    play: Option<PathBuf>,
    /// How many times as fast as it was recorded; 0 is as fast as it goes, without losing any scan [default: 1].
    #[arg(long, value_name = "TIMES", value_parser = rate)]
    rate: Option<f64>,
    /// Number of the drive, for folders that hold several.
    #[arg(long, value_name = "N")]
    drive: Option<u32>,
    /// Map to localise in, which is not changed: the folder of a run or its session.gpkg, or a map.yaml of ROS.
    #[arg(long, value_name = "MAP", value_parser = map_path(), conflicts_with_all = ["earlier", "session", "record", "most_mb"])]
    map: Option<PathBuf>,
    /// Where the robot is in the map at the start, metres and radians; or unknown.
    #[arg(long, value_name = "X,Y,YAW", default_value = "unknown", value_parser = parse_start, requires = "map")]
    pose: Start,
    /// Session to go on with: one trajectory, one map. The file is left as it is; a run's folder stands for its session.gpkg.
    #[arg(long = "continue", value_name = "SESSION", value_parser = map_path())]
    earlier: Option<PathBuf>,
    /// Session that is gone on with where it exists, and kept up to date in place: for robots that start and stop.
    #[arg(long, value_name = "SESSION", conflicts_with = "earlier")]
    session: Option<PathBuf>,
    /// Where the robot is at the start of a drive that goes on.
    #[arg(long, value_name = "WHERE", default_value = "auto")]
    start: solve::Start,
    /// Record what the engine gets: an MCAP file with messages of ROS 2, which `run` reads.
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    #[cfg(feature = "ros2")]
    #[command(flatten)]
    ros: ros::Ros,
    #[command(flatten)]
    page: Page,
    #[command(flatten)]
    topics: Topics,
    #[command(flatten)]
    settings: Settings,
    #[command(flatten)]
    memory: Memory,
    /// Folder of the results [default: runs/NAME-live, with a number where that exists; none with --session or --map].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Replace the folder if it exists.
    #[arg(long)]
    force: bool,
    /// Threads that share the work; the results are the same for any number [default: all cores].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=512))]
    threads: Option<u16>,
    /// How many times its size a file of the recording may take in memory, besides 256 MB [default: 64].
    #[arg(long, value_name = "TIMES", value_parser = number(0.0, 1e9))]
    max_expansion: Option<f64>,
}

/// 0, or a rate at which something can be seen to happen.
fn rate(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(rate) if rate == 0.0 || (0.01..=1000.0).contains(&rate) => Ok(rate),
        _ => Err("expected 0 (as fast as it goes), or 0.01 to 1000 times".to_owned()),
    }
}

/// Situations are told on the terminal this often.
const TOLD_EVERY: Duration = Duration::from_secs(10);

/// Runs `floorprint live`.
pub(crate) fn execute(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<Outcome> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(arguments.threads.map_or(0, usize::from)).build()?;
    let interrupt = Interrupt::listen();
    // Before anything is waited for.
    let _session = arguments.session.as_deref().map(FileLock::claim).transpose()?;
    let Some(mut source) = Source::open(arguments, &interrupt, terminal)? else { return Ok(Outcome::Interrupted) };
    let config = arguments.settings.resolve(source.robot())?;
    let corrections = source.corrections(&config)?;
    let inbox = Arc::new(Inbox::new());
    let (mut engine, board) = arguments.engine(&config, corrections.as_ref(), &inbox)?;
    let recorded = LiveSession { robot: config.robot.clone(), corrections: corrections.clone() };
    let recorder = arguments.record.as_deref().map(|path| Recorder::create(path, &recorded)).transpose()?;
    let out = arguments.out();
    let results = out.as_deref().map(|out| Results::create(out, &config, arguments.force)).transpose()?;
    if let Some(results) = &results {
        interrupt.removes(results.folder());
        results.notes().iter().for_each(|note| terminal.warn(note));
    }
    arguments.limit_memory(&mut engine, out.as_deref(), &config)?;
    let keeper = arguments.keeper(out.as_deref(), &config, terminal)?;
    let frames = source.frames(&config);
    arguments.page.show(&board, &frames, terminal)?;
    source.announce(&board, &frames)?;
    let closed = Arc::clone(&inbox);
    interrupt.on_request(move || closed.close());
    let (terminal, config, interrupt, board) = (terminal, &config, &interrupt, &board);
    let session = Session { arguments, terminal, config, interrupt, board, out: out.as_deref(), recorded };
    let feeding = source.start(config, arguments.rate.unwrap_or(1.0), &inbox, interrupt);
    let outcome = pool.install(|| session.run(engine, recorder, keeper, results));
    // Nobody takes records any more.
    inbox.close();
    if interrupt.requested() || outcome.is_err() {
        // It may wait for a line that never comes, and ends with the process.
        return outcome;
    }
    feeding.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))?;
    outcome
}

impl Arguments {
    /// The engine for the mode that is asked for, and the board on which it will show what it does.
    fn engine(
        &self,
        config: &Config,
        corrections: Option<&OdometryCorrections>,
        inbox: &Arc<Inbox>,
    ) -> anyhow::Result<(Engine, Arc<Board>)> {
        let name = self.play.as_deref().map_or_else(|| "live".to_owned(), run_folder::data_set_name);
        let board = |mode| Arc::new(Board::new(mode, &name, Arc::clone(inbox)));
        if let Some(path) = &self.map {
            let (map, raster) = read_any_map(path)?;
            ensure!(
                !map.is_empty(),
                "{} shows no wall next to free space: there is nothing to be localised by",
                path.display()
            );
            let localizer = Localizer::new(Arc::new(map), self.pose, config);
            let board = board(Mode::Localization);
            if is_session(path) {
                board.annotate(SessionFile::read_annotations(path)?);
            }
            board.show_picture(Picture { revision: 1, map: MapPicture::of_raster(raster, 1), ..Picture::default() });
            return Ok((Engine::localizing(localizer, config, corrections)?, board));
        }
        let earlier = self.earlier.as_deref().or(self.session.as_deref().filter(|path| path.exists()));
        let engine = match earlier {
            Some(path) => {
                let session = SessionFile::read(path)?;
                Engine::extending(session, self.start.whereabouts(), config, corrections)
                    .with_context(|| format!("cannot go on with {}", path.display()))?
            }
            None => Engine::mapping(config, corrections)?,
        };
        let board = board(Mode::Mapping);
        if let Some(path) = earlier {
            board.annotate(SessionFile::read_annotations(path)?);
        }
        Ok((engine, board))
    }

    /// Bounds what an engine keeps in memory, where that is asked for.
    fn limit_memory(&self, engine: &mut Engine, out: Option<&Path>, config: &Config) -> anyhow::Result<()> {
        if let Some(beside) = self.session.as_deref().or(out)
            && let Some((store, most_bytes)) = self.memory.store(beside, config)?
        {
            engine.limit_memory(store, most_bytes);
        }
        Ok(())
    }

    /// Where the results go, where there are to be any.
    fn out(&self) -> Option<PathBuf> {
        if self.out.is_some() || self.session.is_some() || self.map.is_some() {
            return self.out.clone();
        }
        let name = self.play.as_deref().map_or_else(String::new, |path| run_folder::data_set_name(path) + "-");
        let plain = Path::new("runs").join(format!("{name}live"));
        Some(if plain.exists() && !self.force { free_beside(&plain) } else { plain })
    }

    /// Who keeps the session safe; nobody does where a finished map is used, or by a filter that leaves no session.
    fn keeper(
        &self,
        out: Option<&Path>,
        config: &Config,
        terminal: &Terminal,
    ) -> anyhow::Result<Option<SessionKeeper>> {
        let leaves_session = config.filter.kind == FilterKind::RaoBlackwellized && config.loop_closure.enabled;
        let notes = vec![("config", config.to_toml())];
        Ok(match (&self.session, out) {
            _ if self.map.is_some() => None,
            (Some(path), _) if leaves_session => Some(SessionKeeper::in_place(path, terminal, notes)?),
            (Some(_), _) => {
                let message = "--session needs filter.kind = \"rao_blackwellized\" with loop_closure.enabled";
                return Err(BadArguments(message.to_owned()).into());
            }
            (None, Some(out)) if leaves_session => Some(SessionKeeper::beside(out, terminal, notes)),
            (None, _) => None,
        })
    }
}

/// All that stands around the engine while it works.
struct Session<'a> {
    arguments: &'a Arguments,
    terminal: &'a Terminal,
    config: &'a Config,
    interrupt: &'a Interrupt,
    board: &'a Board,
    out: Option<&'a Path>,
    /// What recordings begin with.
    recorded: LiveSession,
}

impl Session<'_> {
    /// Takes records until there are none, or until it is to end; then writes what came of it.
    fn run(
        &self,
        mut engine: Engine,
        mut recorder: Option<Recorder>,
        keeper: Option<SessionKeeper>,
        mut results: Option<Results>,
    ) -> anyhow::Result<Outcome> {
        let terminal = self.terminal;
        let (mut tally, mut told) = (Tally::default(), Instant::now());
        let mut storage = StorageWatch::default();
        let housekeeper = Housekeeper::new(self.config, self.board);
        let keeper = std::thread::scope(|scope| {
            let keeping = scope.spawn(|| housekeeper.keep(keeper));
            let worked = (|| {
                // What was seen before is shown before anything new is.
                housekeeper.look_at(&mut engine);
                let mut watch = Watch::new(terminal);
                while let Some(event) = self.board.inbox.next(watch.patience()) {
                    let record = match event {
                        Event::Record(record, came) => {
                            tally.begin(&record, came);
                            watch.see(&record, came);
                            record
                        }
                        Event::Nothing => {
                            watch.look();
                            continue;
                        }
                        Event::Save(path, done) => {
                            self.save(&mut engine, path, done);
                            continue;
                        }
                        Event::Start(start) => {
                            engine.set_start(start);
                            continue;
                        }
                        Event::Change(change, done) => {
                            let changed = self.change(&change, &mut engine, &mut recorder, &housekeeper);
                            self.tell_change(&change, &changed);
                            // Who asked may not wait any more.
                            let _ = done.send(changed);
                            continue;
                        }
                    };
                    if let Some(recording) = &mut recorder
                        && let Err(error) = recording.write(&record)
                    {
                        terminal.warn(&format!("nothing is recorded any more: {error}"));
                        recorder = None;
                    }
                    let steps = engine.push(record)?;
                    storage.look(engine.storage_trouble(), terminal)?;
                    self.show(&engine, steps, &mut tally, results.as_mut());
                    housekeeper.look_at(&mut engine);
                    if told.elapsed() > TOLD_EVERY {
                        told = Instant::now();
                        self.tell();
                    }
                }
                let steps = engine.flush()?;
                self.show(&engine, steps, &mut tally, results.as_mut());
                anyhow::Ok(())
            })();
            housekeeper.stop();
            let keeper = keeping.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
            worked.map(|()| keeper)
        })?;
        self.tell();
        if let Some(recorder) = recorder {
            recorder.finish()?;
        }
        let ended = results::end(engine, keeper, results, &tally, self)?;
        Ok(if self.interrupt.requested() && !ended { Outcome::Interrupted } else { Outcome::Fine })
    }

    /// Saves a copy of the session beside the engine, and tells whether that worked.
    fn save(&self, engine: &mut Engine, path: PathBuf, done: SyncSender<bool>) {
        let session = engine.session().cloned();
        let (terminal, matcher) = (self.terminal.clone(), self.config.matcher.clone());
        std::thread::spawn(move || {
            let saved = session.map(|session| SessionFile::write(&path, &session, &matcher));
            match &saved {
                Some(Ok(())) => terminal.say(&format!("the session is saved in {}", path.display())),
                Some(Err(error)) => terminal.warn(&format!("the session is not saved: {error}")),
                None => terminal.warn("there is no session to be saved: a finished map is used"),
            }
            // Who asked may not wait any more.
            let _ = done.send(matches!(saved, Some(Ok(()))));
        });
    }

    fn show(&self, engine: &Engine, steps: Vec<Step>, tally: &mut Tally, mut results: Option<&mut Results>) {
        tally.end(&steps);
        tally.counts.lost = self.board.inbox.lost();
        tally.counts.refused = engine.refused();
        if let (Some(results), Mode::Localization) = (&mut results, self.board.mode) {
            results.add(&steps);
        }
        let newest = steps.into_iter().next_back().map(Arc::new);
        let odometry = engine.odometry().map(|stamped| (stamped.stamp_s, stamped.pose));
        let step = newest.or_else(|| self.board.situation().step.clone());
        let now_s = tally.clock.now_s();
        self.board.show(Situation { step, odometry, now_s, counts: tally.counts, delays: tally.delays.summary() });
    }

    fn tell(&self) {
        let situation = self.board.situation();
        let Some(step) = &situation.step else { return };
        let place = match step.pose {
            Some(pose) if !step.is_lost => {
                format!("at {:.2} m, {:.2} m, {:.0}°", pose.x, pose.y, pose.theta.to_degrees())
            }
            _ => "lost".to_owned(),
        };
        let lost = match situation.counts.lost.scans {
            0 => String::new(),
            scans => format!("; {scans} scans were lost where the machine did not keep up"),
        };
        self.terminal.say(&format!("{} scans, {place}{lost}", situation.counts.steps));
    }
}

/// What is counted and measured in a session.
#[derive(Default)]
struct Tally {
    counts: Counts,
    delays: Delays,
    clock: SensorClock,
}

impl Tally {
    /// A record came.
    fn begin(&mut self, record: &Record, came: Instant) {
        self.counts.records += 1;
        self.clock.see(record);
        if let Record::Scan(scan) = record {
            self.delays.begin(scan.stamp_s, came);
        }
    }

    /// Scans have their poses.
    fn end(&mut self, steps: &[Step]) {
        self.counts.steps += steps.len();
        steps.iter().for_each(|step| self.delays.end(step.stamp_s));
    }
}
