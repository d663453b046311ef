//! The receiving side of a stream of packets.

use umo_core_base::arousal::ORDINARY;
use umo_core_base::error::{LoadError, StepError};
use umo_core_base::memory::{self, Arena, filled, with_capacity};
use umo_core_model::avatar::AvatarConfig;
use umo_core_model::config::Config;
use umo_core_model::interp::InterpScratch;
use umo_core_model::layout::{Run, Shape, Window};
use umo_core_model::linear::Compute;
use umo_core_model::model::Model;
use umo_core_model::motion::{FrameRef, MotionScratch, Smoothing};
use umo_core_model::mouth::{Mouth, MouthOver};

use super::{PacketError, PacketHead, PacketLayout, SOUND, byte_arousal, byte_level};

/// Sound of a keyframe of which nothing is known.
const SILENCE: [f32; SOUND] = [0.0, ORDINARY];

/// Maximum number of packets that wait for a missing one.
const WAITING: usize = 4;

/// Statistics of a stream's packets.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Received {
    /// Packets used.
    pub packets: u64,
    /// Packets that arrived too late or twice, and were ignored.
    pub late: u64,
    /// Chunks whose packet did not arrive in time.
    pub lost: u64,
    /// Keyframes of lost chunks that no other packet repeated: the previous one was held.
    pub held: u64,
}

/// Receiver of the frames of a packet stream.
pub(crate) trait PacketSink {
    /// Number of frames that it has room for.
    fn room(&self) -> usize;
    /// Called when a later stream begins.
    fn begin(&mut self);
    /// Receives the next frame, with its audio level and arousal, and whether a prompt says what it shows.
    fn frame(&mut self, frame: FrameRef, sound: [f32; SOUND], is_prompted: bool);
}

/// Sink with unlimited room.
struct Frames<'a>(&'a mut dyn FnMut(FrameRef));

impl PacketSink for Frames<'_> {
    fn room(&self) -> usize {
        usize::MAX
    }

    fn begin(&mut self) {}

    fn frame(&mut self, frame: FrameRef, _: [f32; SOUND], _: bool) {
        (self.0)(frame);
    }
}

/// Computes the frames of one avatar's packets: interpolation and motion decoders, without the language model. It
/// needs the sender's model config and settings. Without packet loss, and with the same instruction set on both
/// sides, its frames are bit-identical to the sender's without layers.
#[derive(Debug)]
pub struct Decoder {
    layout: PacketLayout,
    window: Window,
    run: Run,
    interp: InterpScratch,
    scratch: MotionScratch,
    target: usize,
    prefix: usize,
    stride: usize,
    lookahead: usize,
    /// Number of later packets that may arrive before a missing one counts as lost.
    reorder_window: usize,
    /// Number of the current stream, once one of its packets arrived.
    stream: Option<u8>,
    /// Sequence number of the next packet.
    next: u32,
    is_over: bool,
    /// Frames of the current stream, once its last packet was used.
    total: Option<u32>,
    waiting: Vec<Slot>,
    /// Sounds, codes and mouth of the packet that just arrived.
    arrived_sounds: Box<[[u8; SOUND]]>,
    arrived: Box<[u16]>,
    arrived_mouth: Box<[u8]>,
    /// The mouth of the frames that are computed.
    lips: Lips,
    /// Audio level and arousal of keyframe `k`, at index `k % len`; `SILENCE` if unknown.
    sounds: Box<[[f32; SOUND]]>,
    /// `[P + N, codes of a keyframe]`: codes of the chunk being assembled.
    chunk: Box<[u16]>,
    /// The last keyframe.
    held: Box<[u16]>,
    /// Rest codes.
    rest: Box<[u16]>,
    /// Codes of the last keyframes before a stream's start; empty for rest.
    history: Box<[u16]>,
    /// Whether no chunk has been computed since the motion began.
    is_first: bool,
    /// Number of frames before the motion's first.
    base: usize,
    place: Place,
    is_prompted: bool,
    received: Received,
}

