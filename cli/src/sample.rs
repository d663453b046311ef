//! A made-up animation for trying and testing the writers.

use umo_core::config::{Face, FaceKind};
use umo_core::motion::clip::Clip;
use umo_core::motion::skeleton::ARKIT_NAMES;

/// Every joint swings by up to `amount` radians about a wandering axis; every face channel comes
/// and goes.
pub(crate) fn clip(kind: FaceKind, frames: usize, amount: u8) -> Clip {
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
        skeleton: umo_figure::sample::skeleton(),
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
