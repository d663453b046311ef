//! Sentences whose words have an expected class (`tests/sentences`), written before the rules. Every fourth was set
//! aside, and no rule was made or changed for it.
//!
//! `cargo test --release -p umo-core-words --test sentences -- --nocapture` prints the shares.

use std::collections::BTreeMap;

use umo_core_words::{WordRules, spoken};

/// Of a class: expected words, and those of them that got it.
type Shares = BTreeMap<String, (usize, usize)>;

#[derive(Default)]
struct Score {
    classes: Shares,
    /// Words of no class, and those of them that a gesture would take.
    others: (usize, usize),
    wrong: Vec<String>,
}

impl Score {
    fn right(&self) -> (usize, usize) {
        self.classes.values().fold((0, 0), |sum, share| (sum.0 + share.0, sum.1 + share.1))
    }
}

/// A line's phrases: words in order, each with its class; `[a phrase]=class` or `word=class`.
fn expected(line: &str) -> Vec<(String, Option<String>)> {
    let mut words = Vec::new();
    let mut rest = line.trim();
    while !rest.is_empty() {
        let (phrase, after) = match rest.strip_prefix('[') {
            Some(inner) => inner.split_once(']').expect("a bracket that closes"),
            None => rest.split_at(rest.find(['=', ' ']).unwrap_or(rest.len())),
        };
        let (class, after) = match after.strip_prefix('=') {
            Some(tail) => {
                let (class, after) =
                    tail.split_at(tail.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(tail.len()));
                (Some(class.to_owned()), after)
            }
            None => (None, after),
        };
        words.extend(spoken(phrase).map(|word| (word.text.to_owned(), class.clone())));
        rest = after.trim_start_matches(|c: char| !c.is_alphanumeric() && c != '[' && c != '?');
    }
    words
}

/// The line as it is said.
fn said(line: &str) -> String {
    let mut parts = line.split('=');
    let mut text = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        text += part.trim_start_matches(|c: char| c.is_alphanumeric() || c == '_');
    }
    text.replace(['[', ']'], "")
}

fn score(language: &str, lines: &str, is_kept: bool) -> Score {
    let rules = WordRules::of(language).unwrap();
    let mut score = Score::default();
    for (_, line) in lines.lines().enumerate().filter(|(at, _)| (at % 4 == 3) == is_kept) {
        let (expected, text) = (expected(line), said(line));
        let found = rules.classify(&text);
        let found: Vec<(usize, Option<&str>)> = found
            .into_iter()
            .map(|(length, class)| (length, class.map(|class| &*class.name).filter(|name| *name != "nothing")))
            .collect();
        let said: usize = found.iter().map(|(length, _)| length).sum();
        assert_eq!(expected.len(), said, "{line}");
        let mut got: Vec<Option<&str>> = Vec::new();
        for (length, class) in found {
            let words = &expected[got.len()..got.len() + length];
            // A phrase is right if any of its words has its class; its other words are then no words of no class.
            let is_right = words.iter().any(|(_, wanted)| wanted.as_deref() == class && class.is_some());
            let others = words.iter().filter(|(_, wanted)| wanted.is_none()).count();
            score.others.0 += if is_right { 0 } else { others };
            if class.is_some() && others == length {
                score.others.1 += others;
                score.wrong.push(format!("{} taken for {class:?}: {text}", words[0].0));
            }
            got.extend(std::iter::repeat_n(class, length));
        }
        let mut at = 0;
        while at < expected.len() {
            let (word, Some(class)) = &expected[at] else {
                at += 1;
                continue;
            };
            // A phrase counts once: right if any of its words has the class.
            let length = expected[at..].iter().take_while(|(_, other)| other.as_ref() == Some(class)).count();
            let is_right = got[at..at + length].contains(&Some(&**class));
            let share = score.classes.entry(class.clone()).or_default();
            (share.0, share.1) = (share.0 + 1, share.1 + usize::from(is_right));
            if !is_right {
                score.wrong.push(format!("{word} is not {class} but {:?}: {text}", got[at]));
            }
            at += length;
        }
    }
    score
}

#[test]
fn words_get_the_class_that_was_expected_and_others_none() {
    for (language, lines) in [("en", include_str!("sentences/en.txt")), ("de", include_str!("sentences/de.txt"))] {
        for (is_kept, name, least, most) in [(false, "seen", 0.92, 0.04), (true, "kept out", 0.90, 0.10)] {
            let score = score(language, lines, is_kept);
            let (expected, right) = score.right();
            let (others, taken) = score.others;
            let (share, stray) = (right as f64 / expected as f64, taken as f64 / others as f64);
            println!("{language}, {name}: {right} of {expected} right, {taken} of {others} words of no class taken");
            for (class, (expected, right)) in &score.classes {
                println!("  {class:<12} {right} of {expected}");
            }
            for line in score.wrong.iter().filter(|_| !is_kept) {
                println!("  {line}");
            }
            assert!(share >= least && stray <= most, "{language}, {name}: {share:.3} right, {stray:.3} taken");
        }
    }
}
