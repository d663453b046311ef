//! Every gesture has its characteristic pose, fades in and out without jumps, and leaves the model's bits
//! unchanged before and after.

#![expect(clippy::cast_possible_truncation, reason = "a test has few frames")]

use umo_core_pose::frame::Cue;
use umo_core_pose::skeleton::{ARKIT_NAMES, FIRST_FINGER, JOINTS, Skeleton};

use super::table::Key;
use super::*;
use crate::attention::Weights;
use crate::{Controls, LayerGains, trial};

/// Offsets of the body and of the left hand; the right hand is mirrored.
#[rustfmt::skip]
const OFFSETS: [[f32; 3]; 40] = [
    [0.0, 0.0, 0.0], [0.085, -0.085, 0.0], [-0.085, -0.085, 0.0], [0.0, 0.11, -0.015], [0.01, -0.4, 0.005],
    [-0.01, -0.4, 0.005], [0.0, 0.13, 0.0], [0.0, -0.41, -0.03], [0.0, -0.41, -0.03], [0.0, 0.06, 0.02],
    [0.02, -0.06, 0.12], [-0.02, -0.06, 0.12], [0.0, 0.2, -0.035], [0.06, 0.11, -0.02], [-0.06, 0.11, -0.02],
    [0.0, 0.09, 0.03], [0.115, 0.035, -0.01], [-0.115, 0.035, -0.01], [0.265, -0.01, -0.015], [-0.265, -0.01, -0.015],
    [0.25, 0.005, 0.0], [-0.25, 0.005, 0.0], [0.0, -0.005, 0.02], [0.032, 0.065, 0.07], [-0.032, 0.065, 0.07],
    [0.092, 0.0, 0.026], [0.038, 0.0, 0.0], [0.024, 0.0, 0.0], [0.095, 0.003, 0.004], [0.042, 0.0, 0.0],
    [0.027, 0.0, 0.0], [0.081, -0.004, -0.036], [0.03, 0.0, 0.0], [0.018, 0.0, 0.0], [0.089, 0.0, -0.017],
    [0.039, 0.0, 0.0], [0.025, 0.0, 0.0], [0.026, -0.012, 0.028], [0.029, -0.006, 0.026], [0.022, -0.004, 0.018],
];

const FRAMES: usize = 210;
const ELBOWS: [usize; 2] = [18, 19];
const WRISTS: [usize; 2] = [20, 21];

fn rig() -> Rig {
    let mirror = |[x, y, z]: [f32; 3]| [-x, y, z];
    let right_hand = OFFSETS[FIRST_FINGER..].iter().map(|&place| mirror(place));
    let offsets_m = OFFSETS.into_iter().chain(right_hand).collect();
    Rig::new(&Skeleton { offsets_m, ..trial::skeleton() }, &trial::face(true), &Pose::REST)
}

/// Frame of the model: hanging arms in motion, and a moving head.
fn base(index: usize) -> OwnedFrame {
    let t = index as f32 / 30.0;
    let mut pose = Pose::REST;
    pose.translation = [0.1, 0.9, -0.2];
    let turn = |x: f32, y: f32, z: f32| axis_angle_to_quat([x, y, z]);
    pose.rotations[0] = turn(0.02, 0.05 * (0.7 * t).sin(), 0.0);
    pose.rotations[15] = turn(0.05 * (1.7 * t).sin(), 0.04 * t.cos(), 0.0);
    for (side, shoulder, elbow) in [(1.0, 16, 18), (-1.0, 17, 19)] {
        pose.rotations[shoulder] = turn(0.1 * (1.1 * t).sin(), 0.0, side * -1.25);
        pose.rotations[elbow] = turn(0.0, side * (-0.4 - 0.2 * (1.3 * t).sin()), 0.0);
    }
    for joint in FIRST_FINGER..JOINTS {
        let side = if joint < 40 { -1.0 } else { 1.0 };
        pose.rotations[joint] = turn(0.0, 0.0, side * 0.25);
    }
    let mut frame = OwnedFrame::new(pose, &[0.1; ARKIT_NAMES.len()]);
    frame.index = index as u64;
    frame
}

/// A player over the model's frames.
struct Stage {
    rig: Rig,
    player: Player,
    controls: Controls,
    gestures: Gestures,
}

