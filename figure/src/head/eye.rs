//! Lids and eyeball of the left eye.

use super::Kind;
use super::base::{Base, skin_color};
use super::lids::{Lid, Point, RADIUS, Turn};
use super::sheet::Sheet;
use crate::look::{Color, Look, mix_color};
use crate::vector::{V, add, cross, mix, ramp, scale, sub, unit};
use std::f32::consts::TAU;

/// The left eye.
pub(super) struct Eye {
    pub(super) centre: V,
    look: &'static Look,
}

/// Vertices around the opening; a multiple of four.
const AROUND: usize = 36;
/// Rings of the lids, from the opening outwards.
pub(super) const RINGS: usize = 7;
/// Extents of the outer rings on the face, in metres: towards the nose, towards the temple, up, down.
const OUTER: [[f32; 4]; 4] = [
    [0.0168, 0.0188, 0.0140, 0.0134],
    [0.0182, 0.0216, 0.0168, 0.0162],
    [0.0198, 0.0250, 0.0204, 0.0202],
    [0.0220, 0.0290, 0.0244, 0.0250],
];

const WHITE: [u8; 3] = [228, 224, 220];
const WHITE_EDGE: [u8; 3] = [206, 196, 191];
const WHITE_SHADED: [u8; 3] = [128, 112, 110];
const PUPIL: [u8; 3] = [18, 18, 22];
const GLINT: [u8; 3] = [255, 255, 255];

/// Direction from the eye's centre, `turn` degrees towards the temple and `rise` up.
pub(super) fn direction(Turn { turn, rise }: Turn) -> V {
    let (turn, rise) = (turn.to_radians(), rise.to_radians());
    [turn.sin() * rise.cos(), rise.sin(), turn.cos() * rise.cos()]
}

impl Eye {
    pub(super) fn new(centre: V, look: &'static Look) -> Self {
        Self { centre, look }
    }

    /// Position of a lid's vertex if its direction from the eyeball's centre is `turn`.
    pub(super) fn lid_place(&self, point: &Point, turn: Turn) -> V {
        let on_ball = add(self.centre, scale(direction(turn), point.radius));
        mix(on_ball, point.target, point.share)
    }
}

