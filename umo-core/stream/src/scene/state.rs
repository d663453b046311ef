//! Saving and restoring a scene as a whole.
//!
//! ```text
//! the scene's own state | for each of its places: length of the session's state, 8 bytes, and the state; 0 without one
//! ```

use umo_core_base::state::{StateError, StatePass};

use super::room::{MEMBERS, Room};
use super::{
    Allowed, Body, Inner, MAX_DISTANCE, MAX_EYE_HEIGHT, MAX_FACING, MAX_LEVEL, Place, Scene, SceneError, Target,
    is_point,
};
use crate::session::{Session, SessionError};

/// Stands where a session's state has its model's fingerprint.
const MARK: u64 = u64::from_le_bytes(*b"umoscene");
/// Bytes of a length.
const LENGTH: usize = size_of::<u64>();

impl<B: Body> Scene<B> {
    /// Upper bound on the bytes of the scene's state, with those of its members' sessions; it changes with the members.
    ///
    /// # Errors
    /// [`SceneError::Busy`].
    pub fn state_size(&self) -> Result<usize, SceneError> {
        Ok(self.lock()?.state_size())
    }

    /// Writes the state of the scene and of all its members' sessions to the start of `bytes`, which has at least
    /// [`Self::state_size`] bytes, and returns the number written. Decoders have no state: their senders do.
    ///
    /// # Errors
    /// [`SceneError::Short`], `Busy`, and `Session` as of [`Session::save`]: then the state is not whole.
    pub fn save(&self, bytes: &mut [u8]) -> Result<usize, SceneError> {
        let mut inner = self.lock()?;
        let needed = inner.state_size();
        if bytes.len() < needed {
            return Err(SceneError::Short { needed });
        }
        let mut pass = StatePass::save(bytes, 0, 0);
        inner.own_state(&mut pass)?;
        let mut at = pass.end()?;
        for joined in &inner.bodies {
            let (length, state) = bytes[at..].split_at_mut(LENGTH);
            let saved = match joined {
                Some(joined) => joined.body.with(|session| save(session, state)).unwrap_or(Ok(0))?,
                None => 0,
            };
            length.copy_from_slice(&(saved as u64).to_le_bytes());
            at += LENGTH + saved;
        }
        Ok(at)
    }

    /// Restores a state of this scene, or of another with the same members and sessions of the same models and
    /// configurations: from then on the same calls do the same.
    ///
    /// # Errors
    /// [`SceneError::Session`] as of [`Session::restore`], and `Busy`. After an error, scene and sessions are unchanged.
    pub fn restore(&self, bytes: &[u8]) -> Result<(), SceneError> {
        let mut inner = self.lock()?;
        let own = inner.own_size();
        // A session's state is not a scene's.
        let (head, mut rest) = bytes.split_at_checked(own).ok_or(StateError::Foreign)?;
        let mut pass = StatePass::check(head, 0)?;
        inner
            .own_state(&mut pass)
            .map_err(|error| if error == StateError::Model { StateError::Foreign } else { error })?;
        pass.end()?;
        let mut parts: [&[u8]; MEMBERS] = [&[]; MEMBERS];
        for part in &mut parts {
            let short = StateError::Field("number of bytes");
            let (length, left) = rest.split_first_chunk::<LENGTH>().ok_or(short)?;
            let length = usize::try_from(u64::from_le_bytes(*length)).map_err(|_| short)?;
            (*part, rest) = left.split_at_checked(length).ok_or(short)?;
        }
        if !rest.is_empty() {
            return Err(StateError::Field("number of bytes").into());
        }
        let Inner { room, bodies, levels, ages, frames } = &mut **inner;
        let mut then = || {
            let mut pass = StatePass::load(head, 0);
            describe(&mut pass, room, levels, (ages, frames)).expect("these bytes were checked");
        };
        restore_from(bodies, &parts, &mut then)?;
        bodies.iter_mut().flatten().for_each(|joined| joined.told = None);
        Ok(())
    }
}

