//! The four parts of the body, in fixed order.

use std::ops::{Index, IndexMut};

use serde::{Deserialize, Serialize};

/// One part of the body, with its own code stream (paper section 3; SPEC 1).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// Jaw and expression.
    Face,
    /// The thirty finger joints.
    Hands,
    /// Spine, neck, head and arms.
    Upper,
    /// Pelvis, legs and root motion.
    Lower,
}

impl Part {
    /// All parts, in order.
    pub const ALL: [Self; 4] = [Self::Face, Self::Hands, Self::Upper, Self::Lower];

    /// Name used in files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Face => "face",
            Self::Hands => "hands",
            Self::Upper => "upper",
            Self::Lower => "lower",
        }
    }
}

/// One value per part.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct PerPart<T> {
    /// Jaw and expression.
    pub face: T,
    /// The thirty finger joints.
    pub hands: T,
    /// Spine, neck, head and arms.
    pub upper: T,
    /// Pelvis, legs and root motion.
    pub lower: T,
}

impl<T> PerPart<T> {
    /// Builds a value for every part.
    pub fn from_fn(mut f: impl FnMut(Part) -> T) -> Self {
        Self { face: f(Part::Face), hands: f(Part::Hands), upper: f(Part::Upper), lower: f(Part::Lower) }
    }

    /// Builds a value for every part, or returns the first error.
    ///
    /// # Errors
    /// As returned by `f`.
    pub fn try_from_fn<E>(mut f: impl FnMut(Part) -> Result<T, E>) -> Result<Self, E> {
        Ok(Self { face: f(Part::Face)?, hands: f(Part::Hands)?, upper: f(Part::Upper)?, lower: f(Part::Lower)? })
    }
}

impl<T> Index<Part> for PerPart<T> {
    type Output = T;

    fn index(&self, part: Part) -> &T {
        match part {
            Part::Face => &self.face,
            Part::Hands => &self.hands,
            Part::Upper => &self.upper,
            Part::Lower => &self.lower,
        }
    }
}

impl<T> IndexMut<Part> for PerPart<T> {
    fn index_mut(&mut self, part: Part) -> &mut T {
        match part {
            Part::Face => &mut self.face,
            Part::Hands => &mut self.hands,
            Part::Upper => &mut self.upper,
            Part::Lower => &mut self.lower,
        }
    }
}
