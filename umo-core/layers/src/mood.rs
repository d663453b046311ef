//! Face and posture of a mood; without a mood, the model's unintended frown is removed.

use umo_core_base::functions::Functions;
use umo_core_base::state::{StateError, StatePass};
use umo_core_pose::frame::OwnedFrame;

use super::Tick;
use super::rig::{DEGREE, HEAD, NECK, arkit, step, turn_in_parent};

/// A mood that face and posture show.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mood {
    /// No mood: the model's face without its frown.
    #[default]
    Neutral = 0,
    /// Smile, open chest.
    Joy = 1,
    /// Inner brows up, corners of the mouth and head down.
    Sad = 2,
    /// Brows down, lips pressed, head forward.
    Angry = 3,
    /// Brows and upper lids up, jaw a little open, head back.
    Surprised = 4,
    /// Nose wrinkled, upper lip raised, head back and turned.
    Disgusted = 5,
    /// Brows up and together, eyes wide, shoulders raised.
    Afraid = 6,
}

impl Mood {
    /// All moods in numeric order.
    pub const ALL: [Self; 7] =
        [Self::Neutral, Self::Joy, Self::Sad, Self::Angry, Self::Surprised, Self::Disgusted, Self::Afraid];

    /// Name of the mood.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Neutral => "neutral",
            Self::Joy => "joy",
            Self::Sad => "sad",
            Self::Angry => "angry",
            Self::Surprised => "surprised",
            Self::Disgusted => "disgusted",
            Self::Afraid => "afraid",
        }
    }
}

/// Number of moods except neutral.
const MOODS: usize = Mood::ALL.len() - 1;

/// Time constant of each of the two low-passes over a mood's strength, seconds: 95 % of a change takes
/// 1 s.
const STRENGTH_FILTER_SECONDS: f32 = 0.21;

/// Share by which the liveliest voice scales a mood.
const VOICE_SHARE: f32 = 0.3;

/// Value up to which a frown shape is left unchanged, and upper bound of the compressed value, if no
/// mood frowns.
const FROWN_KNEE: f32 = 0.04;
const MAX_FROWN: f32 = 0.1;

const FROWN: [usize; 8] = [
    arkit("browDownLeft"),
    arkit("browDownRight"),
    arkit("mouthFrownLeft"),
    arkit("mouthFrownRight"),
    arkit("noseSneerLeft"),
    arkit("noseSneerRight"),
    arkit("eyeSquintLeft"),
    arkit("eyeSquintRight"),
];

/// Index in `FROWN` of the squint shapes, which a smile has too.
const SQUINT: usize = 6;

const SMILE: [usize; 2] = [arkit("mouthSmileLeft"), arkit("mouthSmileRight")];
const JAW_OPEN: usize = arkit("jawOpen");

/// Shapes that close or round the lips: speech takes precedence over a mood.
const LIPS: [usize; 3] = [arkit("mouthClose"), arkit("mouthPucker"), arkit("mouthFunnel")];

/// A face shape of a mood and its amount at strength 1: positive adds to the face, negative removes that
/// share.
struct Part {
    shape: usize,
    amount: f32,
    /// Whether the shape is part of the mouth, which speaks.
    is_mouth: bool,
}

const fn upper(name: &str, amount: f32) -> Part {
    Part { shape: arkit(name), amount, is_mouth: false }
}

const fn mouth(name: &str, amount: f32) -> Part {
    Part { shape: arkit(name), amount, is_mouth: true }
}

