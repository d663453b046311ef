//! The engine's side of a session as it was before the chunk that is in work, so that a save need not wait
//! for the chunk's end.
//!
//! ```text
//!  engine    begin ── keep ──► computes the chunk, puts frames out ──► end
//!  save                          what was kept, frames so far
//!  restore                                          └──► begin: computes the chunk again, leaves those frames out
//! ```

use std::sync::atomic::Ordering;

use super::schedule::Member;
use super::shared::{Counters, Shared};
use crate::avatar::Due;
use crate::memory::{Arena, Slice};
use crate::model::Model;
use crate::state::{StateError, StatePass};

/// Bytes of an avatar's state that are in none of its buffers, at most.
const FIELDS: usize = 4096;

/// A chunk that was begun.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Begun {
    /// What was due; none where no chunk was begun.
    pub(super) due: Option<Due>,
    /// Samples that it took.
    pub(super) samples: u64,
    /// Frames that were put out before it was begun again.
    pub(super) frames: u64,
    /// Whether its packet was.
    pub(super) packet: bool,
}

impl Begun {
    const DUE: [Option<Due>; 4] = [None, Some(Due::Chunk), Some(Due::Held), Some(Due::Flush)];

    /// Describes it, with at most so many samples and frames.
    pub(super) fn state(&mut self, pass: &mut StatePass, (samples, frames): (usize, usize)) -> Result<(), StateError> {
        let present = Self::DUE.iter().position(|&due| due == self.due).unwrap_or_default();
        let due = pass.limited("chunk in work", present as u64, Self::DUE.len() as u64 - 1)?;
        if pass.loads() {
            self.due = Self::DUE[usize::try_from(due).unwrap_or_default()];
        }
        pass.number("chunk in work", &mut self.samples, samples as u64)?;
        pass.number("chunk in work", &mut self.frames, frames as u64)?;
        pass.switch("chunk in work", &mut self.packet).map(drop)
    }
}

/// When a session's chunks were there and done, nanoseconds.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Times {
    /// When the next chunk's audio was there; none while it is not.
    pub(super) arrived: Option<u64>,
    /// When real time begins to show the next chunk.
    pub(super) release: u64,
    /// When the last chunk was done.
    pub(super) finished: u64,
}

impl Times {
    pub(super) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        let there = pass.flag("time of audio", self.arrived.is_some())?;
        let arrived = match pass.follows(there) {
            true => Some(pass.moment("time of audio", self.arrived.unwrap_or_default())?),
            false => None,
        };
        let release = pass.moment("time of release", self.release)?;
        let finished = pass.moment("time of the last chunk", self.finished)?;
        if pass.loads() {
            *self = Self { arrived, release, finished };
        }
        Ok(())
    }
}

/// What was kept when the last chunk began.
#[derive(Debug)]
pub(crate) struct Kept {
    /// What a state must have in common with the session up to `identity`, the engine's side behind it.
    bytes: Slice<u8>,
    identity: usize,
    end: usize,
    times: Times,
    begun: Begun,
    /// Most samples and frames of a chunk.
    most: (usize, usize),
    counters: [u64; Counters::OF_ENGINE],
    silence_wanted: bool,
    /// Where the chunk's audio begins, and the next frames and packets were to be.
    audio: u64,
    frames: u64,
    packets: u64,
}

impl Kept {
    /// Room for the state of an avatar whose buffers, with those of its levels, have `bytes` bytes.
    pub(crate) fn new_in(bytes: usize, arena: &Arena) -> Self {
        Self {
            bytes: arena.filled(0, if bytes > 0 { StatePass::START + bytes + FIELDS } else { 0 }),
            identity: 0,
            end: 0,
            times: Times::default(),
            begun: Begun::default(),
            most: (0, 0),
            counters: [0; Counters::OF_ENGINE],
            silence_wanted: false,
            audio: 0,
            frames: 0,
            packets: 0,
        }
    }

    /// Keeps the engine's side.
    pub(super) fn keep(&mut self, member: &mut Member, shared: &Shared, model: &Model) {
        let described = "what is written is not checked";
        let mut pass = StatePass::save(&mut self.bytes, 0, 0);
        member.identity(&mut pass).expect(described);
        self.identity = pass.at();
        member.side_state(&mut pass, model).expect(described);
        self.end = pass.at();
        (self.times, self.begun, self.most) = member.progress();
        self.counters = shared.stats.of_engine().map(|counter| counter.load(Ordering::Relaxed));
        self.silence_wanted = shared.link.is_silence_wanted();
        (self.audio, self.frames) = shared.link.engine_positions();
        self.packets = shared.packets.as_ref().map_or(0, |packets| packets.written());
    }

    /// Whether a member's state has room.
    pub(super) fn fits(&self, member: &mut Member, model: &Model) -> bool {
        let mut pass = StatePass::size();
        let described = "what is counted is not checked";
        member.identity(&mut pass).expect(described);
        member.side_state(&mut pass, model).expect(described);
        pass.at() <= self.bytes.len()
    }
}

/// The engine's side of a session that is saved or restored.
pub(super) enum EngineSide<'a> {
    /// In its slot.
    Here(&'a mut Member),
    /// In work; only to be saved.
    Away(&'a Kept),
}

impl EngineSide<'_> {
    pub(super) fn identity(&self, pass: &mut StatePass) -> Result<(), StateError> {
        match self {
            Self::Here(member) => member.identity(pass),
            Self::Away(kept) => pass.written(&kept.bytes[StatePass::START..kept.identity]),
        }
    }

    /// Where in the ring the audio begins that the engine has not computed, where that is not what it has
    /// not taken.
    pub(super) fn audio(&self) -> Option<u64> {
        match self {
            Self::Here(_) => None,
            Self::Away(kept) => Some(kept.audio),
        }
    }

    /// Describes the side, where frames and packets up to these are in a state.
    pub(super) fn state(
        &mut self,
        pass: &mut StatePass,
        shared: &Shared,
        model: &Model,
        (frames, packets): (u64, u64),
    ) -> Result<(), StateError> {
        match self {
            Self::Here(member) => member.state(pass, model),
            Self::Away(kept) => {
                let (mut times, mut begun) = (kept.times, kept.begun);
                times.state(pass)?;
                begun.frames += shared.link.frames.count(kept.frames, frames);
                begun.packet |= packets > kept.packets;
                begun.state(pass, kept.most)?;
                pass.written(&kept.bytes[kept.identity..kept.end])
            }
        }
    }

    /// Values of the counters that the engine counts with, and whether silence was asked for.
    pub(super) fn counted(&self) -> Option<(&[u64; Counters::OF_ENGINE], bool)> {
        match self {
            Self::Here(_) => None,
            Self::Away(kept) => Some((&kept.counters, kept.silence_wanted)),
        }
    }
}
