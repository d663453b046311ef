//! One page's stream: audio in, frames out, in real time.

use std::io::Read;
use std::net::TcpStream;
use std::sync::Arc;
use std::time::{Duration, Instant};

use tungstenite::protocol::frame::coding::CloseCode;
use tungstenite::protocol::{CloseFrame, WebSocketConfig};
use tungstenite::{Error, Message, WebSocket};
use umo_core::{Session, SessionConfig, SessionError, Voice};
use umo_core_rig::glb::{FollowScratch, Follower};

use super::Host;
use super::http::is_wait;
use super::message::{self, Command, Frames, MAX_BYTES, MAX_SAMPLES, News, Source};

/// Time limit for a read from the page, after which frames are checked.
const LOOK: Duration = Duration::from_millis(4);
/// Interval of status messages to the page.
const NEWS: Duration = Duration::from_millis(250);
/// Time limit for the closing handshake.
const GOODBYE: Duration = Duration::from_secs(1);
/// Upper bound on the bytes of a close reason.
const MAX_REASON: usize = 120;

/// Reason why a stream ends.
enum End {
    /// The page has disconnected.
    Left,
    /// Everything was sent.
    Done,
    /// The program is stopping.
    Over,
    /// The page's request is invalid.
    Refused(String),
    /// The engine has failed.
    Failed(String),
}

impl From<Error> for End {
    fn from(error: Error) -> Self {
        match error {
            Error::Capacity(problem) => Self::Refused(problem.to_string()),
            Error::Utf8(problem) => Self::Refused(problem),
            Error::Protocol(problem) => Self::Refused(problem.to_string()),
            _ => Self::Left,
        }
    }
}

impl From<SessionError> for End {
    fn from(error: SessionError) -> Self {
        Self::Failed(error.to_string())
    }
}

/// A running stream.
struct Stream<'a> {
    session: Session,
    /// Computes the character's channels of each frame, with scratch memory.
    follower: Option<(Arc<Follower>, FollowScratch)>,
    voice: Voice,
    source: Source,
    /// Remaining samples of the recording.
    rest: &'a [f32],
    rate: usize,
    pushed: usize,
    start: Instant,
    reported: Instant,
    finished: bool,
    frames: u64,
}

/// Serves one page until its stream or the program ends.
pub(super) fn run(host: &Host<'_>, stream: TcpStream) {
    let limits = WebSocketConfig::default()
        .max_message_size(Some(MAX_BYTES))
        .max_frame_size(Some(MAX_BYTES))
        .max_write_buffer_size(64 << 20);
    let _ = stream.set_read_timeout(Some(GOODBYE));
    let Ok(mut socket) = tungstenite::accept_with_config(stream, Some(limits)) else { return };
    let _ = socket.get_ref().set_read_timeout(Some(LOOK));
    let end = talk(host, &mut socket);
    let (code, reason) = match end {
        End::Left => return,
        End::Done => (CloseCode::Normal, String::new()),
        End::Over => (CloseCode::Away, "the program has ended".to_owned()),
        End::Refused(reason) => (CloseCode::Policy, reason),
        End::Failed(reason) => (CloseCode::Error, reason),
    };
    part(&mut socket, code, &reason);
}

/// Closes the connection and waits for the page's close.
fn part(socket: &mut WebSocket<TcpStream>, code: CloseCode, reason: &str) {
    if !reason.is_empty() {
        let _ = socket.send(Message::text(News::Error { reason }.json()));
    }
    let end = reason.char_indices().map(|(at, c)| at + c.len_utf8()).take_while(|&end| end <= MAX_REASON).last();
    let reason = reason[..end.unwrap_or(0)].into();
    let _ = socket.close(Some(CloseFrame { code, reason }));
    let start = Instant::now();
    while start.elapsed() < GOODBYE {
        match socket.read() {
            Ok(_) => {}
            Err(Error::Io(error)) if is_wait(&error) => {}
            Err(Error::Io(_) | Error::ConnectionClosed | Error::AlreadyClosed) => return,
            Err(_) => return drain(socket.get_mut(), start),
        }
    }
}

/// Discards the rest of a refused message: unread bytes would make the system reset the
/// connection before the page has read the reason.
fn drain(stream: &mut TcpStream, start: Instant) {
    let mut unread = [0; 1 << 12];
    while start.elapsed() < GOODBYE {
        match stream.read(&mut unread) {
            Ok(0) => return,
            Ok(_) => {}
            Err(error) if is_wait(&error) => {}
            Err(_) => return,
        }
    }
}

fn talk(host: &Host<'_>, socket: &mut WebSocket<TcpStream>) -> End {
    let mut stream = None;
    loop {
        if host.is_over() {
            return End::Over;
        }
        let step = match socket.read() {
            Ok(message) => handle(host, socket, &mut stream, &message),
            Err(Error::Io(error)) if is_wait(&error) => Ok(()),
            Err(error) => Err(error.into()),
        };
        let step = step.and_then(|()| stream.as_mut().map_or(Ok(()), |stream: &mut Stream| stream.step(socket)));
        if let Err(end) = step {
            return end;
        }
    }
}

