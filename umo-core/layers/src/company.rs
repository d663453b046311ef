//! The others of a scene as one avatar meets them (SPEC 2.23): where they are, whether to look at them, when to answer; and the
//! posture, smile and yielding that follow from it.

use umo_core_base::state::{StateError, StatePass};
use umo_core_pose::frame::OwnedFrame;
use umo_core_pose::skeleton::JAW;

use super::noise::{Stream, uniform};
use super::rig::{ARMS, DEGREE, HEAD, NECK, SPINE, Spring, arkit, ease, toward, turn_in_parent};
use super::{Mood, Tick};

/// Spring frequencies, radians a second: of lean and weight 95 % in 1.9 s, of yielding in 0.7 s, and on the way back from it
/// in 1.4 s; of arms that rest in 2.2 s.
const POSTURE_RATE: f32 = 2.5;
const YIELD_RATE: f32 = 7.0;
const RESUME_RATE: f32 = 3.5;
const REST_RATE: f32 = 2.2;
/// Value and speed below which a spring that returns to 0 is at rest.
const AT_REST: f32 = 1e-4;

/// Degrees forward of a lean of 1, and share of them that neck and head take back.
const LEAN_DEGREES: f32 = 5.0;
const LEVEL_HEAD_SHARE: f32 = 0.7;
/// Metres to the left of a weight of 1.
pub(super) const WEIGHT_DISTANCE: f32 = 0.022;

/// Share by which yielding takes arms and mouth to rest, and degrees by which the trunk leans back.
const YIELD_SHARE: f32 = 0.85;
const YIELD_DEGREES: f32 = 6.0;
/// Share by which the arms of a listener go to rest.
const REST_SHARE: f32 = 0.85;
/// Shapes of an open mouth; the closing one among them, so that closed lips stay closed.
const MOUTH: [usize; 8] = [
    arkit("jawOpen"),
    arkit("mouthClose"),
    arkit("mouthFunnel"),
    arkit("mouthPucker"),
    arkit("mouthLowerDownLeft"),
    arkit("mouthLowerDownRight"),
    arkit("mouthUpperUpLeft"),
    arkit("mouthUpperUpRight"),
];

/// Half a smile: seconds and amounts, from the least to the largest; share of it that rises; shapes and their shares.
const SMILE_SECONDS: [f32; 2] = [1.5, 2.6];
const SMILE_AMOUNT: [f32; 2] = [0.16, 0.3];
const SMILE_RISE: f32 = 0.3;
const SMILE: [(usize, f32); 4] = [
    (arkit("mouthSmileLeft"), 1.0),
    (arkit("mouthSmileRight"), 1.0),
    (arkit("cheekSquintLeft"), 0.6),
    (arkit("cheekSquintRight"), 0.6),
];
const SMILES: Stream = Stream(600);

/// Part of an avatar in a conversation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Role {
    /// Nobody speaks.
    #[default]
    Idle = 0,
    /// Another one speaks.
    Listening = 1,
    /// It speaks.
    Speaking = 2,
}

impl Role {
    /// All values in numeric order.
    pub const ALL: [Self; 3] = [Self::Idle, Self::Listening, Self::Speaking];
}

/// The others of a scene as one avatar meets them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Company {
    /// Part of the avatar; `None` if it is alone, and nothing below counts.
    pub role: Option<Role>,
    /// Whether the avatar looks at the place below, and away from it as said there.
    pub has_place: bool,
    /// Eyes of the one it attends to: metres to its left, above its own eyes, and ahead of its place.
    pub place: [f32; 3],
    /// Whether it looks there now.
    pub is_contact: bool,
    /// Numbers of nods, brow raises and half smiles that were asked for so far.
    pub nods: u32,
    /// See [`Self::nods`].
    pub brows: u32,
    /// See [`Self::nods`].
    pub smiles: u32,
    /// Lean forward and shift of weight to the left, -1 to 1.
    pub lean: f32,
    /// See [`Self::lean`].
    pub weight: f32,
    /// Amount of yielding to another one that interrupts, 0 to 1: the mouth closes, hands drop, the trunk leans back.
    pub yielding: f32,
    /// Amount by which the arms rest while another one speaks, 0 to 1.
    pub resting: f32,
}