/// Adds the lids' rings, and returns the vertices of the outermost ring.
pub(super) fn add_lids(sheet: &mut Sheet, base: &Base, eye: &Eye) -> Vec<usize> {
    let mut inner: Vec<usize> = Vec::new();
    for ring in 0..RINGS {
        let loop_: Vec<usize> = (0..AROUND)
            .map(|k| {
                let angle = TAU * k as f32 / AROUND as f32;
                let lid = Lid::at(angle);
                let point = lid.point(ring, target(base, eye, ring, angle));
                let place = eye.lid_place(&point, point.rest);
                let skin = &base.look.skin;
                let color = match (ring, lid.upper) {
                    (0 | 1, true) => skin.toned(0.2, 1.15),
                    (0, false) => skin.toned(0.6, 0.20),
                    (1, false) => skin.toned(0.45, 0.34),
                    (2, true) => skin.toned(0.5, 0.42),
                    (3, true) => skin.toned(0.35, 0.20),
                    (2, false) => skin.toned(0.4, 0.16),
                    _ => skin_color(base, place),
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

/// Lashes of each lid: upper or lower, number, and length relative to the longest.
const LASHES: [(bool, usize, f32); 2] = [(true, 30, 1.0), (false, 15, 0.30)];

/// Adds single lashes along the edges of the lids, longer towards the temple.
pub(super) fn add_lashes(sheet: &mut Sheet, eye: &Eye) {
    let face = &eye.look.build.face;
    let dark = mix_color(eye.look.strands[0], PUPIL, 0.55);
    for (upper, count, share) in LASHES {
        // The lower lashes are finer than a triangle can be, so they are paler.
        let color = if upper { dark } else { mix_color(eye.look.skin.toned(0.3, 0.5), dark, 0.45) };
        for k in 0..count {
            let t = (k as f32 + 0.6) / count as f32;
            let angle = if upper { 0.06 + (TAU / 2.0 - 0.42) * t } else { -0.10 - (TAU / 2.0 - 0.9) * t };
            let edge = |off: f32| Lid::at(angle + off).point(1, eye.centre);
            // Fanned out from the middle of the eye.
            let out = (angle.cos() * 16.0 + 1.0, if upper { 15.0 } else { -11.0 });
            let long = share * face.lashes * (0.62 + 0.38 * angle.cos()) * (0.85 + 0.15 * ((k * 7 % 5) as f32 / 4.0));
            let half = if upper { 0.036 } else { 0.022 };
            let mut points = [edge(-half), edge(half), edge(0.0), edge(0.0)];
            points[2].radius += 0.0007;
            let tip = &mut points[3];
            tip.radius += 0.80 * long;
            tip.rest = Turn { turn: tip.rest.turn + out.0 * long / 0.006, rise: tip.rest.rise + out.1 * long / 0.006 };
            let at = points.map(|point| sheet.add(eye.lid_place(&point, point.rest), Kind::Lid(point), color));
            spike(sheet, at);
        }
    }
}

/// Adds a hair: a triangle and its tip, which is the last vertex.
pub(super) fn spike(sheet: &mut Sheet, [a, b, c, tip]: [usize; 4]) {
    let at = |i: usize| sheet.vertices[i].place;
    let facing = cross(sub(at(b), at(a)), sub(at(c), at(a)));
    let away = unit(sub(at(tip), at(a)));
    let outside = facing.iter().zip(away).map(|(f, w)| f * w).sum::<f32>() < 0.0;
    for [p, q] in [[a, b], [b, c], [c, a]] {
        sheet.triangles.push(if outside { [q, p, tip] } else { [p, q, tip] });
    }
}

/// Position of an outer ring on the face.
fn target(base: &Base, eye: &Eye, ring: usize, angle: f32) -> V {
    let Some(&[nose, temple, up, down]) = ring.checked_sub(3).and_then(|outer| OUTER.get(outer)) else {
        return eye.centre;
    };
    let (sin, cos) = angle.sin_cos();
    let x = eye.centre[0] + cos * if cos > 0.0 { temple } else { nose };
    let y = eye.centre[1] + sin * if sin > 0.0 { up } else { down };
    base.behind(x, y)
}

/// Rings of the eyeball from the pupil backwards: degrees from the front, the colour up to the ring, and the colour
/// from there on if it differs.
fn ball(look: &Look) -> [(f32, Color, Option<Color>); 12] {
    let [iris, inner] = look.iris;
    let rim = mix_color(iris, PUPIL, 0.55);
    [
        (6.0, PUPIL, None),
        (11.0, PUPIL, Some(inner)),
        (15.5, mix_color(iris, inner, 0.6), None),
        (21.0, iris, None),
        (25.0, rim, None),
        (27.0, rim, Some(WHITE_EDGE)),
        (32.0, WHITE, None),
        (44.0, WHITE, None),
        (58.0, WHITE, None),
        (74.0, WHITE_EDGE, None),
        (92.0, WHITE_EDGE, None),
        (115.0, WHITE_EDGE, None),
    ]
}
const SPOKES: usize = 28;
/// Darkness of the eyeball under the upper lid.
const SHADED: f32 = 0.70;
/// Highlight in the eye: degrees towards the temple and up, and its size.
const SPARK: (Turn, f32) = (Turn { turn: 0.0, rise: 10.0 }, 3.4);

pub(super) fn add_eyeball(sheet: &mut Sheet, eye: &Eye) {
    let at = |off: f32, spoke: usize, radius: f32| {
        let (sin, cos) = (TAU * spoke as f32 / SPOKES as f32).sin_cos();
        let (out, ahead) = off.to_radians().sin_cos();
        add(eye.centre, scale([out * cos, out * sin, ahead], radius))
    };
    let middle = sheet.add(at(0.0, 0, RADIUS), Kind::Eyeball, PUPIL);
    let mut inner = vec![middle; SPOKES + 1];
    for (off, color, beyond) in ball(eye.look) {
        // The upper lid shades the eyeball below it.
        let shaded = |k: usize, color: Color| {
            let dark = SHADED * ramp(2.0, 17.0, off * (TAU * k as f32 / SPOKES as f32).sin());
            mix_color(color, if color == WHITE || color == WHITE_EDGE { WHITE_SHADED } else { PUPIL }, dark)
        };
        let mut ring: Vec<usize> =
            (0..SPOKES).map(|k| sheet.add(at(off, k, RADIUS), Kind::Eyeball, shaded(k, color))).collect();
        ring.push(ring[0]);
        sheet.strip(&ring, &inner);
        inner = match beyond {
            None => ring,
            Some(color) => {
                let mut again: Vec<usize> = (0..SPOKES).map(|k| sheet.recolored(ring[k], shaded(k, color))).collect();
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
