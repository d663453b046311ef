//! The protocol between the host, the session's two queues and the engine.
//!
//! ```text
//!  host            begin_epoch: everything that is not shown yet is dropped
//!                      │ epoch
//!        ┌─────────────┼──────────────────┐
//!        ▼             ▼                  ▼
//!  input ──── audio ──► engine ── frames ──► output
//!        └── input_epoch, input_start, end ─►┘
//! ```
//! An *epoch* is the stream between two resets or interrupts. The host begins one by changing one
//! atomic word. Each side compares the word with its own epoch and restarts by itself: no side
//! waits for another.
//!
//! | side | on a new epoch | until then |
//! |---|---|---|
//! | input | publishes where in `audio` the epoch's samples start (`start_input`) | its samples belong to the previous epoch |
//! | engine | discards its state, then skips to that position (`EngineView`) | computes for the previous epoch and stamps its frames with it |
//! | output | eases to rest, then skips frames stamped with another epoch | shows the previous epoch |
//!
//! A side without work publishes what it waits for, checks once more, and only then stops. The side
//! that provides it notifies the engine's [`Signal`]:
//!
//! | waiting side | for | published in | notified by |
//! |---|---|---|---|
//! | engine | audio, or its end | `audio_wanted`, a position in `audio` | input, when it has pushed up to that position |
//! | engine | room for a chunk's frames | `room_wanted` | output, when it has taken enough |
//! | output | motion during silence | `silence_wanted` | itself, once |

use std::sync::Arc;

use umo_core_base::memory::Arena;
use umo_core_base::state::{StateError, StatePass, is_sample};
pub(super) use umo_core_base::sync::{AtomicBool, AtomicU32, AtomicU64, Ordering, fence};
use umo_core_pose::frame::OwnedFrame;

use super::ring::Ring;
use super::{FrameRing, Signal, Stamp};

/// Value of `audio_wanted` while the engine does not wait.
const NOT_WAITING: u64 = u64::MAX;
/// Value of `total` before the end of the stream.
const UNKNOWN_TOTAL: u64 = u64::MAX;
/// Upper bound of positions in `audio`.
const MAX_POSITION: u64 = 1 << 62;

/// A stream between two resets or interrupts, and how it begins.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Epoch {
    /// Number of the epoch; wraps.
    pub(crate) number: u32,
    /// Number of resets, modulo 2^16.
    pub(crate) resets: u16,
    /// Frames of the ease from the last shown pose; 0 after a reset.
    pub(crate) ease: u16,
}

impl Epoch {
    fn pack(self) -> u64 {
        u64::from(self.number) << 32 | u64::from(self.resets) << 16 | u64::from(self.ease)
    }

    #[expect(clippy::cast_possible_truncation, reason = "fields of a word")]
    fn unpack(word: u64) -> Self {
        Self { number: (word >> 32) as u32, resets: (word >> 16) as u16, ease: word as u16 }
    }

    /// The next epoch, after an interrupt.
    pub(crate) fn interrupted(self, ease: u16) -> Self {
        Self { number: self.number.wrapping_add(1), ease, ..self }
    }

    /// The next epoch, after a reset.
    pub(crate) fn reset(self) -> Self {
        Self { number: self.number.wrapping_add(1), resets: self.resets.wrapping_add(1), ease: 0 }
    }

    /// Describes the epoch of one of the sides.
    pub(crate) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        let word = pass.word(self.pack())?;
        if pass.loads() {
            *self = Self::unpack(word);
        }
        Ok(())
    }
}

