//! Measures the speed of a model in a real engine.

use std::fmt;
use std::sync::Arc;
use std::time::{Duration, Instant};

use umo_core::{Config, Engine, EngineConfig, EngineError, Model, Session, SessionConfig, SessionError, Threads};

use crate::voice;

/// Polling interval as a share of the time waited so far, with `SHORTEST_LOOK` as its lower bound: polling thousands
/// of times a second would disturb the engine.
const LOOK_SHARE: u32 = 50;
const SHORTEST_LOOK: Duration = Duration::from_micros(100);
/// Timeout of a chunk.
const PATIENCE: Duration = Duration::from_secs(120);
/// Pushes per second in real time, 10 ms of audio each.
const CALLS_PER_SECOND: usize = 100;
/// Avatars of a self-test, and the duration of their speech in seconds.
const SESSIONS: usize = 4;
const SECONDS: f64 = 2.5;
/// Number of first frames, and of chunks, that a self-test measures.
const STARTS: usize = 5;

/// Reason why the speed was not measured.
#[derive(Debug)]
pub enum SpeedError {
    /// The engine or a session could not be created.
    Engine(EngineError),
    /// A call on a session failed.
    Session(SessionError),
    /// The audio queue was full: the engine does not keep up.
    Behind,
    /// No frame arrived.
    Silent,
}

impl fmt::Display for SpeedError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Engine(error) => error.fmt(f),
            Self::Session(error) => error.fmt(f),
            Self::Behind => f.write_str("the engine does not keep up with one avatar"),
            Self::Silent => write!(f, "no frame after {} s", PATIENCE.as_secs()),
        }
    }
}

impl std::error::Error for SpeedError {}

/// Speed of a model, as medians.
#[derive(Clone, Copy, Debug)]
pub struct Speed {
    /// Number of engine threads.
    pub threads: usize,
    /// Time from a chunk of audio to the first frame of a stream.
    pub first: Duration,
    /// Time to compute a chunk.
    pub chunk: Duration,
    /// Duration of the motion of a chunk.
    pub motion: Duration,
    /// Number of avatars that could speak at once.
    pub avatars: usize,
}

/// Measures a model, for a few seconds.
///
/// # Errors
/// [`SpeedError`] if the engine cannot be created or returns no frames.
pub fn measure(model: &Arc<Model>, threads: usize) -> Result<Speed, SpeedError> {
    let config = EngineConfig { threads: Threads::Own(threads), max_sessions: SESSIONS + 1, ..EngineConfig::default() };
    let engine = Engine::new(Arc::clone(model), &config).map_err(SpeedError::Engine)?;
    let runner = Runner::new(engine, SessionConfig::new(model.config()));
    let first = quantile(&runner.first_frames(STARTS)?, 0.5);
    let chunk = quantile(&runner.chunks(STARTS)?.0, 0.5);
    let motion = Duration::from_secs_f64(runner.chunk() as f64 / model.config().audio.sample_rate as f64);
    let avatars = runner.crowd(SESSIONS, SECONDS)?.at_full_load();
    Ok(Speed { threads, first, chunk, motion, avatars })
}

/// Measurement of several avatars in real time.
#[derive(Debug)]
pub struct Crowd {
    /// Number of avatars.
    pub sessions: usize,
    /// Duration of their speech.
    pub seconds: f64,
    /// Number of frames of all avatars.
    pub frames: u64,
    /// Number of late frames.
    pub late: u64,
    /// Number of chunks with a frozen body.
    pub held: u64,
    /// Number of pushes that found the audio queue full.
    pub overruns: u64,
    /// Median latency of a chunk, of the slowest avatar; the next two fields likewise.
    pub p50: Duration,
    /// The 99th percentile.
    pub p99: Duration,
    /// Maximum.
    pub max: Duration,
    /// Share of the time in which the engine computed.
    pub busy: f64,
}

impl Crowd {
    /// Number of avatars at full load, if each takes the share that it takes now; in larger batches, each takes less.
    pub fn at_full_load(&self) -> usize {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a number of avatars")]
        let count = (self.sessions as f64 / self.busy.max(1e-6)) as usize;
        count
    }
}

/// The quantile `share` of `times`.
pub fn quantile(times: &[Duration], share: f64) -> Duration {
    let mut sorted = times.to_vec();
    sorted.sort();
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "an index of the slice")]
    let at = (share * (sorted.len() - 1) as f64).round() as usize;
    sorted[at]
}

/// An engine, and avatars whose speed is measured in it.
#[derive(Debug)]
pub struct Runner {
    /// The engine.
    pub engine: Engine,
    /// Configuration of each session.
    pub session: SessionConfig,
    /// Half a minute of audio; computing time does not depend on its content.
    speech: Vec<f32>,
}

impl Runner {
    /// Creates a runner for sessions of this configuration in this engine.
    pub fn new(engine: Engine, session: SessionConfig) -> Self {
        let speech = voice::samples(engine.model().config().audio.sample_rate, 30.0);
        Self { engine, session, speech }
    }

    fn config(&self) -> &Config {
        self.engine.model().config()
    }

    fn session(&self) -> Result<Session, SpeedError> {
        self.engine.session(&self.session).map_err(SpeedError::Engine)
    }

