//! Saving and restoring a session's whole state as bytes: for replay, for rollback, and to move an
//! avatar to another process.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use umo_core_base::state::{StateError, StatePass};
use umo_core_layers::{Company, Controls};
use umo_core_model::model::Model;
use umo_core_pose::part::Part;

use super::input::Input;
use super::kept::EngineSide;
use super::other::OtherInput;
use super::output::Output;
use super::packets::PacketQueue;
use super::schedule::Member;
use super::shared::{Counters, Settings, Shared, try_lock};
use super::slots::lock;
use super::{INPUT, Idle, OTHER, OUTPUT, SETTER, Session, SessionError, Source};
use crate::playback::{Host, gain_bits};
use crate::take::Recorder;

/// All sides of a session, locked.
///
/// The rings have one producer and one consumer each. Audio is pushed under the lock of `input` and
/// taken by the owner of the member; frames are pushed by the owner of the member and taken under
/// the lock of `output`. The holder of all three has exclusive access to both ends of both rings.
/// Two words can still change at any moment, the epoch and the idle mode; such a change counts as
/// made before or after.
struct Sides<'a> {
    shared: &'a Shared,
    model: &'a Model,
    engine: EngineSide<'a>,
    input: &'a mut Input,
    other: &'a mut OtherInput,
    output: &'a mut Output,
    settings: &'a mut Settings,
    controls: &'a mut Controls,
    company: &'a mut Company,
}

/// Upper bound on the bytes of a new session's state.
pub(crate) fn state_size(shared: &Shared, member: Option<&mut Member>, model: &Model) -> usize {
    let free = "nobody else knows the session yet";
    let (mut input, mut output) = (try_lock(&shared.input).expect(free), try_lock(&shared.output).expect(free));
    let mut settings = try_lock(&shared.settings.value).expect(free);
    let mut other = try_lock(&shared.other).expect(free);
    let mut controls = try_lock(&shared.host.controls.value).expect(free);
    let mut company = try_lock(&shared.host.company.value).expect(free);
    let (input, output, settings, controls) = (&mut *input, &mut **output, &mut *settings, &mut *controls);
    let mut pass = StatePass::size();
    let engine = match member {
        Some(member) => {
            assert!(try_lock(&shared.kept).expect(free).fits(member, model), "the engine's side has room to be kept");
            EngineSide::Here(member)
        }
        None => EngineSide::Absent,
    };
    Sides { shared, model, engine, input, other: &mut other, output, settings, controls, company: &mut company }
        .state(&mut pass)
        .expect("nothing is checked");
    pass.end().expect("nothing is checked")
}

impl Session {
    /// Upper bound on the bytes of this session's state; constant for its lifetime.
    pub fn state_size(&self) -> usize {
        self.state_size
    }

    /// Writes the session's whole state to the start of `bytes`, which has at least
    /// [`Self::state_size`] bytes, and returns the number written. The session continues
    /// unaffected. A chunk that the engine is computing meanwhile is computed again by the restored
    /// session.
    ///
    /// Never waits for a chunk and never allocates. The bytes contain no address and no absolute
    /// time, so another process can restore them.
    ///
    /// # Errors
    /// [`SessionError::Busy`] while another thread is in a call that pushes, pulls or sets;
    /// [`SessionError::Short`].
    pub fn save(&self, bytes: &mut [u8]) -> Result<usize, SessionError> {
        if bytes.len() < self.state_size {
            return Err(SessionError::Short { needed: self.state_size });
        }
        self.with_sides(true, |mut sides| {
            let mut pass = StatePass::save(bytes, sides.shared.host.clock.nanos(), sides.shared.host.clock.now());
            sides.state(&mut pass)?;
            Ok(pass.end()?)
        })
    }

