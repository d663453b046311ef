//! What the host sets for the frame side, from any thread.

use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, AtomicU64, Ordering};
use std::time::Duration;

use umo_core_base::clock::Clock;
use umo_core_base::state::{StateError, StatePass};
use umo_core_layers::{Company, Controls, Gestures, WordRules};
use umo_core_pose::part::PerPart;

use crate::link::Handover;
use crate::take::Passed;

use super::Idle;

/// Upper bound of the host's time, nanoseconds: 36 years, below the count at which the clock
/// starts.
const MAX_HOST_TIME: u64 = 1 << 60;

/// Age in nanoseconds from which the interlocutor's level counts as silence.
const STALE: u64 = 250_000_000;

/// Settings, requests and times that the stages read.
#[derive(Debug)]
pub(crate) struct Host {
    pub(crate) clock: HostClock,
    /// Requests to the layers.
    pub(crate) controls: Handover<Controls>,
    /// The others of a scene, who are part of the controls once they are taken over.
    pub(crate) company: Handover<Company>,
    /// Gestures that the avatar knows, and the number of requested ones that have begun.
    pub(crate) gestures: Gestures,
    pub(crate) begun_gestures: AtomicU64,
    /// Number of viseme hints that were shown or dropped.
    pub(crate) passed_hints: AtomicU64,
    /// Rules of words, and the number of words that were decided or dropped.
    pub(crate) words: WordRules,
    pub(crate) passed_words: AtomicU64,
    /// Whether the avatar listens in company, with layers that keep it alive.
    pub(crate) listens: AtomicBool,
    /// Value of an [`Idle`].
    pub(crate) idle: AtomicU8,
    /// Gain of each part, as the bits of floats.
    pub(crate) gains: PerPart<AtomicU32>,
    /// Loudness of the interlocutor, as the bits of a float.
    pub(crate) other_level: AtomicU32,
    /// Time of that measurement, by [`HostClock::now`].
    pub(crate) other_time: AtomicU64,
}

impl Host {
    pub(crate) fn new(clock: Clock, controls: Controls, (gestures, words): (Gestures, WordRules), idle: Idle) -> Self {
        let clock = HostClock::new(clock);
        Self {
            // Nothing was heard yet.
            other_time: AtomicU64::new(0),
            clock,
            controls: Handover::new(controls, true),
            company: Handover::new(Company::ALONE, false),
            gestures,
            begun_gestures: AtomicU64::new(0),
            passed_hints: AtomicU64::new(0),
            words,
            passed_words: AtomicU64::new(0),
            listens: AtomicBool::new(false),
            idle: AtomicU8::new(idle as u8),
            gains: PerPart::from_fn(|_| AtomicU32::new(1.0_f32.to_bits())),
            other_level: AtomicU32::new(0.0_f32.to_bits()),
        }
    }

    /// The idle mode.
    pub(crate) fn idle(&self) -> Idle {
        match self.idle.load(Ordering::Relaxed) {
            1 => Idle::Rest,
            2 => Idle::Live,
            _ => Idle::Hold,
        }
    }

    /// Numbers of requests that have begun or passed.
    pub(crate) fn passed(&self) -> Passed {
        let read = |count: &AtomicU64| count.load(Ordering::Acquire);
        Passed { gestures: read(&self.begun_gestures), lips: read(&self.passed_hints), words: read(&self.passed_words) }
    }

    /// Current loudness of the interlocutor, if one is heard.
    pub(crate) fn other_level(&self) -> Option<f32> {
        let age = self.clock.now().saturating_sub(self.other_time.load(Ordering::Relaxed));
        (age <= STALE).then(|| f32::from_bits(self.other_level.load(Ordering::Relaxed)))
    }

    /// Sets the loudness of the interlocutor.
    pub(crate) fn set_other_level(&self, level: f32) {
        self.other_level.store(level.to_bits(), Ordering::Relaxed);
        self.other_time.store(self.clock.now(), Ordering::Relaxed);
    }
}

/// The session's clock, and the host's time if it sets one.
#[derive(Debug)]
pub(crate) struct HostClock {
    clock: Clock,
    /// The host's time, in nanoseconds of the clock's count; 0 while the clock is used.
    time: AtomicU64,
    /// Origin of the host's time, nanoseconds of the clock's count.
    base: AtomicU64,
    /// Time of the last push of audio, by [`Self::now`].
    heard: AtomicU64,
}

impl HostClock {
    fn new(clock: Clock) -> Self {
        let (time, base) = (AtomicU64::new(0), AtomicU64::new(0));
        Self { heard: AtomicU64::new(clock.nanos()), clock, time, base }
    }

    /// The clock's count, nanoseconds.
    pub(crate) fn nanos(&self) -> u64 {
        self.clock.nanos()
    }

    /// Time for idle motion, nanoseconds: the host's if it sets one, otherwise the clock's.
    pub(crate) fn now(&self) -> u64 {
        match self.time.load(Ordering::Relaxed) {
            0 => self.clock.nanos(),
            time => time,
        }
    }

    /// Sets the host's time; it never goes back. One thread at a time.
    pub(crate) fn set(&self, time: Duration) {
        #[expect(clippy::cast_possible_truncation, reason = "at most 2^60 nanoseconds")]
        let nanos = time.as_nanos() as u64;
        let before = self.time.load(Ordering::Relaxed);
        if before == 0 {
            // The host's count continues from the clock's, so that eases in progress continue.
            let now = self.clock.nanos();
            self.base.store(now - nanos, Ordering::Relaxed);
            self.time.store(now, Ordering::Relaxed);
        } else {
            self.time.store(before.max(self.base.load(Ordering::Relaxed) + nanos), Ordering::Relaxed);
        }
    }

    /// Reports that audio was pushed.
    pub(crate) fn hear(&self) {
        self.heard.store(self.now(), Ordering::Relaxed);
    }

    /// Nanoseconds since the last push of audio.
    pub(super) fn silence(&self) -> u64 {
        self.now().saturating_sub(self.heard.load(Ordering::Relaxed))
    }

    /// Describes the host's time; a restored state maps it to the present.
    pub(crate) fn state(&self, pass: &mut StatePass) -> Result<(), StateError> {
        let time = self.time.load(Ordering::Relaxed);
        let is_given = pass.flag("host's time", time != 0)?;
        let mut nanos = time.saturating_sub(self.base.load(Ordering::Relaxed));
        if pass.follows(is_given) {
            nanos = pass.limited("host's time", nanos, MAX_HOST_TIME)?;
        }
        if pass.loads() {
            let now = if is_given { pass.now() } else { 0 };
            self.time.store(now, Ordering::Relaxed);
            self.base.store(now.saturating_sub(nanos), Ordering::Relaxed);
        }
        Ok(())
    }

    /// Describes the time of the last push of audio.
    pub(crate) fn heard_state(&self, pass: &mut StatePass) -> Result<(), StateError> {
        let heard = pass.host_moment("time of sound", self.heard.load(Ordering::Relaxed))?;
        if pass.loads() {
            self.heard.store(heard, Ordering::Relaxed);
        }
        Ok(())
    }
}
