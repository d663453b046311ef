//! Conversion of quaternions, `[x, y, z, w]`, to the formats' rotations, in f64.

pub(crate) type Matrix = [[f64; 3]; 3];

/// Threshold on the middle angle's cosine; below it the two outer axes coincide (gimbal lock).
const GIMBAL: f64 = 1e-9;

fn normalized(q: [f32; 4]) -> [f64; 4] {
    let q = q.map(f64::from);
    let length = q.iter().map(|x| x * x).sum::<f64>().sqrt();
    q.map(|x| x / length)
}

/// Returns the rotation vector: the axis times the angle in radians, at most pi.
pub(crate) fn axis_angle(q: [f32; 4]) -> [f64; 3] {
    let [x, y, z, w] = normalized(q);
    let sine = (x * x + y * y + z * z).sqrt();
    // For tiny angles the rotation vector is twice the vector part; the quotient would be 0 / 0.
    let scale = if sine < 1e-12 { 2.0 * w.signum() } else { 2.0 * sine.atan2(w.abs()) * w.signum() / sine };
    [x * scale, y * scale, z * scale]
}

/// Returns the rotation matrix, for column vectors.
pub(crate) fn matrix(q: [f32; 4]) -> Matrix {
    let [x, y, z, w] = normalized(q);
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

/// Returns `a * b`: applies `b` first, then `a`.
pub(crate) fn product(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
}

/// Returns the Euler angles in radians about three different axes, the first outermost:
/// `m = A(a) * B(b) * C(c)`.
pub(crate) fn euler(m: &Matrix, [i, j, k]: [usize; 3]) -> [f64; 3] {
    // Positive for X Y Z and its cyclic permutations, negative for the mirrored orders.
    let sign = if (i + 1) % 3 == j { 1.0 } else { -1.0 };
    let cosine = m[i][i].hypot(m[i][j]);
    let middle = (sign * m[i][k]).atan2(cosine);
    if cosine < GIMBAL {
        [(sign * m[k][j]).atan2(m[j][j]), middle, 0.0]
    } else {
        [(-sign * m[j][k]).atan2(m[k][k]), middle, (-sign * m[i][j]).atan2(m[i][i])]
    }
}

/// Returns angles `[z, x, y]` in radians with `m = Z(z) * X(x) * Y(y)`.
pub(crate) fn euler_zxy(m: &Matrix) -> [f64; 3] {
    euler(m, [2, 0, 1])
}

/// Returns angles `[y, x, z]` in radians with `m = Y(y) * X(x) * Z(z)`.
pub(crate) fn euler_yxz(m: &Matrix) -> [f64; 3] {
    euler(m, [1, 0, 2])
}
