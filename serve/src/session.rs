//! One client's session, from hello to close.
//!
//! | module | part |
//! |---|---|
//! | `settings` | session settings from a hello |
//! | `character` | the server's character in a client's frames |
//! | `audio` | buffered samples and their pacing |
//! | `opus` | decoder of Opus packets |

mod audio;
mod character;
mod opus;
mod settings;

use std::sync::Arc;
use std::time::Duration;

use axum::extract::ws::{Message, WebSocket};
use futures_util::StreamExt;
use futures_util::stream::SplitStream;
use tokio::sync::watch;
use tokio::time::{Instant, MissedTickBehavior, interval, timeout};
use umo_core::{Engine, EngineError, Pose, Session, SessionError};

use crate::config::Config;
use crate::door::Lobby;
use crate::hub::{Hub, Phase, Place, Refusal};
use crate::metrics::Metrics;
use crate::protocol::{self, AudioKind, Code, FrameMessage, Hello, Output, PACKET, Ready, Reply, Request};
use crate::room::{Membership, Rooms};
use crate::socket::{Broken, Writer, Written, leave, next};
use audio::Audio;
use character::Character;
use opus::Packets;

/// Interval at which the engine is polled for output.
const TICK: Duration = Duration::from_millis(10);
/// Number of waiting frames from which a session in a room catches up.
const PILE: usize = 45;

/// State shared by all sessions of a server.
#[derive(Debug)]
pub(crate) struct Shared {
    pub(crate) config: Config,
    pub(crate) engine: Engine,
    pub(crate) hub: Arc<Hub>,
    pub(crate) lobby: Arc<Lobby>,
    pub(crate) rooms: Arc<Rooms>,
    /// Whether the server listens on loopback only.
    pub(crate) is_loopback: bool,
    pub(crate) metrics: Metrics,
}

/// Identity of a client.
#[derive(Debug)]
pub(crate) struct Client {
    /// Name of the token in the request, if it had one.
    pub(crate) name: Option<String>,
    pub(crate) address: String,
}

/// Reason why a session ended.
#[derive(Debug, PartialEq, Eq)]
enum End {
    /// The client closed, or its connection broke.
    Left,
    /// The server ends the session.
    Because(Code, String),
}

impl End {
    fn bad(reason: impl ToString) -> Self {
        Self::Because(Code::BadRequest, reason.to_string())
    }

    fn internal(reason: impl ToString) -> Self {
        Self::Because(Code::Internal, reason.to_string())
    }

    const fn word(&self) -> &'static str {
        match self {
            Self::Left => "closed",
            Self::Because(code, _) => code.name(),
        }
    }
}

impl From<Broken> for End {
    fn from(broken: Broken) -> Self {
        match broken {
            Broken::Lost => Self::Left,
            Broken::Invalid(code, reason) => Self::Because(code, reason),
        }
    }
}

impl From<Refusal> for End {
    fn from(refusal: Refusal) -> Self {
        match refusal {
            Refusal::Full { places } => {
                Self::Because(Code::Full, format!("all {places} sessions are taken: try another server, or later"))
            }
            Refusal::ClientLimit { places } => {
                Self::Because(Code::ClientLimit, format!("this client has its maximum of {places} sessions"))
            }
            Refusal::Draining => {
                Self::Because(Code::Draining, "the server stops: try another one, or later".to_owned())
            }
        }
    }
}

/// Serves one client; calls `admitted` once it has a slot.
pub(crate) async fn run(socket: WebSocket, client: Client, shared: Arc<Shared>, admitted: impl FnOnce()) {
    let (sink, mut stream) = socket.split();
    let writer = Writer::new(sink, shared.config.stall);
    let (end, has_begun) = match admit(&mut stream, &client, &shared).await {
        Ok((hello, place)) => {
            admitted();
            let end = with_place(&hello, &mut stream, &writer, &shared).await;
            // The slot is free for another client while this one is told why it is disconnected.
            drop(place);
            end
        }
        Err(end) => (end, false),
    };
    let closing = writer.finish().await;
    let end = match (end, closing.written) {
        (End::Left, Written::Stalled) => End::Because(Code::SlowReader, "the client does not read".to_owned()),
        (end, _) => end,
    };
    if has_begun {
        shared.metrics.ended(end.word());
    } else {
        shared.metrics.refused(end.word());
    }
    let is_closed = end == End::Left;
    if let End::Because(code, reason) = end {
        let error = Reply::Error { code: code.name(), reason: &reason }.text();
        closing.close(Some(error), code, &reason).await;
    }
    leave(stream, is_closed).await;
}