/// Face shapes of each mood except neutral.
const FACES: [&[Part]; MOODS] = [
    // Joy: cheeks and lower lids make the smile genuine.
    &[
        mouth("mouthSmileLeft", 0.62),
        mouth("mouthSmileRight", 0.62),
        mouth("mouthDimpleLeft", 0.12),
        mouth("mouthDimpleRight", 0.12),
        mouth("mouthUpperUpLeft", 0.12),
        mouth("mouthUpperUpRight", 0.12),
        mouth("mouthFrownLeft", -0.9),
        mouth("mouthFrownRight", -0.9),
        upper("cheekSquintLeft", 0.55),
        upper("cheekSquintRight", 0.55),
        upper("eyeSquintLeft", 0.38),
        upper("eyeSquintRight", 0.38),
        upper("browInnerUp", 0.1),
        upper("browOuterUpLeft", 0.14),
        upper("browOuterUpRight", 0.14),
        upper("browDownLeft", -0.9),
        upper("browDownRight", -0.9),
    ],
    // Sad.
    &[
        upper("browInnerUp", 0.65),
        upper("browDownLeft", 0.14),
        upper("browDownRight", 0.14),
        upper("browOuterUpLeft", -0.8),
        upper("browOuterUpRight", -0.8),
        upper("eyeSquintLeft", 0.2),
        upper("eyeSquintRight", 0.2),
        mouth("mouthFrownLeft", 0.5),
        mouth("mouthFrownRight", 0.5),
        mouth("mouthShrugLower", 0.28),
        mouth("mouthSmileLeft", -0.85),
        mouth("mouthSmileRight", -0.85),
    ],
    // Angry.
    &[
        upper("browDownLeft", 0.8),
        upper("browDownRight", 0.8),
        upper("browInnerUp", -0.8),
        upper("browOuterUpLeft", -0.5),
        upper("browOuterUpRight", -0.5),
        upper("eyeSquintLeft", 0.35),
        upper("eyeSquintRight", 0.35),
        upper("eyeWideLeft", 0.25),
        upper("eyeWideRight", 0.25),
        upper("noseSneerLeft", 0.3),
        upper("noseSneerRight", 0.3),
        mouth("mouthPressLeft", 0.4),
        mouth("mouthPressRight", 0.4),
        mouth("mouthFrownLeft", 0.28),
        mouth("mouthFrownRight", 0.28),
        mouth("mouthSmileLeft", -0.9),
        mouth("mouthSmileRight", -0.9),
    ],
    // Surprised.
    &[
        upper("browInnerUp", 0.7),
        upper("browOuterUpLeft", 0.72),
        upper("browOuterUpRight", 0.72),
        upper("browDownLeft", -1.0),
        upper("browDownRight", -1.0),
        upper("eyeWideLeft", 0.6),
        upper("eyeWideRight", 0.6),
        upper("eyeSquintLeft", -0.9),
        upper("eyeSquintRight", -0.9),
        mouth("jawOpen", 0.14),
        mouth("mouthFunnel", 0.1),
    ],
    // Disgusted.
    &[
        upper("noseSneerLeft", 0.7),
        upper("noseSneerRight", 0.6),
        upper("browDownLeft", 0.4),
        upper("browDownRight", 0.4),
        upper("cheekSquintLeft", 0.35),
        upper("cheekSquintRight", 0.35),
        upper("eyeSquintLeft", 0.4),
        upper("eyeSquintRight", 0.4),
        mouth("mouthUpperUpLeft", 0.4),
        mouth("mouthUpperUpRight", 0.32),
        mouth("mouthFrownLeft", 0.3),
        mouth("mouthFrownRight", 0.3),
        mouth("mouthSmileLeft", -0.85),
        mouth("mouthSmileRight", -0.85),
    ],
    // Afraid.
    &[
        upper("browInnerUp", 0.75),
        upper("browOuterUpLeft", 0.3),
        upper("browOuterUpRight", 0.3),
        upper("browDownLeft", 0.12),
        upper("browDownRight", 0.12),
        upper("eyeWideLeft", 0.65),
        upper("eyeWideRight", 0.65),
        upper("eyeSquintLeft", -0.9),
        upper("eyeSquintRight", -0.9),
        mouth("mouthStretchLeft", 0.4),
        mouth("mouthStretchRight", 0.4),
        mouth("mouthSmileLeft", -0.85),
        mouth("mouthSmileRight", -0.85),
    ],
];

const SPINE2: usize = 6;
const SPINE3: usize = 9;
const LEFT_COLLAR: usize = 13;
const RIGHT_COLLAR: usize = 14;
const LEFT_SHOULDER: usize = 16;
const RIGHT_SHOULDER: usize = 17;
const JAW: usize = umo_core_pose::skeleton::JAW;

