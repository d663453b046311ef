//! Packets of a session: from the engine to the sender (SPEC 2.18).
//!
//! ```text
//!  engine ── chunk ──► packet ──ring──► pull_packets ──► network
//! ```

use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use umo_core_base::error::StepError;
use umo_core_base::memory::{Arena, filled};
use umo_core_base::state::{StateError, StatePass};
use umo_core_model::avatar::{Avatar, Due};
use umo_core_model::model::Model;

use super::config::PacketConfig;
use super::shared::try_lock;
use super::{Session, SessionError, Shared};
use crate::levels::Levels;
use crate::link::Ring;
use crate::packet::{PacketLayout, PacketRoom};

/// Name of the call, for [`SessionError::Busy`].
pub(super) const PACKETS: &str = "pull_packets, save or restore";

/// Words before a packet's bytes: its epoch, and its length with [`LAST`].
const HEAD: usize = 2;
/// Flag in the length: the stream ends with this packet.
const LAST: u32 = 1 << 31;
/// Least capacity, in packets.
const LEAST: usize = 4;

/// Wait-free queue of packets with one producer and one consumer.
#[derive(Debug)]
pub(crate) struct PacketQueue {
    ring: Ring,
    /// Words per packet.
    width: usize,
    /// Bytes of the longest packet.
    most: usize,
    history: usize,
    pub(super) with_frames: bool,
    /// One more than the number of the epoch whose last packet was taken.
    ended: AtomicU64,
    reader: Mutex<()>,
}

impl PacketQueue {
    /// Creates a queue for the chunks in `frames` frames, `length` frames each, with `held` frames held back.
    pub(crate) fn new_in(
        config: PacketConfig,
        model: &Model,
        (frames, length, held): (usize, usize, usize),
        arena: &Arena,
    ) -> Self {
        let most = PacketLayout::new(model).most_bytes_of(length + held);
        let width = HEAD + most.div_ceil(4);
        let capacity = frames.div_ceil(length).max(LEAST);
        Self {
            ring: Ring::new_in(capacity * width, arena),
            width,
            most,
            history: config.history,
            with_frames: config.with_frames,
            ended: AtomicU64::new(0),
            reader: Mutex::new(()),
        }
    }

    /// Bytes of the longest packet.
    fn most_bytes(&self) -> usize {
        self.most
    }

    pub(super) fn has_room(&self) -> bool {
        self.ring.room() >= self.width
    }

    /// Whether the last packet of an epoch was taken.
    pub(super) fn has_ended(&self, epoch: u32) -> bool {
        self.ended.load(Ordering::Relaxed) == u64::from(epoch) + 1
    }

    /// Producer: appends a packet. The caller has checked that there is room.
    fn push(&self, epoch: u32, bytes: &[u8], is_last: bool) {
        #[expect(clippy::cast_possible_truncation, reason = "a packet is short")]
        let len = bytes.len() as u32 | if is_last { LAST } else { 0 };
        let (whole, rest) = bytes.as_chunks::<4>();
        let mut end = [0; 4];
        end[..rest.len()].copy_from_slice(rest);
        let words = whole.iter().chain([&end]).map(|&bytes| u32::from_le_bytes(bytes));
        let words = [epoch, len].into_iter().chain(words).chain(std::iter::repeat(0));
        let written = self.has_room() && self.ring.push_some(self.width, words) == self.width;
        debug_assert!(written, "a chunk is computed only where its packet has room");
    }

    /// Consumer: epoch and length of the oldest packet, and whether it is the stream's last.
    fn next(&self) -> Option<(u32, usize, bool)> {
        let mut words = [0; HEAD];
        (self.ring.peek(&mut words) == HEAD).then(|| (words[0], (words[1] & !LAST) as usize, words[1] & LAST != 0))
    }

    /// Consumer: moves the oldest packet to `out`, whose length is the packet's.
    fn pop(&self, out: &mut [u8]) {
        let words = out.len().div_ceil(4);
        let mut pieces = out.chunks_mut(4);
        self.ring.peek_range(HEAD..HEAD + words, |word| {
            if let Some(piece) = pieces.next() {
                piece.copy_from_slice(&word.to_le_bytes()[..piece.len()]);
            }
        });
        self.skip();
    }

    fn skip(&self) {
        self.ring.skip(self.width);
    }

    /// Number that distinguishes queues with incompatible states.
    pub(super) fn identity(&self) -> u64 {
        2 * self.history as u64 + u64::from(self.with_frames) + 1
    }