    /// Restores the state of this session, or of another one with the same model and config: from
    /// then on it produces the same frames for the same calls. Earlier frames and audio are
    /// dropped; settings and statistics are the state's; [`Self::latency`] continues.
    ///
    /// Never waits for a chunk and never allocates. An interrupt or a reset by another thread
    /// counts as made before or after.
    ///
    /// # Errors
    /// [`SessionError::State`] if the bytes are not a state, or not one of this model and config;
    /// [`SessionError::Busy`] as for [`Self::save`], and while the engine computes a chunk of this
    /// session, which it does as soon as there is audio for one, or at once if text alone drives
    /// the avatar. The session is unchanged after an error.
    pub fn restore(&self, bytes: &[u8]) -> Result<(), SessionError> {
        self.restore_with(bytes, &mut || Ok(()))
    }

    /// [`Self::restore`], after `next` has succeeded; an error of either leaves the session unchanged.
    pub(crate) fn restore_with(
        &self,
        bytes: &[u8],
        next: &mut dyn FnMut() -> Result<(), SessionError>,
    ) -> Result<(), SessionError> {
        let now = self.shared.host.clock.nanos();
        self.with_sides(false, |mut sides| {
            let mut pass = StatePass::check(bytes, now)?;
            sides.state(&mut pass)?;
            pass.end()?;
            next()?;
            if let Some(mut recording) = sides.shared.recorder.as_ref().and_then(Recorder::keep) {
                recording.close();
            }
            let mut pass = StatePass::load(bytes, now);
            sides.state(&mut pass).expect("these bytes were checked");
            Ok(())
        })
    }

    /// Calls `f` with all sides. If the engine's side is in a batch and `may_be_away`, `f` gets its
    /// snapshot from before the chunk.
    fn with_sides<R>(
        &self,
        may_be_away: bool,
        f: impl FnOnce(Sides) -> Result<R, SessionError>,
    ) -> Result<R, SessionError> {
        let shared = &*self.shared;
        shared.outcome.check()?;
        let result = {
            let _reader = shared.packets.as_ref().map(PacketQueue::lock).transpose()?;
            let mut input = try_lock(&shared.input).ok_or(SessionError::Busy(INPUT))?;
            let mut other = try_lock(&shared.other).ok_or(SessionError::Busy(OTHER))?;
            let mut output = try_lock(&shared.output).ok_or(SessionError::Busy(OUTPUT))?;
            let mut settings = try_lock(&shared.settings.value).ok_or(SessionError::Busy(SETTER))?;
            let mut controls = try_lock(&shared.host.controls.value).ok_or(SessionError::Busy(SETTER))?;
            let mut company = try_lock(&shared.host.company.value).ok_or(SessionError::Busy(SETTER))?;
            let (model, mut f) = (self.model()?, Some(f));
            let mut with = |engine: EngineSide<'_>| {
                let (input, output, settings, controls) = (&mut *input, &mut **output, &mut *settings, &mut *controls);
                let (other, company) = (&mut *other, &mut *company);
                let sides = Sides { shared, model, engine, input, other, output, settings, controls, company };
                f.take().map(|f| f(sides))
            };
            let slot = match &self.source {
                Source::Engine(slot) => slot,
                _ => return with(EngineSide::Absent).unwrap_or(Err(SessionError::IsDecoder)),
            };
            match slot.with_member(|member, _| with(EngineSide::Here(member))) {
                Some(result) => result,
                // The engine begins no other chunk while its snapshot is read.
                None if may_be_away => lock(&shared.kept).and_then(|kept| with(EngineSide::Away(&kept))),
                None => None,
            }
        };
        // The engine skips locked slots: it must check again.
        shared.link.notify();
        result.unwrap_or(Err(SessionError::Busy("a chunk of this session")))
    }
}

