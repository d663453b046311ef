//! The engine's side of a session: when its chunks are due, and where their frames go.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use umo_core_base::error::StepError;
use umo_core_base::memory::{Arena, Counted};
use umo_core_base::state::{StateError, StatePass};
use umo_core_model::avatar::{Avatar, Due};
use umo_core_model::batch::FrameSink;
use umo_core_model::config::Config;
use umo_core_model::model::Model;
use umo_core_model::motion::FrameRef;

use super::held::{HeldMouth, next_frames};
use super::kept::{Begun, Times};
use super::packets::PacketWriter;
use super::shared::try_lock;
use super::{Failure, Idle, SessionConfig, Shared, Voice};
use crate::levels::Levels;
use crate::link::{EngineView, Input, Stamp};
use crate::take::Recorder;

/// Frames that a restored session can still produce before a position overflows its word.
const MORE_FRAMES: u64 = 1 << 32;

/// Nanoseconds per second.
const NANOS: u64 = 1_000_000_000;
/// Its multiples modulo 1 are spread as evenly as possible.
const GOLDEN_RATIO: f32 = 0.618_034;

/// An avatar and its schedule.
#[derive(Debug)]
pub(crate) struct Member {
    pub(crate) avatar: Avatar,
    pub(crate) schedule: Schedule,
}

/// Timing of an avatar's chunks, and the sink of their frames.
#[derive(Debug)]
pub(crate) struct Schedule {
    shared: Counted<Shared>,
    view: EngineView,
    chunk_frames: usize,
    /// Duration of a chunk, nanoseconds.
    period: u64,
    times: Times,
    /// When the engine first saw that the next chunk is due, if batching is on.
    noticed: Option<u64>,
    /// The chunk in work, or the next one if it was begun before the session was restored.
    begun: Begun,
    sample_rate: u64,
    model_rate: u64,
    frame_rate: u64,
    silence: Silence,
    levels: Levels,
    /// Frames of the current chunk so far.
    frames: u64,
    /// The mouth of chunks whose body is held, if the model has a mouth network.
    held_mouth: Option<HeldMouth>,
    /// Accumulated credit towards a full chunk, while only a share of the chunks is computed in
    /// full.
    credit: Option<f32>,
    #[cfg(test)]
    pub(crate) plant: Option<crate::engine::plant::Plant>,
}

/// Silence that the engine inserted into the stream, at the model's rate.
#[derive(Debug, Default)]
struct Silence {
    /// The last run.
    from: u64,
    len: u64,
    /// Length of all runs before it.
    before: u64,
}

impl Silence {
    fn add(&mut self, from: u64, len: u64) {
        if self.len > 0 && self.from + self.len == from {
            self.len += len;
        } else {
            *self = Self { from, len, before: self.before + self.len };
        }
    }

    /// Number of pushed samples before `position` of the stream.
    fn pushed(&self, position: u64) -> u64 {
        position.saturating_sub(self.before + position.saturating_sub(self.from).min(self.len))
    }
}

/// The schedules of a batch's members, in the batch's order.
pub(crate) struct Members<'a>(pub(crate) &'a mut [Schedule]);

impl FrameSink for Members<'_> {
    fn frame(&mut self, member: usize, frame: FrameRef) {
        self.0[member].frame(frame);
    }
}

impl Schedule {
    /// Whether the mouth network is still to hear the chunk's samples.
    pub(crate) fn awaits_mouth(&self) -> bool {
        self.held_mouth.as_ref().is_some_and(HeldMouth::awaits)
    }

    /// Feeds the chunk's samples to the mouth network.
    pub(crate) fn hear_mouth(&mut self, avatar: &mut Avatar) -> Result<(), StepError> {
        let heard = self.held_mouth.as_mut().map_or(Ok(()), |mouth| mouth.hear(avatar.samples_mut()));
        #[cfg(test)]
        self.plant.as_mut().map_or(Ok(()), |plant| plant.meet(crate::engine::plant::MOUTH))?;
        heard
    }

