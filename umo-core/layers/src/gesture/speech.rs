//! Built-in gestures that go with words: sizes, places, times, lists, contrasts, and things that people do.
//!
//! Of several motions with one name, the first is the plain gesture and the others are its variants.

use super::arm::Vec3;
use super::hand;
use super::table::Channel::{Collars, HeadPitch, HeadRoll, HeadYaw, TrunkPitch, TrunkRoll, TrunkYaw};
use super::table::{
    ARM, ARMS, Arms, ELBOW_LOW, ELBOW_OUT, HEAD, Key, Motion, SHOW_TRACKS, Track, face, key, showing, track, waving,
};

type Vec2 = [f32; 2];
type Words = &'static [&'static str];
type Keys = &'static [Key];
type Tracks = &'static [Track];
/// Preparation, stroke, length and retraction of a [`Motion`].
type Times = [f32; 4];

const fn motion(name: &'static str, words: Words, times: Times, arms: Arms, keys: Keys, tracks: Tracks) -> Motion {
    let [preparation, stroke, length, retraction] = times;
    let parts = match arms {
        Arms::None => HEAD,
        Arms::One | Arms::Pointing => ARM,
        Arms::Both | Arms::Together | Arms::Pair(_) => ARMS,
    };
    let is_left = false;
    let is_free = true;
    Motion { name, words, parts, preparation, stroke, length, retraction, arms, keys, tracks, is_left, is_free }
}

const fn one(name: &'static str, words: Words, times: Times, keys: Keys, tracks: Tracks) -> Motion {
    motion(name, words, times, Arms::One, keys, tracks)
}

const fn both(name: &'static str, words: Words, times: Times, keys: Keys, tracks: Tracks) -> Motion {
    motion(name, words, times, Arms::Both, keys, tracks)
}

const fn head(name: &'static str, words: Words, times: Times, tracks: Tracks) -> Motion {
    motion(name, words, times, Arms::None, &[], tracks)
}

/// A gesture whose hand touches the body or the other hand: its place does not vary.
const fn touching(motion: Motion) -> Motion {
    Motion { is_free: false, ..motion }
}

/// A gesture of the left hand, unless the host asks for the right one.
const fn of_left(motion: Motion) -> Motion {
    Motion { is_left: true, ..motion }
}

/// Elbow raised to the side.
const ELBOW_UP: Vec3 = [1.0, -0.45, 0.1];
/// Elbow ahead of the shoulder, for a hand that goes to the face or behind it.
const ELBOW_AHEAD: Vec3 = [0.45, -0.5, 1.0];

/// A stroke that head and brows go with.
const BEAT: Tracks = &[
    track(HeadPitch, &[(-0.3, 0.0), (0.1, 3.0), (0.4, 1.0), (1.0, 0.0)]),
    face("browInnerUp", &[(-0.3, 0.0), (0.1, 0.22), (0.6, 0.1), (1.0, 0.0)]),
];
const WIDE: Tracks = &[
    track(HeadPitch, &[(-0.3, 0.0), (0.25, -3.0), (0.9, -1.0), (1.5, 0.0)]),
    track(TrunkPitch, &[(-0.3, 0.0), (0.3, -2.0), (0.9, -1.5), (1.5, 0.0)]),
    face("browInnerUp", &[(-0.2, 0.0), (0.25, 0.4), (0.9, 0.2), (1.4, 0.0)]),
    face("browOuterUpLeft", &[(-0.2, 0.0), (0.25, 0.4), (0.9, 0.2), (1.4, 0.0)]),
    face("browOuterUpRight", &[(-0.2, 0.0), (0.25, 0.36), (0.9, 0.18), (1.4, 0.0)]),
    face("eyeWideLeft", &[(-0.1, 0.0), (0.25, 0.25), (0.7, 0.1), (1.2, 0.0)]),
    face("eyeWideRight", &[(-0.1, 0.0), (0.25, 0.25), (0.7, 0.1), (1.2, 0.0)]),
];
const NARROW: Tracks = &[
    track(HeadPitch, &[(-0.3, 0.0), (0.25, 4.0), (0.9, 3.0), (1.4, 0.0)]),
    track(HeadRoll, &[(-0.3, 0.0), (0.3, 3.0), (0.9, 2.5), (1.4, 0.0)]),
    face("eyeSquintLeft", &[(-0.1, 0.0), (0.25, 0.45), (0.9, 0.3), (1.3, 0.0)]),
    face("eyeSquintRight", &[(-0.1, 0.0), (0.25, 0.45), (0.9, 0.3), (1.3, 0.0)]),
    face("browDownLeft", &[(-0.1, 0.0), (0.25, 0.2), (0.9, 0.12), (1.3, 0.0)]),
    face("browDownRight", &[(-0.1, 0.0), (0.25, 0.2), (0.9, 0.12), (1.3, 0.0)]),
];
/// Head and trunk go with a hand from the middle to its own side.
const ACROSS: Tracks = &[
    track(HeadYaw, &[(-0.3, 0.0), (0.0, 4.0), (0.5, -8.0), (0.8, -6.0), (1.4, 0.0)]),
    track(TrunkYaw, &[(-0.3, 0.0), (0.0, 2.5), (0.55, -4.0), (0.8, -3.0), (1.4, 0.0)]),
];
const OFFER: Tracks = &[
    track(HeadPitch, &[(-0.3, 0.0), (0.15, 3.0), (0.6, 1.5), (1.2, 0.0)]),
    track(HeadRoll, &[(-0.3, 0.0), (0.2, 3.0), (0.7, 2.5), (1.2, 0.0)]),
    face("browInnerUp", &[(-0.3, 0.0), (0.15, 0.3), (0.7, 0.15), (1.2, 0.0)]),
];
/// Towards the hand's own side.
const ASIDE: Tracks = &[
    track(HeadYaw, &[(-0.3, 0.0), (0.15, -7.0), (0.9, -5.0), (1.5, 0.0)]),
    track(HeadRoll, &[(-0.3, 0.0), (0.2, 4.0), (0.9, 3.0), (1.5, 0.0)]),
    track(TrunkYaw, &[(-0.3, 0.0), (0.2, -3.0), (0.9, -2.5), (1.5, 0.0)]),
];
const UNSURE: Tracks = &[
    track(HeadRoll, &[(-0.3, 0.0), (0.1, 5.0), (0.5, -2.0), (0.9, 4.0), (1.5, 0.0)]),
    face("browDownLeft", &[(-0.3, 0.0), (0.1, 0.25), (0.9, 0.18), (1.4, 0.0)]),
    face("browOuterUpRight", &[(-0.3, 0.0), (0.1, 0.3), (0.9, 0.2), (1.4, 0.0)]),
    face("mouthShrugLower", &[(-0.3, 0.0), (0.1, 0.3), (0.8, 0.22), (1.4, 0.0)]),
    face("mouthLeft", &[(-0.3, 0.0), (0.1, 0.22), (0.8, 0.15), (1.4, 0.0)]),
];
const REFUSING: Tracks = &[
    track(HeadYaw, &[(-0.3, 0.0), (0.05, 4.0), (0.3, -6.0), (0.55, 4.5), (0.8, -2.5), (1.2, 0.0)]),
    face("browDownLeft", &[(-0.3, 0.0), (0.1, 0.3), (0.8, 0.18), (1.3, 0.0)]),
    face("browDownRight", &[(-0.3, 0.0), (0.1, 0.3), (0.8, 0.18), (1.3, 0.0)]),
    face("mouthPressLeft", &[(-0.3, 0.0), (0.1, 0.25), (0.8, 0.15), (1.3, 0.0)]),
    face("mouthPressRight", &[(-0.3, 0.0), (0.1, 0.25), (0.8, 0.15), (1.3, 0.0)]),
];
const FIRM: Tracks = &[
    track(HeadPitch, &[(-0.3, 0.0), (0.1, 3.5), (0.5, 2.0), (1.2, 0.0)]),
    track(TrunkYaw, &[(-0.3, 0.0), (0.0, 3.0), (0.4, -2.0), (1.2, 0.0)]),
    face("browDownLeft", &[(-0.3, 0.0), (0.1, 0.3), (0.7, 0.18), (1.2, 0.0)]),
    face("browDownRight", &[(-0.3, 0.0), (0.1, 0.3), (0.7, 0.18), (1.2, 0.0)]),
];
const BRIGHT: Tracks = &[
    track(HeadPitch, &[(-0.3, 0.0), (0.1, -4.0), (0.5, -1.0), (1.2, 0.0)]),
    face("browInnerUp", &[(-0.3, 0.0), (0.05, 0.45), (0.6, 0.2), (1.2, 0.0)]),
    face("browOuterUpLeft", &[(-0.3, 0.0), (0.05, 0.45), (0.6, 0.2), (1.2, 0.0)]),
    face("browOuterUpRight", &[(-0.3, 0.0), (0.05, 0.45), (0.6, 0.2), (1.2, 0.0)]),
    face("eyeWideLeft", &[(-0.2, 0.0), (0.05, 0.3), (0.4, 0.1), (1.0, 0.0)]),
    face("eyeWideRight", &[(-0.2, 0.0), (0.05, 0.3), (0.4, 0.1), (1.0, 0.0)]),
];
const TENDER: Tracks = &[
    track(HeadPitch, &[(-0.35, 0.0), (0.1, 5.0), (0.7, 2.5), (1.4, 0.0)]),
    track(HeadRoll, &[(-0.35, 0.0), (0.2, 5.0), (0.8, 4.0), (1.5, 0.0)]),
    face("browInnerUp", &[(-0.35, 0.0), (0.1, 0.4), (0.8, 0.25), (1.4, 0.0)]),
    face("mouthSmileLeft", &[(-0.3, 0.0), (0.2, 0.25), (0.8, 0.2), (1.4, 0.0)]),
    face("mouthSmileRight", &[(-0.3, 0.0), (0.2, 0.22), (0.8, 0.18), (1.4, 0.0)]),
];
const RECALLING: Tracks = &[
    track(HeadPitch, &[(-0.4, 0.0), (0.1, 4.0), (0.9, 2.0), (1.6, 0.0)]),
    track(HeadYaw, &[(-0.4, 0.0), (0.1, 6.0), (0.9, 5.0), (1.6, 0.0)]),
    face("eyeLookUpLeft", &[(-0.3, 0.0), (0.05, 0.4), (0.8, 0.3), (1.4, 0.0)]),
    face("eyeLookUpRight", &[(-0.3, 0.0), (0.05, 0.4), (0.8, 0.3), (1.4, 0.0)]),
    face("browInnerUp", &[(-0.3, 0.0), (0.1, 0.3), (0.9, 0.2), (1.5, 0.0)]),
];
const ASKING: Tracks = &[
    track(HeadPitch, &[(-0.3, 0.0), (0.1, -3.0), (0.7, -1.5), (1.3, 0.0)]),
    track(HeadRoll, &[(-0.3, 0.0), (0.15, 7.0), (0.7, 5.5), (1.3, 0.0)]),
    track(Collars, &[(-0.3, 0.0), (0.1, 6.0), (0.5, 4.0), (1.1, 0.0)]),
    face("browInnerUp", &[(-0.3, 0.0), (0.05, 0.5), (0.7, 0.35), (1.2, 0.0)]),
    face("browOuterUpLeft", &[(-0.3, 0.0), (0.05, 0.4), (0.7, 0.3), (1.2, 0.0)]),
    face("browOuterUpRight", &[(-0.3, 0.0), (0.05, 0.5), (0.7, 0.35), (1.2, 0.0)]),
];
const THANKING: Tracks = &[
    track(HeadPitch, &[(-0.35, 0.0), (0.15, 10.0), (0.6, 5.0), (1.4, 0.0)]),
    track(TrunkPitch, &[(-0.35, 0.0), (0.2, 5.0), (0.7, 3.0), (1.5, 0.0)]),
    face("mouthSmileLeft", &[(-0.3, 0.0), (0.2, 0.45), (0.9, 0.35), (1.5, 0.0)]),
    face("mouthSmileRight", &[(-0.3, 0.0), (0.2, 0.42), (0.9, 0.32), (1.5, 0.0)]),
    face("cheekSquintLeft", &[(-0.2, 0.0), (0.2, 0.2), (0.9, 0.15), (1.4, 0.0)]),
    face("cheekSquintRight", &[(-0.2, 0.0), (0.2, 0.2), (0.9, 0.15), (1.4, 0.0)]),
];
const MOUTHFUL: Tracks = &[
    track(HeadPitch, &[(-0.4, 0.0), (0.05, 4.0), (0.35, 1.0), (0.65, 4.0), (1.4, 0.0)]),
    face("mouthPucker", &[(-0.2, 0.0), (0.05, 0.2), (0.3, 0.05), (0.65, 0.2), (1.2, 0.0)]),
];
const LISTED: Tracks = &[
    track(
        HeadPitch,
        &[(-0.3, 0.0), (0.14, 3.5), (0.5, 0.5), (1.0, 3.5), (1.4, 0.5), (1.86, 4.0), (2.3, 1.0), (2.9, 0.0)],
    ),
    face("browInnerUp", &[(-0.3, 0.0), (0.1, 0.2), (1.8, 0.15), (2.6, 0.0)]),
];