/// Reads the hello and takes a slot.
async fn admit(stream: &mut SplitStream<WebSocket>, client: &Client, shared: &Shared) -> Result<(Hello, Place), End> {
    let within = shared.config.hello_within;
    let late = |_| End::bad(format!("no hello within {} seconds", within.as_secs_f64()));
    let hello = timeout(within, first(stream)).await.map_err(late)??;
    let tokens = &shared.config.tokens;
    let name = if tokens.is_empty() {
        &client.address
    } else {
        let named = hello.token.as_deref().and_then(|token| tokens.name(token));
        let unknown = || End::Because(Code::Unauthorized, "token missing or unknown".to_owned());
        client.name.as_deref().or(named).ok_or_else(unknown)?
    };
    if hello.version != protocol::VERSION {
        return Err(End::bad(format!("version {}: this server speaks {}", hello.version, protocol::VERSION)));
    }
    let place = shared.hub.take(name)?;
    Ok((hello, place))
}

/// Reads the hello, which must be the first message except for pings.
async fn first(stream: &mut SplitStream<WebSocket>) -> Result<Hello, End> {
    loop {
        match next(stream).await? {
            Message::Text(text) => {
                return match Request::parse(&text).map_err(End::bad)? {
                    Request::Hello(hello) => Ok(hello),
                    _ => Err(End::bad("the first message must be a hello")),
                };
            }
            Message::Binary(_) => return Err(End::bad("the first message must be a hello, as text")),
            Message::Ping(_) | Message::Pong(_) => {}
            Message::Close(_) => return Err(End::Left),
        }
    }
}

/// Runs a session for a hello to its end; also returns whether it began.
async fn with_place(
    hello: &Hello,
    stream: &mut SplitStream<WebSocket>,
    writer: &Writer,
    shared: &Arc<Shared>,
) -> (End, bool) {
    let opus = match hello.audio {
        AudioKind::Pcm => Ok(None),
        AudioKind::Opus => Packets::new(hello.rate).map(Some),
    };
    let opus = match opus {
        Ok(opus) => opus,
        Err(wrong) => return (End::bad(wrong), false),
    };
    let begun = async { Ok((Character::of(hello, &shared.config)?, begin(hello, stream, shared).await?)) };
    let (character, session) = match begun.await {
        Ok((character, session)) => (character, Arc::new(session)),
        Err(end) => return (end, false),
    };
    let membership = hello.room.as_ref().map(|room| shared.rooms.join(room, hello.place, &session)).transpose();
    let membership = match membership {
        Ok(membership) => membership,
        Err(wrong) => return (End::bad(wrong), false),
    };
    shared.metrics.started.inc();
    let config = &shared.config;
    let mut live = Live {
        audio: Audio::new((hello.rate, opus), config.buffer, config.ahead, Instant::now()).skip(hello.skip),
        shared: Arc::clone(shared),
        rate: hello.rate,
        output: hello.output,
        floats: 0,
        wants_handover: hello.handover,
        wants_stats: false,
        speech: Speech::Open,
        saving: Saving::No,
        frames: 0,
        // A restored session includes the statistics of its previous server.
        late_frames: session.stats().late_frames,
        session,
        membership,
        packet: Vec::new(),
        character,
        heard: Instant::now(),
        active: Instant::now(),
    };
    let end = match live.ready(hello, writer).await {
        Ok(()) => live.run(stream, writer).await.unwrap_or_else(|end| end),
        Err(end) => end,
    };
    live.count_late();
    (end, true)
}

