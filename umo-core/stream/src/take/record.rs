//! The take of a session, as it is recorded while the session runs.
//!
//! ```text
//!  host     asks for something ──► event ─┐
//!  engine   computes a chunk ────► packet ┼──► log
//!  output   takes over what was asked for, and shows a frame ──► frame ─┘
//! ```
//! Who asks holds the log while the layers' requests change, and so does the output while it takes them over: an event
//! is in front of the first frame that it was in force at.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard};

use umo_core_model::lm::layout::MAX_PROMPT_TOKENS;
use umo_core_pose::frame::Cue;

use super::event::{Event, STANDING};
use super::log::{Head, Log};
use crate::link::Epoch;
use crate::session::{SessionError, spin_lock};

/// Tries of [`Recorder::keep`], each a fraction of a millisecond.
const TRIES: usize = 100;

/// Recorder of a session's take.
#[derive(Debug)]
pub(crate) struct Recorder {
    head: Head,
    /// Fingerprint of the word rules.
    rules: u64,
    recording: Mutex<Recording>,
    /// Whether a record is missing.
    is_broken: AtomicBool,
}

/// The record of the present stream.
#[derive(Debug)]
pub(crate) struct Recording {
    log: Log,
    epoch: Epoch,
    /// Whether it goes on.
    is_open: bool,
    /// Values that the host has set, for a take that begins later.
    standing: [Option<Event<'static>>; STANDING],
    prompt: Option<usize>,
    ids: [[u8; 4]; MAX_PROMPT_TOKENS],
}

impl Recorder {
    pub(crate) fn new(head: Head, rules: u64, log: Log) -> Self {
        let recording = Recording {
            log,
            epoch: Epoch::default(),
            is_open: true,
            standing: [None; STANDING],
            prompt: None,
            ids: [[0; 4]; MAX_PROMPT_TOKENS],
        };
        Self { head, rules, recording: Mutex::new(recording), is_broken: AtomicBool::new(false) }
    }

    /// The recording, held: for less than a microsecond, but while a long take is copied.
    pub(crate) fn lock(&self) -> Result<MutexGuard<'_, Recording>, SessionError> {
        let mut recording = spin_lock(&self.recording)?;
        recording.is_open &= !self.is_broken.swap(false, Ordering::Relaxed);
        Ok(recording)
    }

    /// The recording, held, for a side that cannot call again: without it the take ends. Tries for longer than a take
    /// is copied.
    pub(crate) fn keep(&self) -> Option<MutexGuard<'_, Recording>> {
        let recording = (0..TRIES).find_map(|_| self.lock().ok());
        if recording.is_none() {
            self.is_broken.store(true, Ordering::Relaxed);
        }
        recording
    }

    /// Writes the take so far to the start of `out`; returns its length.
    pub(crate) fn take(&self, out: &mut [u8]) -> Result<usize, SessionError> {
        let recording = self.lock()?;
        let needed = recording.log.length(&self.head);
        if out.len() < needed {
            return Err(SessionError::Short { needed });
        }
        recording.log.take(&self.head, self.rules, out);
        Ok(needed)
    }

    /// Bytes of the take so far.
    pub(crate) fn length(&self) -> Result<usize, SessionError> {
        Ok(self.lock()?.log.length(&self.head))
    }
}

impl Recording {
    /// Enters a side's epoch if it is new: a reset begins the take anew, an interrupt ends it. Returns whether what
    /// happens in this epoch is recorded.
    fn enter(&mut self, epoch: Epoch) -> bool {
        let later = epoch.number.wrapping_sub(self.epoch.number);
        if later != 0 && later < 1 << 31 {
            let is_reset = epoch.resets != self.epoch.resets;
            (self.epoch, self.is_open) = (epoch, is_reset);
            if is_reset {
                self.begin();
            }
        }
        later < 1 << 31 && self.is_open
    }

    /// Begins a take, with the values in force.
    fn begin(&mut self) {
        self.log.clear();
        self.standing.iter().flatten().for_each(|event| self.log.event(event));
        if let Some(count) = self.prompt {
            self.log.event(&Event::Prompt(&self.ids[..count]));
        }
    }

    /// Ends the take: what comes now cannot be played.
    pub(crate) fn close(&mut self) {
        self.is_open = false;
    }

    /// Adds what the host asked for.
    pub(crate) fn event(&mut self, epoch: Epoch, event: &Event) {
        if self.enter(epoch) {
            self.log.event(event);
        }
        if let Some((number, event)) = event.standing() {
            self.standing[number] = Some(event);
        }
        if let Event::Prompt(ids) = event {
            self.ids[..ids.len()].copy_from_slice(ids);
            self.prompt = Some(ids.len());
        }
    }

    /// Adds samples that the avatar heard, mono at the model's rate.
    pub(crate) fn hear(&mut self, epoch: Epoch, samples: &[f32]) {
        if self.enter(epoch) {
            self.log.hear(samples);
        }
    }

    /// Adds a chunk's packet.
    pub(crate) fn packet(&mut self, epoch: Epoch, packet: &[u8]) {
        if self.enter(epoch) {
            self.log.packet(packet);
        }
    }

    /// Adds a frame's sound, and the level of the other's voice. The take ends where a frame is not the next.
    pub(crate) fn frame(&mut self, epoch: Epoch, index: u64, cue: &Cue, other: Option<f32>) {
        if self.enter(epoch) {
            match index == self.log.frames() {
                true => self.log.frame(cue, other),
                false => self.close(),
            }
        }
    }
}
