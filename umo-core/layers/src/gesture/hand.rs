//! Hand shapes: the bend of each finger.

use std::f32::consts::PI;

use umo_core_pose::rotation::{IDENTITY, Quat, axis_angle_to_quat, product};

use crate::rig::mirrored;

/// Finger joints of one hand: index, middle, pinky, ring, thumb, three each.
pub(crate) const FINGER_JOINTS: usize = 15;

/// Number of angles of a shape.
pub(crate) const ANGLES: usize = 20;

/// Joint angles of a hand, degrees. For index, middle, ring and pinky: the bends of the three joints, and
/// the lean towards the thumb. For the thumb: its angle away from the index, its angle in front of the
/// palm, and the bends of its two outer joints.
pub(crate) type Shape = [f32; ANGLES];

/// Axis of the left thumb's bend: the tip moves across the palm.
const THUMB_BEND: [f32; 3] = [0.41, 0.86, -0.26];

const STRAIGHT: [f32; 4] = [3.0, 4.0, 2.0, 0.0];
const CURLED: [f32; 4] = [82.0, 98.0, 62.0, 0.0];

const fn shape(index: [f32; 4], middle: [f32; 4], ring: [f32; 4], pinky: [f32; 4], thumb: [f32; 4]) -> Shape {
    let fingers = [index, middle, ring, pinky, thumb];
    let mut flat = [0.0; ANGLES];
    let mut at = 0;
    while at < ANGLES {
        flat[at] = fingers[at / 4][at % 4];
        at += 1;
    }
    flat
}

const fn leaning(finger: [f32; 4], lean: f32) -> [f32; 4] {
    [finger[0], finger[1], finger[2], lean]
}

/// Hanging hand.
pub(crate) const RELAXED: Shape = shape(
    [18.0, 24.0, 14.0, 3.0],
    [24.0, 30.0, 17.0, 0.0],
    [29.0, 33.0, 19.0, -2.0],
    [30.0, 34.0, 20.0, -6.0],
    [2.0, 18.0, 10.0, 14.0],
);
/// Fingers straight and together, as for "stop".
pub(super) const FLAT: Shape = shape(
    [2.0, 5.0, 3.0, 1.0],
    [1.0, 5.0, 3.0, 0.0],
    [3.0, 6.0, 4.0, 0.0],
    [5.0, 8.0, 5.0, -2.0],
    [6.0, 10.0, 4.0, 6.0],
);
/// Fingers straight and a little apart, as for a wave.
pub(super) const OPEN: Shape = shape(
    [4.0, 8.0, 4.0, 6.0],
    [3.0, 9.0, 5.0, 1.0],
    [5.0, 11.0, 6.0, -5.0],
    [6.0, 12.0, 7.0, -12.0],
    [14.0, 8.0, 6.0, 8.0],
);
/// Fingers spread, as for five.
pub(super) const FIVE: Shape = shape(
    leaning(STRAIGHT, 11.0),
    leaning(STRAIGHT, 2.0),
    leaning(STRAIGHT, -8.0),
    leaning(STRAIGHT, -18.0),
    [20.0, 4.0, 0.0, 2.0],
);
/// Thumb of a fist: across the fingers.
const OVER_FINGERS: [f32; 4] = [-22.0, 48.0, 26.0, 46.0];
/// Thumb on the palm.
const ON_PALM: [f32; 4] = [-26.0, 52.0, 40.0, 52.0];
/// Index straight, the others curled.
pub(super) const POINT: Shape = shape([1.0, 1.0, 1.0, 0.0], CURLED, CURLED, CURLED, OVER_FINGERS);
/// One: the index.
pub(super) const ONE: Shape = shape(STRAIGHT, CURLED, CURLED, CURLED, OVER_FINGERS);
/// Two: index and middle.
pub(super) const TWO: Shape = shape(leaning(STRAIGHT, 9.0), leaning(STRAIGHT, -7.0), CURLED, CURLED, ON_PALM);
/// Three: without pinky and thumb.
pub(super) const THREE: Shape = shape(leaning(STRAIGHT, 10.0), STRAIGHT, leaning(STRAIGHT, -10.0), CURLED, ON_PALM);
/// Four: without the thumb.
pub(super) const FOUR: Shape =
    shape(leaning(STRAIGHT, 9.0), leaning(STRAIGHT, 2.0), leaning(STRAIGHT, -6.0), leaning(STRAIGHT, -14.0), ON_PALM);