/// Creates the session, and restores a state if the hello announces one.
async fn begin(hello: &Hello, stream: &mut SplitStream<WebSocket>, shared: &Arc<Shared>) -> Result<Session, End> {
    let defaults = shared.config.session.as_ref();
    let settings = settings::of(hello, defaults, shared.engine.model()).map_err(End::bad)?;
    let maker = Arc::clone(shared);
    let made = tokio::task::spawn_blocking(move || maker.engine.session(&settings)).await.map_err(End::internal)?;
    let session = made.map_err(|error| match error {
        EngineError::Config(_) => End::bad(error),
        EngineError::Full { .. } => End::from(Refusal::Full { places: shared.config.sessions }),
        _ => End::internal(error),
    })?;
    if let Some(bytes) = hello.restore {
        let within = shared.config.hello_within;
        let late = |_| End::bad(format!("the state did not come within {} seconds", within.as_secs_f64()));
        let state = timeout(within, state(stream, bytes, session.state_size())).await.map_err(late)??;
        session.restore(&state).map_err(End::bad)?;
        shared.metrics.restored.inc();
    } else if let Some(mood) = hello.mood {
        session.set_mood(mood.0, hello.mood_strength).map_err(End::bad)?;
    }
    Ok(session)
}

/// Receives a state of `bytes` bytes in binary messages.
async fn state(stream: &mut SplitStream<WebSocket>, bytes: usize, most: usize) -> Result<Vec<u8>, End> {
    if bytes > most {
        return Err(End::bad(format!("restore {bytes}: a state of such a session has {most} bytes at most")));
    }
    let mut state = Vec::with_capacity(bytes);
    while state.len() < bytes {
        match next(stream).await? {
            Message::Binary(piece) if state.len() + piece.len() <= bytes => state.extend_from_slice(&piece),
            Message::Binary(_) => return Err(End::bad(format!("more than the {bytes} bytes of the state"))),
            Message::Text(_) => return Err(End::bad("the bytes of the state must come before anything else")),
            Message::Ping(_) | Message::Pong(_) => {}
            Message::Close(_) => return Err(End::Left),
        }
    }
    Ok(state)
}

/// Progress of a speech.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Speech {
    /// Audio may follow.
    Open,
    /// The client sent `finish`.
    Ending,
    /// The engine was told as well.
    Ended,
    /// All frames were sent.
    Done,
}

/// Whether a save of the state is pending, and for what purpose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Saving {
    No,
    Copy,
    Handover,
}

/// A running session.
#[derive(Debug)]
struct Live {
    session: Arc<Session>,
    /// Where the session sees others.
    membership: Option<Membership>,
    shared: Arc<Shared>,
    rate: usize,
    output: Output,
    /// Number of floats in a frame.
    floats: usize,
    wants_handover: bool,
    wants_stats: bool,
    audio: Audio,
    speech: Speech,
    saving: Saving,
    /// Frames sent.
    frames: u64,
    /// Late frames already counted in the metrics.
    late_frames: u64,
    /// Buffer for a packet.
    packet: Vec<u8>,
    /// The character, if the client shows it.
    character: Option<Character>,
    /// Time of the last message of any kind.
    heard: Instant,
    /// Time of the last audio, command or computation.
    active: Instant,
}

