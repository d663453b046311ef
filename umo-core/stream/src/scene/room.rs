//! The members of a scene and what passes between them, tick by tick.

use umo_core_base::functions::Functions;
use umo_core_base::state::{StateError, StatePass};
use umo_core_layers::{Company, Role};

use super::answers::Answers;
use super::draw::{Draws, Purpose};
use super::floor::Floor;
use super::looks::{Look, Seen};
use super::posture::Posture;
use super::voice::Voice;
use super::{Allowed, Place, TICKS_PER_SECOND, Target, count, ticks};

/// Upper bound on the members of a scene.
pub const MEMBERS: usize = 32;

/// Ticks that may be due after the longest update.
const MOST_DUE: u64 = TICKS_PER_SECOND as u64 + 1;
/// Time for which a member yields.
const YIELD: u32 = ticks(1.5);

/// One member.
#[derive(Debug)]
pub(super) struct Member {
    /// Number of the member, 0 for an empty slot.
    pub(super) id: u32,
    pub(super) place: Place,
    pub(super) has_body: bool,
    pub(super) allowed: Allowed,
    pub(super) target: Target,
    pub(super) voice: Voice,
    pub(super) role: Role,
    look: Look,
    answers: Answers,
    posture: Posture,
    yielding: u32,
}

impl Member {
    fn empty() -> Self {
        let mut draws = Draws::new(0, 0, 0, Purpose::Answers);
        Self {
            id: 0,
            place: Place::default(),
            has_body: false,
            allowed: Allowed::ALL,
            target: Target::Free,
            voice: Voice::new(),
            role: Role::Idle,
            look: Look::new(),
            answers: Answers::new(&mut draws),
            posture: Posture::new(&mut draws),
            yielding: 0,
        }
    }

    pub(super) fn is_there(&self) -> bool {
        self.id != 0
    }

    /// Position of its eyes in the scene.
    fn eyes(&self) -> [f32; 3] {
        let [x, y, z] = self.place.position;
        [x, y + self.place.eye_height, z]
    }

    /// A place of the scene as [`Company::place`] has it.
    fn seen_from(&self, [x, y, z]: [f32; 3]) -> [f32; 3] {
        let eyes = self.eyes();
        let ([dx, dy, dz], (sin, cos)) = ([x - eyes[0], y - eyes[1], z - eyes[2]], self.place.facing.sine_cosine());
        [dx * cos - dz * sin, dy, dx * sin + dz * cos]
    }
}

/// State of a member now.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MemberInfo {
    /// Whether it speaks, listens, or neither.
    pub role: Role,
    /// Whom it attends to; `None` for nobody, or for a point of the host's.
    pub attends_to: Option<u32>,
    /// Whether it looks there now.
    pub is_contact: bool,
    /// Amount of yielding to another one that interrupts, 0 or 1.
    pub yielding: f32,
    /// Numbers of its nods, brow raises and half smiles so far.
    pub answers: [u32; 3],
    /// Level of its voice, root mean square, full scale 1.
    pub level: f32,
}

/// A room for `N` members.
#[derive(Debug)]
pub(super) struct Room<const N: usize> {
    seed: u64,
    /// Ticks so far, and members so far.
    ticks: u64,
    members_so_far: u32,
    /// Seconds so far.
    seconds: f64,
    pub(super) members: [Member; N],
    pub(super) floor: Floor<N>,
}

impl<const N: usize> Room<N> {
    pub(super) fn new(seed: u64) -> Self {
        let members = std::array::from_fn(|_| Member::empty());
        Self { seed, ticks: 0, members_so_far: 0, seconds: 0.0, members, floor: Floor::new() }
    }

    pub(super) fn seed(&self) -> u64 {
        self.seed
    }

    /// Slot of a member.
    pub(super) fn slot(&self, id: u32) -> Option<usize> {
        self.members.iter().position(|member| member.is_there() && member.id == id)
    }

    /// Adds a member to an empty slot; `None` if all are taken.
    pub(super) fn add(&mut self, place: Place, has_body: bool) -> Option<(usize, u32)> {
        let slot = self.members.iter().position(|member| !member.is_there())?;
        self.members_so_far = self.members_so_far.wrapping_add(1).max(1);
        let id = self.members_so_far;
        let draws = |purpose| Draws::new(self.seed, id, self.ticks, purpose);
        self.members[slot] = Member {
            id,
            place,
            has_body,
            answers: Answers::new(&mut draws(Purpose::Answers)),
            posture: Posture::new(&mut draws(Purpose::Posture)),
            ..Member::empty()
        };
        Some((slot, id))
    }

    /// Removes a member; the others forget it.
    pub(super) fn remove(&mut self, slot: usize) {
        let id = std::mem::replace(&mut self.members[slot], Member::empty()).id;
        self.floor.forget(slot);
        for member in &mut self.members {
            member.look.forget(slot);
            member.posture.forget(slot);
            if member.target == Target::Member(id) {
                member.target = Target::Free;
            }
        }
    }

    /// Advances the time and returns the number of ticks that are due, without making them.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a count of ticks")]
    pub(super) fn due(&mut self, seconds: f64) -> u64 {
        // A tenth of a tick early: times that sum up to a tick except for rounding are one.
        self.seconds += seconds;
        let due = ((self.seconds * f64::from(TICKS_PER_SECOND) + 0.1) as u64).saturating_sub(self.ticks);
        // More are due of a forged state alone.
        due.min(MOST_DUE)
    }

    /// Bits of the slots with members.
    fn everybody(&self) -> u32 {
        let there = self.members.iter().enumerate().filter(|(_, member)| member.is_there());
        there.fold(0, |set, (slot, _)| set | 1 << slot)
    }