/// State shared by the sides of a session.
#[derive(Debug)]
pub(crate) struct Link {
    /// Samples at the model's rate, as the bits of floats.
    pub(crate) audio: Ring,
    /// Samples that the engine has taken and that must not be overwritten: at least the samples of
    /// the chunk in work.
    kept: usize,
    /// The same samples for the mouth, if it is live over a body.
    voice: Option<Ring>,
    pub(crate) frames: FrameRing,
    epoch: AtomicU64,
    /// The input's epoch, and the position in `audio` where its samples start.
    input_epoch: AtomicU32,
    input_start: AtomicU64,
    /// Sample frames pushed before that epoch, at the session's rate.
    input_base: AtomicU64,
    /// Total frames of that epoch, or [`UNKNOWN_TOTAL`].
    total: AtomicU64,
    /// Position in `audio` that the engine waits for, or [`NOT_WAITING`].
    audio_wanted: AtomicU64,
    /// Time of the last push, nanoseconds.
    audio_time: AtomicU64,
    /// Whether the engine waits for room in `frames`.
    room_wanted: AtomicBool,
    /// Whether the host waits for frames during silence.
    silence_wanted: AtomicBool,
    signal: Arc<Signal>,
}

/// The engine's view of a session's stream.
#[derive(Clone, Copy, Debug)]
pub(crate) struct EngineView {
    pub(crate) epoch: Epoch,
    /// Whether the input has entered that epoch too, so that the samples in `audio` belong to it.
    joined: bool,
}

/// The input, as the engine sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Input {
    /// The input is still in another epoch.
    Behind,
    /// Number of samples in the ring, and the stream's total frames once its end is known.
    Here { samples: usize, total: Option<u64> },
}

impl Link {
    /// Creates a link at the start of its first epoch, in memory of `arena`. It has room for
    /// `samples` samples, and for `kept` that the engine has taken.
    pub(crate) fn new_in(
        (samples, kept): (usize, usize),
        has_voice: bool,
        frames: FrameRing,
        now: u64,
        signal: Arc<Signal>,
        arena: &Arena,
    ) -> Self {
        Self {
            audio: Ring::new_in(samples + kept, arena),
            kept,
            voice: has_voice.then(|| Ring::new_in(samples, arena)),
            frames,
            epoch: AtomicU64::new(0),
            input_epoch: AtomicU32::new(0),
            input_start: AtomicU64::new(0),
            input_base: AtomicU64::new(0),
            total: AtomicU64::new(UNKNOWN_TOTAL),
            audio_wanted: AtomicU64::new(NOT_WAITING),
            audio_time: AtomicU64::new(now),
            room_wanted: AtomicBool::new(false),
            silence_wanted: AtomicBool::new(false),
            signal,
        }
    }

    /// The current epoch; a side may still be in an earlier one.
    pub(crate) fn epoch(&self) -> Epoch {
        Epoch::unpack(self.epoch.load(Ordering::SeqCst))
    }

    /// Host: begins a new epoch. Threads may call this concurrently.
    pub(crate) fn begin_epoch(&self, next: impl Fn(Epoch) -> Epoch) {
        let update = |word| Some(next(Epoch::unpack(word)).pack());
        // The closure never refuses.
        let _ = self.epoch.fetch_update(Ordering::SeqCst, Ordering::SeqCst, update);
        self.signal.notify();
    }

    /// Any side: wakes the engine.
    pub(crate) fn notify(&self) {
        self.signal.notify();
    }

    /// Time of the last push, nanoseconds.
    pub(crate) fn audio_time(&self) -> u64 {
        self.audio_time.load(Ordering::Relaxed)
    }
}

/// The input's side.
impl Link {
    /// Enters an epoch, before which `base` sample frames were taken: samples pushed from now on
    /// belong to it.
    pub(crate) fn start_input(&self, epoch: Epoch, base: u64) {
        self.total.store(UNKNOWN_TOTAL, Ordering::Relaxed);
        self.input_base.store(base, Ordering::Relaxed);
        self.input_start.store(self.audio.written(), Ordering::Relaxed);
        // Publishes the stores above.
        self.input_epoch.store(epoch.number, Ordering::SeqCst);
    }