/// A packet that arrived early.
#[derive(Debug)]
struct Slot {
    head: Option<PacketHead>,
    sounds: Box<[[u8; SOUND]]>,
    codes: Box<[u16]>,
    mouth: Box<[u8]>,
}

/// Share of the way between the mouth of the codes and that of a packet in one frame, after a loss.
const FADE: f32 = 0.25;

/// The mouth that packets have, over frames.
#[derive(Debug)]
struct Lips {
    over: Option<MouthOver>,
    /// Number of its channels.
    width: usize,
    /// `[frames, channels]` of the packet that is computed, the first of them, and how many there are.
    said: Box<[u8]>,
    first: usize,
    frames: usize,
    /// The last frame that was said, and its share in the last one that was shown; `None` before the first.
    last: Box<[u8]>,
    share: Option<f32>,
}

impl Lips {
    fn new(model: &Model, layout: &PacketLayout) -> Self {
        let width = layout.mouth();
        let over = |mouth| {
            let (names, values) = (&model.config().face.names, model.assembly().face_values());
            MouthOver::new_in(mouth, names, values, &Arena::system())
        };
        Self {
            over: model.mouth().filter(|_| width > 0).map(over),
            width,
            said: filled(0, layout.max_mouth_frames() * width).into(),
            first: 0,
            frames: 0,
            last: filled(0, width).into(),
            share: None,
        }
    }

    /// Returns to the start of a stream.
    fn reset(&mut self) {
        (self.frames, self.share) = (0, None);
    }

    /// Takes over a packet's mouth, of frames from `first` on.
    fn take(&mut self, said: &[u8], first: usize) {
        self.said[..said.len()].copy_from_slice(said);
        (self.first, self.frames) = (first, said.len().checked_div(self.width).unwrap_or_default());
    }

    /// Returns a frame with its mouth.
    fn put<'a>(&'a mut self, mouth: Option<&Mouth>, frame: FrameRef<'a>) -> FrameRef<'a> {
        let (Some(over), Some(mouth)) = (&mut self.over, mouth) else { return frame };
        let at = frame.index.checked_sub(self.first).filter(|&at| at < self.frames);
        let goal: f32 = if at.is_some() { 1.0 } else { 0.0 };
        let share = self.share.map_or(goal, |share| goal.clamp(share - FADE, share + FADE));
        self.share = Some(share);
        if let Some(at) = at {
            self.last.copy_from_slice(&self.said[at * self.width..][..self.width]);
        }
        if share <= 0.0 {
            return frame;
        }
        let (pose, face) = over.put(mouth, &frame, &self.last, share);
        FrameRef { pose, face, ..frame }
    }
}

/// Correction of the root towards the sender's: after a loss, the two have diverged.
#[derive(Clone, Copy, Debug, Default)]
struct Place {
    /// Added to x and z.
    offset: [f32; 2],
    /// Remainder to be added, over `frames` frames.
    more: [f32; 2],
    frames: usize,
    /// Number of these frames that have passed.
    done: usize,
    /// x and z of the last frame as decoded.
    own: [f32; 2],
}

impl Place {
    fn shift(&self) -> [f32; 2] {
        #[expect(clippy::cast_precision_loss, reason = "a chunk is short")]
        let share = if self.frames == 0 { 0.0 } else { self.done as f32 / self.frames as f32 };
        [0, 1].map(|axis| self.offset[axis] + share * self.more[axis])
    }

    /// Moves the root to the sender's position within `frames` frames.
    fn heal(&mut self, sent: [f32; 2], frames: usize) {
        let offset = self.shift();
        let more = [0, 1].map(|axis| sent[axis] - (self.own[axis] + offset[axis]));
        *self = if more == [0.0; 2] {
            Self { offset, more, frames: 0, done: 0, own: self.own }
        } else {
            Self { offset, more, frames, done: 0, own: self.own }
        };
    }

