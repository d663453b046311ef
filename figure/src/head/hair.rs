//! Brows, ears and hair.

use super::Kind;
use super::base::Base;
use super::eye::spike;
use super::sheet::Sheet;
use crate::field::Join::{Cut, Union};
use crate::field::{Shape, Solid, occlusion};
use crate::look::{Color, Hair, mix_color};
use crate::nets::{self, Grid, planes};
use crate::vector::{V, add, cross, curve, mix, ramp, scale, sub, unit};
use std::f32::consts::{PI, TAU};

/// Colour of the strands: 0 for the roots, 1 for the tips.
fn color(base: &Base, t: f32) -> Color {
    let [root, tip] = base.look.strands;
    mix_color(root, tip, t.clamp(0.0, 1.0))
}

/// A deterministic pseudo-random number between 0 and 1.
fn random(seed: usize) -> f32 {
    let x = (seed as f32 * 12.9898).sin() * 43_758.547;
    x - x.floor()
}

/// Adds the left brow: single hairs over a thin strip of their colour.
pub(super) fn add_brow(sheet: &mut Sheet, base: &Base) {
    const LENGTH: usize = 14;
    const HAIRS: usize = 60;
    let thick = base.look.build.face.brows;
    let place = |t: f32, up: f32| {
        let x = 0.0125 + 0.0395 * t;
        let y = curve(&[(0.0, 0.0232), (0.35, 0.0262), (0.68, 0.0278), (1.0, 0.0228)], t);
        let half = thick * curve(&[(0.0, 0.0026), (0.10, 0.0036), (0.5, 0.0034), (1.0, 0.0010)], t);
        let skin = base.behind(x, y + up * half);
        (skin, unit(sub(skin, [0.0, 0.01, -0.06])))
    };
    let mut before: Vec<usize> = Vec::new();
    for step in 0..=LENGTH {
        let t = 0.03 + 0.94 * step as f32 / LENGTH as f32;
        let row: Vec<usize> = [(-0.75, -0.0006), (-0.4, 0.0004), (0.0, 0.0007), (0.4, 0.0004), (0.75, -0.0006)]
            .iter()
            .map(|&(up, lift)| {
                let (skin, away) = place(t, up);
                sheet.add(add(skin, scale(away, lift)), Kind::Brow, color(base, 0.30 - 0.1 * t))
            })
            .collect();
        if step > 0 {
            sheet.strip(&row, &before);
        }
        before = row;
    }
    for hair in 0..HAIRS {
        let t = 0.94 * (hair as f32 + random(hair)) / HAIRS as f32;
        let up = [-0.62, 0.30, -0.15, 0.72][hair % 4];
        let (root, away) = place(t, up);
        // The inner hairs stand up, the outer ones lie along the brow.
        let lie = ramp(0.0, 0.35, t);
        let (end, lift) = place((t + 0.05 + 0.11 * lie).min(1.02), up * 0.55 + 1.1 * (1.0 - lie) * (1.0 - 0.3 * up));
        let tip = add(end, scale(lift, 0.0010));
        let side = scale(unit(cross(away, sub(tip, root))), 0.00050 + 0.0003 * thick);
        let shade = color(base, 0.35 * random(hair + 91));
        let at = [add(root, side), sub(root, side), add(root, scale(away, 0.0011)), tip]
            .map(|place| sheet.add(place, Kind::Brow, shade));
        spike(sheet, at);
    }
}