/// Posture of each mood at strength 1: turns in degrees about X (forward), Y (to the left) and Z (the
/// left side up), in the parent's frame.
const POSTURES: [&[(usize, [f32; 3])]; MOODS] = [
    // Joy: chest open, chin up.
    &[
        (SPINE2, [-1.5, 0.0, 0.0]),
        (SPINE3, [-2.5, 0.0, 0.0]),
        (NECK, [0.5, 0.0, 0.0]),
        (HEAD, [-1.5, 0.0, 1.0]),
        (LEFT_COLLAR, [0.0, -1.5, 1.5]),
        (RIGHT_COLLAR, [0.0, 1.5, -1.5]),
        (LEFT_SHOULDER, [0.0, 0.0, 1.5]),
        (RIGHT_SHOULDER, [0.0, 0.0, -1.5]),
    ],
    // Sad: the body sinks.
    &[
        (SPINE2, [3.5, 0.0, 0.0]),
        (SPINE3, [4.5, 0.0, 0.0]),
        (NECK, [5.0, 0.0, 0.0]),
        (HEAD, [4.5, 0.0, 2.0]),
        (LEFT_COLLAR, [0.0, -2.0, -3.5]),
        (RIGHT_COLLAR, [0.0, 2.0, 3.5]),
    ],
    // Angry: head forward, shoulders up.
    &[
        (SPINE2, [1.5, 0.0, 0.0]),
        (SPINE3, [2.0, 0.0, 0.0]),
        (NECK, [6.0, 0.0, 0.0]),
        (HEAD, [-3.5, 0.0, 0.0]),
        (LEFT_COLLAR, [0.0, 0.0, 3.0]),
        (RIGHT_COLLAR, [0.0, 0.0, -3.0]),
        (LEFT_SHOULDER, [0.0, 0.0, 1.5]),
        (RIGHT_SHOULDER, [0.0, 0.0, -1.5]),
    ],
    // Surprised: head and chest back.
    &[
        (SPINE2, [-1.5, 0.0, 0.0]),
        (SPINE3, [-2.0, 0.0, 0.0]),
        (NECK, [-3.5, 0.0, 0.0]),
        (HEAD, [0.5, 0.0, 0.0]),
        (JAW, [2.5, 0.0, 0.0]),
        (LEFT_COLLAR, [0.0, 0.0, 4.0]),
        (RIGHT_COLLAR, [0.0, 0.0, -4.0]),
    ],
    // Disgusted: back and away.
    &[
        (SPINE2, [-1.5, 1.0, 0.0]),
        (SPINE3, [-1.5, 1.5, 0.0]),
        (NECK, [-3.0, 3.5, 0.0]),
        (HEAD, [0.0, 3.5, 2.5]),
        (LEFT_COLLAR, [0.0, 0.0, 1.5]),
        (RIGHT_COLLAR, [0.0, 0.0, -1.5]),
    ],
    // Afraid: shoulders up, head drawn in.
    &[
        (SPINE2, [2.0, 0.0, 0.0]),
        (SPINE3, [1.5, 0.0, 0.0]),
        (NECK, [-4.0, 0.0, 0.0]),
        (HEAD, [1.5, 0.0, 0.0]),
        (LEFT_COLLAR, [0.0, -2.0, 7.0]),
        (RIGHT_COLLAR, [0.0, 2.0, -7.0]),
        (LEFT_SHOULDER, [0.0, 0.0, -4.0]),
        (RIGHT_SHOULDER, [0.0, 0.0, 4.0]),
    ],
];

/// Current mood.
#[derive(Debug)]
pub(super) struct Expression {
    /// Strength of each mood except neutral after the first and the second low-pass.
    halfway: [f32; MOODS],
    strengths: [f32; MOODS],
    /// Whether a tick has run.
    is_started: bool,
}

impl Expression {
    pub(crate) fn new() -> Self {
        Self { halfway: [0.0; MOODS], strengths: [0.0; MOODS], is_started: false }
    }

    /// Applies one tick to the frame.
    pub(crate) fn apply(&mut self, frame: &mut OwnedFrame, tick: &Tick) {
        self.advance(tick);
        self.calm(frame, tick);
        let (rig, face) = (tick.rig, &mut frame.face);
        // The mood's mouth shapes are weaker while the lips speak.
        let open = rig.shape(face, JAW_OPEN);
        let lips: f32 = LIPS.iter().map(|&shape| rig.shape(face, shape)).fold(0.0, f32::max);
        let speaks = (1.0 - 0.7 * open.min(1.0)) * (1.0 - 0.7 * lips.min(1.0));
        for (mood, &strength) in self.strengths.iter().enumerate() {
            let strength = strength * tick.gain * scale(mood, tick.lively);
            if strength < MIN_STRENGTH {
                continue;
            }
            for part in FACES[mood] {
                let value = rig.shape(face, part.shape);
                let share = part.amount * strength;
                let room = if share > 0.0 { 1.0 - value } else { value };
                let share = if part.is_mouth && share > 0.0 { share * speaks } else { share };
                rig.set_shape(face, part.shape, value + share * room);
            }
            for &(joint, degrees) in POSTURES[mood] {
                turn_in_parent(&mut frame.pose.rotations[joint], degrees.map(|angle| strength * angle * DEGREE));
            }
        }
    }

