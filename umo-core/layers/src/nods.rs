//! Head motion on accents and while listening.

use umo_core_base::state::{StateError, StatePass};
use umo_core_pose::frame::OwnedFrame;
use umo_core_pose::rotation::{IDENTITY, Quat};

use super::Tick;
use super::company::Seen;
use super::noise::{Stream, smooth, uniform};
use super::rig::{DEGREE, HEAD, NECK, angle_between, arkit, ease, step, turn_in_parent};

/// Number of pulses that may overlap.
const MAX_PULSES: usize = 4;

/// Standard deviation of the sway, degrees: pitch, yaw, roll.
const SWAY: [f32; 3] = [2.4, 2.5, 1.6];

/// Direction changes per second of the slow and the fast part of the sway, and their shares.
const SWAY_RATES: [f64; 2] = [0.55, 1.25];
const SWAY_SHARES: [f32; 2] = [0.88, 0.48];

/// Sway at rest, while listening, thinking and speaking.
const SWAY_BY_ATTENTION: [f32; 4] = [0.8, 0.7, 0.7, 1.0];

/// Speeds of the model's head, degrees a second: below the first it is nearly still, above the second
/// it needs no added motion.
const STILL_HEAD_SPEED: f32 = 8.0;
const LIVELY_HEAD_SPEED: f32 = 30.0;

/// Time constant of the measured speed, seconds.
const SPEED_AVERAGE_SECONDS: f32 = 0.8;

/// Share of the sway and of the nods that remains while the head is lively.
const MIN_SWAY_SHARE: f32 = 0.35;
const MIN_NOD_SHARE: f32 = 0.15;

/// Share of accents that bring a nod, and least seconds between two accents with a response.
const ACCENT_NOD_PROBABILITY: f32 = 0.7;
const MIN_ACCENT_GAP_SECONDS: f32 = 0.45;

/// Share by which turns of the head grow with the liveliest voice.
const LIVELY_SHARE: f32 = 0.4;

/// Share of accents that raise the brows.
const BROW_FLASH_PROBABILITY: f32 = 0.35;

/// Least seconds between two responses of a listener whom the host makes listen, and upper bound of the random extra.
const ANSWER_SECONDS: f32 = 5.0;
const EXTRA_ANSWER_SECONDS: f32 = 4.0;

const DRAWS: Stream = Stream(300);
const SLOW: Stream = Stream(301);
const FAST: Stream = Stream(302);

const BROWS: [(usize, f32); 3] =
    [(arkit("browInnerUp"), 1.0), (arkit("browOuterUpLeft"), 0.8), (arkit("browOuterUpRight"), 0.8)];

/// State of the nods layer.
#[derive(Debug)]
pub(super) struct Nods {
    draws: u64,
    /// Rotations of neck and head at the previous tick, and the head's speed, degrees a second.
    before: [Quat; 2],
    is_started: bool,
    speed: f32,
    pulses: [Pulse; MAX_PULSES],
    /// Index of the pulse to replace next.
    next: u64,
    /// Seconds since the last response to an accent, and until a listener responds.
    since_accent: f32,
    answer: f32,
    /// Nods and brow raises that the company has asked for.
    asked: [Seen; 2],
}

impl Nods {
    pub(crate) fn new() -> Self {
        Self {
            draws: 0,
            before: [IDENTITY; 2],
            is_started: false,
            speed: 0.0,
            pulses: [Pulse::default(); MAX_PULSES],
            next: 0,
            since_accent: MIN_ACCENT_GAP_SECONDS,
            answer: ANSWER_SECONDS,
            asked: [Seen::default(); 2],
        }
    }