/// Adds the left ear.
pub(super) fn add_ear(sheet: &mut Sheet, base: &Base) {
    const SIZE: f32 = 0.94;
    let root = base.onto([0.075, -0.012, -0.078]);
    let over = |x: f32, y: f32, z: f32| add(root, scale([x, y, z], SIZE));
    let egg = |centre: V, radii: V| Shape::Ellipsoid { centre, radii: scale(radii, SIZE) };
    let mut solid = Solid::default()
        .with(egg(over(0.0035, 0.005, -0.006), [0.0056, 0.0285, 0.0184]), Union(0.0))
        .with(egg(over(0.0050, -0.0205, -0.0005), [0.0048, 0.0098, 0.0074]), Union(0.009))
        .with(egg(over(0.0125, 0.008, -0.006), [0.0060, 0.0168, 0.0096]), Cut(0.004));
    // The rim, from the front over the top to the back.
    let rim = [
        over(0.0045, 0.004, 0.0045),
        over(0.0070, 0.017, 0.0078),
        over(0.0090, 0.0272, 0.0010),
        over(0.0105, 0.0285, -0.0090),
        over(0.0115, 0.0215, -0.0180),
        over(0.0115, 0.0070, -0.0208),
        over(0.0100, -0.0070, -0.0165),
        over(0.0070, -0.0165, -0.0090),
    ];
    // The inner fold, which has two arms at the top.
    let fold = [over(0.0085, -0.0100, -0.0105), over(0.0100, 0.0030, -0.0120), over(0.0090, 0.0160, -0.0070)];
    for (line, thick, soft) in [(&rim[..], 0.0027, 0.0035), (&fold[..], 0.0024, 0.0040)] {
        for pair in line.windows(2) {
            solid = solid.with(Shape::cone(pair[0], pair[1], thick * SIZE, thick * SIZE), Union(soft));
        }
    }
    solid = solid
        .with(egg(over(0.0125, -0.0030, -0.0035), [0.0095, 0.0085, 0.0062]), Cut(0.0040))
        .with(egg(over(0.0075, -0.0035, 0.0055), [0.0030, 0.0050, 0.0026]), Union(0.0040));
    let range = |axis: usize, reach: f32, step: f32| planes(root[axis] - reach, root[axis] + reach, |_| step);
    let part =
        nets::surface(&solid, &Grid([range(0, 0.024, 0.0028), range(1, 0.040, 0.0031), range(2, 0.030, 0.0028)]));
    let first = sheet.vertices.len();
    for (&place, &normal) in part.positions.iter().zip(&part.normals) {
        // At the back, the ear stands off the head.
        let back = ramp(0.005, -0.022, place[2] - root[2]);
        let shade = occlusion(&[&solid], place, normal, 0.010);
        let color = base.look.skin.toned(0.42, 0.62 * shade);
        sheet.add(add(place, [0.006 * back, 0.0, 0.0]), Kind::Ear, color);
    }
    let (triangles, _) = part.indices.as_chunks::<3>();
    sheet.triangles.extend(triangles.iter().map(|t| t.map(|i| first + i as usize)));
}

/// Hairline: angle from the crown, by the angle from the front, in degrees.
const HAIRLINE: [(f32, f32); 11] = [
    (0.0, 46.5),
    (20.0, 46.5),
    (38.0, 50.0),
    (51.0, 62.5),
    (63.0, 84.0),
    (73.0, 99.0),
    (84.0, 97.0),
    (98.0, 89.0),
    (118.0, 104.0),
    (145.0, 124.0),
    (180.0, 128.0),
];

/// The hairline, made irregular.
fn hairline(ahead: f32) -> f32 {
    let jagged = 0.7 * (ahead * 0.55).sin() + 0.5 * (ahead * 1.21).sin();
    curve(&HAIRLINE, ahead) + jagged * ramp(0.0, 8.0, ahead) * ramp(180.0, 170.0, ahead)
}

const CROWN: V = [0.0, 0.020, -0.066];
const COLUMNS: usize = 44;

/// A row of the cap: share of the way from crown to hairline, and share of the hair's thickness.
type Row = (f32, f32);

/// Adds the left half of the hair: a cap, and locks over it.
pub(super) fn add_hair(sheet: &mut Sheet, base: &Base) {
    add_cap(sheet, base);
    add_fringe(sheet, base);
    match base.look.hair {
        Hair::Short => add_short(sheet, base),
        Hair::Bob => add_bob(sheet, base),
        Hair::Crop => {}
        Hair::Bun => add_bun(sheet, base),
    }
}

/// Point above the skin in a direction from the crown, in degrees: from the front, and downwards.
fn over(base: &Base, ahead: f32, fall: f32, lift: f32) -> V {
    let (turn, fall) = (ahead.to_radians(), fall.to_radians());
    let along = [turn.sin() * fall.sin(), fall.cos(), turn.cos() * fall.sin()];
    add(base.outermost(CROWN, along), scale(along, lift))
}

