//! From words with times to gestures with times.
//!
//! Words wait in the order of their times. The next one is decided [`REACH_SECONDS`] before it is heard, with the words
//! that follow it: the longest phrase counts, gaps between gestures hold, weak classes make room for the others, and
//! chance takes one of the class's gestures.

use umo_core_base::random::philox;
use umo_core_base::state::{StateError, StatePass};

use crate::rules::{Class, ClassGesture, Hand, MAX_CLASSES, MAX_PHRASE, Match, UNKNOWN, WordRules};
use crate::text::{Normal, spoken};

/// Upper bound on the words that wait for their decision.
pub const MAX_PENDING_WORDS: usize = 64;
/// Longest duration of one call's words, seconds.
pub const MAX_WORDS_SECONDS: f64 = 30.0;
/// Time before a word at which it is decided, seconds: the longest way to a stroke, and some more.
pub const REACH_SECONDS: f64 = 1.6;
/// Time after its stress at which a word is too late, seconds.
pub const LATE_SECONDS: f64 = 0.3;

/// Least time between two strokes of a gesture that waits for the words of its strokes, seconds.
const ITEM_SECONDS: f64 = 0.8;
/// Longest pause within a phrase, seconds.
const PAUSE_SECONDS: f64 = 0.7;
/// Duration of a syllable without stress, and of one with much, seconds.
const SHORT_SYLLABLE: f64 = 0.12;
const LONG_SYLLABLE: f64 = 0.30;
/// Units of time per second: a whole number of them is a frame at any usual rate.
pub const UNITS: u64 = 90_000;
/// Last time that a word may have: beyond any stream, and far enough from overflow.
const MAX_TIME: u64 = 1 << 60;
/// Upper bound on the duration of a word.
const MAX_LENGTH: u64 = 1 << 24;
/// Distinguishes these draws from all others of a seed.
const STREAM: u32 = 0x776f_7264;

/// Words that were refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WordError {
    /// A time out of range.
    Time,
    /// More words in one call than can wait.
    TooMany,
    /// [`MAX_PENDING_WORDS`] wait already.
    Full,
}

/// A word and its time.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Word {
    /// Beginning in the host's audio, in [`UNITS`].
    start: u64,
    /// From there to the stressed vowel, and to the end.
    stress: u32,
    length: u32,
    token: u32,
    /// Whether no phrase goes on after it.
    is_end: bool,
    /// How long its syllables are, 0 to 255.
    accent: u8,
    /// Epoch in which it was given.
    epoch: u32,
}

impl Word {
    const NONE: Self = Self { start: 0, stress: 0, length: 0, token: UNKNOWN, is_end: false, accent: 0, epoch: 0 };

    /// Time of the stressed vowel.
    fn stroke(&self) -> u64 {
        self.start + u64::from(self.stress)
    }

    /// Words wait in this order, whatever the order in which they came.
    fn order(&self) -> (u64, u32, u32) {
        (self.start, self.length, self.token)
    }

    fn end(&self) -> u64 {
        self.start + u64::from(self.length)
    }

    fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.number("word's start", &mut self.start, MAX_TIME)?;
        let length = small(pass, "word's length", &mut self.length, MAX_LENGTH)?;
        small(pass, "word's stress", &mut self.stress, length)?;
        small(pass, "word", &mut self.token, u32::MAX.into())?;
        pass.switch("word's end", &mut self.is_end)?;
        let mut accent = self.accent.into();
        small(pass, "word's accent", &mut accent, u8::MAX.into())?;
        self.accent = u8::try_from(accent).unwrap_or_default();
        small(pass, "word's epoch", &mut self.epoch, u32::MAX.into())?;
        Ok(())
    }
}

/// An integer of 32 bits of a state; returns the effective value.
fn small(pass: &mut StatePass, what: &'static str, field: &mut u32, most: u64) -> Result<u64, StateError> {
    let value = pass.limited(what, u64::from(*field), most)?;
    if pass.loads() {
        *field = u32::try_from(value).unwrap_or_default();
    }
    Ok(value)
}