impl Company {
    /// An avatar that is alone.
    pub const ALONE: Self = Self {
        role: None,
        has_place: false,
        place: [0.0; 3],
        is_contact: false,
        nods: 0,
        brows: 0,
        smiles: 0,
        lean: 0.0,
        weight: 0.0,
        yielding: 0.0,
        resting: 0.0,
    };

    /// Whether the avatar is in company.
    pub fn is_on(&self) -> bool {
        self.role.is_some()
    }

    /// The place of the one it attends to.
    pub(super) fn looks_at(&self) -> Option<[f32; 3]> {
        (self.is_on() && self.has_place).then_some(self.place)
    }

    /// Saves or loads it.
    pub fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        let role = pass.limited("company", self.role.map_or(0, |role| role as u64 + 1), Role::ALL.len() as u64)?;
        if pass.loads() {
            self.role = usize::try_from(role).unwrap_or_default().checked_sub(1).map(|role| Role::ALL[role]);
        }
        pass.switch("company", &mut self.has_place)?;
        pass.switch("company", &mut self.is_contact)?;
        pass.places(&mut self.place)?;
        for count in [&mut self.nods, &mut self.brows, &mut self.smiles] {
            pass.ids(std::slice::from_mut(count))?;
        }
        pass.within(&mut self.lean, -1.0..=1.0)?;
        pass.within(&mut self.weight, -1.0..=1.0)?;
        pass.share(&mut self.yielding)?;
        pass.share(&mut self.resting)
    }
}

/// A count of requests, of which the new ones are answered.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Seen(Option<u32>);

impl Seen {
    /// Whether the count has changed since the last tick in company.
    pub(super) fn changes(&mut self, count: Option<u32>) -> bool {
        let before = std::mem::replace(&mut self.0, count);
        before.is_some_and(|before| count.is_some_and(|count| count != before))
    }

    pub(super) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        let mut count = self.0.map(u64::from);
        let there = pass.flag("company", count.is_some())?;
        let most = if there { u32::MAX } else { 0 };
        let value = pass.limited("company", count.unwrap_or_default(), most.into())?;
        count = there.then_some(value);
        if pass.loads() {
            self.0 = count.and_then(|count| u32::try_from(count).ok());
        }
        Ok(())
    }
}

/// Posture, smile and yielding of an avatar in company.
#[derive(Debug)]
pub(super) struct Presence {
    lean: Spring,
    weight: Spring,
    yielding: Spring,
    resting: Spring,
    smiles: Seen,
    /// Seconds since the last smile began, those that it lasts, and its amount.
    passed: f32,
    lasts: f32,
    amount: f32,
}

impl Presence {
    pub(crate) fn new() -> Self {
        let [lean, weight, yielding, resting] = [Spring::default(); 4];
        let (lasts, amount) = (SMILE_SECONDS[1], 0.0);
        Self { lean, weight, yielding, resting, smiles: Seen::default(), passed: lasts, lasts, amount }
    }

