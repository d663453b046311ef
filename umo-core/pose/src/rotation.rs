//! Rotations: the networks' 6D form, matrices, unit quaternions and axis-angle vectors (SPEC 2.7).
//!
//! Everything is computed in f64 and rounded once, so that squares neither overflow nor underflow, and the
//! forms agree to f32's precision. Every function returns a valid rotation for every finite input; functions
//! that read 6D values do so for any input.

use umo_core_base::functions::Functions;

/// A unit quaternion `[x, y, z, w]` with `w >= 0`.
pub type Quat = [f32; 4];

/// A rotation matrix that turns column vectors: `matrix[row][column]`.
pub type Matrix = [[f32; 3]; 3];

/// No rotation.
pub const IDENTITY: Quat = [0.0, 0.0, 0.0, 1.0];

type Wide = [f64; 3];

/// Smallest ratio of a row's perpendicular part to the row that may give a direction. Below it, the part is
/// rounding error.
const PARALLEL: f64 = 1e-6;

/// Sine of the half angle below which a quaternion's vector part is taken as linear in the angle.
const SMALL: f64 = 1e-9;

/// Cosine between two quaternions above which they are interpolated linearly: the sine that slerp divides by
/// would vanish.
const ALIGNED: f64 = 1.0 - 1e-9;

#[expect(clippy::cast_possible_truncation, reason = "rounding to f32 once is the contract")]
fn narrow<const N: usize>(v: [f64; N]) -> [f32; N] {
    v.map(|v| v as f32)
}

fn widen<const N: usize>(v: [f32; N]) -> [f64; N] {
    v.map(f64::from)
}

fn dot<const N: usize>(a: [f64; N], b: [f64; N]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn cross(a: Wide, b: Wide) -> Wide {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Scales `v` to length 1, if its length is finite and more than `least`.
fn direction(v: Wide, least: f64) -> Option<Wide> {
    let length = dot(v, v).sqrt();
    (length > least && length.is_finite()).then(|| v.map(|v| v / length))
}

/// Removes the part of `v` along the unit vector `axis` and scales the rest to length 1; `None` if the rest
/// is only rounding error.
fn aside(v: Wide, axis: Wide) -> Option<Wide> {
    let along = dot(axis, v);
    let rest = [v[0] - along * axis[0], v[1] - along * axis[1], v[2] - along * axis[2]];
    direction(rest, PARALLEL * dot(v, v).sqrt())
}

/// Converts two rows of three values to a rotation: normalises the first, makes the second perpendicular to
/// it, and takes their cross product as the third. A row that is zero, not finite or parallel to the first is
/// replaced by an axis, so that zeros give the identity.
fn gram_schmidt(six: [f32; 6]) -> [Wide; 3] {
    let six = widen(six);
    let first = direction([six[0], six[1], six[2]], 0.0).unwrap_or([1.0, 0.0, 0.0]);
    let second = aside([six[3], six[4], six[5]], first)
        .or_else(|| aside([0.0, 1.0, 0.0], first))
        .or_else(|| aside([0.0, 0.0, 1.0], first))
        .expect("no unit vector is parallel to two axes");
    // A second pass removes the rounding error that a long row leaves along `first`.
    let second = aside(second, first).unwrap_or(second);
    [first, second, cross(first, second)]
}

/// Matrix whose first two rows are `six`, orthonormalised by Gram-Schmidt (Zhou et al. 2019, PyTorch3D's
/// order).
#[inline]
pub fn six_to_matrix(six: [f32; 6]) -> Matrix {
    gram_schmidt(six).map(narrow)
}

/// First two rows of a matrix.
#[inline]
pub fn matrix_to_six(matrix: Matrix) -> [f32; 6] {
    let [a, b, _] = matrix;
    [a[0], a[1], a[2], b[0], b[1], b[2]]
}

/// Orthonormalises six values to the first two rows of a rotation, as input of the root network.
#[inline]
pub fn orthonormal_six(six: [f32; 6]) -> [f32; 6] {
    matrix_to_six(six_to_matrix(six))
}

/// Quaternion of the rotation given by two rows (see [`six_to_matrix`]).
#[inline]
pub fn six_to_quat(six: [f32; 6]) -> Quat {
    quat_of(gram_schmidt(six))
}

/// First two rows of a quaternion's matrix.
#[inline]
pub fn quat_to_six(q: Quat) -> [f32; 6] {
    matrix_to_six(quat_to_matrix(q))
}

/// Quaternion of a rotation matrix.
#[inline]
pub fn matrix_to_quat(matrix: Matrix) -> Quat {
    quat_of(matrix.map(widen))
}

/// Computes the quaternion relative to its largest component, which is at least 1/2.
fn quat_of(m: [Wide; 3]) -> Quat {
    let trace = m[0][0] + m[1][1] + m[2][2];
    let largest = (0..3).fold(0, |best, i| if m[i][i] > m[best][best] { i } else { best });
    if trace >= m[largest][largest] {
        return unit([m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1], 1.0 + trace]);
    }
    let (i, j, k) = (largest, (largest + 1) % 3, (largest + 2) % 3);
    let mut q = [0.0; 4];
    q[i] = 1.0 + m[i][i] - m[j][j] - m[k][k];
    q[j] = m[i][j] + m[j][i];
    q[k] = m[i][k] + m[k][i];
    q[3] = m[k][j] - m[j][k];
    unit(q)
}

/// Scales `q` to length 1 with `w >= 0`; returns the identity if it has no direction.
fn unit(q: [f64; 4]) -> Quat {
    let length = dot(q, q).sqrt();
    if !(length > 0.0 && length.is_finite()) {
        return IDENTITY;
    }
    let scale = if q[3] < 0.0 { -length } else { length };
    let [x, y, z, w] = narrow(q.map(|v| v / scale));
    // Turns a `w` of -0 into 0.
    [x, y, z, w.max(0.0) + 0.0]
}

/// Scales `q` to length 1 with `w >= 0`; zeros and non-finite values give the identity.
#[inline]
pub fn normalized(q: Quat) -> Quat {
    unit(widen(q))
}

/// Rotation matrix of a quaternion.
#[inline]
pub fn quat_to_matrix(q: Quat) -> Matrix {
    let [x, y, z, w] = widen(normalized(q));
    // Divided by the squared length of the rounded quaternion, so that rows have length 1 to the last bit.
    let s = 2.0 / dot([x, y, z, w], [x, y, z, w]);
    [
        [1.0 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)],
        [s * (x * y + z * w), 1.0 - s * (x * x + z * z), s * (y * z - x * w)],
        [s * (x * z - y * w), s * (y * z + x * w), 1.0 - s * (x * x + y * y)],
    ]
    .map(narrow)
}