impl Stage {
    fn with(gestures: Gestures) -> Self {
        let player = Player::new(gestures.clone());
        Self { rig: rig(), player, controls: Controls::new(LayerGains::OFF), gestures }
    }

    fn new() -> Self {
        Self::with(Gestures::new())
    }

    fn play(&mut self, name: &str, options: GestureOptions) -> Result<(), RequestError> {
        let request = Request::new(&self.gestures, name, &options, 30, self.player.epoch)?;
        self.controls.gestures.push(request, self.player.begun())
    }

    fn frame(&mut self, index: usize) -> OwnedFrame {
        let mut frame = base(index);
        let tick = Tick {
            number: index as u64,
            seconds: 1.0 / 30.0,
            seed: 0,
            cue: Cue::default(),
            controls: &self.controls,
            weights: Weights::default(),
            glance: None,
            rig: &self.rig,
            lively: 0.0,
            shift: 0.0,
            stride: Default::default(),
            resting: [0.0; 2],
            gain: 1.0,
        };
        self.player.apply(&mut frame, &tick);
        frame
    }

    fn frames(&mut self) -> Vec<OwnedFrame> {
        (0..FRAMES).map(|index| self.frame(index)).collect()
    }
}

fn played(name: &str, options: GestureOptions) -> Vec<OwnedFrame> {
    let mut stage = Stage::new();
    stage.play(name, options).unwrap();
    let frames = stage.frames();
    assert!(stage.player.is_empty(&stage.controls.gestures), "{name} does not end");
    frames
}

fn bits(frame: &OwnedFrame) -> Vec<u32> {
    let OwnedFrame { pose, face, .. } = frame;
    pose.rotations.as_flattened().iter().chain(&pose.translation).chain(face.iter()).map(|v| v.to_bits()).collect()
}

/// The frame `seconds` after the end of a gesture's preparation.
fn at<'a>(frames: &'a [OwnedFrame], name: &str, seconds: f32) -> &'a OwnedFrame {
    let motion = MOTIONS.iter().find(|motion| motion.name == name).unwrap();
    &frames[((motion.preparation + seconds) * 30.0).round() as usize]
}

fn places(frame: &OwnedFrame) -> [Vec3; JOINTS] {
    rig().world(&frame.pose).0
}

fn direction(frame: &OwnedFrame, joint: usize, rest: Vec3) -> Vec3 {
    rotate(rig().world(&frame.pose).1[joint], rest)
}

fn angle(a: Quat, b: Quat) -> f32 {
    2.0 * a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>().abs().min(1.0).acos().to_degrees()
}

/// Largest rotation of any joint between two frames, degrees, and the joint.
fn largest_step(frames: &[OwnedFrame]) -> (f32, usize) {
    let steps = frames.windows(2).flat_map(|pair| {
        let turned = |j: usize| angle(pair[0].pose.rotations[j], pair[1].pose.rotations[j]);
        (0..JOINTS).map(move |j| (turned(j), j)).collect::<Vec<_>>()
    });
    steps.max_by(|a, b| a.0.total_cmp(&b.0)).unwrap()
}

/// Forward lean of the chest, degrees.
fn lean(frame: &OwnedFrame) -> f32 {
    let up = direction(frame, CHEST, [0.0, 1.0, 0.0]);
    up[2].atan2(up[1]).to_degrees()
}

/// Number of reversals of a curve after a change of at least `least`.
fn turns(values: impl Iterator<Item = f32>, least: f32) -> usize {
    let values: Vec<f32> = values.collect();
    let (mut extreme, mut way, mut count) = (values[0], 0.0_f32, 0);
    for &value in &values {
        if way * (value - extreme) >= 0.0 && way != 0.0 {
            extreme = value;
        } else if (value - extreme).abs() > least {
            count += usize::from(way != 0.0);
            (extreme, way) = (value, (value - extreme).signum());
        }
    }
    count
}

/// Whether each finger of the right hand is straight: index, middle, ring, pinky, thumb.
fn straight(frame: &OwnedFrame) -> [bool; 5] {
    let out = [-1.0, 0.0, 0.0];
    let hand = direction(frame, 21, out);
    let fingers = [42, 45, 51, 48].map(|joint| arm::dot(direction(frame, joint, out), hand) > 0.9);
    let bones = [52, 53, 54].map(|joint| direction(frame, joint, out));
    let index = arm::dot(bones[0], hand);
    let is_out = arm::dot(bones[0], bones[2]) > 0.95 && index < 0.97;
    [fingers[0], fingers[1], fingers[2], fingers[3], is_out]
}

