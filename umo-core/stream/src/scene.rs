//! A scene: avatars that know each other (SPEC 2.23).
//!
//! ```text
//!  sessions ── level of the frame shown ──► voices ──► floor ──► looks, answers, posture
//!  microphones ── push_audio ──────────────────┘                          │
//!  sessions ◄── company: who is where, whom to look at, when to answer ───┘
//! ```
//!
//! | module | part |
//! |---|---|
//! | `room` | members, and the order of a tick |
//! | `voice`, `floor` | who sounds, who has the floor, who interrupts whom |
//! | `looks`, `answers`, `posture` | what each member does |
//! | `pair` | one avatar and one person, within a session |
//! | `draw` | random choices of seed, member and tick |
//! | `state` | saving and restoring |

mod answers;
mod draw;
mod floor;
mod looks;
mod pair;
mod posture;
mod room;
mod state;
#[cfg(test)]
mod tests;
mod voice;

use std::fmt;
use std::ops::BitOr;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use umo_core_base::memory::{self, OutOfMemory};
use umo_core_base::state::{StateError, StatePass};
use umo_core_layers::Company;
pub use umo_core_layers::Role;

use crate::link::try_lock;
use crate::session::{Session, SessionError};

pub(crate) use pair::Pair;
pub use room::{MEMBERS as MAX_MEMBERS, MemberInfo};

use room::{MEMBERS, Room};

/// Ticks of a scene per second, and their length.
const TICKS_PER_SECOND: u32 = 30;
const TICK_SECONDS: f32 = 1.0 / TICKS_PER_SECOND as f32;

/// Longest time of one update, seconds: of a longer one the rest is left out, as of a host that was paused.
const MAX_UPDATE: f64 = 1.0;
/// Ticks without a new frame or new samples after which a voice counts as silent.
const STALE: u64 = ticks(0.25) as u64;
/// Largest magnitude of a coordinate, metres; of a facing, radians; largest height of eyes, metres.
const MAX_DISTANCE: f32 = 10_000.0;
const MAX_FACING: f32 = 1000.0;
const MAX_EYE_HEIGHT: f32 = 100.0;
/// Largest level of a voice.
const MAX_LEVEL: f32 = 1e6;

/// Ticks in a time, of which a compiled program knows the number.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few seconds")]
const fn ticks(seconds: f32) -> u32 {
    (seconds * TICKS_PER_SECOND as f32 + 0.5) as u32
}

/// Ticks in a time that was drawn, at least one.
fn long_ticks(seconds: f32) -> u32 {
    ticks(seconds).max(1)
}

/// Where a member stands, in the scene's space: Y up, right-handed, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Position on the floor.
    pub position: [f32; 3],
    /// Direction it faces: 0 is +Z, to +X (its left) is positive, radians.
    pub facing: f32,
    /// Height of its eyes above the position.
    pub eye_height: f32,
}

impl Default for Place {
    /// At the origin, facing +Z, with the eyes of an adult.
    fn default() -> Self {
        Self { position: [0.0; 3], facing: 0.0, eye_height: 1.6 }
    }
}

impl Place {
    fn check(&self) -> Result<(), SceneError> {
        let is_good = is_point(self.position)
            && self.facing.abs() <= MAX_FACING
            && (0.0..=MAX_EYE_HEIGHT).contains(&self.eye_height);
        if is_good { Ok(()) } else { Err(SceneError::Place) }
    }
}

/// Target of a member's look.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Target {
    /// Chosen by the scene.
    #[default]
    Free,
    /// Another member's eyes, whatever is said.
    Member(u32),
    /// A point of the scene.
    Point([f32; 3]),
}

/// Parts that the scene may play of a member: a set of bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Allowed(u32);

impl Allowed {
    /// Looks: at whom, and away.
    pub const LOOK: Self = Self(1);
    /// Nods and raised brows of a listener.
    pub const NOD: Self = Self(2);
    /// Half smiles of a listener.
    pub const SMILE: Self = Self(4);
    /// Lean and shifts of weight, its own and those that follow another's.
    pub const MIRROR: Self = Self(8);
    /// Giving way to who interrupts it, and arms that rest while another one speaks.
    pub const YIELD: Self = Self(16);
    /// No part.
    pub const NONE: Self = Self(0);
    /// Every part.
    pub const ALL: Self = Self(31);

    /// The set of these bits; `None` if there are others.
    pub const fn from_bits(bits: u32) -> Option<Self> {
        if bits & !Self::ALL.0 == 0 { Some(Self(bits)) } else { None }
    }

    /// Its bits.
    pub const fn bits(self) -> u32 {
        self.0
    }

