use super::super::rotation::*;
use super::*;

const NONE: Matrix = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// Returns the rotation matrix about one axis, by definition.
fn about(axis: usize, angle: f64) -> Matrix {
    let (sin, cos) = angle.sin_cos();
    let (a, b) = ((axis + 1) % 3, (axis + 2) % 3);
    let mut m = NONE;
    m[a][a] = cos;
    m[b][b] = cos;
    m[a][b] = -sin;
    m[b][a] = sin;
    m
}

fn furthest(a: &Matrix, b: &Matrix) -> f64 {
    let pairs = a.as_flattened().iter().zip(b.as_flattened());
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

proptest! {
    #[test]
    fn euler_angles_give_the_rotation_back(q in any_quaternion()) {
        let m = matrix(q);
        let [z, x, y] = euler_zxy(&m);
        let back = product(&product(&about(2, z), &about(0, x)), &about(1, y));
        prop_assert!(furthest(&m, &back) < 1e-8);
        let [y, x, z] = euler_yxz(&m);
        let back = product(&product(&about(1, y), &about(0, x)), &about(2, z));
        prop_assert!(furthest(&m, &back) < 1e-8);
    }

    #[test]
    fn axis_angle_gives_the_rotation_back(q in any_quaternion()) {
        let [x, y, z] = axis_angle(q);
        let angle = (x * x + y * y + z * z).sqrt();
        prop_assert!(angle <= std::f64::consts::PI + 1e-12);
        // Rodrigues' formula.
        let k = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]];
        let kk = product(&k, &k);
        let (s, c) = if angle < 1e-6 {
            (1.0, 0.5)
        } else {
            (angle.sin() / angle, (1.0 - angle.cos()) / (angle * angle))
        };
        let back: Matrix = std::array::from_fn(|i| {
            std::array::from_fn(|j| NONE[i][j] + s * k[i][j] + c * kk[i][j])
        });
        prop_assert!(furthest(&matrix(q), &back) < 1e-9);
    }

    #[test]
    fn matrix_turns_points_as_the_quaternion_does(q in any_quaternion()) {
        let m = matrix(q);
        let q = q.map(f64::from);
        let length = q.iter().map(|x| x * x).sum::<f64>().sqrt();
        for axis in 0..3 {
            let turned = rotate(q.map(|x| x / length), NONE[axis]);
            prop_assert!((0..3).all(|i| (m[i][axis] - turned[i]).abs() < 1e-12));
        }
    }
}
