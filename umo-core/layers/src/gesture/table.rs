//! Built-in gestures.
//!
//! Times are seconds from the end of the preparation. Positions and directions of hands are as in
//! [`ArmTarget`](super::arm::ArmTarget); angles are degrees. One-handed gestures are defined for the
//! right hand.

use super::arm::Vec3;
use super::hand::{self, Shape};
use super::set::GestureParts;
use super::speech::SPEECH;
use crate::rig::arkit;

/// Quantity that a track adds to the model's motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Channel {
    /// Positive is down.
    HeadPitch,
    /// Positive is to the left.
    HeadYaw,
    /// Positive is towards the right shoulder.
    HeadRoll,
    /// Positive is forwards.
    TrunkPitch,
    TrunkYaw,
    TrunkRoll,
    /// Bend of the trunk over standing legs; positive is forwards.
    HipPitch,
    /// Both shoulders; positive is up.
    Collars,
    /// Face shape by its index.
    Face(usize),
}

/// Value over time; begins and ends at 0.
#[derive(Clone, Copy, Debug)]
pub(super) struct Track {
    pub(super) channel: Channel,
    pub(super) keys: &'static [(f32, f32)],
}

/// Pose of an arm at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Key {
    pub(super) at: f32,
    pub(super) hand: Vec3,
    pub(super) elbow: Vec3,
    pub(super) fingers: Vec3,
    pub(super) palm: Vec3,
    pub(super) shape: Shape,
}

/// Arms that follow a gesture's keys.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Arms {
    None,
    /// The arm of the gesture's side, or both at the host's request.
    One,
    Both,
    /// Both, in exact synchrony.
    Together,
    /// Both, the second by keys of its own.
    Pair(&'static [Key]),
    /// One arm, which points at a place and has no keys.
    Pointing,
}

/// A built-in gesture, or a variant of one: those of one name differ in their poses.
#[derive(Clone, Copy, Debug)]
pub(super) struct Motion {
    pub(super) name: &'static str,
    /// Other names, also recognized in a text.
    pub(super) words: &'static [&'static str],
    /// Parts that no other gesture may move at the same time; motion of other parts is added up.
    pub(super) parts: GestureParts,
    /// Duration of the preparation (fade-in).
    pub(super) preparation: f32,
    /// From the end of the preparation to the stroke.
    pub(super) stroke: f32,
    /// From the end of the preparation to the end of the hold.
    pub(super) length: f32,
    /// Duration of the retraction (fade-out).
    pub(super) retraction: f32,
    pub(super) arms: Arms,
    pub(super) keys: &'static [Key],
    pub(super) tracks: &'static [Track],
    /// Whether it is of the left hand, unless the host says which.
    pub(super) is_left: bool,
    /// Whether the place of the hand may vary: it touches nothing.
    pub(super) is_free: bool,
}

pub(super) const fn key(at: f32, hand: Vec3, elbow: Vec3, fingers: Vec3, palm: Vec3, shape: Shape) -> Key {
    Key { at, hand, elbow, fingers, palm, shape }
}

pub(super) const fn track(channel: Channel, keys: &'static [(f32, f32)]) -> Track {
    Track { channel, keys }
}

/// Track of a face shape.
pub(super) const fn face(name: &str, keys: &'static [(f32, f32)]) -> Track {
    track(Channel::Face(arkit(name)), keys)
}

use Channel::{Collars, HeadPitch, HeadRoll, HeadYaw, HipPitch, TrunkPitch, TrunkRoll, TrunkYaw};

pub(super) const HEAD: GestureParts = GestureParts::HEAD;
pub(super) const ARM: GestureParts = GestureParts::RIGHT_ARM;
pub(super) const ARMS: GestureParts = GestureParts::LEFT_ARM.union(GestureParts::RIGHT_ARM);

pub(super) const ELBOW_LOW: Vec3 = [0.35, -1.0, -0.35];
pub(super) const ELBOW_OUT: Vec3 = [0.8, -0.9, -0.2];