impl Sides<'_> {
    fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        let Self { shared, model, engine, input, other, output, settings, controls, company } = self;
        pass.model(model.fingerprint())?;
        input.identity(pass)?;
        engine.identity(pass)?;
        output.identity(pass, shared)?;
        let (waiting, frames) = shared.link.state(pass, engine.audio())?;
        let packets = shared.packets.as_ref().map_or(Ok(0), |packets| packets.state(pass))?;
        input.state(pass, shared, waiting)?;
        other.state(pass)?;
        shared.host.clock.state(pass)?;
        output.state(pass)?;
        engine.state(pass, shared, model, (frames, packets))?;
        shared.state(pass, engine.counted())?;
        settings.state(pass)?;
        controls.state(pass)?;
        company.state(pass)?;
        word(pass, &shared.host.begun_gestures)?;
        word(pass, &shared.host.passed_hints)?;
        word(pass, &shared.host.passed_words)?;
        switch(pass, "settings", &shared.settings.is_unseen)?;
        switch(pass, "controls", &shared.host.controls.is_unseen)?;
        switch(pass, "company", &shared.host.company.is_unseen)?;
        switch(pass, "company", &shared.host.listens)
    }
}

impl Shared {
    /// Describes the state that belongs to no side; if the engine's side is in a batch, with the
    /// values of its snapshot.
    fn state(&self, pass: &mut StatePass, kept: Option<(&[u64; Counters::OF_ENGINE], bool)>) -> Result<(), StateError> {
        let Host { clock, idle, gains, other_level, other_time, .. } = &self.host;
        let mode = pass.limited("idle mode", idle.load(Ordering::Relaxed).into(), Idle::Live as u64)?;
        if pass.loads() {
            idle.store(u8::try_from(mode).unwrap_or_default(), Ordering::Relaxed);
        }
        self.link.waiting_state(pass, kept.is_some_and(|(_, silence_wanted)| silence_wanted))?;
        for part in Part::ALL {
            let bits = gain_bits(pass, gains[part].load(Ordering::Relaxed))?;
            if pass.loads() {
                gains[part].store(bits, Ordering::Relaxed);
            }
        }
        let level = pass.limited("other's level", other_level.load(Ordering::Relaxed).into(), u32::MAX.into())?;
        let level = u32::try_from(level).unwrap_or_default();
        pass.must(f32::from_bits(level).is_finite(), "other's level")?;
        let time = pass.host_moment("other's time", other_time.load(Ordering::Relaxed))?;
        if pass.loads() {
            other_level.store(level, Ordering::Relaxed);
            other_time.store(time, Ordering::Relaxed);
        }
        clock.heard_state(pass)?;
        self.stats.state(pass, kept.map(|(counters, _)| counters))
    }
}

impl Counters {
    fn state(&self, pass: &mut StatePass, kept: Option<&[u64; Self::OF_ENGINE]>) -> Result<(), StateError> {
        match kept {
            Some(kept) => kept.iter().try_for_each(|&value| pass.word(value).map(drop))?,
            None => self.of_engine().into_iter().try_for_each(|counter| word(pass, counter))?,
        }
        let Self { dropped_frames, overruns, silenced, .. } = self;
        [dropped_frames, overruns, silenced].into_iter().try_for_each(|counter| word(pass, counter))
    }
}

impl Settings {
    fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        let count = pass.count("prompt", self.text_len, self.text.len())?;
        if pass.loads() {
            self.text_len = count;
        }
        pass.ids(&mut self.text[..count])?;
        self.sampler.state(pass)
    }
}

fn word(pass: &mut StatePass, field: &AtomicU64) -> Result<(), StateError> {
    let value = pass.word(field.load(Ordering::Relaxed))?;
    if pass.loads() {
        field.store(value, Ordering::Relaxed);
    }
    Ok(())
}

fn switch(pass: &mut StatePass, what: &'static str, field: &AtomicBool) -> Result<(), StateError> {
    let value = pass.flag(what, field.load(Ordering::SeqCst))?;
    if pass.loads() {
        field.store(value, Ordering::SeqCst);
    }
    Ok(())
}