impl Live {
    async fn ready(&mut self, hello: &Hello, writer: &Writer) -> Result<(), End> {
        let model = self.shared.engine.model();
        let (config, latency) = (model.config(), self.session.latency());
        self.packet = vec![0; self.session.packet_size()];
        let face = config.face.names.len();
        let values = self.character.as_mut().map(|character| character.values(&Pose::REST, &vec![0.0; face]));
        self.floats = protocol::floats(face) + values.transpose()?.map_or(0, <[f32]>::len);
        let defaults = self.shared.config.session.as_ref().map_or(config.target, |session| session.avatar.target);
        let ready = Ready {
            version: protocol::VERSION,
            model: &config.name,
            rate: hello.rate,
            audio: hello.audio,
            output: hello.output,
            frame_rate: config.frame_rate,
            joints: umo_core::JOINTS,
            face: &config.face.names,
            floats: self.floats,
            chunk_frames: hello.target.unwrap_or(defaults) * config.keyframe_stride,
            latency_samples: latency.algorithmic_samples,
            mouth_samples: latency.mouth_samples,
            state_bytes: self.session.state_size(),
            note: hello.prompt.as_deref().and_then(|prompt| {
                let prompts = config.unknown_prompt(prompt)?;
                Some(format!("the model was not trained with the prompt `{prompt}`: {prompts}"))
            }),
        };
        self.say(writer, &Reply::Ready(ready)).await
    }

    async fn say(&self, writer: &Writer, reply: &Reply<'_>) -> Result<(), End> {
        if writer.send(Message::Text(reply.text().into())).await { Ok(()) } else { Err(End::Left) }
    }

    async fn run(&mut self, stream: &mut SplitStream<WebSocket>, writer: &Writer) -> Result<End, End> {
        let mut phase = self.shared.hub.phase();
        let mut tick = interval(TICK);
        tick.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let heartbeat = self.shared.config.heartbeat;
        let mut ping = Instant::now() + heartbeat;
        loop {
            tokio::select! {
                message = next(stream), if self.audio.has_room() => self.message(message?)?,
                _ = tick.tick() => {
                    let now = Instant::now();
                    if let Some(end) = self.turn(now, &mut phase, writer).await? {
                        return Ok(end);
                    }
                    if now >= ping {
                        ping = now + heartbeat;
                        // With a full queue, its messages show whether the client still reads.
                        if let Some(place) = writer.place() {
                            place.send(Message::Ping(Vec::new().into()));
                        }
                    }
                }
                () = writer.ended() => return Ok(End::Left),
            }
        }
    }

    /// Handles a message of the client.
    fn message(&mut self, message: Message) -> Result<(), End> {
        self.heard = Instant::now();
        match message {
            Message::Ping(_) | Message::Pong(_) => return Ok(()),
            Message::Close(_) => return Err(End::Left),
            Message::Binary(bytes) => {
                if self.speech != Speech::Open {
                    return Err(End::bad("audio after `finish`: `interrupt` starts a new stream"));
                }
                self.audio.extend(&bytes).map_err(End::bad)?;
            }
            Message::Text(text) => {
                let request = Request::parse(&text).map_err(End::bad)?;
                // A client that only asks for statistics is idle.
                let is_command = request != Request::Stats;
                self.request(request)?;
                if !is_command {
                    return Ok(());
                }
            }
        }
        self.active = self.heard;
        Ok(())
    }

    fn request(&mut self, request: Request) -> Result<(), End> {
        if self.output == Output::Packets
            && matches!(
                request,
                Request::Mood { .. } | Request::Gesture { .. } | Request::Words { .. } | Request::LookAt { .. }
            )
        {
            return Err(End::bad(settings::NOT_IN_PACKETS));
        }
        let session = &self.session;
        match request {
            Request::Hello(_) => return Err(End::bad("a second hello")),
            Request::Stats => self.wants_stats = true,
            Request::Finish if self.speech == Speech::Open => {
                self.audio.finish().map_err(End::bad)?;
                self.speech = Speech::Ending;
            }
            Request::Finish => {}
            Request::Lost { .. } if self.speech != Speech::Open => {
                return Err(End::bad("lost after `finish`: `interrupt` starts a new stream"));
            }
            Request::Lost { packets } => self.audio.lose(packets).map_err(End::bad)?,
            Request::Interrupt { ease } => {
                let ease = Duration::try_from_secs_f64(ease).map_err(End::bad)?;
                session.interrupt(ease).map_err(of_session)?;
                self.audio.clear();
                self.speech = Speech::Open;
            }
            Request::Mood { mood, strength } => session.set_mood(mood.0, strength).map_err(of_session)?,
            Request::Gesture { name, at, speed, strength, side, target, variant } => {
                let options = protocol::gesture_options(at, (speed, strength), side, target, variant);
                session.play_gesture(&name, &options).map_err(of_session)?;
            }
            Request::Words { text, start, end } => session.hint_words(&text, start, end).map_err(of_session)?,
            Request::LookAt { point, strength } => session.look_at(point, strength).map_err(of_session)?,
            Request::Place { place } => {
                let Some(membership) = &self.membership else { return Err(End::bad("place: only in a room")) };
                membership.place(place).map_err(End::bad)?;
            }
            Request::Save if self.saving == Saving::No => self.saving = Saving::Copy,
            Request::Save => {}
        }
        Ok(())
    }