    fn new(
        avatar: &Avatar,
        shared: Counted<Shared>,
        config: &Config,
        sample_rate: usize,
        levels: Levels,
        held_mouth: Option<HeldMouth>,
    ) -> Self {
        let frames = (avatar.target * config.keyframe_stride) as f64;
        Self {
            shared,
            view: EngineView::new(),
            chunk_frames: avatar.chunk_frames(config),
            period: nanos(Duration::from_secs_f64(frames / config.frame_rate as f64)),
            times: Times::default(),
            noticed: None,
            begun: Begun::default(),
            sample_rate: sample_rate as u64,
            model_rate: config.audio.sample_rate as u64,
            frame_rate: config.frame_rate as u64,
            silence: Silence::default(),
            levels,
            frames: 0,
            held_mouth,
            credit: None,
            #[cfg(test)]
            plant: None,
        }
    }

    /// Ends the session: it produces no more frames.
    pub(crate) fn fail(&self, failure: Failure) {
        self.shared.outcome.fail(failure);
    }

    /// Whether the session has not ended.
    pub(crate) fn is_running(&self) -> bool {
        self.shared.outcome.is_running()
    }

    /// Duration of a chunk's motion.
    pub(crate) fn period(&self) -> Duration {
        Duration::from_nanos(self.period)
    }

    /// Lateness of the next chunk, which is due, if it began now, and the chunk's duration, both in
    /// nanoseconds. A chunk is late if its audio has waited longer than a chunk lasts.
    pub(crate) fn late(&self) -> (i64, i64) {
        let (backlog, _) = self.shared.backlog.measure();
        let signed = |nanos: u64| i64::try_from(nanos).unwrap_or(i64::MAX);
        let waited = backlog.saturating_mul(NANOS) / self.sample_rate;
        (signed(waited).saturating_sub(signed(self.period)), signed(self.period))
    }

    /// Whether the body of the next chunk is held, while `share` of all chunks are computed in
    /// full. Full chunks are spread evenly, and sessions in different `slot`s take turns.
    pub(crate) fn holds(&mut self, share: f32, slot: usize) -> bool {
        let credit = self.credit.get_or_insert((slot as f32 * GOLDEN_RATIO).fract());
        *credit += share;
        let is_full = *credit >= 1.0;
        *credit -= if is_full { 1.0 } else { 0.0 };
        !is_full
    }

    /// Counts a completed chunk.
    pub(crate) fn end(&mut self, now: u64) {
        let Self { shared, times: Times { arrived, release, finished }, period, begun, .. } = self;
        *begun = Begun::default();
        let (stats, since) = (&shared.stats, arrived.take().unwrap_or(now));
        stats.delays.add(Duration::from_nanos(now.saturating_sub(since.max(*finished))));
        stats.chunks.fetch_add(1, Ordering::Relaxed);
        stats.frames.fetch_add(self.frames, Ordering::Relaxed);
        *release += *period;
        if now > *release {
            stats.late_frames.fetch_add(self.frames, Ordering::Relaxed);
        }
        *finished = now;
    }

    /// Queues the packet of a completed chunk, if the session has packets, and records it, if it records a take.
    pub(crate) fn write_packet(&self, writer: &mut PacketWriter, avatar: &Avatar, model: &Model, due: Due) {
        let Self { shared, view, levels, begun, held_mouth, .. } = self;
        let epoch = view.epoch;
        if let Some(mut recording) = shared.recorder.as_ref().and_then(Recorder::keep) {
            // A held body's mouth is not in packets.
            if due == Due::Held && held_mouth.is_some() {
                recording.close();
            }
            match writer.record((avatar, model), due, levels) {
                Ok(Some(packet)) => recording.packet(epoch, packet),
                Ok(None) => {}
                Err(error) => self.fail(Failure::Step(error)),
            }
        }
        let Some(queue) = shared.packets.as_ref().filter(|_| !begun.packet) else { return };
        if let Err(error) = writer.write(queue, (avatar, model), due, epoch.number, levels) {
            self.fail(Failure::Step(error));
        }
    }

