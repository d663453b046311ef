//! The page of `umo live`, served on loopback by the server of `umo serve`, which also runs its streams.

use std::fmt;
use std::net::SocketAddr;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use umo_core_rig::glb::Follower;
use umo_serve::Config;

use super::stream::{self, StreamPage};
use super::{browser, page, scene};
use crate::args::Live;
use crate::failure::Failure;
use crate::retarget::Wearer;
use crate::{animate, model, serve};

/// Upper bound on simultaneous streams.
const MAX_STREAMS: usize = 4;

/// Serves until Ctrl-C.
pub(crate) fn run(args: &Live) -> Result<(), Failure> {
    check(args)?;
    let wearer = scene::wearer(&args.shown)?;
    let loaded = model::load(&args.engine.compute)?;
    let mut session = stream::session(&args.generate, loaded.config());
    if let Some(text) = &args.prompt {
        session.avatar.text = animate::prompt(&loaded, text)?;
        session.avatar.template = animate::named(loaded.config(), &session.avatar.template, true)?;
    }
    let input = args.input.as_deref().map(|path| (path, args.repair));
    let look = (args.voice, args.shown.figure.unwrap_or_default());
    let host = Host::new(StreamPage::new(input, Arc::clone(&loaded), session.clone(), look)?, wearer)?;
    let mut engine = model::engine_config(&args.engine)?;
    engine.max_batch = engine.max_batch.min(MAX_STREAMS);
    let config = Config {
        sessions: MAX_STREAMS,
        per_client: MAX_STREAMS,
        engine,
        session: Some(session),
        page: Some(Arc::new(host)),
        drain: Duration::ZERO,
        ..Config::default()
    };
    let ready = |address: SocketAddr| {
        println!("http://{address}/ (Ctrl-C ends it)");
        if !args.shown.no_open {
            browser::open(&format!("http://{address}/"));
        }
    };
    let port = args.port.unwrap_or(0);
    umo_serve::run(&format!("127.0.0.1:{port}"), config, loaded, ready)
        .map_err(|error| serve::failure(&error, &format!("--port {port}")))
}

/// Refuses options that the streams of a page do not support.
fn check(args: &Live) -> Result<(), Failure> {
    args.words.refuse_with("the page of `umo live`: give --vmc or --livelink, or see `umo view`")?;
    let generate = &args.generate;
    let given = [
        ("--start-pose", generate.start_pose.is_some()),
        ("--gesture", !generate.gesture.is_empty()),
        ("--gesture-clip", !generate.gesture_clip.is_empty()),
    ];
    if let Some((name, _)) = given.iter().find(|(_, given)| *given) {
        return Err(Failure::input(format!("{name} does not go with the page of `umo live`")));
    }
    if args.input.as_deref() == Some(Path::new("-")) {
        return Err(Failure::input("`-`: standard input goes with --vmc or --livelink; the page hears a microphone"));
    }
    args.shown.check()
}

/// The page, with the character that was put on last.
struct Host {
    page: StreamPage,
    shown: Mutex<Shown>,
}

#[derive(Clone)]
struct Shown {
    html: Arc<str>,
    follower: Option<Arc<Follower>>,
}

impl Host {
    fn new(page: StreamPage, wearer: Option<Wearer>) -> Result<Self, Failure> {
        let shown = Mutex::new(Shown::new(&page, wearer)?);
        Ok(Self { page, shown })
    }

    fn shown(&self) -> Shown {
        self.shown.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

impl Shown {
    fn new(page: &StreamPage, wearer: Option<Wearer>) -> Result<Self, Failure> {
        let (scene, follower) = page.scene(wearer)?;
        Ok(Self { html: page::html(&scene)?.into(), follower: follower.map(Arc::new) })
    }
}

impl fmt::Debug for Host {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Host").field("title", &self.page.title).finish_non_exhaustive()
    }
}

impl umo_serve::Page for Host {
    fn html(&self) -> Arc<str> {
        self.shown().html
    }

    fn follower(&self) -> Option<Arc<Follower>> {
        self.shown().follower
    }

    fn put_on(&self, file: Vec<u8>) -> Result<(), String> {
        let worn = Wearer::dropped(file).and_then(|wearer| Shown::new(&self.page, Some(wearer)));
        *self.shown.lock().unwrap_or_else(PoisonError::into_inner) = worn.map_err(|failure| failure.to_string())?;
        Ok(())
    }
}
