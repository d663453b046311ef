//! Whom each member looks at, and when it looks away.

use umo_core_base::state::{StateError, StatePass};
use umo_core_layers::Role;

use super::draw::{Draws, between, short};
use super::{long_ticks, slot_state};

/// Seconds from hearing another one speak to the look there, less the 0.1 s until it is heard.
const REACTION: [f32; 2] = [0.1, 0.36];

/// Seconds of a listener's look at the speaker, past it, and at another listener; share of the latter in groups.
const LISTENS_THERE: [f32; 2] = [1.6, 6.4];
const LISTENS_AWAY: [f32; 2] = [0.5, 2.0];
const GLANCE: [f32; 2] = [0.5, 1.2];
const GLANCE_SHARE: f32 = 0.3;

/// Seconds of a speaker's look at a listener, and past it; share of looks past it that another one follows.
const SPEAKS_THERE: [f32; 2] = [0.5, 1.5];
const SPEAKS_AWAY: [f32; 2] = [0.7, 2.4];
const AWAY_AGAIN: f32 = 0.3;
/// Share of phrases that begin with a look away, and its seconds.
const BEGINS_AWAY: f32 = 0.7;
const BEGIN_AWAY: [f32; 2] = [0.5, 1.5];
/// Share of phrases that end with a look at a listener, and its seconds.
const ENDS_THERE: f32 = 0.6;
const END_THERE: [f32; 2] = [0.5, 1.1];
/// Least rest of a look that is there already, seconds.
const END_RESTS: f32 = 0.3;

/// Seconds of looks at each other and away while nobody speaks.
const IDLE_THERE: [f32; 2] = [0.8, 2.5];
const IDLE_AWAY: [f32; 2] = [0.9, 3.6];

/// Seconds for which who yields looks away.
const YIELDS_AWAY: [f32; 2] = [0.6, 1.2];

/// The look of one member; times in ticks.
#[derive(Debug)]
pub(super) struct Look {
    /// Whom it attends to.
    pub(super) at: Option<usize>,
    /// Whether it looks there.
    pub(super) is_contact: bool,
    /// Until the next choice.
    left: u32,
    /// Whom it last heard others attend to, and until it looks there; 0 if it will not.
    focus: Option<usize>,
    reaction: u32,
}

/// Surroundings of one member at a tick.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    pub(super) slot: usize,
    pub(super) role: Role,
    pub(super) focus: Option<usize>,
    /// Whether a phrase of its own begins or has ended, and whether it yields.
    pub(super) begins: bool,
    pub(super) ends: bool,
    pub(super) yields: bool,
    /// Bits of the other members' slots.
    pub(super) others: u32,
}

impl Look {
    pub(super) fn new() -> Self {
        Self { at: None, is_contact: false, left: 0, focus: None, reaction: 0 }
    }

    /// Forgets a member that leaves.
    pub(super) fn forget(&mut self, slot: usize) {
        if self.at == Some(slot) {
            (self.at, self.left) = (None, 0);
        }
        if self.focus == Some(slot) {
            (self.focus, self.reaction) = (None, 0);
        }
    }

    /// Advances by one tick.
    pub(super) fn advance(&mut self, seen: &Seen, draws: &mut Draws) {
        self.left = self.left.saturating_sub(1);
        if seen.focus != self.focus {
            self.focus = seen.focus;
            self.reaction = match seen.focus {
                Some(focus) if focus != seen.slot && !(self.at == Some(focus) && self.is_contact) => {
                    long_ticks(between(REACTION, draws.next()))
                }
                _ => 0,
            };
        }
        if self.reaction > 0 {
            self.reaction -= 1;
            if self.reaction == 0 && self.focus.is_some() {
                return self.look(self.focus, LISTENS_THERE, draws);
            }
        }
        if seen.yields {
            return self.look_away(YIELDS_AWAY, draws);
        }
        if seen.role == Role::Speaking {
            if seen.begins && draws.next() < BEGINS_AWAY {
                return self.look_away(BEGIN_AWAY, draws);
            }
            if seen.ends && self.is_contact {
                self.left = self.left.max(long_ticks(END_RESTS));
            } else if seen.ends && draws.next() < ENDS_THERE {
                return self.look(self.at.or_else(|| draws.one_of(seen.others)), END_THERE, draws);
            }
        }
        if self.left > 0 {
            return;
        }
        match seen.role {
            Role::Listening => self.listen(seen, draws),
            Role::Speaking => self.speak(seen, draws),
            Role::Idle if self.is_contact => self.look_away(IDLE_AWAY, draws),
            Role::Idle => self.look(draws.one_of(seen.others), IDLE_THERE, draws),
        }
    }

    fn listen(&mut self, seen: &Seen, draws: &mut Draws) {
        // Who waits for an answer looks at those who may give one.
        let speaker = seen.focus.filter(|&focus| focus != seen.slot).or_else(|| draws.one_of(seen.others));
        if self.at != speaker || !self.is_contact {
            return self.look(speaker, LISTENS_THERE, draws);
        }
        let rest = seen.others & !speaker.map_or(0, |slot| 1 << slot);
        if rest != 0 && draws.next() < GLANCE_SHARE {
            return self.look(draws.one_of(rest), GLANCE, draws);
        }
        self.look_away(LISTENS_AWAY, draws);
    }

    fn speak(&mut self, seen: &Seen, draws: &mut Draws) {
        if self.is_contact || draws.next() < AWAY_AGAIN {
            return self.look_away(SPEAKS_AWAY, draws);
        }
        // Round the listeners: not twice at the same one.
        let rest = seen.others & !self.at.map_or(0, |slot| 1 << slot);
        self.look(draws.one_of(if rest == 0 { seen.others } else { rest }), SPEAKS_THERE, draws);
    }

    fn look(&mut self, at: Option<usize>, range: [f32; 2], draws: &mut Draws) {
        (self.at, self.is_contact) = (at, at.is_some());
        self.left = long_ticks(short(range, draws.next()));
    }

    fn look_away(&mut self, range: [f32; 2], draws: &mut Draws) {
        self.is_contact = false;
        self.left = long_ticks(short(range, draws.next()));
    }

    pub(super) fn state(&mut self, pass: &mut StatePass, there: u32) -> Result<(), StateError> {
        slot_state(pass, &mut self.at, there)?;
        pass.switch("look", &mut self.is_contact)?;
        super::count(pass, &mut self.left, 1 << 20)?;
        slot_state(pass, &mut self.focus, there)?;
        super::count(pass, &mut self.reaction, 1 << 20)
    }
}
