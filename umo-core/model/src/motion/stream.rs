//! Frames from codes that become known incrementally; each frame is emitted once and in order (SPEC 2.8).

use std::ops::Range;

use umo_core_base::error::{StepError, check_finite};
use umo_core_base::memory::{Arena, Slice};
use umo_core_base::state::{StateError, StatePass};
use umo_core_pose::part::{Part, PerPart};
use umo_core_pose::pose::{HEIGHT, Pose, VELOCITY_X, VELOCITY_Z, finite};

use super::root::Travel;
use super::smoothing::Smoothing;
use super::vq::{Codebook, Latent, MotionScratch};
use super::{MotionDecoder, scatter};
use crate::linear::Compute;

/// Number of frames by which a seam's fade is longer than the run of frames that were decoded without their
/// future.
const FADE_BEYOND: usize = 2;

/// A frame emitted by a stream.
#[derive(Clone, Copy, Debug)]
pub struct FrameRef<'a> {
    /// Number of the frame, from 0.
    pub index: usize,
    /// The body. With an ARKit face, the eyes follow the gaze channels.
    pub pose: &'a Pose,
    /// Face values, in the order of the model's names.
    pub face: &'a [f32],
    /// Channels of each part from which the pose was computed, after smoothing and the blending of seams.
    pub channels: PerPart<&'a [f32]>,
}

/// Bound of the root's speed, m/s: far above that of a body, far below the result of a damaged weight.
const MAX_SPEED: f32 = 50.0;
/// Bound of a part's channels: rows of rotations, metres per second, expression coefficients.
const MAX_CHANNEL: f32 = 1000.0;
const MAX_HEIGHT: f32 = 100.0;

/// Continuation after the newest code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Future {
    /// Further codes, not yet known: the newest one is repeated in their place. A decoder that is cut off
    /// sees zeros instead, which are not valid motion; at the start of a stream with few codes, the root
    /// would then be far below its height.
    Held,
    /// Nothing, as at the end of a whole decode.
    End,
}

impl Future {
    /// Number of frames to repeat the newest code for, if a network sees `reach` frames ahead.
    fn frames(self, reach: usize) -> usize {
        match self {
            Self::Held => reach,
            Self::End => 0,
        }
    }
}

/// State of one stream: the part of the past that the decoders still need, and the position of the root.
///
/// A body part's row is *settled* once all codes within its decoders' reach after it are known. Its bits are then
/// the same as after decoding the whole stream at once. Rows after the last settled one are decoded as if the
/// newest code repeated, and decoded again when more codes are known. At the end of the stream they are
/// decoded as if nothing followed. If such a row was emitted, the next row begins a seam: the difference
/// between the last row as emitted and the same row decoded anew is added to the following rows, fading
/// linearly to zero over `reach - lookahead + 2` frames. The root's velocity is integrated and cannot jump;
/// its height is faded likewise.
///
/// [`Smoothing`] filters the rows of the body's parts and of the root before that. The face is not filtered:
/// a smoothed mouth loses its consonants. At least as many frames are held back as the filter looks ahead.
/// The fade of a filtered part is a cubic that also continues the seam's growth.
#[derive(Debug)]
pub struct MotionStream<T> {
    parts: PerPart<PartState<T>>,
    /// Number of frames whose codes are known.
    known: usize,
    /// Number of emitted frames.
    emitted: usize,
    smoothing: Smoothing,
    travel: Travel,
    /// Height of the last emitted frame.
    height: f32,
    pose: Pose,
    face: Slice<f32>,
    max_push: usize,
    max_lookahead: usize,
}

/// Progress of decoding and emitting frames, one decoder at a time.
#[derive(Debug)]
pub struct Push {
    /// Number of new frames.
    frames: usize,
    /// Frames before this one are emitted.
    until: usize,
    /// Length of the stream in frames; the root stays still from there on.
    end: usize,
    lookahead: usize,
    future: Future,
    /// Next part to decode, and its next decoder. Beyond the last part, the frames are emitted.
    part: usize,
    decoder: usize,
}

impl Push {
    /// Sets the length of the stream, if known.
    pub(crate) fn ending_at(self, end: Option<usize>) -> Self {
        Self { end: end.unwrap_or(usize::MAX), ..self }
    }
}

