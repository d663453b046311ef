//! Quaternions to what the formats want, in f64. Quaternions are `[x, y, z, w]`.

pub(super) type Matrix = [[f64; 3]; 3];

/// Below this cosine of the middle angle, the other two angles turn about one axis.
const GIMBAL: f64 = 1e-9;

fn normalized(q: [f32; 4]) -> [f64; 4] {
    let q = q.map(f64::from);
    let length = q.iter().map(|x| x * x).sum::<f64>().sqrt();
    q.map(|x| x / length)
}

/// Rotation vector: the axis times the angle in radians, at most pi.
pub(super) fn axis_angle(q: [f32; 4]) -> [f64; 3] {
    let [x, y, z, w] = normalized(q);
    let sine = (x * x + y * y + z * z).sqrt();
    // Near no rotation the angle is twice the vector part; the quotient would be 0 / 0.
    let scale = if sine < 1e-12 { 2.0 * w.signum() } else { 2.0 * sine.atan2(w.abs()) * w.signum() / sine };
    [x * scale, y * scale, z * scale]
}

/// Rotation matrix, for column vectors.
pub(super) fn matrix(q: [f32; 4]) -> Matrix {
    let [x, y, z, w] = normalized(q);
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

/// `a * b`: first `b`, then `a`.
pub(super) fn product(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
}

/// Angles `[z, x, y]` in radians with `m = Z(z) * X(x) * Y(y)`.
pub(super) fn euler_zxy(m: &Matrix) -> [f64; 3] {
    let cosine = m[0][1].hypot(m[1][1]);
    let x = m[2][1].atan2(cosine);
    if cosine < GIMBAL {
        [m[1][0].atan2(m[0][0]), x, 0.0]
    } else {
        [(-m[0][1]).atan2(m[1][1]), x, (-m[2][0]).atan2(m[2][2])]
    }
}

/// Angles `[y, x, z]` in radians with `m = Y(y) * X(x) * Z(z)`.
pub(super) fn euler_yxz(m: &Matrix) -> [f64; 3] {
    let cosine = m[1][0].hypot(m[1][1]);
    let x = (-m[1][2]).atan2(cosine);
    if cosine < GIMBAL {
        [(-m[2][0]).atan2(m[0][0]), x, 0.0]
    } else {
        [m[0][2].atan2(m[2][2]), x, m[1][0].atan2(m[1][1])]
    }
}