/// Thickness of the hair in metres, and relief of a strand, -1..=1.
fn thickness(hair: Hair, ahead: f32, fall: f32, t: f32) -> (f32, f32) {
    let front = ramp(70.0, 10.0, ahead);
    let top = ramp(80.0, 25.0, fall);
    let edge = ramp(1.0, 0.80, t);
    let fine = (ahead * 0.30 + 5.0 * t * front).sin() * 0.6 + (ahead * 0.71 + 2.0 * t).sin() * 0.4;
    let strand = fine * (PI * t.min(0.97)).sin().max(0.15) * ramp(0.0, 0.35, t);
    match hair {
        Hair::Short => (0.0022 + edge * (0.0045 + 0.0075 * top + 0.0050 * front * ramp(0.2, 0.8, t)), strand),
        Hair::Bob => (0.0030 + edge * (0.0080 + 0.0060 * top), strand),
        Hair::Bun => (0.0020 + edge * (0.0040 + 0.0035 * top), 0.7 * strand),
        Hair::Crop => {
            let curl = (ahead * 0.9).sin() * (fall * 0.95).sin() + 0.6 * (ahead * 1.7 + fall * 1.3).sin();
            (0.0012 + edge * (0.0030 + 0.0035 * top), 0.55 * curl * edge)
        }
    }
}

fn add_cap(sheet: &mut Sheet, base: &Base) {
    let hair = base.look.hair;
    let rows = if hair == Hair::Crop { 26 } else { 16 };
    let mut before: Vec<usize> = Vec::new();
    let list: Vec<Row> = (0..rows).map(|row| (row as f32 / (rows - 1) as f32, 1.0)).chain([(1.0, 0.0)]).collect();
    for (number, (t, full)) in list.into_iter().enumerate() {
        let ring: Vec<usize> = (0..=COLUMNS)
            .map(|column| {
                let ahead = 180.0 * column as f32 / COLUMNS as f32;
                let end = hairline(ahead);
                let fall = 6.0 * (1.0 - t) + end * t + 1.5 * (1.0 - full);
                let (body, strand) = thickness(hair, ahead, fall, t);
                // The last row is below the skin.
                let lift = if full > 0.0 { body + 0.0015 * strand } else { -0.003 };
                let mut place = over(base, ahead, fall, lift);
                if column == 0 || column == COLUMNS {
                    place[0] = 0.0;
                }
                sheet.add(place, Kind::Hair, color(base, 0.34 + 0.34 * strand - 0.25 * ramp(0.85, 1.0, t)))
            })
            .collect();
        if number == 0 {
            let mut top = sheet.vertices[ring[COLUMNS / 2]].place;
            top[0] = 0.0;
            let top = sheet.add(top, Kind::Hair, color(base, 0.3));
            ring.windows(2).for_each(|pair| sheet.triangles.push([top, pair[0], pair[1]]));
        } else {
            sheet.strip(&ring, &before);
        }
        before = ring;
    }
}

/// Adds single hairs over the hairline, so that the cap's edge does not look cut.
fn add_fringe(sheet: &mut Sheet, base: &Base) {
    const HAIRS: usize = 80;
    let long = if base.look.hair == Hair::Crop { 0.7 } else { 1.0 };
    for hair in 0..HAIRS {
        let ahead = 0.8 + 177.0 * (hair as f32 + 0.8 * random(hair + 300)) / HAIRS as f32;
        let end = hairline(ahead);
        let (body, _) = thickness(base.look.hair, ahead, end - 4.5, 0.94);
        let root = over(base, ahead, end - 4.5, 0.9 * body);
        let beyond = long * (1.3 + 2.6 * random(hair + 600));
        let tip = over(base, ahead + 4.0 * (random(hair + 500) - 0.5), end + beyond, 0.0005);
        let away = from_crown(root);
        let side = scale(unit(cross(away, sub(tip, root))), 0.0014);
        let tone = color(base, 0.45 * random(hair + 400));
        let at = [add(root, side), sub(root, side), add(root, scale(away, 0.0008)), tip]
            .map(|place| sheet.add([place[0].max(1e-4), place[1], place[2]], Kind::Hair, tone));
        spike(sheet, at);
    }
}

