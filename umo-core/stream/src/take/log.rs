//! Records of a take, as it is made.

use std::io::Write;

use umo_core_base::memory::{Arena, Slice};
use umo_core_base::state::Fingerprint;
use umo_core_layers::{Layer, LayerGains};
use umo_core_model::avatar::AvatarConfig;
use umo_core_model::config::Config;
use umo_core_pose::frame::Cue;

use super::event::{Event, shortened};
use super::play::{AROUSAL, LEVEL, NOT_HEARD, ONSET, OTHER, PACKET, Sound};
use super::{AUDIO, CHECKSUM, FRAMES, LENGTH, MAGIC, RULES, UNEDITED};

/// Memory of records.
#[derive(Debug)]
pub(super) enum Store {
    Growing(Vec<u8>),
    /// Memory, and the bytes of it that are used.
    Bounded(Slice<u8>, usize),
}

impl Store {
    fn bytes(&self) -> &[u8] {
        match self {
            Self::Growing(bytes) => bytes,
            Self::Bounded(bytes, used) => &bytes[..*used],
        }
    }

    /// The bytes, copied if the memory is bounded.
    pub(super) fn into_bytes(self) -> Vec<u8> {
        match self {
            Self::Growing(bytes) => bytes,
            Self::Bounded(..) => self.bytes().to_vec(),
        }
    }

    fn truncate(&mut self, len: usize) {
        match self {
            Self::Growing(bytes) => bytes.truncate(len),
            Self::Bounded(_, used) => *used = len,
        }
    }

    /// Appends bytes; returns whether there was room.
    fn append(&mut self, more: &[u8]) -> bool {
        match self {
            Self::Growing(bytes) => bytes.extend_from_slice(more),
            Self::Bounded(bytes, used) => {
                let Some(room) = bytes.get_mut(*used..*used + more.len()) else { return false };
                room.copy_from_slice(more);
                *used += more.len();
            }
        }
        true
    }
}

/// Bytes to append to.
#[derive(Debug)]
pub(super) struct Put<'a> {
    store: &'a mut Store,
    is_full: bool,
}

impl<'a> Put<'a> {
    /// Appends to `store`.
    pub(super) fn new(store: &'a mut Store) -> Self {
        Self { store, is_full: false }
    }

    pub(super) fn bytes(&mut self, bytes: &[u8]) -> &mut Self {
        self.is_full = self.is_full || !self.store.append(bytes);
        self
    }

    pub(super) fn tag(&mut self, tag: u8) -> &mut Self {
        self.bytes(&[tag])
    }

    pub(super) fn f64(&mut self, value: f64) -> &mut Self {
        self.bytes(&value.to_le_bytes())
    }

    pub(super) fn f32s(&mut self, values: &[f32]) -> &mut Self {
        values.iter().fold(self, |out, value| out.bytes(&value.to_le_bytes()))
    }

    /// A number of items.
    pub(super) fn count(&mut self, count: usize) -> &mut Self {
        self.bytes(&u16::try_from(count).unwrap_or(u16::MAX).to_le_bytes())
    }

    pub(super) fn text(&mut self, text: &str) -> &mut Self {
        let text = shortened(text);
        self.count(text.len()).bytes(text.as_bytes())
    }
}

/// Settings of a motion that its take begins with.
#[derive(Debug)]
pub(crate) struct Head(Slice<u8>);

impl Head {
    /// Head of a motion with these settings. `history` has the codes of the keyframes before its start, empty for
    /// rest.
    pub(crate) fn new(
        (config, model): (&Config, u64),
        avatar: &AvatarConfig,
        layers: LayerGains,
        sample_rate: usize,
        history: &[u16],
        arena: &Arena,
    ) -> Self {
        let mut store = Store::Growing(Vec::new());
        let mut out = Put::new(&mut store);
        let word = |value: usize| u32::try_from(value).unwrap_or(u32::MAX).to_le_bytes();
        let sampler = avatar.sampler;
        // `Log::take` fills in the fields that are not known yet.
        out.bytes(MAGIC).bytes(&UNEDITED.to_le_bytes()).bytes(&[0; AUDIO + 16 - CHECKSUM]);
        out.bytes(&model.to_le_bytes()).bytes(&[0; 8]).bytes(&sampler.seed.to_le_bytes());
        for value in [config.frame_rate, sample_rate, avatar.target, avatar.lookahead, avatar.horizon] {
            out.bytes(&word(value));
        }
        out.f32s(&[avatar.smoothing, avatar.guidance, sampler.sampling.temperature]);
        out.bytes(&word(sampler.sampling.top_k));
        out.f32s(&[sampler.sampling.top_p, sampler.activity, sampler.expression]);
        out.f32s(&Layer::ALL.map(|layer| layers.gain(layer)));
        out.text(&avatar.template).count(avatar.text.len());
        for id in &avatar.text {
            out.bytes(&id.to_le_bytes());
        }
        out.count(history.len());
        for code in history {
            out.bytes(&code.to_le_bytes());
        }
        Self(arena.copied(store.bytes()))
    }
}

