//! The lids: rings on the eyeball that open and close by rotation about its centre.

use crate::vector::{V, blend};

/// A direction from the eye's centre, in degrees towards the temple and up.
#[derive(Clone, Copy, Debug)]
pub(super) struct Turn {
    pub(super) turn: f32,
    pub(super) rise: f32,
}

/// A vertex of a lid.
#[derive(Clone, Copy, Debug)]
pub(super) struct Point {
    /// Index of the ring: 0 at the opening, increasing outwards.
    pub(super) ring: usize,
    pub(super) upper: bool,
    pub(super) rest: Turn,
    /// Heights of the edges of both lids at this vertex's position along them, in degrees: upper, lower.
    edges: [f32; 2],
    /// Distance from the eye's centre, in metres.
    pub(super) radius: f32,
    /// Position on the face, and weight with which the vertex is drawn towards it.
    pub(super) target: V,
    pub(super) share: f32,
}

/// Radius of the eyeball in metres.
pub(super) const RADIUS: f32 = 0.0180;
/// Half width of the opening, and its height above and below the line between the corners, in degrees.
const WIDE: f32 = 55.0;
const HIGH: f32 = 17.5;
const LOW: f32 = 20.0;
/// Height of the outer corner relative to the inner one, in degrees.
const SLANT: f32 = 6.0;
/// Offset of the opening's middle towards the temple, in degrees.
const ASIDE: f32 = 4.0;
/// For each ring: excess over the opening in width and height, degrees; distance from the eyeball, metres; weight of
/// the face; share of the edge's rotation.
const RINGS: [(f32, f32, f32, f32, f32); 7] = [
    (-1.0, -2.0, 0.0003, 0.0, 1.0),
    (0.0, 0.0, 0.0016, 0.0, 1.0),
    (4.0, 4.5, 0.0023, 0.0, 0.95),
    (11.0, 12.0, 0.0029, 0.06, 0.78),
    (19.0, 21.0, 0.0022, 0.45, 0.45),
    (30.0, 32.0, 0.0020, 0.80, 0.15),
    (42.0, 44.0, 0.0020, 1.0, 0.0),
];
/// Height at which closed lids meet, as a share of the opening.
const MEET: f32 = 0.14;

/// A position along the lids' edges.
pub(super) struct Lid {
    pub(super) upper: bool,
    sin: f32,
    cos: f32,
}

impl Lid {
    /// Position at an angle around the opening: 0 at the temple, then over the upper lid to the nose.
    pub(super) fn at(angle: f32) -> Self {
        let (sin, cos) = angle.sin_cos();
        Self { upper: sin > -1e-4, sin, cos }
    }

    /// Height in degrees of an edge that exceeds the opening by `beyond` degrees.
    fn rise(&self, upper: bool, beyond: f32) -> f32 {
        let size = self.sin.abs();
        // The upper curve is fuller, and its highest point is nearer to the nose.
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

/// Rotation of the lids by a shape.
#[derive(Clone, Copy, Default)]
pub(super) struct Motion {
    /// Progress towards closed lids, 0 to 1.
    pub(super) close: f32,
    /// Lift of the upper and the lower edge at their middle, in degrees.
    pub(super) upper: f32,
    pub(super) lower: f32,
    /// Degrees towards the temple.
    pub(super) aside: f32,
}

impl Point {
    /// Direction of the vertex after the motion.
    pub(super) fn turned(&self, motion: Motion) -> Turn {
        let [up, low] = self.edges;
        let (own, lift) = if self.upper { (up, motion.upper) } else { (low, motion.lower) };
        // At the corners the edges already meet.
        let open = ((up - low) / (HIGH + LOW)).clamp(0.0, 1.0);
        let edge = motion.close * (blend(low, up, MEET) - own) + lift * open;
        let part = RINGS[self.ring].4;
        Turn { turn: self.rest.turn + motion.aside * open * part, rise: self.rest.rise + edge * part }
    }
}
