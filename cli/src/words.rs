//! `umo words`, and the words of recordings: their rules, and passing them to an animation in time.

use std::path::Path;

use umo_core::{Animation, Gestures, SessionError, WordRules};
use umo_core_words::{Decision, Hand, Hints, Outcome, Planner, UNITS, spoken};

use crate::args::{RuleArgs, WordArgs, Words};
use crate::failure::Failure;
use crate::speech::Speech;
use crate::transcript::{self, Timed, Transcript};
use umo_gltf::keys::{Marker, MarkerKind};

/// A frame.
const FRAME: u64 = UNITS / 30;
/// Seconds of a syllable, and of a pause after punctuation, in `umo words`.
const SYLLABLE: f64 = 0.2;
const PAUSE: f64 = 0.4;

/// Reads the rules that the arguments name.
pub(crate) fn rules(args: &RuleArgs) -> Result<WordRules, Failure> {
    let mut rules = WordRules::of(&args.language).unwrap_or_default();
    for path in &args.rules {
        let wrong = |problem: String| Failure::Input(format!("{}: {problem}", path.display()));
        let text = std::fs::read_to_string(path).map_err(|error| wrong(error.to_string()))?;
        rules = rules.with(&text).map_err(|error| wrong(error.to_string()))?;
    }
    Ok(rules)
}

/// Prints what a text's words would do.
pub(crate) fn run(args: &Words) -> Result<(), Failure> {
    let rules = rules(&args.rules)?;
    let gestures = Gestures::new();
    if let Some((class, gesture)) = rules.unknown_gesture(|name| gestures.stroke(name).is_some()) {
        eprintln!("note: class {class}: no gesture is called {gesture} here; the host must add it");
    }
    let words = timed(&rules, &args.text);
    let decisions = decisions(&rules, &words, args.seed);
    let count = decisions.iter().filter(|it| matches!(it.outcome, Outcome::Gesture(_))).count();
    println!("{:>6}  {:<24} {:<12} gesture", "s", "words", "class");
    for decision in decisions.iter().filter(|it| it.outcome != Outcome::NoClass) {
        println!("{}", line(&rules, &words, decision));
    }
    let said = words.iter().filter(|word| word.text != "?").count();
    println!("{said} words, {count} gestures in {:.1} s", words.last().map_or(0.0, |word| word.end));
    Ok(())
}

/// The words of a text at an even pace.
fn timed(rules: &WordRules, text: &str) -> Vec<Timed> {
    let mut at = 0.0;
    let time = |word: umo_core_words::Spoken| {
        let start = at;
        let end = start + f64::from(rules.syllables(word.text)) * SYLLABLE;
        at = end + if word.is_end { PAUSE } else { 0.0 };
        Timed { text: format!("{}{}", word.text, if word.is_end { "," } else { "" }), start, end }
    };
    spoken(text).map(time).collect()
}

/// What becomes of words, in order.
fn decisions(rules: &WordRules, words: &[Timed], seed: u64) -> Vec<Decision> {
    let (mut hints, mut planner, mut decisions) = (Hints::NONE, Planner::new(), Vec::new());
    let (mut next, mut now) = (0, 0);
    while next < words.len() || !planner.is_empty(&hints) {
        while let Some(Timed { text, start, end }) = words.get(next)
            && hints.push(rules, text, (*start, *end), (0, planner.passed())).is_ok()
        {
            next += 1;
        }
        planner.plan(rules, &hints, seed, now, |decision| decisions.push(decision));
        now += FRAME;
    }
    decisions
}

