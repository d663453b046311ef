//! A person's rig and a run of the layers over a still pose, for the layers' tests.

use umo_core_base::state::StatePass;
use umo_core_pose::face::{Face, FaceKind};
use umo_core_pose::frame::OwnedFrame;
use umo_core_pose::pose::Pose;
use umo_core_pose::rotation::{product, quat_to_matrix};
use umo_core_pose::skeleton::{ARKIT_NAMES, JOINTS, Skeleton};

use super::rig::{DEGREE, EYES, Rig, arkit, turn, turn_vector};
use super::{Company, Controls, Cue, Gestures, Layer, LayerGains, LayerStack, Mood, Role, WordRules};

pub(super) const SECONDS: f32 = 1.0 / 30.0;

const PARENTS: [i32; JOINTS] = [
    -1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 15, 15, 15, 20, 25, 26, 20, 28, 29, 20,
    31, 32, 20, 34, 35, 20, 37, 38, 21, 40, 41, 21, 43, 44, 21, 46, 47, 21, 49, 50, 21, 52, 53,
];

/// Body of a person of 1.7 m with arms held out, in centimetres; limbs of the left side only.
#[rustfmt::skip]
const BODY: [[f32; 3]; 25] = [
    [0.0, 0.0, 0.0], [8.0, -9.0, 0.0], [-8.0, -9.0, 0.0], [0.0, 11.0, -2.0], [1.0, -40.0, 0.0], [-1.0, -40.0, 0.0],
    [0.0, 13.0, 0.0], [0.0, -41.0, -3.0], [0.0, -41.0, -3.0], [0.0, 6.0, 2.0], [2.0, -6.0, 12.0], [-2.0, -6.0, 12.0],
    [0.0, 21.0, -3.0], [6.0, 11.0, -2.0], [-6.0, 11.0, -2.0], [0.0, 9.0, 3.0], [12.0, 4.0, -1.0], [-12.0, 4.0, -1.0],
    [26.0, -1.0, -2.0], [-26.0, -1.0, -2.0], [25.0, 1.0, 0.0], [-25.0, 1.0, 0.0], [0.0, 0.0, 1.0], [3.0, 7.0, 6.0],
    [-3.0, 7.0, 6.0],
];

/// Skeleton of that person.
pub(super) fn skeleton() -> Skeleton {
    let mut offsets_m: Vec<[f32; 3]> = BODY.map(|place| place.map(|cm| cm / 100.0)).into();
    for side in [1.0, -1.0] {
        for finger in [2.0, 0.0, -4.0, -2.0, 4.0] {
            offsets_m.extend([[0.09 * side, 0.0, finger / 100.0], [0.04 * side, 0.0, 0.0], [0.03 * side, 0.0, 0.0]]);
        }
    }
    Skeleton { parents: PARENTS.to_vec(), offsets_m }
}

/// Pose with arms hanging down and feet on the floor.
pub(super) fn standing() -> Pose {
    let mut pose = Pose::REST;
    pose.translation = [0.0, 0.98, 0.0];
    pose.rotations[16] = turn([0.0, 0.0, -70.0 * DEGREE]);
    pose.rotations[17] = turn([0.0, 0.0, 70.0 * DEGREE]);
    pose
}

/// Face with all ARKit shapes, or with other shapes.
pub(super) fn face(is_arkit: bool) -> Face {
    if is_arkit {
        Face { kind: FaceKind::Arkit, names: ARKIT_NAMES.map(str::to_owned).into() }
    } else {
        Face { kind: FaceKind::SmplxExpression, names: (0..10).map(|i| format!("expression_{i}")).collect() }
    }
}

/// The layers, the host's controls and the decoders' input.
pub(super) struct Trial {
    pub(super) rig: Rig,
    pub(super) stack: LayerStack,
    pub(super) controls: Controls,
    /// The decoders' frame.
    pub(super) frame: OwnedFrame,
}

impl Trial {
    /// Creates a run with only these layers, at full gain.
    pub(crate) fn new(layers: &[Layer], seed: u64) -> Self {
        Self::of(layers, seed, &skeleton(), &face(true), &standing())
    }

    pub(super) fn of(layers: &[Layer], seed: u64, skeleton: &Skeleton, face: &Face, rest: &Pose) -> Self {
        let rig = || Rig::new(skeleton, face, rest);
        let config = layers.iter().fold(LayerGains::OFF, |config, &layer| config.with(layer, 1.0));
        Self {
            rig: rig(),
            stack: LayerStack::of(rig(), SECONDS, seed, Gestures::default(), WordRules::english()),
            controls: Controls::new(config),
            frame: OwnedFrame::new(*rest, &vec![0.0; face.names.len()]),
        }
    }

    /// Runs one tick and returns the frame shown.
    pub(super) fn tick(&mut self) -> OwnedFrame {
        let mut frame = self.frame.clone();
        self.stack.apply(&mut frame, &self.controls, None);
        frame
    }

