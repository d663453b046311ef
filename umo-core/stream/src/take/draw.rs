//! Changing a take: chunks that an edit touches are drawn anew, with phases of gestures that are set (SPEC 2.25).
//!
//! Faces, heads and legs keep their codes. Vectors of trunk, arms and hands go from the take's own to those that were
//! drawn, and back; hands that are to rest go to the rest pose. Of several draws the best counts.

use std::collections::BTreeMap;
use std::fmt;
use std::io::Write;
use std::ops::Range;

use umo_core_base::error::{LoadError, StepError};
use umo_core_base::state::Fingerprint;
use umo_core_base::team::Team;
use umo_core_model::avatar::AvatarConfig;
use umo_core_model::config::Config;
use umo_core_model::layout::FREE;
use umo_core_model::linear::Compute;
use umo_core_model::lm::depth;
use umo_core_model::lm::sampler::Sampler;
use umo_core_model::model::Model;
use umo_core_model::motion::vq::VqDecoder;
use umo_core_pose::frame::{Cue, OwnedFrame};
use umo_core_pose::skeleton::joint_places;

use super::edits::Edits;
use super::join::Offset;
use super::log::{Put, Store};
use super::{CHECKSUM, Event, LENGTH, MAGIC, Take};
use crate::animation::Animation;
use crate::packet::{Decoder, PacketHead, PacketLayout, SOUND};

/// Draws of a chunk to choose from.
const DRAWS: u64 = 8;
/// Keyframes of the way from the take's own motion to what is drawn, and back.
const WAY: usize = 5;
/// Keyframes of silence in which the model is at rest.
const SILENCE: Range<usize> = 10..40;
/// Number of silences.
const SILENCES: u64 = 5;
/// Keyframes of the way to rest, and of that from rest.
const TO_REST: usize = 6;
const FROM_REST: usize = 6;
/// Shortest and longest fade of what is left of a difference after the chunks that were drawn, frames, and the distance
/// that a frame may fade, metres.
const FADE: Range<usize> = 8..24;
const FADE_DISTANCE: f32 = 0.02;
/// Chunks from one edit to the next that are drawn independently of each other: beyond the history, and the fade.
const APART: usize = 4;
/// Frames before and after a stroke in which the wrist's speed still counts as the stroke's.
const AROUND: usize = 3;
/// Least peak speed of a stroke's wrist, m/s.
const STROKE_SPEED: f32 = 0.6;
/// Jerk of a wrist up to which a draw costs nothing, and the excess that costs as much as 1 m/s of speed, m/s³.
const CALM: f32 = 60.0;
const ROUGH: f32 = 200.0;
/// Joints of the left and the right wrist.
const WRISTS: [usize; 2] = [20, 21];

/// What is to change in a take.
#[derive(Clone, Debug, Default)]
pub struct Edit<'a> {
    /// Code of `intent` (SPEC 2.12) of each keyframe; those of [`Take::phases`] change nothing. Empty for a model that does
    /// not know them.
    pub phases: Vec<u16>,
    /// Keyframes to draw anew even where their phases are the take's.
    pub anew: Vec<Range<usize>>,
    /// Keyframes of strokes, and the peak speed that their wrists are to have, m/s.
    pub speeds: Vec<(Range<usize>, f32)>,
    /// All requests of the take, each with its frame, in order, if they differ from [`Take::events`].
    pub events: Option<Vec<(u64, Event<'a>)>>,
    /// Frames in which these requests make a difference.
    pub windows: Vec<Range<u64>>,
    /// Number of the variant: each gives other draws.
    pub variant: u64,
}

/// Why a take cannot be changed.
#[derive(Debug)]
#[non_exhaustive]
pub enum EditError {
    /// The model does not know phases of gestures.
    Phases,
    /// The edit has another number of keyframes than the take.
    Keyframes {
        /// Phases of the edit.
        got: usize,
        /// Keyframes of the take.
        want: usize,
    },
    /// The recording is not the take's.
    Audio,
    /// The model cannot begin.
    Load(LoadError),
    /// A step failed.
    Step(StepError),
}

impl fmt::Display for EditError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Phases => write!(f, "this model does not know phases of gestures: it has no part `intent`"),
            Self::Keyframes { got, want } => write!(f, "phases for {got} keyframes, but the take has {want}"),
            Self::Audio => write!(f, "another recording than the take's: give the one that it was made from"),
            Self::Load(error) => write!(f, "{error}"),
            Self::Step(error) => write!(f, "{error}"),
        }
    }
}