/// Each gesture's poses as variants, in the order of the names.
fn variants() -> Vec<(&'static str, u8)> {
    let gestures = Gestures::new();
    let poses = |name: &'static str| (0..gestures.poses(name) as u8).map(move |variant| (name, variant));
    MOTIONS
        .iter()
        .map(|motion| motion.name)
        .collect::<std::collections::BTreeSet<_>>()
        .into_iter()
        .flat_map(poses)
        .collect()
}

/// The fastest that a variant may be.
const FASTEST: f32 = 1.15;

#[test]
fn no_gesture_jumps_and_all_end_where_the_model_is() {
    for (name, variant) in variants() {
        for (side, speed) in [(Side::Auto, 1.0), (Side::Left, 1.4), (Side::Both, 1.0)] {
            let options = GestureOptions::default().side(side).speed(speed).variant(variant).at(1.5);
            let frames = played(name, options);
            let (step, joint) = largest_step(&frames);
            // Fingers are the fastest joints: they open within a quarter of a second.
            let most = if joint >= FIRST_FINGER { 24.0 } else { 16.0 } * if variant > 0 { FASTEST } else { 1.0 };
            let which = format!("{name}, variant {variant}, {side:?}, {speed}");
            assert!(step < most * speed, "{which}: joint {joint} turns by {step} in a frame");
            assert!(step > 0.7, "{which} does nothing");
            assert_eq!(bits(&frames[5]), bits(&base(5)), "{which} begins early");
            assert_eq!(bits(&frames[FRAMES - 1]), bits(&base(FRAMES - 1)), "{which} leaves something");
            for frame in &frames {
                let lengths = frame.pose.rotations.iter().map(|q| q.iter().map(|v| v * v).sum::<f32>());
                assert!(lengths.into_iter().all(|length| (length - 1.0).abs() < 1e-4));
                assert!(frame.face.iter().all(|value| (0.0..=1.0).contains(value)));
            }
        }
    }
}

#[test]
fn hands_go_at_peoples_speeds_and_not_through_the_body() {
    for (name, variant) in variants() {
        let frames = played(name, GestureOptions::default().variant(variant));
        for wrist in WRISTS {
            let steps =
                frames.windows(2).map(|pair| arm::length(less(places(&pair[1])[wrist], places(&pair[0])[wrist])));
            let fastest = 30.0 * steps.fold(0.0, f32::max);
            assert!(fastest < 2.5 * FASTEST, "{name}, variant {variant}: {fastest} m/s");
        }
        for frame in &frames {
            let (places, turned) = rig().world(&frame.pose);
            let knuckles = [28, 43];
            for joint in WRISTS.into_iter().chain(knuckles).chain(ELBOWS) {
                let [x, y, z] = rotate(inverse(turned[CHEST]), less(places[joint], places[CHEST]));
                let inside = (x / 0.15).powi(2) + (z / 0.09).powi(2);
                assert!(
                    inside > 1.0 || !(-0.35..=0.2).contains(&y),
                    "{name}, variant {variant}: joint {joint} in the body: {x} {y} {z}"
                );
            }
        }
    }
}

#[test]
fn a_wave_is_over_the_shoulder_and_swings() {
    for (side, wrist, shoulder) in [(Side::Auto, 21, 17), (Side::Left, 20, 16)] {
        let frames = played("wave", GestureOptions::default().side(side));
        let (from, to) = (23, 64);
        for frame in &frames[from..to] {
            let places = places(frame);
            assert!(places[wrist][1] > places[shoulder][1] + 0.08, "{side:?}");
            // The palm faces ahead.
            assert!(direction(frame, wrist, [0.0, -1.0, 0.0])[2] > 0.75, "{side:?}");
        }
        let swings = turns(frames[from..to].iter().map(|frame| places(frame)[wrist][0]), 0.05);
        assert!(swings >= 4, "{side:?}: {swings}");
    }
    let both = played("wave", GestureOptions::default().side(Side::Both));
    let places = places(at(&both, "wave", 0.5));
    assert!(places[20][1] > places[16][1] && places[21][1] > places[17][1]);
}