    /// Passes a frame to the host.
    fn frame(&mut self, frame: FrameRef) {
        let index = frame.index as u64;
        let sample = if self.silence.len == 0 {
            index * self.sample_rate / self.frame_rate
        } else {
            self.silence.pushed(index * self.model_rate / self.frame_rate) * self.sample_rate / self.model_rate
        };
        let epoch = self.view.epoch.number;
        if self.shared.has_frames() && self.frames >= self.begun.frames {
            let with_mouth = self.held_mouth.as_mut().and_then(|mouth| mouth.put(&frame));
            let (pose, face) = with_mouth.unwrap_or((frame.pose, frame.face));
            let stamp = Stamp { epoch, index, sample };
            let written = self.shared.link.frames.push(stamp, self.levels.cue(&frame), pose, face);
            debug_assert!(written, "a chunk is computed only where its frames have room");
        }
        // A stream that has begun in the meantime counts its own backlog.
        if self.shared.link.epoch().number == epoch {
            self.shared.backlog.cover(sample + self.sample_rate / self.frame_rate);
        }
        self.frames += 1;
    }

    /// Describes the silence in a stream of `consumed` samples.
    fn silence_state(&mut self, pass: &mut StatePass, consumed: u64) -> Result<(), StateError> {
        let Silence { from, len, before } = &mut self.silence;
        let from = pass.number("silence", from, consumed)?;
        let len = pass.number("silence", len, consumed - from.min(consumed))?;
        let before = pass.number("silence", before, from)?;
        pass.must(len > 0 || (from, before) == (0, 0), "silence")?;
        let last = u128::from(consumed) + u128::from(MORE_FRAMES) * u128::from(self.model_rate);
        pass.must(last * u128::from(self.sample_rate) < 1 << 64, "chunks")
    }
}

impl Member {
    pub(crate) fn new_in(
        avatar: Avatar,
        shared: Counted<Shared>,
        model: &Arc<Model>,
        session: &SessionConfig,
        levels: Levels,
        arena: &Arena,
    ) -> Self {
        let has_frames = session.packets.as_ref().is_none_or(|packets| packets.with_frames);
        let wants = avatar.has_audio() && !avatar.hears_mouth() && has_frames && session.voice == Voice::Delayed;
        let face_values = model.assembly().face_values();
        let mouth = wants.then(|| HeldMouth::new_in(model, &avatar, face_values, arena)).flatten();
        let schedule = Schedule::new(&avatar, shared, model.config(), session.sample_rate, levels, mouth);
        Self { schedule, avatar }
    }

    /// Whether the host has dropped the session.
    pub(crate) fn is_dropped(&self) -> bool {
        self.schedule.shared.outcome.dropped.load(Ordering::SeqCst)
    }

    /// Marks the session's engine as gone.
    pub(crate) fn close(&self) {
        self.schedule.shared.outcome.close();
    }

    /// Makes the next frame panic.
    #[cfg(test)]
    pub(crate) fn plant_defect(&mut self) {
        self.schedule.frame_rate = 0;
    }

    /// Settings that a state must share with this session, besides the model.
    pub(super) fn identity(&self, pass: &mut StatePass) -> Result<(), StateError> {
        self.avatar.identity(pass)
    }

    /// Times, the chunk that was begun, and the upper bounds of a chunk's samples and frames.
    pub(super) fn progress(&self) -> (Times, Begun, (usize, usize)) {
        let Self { avatar, schedule } = self;
        (schedule.times, schedule.begun, (avatar.most_samples(), schedule.chunk_frames))
    }