    /// Moves the strengths towards the host's request.
    fn advance(&mut self, tick: &Tick) {
        let wanted = tick.controls.mood as usize;
        let strength = tick.controls.mood_strength.clamp(0.0, 1.0);
        let share = if std::mem::replace(&mut self.is_started, true) {
            step(tick.seconds, STRENGTH_FILTER_SECONDS)
        } else {
            1.0
        };
        for (mood, (halfway, now)) in self.halfway.iter_mut().zip(&mut self.strengths).enumerate() {
            let goal = if mood + 1 == wanted { strength } else { 0.0 };
            *halfway += share * (goal - *halfway);
            *now += share * (*halfway - *now);
        }
    }

    /// Removes the model's frown unless a mood frowns.
    fn calm(&self, frame: &mut OwnedFrame, tick: &Tick) {
        let strength = |mood: Mood| self.strengths[mood as usize - 1];
        let frowns = strength(Mood::Sad) + strength(Mood::Angry) + strength(Mood::Disgusted);
        let share = tick.gain * (1.0 - frowns).max(0.0);
        let (rig, face) = (tick.rig, &mut frame.face);
        let smile = SMILE.map(|shape| rig.shape(face, shape));
        for (number, shape) in FROWN.into_iter().enumerate() {
            let value = rig.shape(face, shape);
            let more = if number < SQUINT { 0.0 } else { 0.5 * smile[number - SQUINT] };
            rig.set_shape(face, shape, value + share * (calmed(value, more) - value));
        }
    }

    /// Saves or loads the layer between two ticks.
    pub(crate) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.moderate(&mut self.halfway)?;
        pass.moderate(&mut self.strengths)?;
        pass.switch("mood", &mut self.is_started)?;
        Ok(())
    }
}

/// Factor of a mood's strength by the voice: a lively one shows more of it, or of sadness less.
fn scale(mood: usize, lively: f32) -> f32 {
    1.0 + VOICE_SHARE * if mood + 1 == Mood::Sad as usize { -lively } else { lively }
}

/// Strength below which a mood has no effect.
const MIN_STRENGTH: f32 = 1e-3;

/// Compresses a frown value: unchanged up to the knee, then smoothly reduced, always below
/// [`MAX_FROWN`]. Both bounds are raised by `more`.
fn calmed(value: f32, more: f32) -> f32 {
    let (knee, room) = (FROWN_KNEE + more, MAX_FROWN - FROWN_KNEE);
    let beyond = value - knee;
    if beyond <= 0.0 { value } else { knee + room * (1.0 - (-beyond / room).exponential()) }
}

#[cfg(test)]
mod tests {
    use umo_core_pose::skeleton::ARKIT_NAMES;

    use super::super::trial::{Trial, assert_sound, shape, turned};
    use super::super::{Cue, Layer};
    use super::*;

    fn set(trial: &mut Trial, mood: Mood, strength: f32) {
        (trial.controls.mood, trial.controls.mood_strength) = (mood, strength);
    }

    #[test]
    fn neutral_is_never_angry() {
        let mut trial = Trial::new(&[Layer::Mood, Layer::Asymmetry], 3);
        let mut before: Option<f32> = None;
        for step in 0..=500_u16 {
            let frown = f32::from(step) / 500.0;
            FROWN.iter().for_each(|&shape| trial.frame.face[shape] = frown);
            let shown = trial.tick();
            for &shape in &FROWN {
                assert!(shown.face[shape] <= 0.15, "{} {frown}", ARKIT_NAMES[shape]);
            }
            // Small values are unchanged; larger input never gives a smaller output.
            let now = calmed(frown, 0.0);
            assert!(frown > FROWN_KNEE || now == frown);
            assert!(before.is_none_or(|before| now >= before && now - before < 0.003), "{frown}");
            before = Some(now);
        }
        // The squint of a smile stays.
        trial.frame.face.fill(0.0);
        for shape in [arkit("eyeSquintLeft"), arkit("mouthSmileLeft")] {
            trial.frame.face[shape] = 0.3;
        }
        assert!(trial.tick().face[arkit("eyeSquintLeft")] > 0.2);
    }

