//! `umo view --live`: serves the page on loopback and streams a recording or a browser's microphone through an engine.
//!
//! | module | part |
//! | --- | --- |
//! | `http` | request handling |
//! | `visitor` | one page's stream |
//! | `message` | messages between page and program |

mod http;
mod message;
mod visitor;

use std::io;
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use umo_core::engine::{Engine, EngineConfig, Threads};
use umo_core::glb::Follower;
use umo_core::model::Model;
use umo_core::motion::clip::Clip;
use umo_core::session::{MAX_RATE, MIN_RATE, SessionConfig, Voice};
use umo_core::{Config, Precision};

use super::scene::{self, Audio, LiveInfo, Scene};
use super::{browser, page};
use crate::args::{GenerateArgs, Page, VoiceArg};
use crate::failure::Failure;
use crate::retarget::Wearer;
use crate::speech::Speech;
use crate::{animate, interrupt, model};
use http::{Answer, Request};

/// Upper bound on simultaneous streams.
const MAX_STREAMS: usize = 4;
/// Upper bound on simultaneous connections, including those that only fetch the page.
const MAX_CONNECTIONS: usize = 16;
/// Interval between polls for connections.
const LOOK: Duration = Duration::from_millis(20);
/// Resampling target for recordings with a rate that sessions do not accept.
const OTHER_RATE: usize = 48_000;

/// State shared by all visitors.
pub(super) struct Host<'a> {
    engine: Engine,
    session: SessionConfig,
    /// Requested timing of the mouth, if any.
    voice: Option<VoiceArg>,
    args: &'a Page,
    audio: Option<Audio>,
    /// Sample rate, and mono samples.
    recording: Option<(usize, Vec<f32>)>,
    shown: Mutex<Shown>,
    port: u16,
    streams: AtomicUsize,
    stop: Arc<AtomicBool>,
}

/// The page, and the character on it.
#[derive(Clone)]
struct Shown {
    page: Arc<str>,
    follower: Option<Arc<Follower>>,
}

/// Serves until Ctrl-C.
pub(super) fn run(args: &Page) -> Result<(), Failure> {
    if args.generate.start_pose.is_some() {
        return Err(Failure::input("--start-pose does not go with --live"));
    }
    if args.mapping.is_some() && args.onto.is_none() {
        return Err(Failure::input("--mapping goes with a character: --onto"));
    }
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, args.port.unwrap_or(0)))
        .map_err(|error| Failure::environment(format!("cannot listen at port {}: {error}", args.port.unwrap_or(0))))?;
    let host = Host::new(args, &listener)?;
    let address = format!("http://127.0.0.1:{}/", host.port);
    println!("{address} (Ctrl-C ends it)");
    if !args.no_open {
        browser::open(&address);
    }
    host.serve(&listener).map_err(Failure::environment)
}

impl<'a> Host<'a> {
    fn new(args: &'a Page, listener: &TcpListener) -> Result<Self, Failure> {
        let speech = args.input.as_deref().map(|path| Speech::open(path, args.repair)).transpose()?;
        let audio = speech.as_ref().map(Audio::new).transpose()?;
        let session_samples = |speech: Speech| {
            let rate = session_rate(speech.sample_rate());
            speech.mono(rate).map(|samples| (rate, samples))
        };
        let recording = speech.map(session_samples).transpose()?;
        let wearer = scene::wearer(args)?;
        let file = model::open(args.generate.model.as_deref())?;
        let isa = model::isa(&args.generate.compute)?;
        let loaded = Arc::new(Model::load(&file, args.generate.compute.precision(Precision::Stored), isa)?);
        drop(file);
        let threads = Threads::Own(model::threads(&args.generate.compute)?);
        let config =
            EngineConfig { threads, max_sessions: MAX_STREAMS + 1, max_batch: MAX_STREAMS, ..EngineConfig::default() };
        let engine = Engine::new(loaded, &config).map_err(Failure::input)?;
        check_voice(args, engine.model())?;
        let session = session(&args.generate, engine.model().config());
        let shown = Mutex::new(Shown::new(args, (&engine, &session), audio.as_ref(), wearer)?);
        Ok(Self {
            engine,
            session,
            voice: args.voice,
            args,
            audio,
            recording,
            shown,
            port: listener.local_addr().map_err(Failure::environment)?.port(),
            streams: AtomicUsize::new(0),
            stop: interrupt::stop(),
        })
    }