#[test]
fn the_head_nods_and_shakes() {
    let head = |frame: &OwnedFrame, index: usize| {
        let there = direction(frame, HEAD_JOINT, [0.0, 0.0, 1.0]);
        let model = direction(&base(index), HEAD_JOINT, [0.0, 0.0, 1.0]);
        [model[1].asin() - there[1].asin(), there[0].atan2(there[2]) - model[0].atan2(model[2])].map(f32::to_degrees)
    };
    let turned = |name: &str, axis: usize| -> Vec<f32> {
        played(name, GestureOptions::default()).iter().enumerate().map(|(i, frame)| head(frame, i)[axis]).collect()
    };
    let nod = turned("nod", 0);
    assert!(nod.iter().copied().fold(0.0, f32::max) > 10.0, "{nod:?}");
    assert!(turns(nod.iter().copied(), 3.0) >= 4);
    let shake = turned("shake", 1);
    let (least, most) = shake.iter().fold((0.0_f32, 0.0_f32), |(least, most), &v| (least.min(v), most.max(v)));
    assert!(least < -12.0 && most > 12.0);
    assert!(turns(shake.iter().copied(), 5.0) >= 3);
}

#[test]
fn a_shrug_lifts_the_shoulders_and_shows_the_palms() {
    let frames = played("shrug", GestureOptions::default());
    let frame = at(&frames, "shrug", 0.2);
    let model = base(frame.index as usize);
    for (shoulder, wrist) in [(16, 20), (17, 21)] {
        assert!(places(frame)[shoulder][1] > places(&model)[shoulder][1] + 0.03);
        assert!(direction(frame, wrist, [0.0, -1.0, 0.0])[1] > 0.7);
    }
}

#[test]
fn a_bow_leans_over_standing_feet() {
    let frames = played("bow", GestureOptions::default());
    let frame = at(&frames, "bow", 0.6);
    let model = base(frame.index as usize);
    assert!(lean(frame) - lean(&model) > 30.0, "{}", lean(frame));
    for (index, frame) in frames.iter().enumerate() {
        let (there, model) = (places(frame), places(&base(index)));
        for foot in [7, 8, 10, 11] {
            assert!(arm::length(less(there[foot], model[foot])) < 1e-3, "frame {index}: a foot moves");
        }
    }
}

#[test]
fn the_index_finger_points_at_the_place() {
    for target in
        [[2.0, 1.2, 3.0], [-2.5, 0.4, 1.0], [0.2, 2.2, 4.0], [-0.6, 1.0, 0.9], [1.5, 0.1, 0.6], [30.0, 5.0, 2.0]]
    {
        let frames = played("point", GestureOptions::default().target(target));
        let is_left = target[0] > 0.1;
        for frame in &frames[21..44] {
            let places = places(frame);
            let (knuckle, tip) = if is_left { (25, 27) } else { (40, 42) };
            let finger = arm::unit(less(places[tip], places[knuckle]), [0.0; 3]);
            let way = arm::unit(less(target, places[knuckle]), [0.0; 3]);
            let off = arm::dot(finger, way).min(1.0).acos().to_degrees();
            assert!(off < 5.0, "{target:?}: {off} degrees off");
        }
    }
}

#[test]
fn a_thumb_is_up_over_a_fist() {
    let frames = played("thumbs_up", GestureOptions::default());
    let frame = at(&frames, "thumbs_up", 0.4);
    let places = places(frame);
    let thumb = arm::unit(less(places[54], places[53]), [0.0; 3]);
    assert!(thumb[1] > 0.85, "{thumb:?}");
    assert_eq!(straight(frame)[..4], [false; 4]);
}

#[test]
fn as_many_fingers_are_straight_as_are_counted() {
    for (name, fingers) in
        [("count_one", 1), ("count_two", 2), ("count_three", 3), ("count_four", 4), ("count_five", 5)]
    {
        let frames = played(name, GestureOptions::default());
        let frame = at(&frames, name, 0.4);
        let straight = straight(frame);
        assert_eq!(straight.iter().filter(|&&is| is).count(), fingers, "{name}: {straight:?}");
        assert!(places(frame)[45][1] > places(frame)[21][1] || fingers < 2);
    }
    let frames = played("count", GestureOptions::default());
    for (time, fingers) in [(0.3, 1), (0.95, 2), (1.6, 3), (2.2, 4), (2.9, 5)] {
        assert_eq!(straight(at(&frames, "count", time)).iter().filter(|&&is| is).count(), fingers, "{time} s");
    }
}

