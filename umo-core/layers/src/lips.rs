//! Lip shapes of sounds whose times the host knows: p, b and m close the lips, f and v bring the lower
//! lip to the teeth, w and rounded vowels push the lips forward.
//!
//! A hint states when a sound is heard. The lips start to move [`BLEND_SECONDS`] before it begins, hold its
//! shape while it lasts, and take as long to leave it. A sound between two frames shows in full at the
//! nearest frame. Nothing else of the mouth changes.

use umo_core_base::state::{StateError, StatePass};
use umo_core_pose::frame::OwnedFrame;
use umo_core_pose::skeleton::JAW;

use super::Heard;
use super::gesture::is_older;
use super::rig::{Rig, arkit, toward};
use crate::error::RequestError;

/// Upper bound on the hints that have not been shown yet.
pub const MAX_PENDING_HINTS: usize = 64;

/// Longest duration of a hint, seconds.
pub const MAX_HINT_SECONDS: f64 = 2.0;

/// Time to reach a shape and to leave it, seconds.
const BLEND_SECONDS: f64 = 0.06;

/// Last sample that a hint may name: beyond any stream, and far enough from overflow.
const MAX_SAMPLE: u64 = 1 << 60;

/// Share of the jaw's opening that is left when the lips meet: they close over a nearly closed jaw.
const CLOSED_JAW: f32 = 0.5;
/// Largest jaw opening with the lower lip at the teeth.
const TEETH_JAW: f32 = 0.15;
/// Least roll of the lower lip with it at the teeth, and least raise of the upper lip.
const TEETH_ROLL: f32 = 0.35;
const TEETH_RAISE: f32 = 0.1;
/// Least pucker of rounded lips.
const ROUND_PUCKER: f32 = 0.55;

/// Lip shape of a visible sound.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LipShape {
    /// The lips meet: p, b, m.
    Closed = 0,
    /// The lower lip is at the upper teeth: f, v.
    Teeth = 1,
    /// The lips are rounded: w, and vowels as in "boot".
    Round = 2,
}

impl LipShape {
    /// All shapes in numeric order.
    pub const ALL: [Self; 3] = [Self::Closed, Self::Teeth, Self::Round];

    /// Name of the shape.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Closed => "closed",
            Self::Teeth => "teeth",
            Self::Round => "round",
        }
    }
}

/// A sound and its time.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Hint {
    /// First sample in the host's audio, and the one after the last.
    start: u64,
    end: u64,
    shape: LipShape,
    /// Epoch in which it was given.
    epoch: u32,
}

impl Hint {
    const NONE: Self = Self { start: 0, end: 0, shape: LipShape::Closed, epoch: 0 };

    fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.number("hint's start", &mut self.start, MAX_SAMPLE)?;
        pass.number("hint's end", &mut self.end, 2 * MAX_SAMPLE)?;
        let shape = pass.limited("hint's shape", self.shape as u64, LipShape::ALL.len() as u64 - 1)?;
        let epoch = pass.limited("hint's epoch", self.epoch.into(), u32::MAX.into())?;
        if pass.loads() {
            self.shape = LipShape::ALL[usize::try_from(shape).unwrap_or_default()];
            self.epoch = u32::try_from(epoch).unwrap_or_default();
        }
        Ok(())
    }
}

/// Queue of hints from the host to the output: the newest ones, in a ring indexed by number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hints {
    ring: [Hint; MAX_PENDING_HINTS],
    /// Number of hints so far.
    count: u64,
}

impl Hints {
    pub(super) const NONE: Self = Self { ring: [Hint::NONE; MAX_PENDING_HINTS], count: 0 };

    /// Makes every hint one of this epoch.
    pub(super) fn move_to(&mut self, epoch: u32) {
        self.ring.iter_mut().for_each(|hint| hint.epoch = epoch);
    }