    /// Applies one tick to the frame.
    pub(crate) fn apply(&mut self, frame: &mut OwnedFrame, tick: &Tick) {
        let lively = self.measure(frame, tick);
        self.speak(tick, lively);
        self.listen(tick);

        let weights = &tick.weights;
        let states = [weights.idle, weights.listening, weights.thinking, weights.speaking];
        let state: f32 = states.iter().zip(SWAY_BY_ATTENTION).map(|(weight, share)| weight * share).sum();
        let amount = state * (1.0 - (1.0 - MIN_SWAY_SHARE) * lively) / 0.4;
        let [slow, fast] = [(SLOW, SWAY_RATES[0]), (FAST, SWAY_RATES[1])]
            .map(|(stream, rate)| smooth(tick.seed, stream, tick.time(), rate));
        // Pitch, yaw, roll in degrees.
        let mut turn: [f32; 3] = std::array::from_fn(|axis| {
            amount * SWAY[axis] * (SWAY_SHARES[0] * slow[axis] + SWAY_SHARES[1] * fast[axis])
        });
        let mut brows = 0.0;
        for pulse in &mut self.pulses {
            let at = pulse.advance(tick.seconds);
            for (sum, angle) in turn.iter_mut().zip(pulse.turn) {
                *sum += at * angle;
            }
            brows += pulse.brows();
        }
        // A listener tilts the head slightly.
        turn[2] += weights.listening * 2.0 * slow[3];
        let size = tick.gain * (1.0 + LIVELY_SHARE * tick.lively);
        for (joint, share) in [(NECK, 0.4), (HEAD, 0.6)] {
            turn_in_parent(&mut frame.pose.rotations[joint], turn.map(|angle| share * size * angle * DEGREE));
        }
        if brows > 0.0 {
            for (shape, share) in BROWS {
                let value = tick.rig.shape(&frame.face, shape);
                let rise = (share * brows * tick.gain).min(0.5);
                tick.rig.set_shape(&mut frame.face, shape, value + (1.0 - value) * rise);
            }
        }
    }

    /// Draws a number in `0..1`.
    fn draw(&mut self, tick: &Tick) -> f32 {
        self.draws += 1;
        uniform(tick.seed, DRAWS, self.draws)
    }

    /// Measures the liveliness of the model's head, 0 to 1.
    fn measure(&mut self, frame: &OwnedFrame, tick: &Tick) -> f32 {
        let now = [frame.pose.rotations[NECK], frame.pose.rotations[HEAD]];
        if std::mem::replace(&mut self.is_started, true) {
            let angle: f32 = now.iter().zip(&self.before).map(|(&now, &before)| angle_between(before, now)).sum();
            let speed = angle / DEGREE / tick.seconds;
            self.speed += step(tick.seconds, SPEED_AVERAGE_SECONDS) * (speed.min(500.0) - self.speed);
        }
        self.before = now;
        ease((self.speed - STILL_HEAD_SPEED) / (LIVELY_HEAD_SPEED - STILL_HEAD_SPEED))
    }

    /// Nods and raises the brows on accents of the avatar's speech.
    fn speak(&mut self, tick: &Tick, lively: f32) {
        self.since_accent = (self.since_accent + tick.seconds).min(COUNTER_CAP_SECONDS);
        let accent = tick.weights.own.accent;
        if accent <= 0.0 || tick.weights.speaking < 0.3 || self.since_accent < MIN_ACCENT_GAP_SECONDS {
            return;
        }
        let [nods, flashes, size, side, lasts] = std::array::from_fn(|_| self.draw(tick));
        let is_nod = nods < ACCENT_NOD_PROBABILITY;
        let is_flash = flashes < BROW_FLASH_PROBABILITY;
        if !is_nod && !is_flash {
            return;
        }
        self.since_accent = 0.0;
        let still = 1.0 - (1.0 - MIN_NOD_SHARE) * lively;
        let down = if is_nod { still * (1.0 + 2.4 * accent * (0.4 + 0.6 * size)) } else { 0.0 };
        self.begin(Pulse {
            passed: 0.0,
            lasts: 0.3 + 0.12 * lasts,
            // A nod is never quite straight: a little yaw and roll.
            turn: [down, 0.5 * down * (side - 0.5), 0.5 * down * (size - 0.5)],
            rise: if is_flash { 0.12 + 0.2 * accent } else { 0.0 },
        });
    }

