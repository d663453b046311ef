//! The page of takes, served on loopback: it saves the score, has it drawn, and keeps a take.

use std::fmt;
use std::io::Write;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use umo_core::Take;
use umo_core_rig::glb::Follower;
use umo_serve::Config;

use super::take::Opened;
use super::{blocks, browser, page};
use crate::args::Page;
use crate::failure::Failure;
use crate::score::{Drawer, Score};
use crate::speech::Speech;
use crate::{atomic_file, play, serve};

/// Serves until Ctrl-C.
pub(super) fn run(args: &Page) -> Result<(), Failure> {
    let opened = Opened::new(args)?;
    let first = &opened.paths[0];
    let kept = args.output.clone().unwrap_or_else(|| kept(first));
    let inputs: Vec<&Path> = opened.paths.iter().map(PathBuf::as_path).collect();
    atomic_file::refuse_inputs(&[&kept], &inputs)?;
    let html = page::html(&opened.scene(args, Some(&kept))?)?.into();
    let engine = umo_core::EngineConfig { threads: umo_core::Threads::Own(1), max_batch: 1, ..Default::default() };
    let model = Arc::clone(&opened.model);
    let desk = Desk {
        html,
        score: first.with_extension("toml"),
        audio: args.audio.first().cloned(),
        repair: args.repair,
        kept,
        opened,
        state: Mutex::default(),
    };
    let config = Config {
        sessions: 1,
        per_client: 1,
        engine,
        page: Some(Arc::new(desk)),
        drain: Duration::ZERO,
        ..Config::default()
    };
    let ready = |address: SocketAddr| {
        println!("http://{address}/ (Ctrl-C ends it)");
        if !args.shown.no_open {
            browser::open(&format!("http://{address}/"));
        }
    };
    umo_serve::run("127.0.0.1:0", config, model, ready).map_err(|error| serve::failure(&error, "--live"))
}

/// Returns the default name of a kept take.
fn kept(first: &Path) -> PathBuf {
    let stem = first.file_stem().unwrap_or_default().to_string_lossy();
    first.with_file_name(format!("{stem}-kept.umo"))
}

/// The page and its files.
struct Desk {
    html: Arc<str>,
    opened: Opened,
    audio: Option<PathBuf>,
    repair: bool,
    /// Where the score is saved.
    score: PathBuf,
    /// Where a take is kept.
    kept: PathBuf,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    /// The take that was drawn last.
    drawn: Option<Take>,
    /// Whether the page has kept a take.
    has_kept: bool,
}

impl fmt::Debug for Desk {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Desk").field("score", &self.score).finish_non_exhaustive()
    }
}

impl Desk {
    /// Writes the score beside the take.
    fn save(&self, text: &str) -> Result<String, Failure> {
        atomic_file::commit(atomic_file::create(&self.score)?, |out| out.write_all(text.as_bytes()))?;
        Ok(self.score.display().to_string())
    }

    /// Draws the take anew by its score; returns its frames.
    fn draw(&self, text: &str, state: &mut State) -> Result<Vec<u8>, Failure> {
        self.save(text)?;
        let audio = self.audio.as_deref().ok_or_else(|| Failure::input("drawing needs the recording: --audio"))?;
        let speech = Speech::open(audio, self.repair)?;
        let Opened { paths, takes, model, session, .. } = &self.opened;
        let drawer = Drawer { model, cx: self.opened.compute(), path: &paths[0], speech: &speech };
        let score = Score::parse(&self.score, text)?;
        let take = drawer.draw(&takes[0], Some(&score), None, 0, &session.gestures)?;
        let clip = play::frames(&self.score, &take, &self.opened.model, &self.opened.session)?;
        state.drawn = Some(take);
        Ok(blocks::frames(&clip).collect())
    }

    /// Writes a take, by its number or the one that was drawn, to the file for it.
    fn keep(&self, which: &str, state: &mut State) -> Result<String, Failure> {
        let take = match which {
            "drawn" => state.drawn.as_ref(),
            number => number.parse().ok().and_then(|number: usize| self.opened.takes.get(number)),
        };
        let take = take.ok_or_else(|| Failure::input(format!("no take `{which}`: reload the page")))?;
        let path = self.kept.display();
        if !state.has_kept && self.kept.exists() {
            return Err(Failure::input(format!("{path} is there already: move it, or name another file by -o")));
        }
        atomic_file::commit(atomic_file::create(&self.kept)?, |out| out.write_all(take.bytes()))?;
        state.has_kept = true;
        Ok(path.to_string())
    }
}

impl umo_serve::Page for Desk {
    fn html(&self) -> Arc<str> {
        Arc::clone(&self.html)
    }

    fn follower(&self) -> Option<Arc<Follower>> {
        None
    }

    fn put_on(&self, _: Vec<u8>) -> Result<(), String> {
        Err("the takes of this page wear figures: `umo view TAKE --onto CHARACTER` shows one on a character".to_owned())
    }

    fn answer(&self, what: &str, body: Vec<u8>) -> Result<Vec<u8>, String> {
        let body = String::from_utf8(body).map_err(|_| "expected text in UTF-8".to_owned())?;
        // One request at a time: a drawing uses all cores.
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let answer = match what {
            "score" => self.save(&body).map(String::into_bytes),
            "draw" => self.draw(&body, &mut state),
            "keep" => self.keep(&body, &mut state).map(String::into_bytes),
            _ => Err(Failure::input(format!("unknown request `{what}`"))),
        };
        answer.map_err(|failure| failure.to_string())
    }
}