impl std::error::Error for EditError {}

impl From<StepError> for EditError {
    fn from(error: StepError) -> Self {
        Self::Step(error)
    }
}

impl From<LoadError> for EditError {
    fn from(error: LoadError) -> Self {
        Self::Load(error)
    }
}

/// Changed frames.
#[derive(Debug)]
pub(crate) struct Redrawn {
    pub(crate) frames: Range<u64>,
    /// Frames in place of the decoders'; empty if only requests differ.
    pub(crate) drawn: Box<[OwnedFrame]>,
}

/// The packets of a take, read.
#[derive(Default)]
struct Chunks {
    heads: Vec<PacketHead>,
    sounds: Vec<Vec<[u8; SOUND]>>,
    mouths: Vec<Vec<u8>>,
    /// Codes of each, before edits and after them.
    before: Vec<Vec<u16>>,
    codes: Vec<Vec<u16>>,
}

/// Codes by chunk.
type Codes = BTreeMap<usize, Vec<u16>>;

/// What an edit is drawn with.
struct Drawing<'a> {
    model: &'a Model,
    cx: Compute<'a>,
    /// The whole recording.
    samples: &'a [f32],
    edit: &'a Edit<'a>,
}

/// Places of a motion's wrists, by frame.
type Wrists = Vec<[[f32; 3]; 2]>;

impl Take {
    /// Returns the codes of `intent` (SPEC 2.12) of its keyframes; `None` for a model without that part.
    pub fn phases(&self, model: &Model) -> Option<Vec<u16>> {
        let config = model.config();
        let (at, count) = (depth::intent(config).filter(|_| config.is_frames())?, config.codes_per_keyframe());
        let codes = self.chunks(model).codes;
        Some(codes.concat().into_iter().skip(at).step_by(count).collect())
    }

    /// Places of the left and the right wrist in each frame, without layers, metres.
    ///
    /// # Errors
    /// [`EditError`] if the model cannot decode it.
    pub fn wrists(&self, model: &Model, cx: Compute) -> Result<Wrists, EditError> {
        let chunks = self.chunks(model);
        let frames = self.decoded(model, cx, &chunks, &chunks.codes)?;
        let edited = self.redrawn(model)?;
        let shown = edited.iter().flat_map(|it| (it.frames.start..).zip(&it.drawn[..]));
        let mut frames = frames;
        for (index, frame) in shown {
            frames[usize::try_from(index).unwrap_or_default()] = frame.clone();
        }
        Ok(frames.iter().map(|frame| wrists(model.config(), frame)).collect())
    }

    /// Peak speed of the wrists that a phase's code names, in a run of keyframes, m/s. `places` is [`Self::wrists`].
    pub fn peak_speed(&self, model: &Model, places: &[[[f32; 3]; 2]], keyframes: &Range<usize>, phase: u16) -> f32 {
        peak(model.config(), places, keyframes, phase)
    }

    /// Changes the take: `samples` is the recording that the avatar heard, mono at the model's rate.
    ///
    /// # Errors
    /// [`EditError`] that names what does not fit.
    pub fn edited(&self, model: &Model, cx: Compute, samples: &[f32], edit: &Edit) -> Result<Self, EditError> {
        let mut chunks = self.chunks(model);
        let now = self.phases(model).unwrap_or_default();
        let place = depth::intent(model.config()).unwrap_or_default();
        if now.is_empty() && !(edit.phases.is_empty() && edit.anew.is_empty() && edit.speeds.is_empty()) {
            return Err(EditError::Phases);
        }
        if edit.phases.len() != now.len() {
            return Err(EditError::Keyframes { got: edit.phases.len(), want: now.len() });
        }
        let samples = self.heard(samples).ok_or(EditError::Audio)?;
        let (target, count) = (self.avatar.target, model.config().codes_per_keyframe());
        let asked = edit.anew.iter().chain(edit.speeds.iter().map(|(keyframes, _)| keyframes));
        let mut is_anew: Vec<bool> = (0..now.len()).map(|at| edit.phases[at] != now[at]).collect();
        for keyframes in asked {
            is_anew[keyframes.start.min(now.len())..keyframes.end.min(now.len())].fill(true);
        }
        // Phases that return to those before all edits get the codes before all edits.
        let before = |at: usize| chunks.before[at / target][at % target * count + place];
        let is_back = |at: usize| is_anew[at] && edit.phases[at] == before(at);
        let asks = |at: usize| edit.anew.iter().chain(edit.speeds.iter().map(|(it, _)| it)).any(|it| it.contains(&at));
        let back: Vec<usize> = (0..now.len()).filter(|&at| is_back(at) && !asks(at)).collect();
        let shares = Shares::new(&is_anew);
        let mut touched: Vec<usize> = (0..now.len()).filter(|&at| shares.0[at] > 0.0).map(|at| at / target).collect();
        touched.dedup();
        let all_back = |group: &Vec<usize>| {
            let mut changed = (group[0] * target..(group[group.len() - 1] + 1) * target).filter(|&at| is_anew[at]);
            changed.all(|at| back.binary_search(&at).is_ok())
        };
        let (undone, drawn): (Vec<_>, Vec<_>) = groups(&touched).into_iter().partition(all_back);
        for chunk in undone.into_iter().flatten() {
            chunks.codes[chunk] = chunks.before[chunk].clone();
        }
        self.draw(&Drawing { model, cx, samples, edit }, &mut chunks, (&drawn, &shares, &is_anew))?;
        self.with_codes(model, cx, edit, &chunks)
    }