    fn shown(&self) -> Shown {
        self.shown.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Shows a character sent by a page; returns the reason if it cannot be shown.
    fn put_on(&self, file: Vec<u8>) -> Result<(), Failure> {
        let wearer = Wearer::dropped(file)?;
        let shown = Shown::new(self.args, (&self.engine, &self.session), self.audio.as_ref(), Some(wearer))?;
        *self.shown.lock().unwrap_or_else(PoisonError::into_inner) = shown;
        Ok(())
    }

    /// Accepts connections, one thread each, until stopped.
    fn serve(&self, listener: &TcpListener) -> io::Result<()> {
        listener.set_nonblocking(true)?;
        let connections = AtomicUsize::new(0);
        std::thread::scope(|scope| {
            while !self.is_over() {
                let stream = match listener.accept() {
                    Ok((stream, _)) => stream,
                    // No connection, or one that was closed immediately.
                    Err(_) => {
                        std::thread::sleep(LOOK);
                        continue;
                    }
                };
                if connections.fetch_add(1, Ordering::SeqCst) >= MAX_CONNECTIONS {
                    connections.fetch_sub(1, Ordering::SeqCst);
                    continue;
                }
                let connections = &connections;
                scope.spawn(move || {
                    // A dropped connection does not affect other visitors.
                    let _ = self.answer(stream);
                    connections.fetch_sub(1, Ordering::SeqCst);
                });
            }
        });
        Ok(())
    }

    /// Returns the timing of the mouth in a stream from the microphone or a recording.
    fn voice(&self, is_microphone: bool) -> Voice {
        let is_live = self.voice.map_or(is_microphone, |voice| voice == VoiceArg::Live);
        if is_live && self.engine.model().mouth().is_some() { Voice::Live } else { Voice::Delayed }
    }

    /// Whether the server is to stop.
    fn is_over(&self) -> bool {
        self.stop.load(Ordering::SeqCst)
    }

    fn answer(&self, mut stream: TcpStream) -> io::Result<()> {
        stream.set_nonblocking(false)?;
        stream.set_nodelay(true)?;
        let Some((head, length)) = http::peek_head(&stream, || self.is_over())? else {
            return http::refuse(&mut stream, 0, "400 Bad Request");
        };
        match Request::parse(&head).map_or(Answer::Refuse("400 Bad Request"), |request| request.answer(self.port)) {
            Answer::Page => http::send_page(&mut stream, length, &self.shown().page),
            Answer::Character(size) => {
                let file = http::body(&mut stream, length, size)?;
                match self.put_on(file) {
                    Ok(()) => http::tell(&mut stream, 0, "200 OK", "reload the page"),
                    Err(failure) => http::tell(&mut stream, 0, "422 Unprocessable Content", &failure.to_string()),
                }
            }
            Answer::Refuse(status) => http::refuse(&mut stream, length, status),
            Answer::Stream if self.streams.fetch_add(1, Ordering::SeqCst) >= MAX_STREAMS => {
                self.streams.fetch_sub(1, Ordering::SeqCst);
                http::refuse(&mut stream, length, "503 Service Unavailable")
            }
            Answer::Stream => {
                visitor::run(self, stream);
                self.streams.fetch_sub(1, Ordering::SeqCst);
                Ok(())
            }
        }
    }
}

impl Shown {
    fn new(
        args: &Page,
        (engine, session): (&Engine, &SessionConfig),
        audio: Option<&Audio>,
        wearer: Option<Wearer>,
    ) -> Result<Self, Failure> {
        let title = args.input.as_deref().map_or_else(|| "microphone".to_owned(), |path| path.display().to_string());
        let live = rest(engine, session)?;
        let config = engine.model().config();
        let mut still = Clip::new(config);
        still.push(&live.rest, &live.rest_face);
        let (character, follower) = wearer.map(|wearer| wearer.follow(&still)).transpose()?.unzip();
        let mut scene = Scene::of_stream(&title, config, args, live, character)?;
        scene.audio = audio.cloned();
        Ok(Self { page: page::html(&scene)?.into(), follower: follower.map(Arc::new) })
    }
}

/// Returns the rate at which a recording is pushed to a session.
pub(crate) fn session_rate(rate: usize) -> usize {
    if (MIN_RATE..=MAX_RATE).contains(&rate) { rate } else { OTHER_RATE }
}

/// Refuses `--voice live` for a model without a mouth network.
pub(super) fn check_voice(args: &Page, model: &Model) -> Result<(), Failure> {
    match args.voice {
        Some(VoiceArg::Live) if model.mouth().is_none() => {
            Err(Failure::input("--voice live needs a model with a mouth network: see `umo inspect`"))
        }
        _ => Ok(()),
    }
}

/// Default keyframes per chunk of a live stream: the lowest latency at which the model's own lookahead
/// keeps the seams smooth.
const LIVE_TARGET: usize = 1;

pub(super) fn session(generate: &GenerateArgs, config: &Config) -> SessionConfig {
    let mut avatar = animate::avatar(generate, config, 0);
    avatar.target = generate.target.unwrap_or(LIVE_TARGET);
    SessionConfig { avatar, ..SessionConfig::new(config) }
}

/// Returns the pose that a page shows before its stream begins, and the stream's algorithmic latency.
pub(super) fn rest(engine: &Engine, config: &SessionConfig) -> Result<LiveInfo, Failure> {
    let session = engine.session(config).map_err(Failure::input)?;
    let algorithmic = session.latency().algorithmic_samples as f64 / config.sample_rate as f64;
    let mut rest = None;
    session.sample_pose(0.0, |frame| rest = Some((*frame.pose, frame.face.to_vec()))).map_err(Failure::environment)?;
    let (rest, rest_face) = rest.ok_or_else(|| Failure::environment("internal: a session without a pose"))?;
    Ok(LiveInfo { algorithmic_seconds: algorithmic, rest, rest_face, engine: None })
}

#[cfg(test)]
mod tests;