/// Queue of words from the host to the output: the newest ones, in a ring indexed by number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hints {
    ring: [Word; MAX_PENDING_WORDS],
    /// Number of words so far.
    count: u64,
}

impl Hints {
    /// No words.
    pub const NONE: Self = Self { ring: [Word::NONE; MAX_PENDING_WORDS], count: 0 };

    /// Makes every word one of this epoch.
    pub fn move_to(&mut self, epoch: u32) {
        self.ring.iter_mut().for_each(|word| word.epoch = epoch);
    }

    /// Adds the words of a text that is spoken from `start` to `end`, in seconds of audio; several words
    /// share the time by their syllables. Fails if they would be more than [`MAX_PENDING_WORDS`] that wait, given that
    /// `passed` are done. Never allocates.
    ///
    /// # Errors
    /// [`WordError`]; nothing was added then.
    pub fn push(
        &mut self,
        rules: &WordRules,
        text: &str,
        (start, end): (f64, f64),
        (epoch, passed): (u32, u64),
    ) -> Result<(), WordError> {
        let last = MAX_TIME as f64 / UNITS as f64;
        if !(0.0..=last).contains(&start) || !(0.0..=MAX_WORDS_SECONDS).contains(&(end - start)) {
            return Err(WordError::Time);
        }
        let sound = |word: &str| rules.sound(Normal::new(word).as_str());
        let (mut words, mut syllables) = (0_usize, 0_u64);
        for word in spoken(text) {
            (words, syllables) = (words + 1, syllables + u64::from(sound(word.text).syllables));
        }
        if words > MAX_PENDING_WORDS {
            return Err(WordError::TooMany);
        }
        if self.count.saturating_sub(passed) + words as u64 > MAX_PENDING_WORDS as u64 {
            return Err(WordError::Full);
        }
        let syllable = (end - start) / syllables.max(1) as f64;
        let share = ((syllable - SHORT_SYLLABLE) / (LONG_SYLLABLE - SHORT_SYLLABLE)).clamp(0.0, 1.0);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the limits")]
        let (unit, accent) = (|seconds: f64| (seconds * UNITS as f64).round() as u64, (255.0 * share).round() as u8);
        let offset = |from: u64, to: u64| u32::try_from(to - from).unwrap_or(u32::MAX);
        let mut at = start;
        for word in spoken(text) {
            let normal = Normal::new(word.text);
            let sound = rules.sound(normal.as_str());
            let length = f64::from(sound.syllables) * syllable;
            let first = unit(at);
            self.ring[place(self.count)] = Word {
                start: first,
                stress: offset(first, unit(at + f64::from(sound.stress) * length)),
                length: offset(first, unit(at + length)),
                token: rules.token(normal.as_str()),
                is_end: word.is_end,
                accent,
                epoch,
            };
            self.count += 1;
            at += length;
        }
        Ok(())
    }

    /// Saves or loads the queue.
    pub fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.number("words", &mut self.count, MAX_TIME)?;
        self.ring.iter_mut().try_for_each(|word| word.state(pass))
    }
}

#[expect(clippy::cast_possible_truncation, reason = "below the length")]
fn place(number: u64) -> usize {
    (number % MAX_PENDING_WORDS as u64) as usize
}

/// A gesture for a word.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plan {
    /// Number of the word's class.
    pub class: u16,
    /// Number of the gesture in the class.
    pub gesture: u8,
    /// Time of the stroke in the host's audio, in [`UNITS`].
    pub stroke: u64,
    /// Strength, 0 to 1.
    pub strength: f32,
    /// Speed, 0.5 to 2.
    pub speed: f32,
    /// Hand; never [`Hand::Either`].
    pub side: Hand,
    /// Variant of the gesture, from 1: its pose, and how it differs a little in size, height and tempo.
    pub variant: u8,
    /// Whether it is the next stroke of the class's last gesture, if that still waits for it.
    pub goes_on: bool,
}

/// What becomes of a phrase.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Outcome {
    /// It is gestured.
    Gesture(Plan),
    /// The word has no class.
    NoClass,
    /// The class has no gesture.
    NoGesture,
    /// Its time has passed.
    Late,
    /// The last gesture of the class is too near.
    ClassGap,
    /// Another gesture is too near.
    Gap,
    /// The class is a weak one, whose chance is below 1, and a strong one follows soon.
    Yields,
    /// Chance left it out.
    Chance,
}