    pub(super) fn ticks(&mut self, count: usize) -> Vec<OwnedFrame> {
        (0..count).map(|_| self.tick()).collect()
    }

    /// Runs ticks of the avatar's speech: phrases of 2 s with syllables, and pauses of 0.6 s.
    pub(super) fn speak(&mut self, count: usize) -> Vec<OwnedFrame> {
        let shown = (0..count).map(|tick| {
            self.frame.cue = Cue { level: speech(tick), ..Cue::default() };
            self.tick()
        });
        let shown = shown.collect();
        self.frame.cue = Cue::default();
        shown
    }

    /// Directions of the left and the right eye in the avatar's space.
    pub(super) fn looks(&self, frame: &OwnedFrame) -> [[f32; 3]; 2] {
        let (_, turned) = self.rig.world(&frame.pose);
        EYES.map(|eye| turn_vector(turned[eye], [0.0, 0.0, 1.0]))
    }

    /// Saves the state as bytes.
    pub(crate) fn save(&mut self) -> Vec<u8> {
        let mut size = StatePass::size();
        self.stack.state(&mut size).unwrap();
        let mut bytes = vec![0; size.end().unwrap()];
        let mut pass = StatePass::save(&mut bytes, 0, 0);
        self.stack.state(&mut pass).unwrap();
        let length = pass.end().unwrap();
        bytes.truncate(length);
        bytes
    }

    pub(super) fn load(&mut self, bytes: &[u8]) {
        let mut pass = StatePass::check(bytes, 0).unwrap();
        self.stack.state(&mut pass).unwrap();
        pass.end().unwrap();
        let mut pass = StatePass::load(bytes, 0);
        self.stack.state(&mut pass).unwrap();
        pass.end().unwrap();
    }
}

/// Level of a voice at a tick: phrases of 2 s, pauses of 0.6 s.
#[expect(clippy::cast_precision_loss, reason = "few ticks")]
pub(super) fn speech(tick: usize) -> f32 {
    let phase = tick % 78;
    let syllable = 0.5 + 0.5 * (tick as f32 * 1.1).sin();
    if phase < 60 { 0.02 + 0.18 * syllable * syllable } else { 0.0 }
}

/// Panics if a frame is invalid.
pub(super) fn assert_sound(frame: &OwnedFrame) {
    for q in frame.pose.rotations {
        let square: f32 = q.iter().map(|v| v * v).sum();
        assert!((square - 1.0).abs() < 1e-3 && q[3] >= 0.0, "{q:?}");
    }
    assert!(frame.pose.translation.iter().chain(&frame.face).all(|value| value.is_finite()));
}

/// Angle between two directions, degrees.
pub(super) fn degrees(a: [f32; 3], b: [f32; 3]) -> f32 {
    let length = |v: [f32; 3]| v.iter().map(|v| v * v).sum::<f32>().sqrt();
    let dot: f32 = a.iter().zip(b).map(|(a, b)| a * b).sum();
    (dot / (length(a) * length(b))).clamp(-1.0, 1.0).acos() / DEGREE
}

/// Yaw, pitch and roll of a joint in the avatar's space, degrees.
pub(super) fn turned(trial: &Trial, frame: &OwnedFrame, joint: usize) -> [f32; 3] {
    let (_, turned) = trial.rig.world(&frame.pose);
    let m = quat_to_matrix(turned[joint]);
    [m[0][2].atan2(m[2][2]), (-m[1][2]).asin(), m[1][0].atan2(m[1][1])].map(|angle| angle / DEGREE)
}

/// Standard deviation.
#[expect(clippy::cast_precision_loss, reason = "few values")]
pub(super) fn deviation(values: impl Iterator<Item = f32> + Clone) -> f32 {
    let count = values.clone().count() as f32;
    let mean = values.clone().sum::<f32>() / count;
    (values.map(|value| (value - mean).powi(2)).sum::<f32>() / count).sqrt()
}

/// Value of one ARKit shape.
pub(super) fn shape(frame: &OwnedFrame, name: &'static str) -> f32 {
    frame.face[arkit(name)]
}

/// Rotates `q` about the vertical.
pub(super) fn yawed(q: [f32; 4], degrees: f32) -> [f32; 4] {
    product(turn([0.0, degrees * DEGREE, 0.0]), q)
}

/// A person who speaks, with a nod asked for every 3 s.
fn person(tick: usize) -> Company {
    Company {
        role: Some(Role::Listening),
        has_place: true,
        place: [0.2, 0.1, 1.5],
        is_contact: tick % 90 < 60,
        nods: u32::try_from(tick / 90).unwrap(),
        resting: 1.0,
        ..Company::ALONE
    }
}