    /// Returns the samples if the avatar heard them; `None` for another recording.
    fn heard<'a>(&self, samples: &'a [f32]) -> Option<&'a [f32]> {
        let heard = samples.get(..usize::try_from(self.info.samples).ok()?)?;
        let mut print = Fingerprint::new();
        for sample in heard {
            // Writing to a fingerprint cannot fail.
            drop(print.write(&sample.to_le_bytes()));
        }
        (print.0 == self.info.audio).then_some(samples)
    }

    /// Reads the packets. They were checked with the model.
    fn chunks(&self, model: &Model) -> Chunks {
        let layout = PacketLayout::new(model);
        let mut chunks = Chunks::default();
        let mut sounds = vec![[0; SOUND]; layout.max_keyframes()];
        let mut codes = vec![0; layout.max_keyframes() * layout.codes()];
        let mut mouth = vec![0; layout.max_mouth_frames() * layout.mouth()];
        let mut read = |bytes: &[u8]| {
            let head = layout.decode(bytes, &mut sounds, &mut codes, &mut mouth).ok()?;
            let heard = (sounds[..head.keyframes].to_vec(), mouth[..head.mouth_frames * layout.mouth()].to_vec());
            Some((head, heard, codes[..head.keyframes * layout.codes()].to_vec()))
        };
        for packet in self.packets() {
            let Some((head, (sounds, mouth), codes)) = read(packet) else { break };
            chunks.heads.push(head);
            chunks.sounds.push(sounds);
            chunks.mouths.push(mouth);
            chunks.before.push(codes);
        }
        chunks.codes.clone_from(&chunks.before);
        for packet in self.edits.packets(&self.bytes) {
            if let Some((head, _, codes)) = read(packet)
                && let Some(own) = chunks.codes.get_mut(head.sequence as usize)
            {
                *own = codes;
            }
        }
        chunks
    }

    /// The decoders' frames of these codes.
    fn decoded(
        &self,
        model: &Model,
        cx: Compute,
        chunks: &Chunks,
        codes: &[Vec<u16>],
    ) -> Result<Vec<OwnedFrame>, EditError> {
        let layout = PacketLayout::new(model);
        let mut decoder = Decoder::new(model, &self.avatar, 0)?;
        decoder.begin_after(&self.history);
        let (mut frames, mut packet) = (Vec::new(), vec![0; layout.most_bytes()]);
        for (((head, sounds), mouth), codes) in chunks.heads.iter().zip(&chunks.sounds).zip(&chunks.mouths).zip(codes) {
            let length = layout.encode(head, sounds, codes, mouth, &mut packet)?;
            let mut keep = |frame: umo_core_model::motion::FrameRef| {
                let mut own = OwnedFrame::new(*frame.pose, frame.face);
                own.index = frame.index as u64;
                let prompted = if head.is_prompted { 1.0 } else { 0.0 };
                own.cue = Cue { prompted, ..crate::levels::cue(&frame, 0.0) };
                frames.push(own);
            };
            let pushed = decoder.push_packet(model, cx, &packet[..length], &mut keep);
            pushed.map_err(|_| StepError::Order("internal: a take's packet was refused"))?;
        }
        frames.truncate(self.info.frames as usize);
        Ok(frames)
    }

    /// Draws the chunks of `groups`, several times, and takes over the best of each group.
    fn draw(
        &self,
        drawing: &Drawing,
        chunks: &mut Chunks,
        (groups, shares, is_anew): (&[Vec<usize>], &Shares, &[bool]),
    ) -> Result<(), EditError> {
        let &Drawing { model, cx, edit, .. } = drawing;
        if groups.is_empty() {
            return Ok(());
        }
        let (rests, still) = (rests(&edit.phases, is_anew), still(model, cx, &self.avatar)?);
        let judge = Judge { target: self.avatar.target, config: model.config(), edit, is_anew };
        let mut best: Vec<Option<(f32, Codes)>> = vec![None; groups.len()];
        for draw in 0..DRAWS {
            let drawn = self.drawn(drawing, chunks, &groups.concat(), draw)?;
            let mut codes = chunks.codes.clone();
            for (chunk, drawn) in drawn {
                codes[chunk] =
                    mixed(model, self.avatar.target, [&codes[chunk], &drawn, &still], chunk, (&shares.0, &rests))?;
            }
            let places: Wrists =
                self.decoded(model, cx, chunks, &codes)?.iter().map(|frame| wrists(model.config(), frame)).collect();
            for (group, best) in groups.iter().zip(&mut best) {
                let cost = judge.cost(group, &places);
                if best.as_ref().is_none_or(|(least, _)| cost < *least) {
                    *best = Some((cost, group.iter().map(|&chunk| (chunk, codes[chunk].clone())).collect()));
                }
            }
        }
        for (chunk, codes) in best.into_iter().flatten().flat_map(|(_, codes)| codes) {
            chunks.codes[chunk] = codes;
        }
        Ok(())
    }

    /// Draws these chunks once; returns their codes.
    fn drawn(&self, drawing: &Drawing, chunks: &Chunks, anew: &[usize], draw: u64) -> Result<Codes, EditError> {
        let &Drawing { model, cx, samples, edit } = drawing;
        let config = model.config();
        let (target, count) = (self.avatar.target, config.codes_per_keyframe());
        let mut avatar = self.avatar.clone();
        let number = edit.variant.wrapping_mul(DRAWS).wrapping_add(draw + 1);
        let seed = |seed: u64| seed ^ number.wrapping_mul(0x9E37_79B9_7F4A_7C15);
        avatar.sampler.seed = seed(avatar.sampler.seed);
        let mut animation = Animation::new(model, &avatar)?;
        if !self.history.is_empty() {
            animation.avatar_mut().set_history(&self.history)?;
        }
        animation.keep_codes_mouth();
        animation.keep_record(config);
        animation.push_audio(samples)?;
        animation.finish(self.info.frames as usize);
        let mut standing = self.events().filter(|(_, event)| matches!(event, Event::Prompt(_) | Event::Sampler(_)));
        let (mut next, kept, place) = (standing.next(), kept(config), depth::intent(config).unwrap_or_default());
        let (mut drawn, mut frames) = (BTreeMap::new(), 0);
        let last = anew.last().copied().unwrap_or_default();
        for (chunk, codes) in chunks.codes.iter().enumerate().take(last + 1) {
            while let Some((_, event)) = next.take_if(|(frame, _)| *frame <= frames) {
                match event {
                    Event::Prompt(ids) => {
                        let ids: Vec<u32> = ids.iter().map(|&id| u32::from_le_bytes(id)).collect();
                        animation.avatar_mut().set_text(&ids)?;
                    }
                    Event::Sampler(mut sampler) => {
                        sampler.seed = seed(sampler.seed);
                        animation.avatar_mut().set_sampler(sampler);
                    }
                    _ => {}
                }
                next = standing.next();
            }
            if !codes.is_empty() {
                let mut want = codes.clone();
                if anew.contains(&chunk) {
                    let phases = &edit.phases[chunk * target..(chunk + 1) * target];
                    for (want, &phase) in want.chunks_exact_mut(count).zip(phases) {
                        want.iter_mut().zip(&kept).filter(|(_, kept)| !**kept).for_each(|(code, _)| *code = FREE);
                        want[place] = phase;
                    }
                }
                animation.want(&want)?;
            }
            animation.step(model, cx, &mut |_| frames += 1)?;
            if anew.contains(&chunk)
                && let Some(record) = animation.chunk()
            {
                drawn.insert(chunk, record.keyframes.to_vec());
            }
        }
        Ok(drawn)
    }

    /// The take with other codes and requests.
    fn with_codes(&self, model: &Model, cx: Compute, edit: &Edit, chunks: &Chunks) -> Result<Self, EditError> {
        let config = model.config();
        let layout = PacketLayout::new(model);
        let total = self.info.frames;
        let redrawn: Vec<usize> = (0..chunks.codes.len()).filter(|&at| chunks.codes[at] != chunks.before[at]).collect();
        let mut packets = Vec::new();
        for &chunk in &redrawn {
            let mut packet = vec![0; layout.most_bytes()];
            let Chunks { heads, sounds, mouths, codes, .. } = chunks;
            let length = layout.encode(&heads[chunk], &sounds[chunk], &codes[chunk], &mouths[chunk], &mut packet)?;
            packet.truncate(length);
            packets.push(packet);
        }
        let before = self.decoded(model, cx, chunks, &chunks.before)?;
        let after = self.decoded(model, cx, chunks, &chunks.codes)?;
        let short = |frame: u64| u32::try_from(frame).unwrap_or(total).min(total);
        let spans = self.spans(config, chunks, &before, &after);
        let mut windows: Vec<Range<u32>> =
            spans.iter().map(|span| short(span.start as u64)..short(span.until as u64)).collect();
        let standing = |(_, event): &(u64, Event)| !matches!(event, Event::Prompt(_) | Event::Sampler(_));
        let asks = match &edit.events {
            Some(events) => !events.iter().filter(|it| standing(it)).eq(self
                .original()
                .events()
                .filter(standing)
                .collect::<Vec<_>>()
                .iter()),
            None => self.edits.has_requests(),
        };
        if asks {
            let old = if self.edits.has_requests() { self.changed() } else { &[] };
            windows.extend(edit.windows.iter().chain(old).map(|window| short(window.start)..short(window.end)));
        }
        let windows = united(windows);
        let events: Vec<(u64, Event)> = match &edit.events {
            Some(events) => events.clone(),
            None => self.events().collect(),
        };
        let mut store = Store::Growing(self.bytes[..self.edits.at].to_vec());
        let mut out = Put::new(&mut store);
        if !windows.is_empty() {
            Edits::write(&mut out, &windows, &packets, asks.then_some(&events[..]));
        }
        let mut bytes = store.into_bytes();
        let version = self.version(!windows.is_empty());
        bytes[MAGIC.len()..CHECKSUM].copy_from_slice(&version.to_le_bytes());
        let length = bytes.len() as u64;
        bytes[LENGTH..LENGTH + 8].copy_from_slice(&length.to_le_bytes());
        let sum = crc32fast::hash(&bytes[LENGTH..]);
        bytes[CHECKSUM..CHECKSUM + 4].copy_from_slice(&sum.to_le_bytes());
        Self::new(&bytes).map_err(|_| StepError::Order("internal: an edited take cannot be read").into())
    }

    /// The frames of chunks that were drawn anew, and of the way back after them.
    fn spans(&self, config: &Config, chunks: &Chunks, before: &[OwnedFrame], after: &[OwnedFrame]) -> Vec<Span> {
        let target = self.avatar.target;
        let (count, stride) = (config.codes_per_keyframe(), config.keyframe_stride);
        let anew: Vec<usize> = (0..chunks.codes.len()).filter(|&at| chunks.codes[at] != chunks.before[at]).collect();
        let span = |group: Range<usize>| {
            let differs = |&at: &usize| before[at].pose != after[at].pose || before[at].face[..] != after[at].face[..];
            let start = (known(config, target, group.start.saturating_sub(2))..before.len()).find(differs)?;
            let last = group.end - 1;
            let pairs = chunks.codes[last].chunks_exact(count).zip(chunks.before[last].chunks_exact(count));
            let other = pairs.rev().position(|(after, before)| after != before).unwrap_or_default();
            let end = ((group.end * target - other - 1) * stride + 1).min(before.len());
            let far = farthest(&wrists(config, &before[end - 1]), &wrists(config, &after[end - 1]));
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
            let fade = ((far / FADE_DISTANCE).ceil() as usize).clamp(FADE.start, FADE.end);
            (start < end).then(|| Span { start, end, until: (end + fade).min(before.len()) })
        };
        joined(&anew).into_iter().filter_map(span).collect()
    }

    /// Its changed frames.
    pub(crate) fn redrawn(&self, model: &Model) -> Result<Vec<Redrawn>, EditError> {
        let team = Team::new(1).map_err(|_| StepError::Missing("thread"))?;
        let cx = Compute { isa: model.isa(), team: &team };
        let chunks = self.chunks(model);
        let before = self.decoded(model, cx, &chunks, &chunks.before)?;
        let after = self.decoded(model, cx, &chunks, &chunks.codes)?;
        let spans = self.spans(model.config(), &chunks, &before, &after);
        let mut fading = Offset::new(model.config().face.names.len());
        let mut shown = before.clone();
        for &Span { start, end, until } in &spans {
            shown[start..end].clone_from_slice(&after[start..end]);
            let before_last = end.saturating_sub(2).max(start);
            let pairs = |frames: &[OwnedFrame]| [frames[end - 1].clone(), frames[before_last].clone()];
            let ([a, b], [c, d]) = (pairs(&after), pairs(&before));
            fading.begin_over([&a, &b], [&c, &d], u32::try_from(until - end).unwrap_or(u32::MAX));
            shown[end..until].iter_mut().for_each(|frame| fading.apply(frame));
        }
        let of = |window: &Range<u64>| {
            let frames = [window.start, window.end].map(|index| usize::try_from(index).unwrap_or(usize::MAX));
            let is_drawn = spans.iter().any(|span| span.start < frames[1] && frames[0] < span.until);
            let drawn = shown.get(frames[0]..frames[1]).filter(|_| is_drawn).unwrap_or_default();
            Redrawn { frames: window.clone(), drawn: drawn.into() }
        };
        Ok(self.changed().iter().map(of).collect())
    }
}

