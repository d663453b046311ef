//! The head without eyes, mouth, ears and hair: a solid, and a map of its skin.
//!
//! Here and in the other modules of the head: metres of a head of size 1, from the middle between
//! the eyes.

use crate::field::Join::{Cut, Union};
use crate::field::{Shape, Solid};
use crate::vector::{V, add, curve, ramp, scale};

/// The rays that find the skin start on an upright line at this depth.
const AXIS: f32 = -0.060;
/// Of the map, metres for a radian about that line.
const ROUND: f32 = 0.075;

pub(super) struct Base {
    solid: Solid,
    /// Where a ray starts on the line, and how steep it is, by its height in the map.
    start: Vec<(f32, f32)>,
    steep: Vec<(f32, f32)>,
}

impl Base {
    /// `neck`: the neck joint.
    pub(super) fn new(neck: V) -> Self {
        let mut solid = Solid::default()
            .with(Shape::Ellipsoid { centre: [0.0, 0.020, -0.068], radii: [0.0725, 0.090, 0.089] }, Union(0.0))
            .with(Shape::Ellipsoid { centre: [0.0, -0.040, -0.036], radii: [0.050, 0.070, 0.053] }, Union(0.03))
            .with(Shape::cone([0.0, -0.055, -0.080], add(neck, [0.0, -0.05, 0.0]), 0.042, 0.050), Union(0.028))
            .with(Shape::cone([0.0, -0.045, -0.004], [0.0, -0.088, -0.007], 0.024, 0.021), Union(0.03))
            .with(Shape::ball([0.0, -0.099, -0.003], 0.0165), Union(0.02));
        for x in [1.0, -1.0] {
            let over = |p: V| [p[0] * x, p[1], p[2]];
            solid = solid
                .with(
                    Shape::cone(over([0.036, -0.066, -0.052]), over([0.010, -0.096, -0.008]), 0.014, 0.015),
                    Union(0.03),
                )
                .with(Shape::ball(over([0.034, -0.032, -0.016]), 0.025), Union(0.03))
                .with(
                    Shape::cone(over([0.010, 0.021, 0.003]), over([0.040, 0.022, -0.016]), 0.0125, 0.011),
                    Union(0.02),
                )
                .with(
                    Shape::Ellipsoid { centre: over([0.034, -0.002, 0.014]), radii: [0.019, 0.011, 0.008] },
                    Cut(0.016),
                );
        }
        solid = solid
            .with(Shape::cone([0.0, 0.012, 0.008], [0.0, -0.034, 0.0235], 0.0075, 0.0100), Union(0.014))
            .with(Shape::ball([0.0, -0.037, 0.0265], 0.0092), Union(0.006));
        for x in [1.0, -1.0] {
            solid = solid.with(Shape::ball([0.0112 * x, -0.0400, 0.0170], 0.0072), Union(0.007));
        }
        Self {
            solid,
            start: vec![
                (-0.24, -0.235),
                (-0.19, -0.185),
                (-0.15, -0.125),
                (-0.125, -0.085),
                (-0.105, -0.075),
                (-0.085, -0.080),
                (-0.064, -0.079),
                (-0.03, -0.055),
                (0.0, -0.022),
                (0.03, 0.0),
                (0.06, 0.012),
                (0.12, 0.03),
            ],
            steep: vec![
                (-0.24, -0.10),
                (-0.19, -0.15),
                (-0.15, -0.45),
                (-0.125, -0.72),
                (-0.105, -0.42),
                (-0.085, -0.08),
                (-0.064, 0.16),
                (-0.03, 0.28),
                (0.0, 0.26),
                (0.03, 0.36),
                (0.06, 0.62),
                (0.12, 1.40),
            ],
        }
    }

    fn ray(&self, [u, v]: [f32; 2]) -> (V, V) {
        let (turn, rise) = (u / ROUND, curve(&self.steep, v));
        let (sin, cos) = turn.sin_cos();
        ([0.0, curve(&self.start, v), AXIS], [sin * rise.cos(), rise.sin(), cos * rise.cos()])
    }

    /// The skin at a place of the map.
    pub(super) fn skin(&self, at: [f32; 2]) -> V {
        let (start, along) = self.ray(at);
        self.outermost(start, along)
    }

    /// Where a ray from inside leaves the head for the last time.
    pub(super) fn outermost(&self, start: V, along: V) -> V {
        let at = |t: f32| add(start, scale(along, t));
        let mut far = 0.19;
        for _ in 0..60 {
            let field = self.solid.at(at(far));
            if field < 1e-5 {
                break;
            }
            far -= 0.7 * field;
        }
        at(far)
    }

    /// The place of the map whose ray passes through `p`; `u` is 0 ahead and grows to the left.
    pub(super) fn map(&self, p: V) -> [f32; 2] {
        let (x, z) = (p[0], p[2] - AXIS);
        let out = x.hypot(z);
        let (mut low, mut high) = (-0.24, 0.12);
        for _ in 0..32 {
            let v = 0.5 * (low + high);
            let y = curve(&self.start, v) + out * curve(&self.steep, v).tan();
            if y < p[1] { low = v } else { high = v }
        }
        [x.atan2(z) * ROUND, 0.5 * (low + high)]
    }

    /// The skin near `p`.
    pub(super) fn onto(&self, p: V) -> V {
        self.skin(self.map(p))
    }

    /// The skin straight behind a place of the face seen from the front.
    pub(super) fn behind(&self, x: f32, y: f32) -> V {
        let at = |z: f32| [x, y, z];
        let mut z = 0.06;
        for _ in 0..60 {
            let field = self.solid.at(at(z));
            if field < 1e-5 {
                break;
            }
            z -= 0.7 * field;
        }
        at(z)
    }

    /// How far apart vertices are at a place of the map.
    pub(super) fn spacing([u, v]: [f32; 2]) -> f32 {
        let nose = ramp(0.030, 0.016, u) * ramp(-0.062, -0.052, v) * ramp(0.0, -0.014, v);
        let face = ramp(0.105, 0.070, u) * ramp(-0.15, -0.125, v) * ramp(0.055, 0.040, v);
        0.0135 - 0.0078 * face - 0.0026 * nose
    }

    /// The end of the map about the head, its bottom and its top.
    pub(super) const BOUNDS: (f32, f32, f32) = (std::f32::consts::PI * ROUND, -0.215, 0.085);
}
