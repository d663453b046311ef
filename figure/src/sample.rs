//! A person's skeleton for tests of what is made on it.

use umo_core::config::Skeleton;
use umo_core::motion::skeleton::JOINTS;

const PARENTS: [i32; JOINTS] = [
    -1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 15, 15, 15, 20, 25, 26, 20, 28, 29, 20,
    31, 32, 20, 34, 35, 20, 37, 38, 21, 40, 41, 21, 43, 44, 21, 46, 47, 21, 49, 50, 21, 52, 53,
];

/// A person of 1.7 m, arms to the sides; by eye, in whole centimetres.
fn offsets() -> Vec<[f32; 3]> {
    let mut cm = vec![
        [0.0, -35.0, 1.0],
        [6.0, -9.0, -1.0],
        [-6.0, -9.0, -1.0],
        [0.0, 11.0, -2.0],
        [5.0, -38.0, 0.0],
        [-5.0, -38.0, 0.0],
        [0.0, 13.0, 0.0],
        [-1.0, -40.0, -4.0],
        [1.0, -40.0, -4.0],
        [0.0, 6.0, 2.0],
        [4.0, -6.0, 12.0],
        [-4.0, -6.0, 12.0],
        [0.0, 21.0, -3.0],
        [7.0, 11.0, -2.0],
        [-7.0, 11.0, -2.0],
        [0.0, 9.0, 5.0],
        [12.0, 4.0, -2.0],
        [-12.0, 4.0, -2.0],
        [26.0, -1.0, -2.0],
        [-26.0, -1.0, -2.0],
        [25.0, 1.0, 0.0],
        [-25.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
        [3.0, 7.0, 6.0],
        [-3.0, 7.0, 6.0],
    ];
    let rows = [2.0, 0.0, -4.0, -2.0];
    for side in [1.0, -1.0] {
        for z in rows {
            cm.extend([[10.0 * side, 0.0, z], [3.0 * side, 0.0, 0.0], [2.0 * side, 0.0, 0.0]]);
        }
        cm.extend([[4.0 * side, -1.0, 3.0], [3.0 * side, 0.0, 2.0], [2.0 * side, 0.0, 2.0]]);
    }
    cm.into_iter().map(|row| row.map(|x| x / 100.0)).collect()
}

/// The skeleton of a person of 1.7 m, arms to the sides.
pub fn skeleton() -> Skeleton {
    Skeleton { parents: PARENTS.to_vec(), offsets_m: offsets() }
}
