//! The head without eyes, mouth, ears and hair: a solid, and a map of its skin.
//!
//! Coordinates here and in the other modules of the head are metres of a head of size 1, relative to the midpoint of
//! the eyes.

use crate::field::Join::{Cut, Union};
use crate::field::{Shape, Solid, occlusion};
use crate::look::{Color, Face, Look};
use crate::vector::{V, add, curve, hypot, ramp, scale, unit};

/// Depth of the vertical line at which the rays that find the skin start.
const AXIS: f32 = -0.060;
/// Scale of the map: metres per radian about that line.
const ROUND: f32 = 0.075;

pub(super) struct Base {
    pub(super) look: &'static Look,
    solid: Solid,
    /// Start of a ray on the line, and its steepness, by its height in the map.
    start: Vec<(f32, f32)>,
    steep: Vec<(f32, f32)>,
}

impl Base {
    /// `neck` is the neck joint.
    pub(super) fn new(neck: V, look: &'static Look) -> Self {
        let face = &look.build.face;
        let (jaw, nose, n) = (face.jaw, face.nose, look.build.neck);
        let solid = Solid::default()
            .with(Shape::Ellipsoid { centre: [0.0, 0.020, -0.068], radii: [0.0725, 0.090, 0.089] }, Union(0.0))
            .with(
                Shape::Ellipsoid { centre: [0.0, -0.038, -0.036], radii: [0.0470 * jaw, 0.066, 0.0525] },
                Union(0.026),
            )
            .with(
                Shape::cone([0.0, -0.055, -0.080], add(neck, [0.0, -0.05, 0.0]), 0.0395 * n, 0.0480 * n),
                Union(0.026),
            )
            .with(Shape::cone([0.0, -0.045, -0.004], [0.0, -0.080, -0.006], 0.024, 0.0195 * jaw), Union(0.026))
            .with(
                Shape::Ellipsoid { centre: [0.0, -0.0915, 0.0000], radii: [0.0175 * jaw, 0.0130, 0.0155] },
                Union(0.016),
            );
        Self {
            look,
            solid: with_middle(with_sides(solid, face), nose),
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

    /// Point of the skin at a place of the map.
    pub(super) fn skin(&self, at: [f32; 2]) -> V {
        let (start, along) = self.ray(at);
        self.outermost(start, along)
    }

    /// The outermost intersection of a ray from inside with the head.
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

    /// Place of the map whose ray passes through `p`; `u` is 0 at the front and grows to the left.
    pub(super) fn map(&self, p: V) -> [f32; 2] {
        let (x, z) = (p[0], p[2] - AXIS);
        let out = hypot(x, z);
        let (mut low, mut high) = (-0.24, 0.12);
        for _ in 0..32 {
            let v = 0.5 * (low + high);
            let y = curve(&self.start, v) + out * curve(&self.steep, v).tan();
            if y < p[1] { low = v } else { high = v }
        }
        [x.atan2(z) * ROUND, 0.5 * (low + high)]
    }

    /// Point of the skin near `p`.
    pub(super) fn onto(&self, p: V) -> V {
        self.skin(self.map(p))
    }

    /// Point of the skin directly behind a place of the face, seen from the front.
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

    /// Outward normal.
    pub(super) fn normal(&self, p: V) -> V {
        unit(self.solid.gradient(p))
    }

    /// Ambient occlusion of the skin at `p`, 0..=1.
    pub(super) fn shade(&self, p: V) -> f32 {
        occlusion(&[&self.solid], p, self.normal(p), 0.026)
    }

    /// Distance between vertices at a place of the map.
    pub(super) fn spacing([u, v]: [f32; 2]) -> f32 {
        let nose = ramp(0.030, 0.016, u) * ramp(-0.062, -0.052, v) * ramp(0.0, -0.014, v);
        let face = ramp(0.105, 0.070, u) * ramp(-0.15, -0.125, v) * ramp(0.055, 0.040, v);
        let wing = ramp(0.030, 0.022, u) * ramp(-0.058, -0.053, v) * ramp(-0.026, -0.034, v);
        let throat = ramp(0.090, 0.060, u) * ramp(-0.165, -0.150, v) * ramp(-0.095, -0.110, v) * (1.0 - face);
        0.0135 - 0.0084 * face - 0.0026 * nose - 0.0007 * wing - 0.0055 * throat
    }

    /// Bounds of the map: half circumference, bottom and top.
    pub(super) const BOUNDS: (f32, f32, f32) = (std::f32::consts::PI * ROUND, -0.192, 0.085);
}

/// Adds jaw, cheekbones, brow ridges and sockets.
fn with_sides(mut solid: Solid, face: &Face) -> Solid {
    for x in [1.0, -1.0] {
        let over = |p: V| [p[0] * x, p[1], p[2]];
        solid = solid
            // Jaw, cheekbone, brow ridge, socket.
            .with(
                Shape::cone(over([0.0420 * face.jaw, -0.060, -0.052]), over([0.010, -0.0925, -0.007]), 0.0110, 0.0125),
                Union(0.024),
            )
            .with(Shape::ball(over([0.0405 * face.jaw, -0.046, -0.0460]), 0.0140), Union(0.026))
            .with(
                Shape::cone(over([0.0300, -0.0300, -0.0060]), over([0.0480, -0.0225, -0.0330]), 0.0180, 0.0150),
                Union(0.028),
            )
            .with(Shape::ball(over([0.0270, -0.051, -0.0090]), 0.0190), Union(0.026))
            .with(
                Shape::cone(
                    over([0.010, 0.0195, 0.0038 + face.brow]),
                    over([0.042, 0.0215, -0.0130 + face.brow]),
                    0.0125,
                    0.0115,
                ),
                Union(0.018),
            )
            .with(
                Shape::Ellipsoid { centre: over([0.0335, 0.000, 0.0145]), radii: [0.0190, 0.0118, 0.0095] },
                Cut(0.015),
            );
    }
    solid
}

/// Adds nose, teeth and grooves.
fn with_middle(mut solid: Solid, nose: f32) -> Solid {
    solid = solid
        .with(Shape::cone([0.0, 0.014, 0.0068], [0.0, -0.030, 0.0275], 0.0058 * nose, 0.0086 * nose), Union(0.010))
        .with(Shape::ball([0.0, -0.0365, 0.0300], 0.0100 * nose), Union(0.006))
        .with(Shape::cone([0.0, -0.0440, 0.0270], [0.0, -0.0480, 0.0200], 0.0036, 0.0040), Union(0.005));
    for x in [1.0, -1.0] {
        solid = solid.with(
            Shape::Ellipsoid { centre: [0.0128 * x * nose, -0.0405, 0.0205], radii: [0.0060, 0.0066, 0.0080] },
            Union(0.0078),
        );
    }
    // Bulge of the teeth behind the lips.
    solid =
        solid.with(Shape::Ellipsoid { centre: [0.0, -0.0660, 0.0020], radii: [0.0260, 0.0200, 0.0190] }, Union(0.014));
    // Groove under the nose, and groove between lip and chin.
    solid = solid
        .with(Shape::cone([0.0, -0.0515, 0.0275], [0.0, -0.0590, 0.0278], 0.0022, 0.0030), Cut(0.005))
        .with(Shape::Ellipsoid { centre: [0.0, -0.0840, 0.0230], radii: [0.0150, 0.0040, 0.0032] }, Cut(0.010));
    solid
}

/// Colour of the skin: slightly red on cheeks and nose, darker where it is occluded.
pub(super) fn skin_color(base: &Base, p: V) -> Color {
    let spot =
        |x: f32, y: f32, wide: f32, tall: f32| (-((p[0].abs() - x) / wide).powi(2) - ((p[1] - y) / tall).powi(2)).exp();
    let ahead = ramp(-0.03, 0.0, p[2]);
    let red = 0.34 * spot(0.042, -0.034, 0.020, 0.014)
        + 0.34 * spot(0.0, -0.037, 0.011, 0.009)
        + 0.12 * spot(0.0, -0.103, 0.014, 0.010)
        + 0.25 * spot(0.030, 0.010, 0.018, 0.006);
    // The nose's underside is too steep for smooth shading.
    let nose = 1.0 - 0.75 * (spot(0.0, -0.045, 0.014, 0.007) + spot(0.0135, -0.041, 0.007, 0.009)).min(1.0) * ahead;
    base.look.skin.toned(red * ahead, 0.55 * base.shade(p) * nose * ramp(-0.125, -0.105, p[1]))
}