/// Key of a waving hand: `lean` is how far the forearm leans outwards.
pub(super) const fn waving(at: f32, lean: f32) -> Key {
    key(
        at,
        [0.43 + 0.22 * lean, 0.33 - 0.03 * lean, 0.34],
        ELBOW_OUT,
        [0.06 + 0.55 * lean, 1.0, 0.08],
        [-0.12, 0.0, 1.0],
        hand::OPEN,
    )
}

/// Key of a hand that shows a number: `lift` raises it for the beat of its arrival.
pub(super) const fn showing(at: f32, lift: f32, shape: Shape) -> Key {
    key(at, [0.34, 0.02 + lift, 0.50], ELBOW_LOW, [-0.06, 1.0, 0.12], [-0.2, 0.0, 1.0], shape)
}

/// Keys of a number that is shown once.
const fn shown(shape: Shape) -> [Key; 4] {
    [showing(0.0, 0.07, shape), showing(0.16, 0.0, shape), showing(0.5, 0.012, shape), showing(0.8, 0.0, shape)]
}

pub(super) const SHOW_TRACKS: &[Track] = &[
    track(HeadPitch, &[(-0.3, 0.0), (0.05, 3.0), (0.35, 1.0), (0.9, 1.0), (1.3, 0.0)]),
    face("browInnerUp", &[(-0.3, 0.0), (0.1, 0.22), (0.7, 0.12), (1.2, 0.0)]),
];