    /// Excludes other readers while a state is saved or restored.
    pub(super) fn lock(&self) -> Result<impl Drop + '_, SessionError> {
        try_lock(&self.reader).ok_or(SessionError::Busy(PACKETS))
    }

    /// Position after the last packet.
    pub(super) fn written(&self) -> u64 {
        self.ring.written()
    }

    /// Describes the waiting packets; returns the position after the last of them.
    pub(super) fn state(&self, pass: &mut StatePass) -> Result<u64, StateError> {
        let are_packets = |words: &[[u8; 4]]| {
            let mut packets = words.chunks_exact(self.width);
            let len = |packet: &[[u8; 4]]| (u32::from_le_bytes(packet[1]) & !LAST) as usize;
            packets.all(|packet| (1..=self.most).contains(&len(packet))) && words.len().is_multiple_of(self.width)
        };
        let waiting = self.ring.state(pass, "waiting packets", None, are_packets)?;
        let ended = pass.limited("end of packets", self.ended.load(Ordering::Relaxed), 1 << 32)?;
        if pass.loads() {
            self.ended.store(ended, Ordering::Relaxed);
        }
        Ok(self.ring.read_position() + waiting as u64)
    }
}

/// Writes the packets of an engine's sessions.
#[derive(Debug)]
pub(crate) struct PacketWriter {
    layout: PacketLayout,
    room: PacketRoom,
    bytes: Box<[u8]>,
}

impl PacketWriter {
    pub(crate) fn new(model: &Model) -> Self {
        let layout = PacketLayout::new(model);
        Self { room: PacketRoom::new(model.config(), &layout), bytes: filled(0, layout.most_bytes()).into(), layout }
    }

    /// The packet of the chunk that was just computed, alone, for a take.
    pub(crate) fn record(
        &mut self,
        (avatar, model): (&Avatar, &Model),
        stepped: Due,
        levels: &Levels,
    ) -> Result<Option<&[u8]>, StepError> {
        let Self { layout, room, bytes } = self;
        let length = room.write(avatar, model.config(), layout, stepped, (0, 0), levels, bytes)?;
        Ok(length.map(|length| &self.bytes[..length]))
    }

    /// Queues the packet of the chunk that was just computed.
    pub(crate) fn write(
        &mut self,
        queue: &PacketQueue,
        (avatar, model): (&Avatar, &Model),
        stepped: Due,
        epoch: u32,
        levels: &Levels,
    ) -> Result<(), StepError> {
        let Self { layout, room, bytes } = self;
        #[expect(clippy::cast_possible_truncation, reason = "streams are told apart modulo 256")]
        let how = (epoch as u8, queue.history);
        if let Some(len) = room.write(avatar, model.config(), layout, stepped, how, levels, bytes)? {
            queue.push(epoch, &bytes[..len], crate::packet::is_last(&bytes[..len]));
        }
        Ok(())
    }
}

impl Shared {
    /// Whether a chunk of `frames` frames has room.
    pub(super) fn has_room(&self, frames: usize) -> bool {
        match &self.packets {
            None => self.link.has_room(frames),
            Some(queue) => self
                .link
                .has_room_where(|| queue.has_room() && (!queue.with_frames || self.link.frames.room() >= frames)),
        }
    }
}

impl Session {
    /// Bytes of the longest packet; 0 for a session without packets.
    pub fn packet_size(&self) -> usize {
        self.shared.packets.as_ref().map_or(0, PacketQueue::most_bytes)
    }

    /// Moves ready packets to `bytes`, back to back and in order, and their lengths to `lengths`:
    /// as many as `lengths` has room for. Returns their number. Each packet is returned once, to be
    /// sent to the [`Session::decoder`]s.
    ///
    /// Never waits and never allocates.
    ///
    /// # Errors
    /// [`SessionError::NoPackets`]; [`SessionError::Short`] if `bytes` is shorter than
    /// [`Self::packet_size`]; [`SessionError::Busy`] if another thread pulls packets;
    /// [`SessionError::Failed`], `Panicked` or `Closed` once all ready packets have been pulled.
    pub fn pull_packets(&self, bytes: &mut [u8], lengths: &mut [usize]) -> Result<usize, SessionError> {
        let shared = &*self.shared;
        let queue = shared.packets.as_ref().ok_or(SessionError::NoPackets)?;
        if bytes.len() < queue.most {
            return Err(SessionError::Short { needed: queue.most });
        }
        let reader = queue.lock()?;
        let (mut count, mut used) = (0, 0);
        while let Some((epoch, len, is_last)) = queue.next()
            && count < lengths.len()
        {
            if epoch != shared.link.epoch().number {
                queue.skip();
            } else if let Some(room) = bytes.get_mut(used..used + len) {
                queue.pop(room);
                (lengths[count], used, count) = (len, used + len, count + 1);
                if is_last {
                    queue.ended.store(u64::from(epoch) + 1, Ordering::Relaxed);
                }
            } else {
                break;
            }
            shared.link.room_made();
        }
        drop(reader);
        if count == 0 && !lengths.is_empty() {
            shared.outcome.check()?;
            if let Some(output) = try_lock(&shared.output) {
                output.want_silence(shared);
            }
        }
        Ok(count)
    }
}
