//! Lips, the mouth behind them, teeth and tongue.

use super::Kind;
use super::base::{Base, skin_color};
use super::lips::{Point, WIDE, line};
use super::sheet::Sheet;
use crate::look::{Color, Look, mix_color};
use crate::vector::{V, ramp};
use std::f32::consts::{FRAC_PI_2, PI};

/// Number of steps from the middle of the lips to their corner.
const STEPS: usize = 13;
const CAVITY: [u8; 3] = [92, 34, 38];
const DEEP: [u8; 3] = [38, 14, 18];
const TEETH: [u8; 3] = [246, 242, 232];
const GUMS: [u8; 3] = [196, 104, 104];
const TONGUE: [u8; 3] = [206, 110, 112];

/// Colour of a ring of the lips.
#[derive(Clone, Copy)]
enum Paint {
    Skin,
    Lip,
    LipDark,
    Cavity,
    Deep,
}

impl Paint {
    /// The colour; that of skin depends on the position and is set later.
    fn color(self, look: &Look) -> Color {
        match self {
            Self::Skin | Self::Lip => look.skin.lip,
            Self::LipDark => lip_dark(look),
            Self::Cavity => CAVITY,
            Self::Deep => DEEP,
        }
    }
}

/// Colour where the lips touch.
fn lip_dark(look: &Look) -> Color {
    mix_color(look.skin.lip, CAVITY, 0.42)
}

/// A ring of the lips: offset up from the line between the lips, forwards from the skin and, at the corner, to the
/// side; metres.
struct Ring {
    number: i8,
    up: f32,
    forward: f32,
    aside: f32,
    paint: Paint,
}

const fn ring(number: i8, up: f32, forward: f32, aside: f32, paint: Paint) -> Ring {
    Ring { number, up, forward, aside, paint }
}

const UPPER: [Ring; 6] = [
    ring(0, 0.0, 0.0006, 0.0, Paint::LipDark),
    ring(1, 0.0014, 0.0022, 0.0008, Paint::Lip),
    ring(2, 0.0034, 0.0030, 0.0018, Paint::Lip),
    ring(3, 0.0057, 0.0019, 0.0030, Paint::Lip),
    ring(4, 0.0088, 0.0011, 0.0055, Paint::Skin),
    ring(5, 0.0130, 0.0, 0.0095, Paint::Skin),
];
const LOWER: [Ring; 6] = [
    ring(0, 0.0, 0.0006, 0.0, Paint::LipDark),
    ring(1, -0.0017, 0.0026, 0.0008, Paint::Lip),
    ring(2, -0.0048, 0.0038, 0.0018, Paint::Lip),
    ring(3, -0.0080, 0.0024, 0.0030, Paint::Lip),
    ring(4, -0.0112, 0.0006, 0.0055, Paint::Skin),
    ring(5, -0.0155, 0.0, 0.0095, Paint::Skin),
];
/// Rings behind the lips: number, up, forwards, share of the width, colour.
const WITHIN: [(i8, f32, f32, f32, Paint); 5] = [
    (-1, 0.0012, -0.0035, 0.99, Paint::LipDark),
    (-2, 0.0045, -0.0070, 0.97, Paint::LipDark),
    (-3, 0.0110, -0.0085, 0.96, Paint::Cavity),
    (-4, 0.0130, -0.0280, 0.86, Paint::Cavity),
    (-5, 0.0080, -0.0480, 0.50, Paint::Deep),
];

/// Adds half of the lips and the mouth behind them. Returns the vertices of the outermost ring, from the middle above
/// to the middle below.
pub(super) fn add_lips(sheet: &mut Sheet, base: &Base) -> Vec<usize> {
    let mut inner: Vec<usize> = Vec::new();
    for (number, up, forward, wide, paint) in WITHIN.into_iter().rev() {
        let row = half_ring(sheet, base, |sheet, upper, x, t, contact| {
            let up = if upper { up } else { -1.15 * up } * (1.0 - t.powi(4));
            let place = [x * wide, contact[1] + up, contact[2] + forward - 0.004 * t * t];
            sheet.add(place, Kind::Lip(Point { upper, ring: number, contact }), paint.color(base.look))
        });
        match inner.is_empty() {
            true => close(sheet, &row),
            false => sheet.strip(&inner, &row),
        }
        inner = row;
    }
    for (above, under) in UPPER.iter().zip(&LOWER) {
        let row = half_ring(sheet, base, |sheet, upper, x, t, contact| {
            let ring = if upper { above } else { under };
            let place = lip_place(base, ring, upper, x, t, contact);
            let color = if ring.number > 3 { skin_color(base, place) } else { lip_color(base.look, ring.paint, t) };
            sheet.add(place, Kind::Lip(Point { upper, ring: ring.number, contact }), color)
        });
        sheet.strip(&inner, &row);
        if above.number == 3 {
            // Skin begins with a sharp edge at the red.
            inner = row.iter().map(|&at| sheet.recolored(at, skin_color(base, sheet.vertices[at].place))).collect();
            for &at in &inner {
                let Kind::Lip(point) = &mut sheet.vertices[at].kind else { continue };
                point.ring += 1;
            }
        } else {
            inner = row;
        }
    }
    inner
}

