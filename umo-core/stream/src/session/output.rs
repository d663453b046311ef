//! The frame side of a session: the stages of [`playback`](crate::playback) in their order.

use std::sync::atomic::Ordering;

use umo_core_base::memory::Boxed;
use umo_core_base::state::{StateError, StatePass};
use umo_core_layers::LayerStack;
use umo_core_pose::frame::OwnedFrame;

use super::outcome::Failure;
use super::packets::PacketQueue;
use super::shared::{Format, SessionInit};
use super::{SessionConfig, Shared};
use crate::playback::{
    Arrival, Frame, Gained, Gap, IdleBlend, Layers, LayersState, LiveVoice, Sample, Sampled, Source, Start, ToRest,
    Trend, Window, frames_of,
};
use crate::take::{Play, Recorder};

/// Mark of the states of a mouth alone, above that of packets.
const MOUTH_STATE: u64 = 1 << 40;

/// The stages, the first ones for the next frame and the last ones for the pose between two frames.
#[derive(Debug)]
pub(crate) struct Output {
    to_rest: ToRest,
    source: Source,
    arrival: Arrival,
    /// If frames come from packets.
    gap: Option<Gap>,
    /// If they come from a take.
    play: Option<Play>,
    layers: Layers,
    trend: Trend,
    window: Window,
    sample: Sample,
    idle: IdleBlend,
    gained: Gained,
    /// The model's rest pose.
    rest: OwnedFrame,
}

impl Output {
    pub(super) fn new_in(init: &SessionInit, session: &SessionConfig, voice: Option<Boxed<LiveVoice>>) -> Self {
        let &SessionInit { rest, chunk_frames, is_decoder, arena, .. } = init;
        let (config, avatar) = (init.model.config(), &session.avatar);
        let (rates, frame_rate) = ((session.sample_rate, config.frame_rate), config.frame_rate);
        let frame = || rest.clone_in(arena);
        let ease = frames_of(session.ease, frame_rate).into();
        let stack = LayerStack::new(
            (&config.skeleton, &config.face),
            frame_rate,
            rest,
            avatar.sampler.seed,
            (session.gestures.clone(), session.words.clone()),
        );
        let controls = crate::playback::controls(&avatar.sampler, session.layers);
        Self {
            to_rest: ToRest::new(frame()),
            source: Source::new(voice, chunk_frames, rates),
            // With packets, `gap` eases.
            arrival: Arrival::new(frame(), if is_decoder { 0 } else { ease }),
            gap: is_decoder.then(|| Gap::new(frame(), frame(), session.ease, frame_rate)),
            play: init.take.cloned().map(|take| Play::new(take, init.patches.clone(), rest.face.len())),
            layers: Layers::new(stack, controls, rates),
            trend: Trend::new(frame_rate),
            window: Window::new(frame),
            sample: Sample::new(frame(), frame_rate),
            idle: IdleBlend::new(frame, session.idle_after, session.ease, frame_rate),
            gained: Gained::new(frame(), init.assembly.is_arkit()),
            rest: frame(),
        }
    }

    /// The newest frame that was shown, and the layers after it.
    pub(super) fn shown(&mut self) -> (&OwnedFrame, &mut Layers) {
        let Self { window, layers, .. } = self;
        (&window.last.frame, layers)
    }

    /// Restarts if the session was interrupted or reset.
    fn sync_epoch(&mut self, shared: &Shared) {
        let (epoch, before) = (shared.link.epoch(), self.source.epoch());
        if epoch == before {
            return;
        }
        let Self { to_rest, source, arrival, gap, play, layers, trend, window, sample, idle, gained, rest } = self;
        let is_reset = epoch.resets != before.resets;
        if window.reset(is_reset, rest) {
            shared.stats.dropped_frames.fetch_add(1, Ordering::Relaxed);
        }
        let is_shown = window.any;
        // If nothing was shown yet, there is nothing to ease from.
        let ease = if is_shown { u64::from(epoch.ease) } else { 0 };
        let base = if is_shown { window.last.frame.index + 1 + ease } else { 0 };
        let start = Start { epoch, is_reset, is_shown, ease, base, last: &window.last.raw, rest };
        to_rest.reset(&start);
        source.reset(&start);
        arrival.reset(&start);
        if let Some(gap) = gap {
            gap.reset(&start);
        }
        if let Some(play) = play {
            play.reset();
        }
        layers.reset(&start, &shared.host);
        trend.reset();
        sample.reset(&start);
        idle.reset(&start);
        gained.reset(&start);
    }

