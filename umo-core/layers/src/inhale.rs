//! Inhalation before a phrase: at its end the voice begins where that is known, otherwise it follows the last phrase.

use umo_core_base::state::{StateError, StatePass};

use super::Tick;
use super::rig::ease;

/// Seconds of the quickest inhalation and of the deepest, and of the way back; least time before a phrase for one.
const LEAST_SECONDS: f32 = 0.1;
const QUICK_SECONDS: f32 = 0.17;
const DEEP_SECONDS: f32 = 0.25;
const OUT_SECONDS: f32 = 1.8;
/// Seconds between the beginnings of two: the least, and those after which it is the deepest.
const LEAST_GAP_SECONDS: f32 = 0.6;
const DEEP_GAP_SECONDS: f32 = DEEP_SECONDS + OUT_SECONDS;

/// Depth of the quickest, relative to the deepest one.
const QUICK_DEPTH: f32 = 0.5;
/// Share by which the breath of the liveliest voice is deeper.
const LIVELY_SHARE: f32 = 0.4;

/// Liveliness from which speech exhausts, seconds in which the liveliest exhausts, and those of the recovery.
const EFFORT: f32 = 0.3;
const EXHAUST_SECONDS: f32 = 6.0;
const RECOVER_SECONDS: f32 = 5.0;

/// An inhalation, and the way back from it.
#[derive(Debug)]
pub(super) struct Inhale {
    /// Seconds since it began, and those that it lasts.
    time: f32,
    lasts: f32,
    /// Air above that of the idle breath when it began, and when it ends.
    from: f32,
    depth: f32,
    /// How exhausted the speaker is, 0 to 1.
    exhaustion: f32,
}

impl Inhale {
    pub(crate) fn new() -> Self {
        Self { time: DEEP_GAP_SECONDS, lasts: DEEP_SECONDS, from: 0.0, depth: 0.0, exhaustion: 0.0 }
    }

    /// Advances by one tick. Returns the air above that of the idle breath, about 0 to 1, and how far the lips are parted,
    /// 0 to 1.
    pub(crate) fn advance(&mut self, tick: &Tick) -> [f32; 2] {
        let rate = if tick.weights.own.is_on {
            (tick.lively - EFFORT).max(0.0) / EXHAUST_SECONDS
        } else {
            -1.0 / RECOVER_SECONDS
        };
        self.exhaustion = (self.exhaustion + rate * tick.seconds).clamp(0.0, 1.0);
        // Quick between quick phrases, deep after a long one or a rest.
        let gap = (self.time - LEAST_GAP_SECONDS) / (DEEP_GAP_SECONDS - LEAST_GAP_SECONDS);
        let lasts = QUICK_SECONDS + (DEEP_SECONDS - QUICK_SECONDS) * gap;
        let onset = tick.cue.onset;
        let is_due = if onset < 0.0 { tick.weights.own.ends } else { (LEAST_SECONDS..=lasts).contains(&onset) };
        // A phrase that is known late leaves less time.
        let lasts = if onset < 0.0 { lasts } else { lasts.min(onset) };
        let amount = (2.0 * tick.controls.expression).min(1.0);
        if is_due && gap >= 0.0 && amount > 0.0 {
            self.from = self.air();
            self.depth = amount * (QUICK_DEPTH + (1.0 - QUICK_DEPTH) * gap) * (1.0 + LIVELY_SHARE * tick.lively);
            (self.time, self.lasts) = (0.0, lasts);
        }
        self.time = (self.time + tick.seconds).min(DEEP_GAP_SECONDS);
        let parted =
            ease((self.time / self.lasts).min(1.0)) * (1.0 - ease(((self.time - self.lasts) / 0.1).clamp(0.0, 1.0)));
        [self.air(), self.depth * parted]
    }

    /// How hard the idle breath is, 0 to 1: after long shouting, while nothing is said.
    pub(crate) fn hard(&self, tick: &Tick) -> f32 {
        self.exhaustion * (1.0 - tick.weights.speaking)
    }

    fn air(&self) -> f32 {
        if self.time < self.lasts {
            return self.from + (self.depth - self.from) * ease(self.time / self.lasts);
        }
        self.depth * (1.0 - ease(((self.time - self.lasts) / OUT_SECONDS).min(1.0)))
    }