/// Records so far.
#[derive(Debug)]
pub(crate) struct Log {
    store: Store,
    /// Whether a record had no room: later ones are not recorded.
    is_full: bool,
    sound: Sound,
    frames: u32,
    packets: u32,
    audio: Fingerprint,
    samples: u64,
}

impl Log {
    /// A log that grows.
    pub(crate) fn growing() -> Self {
        Self::of(Store::Growing(Vec::new()))
    }

    /// A log that takes `limit` bytes of an arena now and nothing later.
    pub(crate) fn bounded_in(limit: usize, arena: &Arena) -> Self {
        Self::of(Store::Bounded(arena.filled(0, limit), 0))
    }

    fn of(store: Store) -> Self {
        let (audio, sound) = (Fingerprint::new(), Sound::START);
        Self { store, is_full: false, sound, frames: 0, packets: 0, audio, samples: 0 }
    }

    /// Returns to the start.
    pub(crate) fn clear(&mut self) {
        self.store.truncate(0);
        (self.is_full, self.sound) = (false, Sound::START);
        (self.frames, self.packets, self.audio, self.samples) = (0, 0, Fingerprint::new(), 0);
    }

    /// Adds a record as a whole; returns whether it had room.
    fn record(&mut self, write: impl FnOnce(&mut Put)) -> bool {
        let start = self.store.bytes().len();
        let mut out = Put { store: &mut self.store, is_full: self.is_full };
        write(&mut out);
        self.is_full = out.is_full;
        if self.is_full {
            self.store.truncate(start);
        }
        !self.is_full
    }

    /// Adds samples that the avatar heard, mono at the model's rate.
    pub(crate) fn hear(&mut self, samples: &[f32]) {
        for sample in samples {
            // Writing to a fingerprint cannot fail.
            drop(self.audio.write(&sample.to_le_bytes()));
        }
        self.samples += samples.len() as u64;
    }

    /// Adds the packet of a chunk.
    pub(crate) fn packet(&mut self, packet: &[u8]) {
        let is_there = self.record(|out| {
            out.tag(PACKET).count(packet.len()).bytes(packet);
        });
        self.packets += u32::from(is_there);
    }

    /// Adds what the host asked for before the next frame.
    pub(crate) fn event(&mut self, event: &Event) {
        self.record(|out| event.write(out));
    }

    /// Adds the next frame's sound, and the level of the other's voice, if one is heard.
    pub(crate) fn frame(&mut self, cue: &Cue, other: Option<f32>) {
        let other = other.unwrap_or(NOT_HEARD);
        let (now, before) = (Sound { level: cue.level, arousal: cue.arousal, onset: cue.onset, other }, self.sound);
        let fields = [
            (LEVEL, now.level, before.level),
            (AROUSAL, now.arousal, before.arousal),
            (ONSET, now.onset, before.onset),
            (OTHER, now.other, before.other),
        ];
        let changed = fields.into_iter().filter(|(_, now, before)| now.to_bits() != before.to_bits());
        let is_there = self.record(|out| {
            out.tag(changed.clone().map(|(flag, ..)| flag).sum());
            for (_, value, _) in changed {
                out.f32s(&[value]);
            }
        });
        if is_there {
            self.sound = now;
            self.frames += 1;
        }
    }

    /// Number of frames so far.
    pub(crate) fn frames(&self) -> u64 {
        self.frames.into()
    }

    /// Bytes of the take so far.
    pub(crate) fn length(&self, head: &Head) -> usize {
        head.0.len() + self.store.bytes().len()
    }

    /// Writes the take so far to the start of `out`, which has [`Self::length`] bytes. `rules` is the fingerprint of
    /// its word rules.
    pub(crate) fn take(&self, head: &Head, rules: u64, out: &mut [u8]) {
        let length = self.length(head);
        let out = &mut out[..length];
        let (start, body) = out.split_at_mut(head.0.len());
        start.copy_from_slice(&head.0);
        body.copy_from_slice(self.store.bytes());
        out[LENGTH..LENGTH + 8].copy_from_slice(&(length as u64).to_le_bytes());
        out[FRAMES..FRAMES + 4].copy_from_slice(&self.frames.to_le_bytes());
        out[FRAMES + 4..FRAMES + 8].copy_from_slice(&self.packets.to_le_bytes());
        out[AUDIO..AUDIO + 8].copy_from_slice(&self.audio.0.to_le_bytes());
        out[AUDIO + 8..AUDIO + 16].copy_from_slice(&self.samples.to_le_bytes());
        out[RULES..RULES + 8].copy_from_slice(&rules.to_le_bytes());
        let sum = crc32fast::hash(&out[LENGTH..]);
        out[CHECKSUM..CHECKSUM + 4].copy_from_slice(&sum.to_le_bytes());
    }
}
