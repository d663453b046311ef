//! Brows, ears and hair.

use super::base::Base;
use super::eye::mix_color;
use super::sheet::Sheet;
use super::{Kind, mouth};
use crate::field::Join::{Cut, Union};
use crate::field::{Shape, Solid};
use crate::nets::{self, Grid, planes};
use crate::vector::{V, add, curve, ramp, scale, sub, unit};
use std::f32::consts::PI;

const BROWN: [u8; 3] = [74, 50, 38];
const BROWN_LIGHT: [u8; 3] = [110, 76, 54];

/// The left brow.
pub(super) fn add_brow(sheet: &mut Sheet, base: &Base) {
    const LENGTH: usize = 14;
    let mut before: Vec<usize> = Vec::new();
    for step in 0..=LENGTH {
        let t = step as f32 / LENGTH as f32;
        let x = 0.0130 + 0.0390 * t;
        let y = curve(&[(0.0, 0.0272), (0.35, 0.0300), (0.68, 0.0308), (1.0, 0.0258)], t);
        let half = curve(&[(0.0, 0.0016), (0.08, 0.0032), (0.5, 0.0033), (1.0, 0.0008)], t);
        let thick = 0.0016 * curve(&[(0.0, 0.2), (0.15, 1.0), (0.6, 1.0), (1.0, 0.25)], t);
        let row: Vec<usize> = [(-1.0, -0.0006), (-0.7, 0.55), (0.0, 1.0), (0.7, 0.55), (1.0, -0.0006)]
            .iter()
            .map(|&(up, out)| {
                let skin = base.behind(x, y + up * half);
                let lift = if out < 0.0 { out } else { thick * out };
                let away = unit(sub(skin, [0.0, 0.01, -0.06]));
                sheet.add(add(skin, scale(away, lift)), Kind::Brow, mix_color(BROWN, BROWN_LIGHT, 0.25 * (1.0 - t)))
            })
            .collect();
        if step > 0 {
            sheet.strip(&row, &before);
        }
        before = row;
    }
}

/// The left ear.
pub(super) fn add_ear(sheet: &mut Sheet, base: &Base) {
    let root = base.onto([0.075, -0.012, -0.078]);
    let over = |x: f32, y: f32, z: f32| add(root, [x, y, z]);
    let solid = Solid::default()
        .with(Shape::Ellipsoid { centre: over(0.004, 0.006, -0.006), radii: [0.0060, 0.0240, 0.0160] }, Union(0.0))
        .with(Shape::Ellipsoid { centre: over(0.004, -0.017, 0.000), radii: [0.0058, 0.0115, 0.0085] }, Union(0.010))
        .with(Shape::Ellipsoid { centre: over(0.0130, 0.007, -0.004), radii: [0.0070, 0.0168, 0.0096] }, Cut(0.004))
        .with(Shape::Ellipsoid { centre: over(0.0125, -0.006, 0.001), radii: [0.0080, 0.0085, 0.0065] }, Cut(0.004));
    let range = |axis: usize, reach: f32, step: f32| planes(root[axis] - reach, root[axis] + reach, |_| step);
    let part =
        nets::surface(&solid, &Grid([range(0, 0.024, 0.0034), range(1, 0.040, 0.0048), range(2, 0.030, 0.0040)]));
    let first = sheet.vertices.len();
    for &place in &part.positions {
        // The ear stands off the head behind.
        let back = ramp(0.005, -0.022, place[2] - root[2]);
        sheet.add(add(place, [0.006 * back, 0.0, 0.0]), Kind::Ear, mouth::skin_color(place));
    }
    let (triangles, _) = part.indices.as_chunks::<3>();
    sheet.triangles.extend(triangles.iter().map(|t| t.map(|i| first + i as usize)));
}

/// Where hair ends, as an angle from the crown, by the angle from straight ahead; degrees.
const HAIRLINE: [(f32, f32); 11] = [
    (0.0, 50.0),
    (20.0, 50.5),
    (38.0, 55.0),
    (51.0, 66.0),
    (63.0, 86.0),
    (73.0, 99.0),
    (84.0, 98.0),
    (98.0, 89.0),
    (118.0, 104.0),
    (145.0, 126.0),
    (180.0, 130.0),
];
const CROWN: V = [0.0, 0.020, -0.066];
const COLUMNS: usize = 40;
const ROWS: usize = 15;

/// The left half of the hair: a cap in strands that run from the crown to the hairline.
pub(super) fn add_hair(sheet: &mut Sheet, base: &Base) {
    let mut before: Vec<usize> = Vec::new();
    for row in 0..=ROWS {
        // The last row is under the skin.
        let t = (row as f32 / (ROWS - 1) as f32).min(1.0);
        let ring: Vec<usize> = (0..=COLUMNS)
            .map(|column| {
                let ahead = 180.0 * column as f32 / COLUMNS as f32;
                let end = curve(&HAIRLINE, ahead);
                let from = 6.0 * (1.0 - t) + end * t + if row == ROWS { 1.5 } else { 0.0 };
                let (place, strand) = hair_place(base, ahead, from, t, row == ROWS);
                let mut place = place;
                if column == 0 || column == COLUMNS {
                    place[0] = 0.0;
                }
                sheet.add(place, Kind::Hair, mix_color(BROWN, BROWN_LIGHT, 0.5 + 0.5 * strand))
            })
            .collect();
        if row == 0 {
            let mut top = sheet.vertices[ring[COLUMNS / 2]].place;
            top[0] = 0.0;
            let top = sheet.add(top, Kind::Hair, BROWN);
            ring.windows(2).for_each(|pair| sheet.triangles.push([top, pair[0], pair[1]]));
        } else {
            sheet.strip(&ring, &before);
        }
        before = ring;
    }
}

/// A place of the hair, and how far the strand stands out, -1..=1.
fn hair_place(base: &Base, ahead: f32, from: f32, t: f32, under: bool) -> (V, f32) {
    let (turn, fall) = (ahead.to_radians(), from.to_radians());
    let along = [turn.sin() * fall.sin(), fall.cos(), turn.cos() * fall.sin()];
    let skin = base.outermost(CROWN, along);
    if under {
        return (add(skin, scale(along, -0.003)), -1.0);
    }
    let front = ramp(70.0, 10.0, ahead);
    let edge = ramp(1.0, 0.72, t);
    let top = ramp(80.0, 25.0, from);
    let body = 0.0040 + edge * (0.0050 + 0.0075 * top + 0.0105 * front * ramp(0.2, 0.8, t));
    // Strands, wider at the back; none at the crown.
    let wave = (ahead * 0.30 + 5.0 * t * front).sin() * 0.6 + (ahead * 0.71 + 2.0 * t).sin() * 0.4;
    let strand = wave * (PI * t.min(0.97)).sin().max(0.15) * ramp(0.0, 0.35, t);
    (add(skin, scale(along, body + 0.0017 * strand)), strand)
}