/// Key of a hand held level in front, palm down.
const fn level(at: f32, hand: Vec3, yaw: f32) -> Key {
    key(at, hand, ELBOW_OUT, [yaw, 0.05, 1.0], [0.0, -1.0, 0.1], hand::FLAT)
}

/// Key of an open hand, palm up, that shows something.
const fn offering(at: f32, hand: Vec3, yaw: f32) -> Key {
    key(at, hand, ELBOW_LOW, [yaw, 0.05, 1.0], [-0.2, 1.0, 0.1], hand::OFFER)
}

/// Key of a hand beside what it bounds, palm inwards.
const fn bounding(at: f32, hand: Vec3, up: f32) -> Key {
    key(at, hand, ELBOW_LOW, [0.0, up, 1.0], [-1.0, 0.0, 0.0], hand::OPEN)
}

/// Key of a hand that turns something away, palm ahead.
const fn refusing(at: f32, hand: Vec3, lean: f32) -> Key {
    key(at, hand, ELBOW_OUT, [lean, 1.0, 0.25], [-0.1, -0.1, 1.0], hand::FLAT)
}

/// Key of thumb and index in a ring: `lift` raises them between beats.
const fn ringing(at: f32, lift: f32) -> Key {
    key(at, [0.14, -0.16 + lift, 0.64], ELBOW_LOW, [-0.25, 0.7, 0.75], [-0.8, -0.2, 0.35], hand::RING)
}

/// Key of a hand that counts on its own fingers, the thumb first, its palm to the speaker.
const fn listing(at: f32, lift: f32, shape: hand::Shape) -> Key {
    key(at, [0.12, -0.16 + lift, 0.60], ELBOW_LOW, [-0.55, 0.75, 0.5], [-0.75, -0.35, -0.35], shape)
}

/// Key of an index finger that ticks off the fingers of the other hand.
const fn ticking(at: f32, [out, up, ahead]: Vec3) -> Key {
    key(at, [-0.02 + out, -0.22 + up, 0.56 + ahead], ELBOW_OUT, [-0.85, -0.3, 0.35], [-0.3, -0.6, -0.6], hand::POINT)
}

/// Key of a hand that wavers: `lean` tilts the palm.
const fn wavering(at: f32, lean: f32) -> Key {
    key(at, [0.20, -0.28, 0.66], ELBOW_OUT, [-0.1, 0.12, 1.0], [lean, -1.0, 0.05], hand::OPEN)
}

/// Key of a flat hand on the left side of the chest: `away` is its distance.
const fn touching_heart(at: f32, away: f32, shape: hand::Shape) -> Key {
    key(at, [-0.20, -0.24, 0.29 + away], ELBOW_OUT, [-1.0, 0.30, 0.0], [0.05, 0.0, -1.0], shape)
}

/// Key of a finger that wags in refusal.
const fn wagging(at: f32, lean: f32) -> Key {
    key(at, [0.28 + 0.05 * lean, 0.02, 0.50], ELBOW_LOW, [-0.06 + lean, 1.0, 0.15], [-0.2, 0.0, 1.0], hand::ONE)
}

/// Key of a thumb that rubs on the fingers.
const fn rubbing(at: f32, shape: hand::Shape) -> Key {
    key(at, [0.16, -0.22, 0.62], ELBOW_LOW, [-0.35, 0.6, 0.8], [-0.35, 0.8, -0.6], shape)
}

/// Key of a hand that writes.
const fn writing(at: f32, along: f32, lift: f32) -> Key {
    key(at, [-0.14 + along, -0.40 + lift, 0.56], ELBOW_OUT, [-0.75, -0.25, 0.65], [-0.45, -0.85, -0.1], hand::PEN)
}