#[derive(Debug)]
struct PartState<T> {
    /// Maximum reach of the part's decoders.
    reach: usize,
    smoothing: Smoothing,
    /// Latents of each of the part's decoders, `[frames, width]`.
    known: Slice<Tail<T>>,
    /// `[frames, channels]`: decoded rows.
    rows: Tail<f32>,
    /// `[channels]`: the last emitted frame.
    last: Slice<f32>,
    /// `[channels]`: the frame emitted before it.
    before: Slice<f32>,
    /// `[channels]`: offset that the seam adds at its start.
    seam: Slice<f32>,
    /// `[channels]`: growth of that offset per frame at its start; 0 without smoothing.
    growth: Slice<f32>,
}

impl<T: Latent> MotionStream<T> {
    /// Creates a stream that takes at most `max_push` frames at a time, and holds back at most
    /// `max_lookahead` frames or as many as `smoothing` needs.
    pub fn new(decoder: &MotionDecoder, max_push: usize, max_lookahead: usize, smoothing: Smoothing) -> Self {
        Self::new_in(decoder, (max_push, max_lookahead), smoothing, &Arena::system())
    }

    /// Like [`Self::new`], in memory of `arena`.
    pub fn new_in(
        decoder: &MotionDecoder,
        (max_push, max_lookahead): (usize, usize),
        smoothing: Smoothing,
        arena: &Arena,
    ) -> Self {
        let max_lookahead = max_lookahead.max(smoothing.radius());
        let parts = PerPart::from_fn(|part| {
            let (reach, channels) = (decoder.reach_of(part), decoder.channels(part));
            let smoothing = if part == Part::Face { Smoothing::OFF } else { smoothing };
            // Seams look back from the last emitted frame, and the root network looks back from there.
            let past = smoothing.past() + if part == Part::Lower { decoder.root.reach() } else { 0 };
            PartState {
                reach,
                smoothing,
                known: arena.collect_len(
                    decoder.decoders_of(part).count(),
                    decoder
                        .decoders_of(part)
                        .map(|(_, decoder)| Tail::new_in(2 * reach + max_push, T::width(decoder.codebook()), arena)),
                ),
                rows: Tail::new_in(reach.max(max_lookahead + 1 + past) + max_push, channels, arena),
                last: arena.filled(0.0, channels),
                before: arena.filled(0.0, channels),
                seam: arena.filled(0.0, channels),
                growth: arena.filled(0.0, channels),
            }
        });
        let face = arena.filled(0.0, decoder.assembly.face_values());
        let (travel, height) = (Travel::default(), 0.0);
        Self { parts, known: 0, emitted: 0, smoothing, travel, height, pose: Pose::REST, face, max_push, max_lookahead }
    }

    /// Resets the stream to its start.
    pub fn reset(&mut self) {
        for part in Part::ALL {
            self.parts[part].known.iter_mut().for_each(Tail::clear);
            self.parts[part].rows.clear();
            self.parts[part].seam.fill(0.0);
            self.parts[part].growth.fill(0.0);
        }
        (self.known, self.emitted) = (0, 0);
        self.travel = Travel::default();
    }

    /// Describes the stream after `known` frames, its latents with `values`. Excludes the pose and the face
    /// values, which are always written before they are read.
    pub(crate) fn state(
        &mut self,
        pass: &mut StatePass,
        decoder: &MotionDecoder,
        known: usize,
        values: impl Fn(&Codebook, &mut StatePass, &mut [T]) -> Result<(), StateError>,
    ) -> Result<(), StateError> {
        let emitted = pass.length("frames put out", &mut self.emitted, known as u64)?;
        pass.must(known as u64 - emitted <= self.max_lookahead as u64, "frames put out")?;
        if pass.loads() {
            self.known = known;
        }
        self.travel.state(pass)?;
        pass.moderate(std::slice::from_mut(&mut self.height))?;
        for part in Part::ALL {
            let state = &mut self.parts[part];
            // Latents that the next frames are decoded from, and the rows that they need beside them.
            let (codes, settled) = (known.saturating_sub(2 * state.reach), known.saturating_sub(state.reach));
            let past = state.smoothing.past() + if part == Part::Lower { decoder.root.reach() } else { 0 };
            let rows = settled.min(usize::try_from(emitted).unwrap_or(usize::MAX).saturating_sub(1 + past));
            for (tail, (_, decoder)) in state.known.iter_mut().zip(decoder.decoders_of(part)) {
                tail.state(pass, codes..known, |pass, latents| values(decoder.codebook(), pass, latents))?;
            }
            state.rows.state(pass, rows..known, |pass, values| pass.moderate(values))?;
            for values in [&mut state.last, &mut state.before, &mut state.seam, &mut state.growth] {
                pass.moderate(values)?;
            }
        }
        Ok(())
    }