#[test]
fn other_gestures_have_their_poses() {
    let shown = |name: &str, time: f32| at(&played(name, GestureOptions::default()), name, time).clone();
    let think = places(&shown("think", 1.0));
    let chin = [think[15][0], think[15][1] - 0.05, think[15][2] + 0.08];
    assert!(arm::length(less(think[42], chin)) < 0.12, "{:?} {chin:?}", think[42]);
    let stop = shown("stop", 0.5);
    assert!(direction(&stop, 21, [0.0, -1.0, 0.0])[2] > 0.85 && places(&stop)[21][2] > places(&stop)[17][2] + 0.3);
    let me = places(&shown("me", 0.4));
    assert!(arm::length(less(me[43], me[9])) < 0.22, "{:?}", less(me[43], me[9]));
    // Hands meet side by side.
    let frames = played("clap", GestureOptions::default());
    let apart = |time: f32| {
        let places = places(at(&frames, "clap", time));
        arm::length(less(places[28], places[43]))
    };
    assert!((0.02..0.085).contains(&apart(0.48)), "{}", apart(0.48));
    assert!(apart(0.64) > 0.18);
    let beckon = played("beckon", GestureOptions::default());
    assert!(straight(at(&beckon, "beckon", 0.0))[..4] == [true; 4]);
    assert!(straight(at(&beckon, "beckon", 0.24))[..4] == [false; 4]);
}

#[test]
fn a_stroke_falls_at_its_time() {
    let frames = played("nod", GestureOptions::default().at(3.0));
    let low = |index: &usize| {
        let pitch = |frame: &OwnedFrame| direction(frame, HEAD_JOINT, [0.0, 0.0, 1.0])[1];
        pitch(&frames[*index]) - pitch(&base(*index))
    };
    let lowest = (0..FRAMES).min_by(|a, b| low(a).total_cmp(&low(b))).unwrap();
    assert!(lowest.abs_diff(90) <= 1, "{lowest}");
    // A request that comes too late begins at once.
    let mut stage = Stage::new();
    (0..60).for_each(|index| drop(stage.frame(index)));
    stage.play("nod", GestureOptions::default().at(1.0)).unwrap();
    let late: Vec<OwnedFrame> = (60..66).map(|index| stage.frame(index)).collect();
    assert_ne!(bits(&late[5]), bits(&base(65)));
}

#[test]
fn speed_and_strength_are_kept() {
    let length = |speed: f32| {
        let frames = played("nod", GestureOptions::default().speed(speed));
        frames.iter().enumerate().filter(|(index, frame)| bits(frame) != bits(&base(*index))).count()
    };
    let (slow, plain, fast) = (length(0.5), length(1.0), length(2.0));
    assert!((slow as f32 / plain as f32 - 2.0).abs() < 0.15 && (plain as f32 / fast as f32 - 2.0).abs() < 0.2);
    let none = played("wave", GestureOptions::default().strength(0.0));
    assert!(none.iter().enumerate().all(|(index, frame)| bits(frame) == bits(&base(index))));
    let height =
        |strength: f32| places(at(&played("wave", GestureOptions::default().strength(strength)), "wave", 0.2))[21][1];
    assert!(height(0.3) < height(0.7) && height(0.7) < height(1.0));
}

#[test]
fn left_is_right_in_a_mirror() {
    let mirror = |frame: &OwnedFrame| -> Vec<Vec3> {
        let places = places(frame);
        let root = places[0];
        let other = |j: usize| match j {
            16 | 18 | 20 => j + 1,
            17 | 19 | 21 => j - 1,
            25..40 => j + 15,
            40.. => j - 15,
            _ => j,
        };
        [16, 17, 18, 19, 20, 21, 27, 42]
            .iter()
            .map(|&j| less(places[other(j)], root))
            .map(|[x, y, z]| [-x, y, z])
            .collect()
    };
    let (right, left) =
        (played("wave", GestureOptions::default()), played("wave", GestureOptions::default().side(Side::Left)));
    let (right, left) = (at(&right, "wave", 0.3), at(&left, "wave", 0.3));
    let there: Vec<Vec3> =
        [16, 17, 18, 19, 20, 21, 27, 42].iter().map(|&j| less(places(left)[j], places(left)[0])).collect();
    // The model's pelvis is turned slightly, and that turn is not mirrored.
    assert!(there.iter().zip(mirror(right)).all(|(a, b)| arm::length(less(*a, b)) < 0.06));
    let shape =
        |frame: &OwnedFrame, name: &str| frame.face[ARKIT_NAMES.iter().position(|known| *known == name).unwrap()];
    assert_eq!(shape(right, "mouthSmileLeft"), shape(left, "mouthSmileRight"));
}