    /// Follows the company by one tick; returns the shift of weight, metres to the left.
    pub(crate) fn advance(&mut self, tick: &Tick) -> f32 {
        let company = if tick.controls.company.is_on() { tick.controls.company } else { Company::ALONE };
        follow(&mut self.lean, company.lean.clamp(-1.0, 1.0), POSTURE_RATE, tick.seconds);
        follow(&mut self.weight, company.weight.clamp(-1.0, 1.0), POSTURE_RATE, tick.seconds);
        let yielding = company.yielding.clamp(0.0, 1.0);
        let rate = if yielding > self.yielding.at { YIELD_RATE } else { RESUME_RATE };
        follow(&mut self.yielding, yielding, rate, tick.seconds);
        let resting = company.resting.clamp(0.0, 1.0);
        let rate = if resting > self.resting.at { REST_RATE } else { RESUME_RATE };
        follow(&mut self.resting, resting, rate, tick.seconds);
        self.passed = (self.passed + tick.seconds).min(self.lasts);
        if self.smiles.changes(company.role.map(|_| company.smiles)) {
            let draw = |which: u64| uniform(tick.seed, SMILES, 2 * u64::from(company.smiles) + which);
            let between = |[least, most]: [f32; 2], t: f32| least + (most - least) * t;
            (self.passed, self.lasts) = (0.0, between(SMILE_SECONDS, draw(0)));
            self.amount = between(SMILE_AMOUNT, draw(1));
        }
        WEIGHT_DISTANCE * self.weight.at
    }

    /// Takes the model's arms and mouth to rest.
    pub(crate) fn yield_floor(&self, frame: &mut OwnedFrame, tick: &Tick) {
        let share = tick.gain * YIELD_SHARE * self.yielding.at;
        let arms = share.max(tick.gain * REST_SHARE * self.resting.at);
        let (rest, rotations) = (&tick.rig.rest.rotations, &mut frame.pose.rotations);
        if arms > 0.0 {
            for (joint, down) in ARMS.into_iter().zip(tick.rig.arms_down) {
                rotations[joint] = toward(rotations[joint], down, arms);
            }
        }
        if share <= 0.0 {
            return;
        }
        rotations[JAW] = toward(rotations[JAW], rest[JAW], share);
        for shape in MOUTH {
            let value = tick.rig.shape(&frame.face, shape);
            tick.rig.set_shape(&mut frame.face, shape, (1.0 - share) * value);
        }
    }

    /// Adds half a smile, unless a mood has another face.
    pub(crate) fn smile(&self, frame: &mut OwnedFrame, tick: &Tick) {
        let t = self.passed / self.lasts;
        if t >= 1.0 {
            return;
        }
        let is_other = !matches!(tick.controls.mood, Mood::Neutral | Mood::Joy);
        let left = if is_other { 1.0 - tick.controls.mood_strength.clamp(0.0, 1.0) } else { 1.0 };
        let shown = if t < SMILE_RISE { ease(t / SMILE_RISE) } else { ease((1.0 - t) / (1.0 - SMILE_RISE)) };
        for (shape, share) in SMILE {
            let value = tick.rig.shape(&frame.face, shape);
            let more = tick.gain * left * share * self.amount * shown;
            tick.rig.set_shape(&mut frame.face, shape, value + (1.0 - value) * more);
        }
    }

    /// Leans the trunk; the head stays level.
    pub(crate) fn lean(&self, frame: &mut OwnedFrame, tick: &Tick) {
        let degrees = LEAN_DEGREES * self.lean.at - YIELD_DEGREES * self.yielding.at;
        if degrees == 0.0 {
            return;
        }
        let forward = tick.gain * degrees * DEGREE;
        let rotations = &mut frame.pose.rotations;
        for joint in SPINE {
            turn_in_parent(&mut rotations[joint], [forward / SPINE.len() as f32, 0.0, 0.0]);
        }
        for (joint, share) in [(NECK, 0.5), (HEAD, 0.5)] {
            turn_in_parent(&mut rotations[joint], [-share * LEVEL_HEAD_SHARE * forward, 0.0, 0.0]);
        }
    }

    /// Saves or loads it between two ticks.
    pub(crate) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        for spring in [&mut self.lean, &mut self.weight, &mut self.yielding, &mut self.resting] {
            spring.state(pass)?;
        }
        self.smiles.state(pass)?;
        pass.within(&mut self.passed, 0.0..=SMILE_SECONDS[1])?;
        pass.within(&mut self.lasts, SMILE_SECONDS[0]..=SMILE_SECONDS[1])?;
        pass.share(&mut self.amount)
    }
}