    /// Number of samples that can be pushed.
    pub(crate) fn audio_room(&self) -> usize {
        self.voice.iter().map(Ring::room).fold(self.audio.room().saturating_sub(self.kept), usize::min)
    }

    /// Appends samples. The caller has checked that there is room.
    pub(crate) fn push_audio(&self, samples: &[f32]) {
        for ring in self.voice.iter().chain([&self.audio]) {
            let written = ring.push(samples.iter().map(|sample| sample.to_bits()));
            debug_assert_eq!(written, samples.len(), "the ring was said to have room");
        }
    }

    /// Reports that samples were pushed at time `now`. Wakes the engine if it waits for them.
    pub(crate) fn audio_pushed(&self, now: u64) {
        self.audio_time.store(now, Ordering::Relaxed);
        self.silence_wanted.store(false, Ordering::Relaxed);
        self.wake_for_audio();
    }

    /// Ends the stream at `total` frames; the remaining ones are due from `now` on.
    pub(crate) fn end_input(&self, total: u64, now: u64) {
        self.total.store(total, Ordering::SeqCst);
        self.audio_time.store(now, Ordering::Relaxed);
        self.wake_for_audio();
    }

    fn wake_for_audio(&self) {
        // Pairs with the fence in `wait_for_audio`: either this side sees that the engine waits, or
        // the engine sees the samples.
        fence(Ordering::SeqCst);
        let wanted = self.audio_wanted.load(Ordering::SeqCst);
        if wanted != NOT_WAITING
            && (self.audio.written() >= wanted || self.total.load(Ordering::SeqCst) != UNKNOWN_TOTAL)
        {
            self.audio_wanted.store(NOT_WAITING, Ordering::SeqCst);
            self.signal.notify();
        }
    }
}

/// The engine's side.
impl Link {
    /// State of the input. `view` must be up to date.
    pub(crate) fn input(&self, view: &EngineView) -> Input {
        if !view.joined {
            return Input::Behind;
        }
        // The end is stored after the last audio, so the length below includes it.
        let total = self.total.load(Ordering::SeqCst);
        Input::Here { samples: self.audio.len(), total: (total != UNKNOWN_TOTAL).then_some(total) }
    }

    /// Publishes that the engine waits for `samples` samples or the end of the stream. The engine
    /// must check once more after this call: the input may have pushed just before it could see
    /// `audio_wanted`.
    pub(crate) fn wait_for_audio(&self, view: &EngineView, samples: usize) {
        // In a new epoch the position is unknown until the input enters it: any push wakes.
        let wanted = if view.joined { self.audio.read_position() + samples as u64 } else { 0 };
        self.audio_wanted.store(wanted, Ordering::SeqCst);
        fence(Ordering::SeqCst);
    }

    /// Whether there is room for `frames` frames. If not, the output notifies once there is.
    pub(crate) fn has_room(&self, frames: usize) -> bool {
        self.has_room_where(|| self.frames.room() >= frames)
    }

    /// Whether `is_there` finds room. If not, the side that makes room notifies.
    pub(crate) fn has_room_where(&self, is_there: impl Fn() -> bool) -> bool {
        if is_there() {
            return true;
        }
        self.room_wanted.store(true, Ordering::SeqCst);
        fence(Ordering::SeqCst);
        is_there()
    }

    /// Moves the oldest samples to `samples` and returns their number: 0 once a new epoch has
    /// begun, because `audio` may then hold samples of that epoch.
    pub(crate) fn take_audio(&self, view: &EngineView, samples: &mut [f32]) -> usize {
        self.audio_wanted.store(NOT_WAITING, Ordering::SeqCst);
        // The ring contains no samples of an epoch that the host has not begun.
        let count = samples.len().min(self.audio.len());
        if self.epoch() != view.epoch {
            return 0;
        }
        let mut slots = samples.iter_mut();
        self.audio.peek_range(0..count, |word| {
            if let Some(slot) = slots.next() {
                *slot = f32::from_bits(word);
            }
        });
        self.audio.skip(count);
        count
    }