    /// Adds a hint with `start` and `duration` in seconds of audio at `rate`. Fails if
    /// [`MAX_PENDING_HINTS`] wait already, given that `passed` are done.
    pub fn push(
        &mut self,
        (start, duration): (f64, f64),
        shape: LipShape,
        rate: usize,
        (epoch, passed): (u32, u64),
    ) -> Result<(), RequestError> {
        let last = MAX_SAMPLE as f64 / rate as f64;
        if !(0.0..=last).contains(&start) || !(0.0..=MAX_HINT_SECONDS).contains(&duration) {
            return Err(RequestError::VisemeHint);
        }
        if self.count.saturating_sub(passed) >= MAX_PENDING_HINTS as u64 {
            return Err(RequestError::HintsFull);
        }
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the limits")]
        let sample = |seconds: f64| (seconds * rate as f64).round() as u64;
        self.ring[place(self.count)] = Hint { start: sample(start), end: sample(start + duration), shape, epoch };
        self.count += 1;
        Ok(())
    }

    pub fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.number("hints", &mut self.count, MAX_SAMPLE)?;
        self.ring.iter_mut().try_for_each(|hint| hint.state(pass))
    }
}

#[expect(clippy::cast_possible_truncation, reason = "below the length")]
fn place(number: u64) -> usize {
    (number % MAX_PENDING_HINTS as u64) as usize
}

/// Hints that wait or are shown.
#[derive(Debug)]
pub(super) struct Lips {
    /// Epoch of the stream.
    epoch: u32,
    /// Number of hints taken from the queue, and of those that passed or were dropped.
    taken: u64,
    passed: u64,
    waiting: [Hint; MAX_PENDING_HINTS],
    count: usize,
}

impl Lips {
    pub(crate) fn new() -> Self {
        Self { epoch: 0, taken: 0, passed: 0, waiting: [Hint::NONE; MAX_PENDING_HINTS], count: 0 }
    }

    /// Whether no hint waits.
    pub(super) fn is_empty(&self, hints: &Hints) -> bool {
        self.count == 0 && self.taken == hints.count
    }

    /// Number of hints that were shown, came too late, or were dropped by an interrupt.
    pub(super) fn passed(&self) -> u64 {
        self.passed
    }

    /// Goes on in another epoch, with what waits.
    pub(super) fn move_to(&mut self, epoch: u32) {
        self.epoch = epoch;
        self.waiting.iter_mut().for_each(|hint| hint.epoch = epoch);
    }

    /// Begins a new epoch: drops the hints of earlier ones.
    pub(super) fn interrupt(&mut self, epoch: u32, hints: &Hints) {
        self.epoch = epoch;
        self.take(hints);
        self.keep(|hint| !is_older(hint.epoch, epoch));
    }

    fn take(&mut self, hints: &Hints) {
        // Only a forged state has more than fit.
        let first = self.taken.max(hints.count.saturating_sub(MAX_PENDING_HINTS as u64));
        self.passed += first - self.taken;
        self.taken = first;
        while self.taken < hints.count {
            let hint = hints.ring[place(self.taken)];
            self.taken += 1;
            if is_older(hint.epoch, self.epoch) || self.count == MAX_PENDING_HINTS {
                self.passed += 1;
            } else {
                self.waiting[self.count] = hint;
                self.count += 1;
            }
        }
    }

    fn keep(&mut self, keeps: impl Fn(&Hint) -> bool) {
        let mut kept = 0;
        for at in 0..self.count {
            if keeps(&self.waiting[at]) {
                self.waiting[kept] = self.waiting[at];
                kept += 1;
            }
        }
        self.passed += (self.count - kept) as u64;
        self.count = kept;
    }