fn lip_color(look: &Look, paint: Paint, t: f32) -> Color {
    mix_color(paint.color(look), lip_dark(look), 0.5 * ramp(0.8, 1.0, t))
}

/// Vertices from the middle above to the corner and on to the middle below; the corner is one vertex.
fn half_ring(
    sheet: &mut Sheet,
    base: &Base,
    mut vertex: impl FnMut(&mut Sheet, bool, f32, f32, V) -> usize,
) -> Vec<usize> {
    let mut row = Vec::new();
    let above = (0..STEPS).map(|k| (k, true));
    let below = (0..STEPS - 1).rev().map(|k| (k, false));
    for (k, upper) in above.chain(below) {
        let t = (FRAC_PI_2 * k as f32 / (STEPS - 1) as f32).sin();
        let x = WIDE * t;
        let touch = base.behind(x, line(x));
        let contact = [x, line(x), touch[2] + 0.0006 * (1.0 - t * t)];
        row.push(vertex(sheet, upper, x, t, contact));
    }
    row
}

fn lip_place(base: &Base, ring: &Ring, upper: bool, x: f32, t: f32, contact: V) -> V {
    if ring.number == 0 {
        return contact;
    }
    let full = (1.0 - t * t).max(0.0).powf(0.80);
    // The upper lip's bow, strongest at the edge of the red.
    let bow = match (upper, ring.number) {
        (true, 2) => 0.5,
        (true, 3) => 1.0,
        (true, 4) => 0.6,
        _ => 0.0,
    };
    let bowed = 1.0 + bow * (0.24 * (-((x - 0.0065) / 0.0042).powi(2)).exp() - 0.16 * (-(x / 0.0030).powi(2)).exp());
    let side = x + ring.aside * t.powi(3);
    let full_lips = if ring.number < 4 { base.look.build.face.lips } else { 1.0 };
    let height = contact[1] + ring.up * full_lips * full * bowed + 0.0004 * t.powi(6);
    let skin = base.behind(side, height);
    [side, height, skin[2] + ring.forward * full_lips * full]
}

/// Closes the back of the mouth.
fn close(sheet: &mut Sheet, row: &[usize]) {
    let at = |k: usize| sheet.vertices[row[k]];
    let (first, last) = (at(0), at(row.len() - 1));
    let mut place = first.place;
    place[1] = 0.5 * (first.place[1] + last.place[1]);
    place[2] -= 0.004;
    let Kind::Lip(point) = first.kind else { return };
    let back = sheet.add(place, Kind::Lip(Point { ring: -6, ..point }), DEEP);
    for pair in row.windows(2) {
        sheet.triangles.push([back, pair[1], pair[0]]);
    }
}

/// Adds the left nostril: a dark oval on the underside of the nose.
pub(super) fn add_nostril(sheet: &mut Sheet, base: &Base) {
    const AROUND: usize = 12;
    let place = |x: f32, z: f32| {
        let skin = base.onto([0.0068 + x, -0.0470, 0.0225 + z]);
        [skin[0], skin[1] - 0.0003, skin[2] + 0.0003]
    };
    let dark = base.look.skin.toned(0.3, 1.15);
    let middle = sheet.add(place(0.0, 0.0), Kind::Skin, dark);
    let ring: Vec<usize> = (0..AROUND)
        .map(|k| {
            let (sin, cos) = (2.0 * PI * k as f32 / AROUND as f32).sin_cos();
            sheet.add(place(0.0028 * cos - 0.0008 * sin, 0.0040 * sin), Kind::Skin, dark)
        })
        .collect();
    for k in 0..AROUND {
        sheet.triangles.push([middle, ring[k], ring[(k + 1) % AROUND]]);
    }
}

/// Columns of a tooth, and teeth of half a row.
const ACROSS: usize = 6;
const TEETH_IN_ROW: usize = 6;