impl<B: Body> Inner<B> {
    fn state_size(&mut self) -> usize {
        let sessions = self.bodies.iter().flatten().filter_map(|joined| joined.body.with(Session::state_size));
        let sessions = sessions.sum::<usize>();
        self.own_size() + MEMBERS * LENGTH + sessions
    }

    /// Bytes of the scene's own state: the same for every scene.
    fn own_size(&mut self) -> usize {
        let mut pass = StatePass::size();
        let size = self.own_state(&mut pass).and_then(|()| pass.end());
        size.expect("nothing is checked")
    }

    fn own_state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        let Self { room, levels, ages, frames, .. } = self;
        describe(pass, room, levels, (ages, frames))
    }
}

fn describe(
    pass: &mut StatePass,
    room: &mut Room<MEMBERS>,
    levels: &mut [f32; MEMBERS],
    (ages, frames): (&mut [u64; MEMBERS], &mut [u64; MEMBERS]),
) -> Result<(), StateError> {
    pass.model(MARK)?;
    room.state(pass)?;
    levels.iter_mut().try_for_each(|level| pass.within(level, 0.0..=MAX_LEVEL))?;
    for word in ages.iter_mut().chain(frames) {
        pass.number("voices", word, u64::MAX)?;
    }
    Ok(())
}

/// Saves a session; a decoder has no state.
fn save(session: &Session, bytes: &mut [u8]) -> Result<usize, SessionError> {
    match session.state_size() {
        0 => Ok(0),
        _ => session.save(bytes),
    }
}

/// Restores the sessions, and then the scene: each is checked before any is changed.
fn restore_from<B: Body>(
    bodies: &[Option<super::Joined<B>>],
    parts: &[&[u8]],
    then: &mut dyn FnMut(),
) -> Result<(), SessionError> {
    let (Some((joined, bodies)), Some((bytes, parts))) = (bodies.split_first(), parts.split_first()) else {
        then();
        return Ok(());
    };
    let mut next = || restore_from(bodies, parts, then);
    let restored = joined.as_ref().and_then(|joined| {
        joined.body.with(|session| match session.state_size() {
            0 => None,
            _ => Some(session.restore_with(bytes, &mut next)),
        })
    });
    match restored.flatten() {
        Some(restored) => restored,
        None if bytes.is_empty() => next(),
        None => Err(StateError::Field("number of sessions").into()),
    }
}

impl Place {
    pub(super) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        for value in &mut self.position {
            pass.within(value, -MAX_DISTANCE..=MAX_DISTANCE)?;
        }
        pass.within(&mut self.facing, -MAX_FACING..=MAX_FACING)?;
        pass.within(&mut self.eye_height, 0.0..=MAX_EYE_HEIGHT)
    }
}

impl Allowed {
    pub(super) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        super::count(pass, &mut self.0, Self::ALL.0)
    }
}

impl Target {
    pub(super) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        let (kind, id, point) = match *self {
            Self::Free => (0, 0, [0.0; 3]),
            Self::Member(id) => (1, id, [0.0; 3]),
            Self::Point(point) => (2, 0, point),
        };
        // Exactly 0 where it does not count: a restored state is saved identically.
        let mut word = |value: u32, counts: bool| {
            let word = pass.limited("target", value.into(), if counts { u32::MAX.into() } else { 0 })?;
            Ok::<_, StateError>(u32::try_from(word).unwrap_or_default())
        };
        let kind = word(kind, true)?;
        let id = word(id, kind == 1)?;
        let point = point.map(|value| word(value.to_bits(), kind == 2));
        let [x, y, z] = point;
        let point = [x?, y?, z?].map(f32::from_bits);
        pass.must(kind <= 2 && is_point(point), "target")?;
        if pass.loads() {
            *self = match kind {
                0 => Self::Free,
                1 => Self::Member(id),
                _ => Self::Point(point),
            };
        }
        Ok(())
    }
}