/// Thumb away from a fist.
pub(super) const THUMB: Shape = shape(CURLED, CURLED, CURLED, CURLED, [50.0, -6.0, -8.0, -14.0]);
/// Hand at the chin: index along the cheek, the others loosely curled.
pub(super) const CHIN: Shape = shape(
    [30.0, 38.0, 20.0, 2.0],
    [58.0, 72.0, 40.0, 0.0],
    [64.0, 78.0, 44.0, 0.0],
    [66.0, 80.0, 46.0, -2.0],
    [10.0, 22.0, 0.0, 4.0],
);
/// Cupped hand, as for a clap.
pub(super) const CUP: Shape = shape(
    [10.0, 12.0, 6.0, 2.0],
    [9.0, 12.0, 6.0, 0.0],
    [10.0, 13.0, 7.0, -1.0],
    [12.0, 15.0, 8.0, -4.0],
    [10.0, 14.0, 6.0, 8.0],
);
/// Fingers bent towards the palm but not closed: the end of a beckon.
pub(super) const HOOK: Shape = shape(
    [52.0, 58.0, 26.0, 2.0],
    [58.0, 64.0, 28.0, 0.0],
    [62.0, 66.0, 30.0, -1.0],
    [62.0, 66.0, 30.0, -3.0],
    [6.0, 24.0, 10.0, 16.0],
);
/// Open hand that offers something: its fingers give a little.
pub(super) const OFFER: Shape = shape(
    [8.0, 12.0, 7.0, 5.0],
    [12.0, 16.0, 9.0, 0.0],
    [17.0, 20.0, 11.0, -4.0],
    [20.0, 22.0, 12.0, -10.0],
    [16.0, 10.0, 4.0, 6.0],
);
/// Fingers straight and far apart.
pub(super) const SPREAD: Shape = shape(
    leaning(STRAIGHT, 13.0),
    leaning(STRAIGHT, 3.0),
    leaning(STRAIGHT, -8.0),
    leaning(STRAIGHT, -20.0),
    [38.0, 4.0, -4.0, -4.0],
);
/// Tips of thumb and index in a ring, the others loosely open.
pub(super) const RING: Shape = shape(
    [46.0, 52.0, 25.0, 1.0],
    [26.0, 30.0, 16.0, 0.0],
    [18.0, 24.0, 13.0, -3.0],
    [14.0, 20.0, 11.0, -8.0],
    [1.0, 55.0, 14.0, 24.0],
);
/// A small gap between the tips of thumb and index.
pub(super) const GAP: Shape = shape(
    [42.0, 40.0, 19.0, 4.0],
    [70.0, 86.0, 50.0, 0.0],
    [76.0, 90.0, 54.0, 0.0],
    [78.0, 92.0, 56.0, -2.0],
    [6.0, 50.0, 7.0, 10.0],
);
/// All fingertips at the thumb's.
pub(super) const BUNCH: Shape = shape(
    [51.0, 46.0, 23.0, -7.0],
    [55.0, 46.0, 22.0, 1.0],
    [52.0, 44.0, 20.0, 6.0],
    [47.0, 41.0, 19.0, 11.0],
    [-21.0, 65.0, 8.0, 15.0],
);
/// Fingertips that a thumb rubs, the thumb towards the index.
pub(super) const RUB: Shape = shape(
    [47.0, 45.0, 21.0, -1.0],
    [50.0, 46.0, 22.0, 3.0],
    [62.0, 66.0, 36.0, 0.0],
    [66.0, 70.0, 40.0, -2.0],
    [-4.0, 59.0, 12.0, 19.0],
);
/// The same, the thumb towards the ring finger.
pub(super) const RUB_BACK: Shape = shape(
    [48.0, 48.0, 24.0, -2.0],
    [52.0, 48.0, 24.0, 0.0],
    [62.0, 66.0, 36.0, 0.0],
    [66.0, 70.0, 40.0, -2.0],
    [-16.0, 63.0, 16.0, 24.0],
);
/// A pen between thumb, index and middle.
pub(super) const PEN: Shape = shape(
    [48.0, 45.0, 16.0, 1.0],
    [50.0, 53.0, 27.0, 2.0],
    [66.0, 76.0, 44.0, 0.0],
    [70.0, 80.0, 46.0, -2.0],
    [-9.0, 62.0, 10.0, 18.0],
);
/// A glass in the hand.
pub(super) const GLASS: Shape = shape(
    [34.0, 46.0, 26.0, 3.0],
    [36.0, 48.0, 28.0, 0.0],
    [40.0, 50.0, 28.0, -2.0],
    [44.0, 52.0, 30.0, -4.0],
    [16.0, 57.0, 8.0, 13.0],
);
/// Thumb and pinky out, as a receiver.
pub(super) const PHONE: Shape = shape(CURLED, CURLED, CURLED, leaning(STRAIGHT, -22.0), [50.0, -6.0, -8.0, -14.0]);
/// Index at the temple, the others half curled.
pub(super) const TEMPLE: Shape = shape(
    [10.0, 16.0, 8.0, 3.0],
    [40.0, 52.0, 30.0, 0.0],
    [56.0, 66.0, 38.0, 0.0],
    [62.0, 72.0, 42.0, -3.0],
    [14.0, 34.0, 12.0, 16.0],
);
/// Two, counted from the thumb.
pub(super) const THUMB_AND_INDEX: Shape = shape(STRAIGHT, CURLED, CURLED, CURLED, [50.0, -6.0, -8.0, -14.0]);
/// Three, counted from the thumb.
pub(super) const WITH_MIDDLE: Shape =
    shape(leaning(STRAIGHT, 7.0), leaning(STRAIGHT, -6.0), CURLED, CURLED, [50.0, -6.0, -8.0, -14.0]);

/// Returns the joints of a hand of this shape, in the skeleton's order: of the left hand, else mirrored.
pub(super) fn joints(shape: &Shape, is_left: bool) -> [Quat; FINGER_JOINTS] {
    let angle = |at: usize| shape[at] * PI / 180.0;
    let mut joints = [IDENTITY; FINGER_JOINTS];
    // The skeleton has the pinky before the ring finger.
    for (finger, first) in [(0, 0), (1, 3), (2, 9), (3, 6)] {
        let lean = axis_angle_to_quat([0.0, -angle(4 * finger + 3), 0.0]);
        for bone in 0..3 {
            let bend = axis_angle_to_quat([0.0, 0.0, -angle(4 * finger + bone)]);
            joints[first + bone] = if bone == 0 { product(lean, bend) } else { bend };
        }
    }
    let [away, before] = [angle(16), angle(17)];
    joints[12] = product(axis_angle_to_quat([0.0, -away, 0.0]), axis_angle_to_quat([before, 0.0, 0.0]));
    for bone in [13, 14] {
        joints[bone] = axis_angle_to_quat(THUMB_BEND.map(|axis| axis * angle(bone + 5)));
    }
    if !is_left {
        joints.iter_mut().for_each(|joint| *joint = mirrored(*joint));
    }
    joints
}
