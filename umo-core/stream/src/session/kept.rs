//! Snapshot of the engine's side from before the chunk in work, so that a save need not wait for
//! the chunk's end.
//!
//! ```text
//!  engine    begin ── keep ──► computes the chunk, queues frames ──► end
//!  save                          snapshot and the frames so far
//!  restore                                          └──► begin: computes the chunk again, omits those frames
//! ```

use std::sync::atomic::Ordering;

use umo_core_base::memory::{Arena, Slice};
use umo_core_base::state::{StateError, StatePass};
use umo_core_model::avatar::Due;
use umo_core_model::model::Model;

use super::schedule::Member;
use super::shared::{Counters, Shared};

/// Upper bound on the bytes of an avatar's state outside its buffers.
const FIELDS: usize = 4096;

/// A chunk that was begun.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Begun {
    /// The kind of chunk; `None` if none was begun.
    pub(super) due: Option<Due>,
    /// Samples that it takes.
    pub(super) samples: u64,
    /// Frames already queued before it was begun again.
    pub(super) frames: u64,
    /// Whether its packet was already queued.
    pub(super) packet: bool,
}

impl Begun {
    const DUE: [Option<Due>; 4] = [None, Some(Due::Chunk), Some(Due::Held), Some(Due::Flush)];

    /// Describes it, with upper bounds of its samples and frames.
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

/// Times of a session's chunks, nanoseconds.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Times {
    /// Arrival of the next chunk's audio; `None` until it is complete.
    pub(super) arrived: Option<u64>,
    /// Playback start of the next chunk.
    pub(super) release: u64,
    /// Completion of the last chunk.
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

/// The snapshot made when the last chunk began.
#[derive(Debug)]
pub(crate) struct Kept {
    /// The settings that a state must share with the session, up to `identity`, then the engine's
    /// side.
    bytes: Slice<u8>,
    identity: usize,
    end: usize,
    times: Times,
    begun: Begun,
    /// Upper bounds of a chunk's samples and frames.
    most: (usize, usize),
    counters: [u64; Counters::OF_ENGINE],
    silence_wanted: bool,
    /// Ring positions of the chunk's audio, the next frame and the next packet.
    audio: u64,
    frames: u64,
    packets: u64,
}

impl Kept {
    /// Allocates room for the state of an avatar whose buffers, with its levels' buffers, have
    /// `bytes` bytes.
    pub(super) fn new_in(bytes: usize, arena: &Arena) -> Self {
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

    /// Saves the engine's side.
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

    /// Whether the member's state fits.
    pub(super) fn fits(&self, member: &mut Member, model: &Model) -> bool {
        let mut pass = StatePass::size();
        let described = "what is counted is not checked";
        member.identity(&mut pass).expect(described);
        member.side_state(&mut pass, model).expect(described);
        pass.at() <= self.bytes.len()
    }
}

/// The engine's side of a session that is being saved or restored.
pub(super) enum EngineSide<'a> {
    /// In its slot.
    Here(&'a mut Member),
    /// In a batch: its snapshot, which can only be saved.
    Away(&'a Kept),
    /// None: a mouth alone.
    Absent,
}

impl EngineSide<'_> {
    pub(super) fn identity(&self, pass: &mut StatePass) -> Result<(), StateError> {
        match self {
            Self::Here(member) => member.identity(pass),
            Self::Away(kept) => pass.written(&kept.bytes[StatePass::START..kept.identity]),
            Self::Absent => Ok(()),
        }
    }

    /// Ring position from which audio is not computed yet, if it differs from the read position.
    pub(super) fn audio(&self) -> Option<u64> {
        match self {
            Self::Here(_) | Self::Absent => None,
            Self::Away(kept) => Some(kept.audio),
        }
    }

    /// Describes the side, for a state that holds the frames and packets up to these positions.
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
            Self::Absent => Ok(()),
        }
    }

    /// Values of the engine's counters, and whether silence was asked for, if they come from the
    /// snapshot.
    pub(super) fn counted(&self) -> Option<(&[u64; Counters::OF_ENGINE], bool)> {
        match self {
            Self::Here(_) | Self::Absent => None,
            Self::Away(kept) => Some((&kept.counters, kept.silence_wanted)),
        }
    }
}