    /// Whether the host waits for motion during silence.
    pub(crate) fn is_silence_wanted(&self) -> bool {
        self.silence_wanted.load(Ordering::SeqCst)
    }

    /// Reports that the engine computes a chunk of silence.
    pub(crate) fn silence_given(&self) {
        self.silence_wanted.store(false, Ordering::SeqCst);
    }
}

impl EngineView {
    /// In the first epoch.
    pub(crate) fn new() -> Self {
        Self { epoch: Epoch::default(), joined: true }
    }

    /// Enters a new epoch, and then the input's part of it; returns whether the epoch changed.
    pub(crate) fn sync_epoch(&mut self, link: &Link) -> bool {
        let epoch = link.epoch();
        let is_new = epoch != self.epoch;
        if is_new {
            *self = Self { epoch, joined: false };
        }
        if !self.joined && link.input_epoch.load(Ordering::SeqCst) == epoch.number {
            self.joined = true;
            link.audio.skip_to(link.input_start.load(Ordering::Relaxed));
        }
        is_new
    }

    /// Describes the view.
    pub(crate) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        self.epoch.state(pass)?;
        pass.switch("epoch", &mut self.joined).map(drop)
    }
}

/// The output's side.
impl Link {
    /// Total frames of the current epoch, if the input has ended it. Until the input enters an
    /// epoch, `total` is that of the previous one.
    pub(crate) fn total(&self) -> Option<u64> {
        let total = self.total.load(Ordering::SeqCst);
        let joined = self.input_epoch.load(Ordering::SeqCst) == self.epoch().number;
        (joined && total != UNKNOWN_TOTAL).then_some(total)
    }

    /// Samples for the live mouth: those of the engine, if there is no body.
    pub(crate) fn voice(&self) -> &Ring {
        self.voice.as_ref().unwrap_or(&self.audio)
    }

    /// Position where the samples of `epoch` start, if the input has entered it.
    pub(crate) fn input_start_in(&self, epoch: Epoch) -> Option<u64> {
        let joined = self.input_epoch.load(Ordering::SeqCst) == epoch.number;
        joined.then(|| self.input_start.load(Ordering::Relaxed))
    }

    /// Sample frames pushed before the epoch that the input is in.
    pub(crate) fn input_base(&self) -> u64 {
        self.input_base.load(Ordering::Relaxed)
    }

    /// Moves the next frame of `epoch` to `frame`, after [`Self::drop_other_epochs`]; returns its
    /// stamp, if there is one, with the sample counted since the last reset.
    pub(crate) fn take_frame(
        &self,
        epoch: Epoch,
        enough: usize,
        frame: &mut OwnedFrame,
        dropped: impl Fn(),
    ) -> Option<Stamp> {
        let stamp = self.drop_other_epochs(epoch, enough, dropped)?;
        self.frames.pop(frame);
        self.frame_taken(enough);
        Some(Stamp { sample: self.input_base() + stamp.sample, ..stamp })
    }

    /// Drops frames of other epochs, which precede those of `epoch`, and calls `dropped` for each;
    /// returns the stamp of the next frame of `epoch`, if there is one. Wakes the engine as
    /// [`Self::frame_taken`] does.
    pub(crate) fn drop_other_epochs(&self, epoch: Epoch, enough: usize, dropped: impl Fn()) -> Option<Stamp> {
        while let Some(stamp) = self.frames.next() {
            if stamp.epoch == epoch.number {
                return Some(stamp);
            }
            self.frames.skip();
            self.frame_taken(enough);
            dropped();
        }
        None
    }

