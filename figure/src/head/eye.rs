//! Lids and eyeball of the left eye.

use super::base::Base;
use super::lids::{Lid, Point, Turn};
use super::sheet::Sheet;
use super::{Kind, mouth};
use crate::vector::{V, add, mix, scale};
use std::f32::consts::TAU;

/// The left eye.
pub(super) struct Eye {
    pub(super) centre: V,
}

/// Of the eyeball, metres.
pub(super) const RADIUS: f32 = 0.0170;
/// Vertices round the opening: a multiple of four.
const AROUND: usize = 36;
/// Rings of the lids, from the opening outwards.
pub(super) const RINGS: usize = 7;
/// Half width and half height of where the outer rings lie on the face, to the nose, to the temple,
/// up, down; metres.
const OUTER: [[f32; 4]; 4] = [
    [0.0168, 0.0188, 0.0140, 0.0134],
    [0.0182, 0.0216, 0.0168, 0.0162],
    [0.0198, 0.0250, 0.0204, 0.0202],
    [0.0220, 0.0290, 0.0244, 0.0250],
];

const LASHES: [u8; 3] = [58, 38, 32];
const WATERLINE: [u8; 3] = [206, 140, 124];
const WHITE: [u8; 3] = [244, 242, 238];
const WHITE_EDGE: [u8; 3] = [222, 214, 210];
const IRIS_RIM: [u8; 3] = [46, 58, 66];
const IRIS: [u8; 3] = [84, 122, 132];
const IRIS_INNER: [u8; 3] = [128, 160, 160];
const PUPIL: [u8; 3] = [18, 18, 22];
const GLINT: [u8; 3] = [255, 255, 255];

/// From the eye's centre, `turn` degrees to the temple and `rise` up.
pub(super) fn direction(Turn { turn, rise }: Turn) -> V {
    let (turn, rise) = (turn.to_radians(), rise.to_radians());
    [turn.sin() * rise.cos(), rise.sin(), turn.cos() * rise.cos()]
}

impl Eye {
    pub(super) fn new(centre: V) -> Self {
        Self { centre }
    }

    /// Where a lid's vertex is when its place on the eyeball is `turn` instead of its own.
    pub(super) fn lid_place(&self, point: &Point, turn: Turn) -> V {
        let on_ball = add(self.centre, scale(direction(turn), point.radius));
        mix(on_ball, point.target, point.share)
    }
}

/// The lids' rings; the outermost ring's vertices.
pub(super) fn add_lids(sheet: &mut Sheet, base: &Base, eye: &Eye) -> Vec<usize> {
    let mut inner: Vec<usize> = Vec::new();
    for ring in 0..RINGS {
        let loop_: Vec<usize> = (0..AROUND)
            .map(|k| {
                let angle = TAU * k as f32 / AROUND as f32;
                let lid = Lid::at(angle);
                let point = lid.point(ring, target(base, eye, ring, angle));
                let place = eye.lid_place(&point, point.rest);
                let color = match (ring, lid.upper) {
                    (0 | 1, true) => LASHES,
                    (0, false) => WATERLINE,
                    (1, false) => mix_color(mouth::skin_color(place), WATERLINE, 0.45),
                    (2, true) => mix_color(mouth::skin_color(place), LASHES, 0.22),
                    _ => mouth::skin_color(place),
                };
                sheet.add(place, Kind::Lid(point), color)
            })
            .collect();
        if ring > 0 {
            let closed = |ring: &[usize]| -> Vec<usize> { ring.iter().copied().chain([ring[0]]).collect() };
            sheet.strip(&closed(&loop_), &closed(&inner));
        }
        inner = loop_;
    }
    inner
}

/// Where an outer ring lies on the face.
fn target(base: &Base, eye: &Eye, ring: usize, angle: f32) -> V {
    let Some(&[nose, temple, up, down]) = ring.checked_sub(3).and_then(|outer| OUTER.get(outer)) else {
        return eye.centre;
    };
    let (sin, cos) = angle.sin_cos();
    let x = eye.centre[0] + cos * if cos > 0.0 { temple } else { nose };
    let y = eye.centre[1] + sin * if sin > 0.0 { up } else { down };
    base.behind(x, y)
}

pub(super) fn mix_color(a: [u8; 3], b: [u8; 3], t: f32) -> [u8; 3] {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between two bytes")]
    std::array::from_fn(|i| (f32::from(a[i]) * (1.0 - t) + f32::from(b[i]) * t).round() as u8)
}

/// Rings of the eyeball from the pupil back: degrees from ahead, and the colour up to there and
/// from there on.
const BALL: [(f32, [u8; 3], Option<[u8; 3]>); 12] = [
    (6.0, PUPIL, None),
    (11.0, PUPIL, Some(IRIS_INNER)),
    (15.0, IRIS, None),
    (21.0, IRIS, None),
    (25.0, IRIS_RIM, None),
    (27.0, IRIS_RIM, Some(WHITE_EDGE)),
    (32.0, WHITE, None),
    (44.0, WHITE, None),
    (58.0, WHITE, None),
    (74.0, WHITE_EDGE, None),
    (92.0, WHITE_EDGE, None),
    (115.0, WHITE_EDGE, None),
];
const SPOKES: usize = 28;
/// The light in the eye: degrees to the temple and up, and its size.
const SPARK: (Turn, f32) = (Turn { turn: 0.0, rise: 13.0 }, 3.6);

pub(super) fn add_eyeball(sheet: &mut Sheet, eye: &Eye) {
    let at = |off: f32, spoke: usize, radius: f32| {
        let (sin, cos) = (TAU * spoke as f32 / SPOKES as f32).sin_cos();
        let (out, ahead) = off.to_radians().sin_cos();
        add(eye.centre, scale([out * cos, out * sin, ahead], radius))
    };
    let middle = sheet.add(at(0.0, 0, RADIUS), Kind::Eyeball, PUPIL);
    let mut inner = vec![middle; SPOKES + 1];
    for (off, color, beyond) in BALL {
        let mut ring: Vec<usize> = (0..SPOKES).map(|k| sheet.add(at(off, k, RADIUS), Kind::Eyeball, color)).collect();
        ring.push(ring[0]);
        sheet.strip(&ring, &inner);
        inner = match beyond {
            None => ring,
            Some(color) => {
                let mut again: Vec<usize> = ring[..SPOKES].iter().map(|&v| sheet.recolored(v, color)).collect();
                again.push(again[0]);
                again
            }
        };
    }
    add_spark(sheet, eye);
}

fn add_spark(sheet: &mut Sheet, eye: &Eye) {
    let place = |x: f32, y: f32| {
        let (centre, size) = SPARK;
        let turn = Turn { turn: centre.turn + size * x, rise: centre.rise + size * y };
        add(eye.centre, scale(direction(turn), RADIUS + 0.0002))
    };
    let middle = sheet.add(place(0.0, 0.0), Kind::Eyeball, GLINT);
    let ring: Vec<usize> = (0..12)
        .map(|k| {
            let (sin, cos) = (TAU * k as f32 / 12.0).sin_cos();
            sheet.add(place(cos, sin), Kind::Eyeball, GLINT)
        })
        .collect();
    for k in 0..12 {
        sheet.triangles.push([middle, ring[k], ring[(k + 1) % 12]]);
    }
}