    /// Nods and raises the brows as the company asks for it, or now and then.
    fn listen(&mut self, tick: &Tick) {
        let company = &tick.controls.company;
        let counts = [company.nods, company.brows].map(|count| company.is_on().then_some(count));
        let [nods, brows] = [0, 1].map(|which| self.asked[which].changes(counts[which]));
        if tick.weights.listening < 0.5 {
            self.answer = ANSWER_SECONDS;
            return;
        }
        if company.is_on() {
            if nods || brows {
                let [size, twice] = std::array::from_fn(|_| self.draw(tick));
                self.respond(nods, if brows { 0.15 + 0.2 * size } else { 0.0 }, size, twice);
            }
            return;
        }
        self.answer -= tick.seconds;
        if self.answer > 0.0 {
            return;
        }
        let [kind, size, twice, gap] = std::array::from_fn(|_| self.draw(tick));
        self.answer = ANSWER_SECONDS + EXTRA_ANSWER_SECONDS * gap;
        let is_nod = kind < 0.75;
        let rise = if kind > 0.55 { 0.15 + 0.2 * size } else { 0.0 };
        self.respond(is_nod, rise, size, twice);
    }

    /// Begins a nod, once or twice, or raised brows alone.
    fn respond(&mut self, is_nod: bool, rise: f32, size: f32, twice: f32) {
        let down = if is_nod { 2.2 + 2.3 * size } else { -0.8 };
        let lasts = 0.36 + 0.1 * size;
        let turn = [down, 0.2 * (size - 0.5), 0.6 * (size - 0.5)];
        self.begin(Pulse { passed: 0.0, lasts, turn, rise });
        if is_nod && twice < 0.5 {
            // The second nod is smaller and begins before the first has ended.
            let turn = turn.map(|angle| 0.6 * angle);
            self.begin(Pulse { passed: -0.85 * lasts, lasts, turn, rise: 0.0 });
        }
    }

    fn begin(&mut self, pulse: Pulse) {
        self.pulses[usize::try_from(self.next).unwrap_or_default() % MAX_PULSES] = pulse;
        self.next = (self.next + 1) % MAX_PULSES as u64;
    }

    /// Saves or loads the layer between two ticks.
    pub(crate) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.number("draws of the nods", &mut self.draws, 1 << 60)?;
        pass.rotations(&mut self.before)?;
        pass.switch("nods", &mut self.is_started)?;
        pass.number("nods", &mut self.next, MAX_PULSES as u64 - 1)?;
        for pulse in &mut self.pulses {
            pulse.state(pass)?;
        }
        let mut values = [self.speed, self.since_accent, self.answer];
        pass.moderate(&mut values)?;
        [self.speed, self.since_accent, self.answer] = values;
        self.asked.iter_mut().try_for_each(|asked| asked.state(pass))
    }
}

/// Cap of the time counters, seconds.
const COUNTER_CAP_SECONDS: f32 = 1e3;

/// A nod, a brow raise or both.
#[derive(Clone, Copy, Debug)]
struct Pulse {
    /// Seconds since it began; negative before that.
    passed: f32,
    lasts: f32,
    /// Pitch, yaw and roll at the peak, degrees.
    turn: [f32; 3],
    /// Brow raise at the peak, 0 to 1.
    rise: f32,
}

impl Default for Pulse {
    fn default() -> Self {
        Self { passed: COUNTER_CAP_SECONDS, lasts: 0.3, turn: [0.0; 3], rise: 0.0 }
    }
}

impl Pulse {
    /// Advances by one tick and returns the current share of the turn.
    fn advance(&mut self, seconds: f32) -> f32 {
        self.passed = (self.passed + seconds).min(COUNTER_CAP_SECONDS);
        bump(self.passed / self.lasts)
    }

    /// Current brow raise: brows stay up longer than the head is down.
    fn brows(&self) -> f32 {
        self.rise * bump(self.passed / (1.6 * self.lasts))
    }

    fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.moderate(&mut self.turn)?;
        pass.moderate(std::slice::from_mut(&mut self.passed))?;
        pass.within(&mut self.lasts, 0.1..=COUNTER_CAP_SECONDS)?;
        pass.share(&mut self.rise)
    }
}

/// Pulse from 0 to 1 and back for `t` from 0 to 1, rising faster than it falls; 0 outside.
fn bump(t: f32) -> f32 {
    const HEIGHT: f32 = 0.4;
    if t < HEIGHT { ease(t / HEIGHT) } else { ease((1.0 - t) / (1.0 - HEIGHT)) }
}

