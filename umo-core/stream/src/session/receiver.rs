//! Sessions whose frames come from packets (SPEC 2.18).
//!
//! ```text
//!  network thread                        game thread
//!  push_packet ──► decoder ──ring──►     pull_frames, sample_pose
//! ```
//! A chunk is computed on the thread that pushes its packet. Everything after the ring is as in a
//! session with an engine: layers, idle motion, gains, gestures.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use umo_core_base::clock::Clock;
use umo_core_base::error::LoadError;
use umo_core_base::memory::{self, Arena};
use umo_core_base::team::Team;
use umo_core_model::audio::resample::Resampler;
use umo_core_model::linear::Compute;
use umo_core_model::model::Model;
use umo_core_model::motion::FrameRef;
use umo_core_pose::frame::Cue;

use super::shared::{SessionInit, Shared, try_lock};
use super::{Session, SessionConfig, SessionError, Source, Voice};
use crate::engine::EngineError;
use crate::link::{Epoch, Stamp};
use crate::packet::{Decoder, PacketError, PacketSink, Received, SOUND};
use crate::playback::frames_of;
use crate::take::{Packets, Patch, Take};

/// Name of the call, for [`SessionError::Busy`].
const PUSH: &str = "push_packet";

/// The side that receives packets.
#[derive(Debug)]
pub(super) struct Receiver {
    model: Arc<Model>,
    decoder: Decoder,
    team: Team,
    /// Epoch of the frames.
    epoch: Epoch,
    /// Frames of the ease between two streams.
    ease: u16,
    /// The take that the packets come from, if they come from one.
    take: Option<Packets>,
    /// Frames of the present stream so far, and how many it has at most.
    frames: u64,
    most: u64,
}

/// Sink of the decoder's frames.
struct Frames<'a> {
    shared: &'a Shared,
    epoch: &'a mut Epoch,
    ease: u16,
    count: u64,
    /// Number of the stream's next frame, and how many it has at most.
    next: &'a mut u64,
    most: u64,
}

impl PacketSink for Frames<'_> {
    fn room(&self) -> usize {
        self.shared.link.frames.room()
    }

    fn begin(&mut self) {
        let link = &self.shared.link;
        link.begin_epoch(|epoch| epoch.interrupted(self.ease));
        *self.epoch = link.epoch();
        link.start_input(*self.epoch, 0);
    }

    fn frame(&mut self, frame: FrameRef, [level, arousal]: [f32; SOUND], is_prompted: bool) {
        let index = frame.index as u64;
        if index >= self.most {
            return;
        }
        let stamp = Stamp { epoch: self.epoch.number, index, sample: self.shared.format.sample_of(index) };
        // What comes later is not known.
        let prompted = if is_prompted { 1.0 } else { 0.0 };
        let cue = Cue { arousal, onset: -1.0, prompted, ..crate::levels::cue(&frame, level) };
        let written = self.shared.link.frames.push(stamp, cue, frame.pose, frame.face);
        debug_assert!(written, "a packet is taken only where its frames have room");
        *self.next = index + 1;
        self.count += 1;
    }
}

impl Session {
    /// Creates a session whose frames come from packets: [`Self::push_packet`] replaces audio, and
    /// everything that shows or changes frames works as in a session with an engine. It needs no
    /// engine and little processor time.
    ///
    /// Target, lookahead and smoothing of `config` must be the sender's; reorder_window, layers,
    /// gestures, idle mode, ease and queue are its own. Allocates everything that it will need.
    ///
    /// # Errors
    /// [`EngineError`] if a number is out of range, the voice is live, or `config` asks for
    /// packets.
    pub fn decoder(model: &Arc<Model>, config: &SessionConfig) -> Result<Self, EngineError> {
        memory::catch(|| Self::make_decoder(model, config, None))?
    }

    /// Creates a decoder, of a take's packets if one is given.
    pub(super) fn make_decoder(
        model: &Arc<Model>,
        config: &SessionConfig,
        take: Option<(&Take, Option<Arc<[Patch]>>)>,
    ) -> Result<Self, EngineError> {
        let (take, patches) = take.map_or_else(Default::default, |(take, patches)| (Some(take), patches));
        let mut config = config.clone();
        if config.voice != Voice::Delayed {
            return Err(LoadError::argument("voice", "a decoder has no live voice, nor the mouth alone").into());
        }
        if config.packets.is_some() {
            return Err(LoadError::argument("packets", "a decoder makes no packets").into());
        }
        if config.take_bytes > 0 {
            return Err(LoadError::argument("take_bytes", "a decoder records no take").into());
        }
        // A decoder takes no audio.
        (config.sample_rate, config.channels) = (model.config().audio.sample_rate, 1);
        let mut decoder = Decoder::new(model, &config.avatar, config.reorder_window)?;
        if let Some(take) = take {
            // Its words and lips have times of its own audio.
            config.sample_rate = take.info().sample_rate as usize;
            decoder.begin_after(take.history());
        }
        // Room for the frames that wait for the host, and for the frames that one packet adds after
        // losses.
        config.queue_frames = config.queue_frames.saturating_add(decoder.most_frames());
        let rest = model.rest().map_err(EngineError::Rest)?;
        let arena = Arena::system();
        let rate = model.config().audio.sample_rate;
        let init = SessionInit {
            model,
            assembly: model.assembly(),
            rest: &rest,
            chunk_frames: config.avatar.target * model.config().keyframe_stride + config.avatar.held_back(),
            chunk_samples: 0,
            kept: 0,
            clock: Clock::system(),
            signal: Arc::default(),
            resampler: Resampler::new_in(rate, rate, None, &arena),
            is_decoder: true,
            take,
            patches,
            arena: &arena,
        };
        let receiver = Receiver {
            model: Arc::clone(model),
            decoder,
            team: Team::new(1).map_err(EngineError::Thread)?,
            epoch: Epoch::default(),
            ease: frames_of(config.ease, model.config().frame_rate),
            take: take.cloned().map(Packets::new),
            frames: 0,
            most: take.map_or(u64::MAX, |take| take.info().frames.into()),
        };
        let shared = arena.counted(Shared::new(init, &config)?);
        let source = Source::Packets(Box::new(Mutex::new(receiver)));
        Ok(Self { shared, source, state_size: 0, output_delay: AtomicU64::new(0) })
    }