    /// Whether all of `parts` are in the set.
    pub const fn has(self, parts: Self) -> bool {
        self.0 & parts.0 == parts.0
    }
}

impl BitOr for Allowed {
    type Output = Self;

    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

/// Access to a member's session, which its owner may drop at any time.
pub trait Body {
    /// Calls `call` with the session; `None` if it is gone, and the member leaves the scene.
    fn with<R>(&self, call: impl FnOnce(&Session) -> R) -> Option<R>;
}

impl Body for Arc<Session> {
    fn with<R>(&self, call: impl FnOnce(&Session) -> R) -> Option<R> {
        Some(call(self))
    }
}

impl Body for &Session {
    fn with<R>(&self, call: impl FnOnce(&Session) -> R) -> Option<R> {
        Some(call(self))
    }
}

/// A call that failed; it changed nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SceneError {
    /// Another thread is in a call on the scene; retry.
    Busy,
    /// The scene has [`MAX_MEMBERS`] members.
    Full,
    /// The scene has no such member.
    NoMember(u32),
    /// A place is out of range.
    Place,
    /// A target is out of range.
    Target,
    /// The time of an update is out of range.
    Time,
    /// The buffer is too small for the state.
    Short {
        /// Bytes needed.
        needed: usize,
    },
    /// A member's session failed.
    Session(SessionError),
}

impl fmt::Display for SceneError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Busy => write!(f, "another thread is in a call on this scene: call again"),
            Self::Full => write!(f, "a scene has {MAX_MEMBERS} members at most: remove one first"),
            Self::NoMember(id) => write!(f, "the scene has no such member {id}"),
            Self::Place => {
                write!(f, "a place needs a position within 10 km, a facing, and eyes at a height of 0 to 100 m")
            }
            Self::Target => write!(f, "a target is another member, or a point within 10 km"),
            Self::Time => write!(f, "the time of an update must be a number of seconds from 0 on"),
            Self::Short { needed } => write!(f, "the buffer needs {needed} bytes"),
            Self::Session(error) => write!(f, "{error}"),
        }
    }
}

impl std::error::Error for SceneError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Session(error) => Some(error),
            _ => None,
        }
    }
}

impl From<SessionError> for SceneError {
    fn from(error: SessionError) -> Self {
        Self::Session(error)
    }
}

impl From<StateError> for SceneError {
    fn from(error: StateError) -> Self {
        Self::Session(error.into())
    }
}

/// Avatars that know each other, and people with microphones: up to [`MAX_MEMBERS`].
///
/// [`Self::update`] reads the voice of each, decides who has the floor, and tells each session whom to look at and when to
/// answer. A session's own look-at, attention, mood and gestures come first. A member's session is reached through `B`:
/// [`Arc<Session>`], or a type of the host's.
///
/// Every call may come from any thread; if two make calls at once, one gets [`SceneError::Busy`], except
/// [`Self::push_audio`], which runs beside all others. Once a scene exists, its calls neither allocate nor wait, and make no
/// system call. A session may be in one scene at a time.
#[derive(Debug)]
pub struct Scene<B: Body> {
    inner: Mutex<Box<Inner<B>>>,
    ears: [Ear; MEMBERS],
}

#[derive(Debug)]
struct Inner<B> {
    room: Room<MEMBERS>,
    bodies: [Option<Joined<B>>; MEMBERS],
    /// Level of each voice, ticks since it was heard last, and one more than the frame that it was heard of.
    levels: [f32; MEMBERS],
    ages: [u64; MEMBERS],
    frames: [u64; MEMBERS],
}

/// The session of a member.
#[derive(Debug)]
struct Joined<B> {
    body: B,
    /// The company that the session was told last.
    told: Option<Company>,
}

/// Samples of a member without a body since the last tick.
#[derive(Debug, Default)]
struct Ear {
    /// Number of the member; 0 without one.
    id: AtomicU32,
    /// Sum of their squares, in units of 2^-32, and their number.
    sum: AtomicU64,
    count: AtomicU64,
}

impl<B: Body> Scene<B> {
    /// Creates an empty scene, whose random choices follow from `seed`. Allocates everything that it will need.
    ///
    /// # Errors
    /// [`OutOfMemory`].
    pub fn new(seed: u64) -> Result<Self, OutOfMemory> {
        memory::catch(|| {
            memory::require(size_of::<Inner<B>>());
            let inner = Inner {
                room: Room::new(seed),
                bodies: std::array::from_fn(|_| None),
                levels: [0.0; MEMBERS],
                ages: [STALE; MEMBERS],
                frames: [0; MEMBERS],
            };
            Self { inner: Mutex::new(Box::new(inner)), ears: std::array::from_fn(|_| Ear::default()) }
        })
    }