    #[test]
    fn a_mood_that_frowns_keeps_the_frown() {
        let mut trial = Trial::new(&[Layer::Mood], 3);
        trial.frame.face[arkit("browDownLeft")] = 0.5;
        set(&mut trial, Mood::Angry, 1.0);
        let shown = trial.ticks(60).pop().unwrap();
        assert!(shape(&shown, "browDownLeft") > 0.8, "{}", shape(&shown, "browDownLeft"));
        trial.controls.layers = trial.controls.layers.with(Layer::Mood, 0.0).with(Layer::Idle, 1.0);
        trial.ticks(12);
        assert_eq!(shape(&trial.tick(), "browDownLeft"), 0.5);
    }

    #[test]
    fn moods_show_in_face_and_posture_and_go_again_without_a_jump() {
        let (joint, still) = (HEAD, Trial::new(&[Layer::Mood], 3).tick());
        for (mood, name, direction) in [
            (Mood::Joy, "mouthSmileLeft", -1.0),
            (Mood::Sad, "browInnerUp", 1.0),
            (Mood::Angry, "browDownRight", 1.0),
            (Mood::Surprised, "eyeWideLeft", -1.0),
            (Mood::Disgusted, "noseSneerLeft", -1.0),
            (Mood::Afraid, "mouthStretchRight", 1.0),
        ] {
            let mut trial = Trial::new(&[Layer::Mood], 3);
            let mut frames = trial.ticks(5);
            set(&mut trial, mood, 1.0);
            frames.extend(trial.ticks(45));
            let shown = frames.last().unwrap();
            assert!(shape(shown, name) > 0.3, "{mood:?} {}", shape(shown, name));
            let pitch = turned(&trial, shown, joint)[1] - turned(&trial, &still, joint)[1];
            assert!(pitch * direction > 0.5 && pitch.abs() < 25.0, "{mood:?} {pitch}");
            set(&mut trial, Mood::Neutral, 1.0);
            frames.extend(trial.ticks(90));
            let end = frames.last().unwrap();
            assert!(shape(end, name) < 0.01);
            assert!((turned(&trial, end, joint)[1] - turned(&trial, &still, joint)[1]).abs() < 0.2);
            for pair in frames.windows(2) {
                assert_sound(&pair[1]);
                let step = pair[0].face.iter().zip(&pair[1].face).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                assert!(step < 0.08, "{mood:?} {step}");
            }
        }
    }

    #[test]
    fn the_voice_scales_a_mood() {
        let smile = |mood: Mood, shape_name: &'static str, arousal: f32, expression: f32| {
            let mut trial = Trial::new(&[Layer::Mood], 3);
            set(&mut trial, mood, 0.5);
            trial.controls.expression = expression;
            trial.frame.cue = Cue { arousal, level: 0.1, ..Cue::default() };
            shape(&trial.ticks(90)[89], shape_name)
        };
        let joy = |arousal, expression| smile(Mood::Joy, "mouthSmileLeft", arousal, expression);
        assert!(joy(0.9, 0.5) > 1.15 * joy(0.5, 0.5) && joy(0.1, 0.5) < 0.85 * joy(0.5, 0.5));
        assert_eq!(joy(0.9, 0.0).to_bits(), joy(0.5, 0.5).to_bits());
        let sad = |arousal| smile(Mood::Sad, "mouthFrownLeft", arousal, 0.5);
        assert!(sad(0.1) > 1.15 * sad(0.5) && sad(0.9) < 0.85 * sad(0.5), "{} {}", sad(0.1), sad(0.5));
    }

    #[test]
    fn lips_that_speak_go_before_a_mood() {
        let mut trial = Trial::new(&[Layer::Mood], 3);
        set(&mut trial, Mood::Joy, 1.0);
        trial.ticks(60);
        let smile = shape(&trial.tick(), "mouthSmileLeft");
        trial.frame.face[arkit("mouthPucker")] = 0.9;
        let rounded = trial.tick();
        assert!(shape(&rounded, "mouthSmileLeft") < 0.5 * smile);
        assert_eq!(shape(&rounded, "mouthPucker"), 0.9);
        assert_eq!(shape(&rounded, "jawOpen"), 0.0);
    }
}