    /// Changes the mouth of a frame at a position in the audio; `seconds` is the frame's duration.
    pub(crate) fn apply(&mut self, frame: &mut OwnedFrame, rig: &Rig, hints: &Hints, heard: Heard, seconds: f32) {
        self.take(hints);
        if self.count == 0 {
            return;
        }
        let half_frame = 0.5 * f64::from(seconds) * heard.rate as f64;
        let blend = BLEND_SECONDS * heard.rate as f64;
        let (mut weights, at) = ([0.0_f32; LipShape::ALL.len()], heard.sample);
        for hint in &self.waiting[..self.count] {
            let away = hint.start.saturating_sub(at).max(at.saturating_sub(hint.end)) as f64;
            #[expect(clippy::cast_possible_truncation, reason = "0 to 1")]
            let near = (1.0 - (away - half_frame).max(0.0) / blend).max(0.0) as f32;
            let weight = &mut weights[hint.shape as usize];
            *weight = weight.max(near * near * (3.0 - 2.0 * near));
        }
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a fraction of a second")]
        let gone = (half_frame + blend) as u64;
        self.keep(|hint| at <= hint.end + gone);
        shape(frame, rig, weights);
    }

    pub(crate) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        let epoch = pass.limited("hints' epoch", self.epoch.into(), u32::MAX.into())?;
        if pass.loads() {
            self.epoch = u32::try_from(epoch).unwrap_or_default();
        }
        let taken = pass.number("hints", &mut self.taken, MAX_SAMPLE)?;
        pass.number("hints", &mut self.passed, taken)?;
        pass.length("hints", &mut self.count, MAX_PENDING_HINTS as u64)?;
        self.waiting.iter_mut().try_for_each(|hint| hint.state(pass))
    }
}

const JAW_OPEN: usize = arkit("jawOpen");
const CLOSE: usize = arkit("mouthClose");
const PUCKER: usize = arkit("mouthPucker");
const FUNNEL: usize = arkit("mouthFunnel");
const ROLL_LOWER: usize = arkit("mouthRollLower");
/// Shapes that part the lips: of the lower lip, then of the upper.
const LOWER: [usize; 2] = [arkit("mouthLowerDownLeft"), arkit("mouthLowerDownRight")];
const UPPER: [usize; 2] = [arkit("mouthUpperUpLeft"), arkit("mouthUpperUpRight")];
/// Shapes that widen the mouth.
const WIDE: [usize; 4] =
    [arkit("mouthSmileLeft"), arkit("mouthSmileRight"), arkit("mouthStretchLeft"), arkit("mouthStretchRight")];