    /// Describes the engine's side between two chunks.
    pub(crate) fn state(&mut self, pass: &mut StatePass, model: &Model) -> Result<(), StateError> {
        let most = self.progress().2;
        self.schedule.times.state(pass)?;
        self.schedule.begun.state(pass, most)?;
        self.side_state(pass, model)
    }

    /// Describes it except for the times and the chunk that was begun. The frame count and the
    /// chunk's audio are set at the start of each chunk.
    pub(super) fn side_state(&mut self, pass: &mut StatePass, model: &Model) -> Result<(), StateError> {
        let schedule = &mut self.schedule;
        schedule.view.state(pass)?;
        if pass.loads() {
            schedule.noticed = None;
            // The held mouth's input is not part of a state.
            if let Some(mouth) = &mut schedule.held_mouth {
                mouth.reset();
            }
        }
        let consumed = self.avatar.state(pass, model)?;
        schedule.levels.state(pass)?;
        schedule.silence_state(pass, consumed)
    }

    /// The work that can be done now, and its deadline; `None` while it waits for audio or room,
    /// and the host's side then wakes the engine.
    pub(crate) fn due(&mut self, model: &Model, now: u64) -> Option<(Due, u64)> {
        if self.is_dropped() || !self.schedule.shared.outcome.is_running() {
            return None;
        }
        let shared = Counted::clone(&self.schedule.shared);
        let mut due = self.next_due(model);
        if due == Due::Audio {
            shared.link.wait_for_audio(&self.schedule.view, self.avatar.chunk_samples());
            due = self.next_due(model);
        }
        let frames = self
            .schedule
            .chunk_frames
            .saturating_sub(usize::try_from(self.schedule.begun.frames).unwrap_or(usize::MAX));
        let is_due = matches!(due, Due::Chunk | Due::Held | Due::Flush) && shared.has_room(frames);
        is_due.then(|| (due, self.deadline(now)))
    }

    /// Enters the host's epoch if it is new; returns the due step or the event waited for.
    fn next_due(&mut self, model: &Model) -> Due {
        let Self { avatar, schedule } = self;
        let shared = &schedule.shared;
        if schedule.view.sync_epoch(&shared.link) {
            avatar.reset();
            schedule.silence = Silence::default();
            schedule.levels.reset();
            if let Some(mouth) = &mut schedule.held_mouth {
                mouth.reset();
            }
            (schedule.times.arrived, schedule.noticed, schedule.times.release) = (None, None, 0);
            schedule.begun = Begun::default();
        }
        if let Some(due) = schedule.begun.due {
            return due;
        }
        match shared.link.input(&schedule.view) {
            Input::Behind if avatar.has_audio() => Due::Audio,
            Input::Behind => Due::Chunk,
            Input::Here { samples, total } => {
                if let Some(total) = total {
                    avatar.finish(usize::try_from(total).unwrap_or(usize::MAX));
                }
                let due = avatar.due(model.config(), samples);
                let silence = due == Due::Audio && shared.host.idle() == Idle::Live && shared.link.is_silence_wanted();
                match silence {
                    // Who listens, with hands that rest, needs no other motion than that of the layers.
                    true if shared.host.listens.load(Ordering::Relaxed) && avatar.rests() => Due::Held,
                    true => Due::Chunk,
                    false => due,
                }
            }
        }
    }

    /// Remaining batching delay of the next chunk, which is due, in nanoseconds: `most` since it
    /// was first seen due, but no longer than until half of its duration is left before `deadline`.
    /// A stream's first chunk does not wait, because a user waits for it.
    pub(crate) fn wait(&mut self, (due, deadline): (Due, u64), most: u64, now: u64) -> u64 {
        let Self { avatar, schedule } = self;
        if due != Due::Chunk || avatar.chunk == 0 {
            return 0;
        }
        let noticed = *schedule.noticed.get_or_insert(now);
        let left = deadline.saturating_sub(now).saturating_sub(schedule.period / 2);
        most.saturating_sub(now.saturating_sub(noticed)).min(left)
    }