    /// Reports that a frame was taken. Wakes the engine if it waits for room and `enough` frames
    /// fit.
    pub(crate) fn frame_taken(&self, enough: usize) {
        // As in `wake_for_audio`.
        fence(Ordering::SeqCst);
        if self.frames.room() >= enough && self.room_wanted.swap(false, Ordering::SeqCst) {
            self.signal.notify();
        }
    }

    /// Reports room other than for frames. Wakes the engine if it waits for room.
    pub(crate) fn room_made(&self) {
        // As in `wake_for_audio`.
        fence(Ordering::SeqCst);
        if self.room_wanted.swap(false, Ordering::SeqCst) {
            self.signal.notify();
        }
    }

    /// Asks for motion on silence.
    pub(crate) fn want_silence(&self) {
        if !self.silence_wanted.swap(true, Ordering::SeqCst) {
            self.signal.notify();
        }
    }
}

/// Saving and restoring. The caller excludes every side.
impl Link {
    /// Positions of the next audio that the engine takes and of the next frame that it puts.
    pub(crate) fn engine_positions(&self) -> (u64, u64) {
        (self.audio.read_position(), self.frames.written())
    }

    /// Describes the current epoch and the contents of the rings; the audio from position `from`
    /// on, if given, otherwise from where the engine takes it next. Returns the number of samples,
    /// and the position after the last frame.
    pub(crate) fn state(&self, pass: &mut StatePass, from: Option<u64>) -> Result<(usize, u64), StateError> {
        // Sides and frames keep the epochs of the saved state: a side that lagged lags again.
        let mut epoch = self.epoch();
        epoch.state(pass)?;
        if pass.loads() {
            self.epoch.store(epoch.pack(), Ordering::SeqCst);
            // The engine checks for audio and room again.
            self.audio_wanted.store(NOT_WAITING, Ordering::SeqCst);
            self.room_wanted.store(false, Ordering::SeqCst);
        }
        let are_samples = |words: &[[u8; 4]]| words.iter().all(|&word| is_sample(f32::from_le_bytes(word)));
        let waiting = self.audio.state(pass, "waiting audio", from, are_samples)?;
        if let Some(voice) = &self.voice {
            voice.state(pass, "waiting audio", None, are_samples)?;
        }
        Ok((waiting, self.frames.state(pass)?))
    }

    /// Describes where the input's epoch starts in `audio`.
    pub(crate) fn input_start_state(&self, pass: &mut StatePass) -> Result<u64, StateError> {
        pass.limited("place of audio", self.input_start.load(Ordering::Relaxed), MAX_POSITION)
    }

    /// Restores the input's epoch, which started at position `start` of `audio`, and has ended if
    /// `total` is known.
    pub(crate) fn restore_input(&self, epoch: Epoch, start: u64, base: u64, total: Option<u64>) {
        self.total.store(total.unwrap_or(UNKNOWN_TOTAL), Ordering::SeqCst);
        self.input_base.store(base, Ordering::Relaxed);
        self.input_start.store(start, Ordering::Relaxed);
        self.input_epoch.store(epoch.number, Ordering::SeqCst);
    }

    /// Describes the time of the last push, and whether the host waits for silence or did so at the
    /// snapshot (`was_wanted`).
    pub(crate) fn waiting_state(&self, pass: &mut StatePass, was_wanted: bool) -> Result<(), StateError> {
        let audio_time = pass.moment("time of audio", self.audio_time.load(Ordering::Relaxed))?;
        let silence = pass.flag("wish for silence", was_wanted || self.is_silence_wanted())?;
        if pass.loads() {
            self.audio_time.store(audio_time, Ordering::Relaxed);
            self.silence_wanted.store(silence, Ordering::SeqCst);
        }
        Ok(())
    }
}

/// Interleavings of the sides:
/// `RUSTFLAGS="--cfg loom" cargo test -p umo-core-stream --release --lib interleavings`.
/// A side that waits for a lost wake-up is a deadlock, which loom reports.
#[cfg(all(test, loom))]
mod interleavings {
    use umo_core_pose::frame::Cue;
    use umo_core_pose::pose::Pose;