/// Key of fingertips at the mouth: `away` is their distance.
const fn eating(at: f32, away: f32) -> Key {
    let hand = [-0.16 + 0.3 * away, 0.10 - 0.6 * away, 0.475 + 0.8 * away];
    key(at, hand, ELBOW_OUT, [-0.5, 0.8, -0.35], [-0.6, -0.1, -0.8], hand::BUNCH)
}

/// Key of a hand around a glass: `tilt` is 1 as it empties.
const fn drinking(at: f32, tilt: f32) -> Key {
    key(
        at,
        [-0.06, 0.04 + 0.13 * tilt, 0.50 - 0.06 * tilt],
        ELBOW_UP,
        [-0.85, 0.35, 0.25],
        [-0.4 - 0.12 * tilt, -0.5 * tilt, -0.9 + 0.3 * tilt],
        hand::GLASS,
    )
}

/// Glances with gestures that point: towards the hand's own side and down, degrees.
pub(super) const GLANCES: [(&str, Vec2); 8] = [
    ("here", [4.0, 16.0]),
    ("there", [22.0, 2.0]),
    ("up", [8.0, -15.0]),
    ("down", [6.0, 17.0]),
    ("past", [16.0, 5.0]),
    ("future", [9.0, 4.0]),
    ("one_hand", [16.0, 9.0]),
    ("other_hand", [16.0, 9.0]),
];

/// The gesture whose hand waits for the words of its items.
pub(super) const LIST: &str = "list";
/// Its holds between two items: when the hand rests in all its variants, and the stroke of the next item.
pub(super) const RESTS: [(f32, f32); 2] = [(0.56, 1.0), (1.42, 1.86)];