/// Frames of chunks that were drawn anew, and the frame at which the take is its own again.
#[derive(Clone, Copy, Debug)]
struct Span {
    start: usize,
    end: usize,
    until: usize,
}

/// By keyframe, how far trunk and arms are what was drawn, 0 to 1: the others are the take's own.
struct Shares(Vec<f32>);

impl Shares {
    fn new(is_anew: &[bool]) -> Self {
        let mut shares = vec![0.0; is_anew.len()];
        for at in (0..is_anew.len()).filter(|&at| is_anew[at]) {
            for (other, share) in shares.iter_mut().enumerate().skip(at.saturating_sub(WAY)).take(2 * WAY + 1) {
                *share = smooth(1.0 - other.abs_diff(at) as f32 / (WAY + 1) as f32).max(*share);
            }
        }
        Self(shares)
    }
}

/// By keyframe, how far hands rest, 0 to 1: in runs of rest that are new in part, and on the way from them.
fn rests(phases: &[u16], is_anew: &[bool]) -> Vec<f32> {
    let (mut rests, mut at) = (vec![0.0_f32; phases.len()], 0);
    for run in phases.chunk_by(|a, b| (*a == depth::REST) == (*b == depth::REST)) {
        let end = at + run.len();
        if run[0] == depth::REST && is_anew[at..end].contains(&true) {
            for (done, rest) in (1..).zip(&mut rests[at..end]) {
                *rest = smooth(done as f32 / TO_REST as f32).max(*rest);
            }
            let most = rests[end - 1];
            for (done, rest) in (1..FROM_REST).zip(&mut rests[end..]) {
                *rest = most * smooth(1.0 - done as f32 / FROM_REST as f32);
            }
        }
        at = end;
    }
    rests
}