    use super::*;
    use loom::thread;

    /// Runs every interleaving with at most three preemptions; losing a wake-up takes two.
    fn explore(sides: impl Fn() + Send + Sync + 'static) {
        let mut model = loom::model::Builder::new();
        model.preemption_bound = Some(3);
        model.check(sides);
    }

    /// Creates a link without face values, with room for two samples and one frame.
    fn link() -> Arc<Link> {
        let arena = Arena::system();
        Arc::new(Link::new_in((2, 0), false, FrameRing::new_in(1, 0, &arena), 0, Arc::default(), &arena))
    }

    fn push(link: &Link, sample: f32) {
        assert_eq!(link.audio.push([sample.to_bits()].into_iter()), 1);
        link.audio_pushed(0);
    }

    /// Runs the engine's side: sleeps until there is a chunk of one sample, and returns it; `None`
    /// at the end.
    fn next_chunk(link: &Link, view: &mut EngineView) -> Option<f32> {
        let sync = |view: &mut EngineView| {
            view.sync_epoch(link);
            link.input(view)
        };
        while link.signal.begin_turn(0) {
            let mut input = sync(view);
            if !matches!(input, Input::Here { samples: 1.., .. } | Input::Here { total: Some(_), .. }) {
                link.wait_for_audio(view, 1);
                input = sync(view);
            }
            match input {
                Input::Here { samples: 1.., .. } => {
                    let mut sample = [0.0];
                    if link.take_audio(view, &mut sample) == 1 {
                        return Some(sample[0]);
                    }
                }
                Input::Here { total: Some(_), .. } => return None,
                _ => link.signal.sleep(0, None),
            }
        }
        unreachable!("nothing stops the signal")
    }

    #[test]
    fn engine_receives_every_sample_and_the_end() {
        explore(|| {
            let link = link();
            let input = Arc::clone(&link);
            let thread = thread::spawn(move || {
                push(&input, 1.0);
                input.end_input(1, 0);
            });
            let mut view = EngineView::new();
            assert_eq!(next_chunk(&link, &mut view), Some(1.0));
            assert_eq!(next_chunk(&link, &mut view), None);
            thread.join().unwrap();
        });
    }

    #[test]
    fn new_epoch_has_only_its_own_samples() {
        explore(|| {
            let link = link();
            push(&link, 1.0);
            let input = Arc::clone(&link);
            let thread = thread::spawn(move || {
                input.begin_epoch(|epoch| epoch.interrupted(0));
                input.start_input(input.epoch(), 1);
                push(&input, 2.0);
            });
            let mut view = EngineView::new();
            let mut sample = next_chunk(&link, &mut view);
            if sample == Some(1.0) {
                // This sample was taken in the first epoch.
                assert_eq!(view.epoch.number, 0);
                sample = next_chunk(&link, &mut view);
            }
            assert_eq!((sample, view.epoch.number), (Some(2.0), 1));
            thread.join().unwrap();
        });
    }

    #[test]
    fn engine_waiting_for_room_is_woken() {
        explore(|| {
            let link = link();
            let stamp = |index| Stamp { epoch: 0, index, sample: 0 };
            assert!(link.frames.push(stamp(0), Cue::default(), &Pose::REST, &[]));
            let output = Arc::clone(&link);
            let thread = thread::spawn(move || {
                assert_eq!(output.frames.next().map(|stamp| stamp.index), Some(0));
                output.frames.skip();
                output.frame_taken(1);
            });
            while link.signal.begin_turn(0) {
                if link.has_room(1) {
                    break;
                }
                link.signal.sleep(0, None);
            }
            assert!(link.frames.push(stamp(1), Cue::default(), &Pose::REST, &[]));
            thread.join().unwrap();
            assert_eq!(link.frames.next(), Some(stamp(1)));
        });
    }
}