const fn count(name: &'static str, words: &'static [&'static str], keys: &'static [Key; 4]) -> Motion {
    Motion {
        name,
        words,
        parts: ARM,
        preparation: 0.62,
        stroke: 0.12,
        length: 0.8,
        retraction: 0.65,
        arms: Arms::One,
        keys,
        tracks: SHOW_TRACKS,
        is_left: false,
        is_free: true,
    }
}

/// Every built-in gesture, and its variants after it.
pub(super) static MOTIONS: [Motion; ACTIONS.len() + SPEECH.len()] = {
    let mut all = [ACTIONS[0]; ACTIONS.len() + SPEECH.len()];
    let mut at = 1;
    while at < all.len() {
        all[at] = if at < ACTIONS.len() { ACTIONS[at] } else { SPEECH[at - ACTIONS.len()] };
        at += 1;
    }
    all
};

/// Gestures that act alone.
const ACTIONS: [Motion; 18] = [
    Motion {
        name: "nod",
        words: &["nods", "nodding", "yes", "agree", "agrees"],
        parts: HEAD,
        preparation: 0.16,
        stroke: 0.17,
        length: 0.72,
        retraction: 0.36,
        arms: Arms::None,
        keys: &[],
        tracks: &[
            track(
                HeadPitch,
                &[
                    (-0.16, 0.0),
                    (0.0, -2.5),
                    (0.17, 13.0),
                    (0.37, -1.0),
                    (0.54, 9.0),
                    (0.72, 0.5),
                    (0.86, 4.0),
                    (1.08, 0.0),
                ],
            ),
            track(TrunkPitch, &[(-0.1, 0.0), (0.24, 1.8), (0.7, 1.0), (1.08, 0.0)]),
            face("eyeBlinkLeft", &[(0.05, 0.0), (0.17, 0.30), (0.32, 0.0)]),
            face("eyeBlinkRight", &[(0.05, 0.0), (0.17, 0.30), (0.32, 0.0)]),
            face("mouthSmileLeft", &[(-0.1, 0.0), (0.3, 0.14), (0.7, 0.12), (1.08, 0.0)]),
            face("mouthSmileRight", &[(-0.1, 0.0), (0.32, 0.12), (0.7, 0.10), (1.08, 0.0)]),
        ],
        is_left: false,
        is_free: true,
    },
    Motion {
        name: "shake",
        words: &[
            "shakes_head",
            "shake_head",
            "shakes_his_head",
            "shakes_her_head",
            "shaking_head",
            "no",
            "disagree",
            "disagrees",
        ],
        parts: HEAD,
        preparation: 0.2,
        stroke: 0.14,
        length: 1.0,
        retraction: 0.4,
        arms: Arms::None,
        keys: &[],
        tracks: &[
            track(
                HeadYaw,
                &[
                    (-0.2, 0.0),
                    (-0.06, 3.0),
                    (0.14, -17.0),
                    (0.40, 18.0),
                    (0.64, -13.0),
                    (0.88, 10.0),
                    (1.08, -3.0),
                    (1.4, 0.0),
                ],
            ),
            track(HeadPitch, &[(-0.2, 0.0), (0.2, 4.0), (0.9, 3.0), (1.4, 0.0)]),
            track(TrunkYaw, &[(-0.1, 0.0), (0.2, -1.6), (0.46, 1.8), (0.7, -1.2), (1.0, 0.6), (1.4, 0.0)]),
            face("browInnerUp", &[(-0.15, 0.0), (0.2, 0.18), (0.9, 0.10), (1.4, 0.0)]),
            face("mouthPressLeft", &[(-0.15, 0.0), (0.25, 0.22), (0.9, 0.16), (1.4, 0.0)]),
            face("mouthPressRight", &[(-0.15, 0.0), (0.25, 0.26), (0.9, 0.18), (1.4, 0.0)]),
        ],
        is_left: false,
        is_free: true,
    },
    Motion {
        name: "shrug",
        words: &["shrugs", "shrugging", "dont_know", "do_not_know", "no_idea"],
        parts: ARMS,
        preparation: 0.54,
        stroke: 0.0,
        length: 0.62,
        retraction: 0.62,
        arms: Arms::Both,
        keys: &[
            key(0.0, [0.47, -0.38, 0.38], ELBOW_LOW, [0.95, 0.18, 0.65], [-0.15, 1.0, 0.30], hand::OPEN),
            key(0.22, [0.45, -0.43, 0.38], ELBOW_LOW, [0.90, 0.06, 0.70], [-0.10, 1.0, 0.25], hand::OPEN),
            key(0.62, [0.45, -0.42, 0.39], ELBOW_LOW, [0.90, 0.08, 0.70], [-0.10, 1.0, 0.25], hand::OPEN),
        ],
        tracks: &[
            track(Collars, &[(-0.42, 0.0), (0.0, 27.0), (0.2, 23.0), (0.5, 22.0), (0.98, 0.0)]),
            track(HeadRoll, &[(-0.4, 0.0), (0.05, 8.0), (0.5, 7.0), (1.1, 0.0)]),
            track(HeadPitch, &[(-0.4, 0.0), (0.0, -2.0), (0.5, 1.0), (1.1, 0.0)]),
            track(TrunkPitch, &[(-0.4, 0.0), (0.0, -2.0), (0.5, -1.5), (1.1, 0.0)]),
            face("browInnerUp", &[(-0.4, 0.0), (-0.05, 0.55), (0.5, 0.45), (1.0, 0.0)]),
            face("browOuterUpLeft", &[(-0.4, 0.0), (-0.05, 0.45), (0.5, 0.35), (1.0, 0.0)]),
            face("browOuterUpRight", &[(-0.4, 0.0), (-0.05, 0.55), (0.5, 0.42), (1.0, 0.0)]),
            face("mouthShrugLower", &[(-0.35, 0.0), (0.0, 0.45), (0.5, 0.4), (1.0, 0.0)]),
            face("mouthFrownLeft", &[(-0.35, 0.0), (0.0, 0.32), (0.5, 0.26), (1.0, 0.0)]),
            face("mouthFrownRight", &[(-0.35, 0.0), (0.0, 0.26), (0.5, 0.22), (1.0, 0.0)]),
        ],
        is_left: false,
        is_free: true,
    },
    Motion {
        name: "wave",
        words: &["waves", "waving", "hello", "hi", "greet", "greets", "goodbye", "bye"],
        parts: ARM,
        preparation: 0.74,
        stroke: 0.0,
        length: 1.42,
        retraction: 0.8,
        arms: Arms::One,
        keys: &[
            waving(0.0, 0.5),
            waving(0.24, -0.42),
            waving(0.48, 0.52),
            waving(0.72, -0.40),
            waving(0.97, 0.46),
            waving(1.22, -0.25),
            waving(1.42, 0.02),
        ],
        tracks: &[
            track(HeadRoll, &[(-0.5, 0.0), (0.1, 5.0), (1.1, 4.0), (1.9, 0.0)]),
            track(HeadPitch, &[(-0.5, 0.0), (-0.15, -3.0), (0.6, -1.0), (1.9, 0.0)]),
            track(TrunkRoll, &[(-0.5, 0.0), (0.0, -2.5), (1.3, -2.0), (2.1, 0.0)]),
            track(TrunkYaw, &[(-0.5, 0.0), (0.0, 3.0), (1.3, 2.5), (2.1, 0.0)]),
            face("browInnerUp", &[(-0.4, 0.0), (-0.05, 0.35), (0.6, 0.15), (1.6, 0.0)]),
            face("browOuterUpLeft", &[(-0.4, 0.0), (-0.05, 0.28), (0.6, 0.10), (1.6, 0.0)]),
            face("browOuterUpRight", &[(-0.4, 0.0), (-0.05, 0.25), (0.6, 0.10), (1.6, 0.0)]),
            face("mouthSmileLeft", &[(-0.3, 0.0), (0.2, 0.52), (1.4, 0.42), (2.1, 0.0)]),
            face("mouthSmileRight", &[(-0.3, 0.0), (0.22, 0.46), (1.4, 0.38), (2.1, 0.0)]),
            face("cheekSquintLeft", &[(-0.2, 0.0), (0.25, 0.28), (1.4, 0.2), (2.0, 0.0)]),
            face("cheekSquintRight", &[(-0.2, 0.0), (0.25, 0.25), (1.4, 0.18), (2.0, 0.0)]),
        ],
        is_left: false,
        is_free: true,
    },
    Motion {
        name: "bow",
        words: &["bows", "bowing"],
        parts: ARMS.union(HEAD).union(GestureParts::TRUNK),
        preparation: 0.55,
        stroke: 0.5,
        length: 0.95,
        retraction: 0.95,
        arms: Arms::Both,
        keys: &[
            key(0.0, [0.13, -0.93, 0.16], [0.5, -0.4, -0.9], [-0.02, -1.0, 0.12], [-1.0, 0.0, -0.1], hand::RELAXED),
            key(0.5, [0.04, -0.84, 0.36], [0.7, -0.4, -0.7], [-0.05, -1.0, 0.30], [-0.8, 0.0, -0.6], hand::RELAXED),
            key(0.95, [0.05, -0.85, 0.34], [0.7, -0.4, -0.7], [-0.05, -1.0, 0.30], [-0.8, 0.0, -0.6], hand::RELAXED),
        ],
        tracks: &[
            track(HipPitch, &[(-0.45, 0.0), (-0.30, -1.2), (0.5, 23.0), (0.72, 22.4), (0.95, 22.0), (1.85, 0.0)]),
            track(TrunkPitch, &[(-0.45, 0.0), (-0.30, -1.0), (0.55, 19.0), (0.95, 18.5), (1.9, 0.0)]),
            track(HeadPitch, &[(-0.5, 0.0), (0.40, 15.0), (0.9, 15.0), (1.55, -1.5), (1.9, 0.0)]),
            face("eyeBlinkLeft", &[(-0.2, 0.0), (0.35, 0.55), (0.95, 0.5), (1.5, 0.0)]),
            face("eyeBlinkRight", &[(-0.2, 0.0), (0.35, 0.55), (0.95, 0.5), (1.5, 0.0)]),
        ],
        is_left: false,
        is_free: false,
    },
    Motion {
        name: "point",
        words: &["points", "pointing", "point_at", "points_at"],
        parts: ARM,
        preparation: 0.64,
        stroke: 0.0,
        length: 0.9,
        retraction: 0.75,
        arms: Arms::Pointing,
        keys: &[],
        tracks: &[
            track(HeadPitch, &[(-0.4, 0.0), (0.05, 2.0), (0.9, 1.0), (1.4, 0.0)]),
            face("browInnerUp", &[(-0.4, 0.0), (0.0, 0.22), (0.8, 0.12), (1.4, 0.0)]),
        ],
        is_left: false,
        is_free: true,
    },
    Motion {
        name: "count",
        words: &["counts", "counting", "count_to_five"],
        parts: ARM,
        preparation: 0.62,
        stroke: 0.12,
        length: 3.1,
        retraction: 0.65,
        arms: Arms::One,
        keys: &[
            showing(0.00, 0.07, hand::ONE),
            showing(0.14, 0.00, hand::ONE),
            showing(0.40, 0.00, hand::ONE),
            showing(0.66, 0.05, hand::TWO),
            showing(0.80, 0.00, hand::TWO),
            showing(1.04, 0.00, hand::TWO),
            showing(1.30, 0.05, hand::THREE),
            showing(1.44, 0.00, hand::THREE),
            showing(1.68, 0.00, hand::THREE),
            showing(1.94, 0.05, hand::FOUR),
            showing(2.08, 0.00, hand::FOUR),
            showing(2.32, 0.00, hand::FOUR),
            showing(2.58, 0.06, hand::FIVE),
            showing(2.72, 0.00, hand::FIVE),
            showing(3.10, 0.00, hand::FIVE),
        ],
        tracks: &[
            track(
                HeadPitch,
                &[
                    (-0.3, 0.0),
                    (0.1, 3.0),
                    (0.4, 0.5),
                    (0.78, 3.0),
                    (1.04, 0.5),
                    (1.42, 3.0),
                    (1.68, 0.5),
                    (2.06, 3.0),
                    (2.32, 0.5),
                    (2.7, 4.0),
                    (3.5, 0.0),
                ],
            ),
            face("browInnerUp", &[(-0.3, 0.0), (0.1, 0.2), (2.6, 0.12), (3.3, 0.0)]),
        ],
        is_left: false,
        is_free: true,
    },
    count("count_one", &["one"], &shown(hand::ONE)),
    count("count_two", &["two"], &shown(hand::TWO)),
    count("count_three", &["three"], &shown(hand::THREE)),
    count("count_four", &["four"], &shown(hand::FOUR)),
    count("count_five", &["five"], &shown(hand::FIVE)),
    Motion {
        name: "thumbs_up",
        words: &["thumb_up", "well_done"],
        parts: ARM,
        preparation: 0.58,
        stroke: 0.0,
        length: 0.85,
        retraction: 0.65,
        arms: Arms::One,
        keys: &[
            key(0.0, [0.10, -0.16, 0.62], ELBOW_LOW, [-0.42, 0.05, 1.0], [-1.0, 0.0, -0.42], hand::THUMB),
            key(0.18, [0.10, -0.21, 0.66], ELBOW_LOW, [-0.42, 0.0, 1.0], [-1.0, 0.0, -0.42], hand::THUMB),
            key(0.85, [0.11, -0.20, 0.65], ELBOW_LOW, [-0.42, 0.02, 1.0], [-1.0, 0.0, -0.42], hand::THUMB),
        ],
        tracks: &[
            track(HeadPitch, &[(-0.35, 0.0), (-0.1, -2.0), (0.16, 5.0), (0.45, 1.0), (1.3, 0.0)]),
            track(HeadRoll, &[(-0.35, 0.0), (0.1, 3.5), (0.8, 3.0), (1.4, 0.0)]),
            track(TrunkPitch, &[(-0.35, 0.0), (0.16, 1.5), (0.8, 1.0), (1.4, 0.0)]),
            face("browOuterUpLeft", &[(-0.3, 0.0), (0.0, 0.30), (0.6, 0.12), (1.3, 0.0)]),
            face("browOuterUpRight", &[(-0.3, 0.0), (0.0, 0.34), (0.6, 0.14), (1.3, 0.0)]),
            face("mouthSmileLeft", &[(-0.3, 0.0), (0.12, 0.48), (0.85, 0.4), (1.5, 0.0)]),
            face("mouthSmileRight", &[(-0.3, 0.0), (0.14, 0.43), (0.85, 0.35), (1.5, 0.0)]),
            face("cheekSquintLeft", &[(-0.2, 0.0), (0.15, 0.25), (0.85, 0.2), (1.4, 0.0)]),
            face("cheekSquintRight", &[(-0.2, 0.0), (0.15, 0.22), (0.85, 0.18), (1.4, 0.0)]),
        ],
        is_left: false,
        is_free: true,
    },
    Motion {
        name: "think",
        words: &["thinks", "thinking", "ponder", "ponders", "wonder", "wonders"],
        parts: ARM,
        preparation: 0.65,
        stroke: 0.0,
        length: 1.7,
        retraction: 0.8,
        arms: Arms::One,
        keys: &[
            key(0.0, [-0.29, -0.02, 0.43], ELBOW_LOW, [-0.35, 1.0, -0.45], [-0.55, -0.35, -0.75], hand::CHIN),
            key(0.8, [-0.29, -0.015, 0.425], ELBOW_LOW, [-0.36, 1.0, -0.47], [-0.55, -0.35, -0.75], hand::CHIN),
            key(1.7, [-0.29, -0.02, 0.43], ELBOW_LOW, [-0.35, 1.0, -0.45], [-0.55, -0.35, -0.75], hand::CHIN),
        ],
        tracks: &[
            track(HeadPitch, &[(-0.5, 0.0), (0.1, 4.0), (0.7, 1.0), (1.6, 3.0), (2.4, 0.0)]),
            track(HeadRoll, &[(-0.5, 0.0), (0.2, 6.0), (1.6, 5.0), (2.4, 0.0)]),
            track(HeadYaw, &[(-0.5, 0.0), (0.1, 7.0), (0.8, 10.0), (1.6, 8.0), (2.4, 0.0)]),
            track(TrunkPitch, &[(-0.5, 0.0), (0.1, 2.5), (1.6, 2.0), (2.4, 0.0)]),
            face("eyeLookUpLeft", &[(-0.3, 0.0), (0.05, 0.45), (1.3, 0.38), (1.9, 0.0)]),
            face("eyeLookUpRight", &[(-0.3, 0.0), (0.05, 0.45), (1.3, 0.38), (1.9, 0.0)]),
            face("eyeLookOutLeft", &[(-0.3, 0.0), (0.05, 0.35), (1.3, 0.28), (1.9, 0.0)]),
            face("eyeLookInRight", &[(-0.3, 0.0), (0.05, 0.35), (1.3, 0.28), (1.9, 0.0)]),
            face("browInnerUp", &[(-0.3, 0.0), (0.1, 0.20), (1.4, 0.15), (2.1, 0.0)]),
            face("browOuterUpLeft", &[(-0.3, 0.0), (0.1, 0.30), (1.4, 0.25), (2.1, 0.0)]),
            face("browDownRight", &[(-0.3, 0.0), (0.1, 0.22), (1.4, 0.18), (2.1, 0.0)]),
            face("mouthPressLeft", &[(-0.3, 0.0), (0.1, 0.25), (1.4, 0.2), (2.1, 0.0)]),
            face("mouthPressRight", &[(-0.3, 0.0), (0.1, 0.30), (1.4, 0.25), (2.1, 0.0)]),
        ],
        is_left: false,
        is_free: false,
    },
    Motion {
        name: "clap",
        words: &["claps", "clapping", "applaud", "applauds"],
        parts: ARMS,
        preparation: 0.5,
        stroke: 0.16,
        length: 1.5,
        retraction: 0.65,
        arms: Arms::Together,
        keys: &[
            clapping(0.0, 1.0),
            clapping(0.16, 0.0),
            clapping(0.32, 0.9),
            clapping(0.48, 0.0),
            clapping(0.64, 0.95),
            clapping(0.80, 0.0),
            clapping(0.96, 0.9),
            clapping(1.12, 0.0),
            clapping(1.28, 0.7),
            clapping(1.42, 0.0),
            clapping(1.5, 0.05),
        ],
        tracks: &[
            track(HeadPitch, &[(-0.4, 0.0), (0.16, 3.0), (0.6, 1.5), (1.3, 2.5), (2.0, 0.0)]),
            face("mouthSmileLeft", &[(-0.3, 0.0), (0.2, 0.52), (1.5, 0.44), (2.1, 0.0)]),
            face("mouthSmileRight", &[(-0.3, 0.0), (0.22, 0.48), (1.5, 0.4), (2.1, 0.0)]),
            face("cheekSquintLeft", &[(-0.2, 0.0), (0.25, 0.25), (1.5, 0.2), (2.0, 0.0)]),
            face("cheekSquintRight", &[(-0.2, 0.0), (0.25, 0.22), (1.5, 0.18), (2.0, 0.0)]),
        ],
        is_left: false,
        is_free: false,
    },
    Motion {
        name: "beckon",
        words: &["beckons", "beckoning", "come", "come_here"],
        parts: ARM,
        preparation: 0.6,
        stroke: 0.2,
        length: 0.95,
        retraction: 0.65,
        arms: Arms::One,
        keys: &[
            key(0.0, [0.22, -0.10, 0.74], ELBOW_LOW, [-0.05, 0.25, 1.0], [-0.25, 1.0, -0.25], hand::FLAT),
            key(0.24, [0.18, -0.03, 0.60], ELBOW_LOW, [-0.20, 0.95, 0.55], [-0.25, 0.55, -1.0], hand::HOOK),
            key(0.46, [0.21, -0.08, 0.70], ELBOW_LOW, [-0.08, 0.40, 1.0], [-0.25, 1.0, -0.40], hand::FLAT),
            key(0.70, [0.18, -0.02, 0.58], ELBOW_LOW, [-0.20, 1.0, 0.50], [-0.25, 0.50, -1.0], hand::HOOK),
            key(0.95, [0.19, -0.05, 0.61], ELBOW_LOW, [-0.18, 0.85, 0.65], [-0.25, 0.60, -0.9], hand::RELAXED),
        ],
        tracks: &[
            track(HeadPitch, &[(-0.4, 0.0), (0.0, 2.0), (0.24, -3.0), (0.46, 1.0), (0.7, -2.5), (1.4, 0.0)]),
            track(TrunkPitch, &[(-0.4, 0.0), (0.05, 2.5), (0.7, 1.0), (1.4, 0.0)]),
            face("browInnerUp", &[(-0.4, 0.0), (0.1, 0.3), (0.7, 0.2), (1.4, 0.0)]),
        ],
        is_left: false,
        is_free: true,
    },
    Motion {
        name: "stop",
        words: &["stops", "halt"],
        parts: ARM,
        preparation: 0.6,
        stroke: 0.0,
        length: 0.95,
        retraction: 0.7,
        arms: Arms::One,
        keys: &[
            key(0.0, [0.14, 0.02, 0.86], ELBOW_LOW, [-0.05, 1.0, 0.02], [-0.10, 0.0, 1.0], hand::FLAT),
            key(0.16, [0.14, 0.0, 0.80], ELBOW_LOW, [-0.05, 1.0, 0.10], [-0.10, 0.0, 1.0], hand::FLAT),
            key(0.95, [0.14, 0.0, 0.80], ELBOW_LOW, [-0.05, 1.0, 0.10], [-0.10, 0.0, 1.0], hand::FLAT),
        ],
        tracks: &[
            track(HeadPitch, &[(-0.4, 0.0), (0.0, 3.0), (0.8, 2.0), (1.5, 0.0)]),
            track(TrunkYaw, &[(-0.4, 0.0), (0.0, 5.0), (0.9, 4.0), (1.6, 0.0)]),
            face("browDownLeft", &[(-0.3, 0.0), (0.05, 0.2), (0.8, 0.15), (1.5, 0.0)]),
            face("browDownRight", &[(-0.3, 0.0), (0.05, 0.2), (0.8, 0.15), (1.5, 0.0)]),
        ],
        is_left: false,
        is_free: true,
    },
    Motion {
        name: "me",
        words: &["myself", "points_at_itself", "point_at_yourself"],
        parts: ARM,
        preparation: 0.5,
        stroke: 0.0,
        length: 0.6,
        retraction: 0.65,
        arms: Arms::One,
        keys: &[
            key(0.0, [-0.08, -0.26, 0.33], ELBOW_OUT, [-1.0, 0.35, 0.05], [-0.1, 0.0, -1.0], hand::FLAT),
            key(0.18, [-0.08, -0.27, 0.29], ELBOW_OUT, [-1.0, 0.35, 0.05], [-0.1, 0.0, -1.0], hand::RELAXED),
            key(0.6, [-0.08, -0.27, 0.29], ELBOW_OUT, [-1.0, 0.35, 0.05], [-0.1, 0.0, -1.0], hand::RELAXED),
        ],
        tracks: &[
            track(HeadPitch, &[(-0.35, 0.0), (0.0, 4.0), (0.3, 1.5), (1.2, 0.0)]),
            face("browInnerUp", &[(-0.35, 0.0), (0.0, 0.3), (0.5, 0.2), (1.2, 0.0)]),
        ],
        is_left: false,
        is_free: false,
    },
];

/// Key of clapping hands: `apart` is their distance, 0 if they meet.
const fn clapping(at: f32, apart: f32) -> Key {
    key(
        at,
        [-0.288 + 0.275 * apart, -0.20 + 0.02 * apart, 0.58],
        ELBOW_OUT,
        [0.07 - 0.15 * apart, 0.60, 0.80],
        [-1.0, 0.15 * apart, 0.0],
        hand::CUP,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_rise_and_tracks_begin_and_end_at_nothing_within_their_gesture() {
        for motion in &MOTIONS {
            let (begin, end) = (-motion.preparation, motion.length + motion.retraction);
            let times = |times: &mut dyn Iterator<Item = f32>| {
                let times: Vec<f32> = times.collect();
                assert!(times.windows(2).all(|pair| pair[0] < pair[1]), "{}", motion.name);
                assert!(times.first().is_none_or(|&t| t >= begin - 1e-5), "{}: begins early", motion.name);
                assert!(times.last().is_none_or(|&t| t <= end + 1e-5), "{}: ends late", motion.name);
            };
            times(&mut motion.keys.iter().map(|key| key.at));
            if let Arms::Pair(keys) = motion.arms {
                times(&mut keys.iter().map(|key| key.at));
            }
            for track in motion.tracks {
                times(&mut track.keys.iter().map(|key| key.0));
                let value = |key: Option<&(f32, f32)>| key.map(|key| key.1);
                assert_eq!(
                    (value(track.keys.first()), value(track.keys.last())),
                    (Some(0.0), Some(0.0)),
                    "{}",
                    motion.name
                );
            }
            assert!((0.0..=motion.length).contains(&motion.stroke), "{}", motion.name);
            assert_eq!(motion.keys.is_empty(), matches!(motion.arms, Arms::None | Arms::Pointing), "{}", motion.name);
        }
    }

    #[test]
    fn names_and_words_mean_one_gesture() {
        let named = |m: &&Motion| {
            MOTIONS.iter().find(|first| first.name == m.name).is_some_and(|first| std::ptr::eq(first, *m))
        };
        let variants = MOTIONS.iter().filter(|m| !named(m));
        assert!(variants.flat_map(|m| m.words).next().is_none());
        let mut all: Vec<&str> =
            MOTIONS.iter().filter(named).flat_map(|m| m.words.iter().copied().chain([m.name])).collect();
        assert!(all.iter().all(|word| word.bytes().all(|b| b.is_ascii_lowercase() || b == b'_')));
        all.sort_unstable();
        let count = all.len();
        all.dedup();
        assert_eq!(all.len(), count);
    }
}