/// Poses of every motion at some times, over a body that is its own mirror image.
#[test]
fn every_motion_is_mirrored() {
    let rig = rig();
    for (number, motion) in MOTIONS.iter().enumerate() {
        for share in [0.0, 0.3, 0.7, 1.0] {
            let shown = |is_mirrored: bool| {
                let request = Request { gesture: number as u32, strength: 1.0, variant: 3, ..Request::NONE };
                let playing = Playing { request, is_mirrored, ..Playing::NONE };
                let mut frame = OwnedFrame::new(Pose::REST, &[0.0; ARKIT_NAMES.len()]);
                let all = Shares { whole: 1.0, arms: 1.0, fingers: 1.0 };
                show(&mut frame, &rig, &playing, motion, motion.preparation + share * motion.length, all);
                frame
            };
            let (right, left) = (places(&shown(false)), places(&shown(true)));
            let other = |joint: usize| match joint {
                13 | 16 | 18 | 20 => joint + 1,
                14 | 17 | 19 | 21 => joint - 1,
                25..40 => joint + 15,
                40.. => joint - 15,
                _ => joint,
            };
            for joint in [12, 15].into_iter().chain(16..22).chain(FIRST_FINGER..JOINTS) {
                let [x, y, z] = right[other(joint)];
                let off = arm::length(less(left[joint], [-x, y, z]));
                assert!(off < 1e-4, "{}, motion {number}, {share}: joint {joint} is {off} m off", motion.name);
            }
        }
    }
}

#[test]
fn arms_reach_what_is_drawn_within_their_limits() {
    let rig = rig();
    for motion in &MOTIONS {
        let second = if let Arms::Pair(keys) = motion.arms { keys } else { &[] };
        for (arm, key) in motion.keys.iter().map(|key| (RIGHT, key)).chain(second.iter().map(|key| (LEFT, key))) {
            let Key { at, hand, elbow, fingers, palm, shape } = *key;
            let pose = arm.pose(&rig, &ArmTarget { hand, elbow, fingers, palm, shape }, None);
            let bend = angle(pose.elbow, [0.0, 0.0, 0.0, 1.0]);
            assert!(bend < 165.0, "{} at {at}: the elbow turns by {bend}", motion.name);
            // Limits of forearm and wrist would turn the hand elsewhere.
            let turned = product(product(product(pose.collar, pose.shoulder), pose.elbow), pose.wrist);
            let rest = arm::unit(rig.offsets[arm.first_finger + 3], [0.0; 3]);
            let off = arm::dot(rotate(turned, rest), arm.sided(arm::unit(fingers, [0.0; 3])));
            assert!(off > 0.97, "{} at {at}: the fingers are {} off", motion.name, off.acos().to_degrees());
            for finger in 0..4 {
                let [first, second, third, lean] = [0, 1, 2, 3].map(|angle| shape[4 * finger + angle]);
                let is_human = (0.0..=90.0).contains(&first)
                    && (0.0..=105.0).contains(&second)
                    && (0.0..=70.0).contains(&third)
                    && (-23.0..=14.0).contains(&lean);
                assert!(is_human, "{} at {at}: finger {finger} bends by {first} {second} {third}, {lean}", motion.name);
            }
        }
    }
}

#[test]
fn a_variant_is_its_own_and_the_same_each_time() {
    let wrist = |name: &str, variant: u8| places(&played(name, GestureOptions::default().variant(variant))[30])[21];
    for name in ["sweep", "ring", "future"] {
        let all: Vec<Vec3> = (0..6).map(|variant| wrist(name, variant)).collect();
        for (variant, place) in all.iter().enumerate() {
            assert_eq!(*place, wrist(name, variant as u8));
            assert!(all[..variant].iter().all(|other| arm::length(less(*other, *place)) > 0.002), "{name} {variant}");
        }
    }
    // A hand that touches the body stays there.
    let frames = |variant: u8| played("heart", GestureOptions::default().speed(1.0).variant(variant));
    let touch = |variant: u8| {
        let frame = &frames(variant)[27];
        less(places(frame)[21], places(frame)[CHEST])
    };
    assert!(arm::length(less(touch(0), touch(2))) < 0.02);
    let gestures = Gestures::new();
    assert_eq!((gestures.poses("sweep"), gestures.poses("point"), gestures.poses("fly")), (2, 1, 0));
}