    /// Emits the frame with the root corrected. Without a correction it is bit-identical to the decoded frame.
    fn put(&mut self, frame: FrameRef, (sound, is_prompted): ([f32; SOUND], bool), out: &mut dyn PacketSink) {
        self.own = [frame.pose.translation[0], frame.pose.translation[2]];
        self.done = (self.done + 1).min(self.frames);
        let shift = self.shift();
        if shift == [0.0; 2] {
            return out.frame(frame, sound, is_prompted);
        }
        let mut pose = *frame.pose;
        pose.translation[0] += shift[0];
        pose.translation[2] += shift[1];
        out.frame(FrameRef { pose: &pose, ..frame }, sound, is_prompted);
    }
}

impl Decoder {
    /// Creates a decoder for packets of avatars with this model and these settings, of which target, lookahead and
    /// smoothing matter. With `reorder_window` 0 a packet counts as lost when a later one arrives; up to 4 later ones may
    /// arrive before it. Allocates everything it will need.
    ///
    /// # Errors
    /// [`LoadError::Argument`] if a number is out of range; [`LoadError::Memory`] if out of memory.
    pub fn new(model: &Model, config: &AvatarConfig, reorder_window: usize) -> Result<Self, LoadError> {
        memory::catch(|| Self::make(model, config, reorder_window))?
    }

    fn make(model: &Model, config: &AvatarConfig, reorder_window: usize) -> Result<Self, LoadError> {
        let c = model.config();
        model.check_body()?;
        config.check(c)?;
        if reorder_window > WAITING {
            return Err(LoadError::argument(
                "reorder_window",
                format!("expected 0 to {WAITING}, got {reorder_window}"),
            ));
        }
        let (stride, lookahead) = (c.keyframe_stride, config.held_back());
        let (max_push, count) = (config.target * stride, c.codes_per_keyframe());
        let smoothing = Smoothing::new(config.smoothing)?;
        let shape = Shape { target: config.target, lookahead, smoothing };
        let layout = PacketLayout::new(model);
        let mut waiting = with_capacity(WAITING);
        waiting.extend((0..WAITING).map(|_| Slot {
            head: None,
            sounds: filled([0; SOUND], c.prefix).into(),
            codes: filled(0, c.prefix * count).into(),
            mouth: filled(0, layout.max_mouth_frames() * layout.mouth()).into(),
        }));
        Ok(Self {
            lips: Lips::new(model, &layout),
            arrived_mouth: filled(0, layout.max_mouth_frames() * layout.mouth()).into(),
            layout,
            window: Window::new_in(c, config.target, &Arena::system()),
            run: model.layout().run_in(c, model.motion(), shape, &Arena::system()),
            interp: model.layout().scratch(c, config.target),
            scratch: model.motion().scratch(model.motion().stream_rows(max_push, lookahead.max(smoothing.radius()))),
            target: config.target,
            prefix: c.prefix,
            stride,
            lookahead,
            reorder_window,
            stream: None,
            next: 0,
            is_over: false,
            total: None,
            waiting,
            arrived_sounds: filled([0; SOUND], c.prefix).into(),
            arrived: filled(0, c.prefix * count).into(),
            // Of the frames held back, of a chunk, and one more.
            sounds: filled(SILENCE, lookahead.div_ceil(stride) + 2 * (config.target + 1)).into(),
            chunk: filled(0, (c.prefix + config.target) * count).into(),
            held: rest(c).into(),
            rest: rest(c).into(),
            history: Box::default(),
            is_first: true,
            base: 0,
            place: Place::default(),
            is_prompted: false,
            received: Received::default(),
        })
    }

    /// Statistics since the decoder was created.
    pub fn received(&self) -> Received {
        self.received
    }

    /// Frames of the current stream, once its last packet was used.
    pub(crate) fn total(&self) -> Option<u32> {
        self.total
    }

    /// Whether the last frame of the current stream was emitted.
    pub fn is_over(&self) -> bool {
        self.is_over
    }

