//! `floorprint view`: a finished session in the browser, to be looked at and, where that is wanted, to be changed.

use crate::interrupt::Interrupt;
use crate::live::Page;
use crate::live::housekeeper::next_picture;
use crate::localize::read_any_map;
use crate::map::diff::{TOLERANCE_M, least_area_m2, maps};
use crate::map::{Stored, file_of, is_session};
use crate::outcome::{BadArguments, Outcome};
use crate::run_folder;
use crate::session_keeper::swap;
use crate::terminal::Terminal;
use clap::Args;
use floorprint::map::difference;
use floorprint::sensors::RobotConfig;
use floorprint::session::{Region, Renderer};
use floorprint_io::{Annotations, FileLock, SessionFile, read_trajectory};
use floorprint_live::{Board, Change, Event, FrameNames, Inbox, MapPicture, Mode, Picture, Refusal};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// Show a finished session in the browser: map, trajectory, loop closures.
#[derive(Args)]
pub(crate) struct Arguments {
    /// Folder of a run, a session.gpkg, or a map.yaml of ROS.
    path: PathBuf,
    /// Let viewers change the session: leave out parts of the map, name places, draw keep-out areas. A session of which a
    /// part is left out stays beside as it was, under a name with a number.
    #[arg(long)]
    edit: bool,
    /// A later map: show what is new and what is gone in it, as `map diff` finds it.
    #[arg(long, value_name = "MAP", conflicts_with = "edit")]
    compare: Option<PathBuf>,
    #[command(flatten)]
    page: Page,
}

/// Where the page is unless another address is asked for: a port that is free.
const ADDRESS: &str = "127.0.0.1:0";
/// How often somebody looks whether there is anything to do; what there is wakes him.
const PATIENCE: Duration = Duration::from_secs(60);

/// Runs `floorprint view`.
pub(crate) fn execute(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<Outcome> {
    let interrupt = Interrupt::listen();
    let path = file_of(&arguments.path);
    let name = run_folder::data_set_name(&arguments.path);
    let inbox = Arc::new(Inbox::new());
    let mut board = Board::new(Mode::Viewing, &name, Arc::clone(&inbox));
    board.is_editable = arguments.edit;
    if arguments.edit && !is_session(&path) {
        return Err(BadArguments(format!("--edit needs a session.gpkg, not {}", path.display())).into());
    }
    let _lock = arguments.edit.then(|| FileLock::claim(&path)).transpose()?;
    let board = Arc::new(board);
    let mut editor = is_session(&path).then(|| Editor::open(&path, &board)).transpose()?;
    if editor.is_none() {
        board.show_picture(picture_of_map(&path, arguments.path.is_dir())?);
    }
    if let Some(later) = &arguments.compare {
        let [before, after] = maps(&path, &file_of(later))?;
        let changes = difference(&before, &after, TOLERANCE_M, least_area_m2(&before, &after));
        terminal.say(&format!("{} patches differ in {}", changes.len(), later.display()));
        board.show_changes(changes);
    }
    let mut page = arguments.page.clone();
    if !page.is_asked_for() {
        page.http = ADDRESS.parse().ok();
    }
    let closed = Arc::clone(&inbox);
    interrupt.on_request(move || closed.close());
    page.show(&board, &FrameNames::of(&RobotConfig::default()), terminal)?;
    terminal.say("Ctrl-C ends it");
    while let Some(event) = inbox.next(PATIENCE) {
        let Event::Change(change, done) = event else { continue };
        let changed = match &mut editor {
            Some(editor) => editor.change(&change, terminal),
            None => Err(Refusal::Mode("a map is shown, which is not changed")),
        };
        if let Err(error) = &changed {
            terminal.warn(&format!("{}: {error}", path.display()));
        }
        // Who asked may not wait any more.
        let _ = done.send(changed);
    }
    Ok(Outcome::Fine)
}

/// A session that is shown, and changed in place.
struct Editor<'a> {
    path: &'a Path,
    board: &'a Board,
    stored: Stored,
}

impl<'a> Editor<'a> {
    fn open(path: &'a Path, board: &'a Board) -> anyhow::Result<Self> {
        let stored = Stored::load(path)?;
        board.annotate(stored.annotations.clone());
        let editor = Self { path, board, stored };
        editor.show();
        Ok(editor)
    }

    fn show(&self) {
        let session = &self.stored.session;
        let mut renderer = Renderer::new(session.map_config());
        self.board.show_picture(next_picture(&self.board.picture(), session, &mut renderer));
    }

    fn change(&mut self, change: &Change, terminal: &Terminal) -> Result<(), Refusal> {
        match change {
            Change::Restrict(region) => self.restrict(region, terminal).map_err(failed),
            Change::Annotate(revision, _) if *revision != self.board.overlay().revision => Err(Refusal::Stale),
            Change::Annotate(_, annotations) => self.annotate(annotations).map_err(failed),
            Change::Reset | Change::Load(..) => Err(Refusal::Mode("a finished session is shown")),
        }
    }

    fn restrict(&mut self, region: &Region, terminal: &Terminal) -> anyhow::Result<()> {
        let regions = std::slice::from_ref(region);
        let (stored, gone_m2) = self.stored.clone().restricted_to(regions, self.path)?;
        let aside = swap(self.path, self.path, || stored.save_over(self.path))?;
        terminal.say(&format!("{gone_m2:.2} m² are taken out; as it was the session is in {}", aside.display()));
        self.stored = stored;
        self.show();
        Ok(())
    }

    fn annotate(&mut self, annotations: &Annotations) -> anyhow::Result<()> {
        SessionFile::open(self.path)?.annotate(annotations)?;
        self.stored.annotations = annotations.clone();
        self.board.annotate(annotations.clone());
        Ok(())
    }
}

fn failed(error: anyhow::Error) -> Refusal {
    Refusal::Failed(format!("{error:#}"))
}

/// What there is to see of a map without a session, and of the trajectory beside it where it is that of a run.
fn picture_of_map(map: &Path, is_run: bool) -> anyhow::Result<Picture> {
    let (_, raster) = read_any_map(map)?;
    let trajectory = match map.with_file_name("trajectory.tum") {
        beside if is_run && beside.is_file() => read_trajectory(&beside)?,
        _ => Vec::new(),
    };
    let trajectory = trajectory.iter().map(|stamped| [stamped.pose.x as f32, stamped.pose.y as f32]).collect();
    Ok(Picture { revision: 1, map: MapPicture::of_raster(raster, 1), trajectory, closures: Vec::new() })
}