/// Executes a message of the page.
fn handle<'a>(
    host: &'a Host<'_>,
    socket: &mut WebSocket<TcpStream>,
    stream: &mut Option<Stream<'a>>,
    said: &Message,
) -> Result<(), End> {
    match (said, stream) {
        (Message::Text(text), stream) => match (message::command(text).map_err(End::Refused)?, stream.as_mut()) {
            (Command::Start { .. }, Some(_)) => Err(End::Refused("a stream is under way".to_owned())),
            (Command::Start { source, rate }, None) => {
                let started = stream.insert(Stream::start(host, source, rate)?);
                Ok(socket.send(Message::text(started.started().json()))?)
            }
            (Command::Finish, Some(stream)) => stream.finish(),
            (Command::Finish, None) => Err(End::Refused("no stream is under way".to_owned())),
        },
        (Message::Binary(bytes), Some(stream)) if stream.source != Source::Recording && !stream.finished => {
            stream.push(&message::samples(bytes).map_err(End::Refused)?)
        }
        (Message::Binary(_), _) => Err(End::Refused(
            "samples are only accepted after a start with the microphone or a recording of the page".to_owned(),
        )),
        (Message::Close(_), _) => Err(End::Left),
        (Message::Ping(_) | Message::Pong(_) | Message::Frame(_), _) => Ok(()),
    }
}

impl<'a> Stream<'a> {
    fn start(host: &'a Host<'_>, source: Source, rate: Option<u32>) -> Result<Self, End> {
        let (rate, rest) = match (source, &host.recording) {
            (Source::Microphone | Source::Page, _) => (rate.unwrap_or_default() as usize, &[][..]),
            (Source::Recording, Some((rate, samples))) => (*rate, &samples[..]),
            (Source::Recording, None) => return Err(End::Refused("there is no recording".to_owned())),
        };
        let voice = host.voice(source == Source::Microphone);
        let config = SessionConfig { sample_rate: rate, voice, ..host.session.clone() };
        let session = host.engine.session(&config).map_err(|error| End::Failed(error.to_string()))?;
        let now = Instant::now();
        Ok(Self {
            session,
            follower: host.shown().follower.map(|follower| (Arc::clone(&follower), follower.scratch())),
            voice,
            source,
            rest,
            rate,
            pushed: 0,
            start: now,
            reported: now,
            finished: false,
            frames: 0,
        })
    }

    fn started(&self) -> News<'static> {
        let latency = self.session.latency();
        let seconds = |samples: usize| samples as f64 / self.rate as f64;
        News::Started {
            live: self.voice == Voice::Live,
            mouth_seconds: seconds(latency.mouth_samples),
            body_seconds: seconds(latency.algorithmic_samples),
        }
    }

    fn push(&mut self, samples: &[f32]) -> Result<(), End> {
        self.session.push_audio(samples)?;
        Ok(())
    }

    fn finish(&mut self) -> Result<(), End> {
        self.finished = true;
        Ok(self.session.finish()?)
    }

    /// Pushes the recording up to the current time and sends the available frames.
    fn step(&mut self, socket: &mut WebSocket<TcpStream>) -> Result<(), End> {
        if self.source == Source::Recording && !self.finished {
            self.hear_recording()?;
        }
        let mut frames = Frames::default();
        let mut worn = Vec::new();
        let mut failed = None;
        self.frames += self.session.pull_frames(usize::MAX, |frame| {
            worn.clear();
            if let Some((follower, scratch)) = &mut self.follower {
                failed = follower.add(scratch, frame.pose, frame.face, &mut worn).err().or(failed);
            }
            frames.add(frame, &worn);
        })? as u64;
        if let Some(error) = failed {
            return Err(End::Failed(error.to_string()));
        }
        if let Some(message) = frames.message() {
            socket.send(Message::binary(message))?;
        }
        let done = self.finished && self.session.is_done()?;
        if done || self.reported.elapsed() >= NEWS {
            self.reported = Instant::now();
            socket.send(Message::text(News::status(&self.session.latency(), &self.session.stats()).json()))?;
        }
        if done {
            socket.send(Message::text(News::Done { frames: self.frames }.json()))?;
            return Err(End::Done);
        }
        Ok(())
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "samples since the start")]
    fn hear_recording(&mut self) -> Result<(), End> {
        let spoken = (self.start.elapsed().as_secs_f64() * self.rate as f64) as usize;
        let count = (spoken - self.pushed.min(spoken)).min(self.rest.len()).min(MAX_SAMPLES);
        let taken = self.session.push_audio(&self.rest[..count])?.taken;
        self.rest = &self.rest[taken..];
        self.pushed += taken;
        if self.rest.is_empty() { self.finish() } else { Ok(()) }
    }
}