    /// Maximum number of frames that one packet can make final.
    pub(crate) fn most_frames(&self) -> usize {
        let made_up = (self.reorder_window + 1) * (self.prefix / self.target);
        (made_up + self.reorder_window + 1) * self.target * self.stride + self.lookahead
    }

    /// Lets streams begin after keyframes of these codes, at most the history's, instead of rest.
    pub(crate) fn begin_after(&mut self, history: &[u16]) {
        self.history = history.into();
        self.begin();
    }

    /// Returns to the initial state, for any stream.
    pub fn reset(&mut self) {
        self.stream = None;
        self.begin();
    }

    /// Resets the state for the start of a stream.
    fn begin(&mut self) {
        self.window.rest();
        self.window.correct(&self.history);
        self.run.reset();
        self.lips.reset();
        self.waiting.iter_mut().for_each(|slot| slot.head = None);
        self.held.copy_from_slice(&self.rest);
        self.sounds.fill(SILENCE);
        (self.next, self.base, self.is_first, self.is_over) = (0, 0, true, false);
        self.total = None;
        self.place = Place::default();
    }

    /// Takes a packet and passes the frames that became final to `frame`, in order. A packet of a later stream starts
    /// that stream. Never allocates.
    ///
    /// # Errors
    /// [`PacketError`]; damaged packets and packets of other models change nothing.
    pub fn push_packet(
        &mut self,
        model: &Model,
        cx: Compute,
        bytes: &[u8],
        frame: &mut dyn FnMut(FrameRef),
    ) -> Result<(), PacketError> {
        self.push_to(model, cx, bytes, &mut Frames(frame))
    }

    /// Begins the packet's stream if it is a later one; returns whether the packet is of the current stream then.
    fn join(&mut self, head: &PacketHead, sink: &mut dyn PacketSink) -> bool {
        match self.stream {
            // Serial-number arithmetic: half of the numbers are later.
            Some(stream) if head.stream.wrapping_sub(stream) >= 128 => return false,
            Some(stream) if head.stream == stream => {}
            // The sink drops frames of the previous stream, so there is room.
            Some(_) => {
                self.begin();
                self.stream = Some(head.stream);
                sink.begin();
            }
            None => {
                self.begin();
                self.stream = Some(head.stream);
                // Joining in the middle of a stream: earlier packets were not lost.
                if head.sequence as usize > self.reorder_window {
                    self.jump(head, None);
                    self.next = head.sequence;
                }
            }
        }
        true
    }

    /// Like [`Self::push_packet`], for a sink of limited room.
    pub(crate) fn push_to(
        &mut self,
        model: &Model,
        cx: Compute,
        bytes: &[u8],
        sink: &mut dyn PacketSink,
    ) -> Result<(), PacketError> {
        let head = self.layout.decode(bytes, &mut self.arrived_sounds, &mut self.arrived, &mut self.arrived_mouth)?;
        if head.keyframes != 0 && head.keyframes != self.target {
            return Err(PacketError::Other("target"));
        }
        if !self.join(&head, sink) || self.is_over || head.sequence < self.next || self.is_waiting(head.sequence) {
            self.received.late += 1;
            return Ok(());
        }
        let ahead = (head.sequence - self.next) as usize;
        let waiting = self.waiting.iter().filter(|slot| slot.head.is_some()).count();
        if ahead == 0 || waiting >= self.reorder_window {
            // Waiting packets may be used too, and gaps between them are filled.
            let made_up = ahead.min((waiting + 1) * (self.prefix / self.target));
            let frames = (made_up + waiting + 1) * self.target * self.stride + self.lookahead;
            if sink.room() < frames {
                return Err(PacketError::Full);
            }
            // Packets missing before the first waiting one count as lost.
            if ahead > 0
                && let Some(slot) = self.first_waiting(head.sequence)
            {
                self.take_waiting(model, cx, slot, sink)?;
                self.take_next(model, cx, sink)?;
            } else {
                self.take(model, cx, &head, None, sink)?;
                self.received.packets += 1;
                return Ok(self.take_next(model, cx, sink)?);
            }
        }
        if head.sequence == self.next {
            self.take(model, cx, &head, None, sink)?;
        } else if let Some(slot) = self.waiting.iter_mut().find(|slot| slot.head.is_none()) {
            slot.head = Some(head);
            slot.sounds.copy_from_slice(&self.arrived_sounds);
            slot.codes.copy_from_slice(&self.arrived);
            slot.mouth.copy_from_slice(&self.arrived_mouth);
        }
        self.received.packets += 1;
        Ok(self.take_next(model, cx, sink)?)
    }