/// A decided phrase.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Decision {
    /// Time at which its first word begins, in [`UNITS`].
    pub start: u64,
    /// Number of its words.
    pub words: usize,
    /// Number of its class.
    pub class: Option<u16>,
    /// What becomes of it.
    pub outcome: Outcome,
}

/// The last gesture of a class.
#[derive(Clone, Copy, Debug, Default)]
struct Last {
    stroke: Option<u64>,
    gesture: u8,
}

/// Words that wait for their decision, and what the next ones depend on.
#[derive(Debug)]
pub struct Planner {
    /// Epoch of the stream.
    epoch: u32,
    /// Number of words taken from the queue, and of those that were decided or dropped.
    taken: u64,
    passed: u64,
    /// In the order of their times.
    waiting: [Word; MAX_PENDING_WORDS],
    count: usize,
    /// By class.
    lasts: [Last; MAX_CLASSES],
    /// Strokes of the hands and of the head.
    hands: Option<u64>,
    head: Option<u64>,
    /// Number of decisions by chance so far.
    draws: u64,
}

impl Planner {
    /// Creates a plan without words.
    pub fn new() -> Self {
        Self {
            epoch: 0,
            taken: 0,
            passed: 0,
            waiting: [Word::NONE; MAX_PENDING_WORDS],
            count: 0,
            lasts: [Last::default(); MAX_CLASSES],
            hands: None,
            head: None,
            draws: 0,
        }
    }

    /// Whether no word waits.
    pub fn is_empty(&self, hints: &Hints) -> bool {
        self.count == 0 && self.taken == hints.count
    }

    /// Number of words that were decided or dropped.
    pub fn passed(&self) -> u64 {
        self.passed
    }

    /// Goes on in another epoch, with what waits.
    pub fn move_to(&mut self, epoch: u32) {
        self.epoch = epoch;
        self.waiting.iter_mut().for_each(|word| word.epoch = epoch);
    }

    /// Begins a new epoch: drops the words of earlier ones.
    pub fn interrupt(&mut self, epoch: u32, hints: &Hints) {
        self.epoch = epoch;
        self.take(hints);
        let mut kept = 0;
        for at in 0..self.count {
            if !is_older(self.waiting[at].epoch, epoch) {
                self.waiting[kept] = self.waiting[at];
                kept += 1;
            }
        }
        self.passed += (self.count - kept) as u64;
        self.count = kept;
    }

    /// [`Self::interrupt`], and forgets all gestures so far.
    pub fn reset(&mut self, epoch: u32, hints: &Hints) {
        self.interrupt(epoch, hints);
        self.lasts = [Last::default(); MAX_CLASSES];
        (self.hands, self.head, self.draws) = (None, None, 0);
    }

    fn take(&mut self, hints: &Hints) {
        // Only a forged state has more than fit.
        let first = self.taken.max(hints.count.saturating_sub(MAX_PENDING_WORDS as u64));
        self.passed += first - self.taken;
        self.taken = first;
        while self.taken < hints.count {
            let word = hints.ring[place(self.taken)];
            self.taken += 1;
            if is_older(word.epoch, self.epoch) || self.count == MAX_PENDING_WORDS {
                self.passed += 1;
                continue;
            }
            let at = self.waiting[..self.count].partition_point(|other| other.order() <= word.order());
            self.waiting.copy_within(at..self.count, at + 1);
            self.waiting[at] = word;
            self.count += 1;
        }
    }

    /// Decides the words that are heard until [`REACH_SECONDS`] after `now`, in [`UNITS`]; passes every decision
    /// to `decide`. Never allocates.
    pub fn plan(&mut self, rules: &WordRules, hints: &Hints, seed: u64, now: u64, mut decide: impl FnMut(Decision)) {
        self.take(hints);
        let reach = now + units(REACH_SECONDS);
        while self.count > 0 && self.waiting[0].start <= reach {
            let decision = self.decide(rules, seed, now);
            decide(decision);
            self.waiting.copy_within(decision.words..self.count, 0);
            self.count -= decision.words;
            self.passed += decision.words as u64;
        }
    }