    /// Playback end of the next chunk, which is due.
    fn deadline(&mut self, now: u64) -> u64 {
        let Self { avatar, schedule } = self;
        if schedule.times.arrived.is_none() {
            // Inserted silence, or a chunk without audio, is due from now on, however long the
            // pause was.
            let link = &schedule.shared.link;
            let is_consumed = avatar.total.is_some() || link.audio.len() >= avatar.chunk_samples();
            let arrived = if avatar.has_audio() && is_consumed { link.audio_time() } else { now };
            schedule.times.arrived = Some(arrived);
            // Audio pushed faster than real time is not shown early.
            schedule.times.release = arrived.max(schedule.times.release);
        }
        schedule.times.release + schedule.period
    }

    /// Prepares [`Self::begin`]: takes over changed settings, and saves the engine's side for saves
    /// while the chunk is in work. Returns the kind of chunk, which becomes a held one if only
    /// `share` of the chunks are computed in full and this one is not. `None` while a save reads
    /// the previous snapshot.
    pub(crate) fn prepare(&mut self, due: Due, share: f32, slot: usize, model: &Model) -> Option<Due> {
        let shared = Counted::clone(&self.schedule.shared);
        let mut kept = try_lock(&shared.kept)?;
        if self.schedule.begun.due.is_none() {
            let is_held = share < 1.0 && due == Due::Chunk && self.schedule.holds(share, slot);
            let room = if due == Due::Flush { 0 } else { self.avatar.chunk_samples() };
            self.schedule.begun = Begun {
                due: Some(if is_held { Due::Held } else { due }),
                samples: room.min(shared.link.audio.len()) as u64,
                ..Begun::default()
            };
            shared.settings.take(|settings| {
                self.avatar.set_sampler(settings.sampler);
                let text = self.avatar.set_text(&settings.text[..settings.text_len]);
                text.expect("a prompt was checked when it was set");
            });
        }
        kept.keep(self, &shared, model);
        self.schedule.begun.due
    }

    /// Takes the next chunk's samples; `busy` if the engine currently holds bodies, this one's or
    /// others'.
    pub(crate) fn begin(&mut self, due: Due, busy: bool, config: &Config) {
        let Self { avatar, schedule } = self;
        schedule.noticed = None;
        let Schedule { shared, view, silence, levels, frames, begun, held_mouth, model_rate, frame_rate, .. } =
            schedule;
        *frames = 0;
        let (start, endless) = (avatar.consumed(avatar.chunk), avatar.total.is_none());
        if due == Due::Held {
            shared.stats.held_chunks.fetch_add(1, Ordering::Relaxed);
        }
        let chunk = next_frames(avatar, config);
        let room = if due == Due::Flush { &mut [] } else { avatar.samples_mut() };
        // Samples that arrive later belong to the next chunk.
        let there = room.len().min(usize::try_from(begun.samples).unwrap_or(usize::MAX));
        let taken = shared.link.take_audio(view, &mut room[..there]);
        room[taken..].fill(0.0);
        if let Some(mut recording) = shared.recorder.as_ref().and_then(Recorder::keep) {
            recording.hear(view.epoch, &room[..taken]);
        }
        levels.push(room);
        let is_endless = taken < room.len() && endless;
        let silent = (room.len() - taken) as u64;
        if due == Due::Chunk {
            levels.tell(avatar, config);
        }
        if let Some(mouth) = held_mouth
            && due != Due::Flush
        {
            mouth.begin(chunk, due == Due::Held, busy.then_some(start * *frame_rate / *model_rate));
        }
        if is_endless {
            shared.link.silence_given();
            silence.add(start + taken as u64, silent);
        }
    }
}

#[expect(clippy::cast_possible_truncation, reason = "a chunk is seconds long")]
fn nanos(time: Duration) -> u64 {
    time.as_nanos() as u64
}