/// The gestures, in groups of one name.
pub(super) const SPEECH: [Motion; 76] = [
    // Of the head, as small as people's in speech.
    head(
        "small_nod",
        &[],
        [0.18, 0.12, 0.34, 0.3],
        &[track(HeadPitch, &[(-0.18, 0.0), (0.12, 6.5), (0.36, -0.5), (0.62, 0.0)])],
    ),
    head(
        "small_nod",
        &[],
        [0.18, 0.12, 0.6, 0.3],
        &[track(HeadPitch, &[(-0.18, 0.0), (0.12, 5.0), (0.30, 0.8), (0.46, 4.2), (0.86, 0.0)])],
    ),
    head(
        "small_shake",
        &[],
        [0.2, 0.12, 0.56, 0.34],
        &[track(HeadYaw, &[(-0.2, 0.0), (0.12, -5.5), (0.34, 5.5), (0.56, -2.5), (0.88, 0.0)])],
    ),
    head(
        "small_shake",
        &[],
        [0.2, 0.12, 0.44, 0.34],
        &[
            track(HeadYaw, &[(-0.2, 0.0), (0.12, 5.0), (0.36, -4.5), (0.76, 0.0)]),
            track(HeadPitch, &[(-0.2, 0.0), (0.15, 2.0), (0.76, 0.0)]),
        ],
    ),
    // Sizes.
    both(
        "size_large",
        &["huge"],
        [0.55, 0.30, 1.0, 0.7],
        &[
            bounding(0.0, [0.16, -0.32, 0.64], 0.35),
            bounding(0.30, [0.56, -0.26, 0.58], 0.25),
            bounding(1.0, [0.55, -0.28, 0.58], 0.25),
        ],
        WIDE,
    ),
    both(
        "size_large",
        &[],
        [0.6, 0.32, 1.0, 0.75],
        &[
            key(0.0, [0.05, -0.05, 0.62], ELBOW_OUT, [-0.35, 0.8, 0.6], [-0.5, -0.5, 0.6], hand::OPEN),
            key(0.32, [0.44, 0.0, 0.62], ELBOW_OUT, [-0.2, 0.75, 0.65], [-1.0, -0.1, 0.1], hand::CUP),
            key(0.6, [0.46, -0.28, 0.64], ELBOW_OUT, [-0.2, 0.3, 1.0], [-0.9, 0.45, -0.1], hand::CUP),
            key(1.0, [0.45, -0.29, 0.64], ELBOW_OUT, [-0.2, 0.3, 1.0], [-0.9, 0.45, -0.1], hand::CUP),
        ],
        WIDE,
    ),
    both(
        "size_small",
        &["tiny"],
        [0.55, 0.26, 0.95, 0.65],
        &[
            bounding(0.0, [0.02, -0.26, 0.62], 0.5),
            bounding(0.26, [-0.17, -0.27, 0.62], 0.5),
            bounding(0.95, [-0.165, -0.275, 0.62], 0.5),
        ],
        NARROW,
    ),
    one(
        "size_small",
        &[],
        [0.55, 0.2, 0.95, 0.65],
        &[
            key(0.0, [0.12, -0.06, 0.60], ELBOW_LOW, [-0.4, 0.8, 0.6], [-0.75, -0.25, 0.45], hand::RELAXED),
            key(0.2, [0.12, -0.03, 0.62], ELBOW_LOW, [-0.4, 0.8, 0.6], [-0.75, -0.25, 0.45], hand::GAP),
            key(0.95, [0.12, -0.035, 0.62], ELBOW_LOW, [-0.4, 0.8, 0.6], [-0.75, -0.25, 0.45], hand::GAP),
        ],
        NARROW,
    ),
    // Shown, swept, offered.
    one(
        "sweep",
        &["sweeps"],
        [0.55, 0.30, 0.9, 0.65],
        &[
            level(0.0, [-0.18, -0.28, 0.60], -0.6),
            level(0.30, [0.22, -0.32, 0.70], 0.0),
            level(0.62, [0.56, -0.34, 0.54], 0.6),
            level(0.9, [0.57, -0.35, 0.53], 0.6),
        ],
        ACROSS,
    ),
    one(
        "sweep",
        &[],
        [0.55, 0.32, 0.95, 0.65],
        &[
            offering(0.0, [-0.14, -0.38, 0.58], -0.5),
            offering(0.32, [0.24, -0.40, 0.68], 0.0),
            offering(0.66, [0.56, -0.38, 0.52], 0.6),
            offering(0.95, [0.56, -0.39, 0.52], 0.6),
        ],
        ACROSS,
    ),
    both(
        "open_palms",
        &["opens_palms"],
        [0.5, 0.2, 0.85, 0.65],
        &[
            offering(0.0, [0.16, -0.40, 0.56], 0.15),
            offering(0.2, [0.28, -0.50, 0.58], 0.4),
            offering(0.85, [0.28, -0.49, 0.58], 0.4),
        ],
        OFFER,
    ),
    one(
        "open_palms",
        &[],
        [0.5, 0.2, 0.85, 0.65],
        &[
            offering(0.0, [0.12, -0.36, 0.58], 0.05),
            offering(0.2, [0.26, -0.44, 0.62], 0.3),
            offering(0.85, [0.26, -0.43, 0.62], 0.3),
        ],
        OFFER,
    ),
    one(
        "ring",
        &["precise", "precisely"],
        [0.5, 0.16, 0.95, 0.6],
        &[ringing(0.0, 0.06), ringing(0.16, 0.0), ringing(0.38, 0.045), ringing(0.54, 0.0), ringing(0.95, 0.005)],
        BEAT,
    ),
    one(
        "ring",
        &[],
        [0.52, 0.14, 0.85, 0.6],
        &[
            key(0.0, [0.24, 0.02, 0.56], ELBOW_LOW, [-0.15, 1.0, 0.3], [-0.55, 0.0, 0.8], hand::RING),
            key(0.14, [0.24, -0.05, 0.58], ELBOW_LOW, [-0.15, 1.0, 0.4], [-0.55, 0.0, 0.8], hand::RING),
            key(0.85, [0.24, -0.045, 0.58], ELBOW_LOW, [-0.15, 1.0, 0.4], [-0.55, 0.0, 0.8], hand::RING),
        ],
        BEAT,
    ),
    // Items and contrasts.
    one(
        "list",
        &["lists"],
        [0.55, 0.14, 2.4, 0.65],
        &[
            listing(0.0, 0.06, hand::THUMB),
            listing(0.14, 0.0, hand::THUMB),
            listing(0.60, 0.005, hand::THUMB),
            listing(0.86, 0.045, hand::THUMB_AND_INDEX),
            listing(1.0, 0.0, hand::THUMB_AND_INDEX),
            listing(1.46, 0.005, hand::THUMB_AND_INDEX),
            listing(1.72, 0.045, hand::WITH_MIDDLE),
            listing(1.86, 0.0, hand::WITH_MIDDLE),
            listing(2.4, 0.0, hand::WITH_MIDDLE),
        ],
        LISTED,
    ),
    touching(motion(
        "list",
        &[],
        [0.6, 0.14, 2.4, 0.65],
        Arms::Pair(&[
            key(0.0, [-0.08, -0.34, 0.54], ELBOW_LOW, [-0.75, 0.45, 0.5], [-0.2, 0.5, -0.85], hand::SPREAD),
            key(2.4, [-0.08, -0.335, 0.54], ELBOW_LOW, [-0.75, 0.45, 0.5], [-0.2, 0.5, -0.85], hand::SPREAD),
        ]),
        &[
            ticking(0.0, [0.02, 0.07, -0.02]),
            ticking(0.14, [0.0, 0.0, 0.0]),
            ticking(0.66, [0.0, 0.005, 0.0]),
            ticking(0.84, [0.02, 0.05, 0.0]),
            ticking(1.0, [0.0, -0.035, 0.035]),
            ticking(1.52, [0.0, -0.03, 0.035]),
            ticking(1.70, [0.02, 0.02, 0.03]),
            ticking(1.86, [0.0, -0.07, 0.06]),
            ticking(2.4, [0.0, -0.065, 0.06]),
        ],
        LISTED,
    )),
    of_left(one(
        "one_hand",
        &[],
        [0.5, 0.2, 1.3, 0.7],
        &[
            offering(0.0, [0.24, -0.30, 0.58], 0.2),
            offering(0.2, [0.38, -0.38, 0.58], 0.4),
            offering(1.3, [0.38, -0.375, 0.58], 0.4),
        ],
        ASIDE,
    )),
    of_left(one(
        "one_hand",
        &[],
        [0.5, 0.2, 1.3, 0.7],
        &[
            bounding(0.0, [0.16, -0.22, 0.60], 0.4),
            bounding(0.2, [0.30, -0.34, 0.64], 0.25),
            bounding(1.3, [0.30, -0.335, 0.64], 0.25),
        ],
        ASIDE,
    )),
    one(
        "other_hand",
        &[],
        [0.5, 0.2, 1.0, 0.7],
        &[
            offering(0.0, [0.24, -0.30, 0.58], 0.2),
            offering(0.2, [0.38, -0.38, 0.58], 0.4),
            offering(1.0, [0.38, -0.375, 0.58], 0.4),
        ],
        ASIDE,
    ),
    one(
        "other_hand",
        &[],
        [0.5, 0.2, 1.0, 0.7],
        &[
            bounding(0.0, [0.16, -0.22, 0.60], 0.4),
            bounding(0.2, [0.30, -0.34, 0.64], 0.25),
            bounding(1.0, [0.30, -0.335, 0.64], 0.25),
        ],
        ASIDE,
    ),
    motion(
        "contrast",
        &[],
        [0.5, 0.2, 1.9, 0.7],
        Arms::Pair(&[
            offering(0.0, [0.22, -0.32, 0.58], 0.2),
            offering(0.2, [0.38, -0.38, 0.58], 0.4),
            offering(0.95, [0.37, -0.40, 0.57], 0.4),
            offering(1.9, [0.35, -0.44, 0.55], 0.4),
        ]),
        &[
            offering(0.0, [0.20, -0.56, 0.50], 0.15),
            offering(0.7, [0.20, -0.55, 0.50], 0.15),
            offering(0.92, [0.26, -0.32, 0.58], 0.2),
            offering(1.12, [0.38, -0.38, 0.58], 0.4),
            offering(1.9, [0.38, -0.375, 0.58], 0.4),
        ],
        &[
            track(HeadYaw, &[(-0.3, 0.0), (0.2, 7.0), (0.7, 5.0), (1.14, -7.0), (1.9, -4.0), (2.5, 0.0)]),
            track(HeadRoll, &[(-0.3, 0.0), (0.2, -4.0), (0.7, -3.0), (1.14, 4.0), (1.9, 3.0), (2.5, 0.0)]),
            track(TrunkYaw, &[(-0.3, 0.0), (0.25, 3.0), (0.7, 2.5), (1.2, -3.0), (1.9, -2.0), (2.5, 0.0)]),
        ],
    ),
    // Times.
    one(
        "past",
        &[],
        [0.6, 0.28, 0.9, 0.7],
        &[
            key(0.0, [0.24, 0.02, 0.42], ELBOW_AHEAD, [0.0, 1.0, 0.2], [-0.95, 0.0, -0.2], hand::OPEN),
            key(0.28, [0.20, 0.24, 0.12], ELBOW_AHEAD, [0.15, 0.6, -0.8], [-0.9, 0.0, -0.4], hand::FLAT),
            key(0.9, [0.20, 0.22, 0.14], ELBOW_AHEAD, [0.15, 0.65, -0.75], [-0.9, 0.0, -0.4], hand::FLAT),
        ],
        &[
            track(HeadYaw, &[(-0.3, 0.0), (0.28, -6.0), (0.8, -4.0), (1.5, 0.0)]),
            track(TrunkYaw, &[(-0.3, 0.0), (0.28, -3.0), (0.8, -2.0), (1.5, 0.0)]),
            track(HeadPitch, &[(-0.3, 0.0), (0.25, -3.0), (0.8, -1.5), (1.5, 0.0)]),
        ],
    ),
    one(
        "past",
        &[],
        [0.55, 0.2, 0.95, 0.65],
        &[
            key(0.0, [0.30, -0.06, 0.42], ELBOW_AHEAD, [-0.15, 1.0, 0.25], [-1.0, -0.1, -0.1], hand::THUMB),
            key(0.2, [0.32, 0.03, 0.30], ELBOW_AHEAD, [-0.1, 1.0, -0.1], [-1.0, -0.1, -0.1], hand::THUMB),
            key(0.42, [0.31, 0.0, 0.36], ELBOW_AHEAD, [-0.1, 1.0, 0.1], [-1.0, -0.1, -0.1], hand::THUMB),
            key(0.60, [0.32, 0.03, 0.30], ELBOW_AHEAD, [-0.1, 1.0, -0.1], [-1.0, -0.1, -0.1], hand::THUMB),
            key(0.95, [0.32, 0.02, 0.31], ELBOW_AHEAD, [-0.1, 1.0, -0.05], [-1.0, -0.1, -0.1], hand::THUMB),
        ],
        ASIDE,
    ),
    one(
        "future",
        &[],
        [0.55, 0.36, 0.95, 0.7],
        &[
            key(0.0, [0.14, -0.14, 0.46], ELBOW_LOW, [-0.15, 1.0, 0.35], [-0.6, 0.0, 0.75], hand::FLAT),
            key(0.18, [0.14, 0.0, 0.66], ELBOW_LOW, [-0.1, 0.8, 0.75], [-0.6, -0.35, 0.6], hand::FLAT),
            key(0.36, [0.14, -0.12, 0.88], ELBOW_LOW, [-0.08, 0.3, 1.0], [-0.6, -0.75, 0.15], hand::FLAT),
            key(0.95, [0.14, -0.13, 0.87], ELBOW_LOW, [-0.08, 0.28, 1.0], [-0.6, -0.75, 0.15], hand::FLAT),
        ],
        BEAT,
    ),
    one(
        "future",
        &[],
        [0.5, 0.22, 1.0, 0.65],
        &[
            bounding(0.0, [0.14, -0.22, 0.52], 0.35),
            bounding(0.22, [0.14, -0.34, 0.66], 0.2),
            bounding(0.44, [0.14, -0.24, 0.78], 0.2),
            bounding(0.66, [0.15, -0.32, 0.88], 0.1),
            bounding(1.0, [0.15, -0.315, 0.88], 0.1),
        ],
        BEAT,
    ),
    // Places and people.
    one(
        "up",
        &[],
        [0.5, 0.34, 0.95, 0.7],
        &[
            key(0.0, [0.20, -0.46, 0.58], ELBOW_LOW, [-0.1, 0.1, 1.0], [-0.2, 1.0, 0.0], hand::OFFER),
            key(0.34, [0.24, -0.02, 0.60], ELBOW_LOW, [-0.25, 0.5, 0.85], [-0.35, 0.85, -0.5], hand::OFFER),
            key(0.95, [0.24, -0.03, 0.60], ELBOW_LOW, [-0.25, 0.5, 0.85], [-0.35, 0.85, -0.5], hand::OFFER),
        ],
        BRIGHT,
    ),
    one(
        "up",
        &[],
        [0.55, 0.2, 0.9, 0.7],
        &[
            key(0.0, [0.26, 0.04, 0.50], ELBOW_LOW, [-0.05, 1.0, 0.2], [-0.5, 0.0, 0.85], hand::POINT),
            key(0.2, [0.27, 0.16, 0.46], ELBOW_LOW, [-0.03, 1.0, 0.1], [-0.5, 0.0, 0.85], hand::POINT),
            key(0.9, [0.27, 0.15, 0.46], ELBOW_LOW, [-0.03, 1.0, 0.1], [-0.5, 0.0, 0.85], hand::POINT),
        ],
        BRIGHT,
    ),
    one(
        "down",
        &[],
        [0.5, 0.32, 0.9, 0.65],
        &[
            level(0.0, [0.16, -0.18, 0.62], -0.2),
            level(0.32, [0.18, -0.54, 0.58], -0.15),
            level(0.9, [0.18, -0.53, 0.58], -0.15),
        ],
        BEAT,
    ),
    one(
        "down",
        &[],
        [0.5, 0.2, 0.9, 0.65],
        &[
            key(0.0, [0.16, -0.42, 0.58], ELBOW_UP, [-0.2, -0.6, 0.8], [-0.35, -0.8, -0.6], hand::POINT),
            key(0.2, [0.16, -0.52, 0.58], ELBOW_UP, [-0.2, -0.75, 0.7], [-0.35, -0.7, -0.75], hand::POINT),
            key(0.42, [0.16, -0.47, 0.58], ELBOW_UP, [-0.2, -0.65, 0.75], [-0.35, -0.75, -0.65], hand::POINT),
            key(0.60, [0.16, -0.52, 0.58], ELBOW_UP, [-0.2, -0.75, 0.7], [-0.35, -0.7, -0.75], hand::POINT),
            key(0.9, [0.16, -0.51, 0.58], ELBOW_UP, [-0.2, -0.75, 0.7], [-0.35, -0.7, -0.75], hand::POINT),
        ],
        BEAT,
    ),
    both(
        "here",
        &[],
        [0.45, 0.18, 0.8, 0.6],
        &[
            level(0.0, [0.10, -0.40, 0.56], -0.3),
            level(0.18, [0.12, -0.52, 0.56], -0.25),
            level(0.8, [0.12, -0.51, 0.56], -0.25),
        ],
        BEAT,
    ),
    one(
        "here",
        &[],
        [0.5, 0.18, 0.85, 0.6],
        &[
            key(0.0, [0.06, -0.40, 0.50], ELBOW_UP, [-0.45, -0.6, 0.65], [-0.3, -0.7, -0.7], hand::POINT),
            key(0.18, [0.05, -0.50, 0.52], ELBOW_UP, [-0.4, -0.75, 0.55], [-0.3, -0.6, -0.8], hand::POINT),
            key(0.85, [0.05, -0.49, 0.52], ELBOW_UP, [-0.4, -0.75, 0.55], [-0.3, -0.6, -0.8], hand::POINT),
        ],
        BEAT,
    ),
    motion(
        "there",
        &["over_there"],
        [0.6, 0.0, 0.85, 0.7],
        Arms::Pointing,
        &[],
        &[
            track(HeadPitch, &[(-0.4, 0.0), (0.05, 2.0), (0.8, 1.0), (1.3, 0.0)]),
            face("browInnerUp", &[(-0.4, 0.0), (0.0, 0.22), (0.8, 0.12), (1.3, 0.0)]),
        ],
    ),
    one(
        "there",
        &[],
        [0.55, 0.2, 0.9, 0.7],
        &[
            key(0.0, [0.40, -0.16, 0.62], ELBOW_LOW, [0.3, 0.35, 0.9], [-0.8, 0.5, 0.4], hand::OFFER),
            key(0.2, [0.58, -0.14, 0.70], ELBOW_LOW, [0.55, 0.1, 0.85], [-0.6, 0.7, 0.3], hand::OFFER),
            key(0.9, [0.57, -0.15, 0.70], ELBOW_LOW, [0.55, 0.1, 0.85], [-0.6, 0.7, 0.3], hand::OFFER),
        ],
        &[
            track(HeadYaw, &[(-0.4, 0.0), (0.1, -14.0), (0.5, -11.0), (1.2, 0.0)]),
            track(TrunkYaw, &[(-0.4, 0.0), (0.15, -5.0), (0.6, -4.0), (1.3, 0.0)]),
        ],
    ),
    one(
        "you",
        &[],
        [0.5, 0.18, 0.75, 0.6],
        &[
            key(0.0, [0.10, -0.28, 0.62], ELBOW_LOW, [-0.15, 0.3, 1.0], [-0.7, 0.7, -0.1], hand::OFFER),
            key(0.18, [0.06, -0.27, 0.80], ELBOW_LOW, [-0.2, 0.1, 1.0], [-0.6, 0.8, 0.0], hand::OFFER),
            key(0.75, [0.07, -0.28, 0.78], ELBOW_LOW, [-0.2, 0.1, 1.0], [-0.6, 0.8, 0.0], hand::OFFER),
        ],
        OFFER,
    ),
    one(
        "you",
        &[],
        [0.5, 0.18, 0.7, 0.6],
        &[
            key(0.0, [0.10, -0.16, 0.62], ELBOW_LOW, [-0.15, 0.4, 1.0], [-0.75, -0.6, 0.2], hand::POINT),
            key(0.18, [0.08, -0.20, 0.80], ELBOW_LOW, [-0.15, 0.05, 1.0], [-0.7, -0.7, 0.05], hand::POINT),
            key(0.7, [0.08, -0.205, 0.79], ELBOW_LOW, [-0.15, 0.05, 1.0], [-0.7, -0.7, 0.05], hand::POINT),
        ],
        BEAT,
    ),
    both(
        "we",
        &["us"],
        [0.5, 0.34, 0.9, 0.65],
        &[
            offering(0.0, [0.40, -0.36, 0.60], 0.25),
            key(0.34, [0.06, -0.32, 0.44], ELBOW_OUT, [-0.75, 0.35, 0.45], [-0.45, 0.35, -0.85], hand::OFFER),
            key(0.9, [0.06, -0.33, 0.44], ELBOW_OUT, [-0.75, 0.35, 0.45], [-0.45, 0.35, -0.85], hand::OFFER),
        ],
        OFFER,
    ),
    one(
        "we",
        &[],
        [0.5, 0.3, 1.1, 0.65],
        &[
            key(0.0, [-0.02, -0.28, 0.40], ELBOW_OUT, [-0.9, 0.35, 0.2], [-0.2, 0.1, -1.0], hand::RELAXED),
            key(0.30, [0.16, -0.30, 0.70], ELBOW_OUT, [-0.5, 0.25, 0.85], [-0.55, 0.7, -0.5], hand::OFFER),
            key(0.70, [0.0, -0.29, 0.42], ELBOW_OUT, [-0.9, 0.35, 0.2], [-0.2, 0.1, -1.0], hand::RELAXED),
            key(1.1, [0.0, -0.30, 0.42], ELBOW_OUT, [-0.9, 0.35, 0.2], [-0.2, 0.1, -1.0], hand::RELAXED),
        ],
        BEAT,
    ),
    touching(one(
        "heart",
        &["hand_on_heart", "love"],
        [0.6, 0.0, 1.2, 0.75],
        &[
            touching_heart(0.0, 0.0, hand::FLAT),
            touching_heart(0.6, 0.005, hand::FLAT),
            touching_heart(1.2, 0.0, hand::FLAT),
        ],
        TENDER,
    )),
    touching(one(
        "heart",
        &[],
        [0.6, 0.0, 1.1, 0.75],
        &[
            touching_heart(0.0, 0.0, hand::FLAT),
            touching_heart(0.22, 0.07, hand::RELAXED),
            touching_heart(0.44, 0.0, hand::FLAT),
            touching_heart(1.1, 0.0, hand::FLAT),
        ],
        TENDER,
    )),
    // Asked of the other.
    one(
        "wait",
        &["hold_on", "one_moment"],
        [0.55, 0.16, 0.95, 0.65],
        &[
            refusing(0.0, [0.20, -0.12, 0.62], 0.0),
            refusing(0.16, [0.20, -0.16, 0.72], 0.0),
            refusing(0.40, [0.20, -0.14, 0.66], 0.0),
            refusing(0.58, [0.20, -0.16, 0.71], 0.0),
            refusing(0.95, [0.20, -0.165, 0.71], 0.0),
        ],
        BEAT,
    ),
    one(
        "wait",
        &[],
        [0.55, 0.14, 0.95, 0.65],
        &[showing(0.0, 0.05, hand::ONE), showing(0.14, 0.0, hand::ONE), showing(0.95, 0.0, hand::ONE)],
        SHOW_TRACKS,
    ),
    both(
        "refuse",
        &["refuses"],
        [0.55, 0.28, 0.85, 0.65],
        &[
            refusing(0.0, [-0.10, -0.14, 0.62], -0.3),
            refusing(0.28, [0.32, -0.18, 0.62], 0.15),
            refusing(0.85, [0.31, -0.18, 0.62], 0.15),
        ],
        REFUSING,
    ),
    one(
        "refuse",
        &[],
        [0.55, 0.16, 1.0, 0.65],
        &[
            wagging(0.0, -0.25),
            wagging(0.16, 0.3),
            wagging(0.36, -0.28),
            wagging(0.56, 0.3),
            wagging(0.78, -0.2),
            wagging(1.0, 0.0),
        ],
        REFUSING,
    ),
    one(
        "push_away",
        &["go_away"],
        [0.55, 0.36, 0.9, 0.65],
        &[
            key(0.0, [0.04, -0.22, 0.46], ELBOW_OUT, [-0.7, 0.5, 0.5], [-0.3, -0.6, -0.6], hand::RELAXED),
            key(0.36, [0.36, -0.24, 0.62], ELBOW_OUT, [0.35, 0.35, 0.85], [0.1, -0.9, 0.45], hand::OPEN),
            key(0.9, [0.36, -0.26, 0.61], ELBOW_OUT, [0.35, 0.25, 0.9], [0.1, -0.9, 0.35], hand::OPEN),
        ],
        FIRM,
    ),
    both(
        "push_away",
        &[],
        [0.55, 0.28, 0.85, 0.65],
        &[
            refusing(0.0, [0.12, -0.18, 0.46], 0.0),
            refusing(0.28, [0.16, -0.16, 0.78], 0.0),
            refusing(0.85, [0.16, -0.165, 0.77], 0.0),
        ],
        FIRM,
    ),
    one(
        "cut_off",
        &["enough"],
        [0.55, 0.20, 0.8, 0.65],
        &[
            level(0.0, [-0.20, -0.20, 0.54], -0.75),
            level(0.20, [0.16, -0.24, 0.64], -0.1),
            level(0.40, [0.46, -0.28, 0.54], 0.45),
            level(0.8, [0.46, -0.285, 0.54], 0.45),
        ],
        FIRM,
    ),
    both(
        "cut_off",
        &[],
        [0.55, 0.20, 0.85, 0.65],
        &[
            level(0.0, [-0.10, -0.32, 0.58], -0.45),
            level(0.20, [0.16, -0.34, 0.60], 0.0),
            level(0.38, [0.42, -0.36, 0.56], 0.4),
            level(0.85, [0.42, -0.365, 0.56], 0.4),
        ],
        FIRM,
    ),
    one(
        "question",
        &["asks"],
        [0.45, 0.3, 0.95, 0.6],
        &[
            key(0.0, [0.18, -0.34, 0.60], ELBOW_LOW, [-0.05, 0.15, 1.0], [-0.95, 0.0, 0.0], hand::RELAXED),
            key(0.3, [0.34, -0.36, 0.60], ELBOW_LOW, [0.35, 0.15, 1.0], [-0.15, 1.0, 0.1], hand::OFFER),
            key(0.95, [0.34, -0.365, 0.60], ELBOW_LOW, [0.35, 0.15, 1.0], [-0.15, 1.0, 0.1], hand::OFFER),
        ],
        ASKING,
    ),
    both(
        "question",
        &[],
        [0.45, 0.3, 0.95, 0.6],
        &[
            key(0.0, [0.20, -0.42, 0.56], ELBOW_LOW, [0.0, 0.15, 1.0], [-0.95, 0.0, 0.0], hand::RELAXED),
            key(0.3, [0.36, -0.42, 0.54], ELBOW_LOW, [0.45, 0.15, 0.9], [-0.15, 1.0, 0.1], hand::OFFER),
            key(0.95, [0.36, -0.425, 0.54], ELBOW_LOW, [0.45, 0.15, 0.9], [-0.15, 1.0, 0.1], hand::OFFER),
        ],
        ASKING,
    ),
    both(
        "all",
        &["everything", "everybody"],
        [0.55, 0.40, 1.1, 0.75],
        &[
            key(0.0, [-0.06, -0.30, 0.62], ELBOW_OUT, [-0.25, 0.5, 0.85], [-0.6, 0.3, -0.5], hand::OPEN),
            key(0.20, [0.20, -0.04, 0.66], ELBOW_OUT, [0.05, 0.75, 0.7], [-0.5, 0.1, 0.4], hand::OPEN),
            key(0.40, [0.50, -0.10, 0.58], ELBOW_OUT, [0.4, 0.55, 0.75], [-0.35, 0.7, 0.5], hand::OPEN),
            key(0.66, [0.56, -0.34, 0.50], ELBOW_OUT, [0.55, 0.2, 0.8], [-0.2, 1.0, 0.25], hand::OFFER),
            key(1.1, [0.55, -0.35, 0.50], ELBOW_OUT, [0.55, 0.2, 0.8], [-0.2, 1.0, 0.25], hand::OFFER),
        ],
        WIDE,
    ),
    one(
        "all",
        &[],
        [0.55, 0.34, 1.1, 0.7],
        &[
            level(0.0, [0.20, -0.30, 0.54], -0.2),
            level(0.18, [-0.06, -0.30, 0.64], -0.45),
            level(0.34, [0.14, -0.30, 0.76], -0.05),
            level(0.52, [0.40, -0.30, 0.66], 0.3),
            level(0.70, [0.24, -0.30, 0.54], -0.1),
            level(1.1, [0.22, -0.31, 0.56], -0.1),
        ],
        ACROSS,
    ),
    one(
        "doubt",
        &["doubts", "so_so"],
        [0.5, 0.16, 1.0, 0.65],
        &[
            wavering(0.0, 0.4),
            wavering(0.16, -0.45),
            wavering(0.36, 0.42),
            wavering(0.56, -0.4),
            wavering(0.78, 0.3),
            wavering(1.0, 0.0),
        ],
        UNSURE,
    ),
    one(
        "doubt",
        &[],
        [0.5, 0.26, 1.0, 0.65],
        &[
            key(0.0, [0.28, -0.40, 0.60], ELBOW_LOW, [0.1, 0.1, 1.0], [-0.75, 0.7, 0.0], hand::OFFER),
            key(0.26, [0.32, -0.38, 0.60], ELBOW_LOW, [0.25, 0.15, 1.0], [-0.1, 1.0, 0.1], hand::OPEN),
            key(0.56, [0.28, -0.40, 0.60], ELBOW_LOW, [0.1, 0.1, 1.0], [-0.7, 0.75, 0.0], hand::OFFER),
            key(1.0, [0.30, -0.40, 0.60], ELBOW_LOW, [0.15, 0.1, 1.0], [-0.4, 0.95, 0.0], hand::OFFER),
        ],
        UNSURE,
    ),
    // Thoughts and senses.
    touching(one(
        "remember",
        &["remembers", "recalls"],
        [0.65, 0.0, 1.0, 0.75],
        &[
            key(0.0, [0.04, 0.24, 0.36], ELBOW_UP, [-0.6, 0.7, -0.4], [-0.6, -0.45, -0.6], hand::TEMPLE),
            key(0.5, [0.04, 0.245, 0.355], ELBOW_UP, [-0.6, 0.7, -0.4], [-0.6, -0.45, -0.6], hand::TEMPLE),
            key(1.0, [0.04, 0.24, 0.36], ELBOW_UP, [-0.6, 0.7, -0.4], [-0.6, -0.45, -0.6], hand::TEMPLE),
        ],
        RECALLING,
    )),
    one(
        "remember",
        &[],
        [0.6, 0.2, 1.1, 0.7],
        &[
            key(0.0, [0.24, 0.10, 0.46], ELBOW_LOW, [-0.2, 1.0, 0.2], [-0.8, 0.0, 0.2], hand::ONE),
            key(0.2, [0.28, 0.16, 0.42], ELBOW_LOW, [0.0, 1.0, -0.05], [-0.7, 0.0, 0.5], hand::ONE),
            key(0.42, [0.26, 0.14, 0.40], ELBOW_LOW, [-0.2, 1.0, 0.0], [-0.8, 0.0, 0.2], hand::ONE),
            key(0.62, [0.28, 0.16, 0.42], ELBOW_LOW, [0.0, 1.0, -0.05], [-0.7, 0.0, 0.5], hand::ONE),
            key(1.1, [0.27, 0.15, 0.42], ELBOW_LOW, [-0.1, 1.0, 0.0], [-0.75, 0.0, 0.4], hand::ONE),
        ],
        RECALLING,
    ),
    one(
        "idea",
        &[],
        [0.55, 0.18, 0.9, 0.7],
        &[
            key(0.0, [0.24, -0.08, 0.48], ELBOW_LOW, [-0.1, 1.0, 0.25], [-0.6, 0.0, 0.75], hand::ONE),
            key(0.18, [0.26, 0.12, 0.46], ELBOW_LOW, [-0.05, 1.0, 0.1], [-0.55, 0.0, 0.8], hand::ONE),
            key(0.9, [0.26, 0.11, 0.46], ELBOW_LOW, [-0.05, 1.0, 0.1], [-0.55, 0.0, 0.8], hand::ONE),
        ],
        BRIGHT,
    ),
    one(
        "idea",
        &[],
        [0.6, 0.3, 0.9, 0.7],
        &[
            key(0.0, [0.14, 0.08, 0.48], ELBOW_LOW, [-0.25, 1.0, 0.1], [-0.8, 0.0, -0.3], hand::BUNCH),
            key(0.3, [0.26, 0.14, 0.48], ELBOW_LOW, [0.05, 1.0, 0.15], [-0.7, 0.0, 0.5], hand::SPREAD),
            key(0.9, [0.26, 0.11, 0.48], ELBOW_LOW, [0.05, 1.0, 0.15], [-0.6, 0.0, 0.6], hand::OPEN),
        ],
        BRIGHT,
    ),
    one(
        "hear",
        &["hears", "listens"],
        [0.85, 0.0, 1.0, 0.85],
        &[
            key(0.0, [0.09, 0.22, 0.06], ELBOW_UP, [-0.5, 0.85, -0.1], [-0.45, 0.0, 0.9], hand::CUP),
            key(0.5, [0.09, 0.225, 0.06], ELBOW_UP, [-0.5, 0.85, -0.1], [-0.45, 0.0, 0.9], hand::CUP),
            key(1.0, [0.09, 0.22, 0.06], ELBOW_UP, [-0.5, 0.85, -0.1], [-0.45, 0.0, 0.9], hand::CUP),
        ],
        &[
            track(HeadYaw, &[(-0.4, 0.0), (0.05, 9.0), (0.8, 8.0), (1.6, 0.0)]),
            track(TrunkPitch, &[(-0.4, 0.0), (0.1, 3.0), (0.8, 2.5), (1.6, 0.0)]),
            face("browInnerUp", &[(-0.3, 0.0), (0.1, 0.3), (0.8, 0.2), (1.5, 0.0)]),
            face("browOuterUpRight", &[(-0.3, 0.0), (0.1, 0.3), (0.8, 0.2), (1.5, 0.0)]),
        ],
    ),
    one(
        "see",
        &["sees"],
        [0.6, 0.0, 1.15, 0.7],
        &[
            key(0.0, [-0.12, 0.11, 0.56], ELBOW_OUT, [-0.35, 0.85, -0.1], [-0.35, -0.3, -0.85], hand::TWO),
            key(0.20, [-0.12, 0.105, 0.56], ELBOW_OUT, [-0.35, 0.85, -0.1], [-0.35, -0.3, -0.85], hand::TWO),
            key(0.74, [0.06, 0.04, 0.74], ELBOW_OUT, [-0.2, 0.35, 1.0], [-0.25, -0.95, 0.2], hand::TWO),
            key(1.15, [0.06, 0.03, 0.74], ELBOW_OUT, [-0.2, 0.3, 1.0], [-0.25, -0.95, 0.2], hand::TWO),
        ],
        BEAT,
    ),
    one(
        "see",
        &[],
        [0.65, 0.0, 0.95, 0.75],
        &[
            key(0.0, [0.10, 0.42, 0.36], ELBOW_UP, [-0.95, 0.2, 0.1], [0.0, -1.0, -0.2], hand::FLAT),
            key(0.95, [0.10, 0.415, 0.365], ELBOW_UP, [-0.95, 0.2, 0.1], [0.0, -1.0, -0.2], hand::FLAT),
        ],
        &[
            track(HeadYaw, &[(-0.4, 0.0), (0.0, 5.0), (0.6, -6.0), (1.5, 0.0)]),
            track(HeadPitch, &[(-0.4, 0.0), (0.0, -2.0), (0.8, -1.0), (1.5, 0.0)]),
            face("eyeSquintLeft", &[(-0.2, 0.0), (0.1, 0.35), (0.8, 0.3), (1.4, 0.0)]),
            face("eyeSquintRight", &[(-0.2, 0.0), (0.1, 0.35), (0.8, 0.3), (1.4, 0.0)]),
        ],
    ),
    // Things that people do.
    one(
        "money",
        &[],
        [0.5, 0.1, 1.0, 0.6],
        &[
            rubbing(0.0, hand::RUB),
            rubbing(0.18, hand::RUB_BACK),
            rubbing(0.36, hand::RUB),
            rubbing(0.54, hand::RUB_BACK),
            rubbing(0.72, hand::RUB),
            rubbing(1.0, hand::RUB_BACK),
        ],
        BEAT,
    ),
    touching(one(
        "phone",
        &["phones", "call_me", "calls"],
        [0.65, 0.0, 1.2, 0.75],
        &[
            key(0.0, [0.02, 0.12, 0.17], ELBOW_OUT, [-0.3, 0.65, 0.55], [-0.95, 0.0, -0.3], hand::PHONE),
            key(0.6, [0.02, 0.125, 0.165], ELBOW_OUT, [-0.3, 0.65, 0.55], [-0.95, 0.0, -0.3], hand::PHONE),
            key(1.2, [0.02, 0.12, 0.17], ELBOW_OUT, [-0.3, 0.65, 0.55], [-0.95, 0.0, -0.3], hand::PHONE),
        ],
        &[
            track(HeadRoll, &[(-0.4, 0.0), (0.1, 7.0), (1.1, 6.0), (1.8, 0.0)]),
            face("browInnerUp", &[(-0.3, 0.0), (0.1, 0.25), (1.0, 0.12), (1.7, 0.0)]),
        ],
    )),
    touching(motion(
        "write",
        &["writes", "writing"],
        [0.6, 0.1, 1.3, 0.7],
        Arms::Pair(&[
            key(0.0, [-0.06, -0.50, 0.52], ELBOW_LOW, [-0.8, 0.1, 0.6], [-0.1, 1.0, -0.15], hand::FLAT),
            key(1.3, [-0.06, -0.50, 0.52], ELBOW_LOW, [-0.8, 0.1, 0.6], [-0.1, 1.0, -0.15], hand::FLAT),
        ]),
        &[
            writing(0.0, -0.04, 0.03),
            writing(0.14, -0.03, 0.0),
            writing(0.28, -0.005, 0.03),
            writing(0.42, 0.0, 0.0),
            writing(0.56, 0.025, 0.03),
            writing(0.70, 0.03, 0.0),
            writing(0.84, 0.055, 0.03),
            writing(0.98, 0.06, 0.0),
            writing(1.3, 0.08, 0.04),
        ],
        &[track(HeadPitch, &[(-0.4, 0.0), (0.1, 8.0), (0.9, 6.0), (1.8, 0.0)])],
    )),
    one(
        "write",
        &[],
        [0.55, 0.1, 1.1, 0.65],
        &[
            key(0.0, [-0.02, -0.10, 0.66], ELBOW_OUT, [-0.4, 0.45, 0.85], [-0.35, -0.75, 0.45], hand::PEN),
            key(0.18, [0.05, -0.05, 0.67], ELBOW_OUT, [-0.35, 0.5, 0.85], [-0.35, -0.75, 0.45], hand::PEN),
            key(0.34, [0.09, -0.12, 0.67], ELBOW_OUT, [-0.3, 0.42, 0.9], [-0.35, -0.75, 0.45], hand::PEN),
            key(0.50, [0.15, -0.06, 0.66], ELBOW_OUT, [-0.25, 0.5, 0.85], [-0.35, -0.75, 0.45], hand::PEN),
            key(0.66, [0.20, -0.13, 0.65], ELBOW_OUT, [-0.2, 0.42, 0.9], [-0.35, -0.75, 0.45], hand::PEN),
            key(0.82, [0.28, -0.08, 0.64], ELBOW_OUT, [-0.1, 0.48, 0.85], [-0.35, -0.75, 0.45], hand::PEN),
            key(1.1, [0.32, -0.10, 0.63], ELBOW_OUT, [-0.1, 0.45, 0.85], [-0.35, -0.75, 0.45], hand::PEN),
        ],
        BEAT,
    ),
    touching(one(
        "eat",
        &["eats", "eating"],
        [0.65, 0.0, 1.1, 0.75],
        &[eating(0.0, 0.0), eating(0.30, 0.12), eating(0.60, 0.0), eating(1.1, 0.06)],
        MOUTHFUL,
    )),
    touching(one(
        "drink",
        &["drinks", "drinking"],
        [0.65, 0.25, 1.1, 0.75],
        &[drinking(0.0, 0.0), drinking(0.30, 0.9), drinking(0.70, 1.0), drinking(1.1, 0.2)],
        &[
            track(HeadPitch, &[(-0.3, 0.0), (0.0, 2.0), (0.35, -9.0), (0.75, -10.0), (1.4, 0.0)]),
            face("mouthPucker", &[(-0.1, 0.0), (0.25, 0.3), (0.8, 0.25), (1.2, 0.0)]),
        ],
    )),
    touching(one(
        "sleep",
        &["sleeps", "sleeping"],
        [0.7, 0.0, 1.3, 0.8],
        &[
            key(0.0, [0.0, 0.08, 0.24], ELBOW_OUT, [-0.3, 0.95, -0.2], [-0.9, 0.35, -0.25], hand::FLAT),
            key(1.3, [0.0, 0.075, 0.24], ELBOW_OUT, [-0.3, 0.95, -0.2], [-0.9, 0.35, -0.25], hand::FLAT),
        ],
        &[
            track(HeadRoll, &[(-0.5, 0.0), (0.1, 17.0), (1.2, 16.0), (2.0, 0.0)]),
            track(HeadPitch, &[(-0.5, 0.0), (0.1, 4.0), (1.2, 5.0), (2.0, 0.0)]),
            face("eyeBlinkLeft", &[(-0.3, 0.0), (0.05, 0.9), (1.1, 0.9), (1.6, 0.0)]),
            face("eyeBlinkRight", &[(-0.3, 0.0), (0.05, 0.9), (1.1, 0.9), (1.6, 0.0)]),
        ],
    )),
    touching(motion(
        "thanks",
        &["thank_you"],
        [0.6, 0.14, 1.0, 0.7],
        Arms::Together,
        &[
            key(0.0, [-0.283, -0.22, 0.40], ELBOW_OUT, [-0.02, 1.0, 0.25], [-1.0, 0.0, 0.0], hand::FLAT),
            key(0.14, [-0.285, -0.25, 0.40], ELBOW_OUT, [-0.02, 1.0, 0.35], [-1.0, 0.0, 0.0], hand::FLAT),
            key(1.0, [-0.285, -0.245, 0.40], ELBOW_OUT, [-0.02, 1.0, 0.35], [-1.0, 0.0, 0.0], hand::FLAT),
        ],
        THANKING,
    )),
    touching(one(
        "thanks",
        &[],
        [0.55, 0.0, 1.0, 0.7],
        &[
            touching_heart(0.0, 0.0, hand::FLAT),
            touching_heart(0.36, 0.02, hand::FLAT),
            key(0.68, [0.10, -0.34, 0.62], ELBOW_OUT, [-0.3, 0.2, 1.0], [-0.5, 0.9, -0.1], hand::OFFER),
            key(1.0, [0.12, -0.36, 0.64], ELBOW_OUT, [-0.2, 0.15, 1.0], [-0.4, 0.95, 0.0], hand::OFFER),
        ],
        THANKING,
    )),
    // Variants of the gestures that act alone.
    head(
        "nod",
        &[],
        [0.16, 0.17, 0.5, 0.4],
        &[
            track(HeadPitch, &[(-0.16, 0.0), (0.0, -1.5), (0.17, 11.0), (0.42, 1.0), (0.62, 3.0), (0.9, 0.0)]),
            track(TrunkPitch, &[(-0.1, 0.0), (0.24, 1.5), (0.9, 0.0)]),
        ],
    ),
    head(
        "shake",
        &[],
        [0.2, 0.16, 0.8, 0.4],
        &[
            track(HeadYaw, &[(-0.2, 0.0), (0.16, 13.0), (0.44, -13.0), (0.74, 7.0), (1.2, 0.0)]),
            track(HeadPitch, &[(-0.2, 0.0), (0.2, 3.0), (0.7, 2.0), (1.2, 0.0)]),
            face("browDownLeft", &[(-0.15, 0.0), (0.2, 0.2), (0.7, 0.1), (1.2, 0.0)]),
            face("browDownRight", &[(-0.15, 0.0), (0.2, 0.2), (0.7, 0.1), (1.2, 0.0)]),
        ],
    ),
    one(
        "wave",
        &[],
        [0.6, 0.0, 0.8, 0.7],
        &[waving(0.0, 0.35), waving(0.22, -0.2), waving(0.44, 0.3), waving(0.8, 0.1)],
        &[
            track(HeadRoll, &[(-0.4, 0.0), (0.1, 4.0), (0.7, 3.0), (1.4, 0.0)]),
            face("browInnerUp", &[(-0.4, 0.0), (0.0, 0.3), (0.5, 0.12), (1.2, 0.0)]),
            face("mouthSmileLeft", &[(-0.3, 0.0), (0.2, 0.45), (0.8, 0.35), (1.5, 0.0)]),
            face("mouthSmileRight", &[(-0.3, 0.0), (0.2, 0.4), (0.8, 0.32), (1.5, 0.0)]),
        ],
    ),
    one(
        "shrug",
        &[],
        [0.5, 0.0, 0.6, 0.6],
        &[
            key(0.0, [0.44, -0.36, 0.42], ELBOW_LOW, [0.85, 0.18, 0.7], [-0.15, 1.0, 0.30], hand::OPEN),
            key(0.6, [0.43, -0.39, 0.42], ELBOW_LOW, [0.85, 0.10, 0.7], [-0.10, 1.0, 0.25], hand::OPEN),
        ],
        &[
            track(Collars, &[(-0.4, 0.0), (0.0, 17.0), (0.4, 14.0), (1.0, 0.0)]),
            track(HeadRoll, &[(-0.4, 0.0), (0.05, 9.0), (0.5, 7.0), (1.1, 0.0)]),
            track(TrunkRoll, &[(-0.4, 0.0), (0.05, 2.0), (0.5, 1.5), (1.1, 0.0)]),
            face("browInnerUp", &[(-0.4, 0.0), (-0.05, 0.5), (0.5, 0.4), (1.0, 0.0)]),
            face("mouthShrugLower", &[(-0.35, 0.0), (0.0, 0.4), (0.5, 0.35), (1.0, 0.0)]),
        ],
    ),
    touching(one(
        "think",
        &[],
        [0.65, 0.0, 1.6, 0.8],
        &[
            key(0.0, [0.04, 0.24, 0.36], ELBOW_UP, [-0.6, 0.7, -0.4], [-0.6, -0.45, -0.6], hand::TEMPLE),
            key(0.4, [0.045, 0.235, 0.375], ELBOW_UP, [-0.58, 0.7, -0.38], [-0.6, -0.45, -0.6], hand::TEMPLE),
            key(0.7, [0.04, 0.24, 0.36], ELBOW_UP, [-0.6, 0.7, -0.4], [-0.6, -0.45, -0.6], hand::TEMPLE),
            key(1.6, [0.04, 0.24, 0.36], ELBOW_UP, [-0.6, 0.7, -0.4], [-0.6, -0.45, -0.6], hand::TEMPLE),
        ],
        RECALLING,
    )),
    both(
        "stop",
        &[],
        [0.6, 0.16, 0.95, 0.7],
        &[
            refusing(0.0, [0.16, -0.04, 0.66], 0.0),
            refusing(0.16, [0.18, -0.06, 0.78], 0.0),
            refusing(0.95, [0.18, -0.065, 0.78], 0.0),
        ],
        FIRM,
    ),
    one(
        "beckon",
        &[],
        [0.55, 0.22, 0.9, 0.65],
        &[
            offering(0.0, [0.24, -0.34, 0.72], 0.0),
            key(0.22, [0.18, -0.30, 0.56], ELBOW_LOW, [-0.35, 0.6, 0.7], [-0.3, 0.75, -0.7], hand::HOOK),
            key(0.9, [0.18, -0.31, 0.56], ELBOW_LOW, [-0.35, 0.55, 0.75], [-0.3, 0.8, -0.6], hand::RELAXED),
        ],
        OFFER,
    ),
];
