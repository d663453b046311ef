//! One avatar and the person that talks with it: a scene of two, within a session.

use umo_core_base::state::{StateError, StatePass};
use umo_core_layers::Company;

use super::room::Room;
use super::{MAX_LEVEL, Place};

/// Slot of the avatar; the person has the other one.
const AVATAR: usize = 0;
/// Distance of the person, metres: as the listener of an avatar that is alone.
const AHEAD: f32 = 1.5;

/// An avatar and a person ahead of it, who is there from the first sound of a microphone on.
#[derive(Debug)]
pub(crate) struct Pair {
    room: Room<2>,
    is_there: bool,
}

impl Pair {
    pub(crate) fn new(seed: u64) -> Self {
        let mut room = Room::new(seed);
        let person = Place { position: [0.0, 0.0, AHEAD], facing: std::f32::consts::PI, ..Place::default() };
        room.add(Place::default(), true);
        room.add(person, false);
        Self { room, is_there: false }
    }

    /// Returns to a room without the person.
    pub(crate) fn reset(&mut self) {
        *self = Self::new(self.room.seed());
    }

    /// Advances by one frame of so many seconds, and returns the person as the avatar meets it. `own` and `person` are levels
    /// of their voices, the latter `None` while no microphone is heard.
    pub(crate) fn advance(&mut self, own: f32, person: Option<f32>, seconds: f32) -> Company {
        self.is_there |= person.is_some();
        if !self.is_there {
            return Company::ALONE;
        }
        let levels = [own, person.unwrap_or_default()].map(|level| level.clamp(0.0, MAX_LEVEL));
        (0..self.room.due(f64::from(seconds))).for_each(|_| self.room.tick(&levels));
        self.room.company(AVATAR)
    }

    pub(crate) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.switch("person", &mut self.is_there)?;
        self.room.state(pass)
    }
}