    /// Uses the waiting packets that follow without a gap.
    fn take_next(&mut self, model: &Model, cx: Compute, sink: &mut dyn PacketSink) -> Result<(), StepError> {
        while let Some(slot) = self.waiting.iter().position(|slot| slot.head.is_some_and(|h| h.sequence == self.next)) {
            self.take_waiting(model, cx, slot, sink)?;
        }
        Ok(())
    }

    fn is_waiting(&self, sequence: u32) -> bool {
        self.waiting.iter().any(|slot| slot.head.is_some_and(|head| head.sequence == sequence))
    }

    /// The first waiting packet before `sequence`.
    fn first_waiting(&self, sequence: u32) -> Option<usize> {
        let of = |(index, slot): (usize, &Slot)| Some((slot.head?.sequence, index));
        let first = self.waiting.iter().enumerate().filter_map(of).min();
        first.filter(|(first, _)| *first < sequence).map(|(_, index)| index)
    }

    fn take_waiting(
        &mut self,
        model: &Model,
        cx: Compute,
        slot: usize,
        sink: &mut dyn PacketSink,
    ) -> Result<(), StepError> {
        match self.waiting[slot].head.take() {
            Some(head) => self.take(model, cx, &head, Some(slot), sink),
            None => Ok(()),
        }
    }

    /// Uses the codes of a packet, from a slot or just arrived; first fills the gap that lost packets left before it.
    fn take(
        &mut self,
        model: &Model,
        cx: Compute,
        head: &PacketHead,
        slot: Option<usize>,
        sink: &mut dyn PacketSink,
    ) -> Result<(), StepError> {
        let (count, n) = (self.layout.codes(), self.target);
        let lost = (head.sequence - self.next) as usize;
        self.received.lost += lost as u64;
        let keyframes = lost.saturating_mul(n);
        // Missing keyframes that the packet repeats.
        let said = head.history.min(keyframes);
        self.received.held += (keyframes - said) as u64;
        self.lips.frames = 0;
        if lost > 0 && keyframes > self.prefix {
            self.jump(head, slot);
        } else {
            for chunk in 0..lost {
                for i in 0..n {
                    let keyframe = (self.next as usize + chunk) * n + i;
                    *sound_of(&mut self.sounds, keyframe) = SILENCE;
                    // Distance from this keyframe to the packet's first new one.
                    let back = keyframes - (chunk * n + i);
                    if back <= said {
                        let from = (head.history - back) * count;
                        let codes = codes_of(&self.waiting, &self.arrived, slot);
                        self.held.copy_from_slice(&codes[from..from + count]);
                    }
                    self.chunk[i * count..(i + 1) * count].copy_from_slice(&self.held);
                }
                self.compute(model, cx, n, None, sink)?;
            }
            if lost > 0 {
                let codes = codes_of(&self.waiting, &self.arrived, slot);
                self.window.correct(&codes[..head.history * count]);
            }
        }
        if head.mouth_frames > 0 {
            let said = slot.map_or(&*self.arrived_mouth, |slot| &self.waiting[slot].mouth);
            let begins = (head.sequence as usize).saturating_mul(n * self.stride);
            let first = begins.saturating_sub(head.mouth_back.into());
            self.lips.take(&said[..head.mouth_frames * self.layout.mouth()], first);
        }
        self.next = head.sequence.wrapping_add(1);
        self.is_prompted = head.is_prompted;
        let total = head.total.map(|total| (total as usize).saturating_sub(self.base));
        if head.keyframes > 0 {
            let codes = codes_of(&self.waiting, &self.arrived, slot);
            let new = &codes[head.history * count..(head.history + n) * count];
            self.chunk[..n * count].copy_from_slice(new);
            self.held.copy_from_slice(&new[(n - 1) * count..]);
            let heard = slot.map_or(&*self.arrived_sounds, |slot| &self.waiting[slot].sounds);
            for (i, &[level, arousal]) in heard[..n].iter().enumerate() {
                let sound = [byte_level(level), byte_arousal(arousal)];
                *sound_of(&mut self.sounds, head.sequence as usize * n + i) = sound;
            }
        }
        self.compute(model, cx, head.keyframes, total, sink)?;
        self.place.heal(head.root, n * self.stride);
        (self.is_over, self.total) = (head.total.is_some(), head.total);
        Ok(())
    }

