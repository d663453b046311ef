//! Takes of sessions: recording one, and sessions that play one (SPEC 2.24).
//!
//! The packets take the way of a decoder's. The recorded requests reach the layers just before their frame, through the
//! present host's requests: the last request counts.

use std::sync::Arc;

use umo_core_base::error::LoadError;
use umo_core_base::memory;
use umo_core_model::model::Model;

use super::{Session, SessionConfig, SessionError};
use crate::engine::EngineError;
use crate::take::Take;

impl Session {
    /// Creates a session that plays a take: [`Self::push_take`] replaces audio, and everything that shows or changes
    /// frames works as in a session with an engine. Where this host asks for nothing of its own, its frames are the
    /// take's, bit for bit on one instruction set. [`Self::reset`] begins the take anew.
    ///
    /// Of `config`, gestures, word rules, idle mode, ease and queue count; the avatar, the layers' gains and the
    /// sample rate are the take's. Needs no engine. Allocates everything that it will need.
    ///
    /// # Errors
    /// [`EngineError`] if the take does not fit the model, or a number is out of range.
    pub fn of_take(model: &Arc<Model>, take: &Take, config: &SessionConfig) -> Result<Self, EngineError> {
        take.check(model, &config.gestures, &config.words)
            .map_err(|error| LoadError::argument("take", error.to_string()))?;
        let config =
            SessionConfig { avatar: take.avatar().clone(), layers: take.layers(), reorder_window: 0, ..config.clone() };
        memory::catch(|| Self::make_decoder(model, &config, Some(take)))?
    }

    /// Writes the take of the frames that were shown so far to the start of `bytes`; returns its length. It begins at
    /// the session's start or its last reset, and goes on until an interrupt, until its memory is full, or until
    /// something that a take cannot say: a restored state, company in a scene, silence that the engine inserts, a held
    /// body, a gap in the frames.
    ///
    /// Never allocates and never waits; the session's other calls, and its engine, wait while a take is copied.
    ///
    /// # Errors
    /// [`SessionError::NoTake`]; [`SessionError::Short`] if `bytes` is shorter than [`Self::take_size`] by now;
    /// [`SessionError::Busy`] if the take is being written to.
    pub fn take(&self, bytes: &mut [u8]) -> Result<usize, SessionError> {
        self.shared.recorder.as_ref().ok_or(SessionError::NoTake)?.take(bytes)
    }

    /// Bytes of the take so far.
    ///
    /// # Errors
    /// [`SessionError::NoTake`]; [`SessionError::Busy`] if the take is being written to.
    pub fn take_size(&self) -> Result<usize, SessionError> {
        self.shared.recorder.as_ref().ok_or(SessionError::NoTake)?.length()
    }
}