    /// Number of frames whose codes are known.
    pub fn known(&self) -> usize {
        self.known
    }

    /// Position of the root in the last emitted frame: x and z, metres.
    pub fn place(&self) -> [f32; 2] {
        let [x, _, z] = self.travel.place(0.0);
        [x, z]
    }

    /// Number of emitted frames.
    pub fn emitted(&self) -> usize {
        self.emitted
    }

    /// Takes the codes or vectors of the next frames, for each of [`MotionDecoder::decoders`]. Emits all known
    /// frames except the last `lookahead`, or as many as smoothing needs. Never allocates.
    ///
    /// `scratch` must have room for [`MotionDecoder::stream_rows`] frames.
    ///
    /// # Errors
    /// [`StepError`] if the parts have different numbers of frames, a code is out of range, or there are more
    /// frames than the stream was created for. The stream is then unchanged.
    pub fn push(
        &mut self,
        cx: Compute,
        decoder: &MotionDecoder,
        scratch: &mut MotionScratch,
        latents: &[&[T]],
        lookahead: usize,
        out: &mut dyn FnMut(FrameRef),
    ) -> Result<(), StepError> {
        let mut push = self.begin_push(decoder, scratch, latents, lookahead)?;
        while self.push_step(cx, decoder, scratch, latents, &mut push, out)? {}
        Ok(())
    }

    /// Begins [`Self::push`], to be continued with [`Self::push_step`].
    ///
    /// # Errors
    /// As [`Self::push`].
    pub fn begin_push(
        &mut self,
        decoder: &MotionDecoder,
        scratch: &MotionScratch,
        latents: &[&[T]],
        lookahead: usize,
    ) -> Result<Push, StepError> {
        let frames = decoder.check(latents)?;
        if frames > self.max_push {
            return Err(StepError::TooLong { what: "frames at once", got: frames, limit: self.max_push });
        }
        let lookahead = lookahead.max(self.smoothing.radius());
        if lookahead > self.max_lookahead {
            return Err(StepError::TooLong { what: "lookahead", got: lookahead, limit: self.max_lookahead });
        }
        let rows = decoder.stream_rows(self.max_push, self.max_lookahead);
        if scratch.rows() < rows {
            return Err(StepError::TooLong { what: "frames of motion", got: rows, limit: scratch.rows() });
        }
        let until = (self.known + frames).saturating_sub(lookahead);
        let part = if frames > 0 { 0 } else { Part::ALL.len() };
        Ok(Push { frames, until, end: usize::MAX, lookahead, future: Future::Held, part, decoder: 0 })
    }

    /// Runs the next decoder of a push, or emits its frames. Returns whether there is more to do. `latents`
    /// must be those passed to [`Self::begin_push`]; after [`Self::begin_finish`] they are ignored.
    ///
    /// # Errors
    /// As [`Self::push`].
    pub fn push_step(
        &mut self,
        cx: Compute,
        decoder: &MotionDecoder,
        scratch: &mut MotionScratch,
        latents: &[&[T]],
        push: &mut Push,
        out: &mut dyn FnMut(FrameRef),
    ) -> Result<bool, StepError> {
        if let Some(&part) = Part::ALL.get(push.part) {
            if push.decoder == 0 {
                self.make_room(decoder, part, push.frames);
            }
            if push.decoder < decoder.decoders_of(part).count() {
                self.extend(cx, decoder, scratch, (part, push.decoder), (latents, push.frames), push.future)?;
            }
            push.decoder += 1;
            if push.decoder >= decoder.decoders_of(part).count() {
                (push.part, push.decoder) = (push.part + 1, 0);
            }
            return Ok(true);
        }
        self.known += push.frames;
        self.emit(cx, decoder, scratch, push, out)?;
        Ok(false)
    }

