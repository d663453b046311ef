//! Gestures for words whose times the host knows (SPEC 2.20): plans of `umo_core_words`, and the moment at which each
//! begins. A word's gesture leaves its parts to the host's own at any time.

use umo_core_base::state::{StateError, StatePass};
use umo_core_pose::frame::OwnedFrame;
use umo_core_words::{Hand, Hints, LATE_SECONDS, Outcome, Plan, Planner, UNITS, WordRules};

use super::gesture::{Player, Request, Side};
use super::{Heard, Tick};

/// Upper bound on the gestures that are decided and not begun: the gap of the hands and of the head leaves fewer.
const MAX_PLANS: usize = 8;
/// Last time that a stroke may have.
const MAX_TIME: u64 = 1 << 61;

/// A gesture that has not begun.
#[derive(Clone, Copy, Debug)]
struct Planned {
    request: Request,
    /// Time of its stroke in the host's audio, in [`UNITS`].
    stroke: u64,
    /// Whether it is the next stroke of a list, if that still waits for it.
    goes_on: bool,
}

/// Words that wait, and gestures that have not begun.
#[derive(Debug)]
pub(super) struct Words {
    rules: WordRules,
    planner: Planner,
    plans: [Planned; MAX_PLANS],
    count: usize,
}

impl Words {
    pub(crate) fn new(rules: WordRules) -> Self {
        let plans = [Planned { request: Request::NONE, stroke: 0, goes_on: false }; MAX_PLANS];
        Self { rules, planner: Planner::new(), plans, count: 0 }
    }

    pub(super) fn rules(&self) -> &WordRules {
        &self.rules
    }

    /// Whether nothing waits.
    pub(super) fn is_empty(&self, hints: &Hints) -> bool {
        self.count == 0 && self.planner.is_empty(hints)
    }

    /// Number of words that were decided or dropped.
    pub(super) fn passed(&self) -> u64 {
        self.planner.passed()
    }

    /// Goes on in another epoch, with what waits.
    pub(super) fn move_to(&mut self, epoch: u32) {
        self.planner.move_to(epoch);
    }

    /// Begins a new epoch: drops the words of earlier ones, and gestures that have not begun.
    pub(super) fn interrupt(&mut self, epoch: u32, hints: &Hints) {
        self.planner.interrupt(epoch, hints);
        self.count = 0;
    }

    /// Returns to the start of a stream.
    pub(super) fn reset(&mut self, epoch: u32, hints: &Hints) {
        self.planner.reset(epoch, hints);
        self.count = 0;
    }

    /// Decides the words that are near, and begins the gestures that are due at this frame.
    pub(crate) fn apply(&mut self, player: &mut Player, frame: &OwnedFrame, tick: &Tick, heard: Heard) {
        let Self { rules, planner, plans, count } = self;
        let now = time(tick, heard);
        planner.plan(rules, &tick.controls.words, tick.seed, now, |decision| {
            if let Outcome::Gesture(plan) = decision.outcome
                && *count < MAX_PLANS
                && let Some(planned) = planned(rules, player, &plan)
            {
                plans[*count] = planned;
                *count += 1;
            }
        });
        if player.is_listing(tick) {
            let planned = plans[..*count].iter().filter(|planned| planned.goes_on).map(|planned| planned.stroke).min();
            let next = planned.or_else(|| planner.next_item(rules));
            player.set_item(next.map(|stroke| seconds(stroke, now)));
        }
        let mut kept = 0;
        for at in 0..self.count {
            let planned = self.plans[at];
            if !begin(player, planned, frame, tick, now) {
                self.plans[kept] = planned;
                kept += 1;
            }
        }
        self.count = kept;
    }

    pub(crate) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        self.planner.state(pass)?;
        pass.length("words' gestures", &mut self.count, MAX_PLANS as u64)?;
        for planned in &mut self.plans {
            planned.request.state(pass)?;
            pass.number("words' gestures", &mut planned.stroke, MAX_TIME)?;
            pass.switch("words' gestures", &mut planned.goes_on)?;
        }
        Ok(())
    }
}

/// The request of a plan; `None` if the avatar does not know its gesture.
fn planned(rules: &WordRules, player: &Player, plan: &Plan) -> Option<Planned> {
    let gesture = rules.classes().get(usize::from(plan.class))?.gestures.get(usize::from(plan.gesture))?;
    let side = match plan.side {
        Hand::Auto | Hand::Either => Side::Auto,
        Hand::Left => Side::Left,
        Hand::Right => Side::Right,
        Hand::Both => Side::Both,
    };
    let request = Request::of_word(player.find(&gesture.name)?, plan.variant, plan.speed, plan.strength, side);
    Some(Planned { request, stroke: plan.stroke, goes_on: plan.goes_on })
}

/// Time of a frame in the host's audio, in [`UNITS`]: of the nearest multiple of its duration, so that rounding to samples
/// of any rate changes nothing.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a stream is shorter than 2^53 frames")]
fn time(tick: &Tick, heard: Heard) -> u64 {
    let frame_rate = (1.0 / f64::from(tick.seconds)).round();
    let frame = (heard.sample as f64 * frame_rate / heard.rate as f64).round();
    (frame * UNITS as f64 / frame_rate).round() as u64
}

/// Seconds from one time to another, in [`UNITS`]; negative once it has passed.
#[expect(clippy::cast_possible_truncation, reason = "a few seconds")]
fn seconds(to: u64, from: u64) -> f32 {
    ((to as f64 - from as f64) / UNITS as f64) as f32
}

/// Begins a gesture if it is due at `now`; returns whether it need not wait.
fn begin(player: &mut Player, planned: Planned, frame: &OwnedFrame, tick: &Tick, now: u64) -> bool {
    let Planned { request, stroke, goes_on } = planned;
    if goes_on && player.is_listing(tick) {
        // The list's own next stroke.
        return stroke <= now;
    }
    let lead = player.lead(&request);
    // Negative once the stroke's time has passed.
    let left = (stroke as f64 - now as f64) / UNITS as f64;
    let half = 0.5 * f64::from(tick.seconds);
    if left > f64::from(lead / request.speed()) + half {
        return false;
    }
    #[expect(clippy::cast_possible_truncation, reason = "a few seconds")]
    let hurried = request.hurried(lead, (left + half).max(0.0) as f32);
    let late = f64::from(lead / hurried.speed()) - left;
    if late <= LATE_SECONDS {
        player.offer(hurried, frame, tick);
    }
    true
}

#[cfg(test)]
mod tests;