/// A decision in one line.
fn line(rules: &WordRules, words: &[Timed], decision: &Decision) -> String {
    let start = decision.start as f64 / UNITS as f64;
    let first = words.iter().position(|word| (word.start - start).abs() < 1e-3).unwrap_or(0);
    let phrase: Vec<&str> =
        words[first..].iter().take(decision.words).map(|word| word.text.trim_end_matches(',')).collect();
    let class = decision.class.map(|class| &rules.classes()[usize::from(class)]);
    let why = match decision.outcome {
        Outcome::Gesture(plan) => {
            let name = class.map_or("", |class| &*class.gestures[usize::from(plan.gesture)].name);
            let stroke = plan.stroke as f64 / UNITS as f64;
            let side = match plan.side {
                Hand::Left => ", left hand",
                Hand::Right => ", right hand",
                Hand::Both => ", both hands",
                Hand::Auto | Hand::Either => "",
            };
            let item = if plan.goes_on { ", its next stroke" } else { "" };
            format!(
                "{name}: stroke at {stroke:.2} s, strength {:.2}, speed {:.2}{side}{item}",
                plan.strength, plan.speed
            )
        }
        Outcome::NoClass | Outcome::NoGesture => "-: the class has none".to_owned(),
        Outcome::Late => "-: too late".to_owned(),
        Outcome::ClassGap => {
            format!("-: less than {} s after the last of its class", class.map_or(0.0, |class| class.gap))
        }
        Outcome::Gap => format!("-: less than {} s after another", rules.gap()),
        Outcome::Yields => "-: gives way to a stronger class that follows".to_owned(),
        Outcome::Chance => {
            format!("-: chance; the class takes {:.0} %", 100.0 * class.map_or(1.0, |class| class.chance))
        }
    };
    format!("{start:>6.2}  {:<24} {:<12} {why}", phrase.join(" "), class.map_or("", |class| &*class.name))
}

/// Words of a recording that are passed to its animation as there is room.
#[derive(Debug, Default)]
pub(crate) struct Script {
    words: Vec<Timed>,
    next: usize,
}

impl Script {
    /// The words that the arguments name, and their rules.
    pub(crate) fn of(args: &WordArgs, speech: &Speech) -> Result<Option<(Self, WordRules)>, Failure> {
        let Some(path) = &args.words else { return Ok(None) };
        let rules = rules(&args.rules)?;
        let script = Self::read(path, &rules, speech.seconds(), |rate| speech.mono(rate))?;
        Ok(Some((script, rules)))
    }

    /// [`Self::of`], with the rules set in the animation.
    pub(crate) fn begin(args: &WordArgs, speech: &Speech, animation: &mut Animation) -> Result<Self, Failure> {
        let Some((script, rules)) = Self::of(args, speech)? else { return Ok(Self::default()) };
        animation.set_word_rules(rules)?;
        Ok(script)
    }

    /// Reads the words of a file; plain text is spread over the `voice` of the recording, which it returns at a rate.
    pub(crate) fn read(
        path: &Path,
        rules: &WordRules,
        seconds: f64,
        voice: impl FnOnce(usize) -> Result<Vec<f32>, Failure>,
    ) -> Result<Self, Failure> {
        let mut words = match transcript::read(path)? {
            Transcript::Timed(words) => words,
            Transcript::Plain(text) => {
                let samples = voice(transcript::VOICE_RATE)?;
                transcript::spread(rules, &text, &transcript::voiced(&samples), seconds)
            }
        };
        words.sort_by(|a, b| a.start.total_cmp(&b.start));
        Ok(Self { words, next: 0 })
    }

    /// The words as markers.
    pub(crate) fn markers(&self) -> impl Iterator<Item = Marker> {
        let marker =
            |word: &Timed| Marker { seconds: word.start, kind: MarkerKind::Word, name: word.text.trim().to_owned() };
        self.words.iter().map(marker)
    }

    /// Passes as many words as there is room for to an animation's `hint`. Call it before every step.
    pub(crate) fn give(
        &mut self,
        mut hint: impl FnMut(&str, f64, f64) -> Result<(), SessionError>,
    ) -> Result<(), Failure> {
        while let Some(Timed { text, start, end }) = self.words.get(self.next) {
            match hint(text, *start, *end) {
                Ok(()) => self.next += 1,
                Err(SessionError::WordsFull) => break,
                Err(error) => return Err(Failure::Input(format!("`{text}` at {start} s: {error}"))),
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_text_does_is_printed_with_its_reason() {
        let rules = WordRules::english();
        let words = timed(&rules, "No, that is not bad. The table. Hello!");
        let lines: Vec<String> = decisions(&rules, &words, 0)
            .iter()
            .filter(|it| it.outcome != Outcome::NoClass)
            .map(|it| line(&rules, &words, it))
            .collect();
        let has = |text: &str, all: &[&str]| {
            let found = lines.iter().find(|line| line.contains(text)).unwrap_or_else(|| panic!("{text}: {lines:?}"));
            assert!(all.iter().all(|part| found.contains(part)), "{found}");
        };
        has("0.00  No", &["negation", "shake: stroke at 0.1"]);
        has("not bad", &["nothing", "the class has none"]);
        has("Hello", &["greeting", "wave: stroke"]);
        assert!(!lines.iter().any(|line| line.contains("table")));
    }
}