/// Runs a dialogue with every layer.
fn dialogue(trial: &mut Trial, ticks: std::ops::Range<usize>) -> Vec<OwnedFrame> {
    let shown = ticks.map(|tick| {
        let speaks = tick / 300 % 2 == 0;
        trial.frame.cue.level = if speaks { speech(tick) } else { 0.0 };
        trial.controls.company = if speaks { Company::ALONE } else { person(tick) };
        let is_asked = tick / 200 % 3 == 1;
        (trial.controls.look_at, trial.controls.look_at_strength) = ([0.8, 1.4, 1.0], f32::from(u8::from(is_asked)));
        trial.controls.mood = Mood::ALL[tick / 150 % Mood::ALL.len()];
        trial.controls.mood_strength = 0.8;
        trial.tick()
    });
    shown.collect()
}

fn same(a: &OwnedFrame, b: &OwnedFrame) -> bool {
    let bits = |frame: &OwnedFrame| -> Vec<u32> {
        let values = frame.pose.rotations.as_flattened().iter().chain(&frame.pose.translation).chain(&*frame.face);
        values.map(|value| value.to_bits()).collect()
    };
    bits(a) == bits(b)
}

#[test]
fn the_same_seed_gives_the_same_bits_and_another_one_others() {
    let run = |seed| dialogue(&mut Trial::new(&Layer::ALL, seed), 0..900);
    let (a, b, c) = (run(5), run(5), run(6));
    assert!(a.iter().zip(&b).all(|(a, b)| same(a, b)));
    assert!(a.iter().zip(&c).filter(|(a, c)| same(a, c)).count() < 10);
    a.iter().for_each(assert_sound);
}

#[test]
fn restored_layers_go_on_with_the_same_bits() {
    for stop in [0, 1, 77, 350, 640] {
        let mut trial = Trial::new(&Layer::ALL, 5);
        dialogue(&mut trial, 0..stop);
        let state = trial.save();
        let wanted = dialogue(&mut trial, stop..stop + 300);
        // Loads into layers in another state.
        let mut other = Trial::new(&Layer::ALL, 5);
        dialogue(&mut other, 200..480);
        other.load(&state);
        let got = dialogue(&mut other, stop..stop + 300);
        assert!(wanted.iter().zip(&got).all(|(a, b)| same(a, b)), "{stop}");
    }
}

#[test]
fn a_reset_is_a_start() {
    let mut trial = Trial::new(&Layer::ALL, 5);
    let wanted = dialogue(&mut trial, 0..400);
    let controls = trial.controls;
    trial.stack.reset(0, &controls);
    let got = dialogue(&mut trial, 0..400);
    assert!(wanted.iter().zip(&got).all(|(a, b)| same(a, b)));
}

#[test]
fn a_gain_of_0_leaves_every_bit() {
    let mut trial = Trial::new(&[], 5);
    let given = trial.frame.clone();
    assert!(dialogue(&mut trial, 0..200).iter().all(|frame| same(frame, &given)));
    for layer in Layer::ALL {
        let mut trial = Trial::new(&Layer::ALL.into_iter().filter(|&other| other != layer).collect::<Vec<_>>(), 5);
        dialogue(&mut trial, 0..60).iter().for_each(assert_sound);
    }
}

#[test]
fn odd_bodies_and_faces_stay_sound() {
    let mut random = 0_u64;
    let mut draw = || {
        random += 1;
        2.0 * super::noise::uniform(1, super::noise::Stream(9), random) - 1.0
    };
    for case in 0..24 {
        let mut skeleton = skeleton();
        for (joint, parent) in skeleton.parents.iter_mut().enumerate().skip(1) {
            if case % 3 == 0 {
                *parent = i32::try_from(joint / (case + 2)).unwrap();
            }
        }
        let size = [0.0, 1e-6, 0.3, 50.0][case % 4];
        skeleton.offsets_m.iter_mut().flatten().for_each(|value| *value = size * draw());
        let mut rest = Pose::REST;
        rest.rotations.iter_mut().for_each(|q| *q = super::rig::unit([draw(), draw(), draw(), draw()]));
        let mut faces = face(case % 2 == 0);
        // Some shapes are missing, and the others are in another order.
        faces.names.reverse();
        faces.names.truncate(faces.names.len() - 2 * (case % 5));
        let mut trial = Trial::of(&Layer::ALL, case as u64, &skeleton, &faces, &rest);
        for _ in 0..60 {
            trial.frame.pose.rotations.iter_mut().for_each(|q| *q = super::rig::unit([draw(), draw(), draw(), draw()]));
            trial.frame.face.iter_mut().for_each(|value| *value = draw().abs());
            trial.frame.cue.level = draw().abs();
            trial.controls.company = Company { place: [9.0 * draw(), 9.0 * draw(), 9.0 * draw()], ..person(case) };
            trial.controls.look_at = [9.0 * draw(), 9.0 * draw(), 9.0 * draw()];
            trial.controls.look_at_strength = draw().abs();
            assert_sound(&trial.tick());
        }
    }
}