/// Adds a flat lock along a path, at most `wide` metres across, from a blunt root to its end. `end` is the width at
/// the end as a share, `shade` the position between the strands' colours.
fn add_lock(sheet: &mut Sheet, base: &Base, path: &[V], end: f32, wide: f32, shade: f32) {
    const AROUND: usize = 5;
    let last = path.len() - 1;
    let mut before: Vec<usize> = Vec::new();
    for (k, &place) in path.iter().enumerate() {
        let t = k as f32 / last as f32;
        let along = unit(sub(path[(k + 1).min(last)], path[k.saturating_sub(1)]));
        let away = from_crown(place);
        let side = unit(cross(away, along));
        let up = cross(along, side);
        let size = wide * (0.45 + 0.55 * ramp(0.0, 0.35, t)) * (1.0 - (1.0 - end) * ramp(0.62, 1.0, t));
        let tone = color(base, shade + 0.22 * t);
        let ring: Vec<usize> = (0..AROUND)
            .map(|spoke| {
                let (sin, cos) = (TAU * spoke as f32 / AROUND as f32).sin_cos();
                let mut at = add(place, add(scale(side, 0.5 * size * cos), scale(up, 0.12 * size * sin)));
                at[0] = at[0].max(1e-4);
                sheet.add(at, Kind::Hair, tone)
            })
            .collect();
        let closed: Vec<usize> = ring.iter().copied().chain([ring[0]]).collect();
        if k > 0 {
            sheet.strip(&before, &closed);
        }
        before = closed;
    }
    let tip = sheet.add(path[last], Kind::Hair, color(base, shade + 0.22));
    before.windows(2).for_each(|pair| sheet.triangles.push([pair[0], pair[1], tip]));
}

fn from_crown(p: V) -> V {
    unit(sub(p, CROWN))
}

/// Hair swept back from the forehead, short at sides and back.
fn add_short(sheet: &mut Sheet, base: &Base) {
    let mut seed = 0;
    for (row, &(from, to)) in [(1.0, 0.52), (0.86, 0.30), (0.62, 0.10)].iter().enumerate() {
        let mut ahead = 4.0 + 3.0 * row as f32;
        while ahead < 60.0 {
            seed += 1;
            let turn = ahead + 3.0 * (random(seed) - 0.5);
            let end = curve(&HAIRLINE, turn);
            let rise = 0.0026 + 0.0052 * ramp(60.0, 10.0, turn) + 0.003 * random(seed + 40);
            let path: Vec<V> = (0..=5_u8)
                .map(|k| {
                    let t = f32::from(k) / 5.0;
                    let fall = end * (from + (to - from) * t);
                    let (body, _) = thickness(Hair::Short, turn, fall, from + (to - from) * t);
                    let lift = 0.7 * body
                        + rise * (1.0 - (2.0 * t - 0.75).powi(2)).max(0.0) * if row == 0 { 1.0 } else { 0.55 };
                    // Roots are inside the skin.
                    over(base, turn + 9.0 * t, fall, lift * ramp(-0.06, 0.28, t))
                })
                .collect();
            add_lock(sheet, base, &path, 0.21, 0.0092, 0.12 + 0.6 * random(seed + 7));
            ahead += 5.2;
        }
    }
    for (row, &(from, to)) in [(0.30, 0.74), (0.55, 0.98)].iter().enumerate() {
        let mut ahead = 62.0 + 5.0 * row as f32;
        while ahead < 178.0 {
            seed += 1;
            let turn = ahead + 4.0 * (random(seed) - 0.5);
            let end = curve(&HAIRLINE, turn);
            let path: Vec<V> = (0..=4_u8)
                .map(|k| {
                    let t = f32::from(k) / 4.0;
                    let share = from + (to - from) * t;
                    let (body, _) = thickness(Hair::Short, turn, end * share, share);
                    over(base, turn + 5.0 * t, end * share, 0.85 * body + 0.0014 * (1.0 - t))
                })
                .collect();
            add_lock(sheet, base, &path, 0.21, 0.0115, 0.08 + 0.55 * random(seed + 7));
            ahead += 8.2;
        }
    }
}

/// Point of hanging hair: over the head down to the angle `bend`, then straight down for `long` metres.
fn hanging(base: &Base, ahead: f32, t: f32, lift: f32, long: f32) -> V {
    let bend = curve(&[(0.0, 60.0), (60.0, 84.0), (90.0, 88.0), (180.0, 92.0)], ahead);
    let split = 0.52;
    let at = over(base, ahead, 7.0 + (bend - 7.0) * (t / split).min(1.0), lift);
    let down = ((t - split) / (1.0 - split)).max(0.0);
    // Falls outside ear and cheek, and turns in at the end.
    let out = unit([at[0] - CROWN[0], 0.0, at[2] - CROWN[2]]);
    let away = 0.006 * (PI * down).sin() - 0.012 * down.powi(3);
    add(add(at, scale(out, away)), [0.0, -long * down, 0.0])
}