    /// Shows the next frame, with gains, if there is one.
    pub(super) fn next(&mut self, shared: &Shared) -> Option<Frame<'_>> {
        let time = self.step(shared)?;
        self.idle.show(&self.window.last.frame);
        Some(self.gained.apply(&shared.host.gains, time, &self.window.last.frame, &self.rest))
    }

    /// Makes the next frame the one shown; returns its time in seconds, if there was one.
    fn step(&mut self, shared: &Shared) -> Option<f64> {
        self.sync_epoch(shared);
        self.fetch(shared).then(|| self.sample.show_next(&mut self.window))
    }

    /// Fetches the frame after the one shown; returns whether there is one.
    fn fetch(&mut self, shared: &Shared) -> bool {
        let Self { to_rest, source, arrival, gap, play, layers, trend, window, rest, .. } = self;
        let mut other = None;
        if window.has_next {
            return true;
        }
        let (frame, last) = (&mut window.next.frame, &window.last.raw);
        if !to_rest.apply(frame, rest, source.base()) {
            match source.apply(frame, &shared.link, &shared.stats.dropped_frames) {
                Ok(true) if source.is_mouth() => {
                    // No engine counts them.
                    let Format { sample_rate, frame_rate, .. } = shared.format;
                    shared.stats.frames.fetch_add(1, Ordering::Relaxed);
                    let of_stream = frame.sample.saturating_sub(shared.link.input_base());
                    shared.backlog.cover(of_stream + (sample_rate / frame_rate) as u64);
                }
                Ok(true) => {}
                Ok(false) => return false,
                Err(error) => {
                    shared.outcome.fail(Failure::Step(error));
                    return false;
                }
            }
            if let Some(play) = play {
                let epoch = source.epoch().number;
                if play.has_joins()
                    && let Some(now) = layers.asked(&shared.host)
                {
                    let back = |state: &LayersState| layers.return_to(&shared.host, state, epoch);
                    play.rejoin(frame.index, &now, &window.last.frame, back);
                }
                play.advance(frame.index, |event| layers.ask(&shared.host, &event, epoch));
                if play.has_joins() {
                    play.leave(layers.asked(&shared.host));
                }
                play.patch(frame);
                play.cue(&mut frame.cue);
                other = play.other();
            }
            arrival.apply(frame, last);
            if let Some(gap) = gap {
                gap.apply(frame, window.any.then_some(last));
            }
        }
        window.next.raw.copy(frame);
        let other = shared.host.other_level().or(other);
        {
            // The host asks for nothing between the requests that this frame has and its record.
            let mut recording = shared.recorder.as_ref().and_then(Recorder::keep);
            layers.follow(&shared.host);
            if let Some(recording) = &mut recording {
                // Company is another session's; idle time, and silence that the engine inserts, have no place in a take's.
                if !layers.is_of_stream() || frame.sample != shared.format.sample_of(frame.index) {
                    recording.close();
                }
                recording.frame(source.epoch(), frame.index, &frame.cue, other);
            }
        }
        layers.apply_for(&shared.host, frame, other);
        if let Some(play) = play {
            play.fading.apply(frame);
        }
        trend.follow(frame.cue.arousal);
        window.has_next = true;
        true
    }

    /// Samples the pose at a time; returns it with gains.
    pub(super) fn sample(&mut self, shared: &Shared, seconds: f64) -> (Sampled, Frame<'_>) {
        self.sync_epoch(shared);
        let time = self.sample.advance(seconds);
        if !self.window.any {
            self.step(shared);
        }
        while self.fetch(shared) && self.sample.seconds(&self.window.next.frame) <= time {
            self.step(shared);
        }
        let newest = self.newest(shared);
        let Self { gap, layers, window, sample, idle, gained, rest, .. } = self;
        let stand = sample.apply(window, rest, time, gap.as_mut());
        let missed = gap.as_mut().map(|gap| gap.missed(&stand));
        if stand.is_ahead {
            idle.want_silence(&shared.link, &shared.host);
        }
        idle.apply(&mut sample.frame, &stand, missed, layers, &shared.host);
        let sampled = Sampled { oldest: sample.seconds(&window.last.frame), newest, is_ahead: stand.is_ahead };
        (sampled, gained.apply(&shared.host.gains, sample.time, &sample.frame, rest))
    }

    /// Time of the newest ready frame, seconds.
    fn newest(&mut self, shared: &Shared) -> f64 {
        let waiting = usize::from(self.window.has_next) + self.source.waiting(&shared.link);
        #[expect(clippy::cast_precision_loss, reason = "a queue is short")]
        let ahead = waiting as f64 + self.to_rest.left() as f64;
        self.sample.seconds(&self.window.last.frame) + ahead / self.sample.frame_rate
    }

    /// Number of frames that `next` would return, of this stream.
    #[expect(clippy::cast_possible_truncation, reason = "an ease is at most 2^16 frames")]
    pub(super) fn ready(&mut self, shared: &Shared) -> usize {
        self.sync_epoch(shared);
        let waiting = self.source.ready(&shared.link, &shared.stats.dropped_frames);
        usize::from(self.window.has_next) + self.to_rest.left() as usize + waiting
    }

    /// Arousal of the voice at the newest frame shown, and its change per second.
    pub(super) fn arousal(&mut self, shared: &Shared) -> (f32, f32) {
        self.sync_epoch(shared);
        (self.window.last.frame.cue.arousal, self.trend.value())
    }

    /// Index of the newest frame shown and level of its sound; `None` before the first.
    pub(super) fn voice(&mut self, shared: &Shared) -> Option<(u64, f32)> {
        self.sync_epoch(shared);
        let frame = &self.window.last.frame;
        self.window.any.then_some((frame.index, frame.cue.level))
    }

    /// Whether every frame of a stream of `total` frames was shown.
    pub(super) fn is_done(&mut self, shared: &Shared, total: u64) -> bool {
        self.sync_epoch(shared);
        let Self { to_rest, source, window, .. } = self;
        let shown = if window.any { (window.last.frame.index + 1).saturating_sub(source.base()) } else { 0 };
        let tail = if total > 0 { source.tail() } else { 0 };
        !window.has_next && to_rest.left() == 0 && shown >= total + tail
    }

    /// Asks the engine for motion on silence, if the idle mode is live and no audio comes.
    pub(super) fn want_silence(&self, shared: &Shared) {
        self.idle.want_silence(&shared.link, &shared.host);
    }

    /// Settings that a state must share with this session, besides the model.
    pub(super) fn identity(&self, pass: &mut StatePass, shared: &Shared) -> Result<(), StateError> {
        pass.same("queue of frames", shared.link.frames.capacity() as u64)?;
        self.idle.identity(pass)?;
        let packets = shared.packets.as_ref().map_or(0, PacketQueue::identity);
        let voice = u64::from(self.source.is_live()) + if self.source.is_mouth() { MOUTH_STATE } else { 0 };
        pass.same("voice, or of packets", voice + 2 * packets)?;
        self.layers.stack.identity(pass)
    }

    /// Describes the frame side, in the order of the format. Rest is the model's and is not saved.
    pub(super) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        let Self { to_rest, source, arrival, layers, trend, window, sample, idle, gained, .. } = self;
        source.epoch_state(pass)?;
        window.flags_state(pass)?;
        idle.state(pass)?;
        window.state(pass)?;
        layers.state(pass)?;
        trend.state(pass)?;
        source.voice_state(pass)?;
        layers.controls_state(pass)?;
        idle.still_state(pass)?;
        let eased = to_rest.state(pass)?;
        arrival.state(pass)?;
        idle.seam_state(pass)?;
        source.state(pass, eased)?;
        sample.state(pass)?;
        idle.seam_time_state(pass)?;
        gained.state(pass)
    }
}