    /// The longest phrase at a waiting word.
    fn find(&self, rules: &WordRules, at: usize) -> Option<Match> {
        let words = &self.waiting[at..self.count.min(at + MAX_PHRASE)];
        let pause = units(PAUSE_SECONDS);
        let mut tokens = [UNKNOWN; MAX_PHRASE];
        let mut length = 0;
        for (number, word) in words.iter().enumerate() {
            let goes_on = |before: &Word| !before.is_end && word.start <= before.end() + pause;
            if number > 0 && !goes_on(&words[number - 1]) {
                break;
            }
            tokens[number] = word.token;
            length = number + 1;
        }
        rules.find(&tokens[..length])
    }

    /// Decides the first waiting word, or the phrase that begins with it.
    fn decide(&mut self, rules: &WordRules, seed: u64, now: u64) -> Decision {
        let start = self.waiting[0].start;
        let Some(found) = self.find(rules, 0) else {
            return Decision { start, words: 1, class: None, outcome: Outcome::NoClass };
        };
        let outcome = self.outcome(rules, found, seed, now);
        if let Outcome::Gesture(plan) = outcome {
            let class = &rules.classes()[usize::from(plan.class)];
            *(if class.is_head { &mut self.head } else { &mut self.hands }) = Some(plan.stroke);
            self.lasts[usize::from(plan.class)] = Last { stroke: Some(plan.stroke), gesture: plan.gesture };
        }
        Decision { start, words: found.length, class: Some(found.class), outcome }
    }