/// Rotation by `b`, then by `a`.
#[inline]
pub fn product(a: Quat, b: Quat) -> Quat {
    let ([ax, ay, az, aw], [bx, by, bz, bw]) = (widen(a), widen(b));
    unit([
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    ])
}

/// Inverse rotation.
#[inline]
pub fn inverse(q: Quat) -> Quat {
    [-q[0], -q[1], -q[2], q[3]]
}

/// Rotates `v` by `q`.
#[inline]
pub fn rotate(q: Quat, v: [f32; 3]) -> [f32; 3] {
    let matrix = quat_to_matrix(q).map(widen);
    narrow(matrix.map(|row| dot(row, widen(v))))
}

/// Rotation axis times the angle in radians, 0 to pi.
#[inline]
pub fn quat_to_axis_angle(q: Quat) -> [f32; 3] {
    let [x, y, z, w] = widen(normalized(q));
    let sine = dot([x, y, z], [x, y, z]).sqrt();
    let per_sine = if sine < SMALL { 2.0 } else { 2.0 * sine.arc_tangent_over(w) / sine };
    narrow([x, y, z].map(|v| v * per_sine))
}

/// Rotation about `v` by its length in radians; any length is allowed.
#[inline]
pub fn axis_angle_to_quat(v: [f32; 3]) -> Quat {
    let v = widen(v);
    let angle = dot(v, v).sqrt();
    if !angle.is_finite() {
        return IDENTITY;
    }
    let per_angle = if angle < SMALL { 0.5 } else { (0.5 * angle).sine() / angle };
    unit([v[0] * per_angle, v[1] * per_angle, v[2] * per_angle, (0.5 * angle).cosine()])
}