/// Codes of a keyframe at rest: the median of what the model does in silence.
fn still(model: &Model, cx: Compute, avatar: &AvatarConfig) -> Result<Vec<u16>, EditError> {
    let config = model.config();
    let count = config.codes_per_keyframe();
    let mut want = vec![FREE; avatar.target * count];
    let place = depth::intent(config).unwrap_or_default();
    want.iter_mut().skip(place).step_by(count).for_each(|code| *code = depth::REST);
    let chunks = SILENCE.end.div_ceil(avatar.target);
    let mut codes = Vec::new();
    for seed in 0..SILENCES {
        // A model that hears ahead comes to rest sooner.
        let (sampler, horizon) = (Sampler { seed, ..avatar.sampler }, config.audio.ahead);
        let mut animation = Animation::new(model, &AvatarConfig { sampler, horizon, ..avatar.clone() })?;
        animation.keep_codes_mouth();
        animation.keep_record(config);
        animation.push_audio(&vec![0.0; chunks * avatar.target * config.samples_per_keyframe()])?;
        animation.finish(known(config, avatar.target, chunks));
        for chunk in 0..chunks {
            animation.want(&want)?;
            animation.step(model, cx, &mut |_| ())?;
            let keyframes = animation.chunk().map(|chunk| chunk.keyframes).unwrap_or_default();
            let early = SILENCE.start.saturating_sub(chunk * avatar.target).min(avatar.target);
            codes.extend_from_slice(&keyframes[early * count..]);
        }
    }
    let keyframes = codes.chunks_exact(count);
    let mut still = vec![depth::REST; count];
    let mut place = 0;
    let mut decoders = model.motion().decoders().iter();
    for part in config.part_list() {
        let range = place..place + part.levels;
        place = range.end;
        if part.is_annotation() {
            continue;
        }
        let Some(codebook) = decoders.next().map(VqDecoder::codebook) else { break };
        let (mut values, mut vector) = (vec![Vec::new(); codebook.width()], vec![0.0; codebook.width()]);
        for codes in keyframes.clone() {
            codebook.vector(&codes[range.clone()], &mut vector)?;
            values.iter_mut().zip(&vector).for_each(|(values, &value)| values.push(value));
        }
        let mut median: Vec<f32> = values
            .into_iter()
            .map(|mut values| {
                values.sort_by(f32::total_cmp);
                values[values.len() / 2]
            })
            .collect();
        codebook.encode(&mut median, &mut still[range]);
    }
    Ok(still)
}

