//! A person's skeleton and an animation of it, for tests.

use umo_core_pose::clip::Clip;
use umo_core_pose::face::{Face, FaceKind};
use umo_core_pose::skeleton::{ARKIT_NAMES, JOINTS, Skeleton};

const PARENTS: [i32; JOINTS] = [
    -1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 15, 15, 15, 20, 25, 26, 20, 28, 29, 20,
    31, 32, 20, 34, 35, 20, 37, 38, 21, 40, 41, 21, 43, 44, 21, 46, 47, 21, 49, 50, 21, 52, 53,
];

/// A person of 1.7 m with arms to the sides; estimated by eye, in whole centimetres.
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

/// A synthetic animation: every joint swings by up to `amount` radians about a varying axis, and every face channel
/// rises and falls.
pub fn clip(kind: FaceKind, frames: usize, amount: u8) -> Clip {
    let names: Vec<String> = match kind {
        FaceKind::Arkit => ARKIT_NAMES.map(str::to_owned).to_vec(),
        FaceKind::SmplxExpression => (0..100).map(|i| format!("expression_{i}")).collect(),
    };
    let rotations = (0..frames)
        .map(|frame| std::array::from_fn(|joint| swing(frame as f32 / 30.0, joint as f32, f32::from(amount))));
    let translation = (0..frames).map(|frame| {
        let t = frame as f32 / 30.0;
        [0.2 * t.sin(), 1.3 + 0.02 * (3.0 * t).cos(), 0.1 * t]
    });
    let count = names.len();
    let value = |i: usize| {
        let (t, channel) = ((i / count) as f32 / 30.0, (i % count) as f32);
        (t * 2.0 + channel).sin().max(0.0)
    };
    Clip {
        frame_rate: 30.0,
        skeleton: skeleton(),
        face: Face { kind, names },
        rotations: rotations.collect(),
        translation: translation.collect(),
        face_values: (0..frames * count).map(value).collect(),
    }
}

fn swing(t: f32, joint: f32, amount: f32) -> [f32; 4] {
    let axis = [(t + joint).sin(), (2.0 * t + joint).cos(), (0.7 * t - joint).sin()];
    let length = axis.iter().map(|x| x * x).sum::<f32>().sqrt().max(1e-3);
    let (sin, cos) = (0.5 * amount * (t * 1.7 + joint).sin()).sin_cos();
    let [x, y, z] = axis.map(|a| a / length * sin);
    let scale = 1.0 / (x * x + y * y + z * z + cos * cos).sqrt();
    [x, y, z, cos].map(|x| x * scale)
}
