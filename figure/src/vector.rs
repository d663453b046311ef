//! Vectors `[x, y, z]` in metres; X to the body's left, Y up, Z forwards.

pub(crate) type V = [f32; 3];

pub(crate) fn add(a: V, b: V) -> V {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

pub(crate) fn sub(a: V, b: V) -> V {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub(crate) fn scale(a: V, by: f32) -> V {
    a.map(|x| x * by)
}

pub(crate) fn dot(a: V, b: V) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(crate) fn cross(a: V, b: V) -> V {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub(crate) fn length(a: V) -> f32 {
    dot(a, a).sqrt()
}

pub(crate) fn distance(a: V, b: V) -> f32 {
    length(sub(a, b))
}

/// Length of a 2D vector. It has the same bits as `f32::hypot`, which would need glibc 2.35.
#[expect(clippy::cast_possible_truncation, reason = "rounds, as wanted")]
pub(crate) fn hypot(x: f32, y: f32) -> f32 {
    let [x, y] = [x, y].map(f64::from);
    (x * x + y * y).sqrt() as f32
}

/// Normalises `a`; up if `a` has no length.
pub(crate) fn unit(a: V) -> V {
    let size = length(a);
    if size > 1e-12 { scale(a, 1.0 / size) } else { [0.0, 1.0, 0.0] }
}

pub(crate) fn mix(a: V, b: V, t: f32) -> V {
    add(scale(a, 1.0 - t), scale(b, t))
}

pub(crate) fn blend(a: f32, b: f32, t: f32) -> f32 {
    a + (b - a) * t
}

/// 0 up to `from`, 1 beyond `to`, smooth in between; `from` may be the larger.
pub(crate) fn ramp(from: f32, to: f32, x: f32) -> f32 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Rotates `p` by `angle` radians about the X axis through `centre`; positive from Y towards Z.
pub(crate) fn turn_x(p: V, centre: V, angle: f32) -> V {
    let (sin, cos) = angle.sin_cos();
    let [x, y, z] = sub(p, centre);
    add(centre, [x, y * cos - z * sin, y * sin + z * cos])
}

pub(crate) fn mirrored(a: V) -> V {
    [-a[0], a[1], a[2]]
}

/// Value at `x` of a smooth curve through `points` (ascending in `x`), constant beyond its ends.
pub(crate) fn curve(points: &[(f32, f32)], x: f32) -> f32 {
    let last = points.len() - 1;
    let above = points.iter().position(|point| point.0 > x);
    match above {
        Some(0) => points[0].1,
        None => points[last].1,
        Some(k) => {
            let slope = |i: usize| {
                let (a, b) = (points[i.saturating_sub(1)], points[(i + 1).min(last)]);
                (b.1 - a.1) / (b.0 - a.0)
            };
            let (a, b) = (points[k - 1], points[k]);
            let width = b.0 - a.0;
            let t = (x - a.0) / width;
            let (from, to) = (slope(k - 1) * width, slope(k) * width);
            let u = 1.0 - t;
            u * u * (1.0 + 2.0 * t) * a.1 + u * u * t * from + t * t * (3.0 - 2.0 * t) * b.1 - t * t * u * to
        }
    }
}