#[test]
fn one_hand_is_the_left_and_the_other_hand_the_right() {
    for (name, side, wrist) in [
        ("one_hand", Side::Auto, 20),
        ("one_hand", Side::Right, 21),
        ("other_hand", Side::Auto, 21),
        ("other_hand", Side::Left, 20),
    ] {
        let frame = &played(name, GestureOptions::default().side(side))[24];
        let height = |wrist: usize| places(frame)[wrist][1];
        assert!(height(wrist) > height(41 - wrist) + 0.1, "{name}, {side:?}");
    }
    // A contrast shows the left hand, then the right one.
    let frames = played("contrast", GestureOptions::default());
    let lift = |time: f32| {
        let places = places(at(&frames, "contrast", time));
        places[20][1] - places[21][1]
    };
    assert!(lift(0.3) > 0.08 && lift(1.5) < 0.05, "{} {}", lift(0.3), lift(1.5));
}

#[test]
fn small_signs_of_the_head_are_as_small_as_peoples() {
    for (name, axis) in [("small_nod", 0), ("small_shake", 1)] {
        for variant in 0..2 {
            let frames = played(name, GestureOptions::default().variant(variant));
            let turned = |(index, frame): (usize, &OwnedFrame)| {
                let of =
                    |frame: &OwnedFrame| product(frame.pose.rotations[NECK_JOINT], frame.pose.rotations[HEAD_JOINT]);
                let by = product(inverse(of(&base(index))), of(frame));
                2.0 * by[axis].abs().min(1.0).asin().to_degrees()
            };
            let most = frames.iter().enumerate().map(turned).fold(0.0, f32::max);
            assert!((4.0..8.0).contains(&most), "{name}, variant {variant}: {most}");
        }
    }
}

#[test]
fn gestures_of_the_same_parts_wait_and_others_do_not() {
    let mut stage = Stage::new();
    for name in ["count_one", "count_two", "nod"] {
        stage.play(name, GestureOptions::default()).unwrap();
    }
    stage.frame(0);
    assert_eq!((stage.player.shown, stage.player.waiting, stage.player.begun()), (2, 1, 2));
    let frames: Vec<OwnedFrame> = (1..FRAMES).map(|index| stage.frame(index)).collect();
    assert!(stage.player.is_empty(&stage.controls.gestures));
    assert!(largest_step(&frames).0 < 16.0);
    let counted = |fingers: usize| {
        frames.iter().position(|f| {
            straight(f).iter().filter(|&&is| is).count() == fingers && places(f)[21][1] > places(f)[17][1] - 0.1
        })
    };
    assert!(counted(1).unwrap() < counted(2).unwrap());
    // The second number follows the first without lowering the hand.
    let between = &frames[counted(1).unwrap()..counted(2).unwrap()];
    assert!(between.iter().all(|frame| places(frame)[21][1] > places(frame)[17][1] - 0.25));
}

#[test]
fn a_queue_that_is_full_says_so_and_wrong_requests_are_refused() {
    let mut stage = Stage::new();
    let later = GestureOptions::default().at(100.0);
    for _ in 0..MAX_PENDING_GESTURES {
        stage.play("nod", later).unwrap();
    }
    assert_eq!(stage.play("nod", later), Err(RequestError::GesturesFull));
    stage.frame(0);
    assert_eq!(stage.play("nod", later), Err(RequestError::GesturesFull));
    stage.player.interrupt(1, 3, 30.0, &stage.controls.gestures);
    assert_eq!(stage.play("nod", later), Ok(()));
    assert_eq!(stage.play("fly", later), Err(RequestError::UnknownGesture));
    for (options, error) in [
        (GestureOptions::default().speed(0.4), RequestError::GestureOptions),
        (GestureOptions::default().speed(f32::NAN), RequestError::GestureOptions),
        (GestureOptions::default().strength(1.1), RequestError::GestureOptions),
        (GestureOptions::default().at(-1.0), RequestError::GestureTime),
        (GestureOptions::default().at(f64::NAN), RequestError::GestureTime),
        (GestureOptions::default().at(1e18), RequestError::GestureTime),
        (GestureOptions::default().target([0.0, f32::INFINITY, 0.0]), RequestError::GestureTarget),
    ] {
        assert_eq!(stage.play("wave", options), Err(error), "{options:?}");
    }
}