/// Moves a spring; one that returns to 0 gets there.
fn follow(spring: &mut Spring, goal: f32, rate: f32, seconds: f32) {
    if goal == 0.0 && spring.is_within(AT_REST) {
        *spring = Spring::default();
    } else {
        spring.follow(goal, rate, seconds);
    }
}

#[cfg(test)]
mod tests {
    use super::super::Layer;
    use super::super::rig::angle_between;
    use super::super::trial::{Trial, assert_sound, face, shape, skeleton, standing, turned};
    use super::*;

    /// Largest turn of a joint from one frame to the next, degrees.
    fn most_turned(shown: &[OwnedFrame]) -> f32 {
        let pairs = shown.windows(2).flat_map(|pair| pair[0].pose.rotations.iter().zip(&pair[1].pose.rotations));
        pairs.map(|(&a, &b)| angle_between(a, b)).fold(0.0, f32::max) / DEGREE
    }

    /// A figure that gestures with an open mouth.
    fn trial() -> Trial {
        let mut trial = Trial::new(&[Layer::Mood, Layer::Idle], 3);
        trial.frame.pose.rotations[16] = toward(trial.frame.pose.rotations[17], trial.frame.pose.rotations[16], 0.3);
        trial.frame.face[arkit("jawOpen")] = 0.6;
        trial
    }

    #[test]
    fn who_yields_closes_the_mouth_and_drops_the_hands_and_comes_back() {
        let mut trial = trial();
        trial.controls.company.role = Some(Role::Speaking);
        let before = trial.ticks(30).pop().unwrap();
        trial.controls.company.yielding = 1.0;
        let down = trial.ticks(45);
        trial.controls.company.yielding = 0.0;
        let back = trial.ticks(120);
        let raised =
            |frame: &OwnedFrame| angle_between(trial.rig.rest.rotations[16], frame.pose.rotations[16]) / DEGREE;
        let [first, low, last] = [&before, &down[44], &back[119]];
        assert!(raised(low) < 0.4 * raised(first) && raised(last) > 0.8 * raised(first), "{}", raised(low));
        assert!(shape(low, "jawOpen") < 0.2 && shape(last, "jawOpen") > 0.5);
        let pitch = |frame: &OwnedFrame| turned(&trial, frame, SPINE[2])[1];
        assert!(pitch(low) < pitch(first) - 2.0, "leans back: {} {}", pitch(low), pitch(first));
        assert!(most_turned(&down) < 9.0 && most_turned(&back) < 6.0, "{} {}", most_turned(&down), most_turned(&back));
    }

    #[test]
    fn the_arms_of_a_listener_rest() {
        let mut trial = trial();
        let listens = Company { role: Some(Role::Listening), resting: 1.0, ..Company::ALONE };
        let raised = |trial: &Trial, frame: &OwnedFrame| {
            angle_between(trial.rig.rest.rotations[16], frame.pose.rotations[16]) / DEGREE
        };
        let before = trial.tick();
        trial.controls.company = listens;
        let rest = trial.ticks(90);
        assert!(raised(&trial, &rest[89]) < 0.5 * raised(&trial, &before), "{}", raised(&trial, &rest[89]));
        assert!(most_turned(&rest) < 4.0 && shape(&rest[89], "jawOpen") > 0.5, "{}", most_turned(&rest));
    }

    #[test]
    fn posture_and_smiles_come_softly_and_leave_no_trace() {
        let (mut trial, mut alone) = (trial(), trial());
        let mut ticks = |trial: &mut Trial, count: usize| {
            let shown = trial.ticks(count);
            shown.iter().for_each(assert_sound);
            (shown, alone.ticks(count))
        };
        let company = Company { role: Some(Role::Listening), lean: 1.0, weight: -1.0, ..Company::ALONE };
        trial.controls.company = company;
        ticks(&mut trial, 5);
        trial.controls.company.smiles += 1;
        let (shown, usual) = ticks(&mut trial, 90);
        let smiles =
            |shown: &[OwnedFrame]| shown.iter().map(|frame| shape(frame, "mouthSmileLeft")).fold(0.0, f32::max);
        assert!((0.12..0.35).contains(&(smiles(&shown) - smiles(&usual))));
        assert!(most_turned(&shown) < 1.5, "{}", most_turned(&shown));
        let aside = shown[89].pose.translation[0] - usual[89].pose.translation[0];
        assert!((aside + WEIGHT_DISTANCE).abs() < 0.003, "{aside}");
        trial.controls.company = Company::ALONE;
        ticks(&mut trial, 300);
        let (shown, usual) = ticks(&mut trial, 2);
        assert!(shown[1].pose.rotations == usual[1].pose.rotations && shown[1].face[..] == usual[1].face[..]);
        assert_eq!(shown[1].pose.translation, usual[1].pose.translation);
    }

