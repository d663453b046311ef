//! Takes of sessions: recording one, and sessions that play one (SPEC 2.24).
//!
//! The packets take the way of a decoder's. The recorded requests reach the layers just before their frame, through the
//! present host's requests: the last request counts.

use std::sync::Arc;

use umo_core_base::error::LoadError;
use umo_core_base::memory;
use umo_core_model::model::Model;
use umo_core_pose::frame::OwnedFrame;

use super::shared::try_lock;
use super::{OUTPUT, Session, SessionConfig, SessionError};
use crate::engine::EngineError;
use crate::playback::LayersState;
use crate::take::{Join, Patch, Redrawn, Take};

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
        memory::catch(|| {
            let patches = take.is_edited().then(|| patches(model, take, &config)).transpose()?;
            Self::make_decoder(model, &config, Some((take, patches)))
        })?
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

impl Session {
    /// Plays a take to its next frame.
    fn next_of_take(&self) -> Result<Option<OwnedFrame>, SessionError> {
        loop {
            if self.pull_frames(1, |_| ())? > 0 {
                let mut output = try_lock(&self.shared.output).ok_or(SessionError::Busy(OUTPUT))?;
                return Ok(Some(output.shown().0.clone()));
            }
            if self.is_done()? {
                return Ok(None);
            }
            self.push_take()?;
        }
    }

    /// The layers after the newest frame.
    fn layers_now(&self) -> Result<LayersState, SessionError> {
        let mut output = try_lock(&self.shared.output).ok_or(SessionError::Busy(OUTPUT))?;
        output.shown().1.keep().map_err(SessionError::State)
    }
}

/// The changed frames of a take, and the layers after them, which the motion that was edited is played for.
fn patches(model: &Arc<Model>, take: &Take, config: &SessionConfig) -> Result<Arc<[Patch]>, EngineError> {
    let failed = |error: String| EngineError::from(LoadError::argument("take", error));
    let redrawn = take.redrawn(model).map_err(|error| failed(error.to_string()))?;
    let total = u64::from(take.info().frames);
    let before = Session::make_decoder(model, config, Some((&take.original(), None)))?;
    let mut frame = 0;
    let mut patches = Vec::with_capacity(redrawn.len());
    for Redrawn { frames, drawn } in redrawn {
        let mut last = None;
        while frame < frames.end {
            last = before.next_of_take().map_err(|error| failed(error.to_string()))?;
            frame += 1;
        }
        let join = match last {
            Some(shown) if frames.end < total => {
                Some(Join { layers: before.layers_now().map_err(|error| failed(error.to_string()))?, shown })
            }
            _ => None,
        };
        patches.push(Patch { frames, drawn, join });
    }
    Ok(patches.into())
}