    /// Adds a member, and returns its number: from 1 on, never used again. Without a body it is a person, whose voice comes
    /// by [`Self::push_audio`], or somebody who only listens.
    ///
    /// # Errors
    /// [`SceneError::Full`], `Place`, `Busy`.
    pub fn add(&self, body: Option<B>, place: Place) -> Result<u32, SceneError> {
        place.check()?;
        let mut inner = self.lock()?;
        let (slot, id) = inner.room.add(place, body.is_some()).ok_or(SceneError::Full)?;
        let ear = &self.ears[slot];
        ear.take();
        ear.id.store(if body.is_none() { id } else { 0 }, Ordering::Release);
        inner.bodies[slot] = body.map(|body| Joined { body, told: None });
        (inner.levels[slot], inner.ages[slot], inner.frames[slot]) = (0.0, STALE, 0);
        Ok(id)
    }

    /// Removes a member. Its session goes on alone; the others look elsewhere.
    ///
    /// # Errors
    /// [`SceneError::NoMember`], `Busy`.
    pub fn remove(&self, id: u32) -> Result<(), SceneError> {
        let mut inner = self.lock()?;
        let slot = inner.slot(id)?;
        if let Some(joined) = &inner.bodies[slot] {
            joined.body.with(Session::leave_company);
        }
        self.forget(&mut inner, slot);
        Ok(())
    }

    fn forget(&self, inner: &mut Inner<B>, slot: usize) {
        inner.room.remove(slot);
        inner.bodies[slot] = None;
        self.ears[slot].id.store(0, Ordering::Release);
    }

    /// Moves a member.
    ///
    /// # Errors
    /// [`SceneError::NoMember`], `Place`, `Busy`.
    pub fn set_place(&self, id: u32, place: Place) -> Result<(), SceneError> {
        place.check()?;
        let mut inner = self.lock()?;
        let slot = inner.slot(id)?;
        inner.room.members[slot].place = place;
        Ok(())
    }

    /// Sets the target of a member's look, until it is [`Target::Free`] again, or the target leaves.
    ///
    /// # Errors
    /// [`SceneError::NoMember`], `Target` for a point out of range or the member itself, `Busy`.
    pub fn set_target(&self, id: u32, target: Target) -> Result<(), SceneError> {
        let mut inner = self.lock()?;
        let slot = inner.slot(id)?;
        match target {
            Target::Point(point) if !is_point(point) => return Err(SceneError::Target),
            Target::Member(other) if other == id => return Err(SceneError::Target),
            Target::Member(other) => inner.slot(other).map(|_| ())?,
            Target::Point(_) | Target::Free => {}
        }
        inner.room.members[slot].target = target;
        Ok(())
    }

    /// Sets the parts that the scene plays of a member; all at first.
    ///
    /// # Errors
    /// [`SceneError::NoMember`], `Busy`.
    pub fn set_allowed(&self, id: u32, allowed: Allowed) -> Result<(), SceneError> {
        let mut inner = self.lock()?;
        let slot = inner.slot(id)?;
        inner.room.members[slot].allowed = allowed;
        Ok(())
    }

    /// Feeds the voice of a member without a body: samples at any rate, of any number of channels, full scale 1. Only their
    /// loudness is used; samples that are NaN or infinite count as silence.
    ///
    /// Wait-free; meant for the thread that records.
    ///
    /// # Errors
    /// [`SceneError::NoMember`] for one that is not there, or has a body.
    pub fn push_audio(&self, id: u32, samples: &[f32]) -> Result<(), SceneError> {
        let ear = self.ears.iter().find(|ear| id != 0 && ear.id.load(Ordering::Acquire) == id);
        ear.ok_or(SceneError::NoMember(id))?.push(samples);
        Ok(())
    }

    /// Advances the scene by `seconds`: once per picture, before frames are pulled or sampled. Reads each session's voice at
    /// the frame that it has shown last. Of a time longer than a second the rest is left out. Members whose session is gone
    /// leave.
    ///
    /// # Errors
    /// [`SceneError::Time`] if the time is negative or not finite; [`SceneError::Busy`].
    pub fn update(&self, seconds: f64) -> Result<(), SceneError> {
        if !(0.0..=f64::MAX).contains(&seconds) {
            return Err(SceneError::Time);
        }
        let mut inner = self.lock()?;
        let due = inner.room.due(seconds.min(MAX_UPDATE));
        self.hear(&mut inner, due);
        let Inner { room, levels, bodies, .. } = &mut **inner;
        (0..due).for_each(|_| room.tick(levels));
        for (slot, joined) in bodies.iter_mut().enumerate() {
            let Some(joined) = joined else { continue };
            let company = room.company(slot);
            let is_new = joined.told != Some(company);
            if is_new && joined.body.with(|session| session.keep_company(&company)) == Some(true) {
                joined.told = Some(company);
            }
        }
        Ok(())
    }