/// Codes of a chunk on the way from a take's own to those that were drawn, with arms on the way to `still`.
fn mixed(
    model: &Model,
    target: usize,
    [own, drawn, still]: [&[u16]; 3],
    chunk: usize,
    (shares, rests): (&[f32], &[f32]),
) -> Result<Vec<u16>, EditError> {
    let config = model.config();
    let count = config.codes_per_keyframe();
    let mut out = own.to_vec();
    let mut decoders = model.motion().decoders().iter();
    let (mut vectors, mut place) = ([const { Vec::new() }; 3], 0);
    for part in config.part_list() {
        let range = place..place + part.levels;
        place = range.end;
        let decoder = if part.is_annotation() { None } else { decoders.next() };
        if is_kept(&part.name) && decoder.is_some() {
            continue;
        }
        for keyframe in 0..target {
            let (share, rest) = (shares[chunk * target + keyframe], rests[chunk * target + keyframe]);
            let codes = keyframe * count + range.start..keyframe * count + range.end;
            let Some(decoder) = decoder else {
                // Phases are set, not blended.
                out[codes.clone()].copy_from_slice(&drawn[codes]);
                continue;
            };
            if share <= 0.0 || (share >= 1.0 && rest <= 0.0) {
                let from = if share <= 0.0 { own } else { drawn };
                out[codes.clone()].copy_from_slice(&from[codes]);
                continue;
            }
            let codebook = decoder.codebook();
            for (vector, codes) in
                vectors.iter_mut().zip([&own[codes.clone()], &drawn[codes.clone()], &still[range.clone()]])
            {
                vector.resize(codebook.width(), 0.0);
                codebook.vector(codes, vector)?;
            }
            let [own, drawn, still] = &mut vectors;
            for ((own, drawn), still) in own.iter_mut().zip(drawn).zip(still) {
                let anew = *drawn + rest * (*still - *drawn);
                *own += share * (anew - *own);
            }
            codebook.encode(own, &mut out[codes]);
        }
    }
    Ok(out)
}

