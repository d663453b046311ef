//! The head's surface: a mask with brow, nose and a mouth that can open, on the head joint.
//!
//! Points of the face are named by two angles seen from the head's centre: degrees to the body's left of
//! straight ahead, and degrees above it.

use super::body::{add, cross, subtract, unit};
use super::{HEAD, Surface};

/// The head's centre from the head joint, and its half width, height and depth, metres.
const CENTRE: [f32; 3] = [0.0, 0.055, 0.02];
const RADII: [f32; 3] = [0.076, 0.115, 0.095];
/// Columns from ear to ear.
const COLUMNS: u16 = 19;
const SIDE: f32 = 105.0;
/// Rows above the line between the lips, and below it.
const UPPER_ROWS: u16 = 12;
const LOWER_ROWS: u16 = 6;
const TOP: f32 = 80.0;
pub(super) const LIPS: f32 = -30.0;
const CHIN: f32 = -68.0;
/// From this angle the lips begin to be one, and from that they are: the mouth's corner.
const CORNER: (f32, f32) = (10.0, 22.0);

/// The surface, with what the shapes need to know of each vertex.
pub(super) struct Head {
    pub(super) surface: Surface,
    /// `[vertices]`
    pub(super) points: Vec<Point>,
}

/// A vertex of the face.
#[derive(Clone, Copy)]
pub(super) struct Point {
    /// Degrees to the body's left.
    pub(super) left: f32,
    /// Degrees up.
    pub(super) up: f32,
    /// Below the line between the lips.
    pub(super) lower: bool,
    /// How freely a lip may leave the other here, 0..=1; 1 away from the line between them.
    pub(super) free: f32,
}

/// The head over the head joint at `joint`; the part below the lips follows `jaw`, where there is one.
pub(super) fn head(joint: [f32; 3], jaw: Option<usize>) -> Head {
    let mut head = Head { surface: Surface::default(), points: Vec::new() };
    let centre = add(joint, CENTRE);
    add_sheet(&mut head, centre, (LIPS, TOP, UPPER_ROWS), false);
    add_sheet(&mut head, centre, (CHIN, LIPS, LOWER_ROWS), true);
    add_normals(&mut head.surface);
    for point in &head.points {
        let (joints, weights) = follow(point, jaw);
        head.surface.joints.push(joints);
        head.surface.weights.push(weights);
    }
    head
}

/// A grid of vertices from one height to another. The two sheets meet in vertices at the same places.
fn add_sheet(head: &mut Head, centre: [f32; 3], (low, high, rows): (f32, f32, u16), lower: bool) {
    let first = u16::try_from(head.points.len()).expect("the face has few vertices");
    for row in 0..=rows {
        let up = low + (high - low) * f32::from(row) / f32::from(rows);
        for column in 0..COLUMNS {
            let left = SIDE * (2.0 * f32::from(column) / f32::from(COLUMNS - 1) - 1.0);
            let on_line = row == if lower { rows } else { 0 };
            let free = if on_line { open(left) } else { 1.0 };
            head.points.push(Point { left, up, lower, free });
            head.surface.positions.push(add(centre, place(left, up)));
        }
    }
    for row in 0..rows {
        for column in 0..COLUMNS - 1 {
            let a = first + row * COLUMNS + column;
            let (b, c, d) = (a + 1, a + COLUMNS, a + COLUMNS + 1);
            head.surface.indices.extend([a, b, d, a, d, c]);
        }
    }
}

/// A point of an ellipsoid, with a nose, eye sockets and lips.
fn place(left: f32, up: f32) -> [f32; 3] {
    let (sin, cos) = left.to_radians().sin_cos();
    let (rise, level) = up.to_radians().sin_cos();
    let bump = |x: f32, y: f32, wide: f32, tall: f32| {
        let (x, y) = ((left - x) / wide, (up - y) / tall);
        (-0.5 * (x * x + y * y)).exp()
    };
    let nose = 0.022 * bump(0.0, -6.0, 8.0, 9.0);
    let sockets = -0.008 * (bump(24.0, 13.0, 9.0, 6.0) + bump(-24.0, 13.0, 9.0, 6.0));
    let lips = 0.007 * bump(0.0, LIPS, 12.0, 6.0);
    [RADII[0] * sin * level, RADII[1] * rise, RADII[2] * cos * level + nose + sockets + lips]
}

/// 1 in the middle of the mouth, 0 beyond its corners.
fn open(left: f32) -> f32 {
    let t = ((CORNER.1 - left.abs()) / (CORNER.1 - CORNER.0)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

fn follow(point: &Point, jaw: Option<usize>) -> ([u8; 4], [f32; 4]) {
    let number = |joint: usize| u8::try_from(joint).expect("there are 55 joints");
    let alone = ([number(HEAD), 0, 0, 0], [1.0, 0.0, 0.0, 0.0]);
    let Some(jaw) = jaw.filter(|_| point.lower) else {
        return alone;
    };
    // The cheeks stay with the head.
    let side = ((90.0 - point.left.abs()) / 50.0).clamp(0.0, 1.0);
    let weight = side * point.free;
    if weight == 0.0 {
        return alone;
    }
    let joints = [number(jaw), if weight < 1.0 { number(HEAD) } else { 0 }, 0, 0];
    (joints, [weight, 1.0 - weight, 0.0, 0.0])
}

/// Normals of a smooth surface: the mean of the triangles around, by area. The lips' two edges are
/// smoothed apart.
fn add_normals(surface: &mut Surface) {
    let mut sums = vec![[0.0; 3]; surface.positions.len()];
    let (triangles, _) = surface.indices.as_chunks::<3>();
    for corners in triangles {
        let [a, b, c] = corners.map(|i| surface.positions[usize::from(i)]);
        let normal = cross(subtract(b, a), subtract(c, a));
        for &i in corners {
            let sum = &mut sums[usize::from(i)];
            *sum = add(*sum, normal);
        }
    }
    surface.normals = sums.into_iter().map(unit).collect();
}