/// Spherical linear interpolation along the shorter arc from `a` (at `t` 0) to `b` (at 1).
#[inline]
pub fn slerp(a: Quat, b: Quat, t: f32) -> Quat {
    let (a, b, t) = (widen(normalized(a)), widen(normalized(b)), f64::from(t));
    let cosine = dot(a, b);
    let (cosine, sign) = if cosine < 0.0 { (-cosine, -1.0) } else { (cosine, 1.0) };
    let (from, to) = if cosine > ALIGNED {
        (1.0 - t, t)
    } else {
        let angle = cosine.arc_cosine();
        (((1.0 - t) * angle).sine(), (t * angle).sine())
    };
    unit(std::array::from_fn(|i| from * a[i] + sign * to * b[i]))
}

/// Rotates from `a` by `share` times the rotation from `a` to `b`: 0 gives `a`, 1 gives `b`, more continues
/// beyond it.
#[inline]
pub fn scaled(a: Quat, b: Quat, share: f32) -> Quat {
    product(a, axis_angle_to_quat(quat_to_axis_angle(product(inverse(a), b)).map(|v| v * share)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Ordinary values, zeros, and arbitrary floats.
    fn any_value() -> impl Strategy<Value = f32> {
        prop_oneof![4 => -2.0_f32..2.0, 1 => Just(0.0_f32), 1 => proptest::num::f32::ANY]
    }

    fn six() -> impl Strategy<Value = [f32; 6]> {
        proptest::array::uniform6(any_value())
    }

    fn quat() -> impl Strategy<Value = Quat> {
        proptest::array::uniform4(-1.0_f32..1.0)
            .prop_filter("has a direction", |q| q.iter().map(|v| v * v).sum::<f32>() > 0.01)
            .prop_map(normalized)
    }

    fn assert_rotation(m: Matrix) {
        let m = m.map(widen);
        for (i, &row) in m.iter().enumerate() {
            for (j, &other) in m.iter().enumerate() {
                let want = if i == j { 1.0 } else { 0.0 };
                assert!((dot(row, other) - want).abs() < 4e-7, "{m:?}");
            }
        }
        assert!((dot(cross(m[0], m[1]), m[2]) - 1.0).abs() < 1e-6, "{m:?} mirrors");
    }

    fn near<const N: usize>(a: [f32; N], b: [f32; N], tolerance: f32) -> bool {
        a.iter().zip(b).all(|(a, b)| (a - b).abs() <= tolerance)
    }

    fn same_rotation(a: Quat, b: Quat) -> bool {
        near(a, b, 3e-6) || near(a, b.map(|v| -v), 3e-6)
    }

    /// Textbook Gram-Schmidt, for rows that are well separated.
    fn plain_gram_schmidt(six: [f32; 6]) -> [Wide; 3] {
        let six = widen(six);
        let (a, b): (Wide, Wide) = ([six[0], six[1], six[2]], [six[3], six[4], six[5]]);
        let scaled = |v: Wide| v.map(|x| x / dot(v, v).sqrt());
        let first = scaled(a);
        let along = dot(first, b);
        let second = scaled(std::array::from_fn(|i| b[i] - along * first[i]));
        [first, second, cross(first, second)]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]

        #[test]
        fn any_six_values_give_a_rotation(six in six()) {
            assert_rotation(six_to_matrix(six));
            let q = six_to_quat(six);
            prop_assert!((widen(q).iter().map(|v| v * v).sum::<f64>() - 1.0).abs() < 4e-7);
            prop_assert!(q[3] >= 0.0 && q[3].is_sign_positive());
            prop_assert!(same_rotation(matrix_to_quat(six_to_matrix(six)), q));
        }

        #[test]
        fn six_values_agree_with_the_formula(six in proptest::array::uniform6(-2.0_f32..2.0)) {
            let (a, b) = (widen([six[0], six[1], six[2]]), widen([six[3], six[4], six[5]]));
            prop_assume!(dot(a, a) > 1e-3 && dot(cross(a, b), cross(a, b)) > 1e-3 * dot(a, a) * dot(b, b));
            let want = plain_gram_schmidt(six).map(narrow);
            for (got, want) in six_to_matrix(six).into_iter().zip(want) {
                prop_assert!(near(got, want, 1e-6), "{got:?} {want:?}");
            }
        }

        #[test]
        fn forms_round_trip(q in quat()) {
            assert_rotation(quat_to_matrix(q));
            prop_assert!(same_rotation(matrix_to_quat(quat_to_matrix(q)), q));
            prop_assert!(same_rotation(six_to_quat(quat_to_six(q)), q));
            prop_assert!(same_rotation(axis_angle_to_quat(quat_to_axis_angle(q)), q));
            let six = quat_to_six(q);
            prop_assert!(near(orthonormal_six(six), six, 1e-6));
        }

        #[test]
        fn axis_angle_turns_vectors_as_rodrigues_has_it(
            axis in proptest::array::uniform3(-4.0_f32..4.0),
            v in proptest::array::uniform3(-3.0_f32..3.0),
        ) {
            let (wide, x) = (widen(axis), widen(v));
            let angle = dot(wide, wide).sqrt();
            prop_assume!(angle > 1e-6);
            let k = wide.map(|a| a / angle);
            let (sin, cos) = angle.sin_cos();
            let side = cross(k, x);
            let want = narrow(std::array::from_fn(|i| x[i] * cos + side[i] * sin + k[i] * dot(k, x) * (1.0 - cos)));
            prop_assert!(near(rotate(axis_angle_to_quat(axis), v), want, 4e-6));
        }

        #[test]
        fn a_product_turns_twice(a in quat(), b in quat(), v in proptest::array::uniform3(-1.0_f32..1.0)) {
            prop_assert!(near(rotate(product(a, b), v), rotate(a, rotate(b, v)), 3e-6));
            prop_assert!(same_rotation(product(a, inverse(a)), IDENTITY));
        }

        #[test]
        fn slerp_goes_the_shorter_way_at_even_speed(a in quat(), b in quat(), t in 0.0_f32..1.0) {
            prop_assert!(same_rotation(slerp(a, b, 0.0), a));
            prop_assert!(same_rotation(slerp(a, b, 1.0), b));
            let angle = |p, q| f64::from(quat_to_axis_angle(product(inverse(p), q)).iter().map(|v| v * v).sum::<f32>()).sqrt();
            let whole = angle(a, b);
            // At half a turn both arcs are equally short.
            prop_assume!(whole < 3.1);
            prop_assert!((angle(a, slerp(a, b, t)) - f64::from(t) * whole).abs() < 2e-4);
        }
    }

    proptest! {
        #[test]
        fn a_scaled_turn_is_slerp_and_goes_on_beyond(a in quat(), axis in proptest::array::uniform3(-0.9_f32..0.9), t in 0.0_f32..1.0) {
            let b = product(a, axis_angle_to_quat(axis));
            prop_assert!(same_rotation(scaled(a, b, t), slerp(a, b, t)));
            prop_assert!(same_rotation(scaled(a, b, 2.0), product(b, axis_angle_to_quat(axis))));
        }
    }

    #[test]
    fn degenerate_rows_give_rotations() {
        assert_eq!(six_to_quat([0.0; 6]), IDENTITY);
        assert_eq!(six_to_quat([f32::NAN; 6]), IDENTITY);
        for six in [
            [1.0, 2.0, 3.0, 2.0, 4.0, 6.0],
            [1.0, 2.0, 3.0, -1.0, -2.0, -3.0],
            [0.0, 5.0, 0.0, 0.0, 0.0, 0.0],
            [0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
            [f32::MAX; 6],
            [f32::MIN_POSITIVE, 0.0, 0.0, 0.0, f32::from_bits(1), 0.0],
            [f32::INFINITY, 0.0, 0.0, f32::NEG_INFINITY, f32::NAN, 1.0],
            [1.0, 1e-8, 0.0, 1.0, 0.0, 1e-8],
        ] {
            assert_rotation(six_to_matrix(six));
        }
    }

    #[test]
    fn half_turns_survive() {
        let pi = std::f32::consts::PI;
        for axis in [[pi, 0.0, 0.0], [0.0, pi, 0.0], [0.0, 0.0, pi], [pi * 0.6, -pi * 0.8, 0.0]] {
            let q = axis_angle_to_quat(axis);
            assert_rotation(quat_to_matrix(q));
            let back = quat_to_axis_angle(matrix_to_quat(quat_to_matrix(q)));
            assert!(near(back, axis, 2e-6) || near(back, axis.map(|v| -v), 2e-6), "{axis:?} {back:?}");
        }
    }
}