/// Smoothstep.
fn smooth(t: f32) -> f32 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// What draws are judged by.
struct Judge<'a> {
    target: usize,
    config: &'a Config,
    edit: &'a Edit<'a>,
    is_anew: &'a [bool],
}

impl Judge<'_> {
    /// How much a draw lacks, m/s: strokes that are slow or of another speed than asked for, and jerk.
    fn cost(&self, chunks: &[usize], places: &Wrists) -> f32 {
        let keyframes = chunks[0] * self.target..(chunks[chunks.len() - 1] + 1) * self.target;
        let phases = &self.edit.phases;
        let of = |keyframes: &Range<usize>| peak(self.config, places, keyframes, phases[keyframes.start]);
        let new = strokes(phases, &keyframes).into_iter().filter(|stroke| self.is_anew[stroke.clone()].contains(&true));
        let lacking: f32 = new.map(|stroke| 3.0 * (STROKE_SPEED - of(&stroke)).max(0.0)).sum();
        let speeds = self.edit.speeds.iter().filter(|(stroke, _)| keyframes.contains(&stroke.start));
        let off: f32 = speeds.map(|(stroke, speed)| (speed - of(stroke)).abs()).sum();
        let stride = self.config.keyframe_stride;
        let frames = (keyframes.start * stride).saturating_sub(9)..(keyframes.end * stride + 9).min(places.len());
        let rate = self.config.frame_rate as f32;
        let jerk = places[frames].windows(4).flat_map(|w| {
            WRISTS.iter().enumerate().map(|(hand, _)| {
                let third =
                    |axis: usize| w[3][hand][axis] - 3.0 * w[2][hand][axis] + 3.0 * w[1][hand][axis] - w[0][hand][axis];
                rate * rate * rate * (0..3).map(|axis| third(axis) * third(axis)).sum::<f32>().sqrt()
            })
        });
        lacking + off + (jerk.fold(0.0, f32::max) - CALM).max(0.0) / ROUGH
    }
}