    /// Does one tick's work; returns the reason if the session is over.
    async fn turn(
        &mut self,
        now: Instant,
        phase: &mut watch::Receiver<Phase>,
        writer: &Writer,
    ) -> Result<Option<End>, End> {
        let phase = *phase.borrow_and_update();
        if matches!(phase, Phase::Draining(_)) && self.wants_handover {
            self.saving = Saving::Handover;
        }
        if self.saving == Saving::No {
            self.push(now)?;
            self.pull(now, writer)?;
            if std::mem::take(&mut self.wants_stats) {
                self.say(writer, &self.stats()).await?;
            }
            if self.speech == Speech::Ended && self.session.is_done().or_else(later(false))? {
                self.speech = Speech::Done;
                let late_frames = self.session.stats().late_frames;
                self.say(writer, &Reply::Done { frames: self.frames, late_frames }).await?;
            }
        } else if self.save(writer).await? {
            self.active = now;
            if self.saving == Saving::Handover {
                self.shared.metrics.handed_over.inc();
                let reason = "the server stops: restore the state elsewhere".to_owned();
                return Ok(Some(End::Because(Code::Draining, reason)));
            }
            self.saving = Saving::No;
        }
        self.count_late();
        if let Phase::Draining(deadline) = phase
            && (now >= deadline || self.speech == Speech::Done)
        {
            return Ok(Some(End::Because(Code::Draining, "the server stops".to_owned())));
        }
        Ok(self.overdue(now))
    }

    /// Pushes the audio that the pacing allows to the engine.
    fn push(&mut self, now: Instant) -> Result<(), End> {
        let Self { audio, session, .. } = self;
        let taken = audio.push(now, |samples| match session.push_audio_i16(samples) {
            Ok(pushed) => Ok(pushed.taken),
            Err(error) => later(0)(error),
        })?;
        self.shared.metrics.took(taken, self.rate);
        if taken > 0 {
            self.active = now;
        }
        if self.speech == Speech::Ending && self.audio.is_empty() {
            match self.session.finish() {
                Ok(()) => self.speech = Speech::Ended,
                Err(error) => later(())(error)?,
            }
        }
        Ok(())
    }

    /// Number of frames that may be sent: in a room as many as it has ticked, and twice as many while they pile up.
    fn most_frames(&mut self, now: Instant) -> Result<usize, End> {
        let Some(membership) = &mut self.membership else { return Ok(usize::MAX) };
        let due = membership.due(now);
        if due > 0 && membership.has_company() {
            // Who listens to others is not idle.
            self.active = now;
        }
        let is_behind = self.session.ready_frames().or_else(later(0))? > PILE;
        Ok(if is_behind { 2 * due } else { due })
    }

    /// Queues available output while the queue has room.
    fn pull(&mut self, now: Instant, writer: &Writer) -> Result<(), End> {
        let mut most = self.most_frames(now)?;
        let metrics = &self.shared.metrics;
        while most > 0
            && let Some(place) = writer.place()
        {
            let bytes = match self.output {
                Output::Frames => {
                    let Some((bytes, count)) = pull_frames(&self.session, (self.floats, most), &mut self.character)?
                    else {
                        break;
                    };
                    most = most.saturating_sub(usize::try_from(count).unwrap_or(usize::MAX));
                    self.frames += count;
                    metrics.frames.inc_by(count);
                    bytes
                }
                Output::Packets => {
                    let mut length = [0];
                    if self.session.pull_packets(&mut self.packet, &mut length).or_else(later(0))? == 0 {
                        break;
                    }
                    metrics.packets.inc();
                    std::iter::once(PACKET).chain(self.packet[..length[0]].iter().copied()).collect()
                }
            };
            metrics.sent(bytes.len());
            place.send(Message::Binary(bytes.into()));
        }
        Ok(())
    }