/// Chin-length hair with a middle parting.
fn add_bob(sheet: &mut Sheet, base: &Base) {
    const ROWS: usize = 12;
    const WAYS: usize = 16;
    // A curtain with an inner side.
    let mut before: Vec<usize> = Vec::new();
    for row in 0..=2 * ROWS {
        let inside = row > ROWS;
        let t = if inside { 2 * ROWS - row } else { row } as f32 / ROWS as f32;
        let t = if inside { t.max(0.35) } else { t };
        let ring: Vec<usize> = (0..=WAYS)
            .map(|way| {
                let ahead = 54.0 + 126.0 * way as f32 / WAYS as f32;
                let lift = if inside { 0.004 } else { 0.0120 };
                let strand = (way as f32 * 2.3).sin();
                let mut place = hanging(base, ahead, t, lift + if inside { 0.0 } else { 0.0014 * strand }, 0.090);
                if way == WAYS {
                    place[0] = 0.0;
                }
                sheet.add(place, Kind::Hair, color(base, if inside { 0.0 } else { 0.3 + 0.25 * strand }))
            })
            .collect();
        if row > 0 {
            sheet.strip(&ring, &before);
        }
        before = ring;
    }
    let mut seed = 0;
    for layer in 0..2_u8 {
        let mut ahead = 30.0 + 4.0 * f32::from(layer);
        while ahead < 178.0 {
            seed += 1;
            let turn = ahead + 3.0 * (random(seed) - 0.5);
            let shift = 26.0 * ramp(70.0, 30.0, turn);
            let long = 0.106 + 0.008 * random(seed + 3) - 0.006 * f32::from(layer);
            let path: Vec<V> = (0..=6_u8)
                .map(|k| {
                    let t = 0.06 + 0.94 * f32::from(k) / 6.0;
                    let lift = 0.0125 + 0.0022 * f32::from(layer) - 0.003 * t;
                    hanging(base, turn + shift * ramp(0.1, 0.75, t), t, lift, long)
                })
                .collect();
            add_lock(sheet, base, &path, 0.55, 0.0200, 0.12 + 0.5 * random(seed + 7));
            ahead += 9.5;
        }
    }
}

/// Hair drawn back to a knot at the back of the head.
fn add_bun(sheet: &mut Sheet, base: &Base) {
    let mut seed = 0;
    let knot = add(over(base, 180.0, 58.0, 0.0), [0.0, 0.010, -0.018]);
    let mut ahead = 4.0;
    while ahead < 176.0 {
        seed += 1;
        let end = curve(&HAIRLINE, ahead);
        let start = over(base, ahead, 0.93 * end, 0.0024);
        let path: Vec<V> = (0..=6_u8)
            .map(|k| {
                // Over the head towards the knot.
                let t = 0.96 * f32::from(k) / 6.0;
                let straight = mix(start, knot, t);
                let out = from_crown(straight);
                let skin = base.outermost(CROWN, out);
                let mut place = add(skin, scale(out, 0.0030 + 0.0035 * (PI * t).sin()));
                place[0] = place[0].max(0.002);
                place
            })
            .collect();
        add_lock(sheet, base, &path, 0.21, 0.0150, 0.10 + 0.42 * random(seed + 7));
        ahead += 6.2;
    }
    // The knot consists of wound strands.
    const RINGS: usize = 12;
    const SPOKES: usize = 12;
    let mut before: Vec<usize> = Vec::new();
    for ring in 0..=RINGS {
        let (out, up) = (PI * ring as f32 / RINGS as f32).sin_cos();
        let row: Vec<usize> = (0..=SPOKES)
            .map(|spoke| {
                let angle = PI * spoke as f32 / SPOKES as f32;
                let wound = (5.0 * angle + 2.4 * PI * up).sin();
                let radius = 0.0330 * (1.0 + 0.055 * wound * out);
                let (sin, cos) = angle.sin_cos();
                let x = if spoke == 0 || spoke == SPOKES { 0.0 } else { radius * out * sin };
                let place = add(knot, [x, radius * out * cos, -0.8 * radius * up]);
                sheet.add(place, Kind::Hair, color(base, 0.36 + 0.34 * wound))
            })
            .collect();
        if ring > 0 {
            sheet.strip(&row, &before);
        }
        before = row;
    }
}