/// Peak speed of the wrists of a stroke, m/s: of the hands that its code names.
fn peak(config: &Config, places: &[[[f32; 3]; 2]], keyframes: &Range<usize>, phase: u16) -> f32 {
    let hands = match phase % 3 {
        1 => 0..1,
        2 => 1..2,
        _ => 0..2,
    };
    let frames = (keyframes.start * config.keyframe_stride).saturating_sub(AROUND)
        ..(keyframes.end * config.keyframe_stride + AROUND).min(places.len());
    let rate = config.frame_rate as f32;
    let speeds = places
        .get(frames)
        .unwrap_or_default()
        .windows(2)
        .flat_map(|pair| hands.clone().map(move |hand| rate * distance(&pair[0][hand], &pair[1][hand])));
    speeds.fold(0.0, f32::max)
}

/// Runs of keyframes of a stroke.
fn strokes(phases: &[u16], keyframes: &Range<usize>) -> Vec<Range<usize>> {
    let mut found: Vec<Range<usize>> = Vec::new();
    for at in keyframes.clone().filter(|&at| (4..=6).contains(&phases[at])) {
        match found.last_mut() {
            Some(last) if last.end == at && phases[last.start] == phases[at] => last.end += 1,
            _ => found.push(at..at + 1),
        }
    }
    found
}

/// Whether a part keeps what it was: all but trunk, arms and hands.
fn is_kept(part: &str) -> bool {
    !["torso", "left_arm", "right_arm", "hands"].contains(&part)
}

/// Which codes of a keyframe keep what they were.
fn kept(config: &Config) -> Vec<bool> {
    let parts = config.part_list();
    parts.iter().flat_map(|part| std::iter::repeat_n(is_kept(&part.name), part.levels)).collect()
}

/// Chunks in groups that are drawn independently of each other, with those between.
fn groups(chunks: &[usize]) -> Vec<Vec<usize>> {
    chunks.chunk_by(|a, b| b - a < APART).map(|group| (group[0]..=group[group.len() - 1]).collect()).collect()
}

/// Runs of neighbouring chunks.
fn joined(chunks: &[usize]) -> Vec<Range<usize>> {
    chunks.chunk_by(|a, b| b - a == 1).map(|run| run[0]..run[run.len() - 1] + 1).collect()
}

/// Ranges in order, of which those that touch are one.
fn united(mut ranges: Vec<Range<u32>>) -> Vec<Range<u32>> {
    ranges.retain(|range| !range.is_empty());
    ranges.sort_by_key(|range| range.start);
    let mut out: Vec<Range<u32>> = Vec::new();
    for range in ranges {
        match out.last_mut() {
            Some(last) if range.start <= last.end => last.end = last.end.max(range.end),
            _ => out.push(range),
        }
    }
    out
}

/// Number of frames up to the last keyframe of this number of chunks.
fn known(config: &Config, target: usize, chunks: usize) -> usize {
    (chunks * target * config.keyframe_stride + 1).saturating_sub(config.keyframe_stride)
}

fn wrists(config: &Config, frame: &OwnedFrame) -> [[f32; 3]; 2] {
    let places = joint_places(&config.skeleton, &frame.pose);
    WRISTS.map(|wrist| places[wrist])
}

fn farthest(a: &[[f32; 3]; 2], b: &[[f32; 3]; 2]) -> f32 {
    a.iter().zip(b).map(|(a, b)| distance(a, b)).fold(0.0, f32::max)
}

fn distance(a: &[f32; 3], b: &[f32; 3]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f32>().sqrt()
}