    /// Saves or loads the layer between two ticks.
    pub(crate) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.within(&mut self.time, 0.0..=DEEP_GAP_SECONDS)?;
        pass.within(&mut self.lasts, LEAST_SECONDS..=DEEP_SECONDS)?;
        pass.within(&mut self.from, 0.0..=2.0)?;
        pass.within(&mut self.depth, 0.0..=2.0)?;
        pass.share(&mut self.exhaustion)
    }
}

#[cfg(test)]
mod tests {
    use super::super::rig::{DEGREE, SPINE, angle_between};
    use super::super::trial::{Trial, assert_sound, shape, turned};
    use super::super::{Cue, Layer};

    /// How far the chest is from where it would be without the voice, degrees, and jawOpen, in each tick of two phrases:
    /// sound from tick 30 to 60, and from 80 to 90, whose beginnings are told or not.
    fn breaths(is_known: bool) -> Vec<(f32, f32)> {
        let cue = |tick: usize| {
            let next = [30, 80].into_iter().find(|&begin| begin > tick && begin <= tick + 12);
            let onset = next.map_or(0.0, |begin| (begin - tick) as f32 / 30.0);
            let level = if (30..60).contains(&tick) || (80..90).contains(&tick) { 0.1 } else { 0.0 };
            Cue { level, onset: if is_known { onset } else { -1.0 }, ..Cue::default() }
        };
        let run = |expression: f32| {
            let mut trial = Trial::new(&[Layer::Idle], 3);
            trial.controls.expression = expression;
            let tick = |tick: usize| {
                trial.frame.cue = cue(tick);
                let frame = trial.tick();
                assert_sound(&frame);
                frame
            };
            (0..130).map(tick).collect::<Vec<_>>()
        };
        let (with, without) = (run(0.5), run(0.0));
        let away = |(a, b): (&umo_core_pose::frame::OwnedFrame, &umo_core_pose::frame::OwnedFrame)| {
            let turned = angle_between(a.pose.rotations[SPINE[2]], b.pose.rotations[SPINE[2]]) / DEGREE;
            (turned, shape(a, "jawOpen"))
        };
        with.iter().zip(&without).map(away).collect()
    }

    #[test]
    fn a_breath_ends_as_a_known_phrase_begins() {
        let found = breaths(true);
        for begin in [30, 80] {
            let [before, during, at] = [begin - 8, begin - 3, begin].map(|tick| found[tick]);
            assert!(before.0 < during.0 && during.0 < at.0 && at.0 > 1.2, "{before:?} {during:?} {at:?}");
            assert!(during.1 > 0.01, "lips part: {during:?}");
        }
        // Nothing begins within a phrase, and nothing jumps.
        assert!(found[34..60].is_sorted_by(|a, b| a.0 >= b.0));
        assert!(found.windows(2).all(|pair| (pair[1].0 - pair[0].0).abs() < 0.6));
    }

    #[test]
    fn breaths_are_quick_between_quick_phrases() {
        let found = breaths(true);
        // The second comes 50 ticks after the first: less than a breath's whole way.
        assert!(found[24].0 > 0.1 && found[74].0 < found[24].0 + found[73].0, "{:?} {:?}", found[24], &found[73..75]);
    }

    #[test]
    fn breath_is_hard_after_long_shouting() {
        let span = |expression: f32| {
            let mut trial = Trial::new(&[Layer::Idle], 3);
            trial.controls.expression = expression;
            trial.frame.cue = Cue { level: 0.1, arousal: 0.95, ..Cue::default() };
            trial.ticks(240);
            trial.frame.cue = Cue::default();
            let chest: Vec<f32> =
                trial.ticks(120).iter().map(|frame| turned(&trial, frame, SPINE[2])[1] / DEGREE).collect();
            chest.iter().fold(f32::MIN, |a, &b| a.max(b)) - chest.iter().fold(f32::MAX, |a, &b| a.min(b))
        };
        let (hard, usual) = (span(0.5), span(0.0));
        assert!(hard > 1.4 * usual, "{hard} {usual}");
    }

    #[test]
    fn a_live_voice_breathes_after_a_phrase() {
        let found = breaths(false);
        assert!(found[..60].iter().all(|breath| breath.0 < 0.1));
        assert!((66..78).any(|tick| found[tick].0 > 1.2), "{:?}", &found[60..80]);
    }
}