    /// Emits the frames up to `total`. The stream then needs a [`reset`](Self::reset). Never allocates.
    ///
    /// # Errors
    /// [`StepError`] if the codes of some of these frames are not known.
    pub fn finish(
        &mut self,
        cx: Compute,
        decoder: &MotionDecoder,
        scratch: &mut MotionScratch,
        total: usize,
        out: &mut dyn FnMut(FrameRef),
    ) -> Result<(), StepError> {
        let mut push = self.begin_finish(total)?;
        while self.push_step(cx, decoder, scratch, &[], &mut push, out)? {}
        Ok(())
    }

    /// Begins [`Self::finish`], to be continued with [`Self::push_step`].
    ///
    /// # Errors
    /// As [`Self::finish`].
    pub fn begin_finish(&self, total: usize) -> Result<Push, StepError> {
        if total > self.known {
            return Err(StepError::TooLong { what: "frames of a stream", got: total, limit: self.known });
        }
        let part = if total > self.emitted { 0 } else { Part::ALL.len() };
        Ok(Push { frames: 0, until: total, end: total, lookahead: 0, future: Future::End, part, decoder: 0 })
    }

    /// Makes room for the rows of `part` that change with `new` frames: the rows that were not settled, and
    /// the new ones.
    fn make_room(&mut self, decoder: &MotionDecoder, part: Part, new: usize) {
        let keep = self.oldest(decoder, part);
        let state = &mut self.parts[part];
        let settled = self.known.saturating_sub(state.reach);
        state.rows.forget(keep.min(settled));
        state.rows.truncate(settled);
        state.rows.grow(self.known + new - settled);
    }

    /// Decodes all rows that change with the new `latents` and `future`, using one decoder of a part. `which`
    /// counts among the part's decoders.
    fn extend(
        &mut self,
        cx: Compute,
        decoder: &MotionDecoder,
        scratch: &mut MotionScratch,
        (part, which): (Part, usize),
        (latents, new): (&[&[T]], usize),
        future: Future,
    ) -> Result<(), StepError> {
        let (known, state) = (self.known + new, &mut self.parts[part]);
        let settled = self.known.saturating_sub(state.reach);
        // Rows nearer than `reach` to the first latent would see zeros in place of earlier codes.
        let first = settled.saturating_sub(state.reach);
        let width = decoder.channels(part);
        let place = state.rows.last_mut(known - settled);
        for (tail, (index, decoder)) in state.known.iter_mut().zip(decoder.decoders_of(part)).skip(which).take(1) {
            tail.forget(first);
            if new > 0 {
                tail.append(latents[index]);
            }
            let decoded = decoder.decode_held(cx, scratch, tail.all(), future.frames(state.reach))?;
            let channels = decoder.channels();
            let rows = &decoded[(settled - first) * channels..(known - first) * channels];
            check_channels(rows)?;
            scatter(decoder, rows, width, place);
        }
        Ok(())
    }

    /// Returns the first row of `part` that the next frame needs: the first that its seam reads, or the start
    /// of the root network's reach before that.
    fn oldest(&self, decoder: &MotionDecoder, part: Part) -> usize {
        let past = self.parts[part].smoothing.past() + if part == Part::Lower { decoder.root.reach() } else { 0 };
        self.emitted.saturating_sub(1 + past)
    }

    /// Emits the frames from the first one not yet emitted up to `until`.
    fn emit(
        &mut self,
        cx: Compute,
        decoder: &MotionDecoder,
        scratch: &mut MotionScratch,
        &Push { until, end, lookahead, future, .. }: &Push,
        out: &mut dyn FnMut(FrameRef),
    ) -> Result<(), StepError> {
        if until <= self.emitted {
            return Ok(());
        }
        let (first, start) = (self.oldest(decoder, Part::Lower), self.emitted);
        let lower = self.parts.lower.rows.range(first..self.known);
        let rows = decoder.root.run_held(cx, scratch, lower, future.frames(decoder.root.reach()))?;
        let root = Root { rows, first, end: self.known, channels: decoder.root.channels(), smoothing: self.smoothing };
        root.check(start, until)?;
        let height_seam = if start == 0 { 0.0 } else { self.height - finite(root.moves(start - 1)[1]) };
        let height_fade = Fade::new(decoder.root.reach(), lookahead);
        if start > 0 {
            for part in Part::ALL {
                self.parts[part].begin_seam(start - 1, self.known);
            }
        }
        for index in start..until {
            if (1..end).contains(&index) {
                let [x, _, z] = root.moves(index - 1);
                self.travel.advance([x, z], decoder.frame_seconds);
            }
            for part in Part::ALL {
                let fade = Fade::new(self.parts[part].reach, lookahead);
                self.parts[part].blend(index, self.known, fade, index - start);
            }
            let height = finite(root.moves(index)[1]);
            self.height = added(height, height_seam, height_fade.weight(index - start));
            self.assemble(decoder);
            self.emitted = index + 1;
            let channels = PerPart::from_fn(|part| &*self.parts[part].last);
            out(FrameRef { index, pose: &self.pose, face: &self.face, channels });
        }
        Ok(())
    }