    fn outcome(&mut self, rules: &WordRules, found: Match, seed: u64, now: u64) -> Outcome {
        let (number, word) = (usize::from(found.class), self.waiting[found.stressed]);
        let (class, stroke) = (&rules.classes()[number], word.stroke());
        if class.gestures.is_empty() {
            return Outcome::NoGesture;
        }
        if stroke + units(LATE_SECONDS) < now {
            return Outcome::Late;
        }
        let is_near = |last: Option<u64>, gap: f64| last.is_some_and(|last| last.abs_diff(stroke) < units(gap));
        let Last { stroke: last, gesture } = self.lasts[number];
        let goes_on = self.is_held(class, number) && is_near(last, class.hold) && !is_near(last, ITEM_SECONDS);
        if !goes_on && is_near(last, class.gap) {
            return Outcome::ClassGap;
        }
        if !goes_on && is_near(if class.is_head { self.head } else { self.hands }, rules.gap()) {
            return Outcome::Gap;
        }
        if class.chance < 1.0 && self.is_followed(rules, found, stroke) {
            return Outcome::Yields;
        }
        let [chance, which, hand, size] = uniforms(seed, self.draws);
        self.draws += 1;
        if chance >= class.chance {
            return Outcome::Chance;
        }
        let (gesture, &ClassGesture { strength, speed, side, .. }) = match class.gestures.get(usize::from(gesture)) {
            Some(last) if goes_on => (gesture, last),
            _ => self.choose(class, number, which),
        };
        let accent = f32::from(word.accent) / 255.0;
        let side = match side {
            Hand::Either if hand < 0.5 => Hand::Left,
            Hand::Either => Hand::Right,
            side => side,
        };
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "1 to 255")]
        let variant = 1 + (254.0 * size) as u8;
        Outcome::Gesture(Plan {
            class: found.class,
            gesture,
            stroke,
            strength: strength * (0.8 + 0.2 * accent) * (0.9 + 0.1 * size),
            speed: (speed * (0.95 + 0.1 * hand)).clamp(0.5, 2.0),
            side,
            variant,
            goes_on,
        })
    }

    /// Whether the last stroke of the hands was of this class, and its hand waits for the class's next word.
    fn is_held(&self, class: &Class, number: usize) -> bool {
        class.hold > 0.0 && !class.is_head && self.hands.is_some() && self.lasts[number].stroke == self.hands
    }

    /// The stroke of the next waiting word that a held hand waits for, in [`UNITS`].
    pub fn next_item(&self, rules: &WordRules) -> Option<u64> {
        let held = rules.classes().iter().enumerate().find(|&(number, class)| self.is_held(class, number));
        let ((number, class), last) = held.zip(self.hands)?;
        let end = last + units(class.hold);
        (0..self.count).take_while(|&at| self.waiting[at].start < end).find_map(|at| {
            let found = self.find(rules, at).filter(|found| usize::from(found.class) == number)?;
            let stroke = self.waiting[at + found.stressed].stroke();
            (last + units(ITEM_SECONDS)..end).contains(&stroke).then_some(stroke)
        })
    }

    /// Whether a strong class of the same part follows a phrase before another gesture could come.
    fn is_followed(&self, rules: &WordRules, found: Match, stroke: u64) -> bool {
        let (part, end) = (rules.classes()[usize::from(found.class)].is_head, stroke + units(rules.gap()));
        (found.length..self.count).take_while(|&at| self.waiting[at].start < end).any(|at| {
            self.find(rules, at).is_some_and(|next| {
                let class = &rules.classes()[usize::from(next.class)];
                let is_strong = class.chance >= 1.0 && class.is_head == part && !class.gestures.is_empty();
                is_strong && self.waiting[at + next.stressed].stroke() < end
            })
        })
    }

    /// One of a class's gestures by their weights, not the last one again.
    fn choose<'a>(&self, class: &'a Class, number: usize, which: f32) -> (u8, &'a ClassGesture) {
        let Last { stroke, gesture } = self.lasts[number];
        let again = stroke.map(|_| usize::from(gesture)).filter(|_| class.gestures.len() > 1);
        let all = || class.gestures.iter().enumerate().filter(move |&(at, _)| Some(at) != again);
        let mut left = which * all().map(|(_, gesture)| gesture.weight).sum::<f32>();
        let found = all().find(|(_, gesture)| {
            left -= gesture.weight;
            left < 0.0
        });
        let (at, gesture) = found.or_else(|| all().next_back()).unwrap_or((0, &class.gestures[0]));
        (u8::try_from(at).unwrap_or_default(), gesture)
    }

    /// Saves or loads the words that wait and the gestures that were.
    pub fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        small(pass, "words' epoch", &mut self.epoch, u32::MAX.into())?;
        let taken = pass.number("words", &mut self.taken, MAX_TIME)?;
        pass.number("words", &mut self.passed, taken)?;
        pass.length("words", &mut self.count, MAX_PENDING_WORDS as u64)?;
        self.waiting.iter_mut().try_for_each(|word| word.state(pass))?;
        for Last { stroke, gesture } in &mut self.lasts {
            pass.maybe("word's gesture", stroke, 2 * MAX_TIME)?;
            let mut number = (*gesture).into();
            small(pass, "word's gesture", &mut number, u8::MAX.into())?;
            *gesture = u8::try_from(number).unwrap_or_default();
        }
        pass.maybe("hands' stroke", &mut self.hands, 2 * MAX_TIME)?;
        pass.maybe("head's stroke", &mut self.head, 2 * MAX_TIME)?;
        pass.number("words' draws", &mut self.draws, MAX_TIME)?;
        Ok(())
    }
}

impl Default for Planner {
    fn default() -> Self {
        Self::new()
    }
}

/// Whether an epoch came before another; the numbers may wrap.
fn is_older(epoch: u32, than: u32) -> bool {
    than.wrapping_sub(epoch).wrapping_sub(1) < u32::MAX / 2
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "minutes")]
fn units(seconds: f64) -> u64 {
    (seconds * UNITS as f64) as u64
}

/// Four numbers in `0..1` that depend on the arguments alone.
#[expect(clippy::cast_possible_truncation, reason = "taking halves of 64-bit words is intended")]
fn uniforms(seed: u64, counter: u64) -> [f32; 4] {
    let words = [counter as u32, (counter >> 32) as u32, STREAM, 1];
    philox(words, [seed as u32, (seed >> 32) as u32]).map(|bits| (bits >> 8) as f32 / (1 << 24) as f32)
}

#[cfg(test)]
mod tests;
