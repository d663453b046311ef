//! The lids: rings on the eyeball that open and close by turning about its centre.

use super::eye::RADIUS;
use crate::vector::{V, blend};

/// A direction from the eye's centre, degrees to the temple and up.
#[derive(Clone, Copy, Debug)]
pub(super) struct Turn {
    pub(super) turn: f32,
    pub(super) rise: f32,
}

/// A vertex of a lid.
#[derive(Clone, Copy, Debug)]
pub(super) struct Point {
    /// From the opening, 0, outwards.
    pub(super) ring: usize,
    pub(super) upper: bool,
    pub(super) rest: Turn,
    /// How high the two lids' edges are at this vertex's place along them, degrees: upper, lower.
    edges: [f32; 2],
    /// From the eye's centre, metres.
    pub(super) radius: f32,
    /// On the face, and how much the vertex is drawn to there.
    pub(super) target: V,
    pub(super) share: f32,
}

/// Half the opening's width, its height over and under the line between the corners, degrees.
const WIDE: f32 = 55.0;
const HIGH: f32 = 17.5;
const LOW: f32 = 20.0;
/// The outer corner is this much higher than the inner one.
const SLANT: f32 = 6.0;
/// The opening's middle is towards the temple.
const ASIDE: f32 = 4.0;
/// Of each ring: beyond the opening in width and height, degrees; over the eyeball, metres; share
/// of the face; how much of the edge's turn it takes part in.
const RINGS: [(f32, f32, f32, f32, f32); 7] = [
    (-1.0, -2.0, 0.0003, 0.0, 1.0),
    (0.0, 0.0, 0.0016, 0.0, 1.0),
    (4.0, 4.5, 0.0023, 0.0, 0.95),
    (11.0, 12.0, 0.0029, 0.06, 0.78),
    (19.0, 21.0, 0.0022, 0.45, 0.45),
    (30.0, 32.0, 0.0020, 0.80, 0.15),
    (42.0, 44.0, 0.0020, 1.0, 0.0),
];
/// Closed lids meet at this share of the way up.
const MEET: f32 = 0.14;

/// A place along the lids' edges.
pub(super) struct Lid {
    pub(super) upper: bool,
    sin: f32,
    cos: f32,
}

impl Lid {
    /// At an angle round the opening: 0 at the temple, then over the upper lid to the nose.
    pub(super) fn at(angle: f32) -> Self {
        let (sin, cos) = angle.sin_cos();
        Self { upper: sin > -1e-4, sin, cos }
    }

    /// Degrees up of the edge that is `beyond` degrees larger than the opening.
    fn rise(&self, upper: bool, beyond: f32) -> f32 {
        let size = self.sin.abs();
        // A fuller curve above, where the highest place is nearer to the nose.
        let lean = if upper { 1.0 - 0.10 * self.cos } else { 1.0 + 0.10 * self.cos };
        let high = if upper { HIGH * lean + beyond } else { -(LOW * lean + beyond) };
        high * size.powf(1.12) + 0.5 * SLANT * self.cos
    }

    pub(super) fn point(&self, ring: usize, target: V) -> Point {
        let (wider, higher, over, share, _) = RINGS[ring];
        let edges = [self.rise(true, 0.0), self.rise(false, 0.0)];
        let turn = ASIDE + (WIDE + wider) * self.cos;
        let rest = Turn { turn, rise: self.rise(self.upper, higher) };
        Point { ring, upper: self.upper, rest, edges, radius: RADIUS + over, target, share }
    }
}

/// How a shape turns the lids.
#[derive(Clone, Copy, Default)]
pub(super) struct Motion {
    /// Share of the way to closed lids.
    pub(super) close: f32,
    /// Degrees up of the upper and the lower edge in their middle.
    pub(super) upper: f32,
    pub(super) lower: f32,
    /// Degrees to the temple.
    pub(super) aside: f32,
}

impl Point {
    /// Where the vertex goes.
    pub(super) fn turned(&self, motion: Motion) -> Turn {
        let [up, low] = self.edges;
        let (own, lift) = if self.upper { (up, motion.upper) } else { (low, motion.lower) };
        // At the corners the edges meet already.
        let open = ((up - low) / (HIGH + LOW)).clamp(0.0, 1.0);
        let edge = motion.close * (blend(low, up, MEET) - own) + lift * open;
        let part = RINGS[self.ring].4;
        Turn { turn: self.rest.turn + motion.aside * open * part, rise: self.rest.rise + edge * part }
    }
}