    /// Number of samples in a chunk.
    fn chunk(&self) -> usize {
        self.session.avatar.target * self.config().samples_per_keyframe()
    }

    /// Pushes one chunk of audio and waits for its last frame. Returns the time to the first frame, and the number of
    /// frames. If the first chunk of a stream is a single keyframe, it has no frame before the second chunk, which is
    /// pushed then.
    fn one(&self, session: &Session, chunk: usize) -> Result<(Duration, usize), SpeedError> {
        let at = (chunk * self.chunk()) % (self.speech.len() - self.chunk());
        let push = || {
            let pushed = session.push_audio(&self.speech[at..at + self.chunk()]).map_err(SpeedError::Session)?;
            if pushed.taken < self.chunk() {
                return Err(SpeedError::Behind);
            }
            Ok(())
        };
        let mut wanted = session.stats().chunks + 1;
        let start = Instant::now();
        push()?;
        while session.ready_frames().map_err(SpeedError::Session)? == 0 {
            if session.stats().chunks == wanted && session.ready_frames().map_err(SpeedError::Session)? == 0 {
                wanted += 1;
                push()?;
            }
            if start.elapsed() > PATIENCE {
                return Err(SpeedError::Silent);
            }
            wait_a_little(start);
        }
        let time = start.elapsed();
        while session.stats().chunks < wanted && start.elapsed() < PATIENCE {
            wait_a_little(start);
        }
        Ok((time, session.pull_frames(usize::MAX, |_| ()).map_err(SpeedError::Session)?))
    }

    /// Times to the first frame of new streams, with the audio of a chunk pushed at once.
    ///
    /// # Errors
    /// [`SpeedError`] if a session cannot be created or returns no frames.
    pub fn first_frames(&self, count: usize) -> Result<Vec<Duration>, SpeedError> {
        let session = self.session()?;
        // Warm up: touch all memory once.
        self.one(&session, 0)?;
        let time = |i| {
            session.reset().map_err(SpeedError::Session)?;
            Ok(self.one(&session, i)?.0)
        };
        (0..count).map(time).collect()
    }

    /// Times of the chunks of one stream, each pushed when the previous one is complete, and the number of frames of
    /// all.
    ///
    /// # Errors
    /// As [`Self::first_frames`].
    pub fn chunks(&self, count: usize) -> Result<(Vec<Duration>, usize), SpeedError> {
        let session = self.session()?;
        self.one(&session, 0)?;
        let mut frames = 0;
        let time = |i| {
            let (time, more) = self.one(&session, i + 1)?;
            frames += more;
            Ok(time)
        };
        Ok(((0..count).map(time).collect::<Result<_, SpeedError>>()?, frames))
    }

    /// Measures several avatars that speak in real time, with staggered starts.
    ///
    /// # Errors
    /// As [`Self::first_frames`].
    pub fn crowd(&self, count: usize, seconds: f64) -> Result<Crowd, SpeedError> {
        let sessions = (0..count).map(|_| self.session()).collect::<Result<Vec<_>, _>>()?;
        let piece = self.config().audio.sample_rate / CALLS_PER_SECOND;
        let calls_per_chunk = self.chunk() / piece;
        let (start, before) = (Instant::now(), self.engine.stage_times().total());
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a day has 8.6 million")]
        let calls = (seconds * CALLS_PER_SECOND as f64) as usize;
        for call in 0..calls {
            for (i, session) in sessions.iter().enumerate() {
                // Chunks do not coincide: each avatar starts later by a share of a chunk.
                if call >= i * calls_per_chunk / count {
                    let at = (call * piece + i * self.chunk()) % (self.speech.len() - piece);
                    session.push_audio(&self.speech[at..at + piece]).map_err(SpeedError::Session)?;
                }
                session.pull_frames(usize::MAX, |_| ()).map_err(SpeedError::Session)?;
            }
            let next = Duration::from_secs_f64((call + 1) as f64 / CALLS_PER_SECOND as f64);
            std::thread::sleep(next.saturating_sub(start.elapsed()));
        }
        // The last chunks may still be in progress.
        std::thread::sleep(Duration::from_millis(200));
        let worked = self.engine.stage_times().total() - before;
        let (stats, latency): (Vec<_>, Vec<_>) = sessions.iter().map(|s| (s.stats(), s.latency())).unzip();
        Ok(Crowd {
            sessions: count,
            seconds: start.elapsed().as_secs_f64(),
            frames: stats.iter().map(|s| s.frames).sum(),
            late: stats.iter().map(|s| s.late_frames).sum(),
            held: stats.iter().map(|s| s.held_chunks).sum(),
            overruns: stats.iter().map(|s| s.overruns).sum(),
            p50: latency.iter().map(|l| l.compute_p50).max().unwrap_or_default(),
            p99: latency.iter().map(|l| l.compute_p99).max().unwrap_or_default(),
            max: latency.iter().map(|l| l.compute_max).max().unwrap_or_default(),
            busy: worked.as_secs_f64() / (start.elapsed().as_secs_f64() * self.engine.batches() as f64),
        })
    }
}

/// Sleeps before the next poll of something awaited since `start`.
fn wait_a_little(start: Instant) {
    std::thread::sleep(SHORTEST_LOOK.max(start.elapsed() / LOOK_SHARE));
}