    /// Restarts at a packet that is too far ahead to fill the gap.
    fn jump(&mut self, head: &PacketHead, slot: Option<usize>) {
        let count = self.layout.codes();
        let codes = codes_of(&self.waiting, &self.arrived, slot);
        self.window.rest();
        self.window.correct(&codes[..head.history * count]);
        self.run.reset();
        self.lips.reset();
        self.sounds.fill(SILENCE);
        (self.is_first, self.base) = (true, head.sequence as usize * self.target * self.stride);
        self.place = Place { offset: head.root, ..Place::default() };
    }

    /// Computes a chunk of the `keyframes` new keyframes in `chunk`, possibly 0; ends the stream if `total` is given.
    fn compute(
        &mut self,
        model: &Model,
        cx: Compute,
        keyframes: usize,
        total: Option<usize>,
        sink: &mut dyn PacketSink,
    ) -> Result<(), StepError> {
        let Self { window, run, interp, scratch, place, base, sounds, stride, is_prompted, lips, .. } = self;
        let (decoder, mouth) = (model.motion(), model.mouth());
        let mut out = |raw: FrameRef| {
            if total.is_none_or(|total| raw.index < total) {
                let index = *base + raw.index;
                let frame = lips.put(mouth, FrameRef { index, ..raw });
                place.put(frame, (*sound_of(sounds, index / *stride), *is_prompted), sink);
            }
        };
        if keyframes > 0 {
            window.write(&self.chunk[..keyframes * self.layout.codes()]);
            let start = window.fresh_start(self.is_first);
            let mut filling = run.begin_filling(cx, interp, (window, start), decoder, false)?;
            while run.fill(cx, interp, &mut filling)? {}
            let mut push = run.begin_push(decoder, scratch, start, self.lookahead)?;
            while run.push_step(cx, decoder, scratch, start, &mut push, &mut out)? {}
            window.advance();
            self.is_first = false;
        }
        if let Some(total) = total {
            let mut push = run.begin_finish(total.min(run.known()))?;
            while run.push_step(cx, decoder, scratch, 0, &mut push, &mut out)? {}
        }
        Ok(())
    }
}

/// Codes of the packet in a slot, or of the one that just arrived.
fn codes_of<'a>(waiting: &'a [Slot], arrived: &'a [u16], slot: Option<usize>) -> &'a [u16] {
    slot.map_or(arrived, |slot| &waiting[slot].codes)
}

/// Audio level and arousal of a keyframe.
fn sound_of(sounds: &mut [[f32; SOUND]], keyframe: usize) -> &mut [f32; SOUND] {
    let place = keyframe % sounds.len();
    &mut sounds[place]
}

/// Rest codes, in the order of a keyframe.
#[expect(clippy::cast_possible_truncation, reason = "codes fit 16 bits by the config's checks")]
fn rest(config: &Config) -> Vec<u16> {
    config.part_list().iter().flat_map(|part| part.rest.iter().map(|&code| code as u16).collect::<Vec<_>>()).collect()
}