    /// Assembles the pose from the last blended rows.
    fn assemble(&mut self, decoder: &MotionDecoder) {
        let channels = PerPart::from_fn(|part| &*self.parts[part].last);
        decoder.assembly.face(channels.face, &mut self.face);
        self.pose.rotations = decoder.assembly.rotations(channels);
        decoder.assembly.turn_eyes(&self.face, &mut self.pose.rotations);
        self.pose.translation = self.travel.place(self.height);
    }
}

impl<T> PartState<T> {
    /// Begins a seam: the difference between frame `index` as emitted and as decoded now.
    fn begin_seam(&mut self, index: usize, known: usize) {
        let Self { smoothing, rows, last, before, seam, growth, .. } = self;
        let row = |row: usize| rows.range(row..row + 1);
        smoothing.apply(index, 0..known, row, seam);
        seam.iter_mut().zip(last.iter()).for_each(|(seam, last)| *seam = finite(last - *seam));
        if smoothing.radius() > 0 && index > 0 {
            smoothing.apply(index - 1, 0..known, row, growth);
            for ((growth, before), seam) in growth.iter_mut().zip(before.iter()).zip(seam.iter()) {
                *growth = finite(seam - (before - *growth));
            }
        }
    }

    /// Sets `last` to the row of frame `index`, plus the remaining part of the seam.
    fn blend(&mut self, index: usize, known: usize, fade: Fade, after: usize) {
        let Self { smoothing, rows, last, before, seam, growth, .. } = self;
        std::mem::swap(last, before);
        smoothing.apply(index, 0..known, |row| rows.range(row..row + 1), last);
        if smoothing.radius() == 0 {
            let weight = fade.weight(after);
            last.iter_mut().zip(seam.iter()).for_each(|(last, seam)| *last = added(*last, *seam, weight));
        } else {
            let (weight, grown) = fade.smooth(after);
            let seams = seam.iter().zip(growth.iter()).map(|(seam, growth)| seam * weight + growth * grown);
            last.iter_mut().zip(seams).for_each(|(last, seam)| *last = added(*last, seam, 1.0));
        }
    }
}

/// Checks that channels are plausible for a body.
fn check_channels(channels: &[f32]) -> Result<(), StepError> {
    // No early exit, so that many values are compared at once.
    if channels.iter().fold(true, |good, v| good & (v.abs() <= MAX_CHANNEL)) {
        return Ok(());
    }
    check_finite(channels, "motion channels")?;
    Err(StepError::Implausible("a motion channel is larger than 1000"))
}

/// Computes `value + seam * weight`; returns exactly `value` if the seam is zero or the sum is not finite.
fn added(value: f32, seam: f32, weight: f32) -> f32 {
    let sum = value + seam * weight;
    if seam == 0.0 || weight == 0.0 || !sum.is_finite() { value } else { sum }
}

/// Weight of a seam over the frames that follow it.
#[derive(Clone, Copy, Debug)]
struct Fade {
    frames: usize,
}

impl Fade {
    fn new(reach: usize, lookahead: usize) -> Self {
        Self { frames: reach.saturating_sub(lookahead) + FADE_BEYOND }
    }

    /// Weight of the seam: below 1 at the first frame after the seam, 0 from the `frames`-th on.
    fn weight(self, after: usize) -> f32 {
        let share = (after + 1).min(self.frames) as f32 / self.frames as f32;
        1.0 - share
    }

    /// Weights of a seam and of its growth per frame: cubics that continue both and end with zero value and
    /// slope.
    fn smooth(self, after: usize) -> (f32, f32) {
        let frames = self.frames as f32;
        let t = (after + 1).min(self.frames) as f32 / frames;
        let rest = (1.0 - t) * (1.0 - t);
        (rest * (1.0 + 2.0 * t), rest * t * frames)
    }
}

