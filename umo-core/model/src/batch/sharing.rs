//! Decision whether to share a step with the team's other threads, learned at run time from how long steps of its
//! kind take with and without them.
//!
//! The result does not depend on it: a wrong decision only costs time. A small model's layer is done before the
//! others are awake, and a waiting thread occupies a core that a game wants; on a busy machine the others may be
//! late. So the other threads must save a tenth of the time; otherwise the calling thread works alone.

use std::time::Duration;

use umo_core_base::memory::filled;

/// Largest ratio of the shared to the unshared time at which sharing pays.
const WORTH_IT: f32 = 0.9;
/// Number of times per alternative that a decision is based on; their median, so odd.
const SAMPLES: usize = 5;
/// Steps between two trials of the other alternative; steps until the next trial after one that contradicts the
/// decision.
const TRIAL_INTERVAL: u32 = 256;
const NEXT_TRIAL: u32 = 4;

/// Recent times of one alternative, seconds.
#[derive(Clone, Copy, Debug, Default)]
struct Times {
    last: [f32; SAMPLES],
    /// Number of times so far, up to [`SAMPLES`].
    count: usize,
    next: usize,
}

impl Times {
    fn add(&mut self, time: f32) {
        self.last[self.next] = time;
        self.next = (self.next + 1) % SAMPLES;
        self.count = (self.count + 1).min(SAMPLES);
    }

    fn is_known(&self) -> bool {
        self.count == SAMPLES
    }

    fn median(&self) -> f32 {
        let mut sorted = self.last;
        sorted.sort_unstable_by(f32::total_cmp);
        sorted[SAMPLES / 2]
    }
}

/// Steps of one kind, in batches of one size.
#[derive(Clone, Copy, Debug, Default)]
struct Kind {
    shared: Times,
    alone: Times,
    /// Steps until the next trial.
    until_trial: u32,
}

impl Kind {
    fn is_worth_it(&self) -> bool {
        self.shared.median() <= WORTH_IT * self.alone.median()
    }

    /// Whether the next step is shared.
    fn choose(&self) -> bool {
        if !(self.shared.is_known() && self.alone.is_known()) {
            // Shared first: users wait for the first frames of a stream.
            return self.shared.count <= self.alone.count;
        }
        self.is_worth_it() != (self.until_trial == 0)
    }

    /// Records the time of a step, shared or not as [`Self::choose`] decided.
    fn learn(&mut self, shared: bool, time: Duration) {
        let (known, time) = (self.shared.is_known() && self.alone.is_known(), time.as_secs_f32());
        let was_trial = known && shared != self.is_worth_it();
        if was_trial {
            let speaks_for_shared = match shared {
                true => time <= WORTH_IT * self.alone.median(),
                false => self.shared.median() <= WORTH_IT * time,
            };
            self.until_trial = if speaks_for_shared == shared { NEXT_TRIAL } else { TRIAL_INTERVAL };
        } else {
            self.until_trial = if known { self.until_trial.saturating_sub(1) } else { TRIAL_INTERVAL };
        }
        if shared { &mut self.shared } else { &mut self.alone }.add(time);
    }
}

/// Times of every kind of step in batches of up to `width` members.
#[derive(Debug)]
pub(super) struct Sharing {
    /// `[kinds, width]`.
    kinds: Box<[Kind]>,
    width: usize,
}

impl Sharing {
    pub(crate) fn new(kinds: usize, width: usize) -> Self {
        Self { kinds: filled(Kind::default(), kinds * width).into(), width }
    }

    /// Whether to share the next step of this kind, in a batch of `members`, with the team's other threads.
    pub(super) fn choose(&self, kind: usize, members: usize) -> bool {
        self.kinds[self.place(kind, members)].choose()
    }

    /// Records the duration of that step.
    pub(super) fn learn(&mut self, kind: usize, members: usize, shared: bool, time: Duration) {
        self.kinds[self.place(kind, members)].learn(shared, time);
    }

    fn place(&self, kind: usize, members: usize) -> usize {
        kind * self.width + members.clamp(1, self.width) - 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MICROSECOND: Duration = Duration::from_micros(1);

    /// Runs `steps` steps that take `shared` or `alone` microseconds; returns how many of the last `last` were
    /// shared.
    fn shared_of(sharing: &mut Sharing, steps: usize, last: usize, shared: u32, alone: u32) -> usize {
        let mut count = 0;
        for step in 0..steps {
            let choice = sharing.choose(1, 2);
            sharing.learn(1, 2, choice, MICROSECOND * if choice { shared } else { alone });
            count += usize::from(choice && step >= steps - last);
        }
        count
    }

    #[test]
    fn the_first_step_is_shared_and_both_ways_are_tried() {
        let mut sharing = Sharing::new(3, 4);
        assert!(sharing.choose(1, 2));
        let tried = shared_of(&mut sharing, 2 * SAMPLES, 2 * SAMPLES, 100, 100);
        assert_eq!(tried, SAMPLES);
    }

    #[test]
    fn threads_that_save_little_are_left_alone_and_those_that_save_much_are_used() {
        let mut sharing = Sharing::new(3, 4);
        assert!(shared_of(&mut sharing, 2000, 1024, 95, 100) <= 5);
        let mut sharing = Sharing::new(3, 4);
        assert!(shared_of(&mut sharing, 2000, 1024, 55, 100) >= 1019);
    }

    #[test]
    fn a_single_slow_step_changes_nothing() {
        let mut sharing = Sharing::new(3, 4);
        shared_of(&mut sharing, 100, 0, 55, 100);
        for _ in 0..2 {
            sharing.learn(1, 2, true, MICROSECOND * 50_000);
        }
        assert!(sharing.choose(1, 2));
    }

    #[test]
    fn it_follows_the_machine_within_a_few_trials() {
        let mut sharing = Sharing::new(3, 4);
        shared_of(&mut sharing, 1000, 0, 55, 100);
        // Another program occupies a core: the other threads are late.
        assert!(shared_of(&mut sharing, 100, 80, 400, 100) <= 1);
        // The other program ends.
        assert!(shared_of(&mut sharing, 600, 256, 55, 100) >= 250);
    }

    #[test]
    fn kinds_and_sizes_of_batches_are_learned_apart() {
        let mut sharing = Sharing::new(3, 4);
        shared_of(&mut sharing, 100, 0, 95, 100);
        assert!(!sharing.choose(1, 2));
        assert!(sharing.choose(0, 2) && sharing.choose(2, 2) && sharing.choose(1, 1) && sharing.choose(1, 3));
    }
}