    #[test]
    fn an_avatar_that_is_alone_keeps_every_bit() {
        let run = |company: Company| {
            let mut trial = Trial::new(&Layer::ALL, 5);
            trial.controls.company = company;
            trial.speak(300)
        };
        let odd = Company { role: None, has_place: true, place: [1.0; 3], nods: 4, lean: 1.0, ..Company::ALONE };
        let odd = Company { yielding: 1.0, weight: 1.0, smiles: 3, is_contact: true, ..odd };
        for (a, b) in run(Company::ALONE).iter().zip(&run(odd)) {
            assert!(a.pose.rotations == b.pose.rotations && a.pose.translation == b.pose.translation);
            assert_eq!(a.face[..], b.face[..]);
        }
    }

    #[test]
    fn company_is_part_of_a_state() {
        let run = |trial: &mut Trial, ticks: std::ops::Range<u32>| -> Vec<OwnedFrame> {
            let each = ticks.map(|tick| {
                let role = Some(Role::ALL[tick as usize / 70 % 3]);
                let place = [[0.8, 0.0, 1.0], [-0.8, 0.1, 1.2]][tick as usize / 50 % 2];
                let (nods, smiles, lean) = (tick / 40, tick / 90, (tick as f32 * 0.01).sin());
                let (yielding, is_contact) = (f32::from(u8::from(tick / 60 % 4 == 1)), tick / 35 % 2 == 0);
                let seen = Company { role, has_place: true, place, is_contact, ..Company::ALONE };
                trial.controls.company = Company { nods, smiles, lean, weight: -lean, yielding, ..seen };
                trial.tick()
            });
            each.collect()
        };
        let mut trial = Trial::new(&Layer::ALL, 5);
        run(&mut trial, 0..333);
        let state = trial.save();
        let wanted = run(&mut trial, 333..600);
        let mut other = Trial::new(&Layer::ALL, 5);
        run(&mut other, 100..250);
        other.load(&state);
        for (a, b) in wanted.iter().zip(&run(&mut other, 333..600)) {
            assert!(a.pose.rotations == b.pose.rotations && a.face[..] == b.face[..]);
        }
    }

    #[test]
    fn both_arms_of_a_listener_hang_though_one_is_raised_at_rest() {
        let mut rest = standing();
        turn_in_parent(&mut rest.rotations[16], [0.0, 0.0, 60.0 * DEGREE]);
        let mut trial = Trial::of(&[Layer::Mood], 3, &skeleton(), &face(true), &rest);
        let wrists = |trial: &Trial, frame: &OwnedFrame| {
            let (places, _) = trial.rig.world(&frame.pose);
            [places[20][1], places[21][1]]
        };
        let [left, right] = wrists(&trial, &trial.frame);
        assert!((left - right).abs() > 0.2, "{left} {right}");
        trial.controls.company = Company { role: Some(Role::Listening), resting: 1.0, ..Company::ALONE };
        let shown = trial.ticks(150);
        let [now_left, now_right] = wrists(&trial, &shown[149]);
        let low = left.min(right);
        assert!(now_left < low + 0.12 && now_right < low + 0.12, "{now_left} {now_right}, {low} at rest");
        shown.iter().for_each(assert_sound);
    }
}