/// Output of the root network for the frames from `first` on.
struct Root<'a> {
    rows: &'a [f32],
    first: usize,
    /// One more than the number of the last known frame.
    end: usize,
    channels: usize,
    smoothing: Smoothing,
}

impl Root<'_> {
    /// Smoothed velocity along x, height, and velocity along z at a frame.
    fn moves(&self, index: usize) -> [f32; 3] {
        let mut moves = [0.0; 3];
        self.smoothing.apply(index, 0..self.end, |row| &self.row(row)[VELOCITY_X..], &mut moves);
        moves
    }

    fn row(&self, index: usize) -> &[f32] {
        &self.rows[(index - self.first) * self.channels..][..self.channels]
    }

    /// Checks that the root's motion is plausible in the frames `start..until`, the frame before them, and
    /// the frames that smoothing reads.
    fn check(&self, start: usize, until: usize) -> Result<(), StepError> {
        let radius = self.smoothing.radius();
        for index in start.saturating_sub(1 + radius)..(until + radius).min(self.end) {
            let row = self.row(index);
            let moves = [row[VELOCITY_X], row[HEIGHT], row[VELOCITY_Z]];
            check_finite(&moves, "root velocity and height")?;
            // Not `hypot`, which would need glibc 2.35. A square that overflows also exceeds the limit.
            if row[VELOCITY_X].powi(2) + row[VELOCITY_Z].powi(2) > MAX_SPEED * MAX_SPEED {
                return Err(StepError::Implausible("the root moves faster than 50 m/s"));
            }
            if row[HEIGHT].abs() > MAX_HEIGHT {
                return Err(StepError::Implausible("the root is more than 100 m from the ground"));
            }
        }
        Ok(())
    }
}

/// The newest rows of a growing sequence, up to a fixed capacity.
#[derive(Debug)]
struct Tail<T> {
    /// `[capacity, width]`
    data: Slice<T>,
    width: usize,
    /// Number of the row at the start of `data`.
    start: usize,
    /// One more than the number of the last row.
    end: usize,
}

impl<T: Copy + Default> Tail<T> {
    fn new_in(capacity: usize, width: usize, arena: &Arena) -> Self {
        Self { data: arena.filled(T::default(), capacity * width), width, start: 0, end: 0 }
    }

    fn clear(&mut self) {
        (self.start, self.end) = (0, 0);
    }

    /// Describes the rows up to the end of `needed`: at least all of `needed`, and possibly some before.
    fn state(
        &mut self,
        pass: &mut StatePass,
        needed: Range<usize>,
        values: impl Fn(&mut StatePass, &mut [T]) -> Result<(), StateError>,
    ) -> Result<(), StateError> {
        let rows = pass.count("motion", self.end - self.start, self.data.len() / self.width)?;
        pass.must((needed.len()..=needed.end).contains(&rows), "motion")?;
        if pass.loads() {
            (self.start, self.end) = (needed.end - rows, needed.end);
        }
        values(pass, &mut self.data[..rows * self.width])
    }

    /// Drops the rows before `row`.
    fn forget(&mut self, row: usize) {
        let drop = row.clamp(self.start, self.end) - self.start;
        let len = (self.end - self.start) * self.width;
        self.data.copy_within(drop * self.width..len, 0);
        self.start += drop;
    }

    /// Drops the rows from `row` on.
    fn truncate(&mut self, row: usize) {
        self.end = row.clamp(self.start, self.end);
    }

    /// Appends `rows` rows, whose values must then be written.
    fn grow(&mut self, rows: usize) {
        self.end += rows;
        assert!((self.end - self.start) * self.width <= self.data.len(), "a stream was made for as many rows");
    }

    /// The last `rows` rows.
    fn last_mut(&mut self, rows: usize) -> &mut [T] {
        let len = (self.end - self.start) * self.width;
        &mut self.data[len - rows * self.width..len]
    }

    fn append(&mut self, rows: &[T]) {
        let len = (self.end - self.start) * self.width;
        self.data[len..len + rows.len()].copy_from_slice(rows);
        self.end += rows.len() / self.width;
    }

    fn range(&self, rows: Range<usize>) -> &[T] {
        &self.data[(rows.start - self.start) * self.width..(rows.end - self.start) * self.width]
    }

    fn all(&self) -> &[T] {
        self.range(self.start..self.end)
    }
}