    fn receiver(&self) -> Result<&Mutex<Receiver>, SessionError> {
        match &self.source {
            Source::Packets(receiver) => Ok(receiver),
            Source::Engine(_) | Source::Mouth(_) => Err(SessionError::NotDecoder),
        }
    }

    /// Takes a packet, in any order and any number of times, and computes the frames that it makes
    /// final. Once a later packet has arrived, missing ones are concealed.
    ///
    /// Meant for the thread that receives: never allocates, never waits, and takes the time of a
    /// chunk's motion decoders.
    ///
    /// # Errors
    /// [`SessionError::Packet`] if the bytes are not a packet of this model and these settings, or
    /// the frame queue is full: nothing changes. Also if a step fails: the stream is then joined
    /// anew. [`SessionError::Busy`] if another thread pushes; [`SessionError::NotDecoder`] for a session
    /// with an engine.
    pub fn push_packet(&self, bytes: &[u8]) -> Result<(), SessionError> {
        let shared = &*self.shared;
        shared.outcome.check()?;
        let mut receiver = try_lock(self.receiver()?).ok_or(SessionError::Busy(PUSH))?;
        match receiver.take {
            Some(_) => Err(SessionError::Take),
            None => receiver.push(shared, bytes),
        }
    }

    /// Computes the frames of the next packet of the take that it plays, if the queue has room for them; returns
    /// whether there may be more. Call it more often than chunks begin, for example before each image: most calls find
    /// no room, and return at once. Never allocates and never waits. A packet takes the time of a chunk's motion
    /// decoders.
    ///
    /// # Errors
    /// [`SessionError::Packet`] if a step fails; [`SessionError::Busy`] if another thread pushes; [`SessionError::Take`] for
    /// a session that plays no take.
    pub fn push_take(&self) -> Result<bool, SessionError> {
        let shared = &*self.shared;
        shared.outcome.check()?;
        let mut receiver = try_lock(self.receiver()?).ok_or(SessionError::Busy(PUSH))?;
        receiver.push_take(shared)
    }

    /// Statistics of the packets so far.
    ///
    /// # Errors
    /// [`SessionError::Busy`] if another thread pushes; [`SessionError::NotDecoder`] for a session with
    /// an engine.
    pub fn received(&self) -> Result<Received, SessionError> {
        Ok(try_lock(self.receiver()?).ok_or(SessionError::Busy(PUSH))?.decoder.received())
    }
}

impl Receiver {
    /// Enters the session's epoch if it is new; returns whether it was.
    fn sync_epoch(&mut self, shared: &Shared) -> bool {
        let present = shared.link.epoch();
        let is_new = present != self.epoch;
        if is_new {
            // The host has reset the session: it joins the stream at the next packet.
            self.decoder.reset();
            (self.epoch, self.frames) = (present, 0);
            shared.link.start_input(present, 0);
        }
        is_new
    }

    fn push(&mut self, shared: &Shared, bytes: &[u8]) -> Result<(), SessionError> {
        self.sync_epoch(shared);
        let Self { model, decoder, team, epoch, ease, frames: next, most, .. } = self;
        let cx = Compute { isa: model.isa(), team };
        let taken = decoder.received().packets;
        let mut frames = Frames { shared, epoch, ease: *ease, count: 0, next, most: *most };
        let pushed = decoder.push_to(model, cx, bytes, &mut frames);
        let count = frames.count;
        shared.stats.frames.fetch_add(count, Ordering::Relaxed);
        if decoder.received().packets > taken {
            shared.stats.chunks.fetch_add(1, Ordering::Relaxed);
            shared.host.clock.hear();
        }
        match pushed {
            Ok(()) => {
                if let Some(total) = decoder.total() {
                    shared.link.end_input(u64::from(total).min(*most), shared.host.clock.nanos());
                }
                Ok(())
            }
            Err(error) => {
                // The stream's state is undefined after a failed step: join it anew.
                if let PacketError::Step(_) = error {
                    decoder.reset();
                }
                Err(SessionError::Packet(error))
            }
        }
    }

    /// Pushes the next packet of the take; returns whether there are more.
    fn push_take(&mut self, shared: &Shared) -> Result<bool, SessionError> {
        let mut packets = self.take.take().ok_or(SessionError::Take)?;
        let pushed = self.push_from(shared, &mut packets);
        self.take = Some(packets);
        pushed
    }

    fn push_from(&mut self, shared: &Shared, packets: &mut Packets) -> Result<bool, SessionError> {
        if self.sync_epoch(shared) {
            packets.reset();
        }
        let full = SessionError::Packet(PacketError::Full);
        let pushed = packets.next(|packet| match self.push(shared, packet) {
            Err(error) if error == full => None,
            pushed => Some(pushed),
        });
        match pushed {
            Some(pushed) => pushed.unwrap_or(Ok(())).map(|()| true),
            None => {
                // A take that was cut ends without a last packet.
                if self.decoder.total().is_none() {
                    shared.link.end_input(self.frames, shared.host.clock.nanos());
                }
                Ok(false)
            }
        }
    }
}