    /// Makes a tick; `levels` of the members' voices, full scale 1.
    pub(super) fn tick(&mut self, levels: &[f32; N]) {
        let everybody = self.everybody();
        let Self { seed, ticks, members, floor, .. } = self;
        for (member, &level) in members.iter_mut().zip(levels).filter(|(member, _)| member.is_there()) {
            member.voice.hear(level);
        }
        floor.advance(members);
        let focus = floor.focus;
        let ends = focus.is_some_and(|focus| members[focus].voice.ends);
        let is_heard = focus.is_some_and(|focus| members[focus].voice.silent < YIELD);
        for slot in 0..N {
            let member = &members[slot];
            if !member.is_there() {
                continue;
            }
            let other = focus.filter(|&focus| focus != slot).or(member.look.at);
            let other = other.filter(|&other| other != slot).map(|other| (other, members[other].posture.own));
            let member = &mut members[slot];
            let speaks = floor.is_speaker(slot, &member.voice);
            member.role = match focus {
                _ if speaks => Role::Speaking,
                Some(_) => Role::Listening,
                None => Role::Idle,
            };
            if !member.has_body {
                continue;
            }
            let draws = |purpose| Draws::new(*seed, member.id, *ticks, purpose);
            let yields = floor.yields == Some(slot);
            member.yielding = if yields { YIELD } else { member.yielding.saturating_sub(1) };
            let seen = Seen {
                slot,
                role: member.role,
                focus,
                begins: member.voice.begins,
                ends: member.voice.ends,
                yields: yields && member.allowed.has(Allowed::YIELD),
                others: everybody & !(1 << slot),
            };
            member.look.advance(&seen, &mut draws(Purpose::Looks));
            let listens = member.role == Role::Listening && focus != Some(slot) && is_heard;
            let [nods, smiles] = [Allowed::NOD, Allowed::SMILE].map(|part| member.allowed.has(part));
            member.answers.advance((listens, ends), [nods, nods, smiles], &mut draws(Purpose::Answers));
            member.posture.advance(other, &mut draws(Purpose::Posture));
        }
        *ticks += 1;
    }

    /// The others as a member meets them now.
    pub(super) fn company(&self, slot: usize) -> Company {
        let member = &self.members[slot];
        let others = || self.members.iter().enumerate().filter(|&(other, member)| other != slot && member.is_there());
        let target = match member.target {
            Target::Free => None,
            Target::Point(point) => Some(point),
            Target::Member(id) => self.slot(id).map(|slot| self.members[slot].eyes()),
        };
        let is_alone = others().next().is_none() || member.allowed == Allowed::NONE;
        if target.is_none() && is_alone {
            return Company::ALONE;
        }
        let looks = member.look.at.map(|at| self.members[at].eyes()).filter(|_| member.allowed.has(Allowed::LOOK));
        let place = target.or(looks);
        let [lean, weight] = if member.allowed.has(Allowed::MIRROR) { member.posture.shown() } else { [0.0; 2] };
        let [nods, brows, smiles] = member.answers.counts;
        Company {
            role: Some(member.role),
            has_place: place.is_some(),
            place: place.map_or([0.0; 3], |place| member.seen_from(place)),
            is_contact: target.is_some() || member.look.is_contact,
            nods,
            brows,
            smiles,
            lean,
            weight,
            yielding: self.yielding(slot),
            resting: f32::from(u8::from(member.role == Role::Listening && member.allowed.has(Allowed::YIELD))),
        }
    }

    fn yielding(&self, slot: usize) -> f32 {
        let member = &self.members[slot];
        f32::from(u8::from(member.yielding > 0 && member.allowed.has(Allowed::YIELD)))
    }

    /// State of a member now.
    pub(super) fn info(&self, slot: usize) -> MemberInfo {
        let member = &self.members[slot];
        let (attends_to, is_contact) = match member.target {
            Target::Member(id) => (Some(id), true),
            Target::Point(_) => (None, true),
            Target::Free if !member.allowed.has(Allowed::LOOK) => (None, false),
            Target::Free => (member.look.at.map(|at| self.members[at].id), member.look.is_contact),
        };
        MemberInfo {
            role: member.role,
            attends_to,
            is_contact,
            yielding: self.yielding(slot),
            answers: member.answers.counts,
            level: member.voice.level,
        }
    }

    /// Saves or loads the room; who is there must be the same.
    pub(super) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        for member in &self.members {
            pass.same("member of the scene", u64::from(member.id) << 1 | u64::from(member.has_body))?;
        }
        pass.number("seed of the scene", &mut self.seed, u64::MAX)?;
        pass.number("ticks of the scene", &mut self.ticks, 1 << 50)?;
        count(pass, &mut self.members_so_far, u32::MAX)?;
        pass.float(&mut self.seconds)?;
        let there = self.everybody();
        self.floor.state(pass, there)?;
        self.members.iter_mut().try_for_each(|member| member.state(pass, there))
    }
}

impl Member {
    fn state(&mut self, pass: &mut StatePass, there: u32) -> Result<(), StateError> {
        self.place.state(pass)?;
        self.allowed.state(pass)?;
        self.target.state(pass)?;
        self.voice.state(pass)?;
        let role = pass.limited("role", self.role as u64, Role::ALL.len() as u64 - 1)?;
        if pass.loads() {
            self.role = Role::ALL[usize::try_from(role).unwrap_or_default()];
        }
        self.look.state(pass, there)?;
        self.answers.state(pass)?;
        self.posture.state(pass, there)?;
        count(pass, &mut self.yielding, YIELD)
    }
}