/// Adds half of both rows.
pub(super) fn add_teeth(sheet: &mut Sheet, base: &Base) {
    let front = base.behind(0.0, line(0.0))[2];
    // Widths from the middle outwards; the upper front teeth are larger.
    let upper = [0.0043, 0.0036, 0.0038, 0.0035, 0.0034, 0.0040];
    let lower = [0.0029, 0.0030, 0.0034, 0.0034, 0.0036, 0.0040];
    row_of_teeth(sheet, &upper, front - 0.0100, [0.0085, -0.0020], true);
    row_of_teeth(sheet, &lower, front - 0.0122, [-0.0105, -0.0032], false);
}

/// `ends` are the heights of gums and edge above the line between the lips, in metres.
fn row_of_teeth(sheet: &mut Sheet, widths: &[f32; TEETH_IN_ROW], front: f32, [gums, edge]: [f32; 2], upper: bool) {
    let kind = if upper { Kind::UpperTeeth } else { Kind::LowerTeeth };
    // Gums, neck, middle, edge, and back up on the inside: share of the height, offset backwards, colour.
    let profile = [
        (-0.35, 0.0016, GUMS),
        (0.0, 0.0006, GUMS),
        (0.08, 0.0003, TEETH),
        (0.5, 0.0, TEETH),
        (0.88, 0.0002, TEETH),
        (1.0, 0.0012, TEETH),
        (0.75, 0.0032, TEETH),
        (0.0, 0.0046, TEETH),
    ];
    let mut rows: Vec<Vec<usize>> = vec![Vec::new(); profile.len()];
    let mut along = 0.0;
    for (tooth, width) in widths.iter().enumerate() {
        for column in 0..=ACROSS {
            let across = column as f32 / ACROSS as f32;
            if column == 0 && tooth > 0 {
                continue;
            }
            // Teeth are round at the sides, and slightly shorter there.
            let hollow = (2.0 * across - 1.0).powi(6);
            let s = along + across * width;
            for (row, &(share, back, color)) in rows.iter_mut().zip(&profile) {
                let outer = 1.0 - 0.10 * (tooth as f32 / TEETH_IN_ROW as f32);
                let height =
                    gums + (edge - gums) * share * if share > 0.6 { outer * (1.0 - 0.07 * hollow) } else { 1.0 };
                let turn = s / 0.0225;
                let radius = 0.0225 - back - 0.0011 * hollow * if share > 0.0 { 1.0 } else { 0.3 };
                // A parabola-like arch: deeper than wide.
                let place =
                    [radius * turn.sin(), line(0.0) + height, front - 0.0225 * 1.25 + radius * 1.25 * turn.cos()];
                let shaded = mix_color(color, GUMS, 0.45 * hollow * ramp(1.1, 0.2, share.abs()));
                // Lips and cheeks shade the lower row and the teeth at the sides.
                let dark = if upper { 0.0 } else { 0.10 } + 0.16 * ramp(0.004, 0.022, s);
                let shaded = mix_color(shaded, CAVITY, dark);
                row.push(sheet.add(place, kind, shaded));
            }
        }
        along += width;
    }
    for pair in rows.windows(2) {
        if upper { sheet.strip(&pair[1], &pair[0]) } else { sheet.strip(&pair[0], &pair[1]) }
    }
}

/// Sections of the tongue from root to tip.
const SECTIONS: usize = 11;
const HALF_ROUND: usize = 8;

/// Adds half of the tongue.
pub(super) fn add_tongue(sheet: &mut Sheet, base: &Base) {
    let front = base.behind(0.0, line(0.0))[2];
    let mut before: Vec<usize> = Vec::new();
    for section in 0..SECTIONS {
        let s = (FRAC_PI_2 * section as f32 / (SECTIONS - 1) as f32).sin();
        let round = (1.0 - s.powi(4)).max(0.0).sqrt();
        let (wide, thick) = (0.0165 * round.max(0.02), 0.0052 * round.max(0.02));
        let centre = [0.0, line(0.0) - 0.0088 + 0.0032 * (PI * s).sin() * 0.8, front - 0.050 + 0.0330 * s];
        let row: Vec<usize> = (0..=HALF_ROUND)
            .map(|k| {
                let (sin, cos) = (PI * k as f32 / HALF_ROUND as f32).sin_cos();
                // A groove along the middle of the upper side.
                let groove = if cos > 0.0 { 0.0016 * round * (-(sin / 0.35).powi(2)).exp() } else { 0.0 };
                let place = [wide * sin, centre[1] + thick * cos - groove, centre[2]];
                sheet.add(place, Kind::Tongue(s), mix_color(CAVITY, TONGUE, 0.35 + 0.65 * s))
            })
            .collect();
        if section > 0 {
            sheet.strip(&row, &before);
        }
        before = row;
    }
}