    /// Reads the voices before `due` ticks.
    fn hear(&self, inner: &mut Inner<B>, due: u64) {
        for slot in 0..MEMBERS {
            if !inner.room.members[slot].is_there() {
                continue;
            }
            let heard = match &mut inner.bodies[slot] {
                None => self.ears[slot].take(),
                Some(joined) => match joined.body.with(Session::voice_shown) {
                    None => {
                        self.forget(inner, slot);
                        continue;
                    }
                    // Another thread pulls: as before.
                    Some(None) => None,
                    Some(Some((frame, level))) => {
                        let before = std::mem::replace(&mut inner.frames[slot], frame + 1);
                        (before != frame + 1).then_some(level)
                    }
                },
            };
            let age = &mut inner.ages[slot];
            *age = age.saturating_add(due);
            if let Some(level) = heard {
                (inner.levels[slot], *age) = (level.clamp(0.0, MAX_LEVEL), 0);
            } else if *age > STALE {
                inner.levels[slot] = 0.0;
            }
        }
    }

    /// The member that has the floor, if one has.
    ///
    /// # Errors
    /// [`SceneError::Busy`].
    pub fn floor(&self) -> Result<Option<u32>, SceneError> {
        let inner = self.lock()?;
        Ok(inner.room.floor.holder.map(|slot| inner.room.members[slot].id))
    }

    /// State of a member now.
    ///
    /// # Errors
    /// [`SceneError::NoMember`], `Busy`.
    pub fn member(&self, id: u32) -> Result<MemberInfo, SceneError> {
        let inner = self.lock()?;
        Ok(inner.room.info(inner.slot(id)?))
    }

    fn lock(&self) -> Result<std::sync::MutexGuard<'_, Box<Inner<B>>>, SceneError> {
        try_lock(&self.inner).ok_or(SceneError::Busy)
    }
}

impl<B> Inner<B> {
    fn slot(&self, id: u32) -> Result<usize, SceneError> {
        self.room.slot(id).ok_or(SceneError::NoMember(id))
    }
}

impl<B: Body> Drop for Scene<B> {
    fn drop(&mut self) {
        let inner = self.inner.get_mut().unwrap_or_else(std::sync::PoisonError::into_inner);
        for joined in inner.bodies.iter().flatten() {
            joined.body.with(Session::leave_company);
        }
    }
}

impl Ear {
    fn push(&self, samples: &[f32]) {
        const UNIT: f64 = (1_u64 << 32) as f64;
        let square = |&sample: &f32| if sample.is_finite() { f64::from(sample.clamp(-1.0, 1.0)).powi(2) } else { 0.0 };
        let sum: f64 = samples.iter().map(square).sum();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the range, or saturated")]
        self.sum.fetch_add((sum * UNIT) as u64, Ordering::Relaxed);
        self.count.fetch_add(samples.len() as u64, Ordering::Release);
    }

    /// Level of what was pushed since the last call; `None` if nothing was.
    fn take(&self) -> Option<f32> {
        const UNIT: f64 = (1_u64 << 32) as f64;
        let count = self.count.swap(0, Ordering::Acquire);
        let sum = self.sum.swap(0, Ordering::Relaxed);
        #[expect(clippy::cast_possible_truncation, reason = "a level's precision is enough")]
        (count > 0).then(|| (sum as f64 / UNIT / count as f64).sqrt() as f32)
    }
}

fn is_point(point: [f32; 3]) -> bool {
    point.iter().all(|value| value.abs() <= MAX_DISTANCE)
}

/// Describes a counter.
fn count(pass: &mut StatePass, field: &mut u32, most: u32) -> Result<(), StateError> {
    let value = pass.limited("scene", u64::from(*field), most.into())?;
    if pass.loads() {
        *field = u32::try_from(value).unwrap_or_default();
    }
    Ok(())
}

/// Describes a member's slot, one of the bits `there`, or none.
fn slot_state(pass: &mut StatePass, field: &mut Option<usize>, there: u32) -> Result<(), StateError> {
    let value = pass.limited("scene", field.map_or(0, |slot| slot as u64 + 1), MEMBERS as u64)?;
    pass.must(value == 0 || there >> (value.max(1) - 1) & 1 == 1, "scene")?;
    if pass.loads() {
        *field = usize::try_from(value).unwrap_or_default().checked_sub(1);
    }
    Ok(())
}
