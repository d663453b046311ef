//! Small differences between the left and right of the face.

use umo_core_base::state::{StateError, StatePass};
use umo_core_pose::frame::OwnedFrame;

use super::Tick;
use super::noise::{Stream, smooth, uniform};
use super::rig::arkit;

/// Pairs of shapes, left before right, and their largest asymmetry: one side is larger by up to this
/// share, the other smaller. Lids, gaze and shapes that close the lips stay symmetric.
const PAIRS: [(usize, usize, f32); 13] = [
    (arkit("browDownLeft"), arkit("browDownRight"), 0.15),
    (arkit("browOuterUpLeft"), arkit("browOuterUpRight"), 0.2),
    (arkit("eyeSquintLeft"), arkit("eyeSquintRight"), 0.12),
    (arkit("eyeWideLeft"), arkit("eyeWideRight"), 0.1),
    (arkit("cheekSquintLeft"), arkit("cheekSquintRight"), 0.15),
    (arkit("noseSneerLeft"), arkit("noseSneerRight"), 0.15),
    (arkit("mouthSmileLeft"), arkit("mouthSmileRight"), 0.15),
    (arkit("mouthFrownLeft"), arkit("mouthFrownRight"), 0.15),
    (arkit("mouthDimpleLeft"), arkit("mouthDimpleRight"), 0.15),
    (arkit("mouthStretchLeft"), arkit("mouthStretchRight"), 0.12),
    (arkit("mouthPressLeft"), arkit("mouthPressRight"), 0.1),
    (arkit("mouthLowerDownLeft"), arkit("mouthLowerDownRight"), 0.1),
    (arkit("mouthUpperUpLeft"), arkit("mouthUpperUpRight"), 0.1),
];

/// Direction changes per second.
const RATE: f64 = 0.35;

const NOISE: u32 = 400;
const HABIT: Stream = Stream(410);

/// Asymmetry of the face. Stateless: its effect depends only on the seed and the tick's number.
#[derive(Debug)]
pub(super) struct Asymmetry {}

impl Asymmetry {
    pub(crate) fn new() -> Self {
        Self {}
    }

    /// Applies one tick to the frame.
    #[expect(clippy::unused_self, reason = "as the other layers")]
    pub(crate) fn apply(&mut self, frame: &mut OwnedFrame, tick: &Tick) {
        if tick.rig.shapes.iter().all(Option::is_none) {
            return;
        }
        let mut noise = [0.0; 4];
        for (number, &(left, right, most)) in (0_u32..).zip(&PAIRS) {
            let lane = number as usize % noise.len();
            if lane == 0 {
                noise = smooth(tick.seed, Stream(NOISE + number / 4), tick.time(), RATE);
            }
            // A constant preferred side, and a variation around it.
            let habit = 2.0 * uniform(tick.seed, HABIT, number.into()) - 1.0;
            let apart = tick.gain * most * (0.4 * habit + 1.2 * noise[lane]).clamp(-1.0, 1.0);
            for (shape, scale) in [(left, 1.0 + apart), (right, 1.0 - apart)] {
                let value = tick.rig.shape(&frame.face, shape);
                tick.rig.set_shape(&mut frame.face, shape, value * scale);
            }
        }
    }

    /// Saves or loads the layer between two ticks.
    #[expect(clippy::unused_self, clippy::unnecessary_wraps, reason = "as the other layers")]
    pub(crate) fn state(&mut self, _pass: &mut StatePass) -> Result<(), StateError> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use umo_core_pose::skeleton::ARKIT_NAMES;

    use super::super::Layer;
    use super::super::trial::Trial;
    use super::*;

    #[test]
    fn sides_differ_a_little_and_slowly_and_lips_stay_as_they_are() {
        let mut trial = Trial::new(&[Layer::Asymmetry], 5);
        trial.frame.face.fill(0.5);
        let shown = trial.ticks(3000);
        for &(left, right, most) in &PAIRS {
            let apart = |index: usize| (shown[index].face[left] - shown[index].face[right]) / 0.5;
            let largest = (0..3000).map(|i| apart(i).abs()).fold(0.0, f32::max);
            assert!(largest > 0.4 * most && largest <= 2.0 * most + 1e-5, "{} {largest}", ARKIT_NAMES[left]);
            assert!((1..3000).all(|i| (apart(i) - apart(i - 1)).abs() < 0.02));
            // The sum of both sides is unchanged.
            assert!(shown.iter().all(|frame| (frame.face[left] + frame.face[right] - 1.0).abs() < 1e-5));
        }
        let is_paired = |shape: usize| PAIRS.iter().any(|&(left, right, _)| left == shape || right == shape);
        for shape in (0..ARKIT_NAMES.len()).filter(|&shape| !is_paired(shape)) {
            assert!(shown.iter().all(|frame| frame.face[shape] == 0.5), "{}", ARKIT_NAMES[shape]);
        }
    }

    #[test]
    fn a_face_at_rest_stays_at_rest() {
        let mut trial = Trial::new(&[Layer::Asymmetry], 5);
        assert!(trial.ticks(100).iter().all(|frame| frame.face.iter().all(|&value| value == 0.0)));
    }
}