/// Applies weights in the order of [`LipShape::ALL`] to the mouth. Closed lips take precedence.
fn shape(frame: &mut OwnedFrame, rig: &Rig, [closed, teeth, round]: [f32; 3]) {
    let OwnedFrame { pose, face, .. } = frame;
    let jaw = rig.shape(face, JAW_OPEN);
    let scale = |face: &mut [f32], shapes: &[usize], by: f32| {
        shapes.iter().for_each(|&shape| rig.set_shape(face, shape, by * rig.shape(face, shape)));
    };
    let least = |face: &mut [f32], shape: usize, least: f32, weight: f32| {
        let value = rig.shape(face, shape);
        rig.set_shape(face, shape, value + weight * (least - value).max(0.0));
    };
    let mut open = jaw;
    if round > 0.0 {
        least(face, PUCKER, ROUND_PUCKER, round);
        scale(face, &WIDE, 1.0 - 0.7 * round);
    }
    if teeth > 0.0 {
        open -= teeth * (open - TEETH_JAW).max(0.0);
        least(face, ROLL_LOWER, TEETH_ROLL, teeth);
        scale(face, &LOWER, 1.0 - teeth);
        scale(face, &[PUCKER, FUNNEL], 1.0 - 0.7 * teeth);
        UPPER.iter().for_each(|&upper| least(face, upper, TEETH_RAISE, teeth));
        // Closed lips would hide the teeth.
        scale(face, &[CLOSE], 1.0 - 0.8 * teeth);
    }
    if closed > 0.0 {
        open *= 1.0 - (1.0 - CLOSED_JAW) * closed;
        scale(face, &LOWER, 1.0 - closed);
        scale(face, &UPPER, 1.0 - closed);
        scale(face, &[FUNNEL], 1.0 - closed);
        least(face, CLOSE, open, closed);
    }
    if open < jaw {
        rig.set_shape(face, JAW_OPEN, open);
        let joint = &mut pose.rotations[JAW];
        *joint = toward(*joint, rig.rest.rotations[JAW], 1.0 - open / jaw);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::Layer;
    use super::super::trial::Trial;
    use super::*;

    const RATE: usize = 16_000;

    /// Distance between the lips, as in the training's metric of closures.
    fn opening(rig: &Rig, face: &[f32]) -> f32 {
        let of = |shapes: &[usize]| shapes.iter().map(|&shape| rig.shape(face, shape)).sum::<f32>();
        of(&[JAW_OPEN]) - of(&[CLOSE]) + 0.1 * (of(&LOWER) + of(&UPPER)) + 0.05 * of(&[FUNNEL])
            - 0.05 * of(&[ROLL_LOWER])
    }

    fn heard(tick: u64) -> Option<Heard> {
        Some(Heard { sample: tick * RATE as u64 / 30, rate: RATE })
    }

    /// Run with an open mouth.
    fn speaking() -> Trial {
        let mut trial = Trial::new(&[], 3);
        for (shape, value) in
            [(JAW_OPEN, 0.6), (LOWER[0], 0.5), (LOWER[1], 0.5), (UPPER[0], 0.3), (UPPER[1], 0.3), (WIDE[0], 0.4)]
        {
            trial.rig.set_shape(&mut trial.frame.face, shape, value);
        }
        trial.frame.pose.rotations[JAW] = super::super::rig::turn([0.2, 0.0, 0.0]);
        trial
    }

    fn hint(trial: &mut Trial, start: f64, duration: f64, shape: LipShape) -> Result<(), RequestError> {
        let passed = trial.stack.passed_hints();
        trial.controls.hints.push((start, duration), shape, RATE, (0, passed))
    }

    fn tick(trial: &mut Trial, heard: Option<Heard>) -> OwnedFrame {
        let mut frame = trial.frame.clone();
        trial.stack.apply(&mut frame, &trial.controls, heard);
        frame
    }

    fn values(frame: &OwnedFrame) -> (&[f32], &umo_core_pose::pose::Pose) {
        (&frame.face, &frame.pose)
    }

    #[test]
    fn lips_meet_in_the_time_of_a_closure_and_nowhere_else() {
        // A short one between two frames, one that lasts, and one of no duration.
        for (start, duration) in [(0.515, 0.004), (0.5, 0.08), (1.015, 0.0)] {
            let mut trial = speaking();
            hint(&mut trial, start, duration, LipShape::Closed).unwrap();
            let frames: Vec<_> = (0..60).map(|at| tick(&mut trial, heard(at))).collect();
            let openings: Vec<f32> = frames.iter().map(|frame| opening(&trial.rig, &frame.face)).collect();
            let least = openings.iter().copied().fold(f32::MAX, f32::min);
            assert!(least < 1e-3, "{start}: {least}");
            for (at, frame) in frames.iter().enumerate() {
                let seconds = at as f64 / 30.0;
                let is_far = seconds < start - 0.08 || seconds > start + duration + 0.08;
                assert_eq!(values(frame) == values(&trial.frame), is_far, "{start} at {seconds}");
            }
            // Two frames to close and two to open: no jump between open and closed.
            let steps = openings.windows(2).map(|pair| (pair[1] - pair[0]).abs());
            assert!(steps.fold(0.0, f32::max) < 0.8 * opening(&trial.rig, &trial.frame.face), "{openings:?}");
            assert_eq!(trial.stack.passed_hints(), 1);
        }
    }

    #[test]
    fn each_shape_does_what_one_sees() {
        let at = |shape| {
            let mut trial = speaking();
            hint(&mut trial, 0.0, 0.1, shape).unwrap();
            let frame = tick(&mut trial, heard(1));
            let values = [JAW_OPEN, PUCKER, ROLL_LOWER, LOWER[0], WIDE[0]].map(|it| trial.rig.shape(&frame.face, it));
            (values, opening(&trial.rig, &frame.face))
        };
        let ([jaw, .., lower, _], opening) = at(LipShape::Closed);
        assert!(jaw < 0.31 && lower == 0.0 && opening < 1e-3, "{opening}");
        let ([jaw, _, roll, lower, _], opening) = at(LipShape::Teeth);
        assert!(jaw < 0.16 && roll > 0.34 && lower == 0.0 && opening > 0.1, "{opening}");
        let ([jaw, pucker, _, _, wide], _) = at(LipShape::Round);
        assert!((jaw - 0.6).abs() < 1e-6 && pucker > 0.54 && wide < 0.13);
    }

    #[test]
    fn hints_are_bounded_and_late_ones_change_nothing() {
        let mut trial = speaking();
        for number in 0..MAX_PENDING_HINTS {
            hint(&mut trial, 5.0 + number as f64, 0.1, LipShape::Closed).unwrap();
        }
        assert_eq!(hint(&mut trial, 0.0, 0.1, LipShape::Closed), Err(RequestError::HintsFull));
        tick(&mut trial, heard(0));
        assert_eq!(hint(&mut trial, 0.0, 0.1, LipShape::Closed), Err(RequestError::HintsFull));
        // At 6.5 s two have passed; a third that is added with a past time is late.
        assert_eq!(values(&tick(&mut trial, heard(195))), values(&trial.frame));
        assert_eq!(trial.stack.passed_hints(), 2);
        hint(&mut trial, 2.0, 0.1, LipShape::Closed).unwrap();
        assert_eq!(values(&tick(&mut trial, heard(196))), values(&trial.frame));
        assert_eq!(trial.stack.passed_hints(), 3);
        for (start, duration) in [(-0.1, 0.1), (f64::NAN, 0.1), (0.0, 2.1), (0.0, -0.1), (0.0, f64::NAN), (1e300, 0.0)]
        {
            let wrong = hint(&mut trial, start, duration, LipShape::Closed);
            assert_eq!(wrong, Err(RequestError::VisemeHint), "{start} {duration}");
        }
    }

    #[test]
    fn an_interrupt_drops_hints_and_no_audio_shows_none() {
        let mut trial = speaking();
        hint(&mut trial, 0.5, 0.1, LipShape::Closed).unwrap();
        assert_eq!(values(&tick(&mut trial, None)), values(&trial.frame));
        trial.stack.interrupt(1, 5, &trial.controls);
        assert_eq!(trial.stack.passed_hints(), 1);
        assert_eq!(values(&tick(&mut trial, heard(16))), values(&trial.frame));
        // Without ARKit shapes there is nothing to move.
        let config = super::super::trial::face(false);
        let mut other = Trial::of(&[], 3, &super::super::trial::skeleton(), &config, &super::super::trial::standing());
        hint(&mut other, 0.0, 0.1, LipShape::Closed).unwrap();
        assert_eq!(values(&tick(&mut other, heard(1))), values(&other.frame));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(100))]

        #[test]
        fn values_stay_in_range_and_a_state_goes_on_with_the_same_bits(
            hints in prop::collection::vec((0.0_f64..3.0, 0.0_f64..0.4, 0_usize..3), 0..40),
            face in prop::collection::vec(0.0_f32..1.0, 52),
            cut in 0_u64..80,
        ) {
            let make = || {
                let mut trial = Trial::new(&[Layer::Asymmetry], 5);
                trial.frame.face.copy_from_slice(&face);
                for &(start, duration, shape) in &hints {
                    hint(&mut trial, start, duration, LipShape::ALL[shape]).unwrap();
                }
                trial
            };
            let mut whole = make();
            let mut first = make();
            let mut second = make();
            for at in 0..100 {
                let expected = tick(&mut whole, heard(at));
                prop_assert!(expected.face.iter().all(|value| (0.0..=1.0).contains(value)));
                prop_assert!(expected.pose.rotations.as_flattened().iter().all(|value| value.is_finite()));
                let shown = if at < cut {
                    tick(&mut first, heard(at))
                } else {
                    if at == cut {
                        second.load(&first.save());
                    }
                    tick(&mut second, heard(at))
                };
                prop_assert_eq!(values(&shown), values(&expected));
            }
        }
    }
}
