//! Posture: each member changes its own now and then, and follows the one it attends to, late and a third as far.

use umo_core_base::state::{StateError, StatePass};

use super::draw::{Draws, between};
use super::{long_ticks, slot_state};

/// Seconds between two changes of the own posture.
const CHANGE: [f32; 2] = [10.0, 30.0];
/// Seconds after which another one's is followed, and share.
const LATE: [f32; 2] = [2.0, 4.0];
const SHARE: f32 = 1.0 / 3.0;
/// Largest lean and weight of the own posture: what is followed comes on top.
const OWN: [f32; 2] = [0.6, 0.7];

/// Lean forward and shift of weight to the left.
pub(super) type Stance = [f32; 2];

/// Posture of one member; times in ticks.
#[derive(Debug)]
pub(super) struct Posture {
    pub(super) own: Stance,
    left: u32,
    /// Whom it follows, what it has seen there, until it follows, and what it follows now.
    whom: Option<usize>,
    seen: Stance,
    late: u32,
    followed: Stance,
}

impl Posture {
    pub(super) fn new(draws: &mut Draws) -> Self {
        let left = long_ticks(between([1.0, CHANGE[1]], draws.next()));
        Self { own: [0.0; 2], left, whom: None, seen: [0.0; 2], late: 0, followed: [0.0; 2] }
    }

    /// Forgets a member that leaves.
    pub(super) fn forget(&mut self, slot: usize) {
        self.whom = self.whom.filter(|&whom| whom != slot);
    }

    /// Advances by one tick; `other` is whom it attends to, and the posture there.
    pub(super) fn advance(&mut self, other: Option<(usize, Stance)>, draws: &mut Draws) {
        self.left = self.left.saturating_sub(1);
        if self.left == 0 {
            self.own = OWN.map(|most| most * (2.0 * draws.next() - 1.0));
            self.left = long_ticks(between(CHANGE, draws.next()));
        }
        if let Some((whom, stance)) = other
            && (self.whom != Some(whom) || self.seen != stance)
        {
            (self.whom, self.seen) = (Some(whom), stance);
            self.late = long_ticks(between(LATE, draws.next()));
        }
        if self.late > 0 {
            self.late -= 1;
            if self.late == 0 {
                self.followed = self.seen;
            }
        }
    }

    /// Lean and weight to show. The weight goes to the other side, as in a mirror.
    pub(super) fn shown(&self) -> Stance {
        [self.own[0] + SHARE * self.followed[0], self.own[1] - SHARE * self.followed[1]]
    }

    pub(super) fn state(&mut self, pass: &mut StatePass, there: u32) -> Result<(), StateError> {
        super::count(pass, &mut self.left, 1 << 20)?;
        super::count(pass, &mut self.late, 1 << 20)?;
        slot_state(pass, &mut self.whom, there)?;
        for stance in [&mut self.own, &mut self.seen, &mut self.followed] {
            stance.iter_mut().try_for_each(|value| pass.within(value, -1.0..=1.0))?;
        }
        Ok(())
    }
}
