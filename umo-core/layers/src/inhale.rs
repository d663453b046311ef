//! Inhalation before a phrase: at its end the voice begins where that is known, otherwise it follows the last phrase.

use umo_core_base::state::{StateError, StatePass};

use super::Tick;
use super::rig::ease;

/// Seconds of the inhalation, and of the way back.
const IN_SECONDS: f32 = 0.25;
const OUT_SECONDS: f32 = 1.8;
/// Least seconds between the beginnings of two.
const LEAST_GAP_SECONDS: f32 = 0.6;

/// Share by which the breath of the liveliest voice is deeper.
const LIVELY_SHARE: f32 = 0.4;

/// An inhalation, and the way back from it.
#[derive(Debug)]
pub(super) struct Inhale {
    /// Seconds since it began.
    time: f32,
    /// Air above that of the idle breath when it began, and when it ends.
    from: f32,
    depth: f32,
}

impl Inhale {
    pub(crate) fn new() -> Self {
        Self { time: IN_SECONDS + OUT_SECONDS, from: 0.0, depth: 0.0 }
    }

    /// Advances by one tick. Returns the air above that of the idle breath, about 0 to 1, and how far the lips are parted,
    /// 0 to 1.
    pub(crate) fn advance(&mut self, tick: &Tick) -> [f32; 2] {
        let onset = tick.cue.onset;
        let is_due = if onset < 0.0 { tick.weights.own.ends } else { onset > 0.0 && onset <= IN_SECONDS };
        let amount = (2.0 * tick.controls.expression).min(1.0);
        if is_due && self.time >= LEAST_GAP_SECONDS && amount > 0.0 {
            self.from = self.air();
            self.depth = amount * (1.0 + LIVELY_SHARE * tick.lively);
            self.time = 0.0;
        }
        self.time = (self.time + tick.seconds).min(IN_SECONDS + OUT_SECONDS);
        let parted =
            ease((self.time / IN_SECONDS).min(1.0)) * (1.0 - ease(((self.time - IN_SECONDS) / 0.1).clamp(0.0, 1.0)));
        [self.air(), self.depth * parted]
    }

    fn air(&self) -> f32 {
        if self.time < IN_SECONDS {
            return self.from + (self.depth - self.from) * ease(self.time / IN_SECONDS);
        }
        self.depth * (1.0 - ease(((self.time - IN_SECONDS) / OUT_SECONDS).min(1.0)))
    }

    /// Saves or loads the layer between two ticks.
    pub(crate) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.within(&mut self.time, 0.0..=IN_SECONDS + OUT_SECONDS)?;
        pass.within(&mut self.from, 0.0..=2.0)?;
        pass.within(&mut self.depth, 0.0..=2.0)
    }
}

#[cfg(test)]
mod tests {
    use super::super::rig::{DEGREE, SPINE, angle_between};
    use super::super::trial::{Trial, assert_sound, shape};
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
            assert!(during.1 > 0.02, "lips part: {during:?}");
        }
        // Nothing begins within a phrase, and nothing jumps.
        assert!(found[34..60].is_sorted_by(|a, b| a.0 >= b.0));
        assert!(found.windows(2).all(|pair| (pair[1].0 - pair[0].0).abs() < 0.6));
    }

    #[test]
    fn a_live_voice_breathes_after_a_phrase() {
        let found = breaths(false);
        assert!(found[..60].iter().all(|breath| breath.0 < 0.1));
        assert!((66..78).any(|tick| found[tick].0 > 1.2), "{:?}", &found[60..80]);
    }
}