#[test]
fn an_interrupt_lets_go_with_an_ease() {
    for (ticks, end) in [(20, 20), (0, 9)] {
        let mut stage = Stage::new();
        stage.play("wave", GestureOptions::default()).unwrap();
        stage.play("wave", GestureOptions::default()).unwrap();
        let mut frames: Vec<OwnedFrame> = (0..40).map(|index| stage.frame(index)).collect();
        stage.player.interrupt(1, ticks, 30.0, &stage.controls.gestures);
        // Requests after the interrupt are played.
        stage.play("nod", GestureOptions::default().at(5.0)).unwrap();
        frames.extend((40..120).map(|index| stage.frame(index)));
        assert!(largest_step(&frames).0 < 22.0, "{ticks}: {:?}", largest_step(&frames));
        assert_ne!(bits(&frames[40 + end - 2]), bits(&base(40 + end - 2)));
        assert_eq!(bits(&frames[40 + end + 1]), bits(&base(40 + end + 1)), "{ticks}");
        let rest: Vec<OwnedFrame> = (120..FRAMES).map(|index| stage.frame(index)).collect();
        assert_ne!(bits(&rest[30]), bits(&base(150)));
    }
    let mut stage = Stage::new();
    stage.play("wave", GestureOptions::default()).unwrap();
    (0..30).for_each(|index| drop(stage.frame(index)));
    stage.player.reset(1, &stage.controls.gestures);
    assert_eq!(bits(&stage.frame(0)), bits(&base(0)));
}

#[test]
fn a_hosts_clip_is_shown_where_it_moves() {
    let turned = axis_angle_to_quat([0.0, 0.0, 0.9]);
    let frames: Vec<[Quat; JOINTS]> = (0..61).map(|_| [turned; JOINTS]).collect();
    let clip = |parts| Gesture::new("salute", 30.0, &frames, 1.0, parts).unwrap();
    let mut gestures = Gestures::new();
    assert!(gestures.add(clip(GestureParts::LEFT_ARM)).unwrap());
    assert!(!gestures.add(clip(GestureParts::RIGHT_ARM)).unwrap());
    assert_eq!(gestures.names().last(), Some("salute"));
    assert_eq!(gestures.in_text("he gives a salute"), Some("salute"));
    for (side, joint, other, wanted) in
        [(Side::Auto, 17, 16, turned), (Side::Left, 16, 17, [0.0, 0.0, -turned[2], turned[3]])]
    {
        let mut stage = Stage::with(gestures.clone());
        stage.play("salute", GestureOptions::default().at(2.0).side(side)).unwrap();
        let frames = stage.frames();
        assert_eq!(frames[60].pose.rotations[joint], wanted);
        assert_eq!(frames[60].pose.rotations[other], base(60).pose.rotations[other]);
        assert_eq!(frames[60].pose.rotations[0], base(60).pose.rotations[0]);
        assert!(largest_step(&frames).0 < 22.0);
        assert_eq!(bits(&frames[FRAMES - 1]), bits(&base(FRAMES - 1)));
    }
    for (name, rate, count, stroke, parts) in [
        ("", 30.0, 61, 1.0, 1),
        ("a\nb", 30.0, 61, 1.0, 1),
        ("salute", 0.0, 61, 1.0, 1),
        ("salute", f32::NAN, 61, 1.0, 1),
        ("salute", 30.0, 1, 0.0, 1),
        ("salute", 30.0, 61, 2.1, 1),
        ("salute", 30.0, 61, -0.1, 1),
        ("salute", 30.0, 61, 1.0, 0),
    ] {
        let parts = GestureParts::from_bits(parts).unwrap();
        assert!(Gesture::new(name, rate, &frames[..count], stroke, parts).is_err(), "{name:?} {rate} {count} {stroke}");
    }
    assert!(Gesture::new("salute", 30.0, &[[[f32::NAN; 4]; JOINTS]; 2], 0.0, GestureParts::ALL).is_err());
}