#[cfg(test)]
mod tests {
    use super::super::trial::{Trial, assert_sound, deviation, shape, turned, yawed};
    use super::super::{Attention, Company, Layer, Role};
    use super::*;

    #[test]
    fn a_speaking_head_is_never_still_and_nods() {
        let mut trial = Trial::new(&[Layer::Nods], 11);
        let shown = trial.speak(5400);
        shown.iter().for_each(assert_sound);
        let turns: Vec<[f32; 3]> = shown.iter().map(|frame| turned(&trial, frame, HEAD)).collect();
        for (axis, (least, most)) in [(2.2, 4.0), (1.8, 3.5), (1.3, 3.0)].into_iter().enumerate() {
            let got = deviation(turns.iter().map(|turn| turn[axis]));
            assert!((least..most).contains(&got), "{axis} {got}");
        }
        // No jumps: 90 degrees a second at most.
        assert!(turns.windows(2).all(|pair| (0..3).all(|axis| (pair[1][axis] - pair[0][axis]).abs() < 3.0)));
        let raises = shown
            .windows(2)
            .filter(|pair| shape(&pair[0], "browInnerUp") < 0.1 && shape(&pair[1], "browInnerUp") >= 0.1);
        let a_minute = raises.count() / 3;
        assert!((3..40).contains(&a_minute), "{a_minute}");
    }

    #[test]
    fn a_lively_head_is_left_alone() {
        let sway = |swing: f32| {
            let mut trial = Trial::new(&[Layer::Nods], 11);
            let rest = trial.frame.pose;
            let mut added = Vec::new();
            for tick in 0..900_u16 {
                let angle = swing * (f32::from(tick) * 0.4).sin();
                trial.frame.pose.rotations[HEAD] = yawed(rest.rotations[HEAD], angle);
                let shown = trial.tick();
                added.push(turned(&trial, &shown, HEAD)[0] - angle);
            }
            deviation(added[100..].iter().copied())
        };
        let (still, lively) = (sway(0.0), sway(10.0));
        assert!(lively < 0.5 * still, "{still} {lively}");
    }

    #[test]
    fn whom_the_host_makes_listen_nods_now_and_then() {
        let mut trial = Trial::new(&[Layer::Nods], 2);
        let count = |trial: &mut Trial, attention| {
            trial.controls.attention = attention;
            trial.ticks(90);
            let mut before = trial.stack.nods.next;
            let ticks = (0..1800).filter(|_| {
                trial.tick();
                std::mem::replace(&mut before, trial.stack.nods.next) != before
            });
            ticks.count()
        };
        let heard = count(&mut trial, Attention::Listening);
        assert!((5..=14).contains(&heard), "{heard}");
        assert_eq!(count(&mut trial, Attention::Idle), 0);
    }

    #[test]
    fn in_company_a_listener_nods_when_asked_and_not_by_itself() {
        let mut trial = Trial::new(&[Layer::Nods], 2);
        trial.controls.company = Company { role: Some(Role::Listening), nods: 7, brows: 3, ..Company::ALONE };
        let mut begun = Vec::new();
        for tick in 0..1800 {
            let before = trial.stack.nods.next;
            trial.controls.company.nods += u32::from(tick % 300 == 200);
            trial.controls.company.brows += u32::from(tick % 300 == 250);
            trial.tick();
            if before != trial.stack.nods.next {
                begun.push(tick);
            }
        }
        let wanted: Vec<usize> = (0..6).flat_map(|i| [300 * i + 200, 300 * i + 250]).collect();
        assert_eq!(begun, wanted);
        // A speaker does not answer, nor one that the host makes think.
        for (role, attention) in [(Role::Speaking, Attention::Auto), (Role::Listening, Attention::Thinking)] {
            trial.controls.company.role = Some(role);
            trial.controls.attention = attention;
            trial.ticks(60);
            let before = trial.stack.nods.next;
            trial.controls.company.nods += 1;
            trial.ticks(10);
            assert_eq!(trial.stack.nods.next, before, "{role:?}");
        }
    }
}