    /// Sends the state; returns `false` if another call on the session is in progress.
    async fn save(&self, writer: &Writer) -> Result<bool, End> {
        let mut bytes = vec![0; self.session.state_size()];
        let length = match self.session.save(&mut bytes) {
            Ok(length) => length,
            Err(error) => return later(false)(error),
        };
        let is_handover = self.saving == Saving::Handover;
        self.say(writer, &Reply::State { samples: self.audio.used, bytes: length, is_handover }).await?;
        for message in protocol::state_messages(&bytes[..length]) {
            self.shared.metrics.sent(message.len());
            if !writer.send(Message::Binary(message.into())).await {
                return Err(End::Left);
            }
        }
        Ok(true)
    }

    fn stats(&self) -> Reply<'static> {
        let (latency, stats) = (self.session.latency(), self.session.stats());
        Reply::Stats {
            samples: self.audio.used,
            chunks: stats.chunks,
            late_frames: stats.late_frames,
            compute_p50: latency.compute_p50.as_secs_f64(),
            compute_p99: latency.compute_p99.as_secs_f64(),
            compute_max: latency.compute_max.as_secs_f64(),
        }
    }

    fn count_late(&mut self) {
        let late_frames = self.session.stats().late_frames;
        self.shared.metrics.late_frames.inc_by(late_frames.saturating_sub(self.late_frames));
        self.late_frames = late_frames;
    }

    /// Returns the reason to end the session if the client is silent or idle.
    fn overdue(&mut self, now: Instant) -> Option<End> {
        let Config { heartbeat, idle, .. } = self.shared.config;
        if !self.audio.has_room() {
            // Reading is paused.
            (self.heard, self.active) = (now, now);
        } else if now - self.heard > 2 * heartbeat {
            let reason =
                format!("nothing received for {} seconds, not even an answer to a ping", 2 * heartbeat.as_secs());
            return Some(End::Because(Code::Silent, reason));
        } else if now - self.active > idle {
            let reason = format!("no audio and no command for {} seconds", idle.as_secs_f64());
            return Some(End::Because(Code::Idle, reason));
        }
        None
    }
}

/// Returns a message of the available frames and their number, if there are any.
fn pull_frames(
    session: &Session,
    (floats, most): (usize, usize),
    character: &mut Option<Character>,
) -> Result<Option<(Vec<u8>, u64)>, End> {
    let most = protocol::frames_at_once(floats).min(most);
    let (mut message, mut added) = (None, Ok(()));
    let pulled = session.pull_frames(most, |frame| {
        let message = message.get_or_insert_with(|| FrameMessage::new(floats, most));
        match character.as_mut().map_or(Ok(&[][..]), |character| character.values(frame.pose, frame.face)) {
            Ok(values) => message.push(&frame, values),
            Err(end) => added = Err(end),
        }
    });
    pulled.or_else(later(0))?;
    added?;
    Ok(message.map(FrameMessage::finish))
}

/// Maps a busy error to `nothing`, so that the call is repeated later; other errors end the session.
fn later<T>(nothing: T) -> impl FnOnce(SessionError) -> Result<T, End> {
    move |error| match error {
        SessionError::Busy(_) => Ok(nothing),
        error => Err(of_session(error)),
    }
}

/// Attributes an error to the client or to the server.
fn of_session(error: SessionError) -> End {
    match error {
        SessionError::Range(_)
        | SessionError::UnknownGesture
        | SessionError::GesturesFull
        | SessionError::HintsFull
        | SessionError::WordsFull => End::bad(error),
        _ => End::internal(error),
    }
}
