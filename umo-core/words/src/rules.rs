//! Rules as data: TOML with classes of words, stems and phrases, and each class's gestures.

use std::collections::BTreeMap;
use std::fmt;
use std::sync::{Arc, OnceLock};

use serde::Deserialize;
use umo_core_base::state::Fingerprint;

use crate::text::{MAX_BYTES, Normal, Sound, spoken};

/// Upper bound on the classes of a set of rules.
pub const MAX_CLASSES: usize = 64;
/// Longest phrase, words.
pub(crate) const MAX_PHRASE: usize = 6;
/// Longest time between two gestures, seconds.
const MAX_GAP: f64 = 600.0;
/// Longest time that a hand waits for the next word of its class, seconds.
const MAX_HOLD: f64 = 3.0;
/// Token of a word that no rule names, and the one that stands for any word.
pub(crate) const UNKNOWN: u32 = 0;
const ANY: u32 = u32::MAX;

/// A file of rules that cannot be used. The text says what to change.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RulesError(String);

impl fmt::Display for RulesError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for RulesError {}

/// Hand of a gesture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Hand {
    /// The right hand, or as the gesture says.
    #[default]
    Auto,
    /// The left hand.
    Left,
    /// The right hand.
    Right,
    /// Both hands.
    Both,
    /// The left or the right hand, by chance.
    Either,
}

/// A gesture of a class.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClassGesture {
    /// Name of the gesture.
    pub name: String,
    /// How often it is taken, relative to the class's others.
    #[serde(default = "one")]
    pub weight: f32,
    /// Strength, 0 to 1.
    #[serde(default = "one")]
    pub strength: f32,
    /// Speed, 0.5 to 2.
    #[serde(default = "one")]
    pub speed: f32,
    /// Hand.
    #[serde(default)]
    pub side: Hand,
}

fn one() -> f32 {
    1.0
}

/// A class of words.
#[derive(Clone, Debug, PartialEq)]
pub struct Class {
    /// Name.
    pub name: String,
    /// Whether its gestures are the head's, whose gap is its own.
    pub is_head: bool,
    /// Least time between two strokes of this class, seconds.
    pub gap: f64,
    /// Share of the class's words that are gestured, 0 to 1.
    pub chance: f32,
    /// How long the hand waits for the next word of the class, seconds; 0 for classes whose gestures have one stroke.
    pub hold: f64,
    /// Gestures; none if the words mean nothing that could be shown.
    pub gestures: Vec<ClassGesture>,
}

/// A file.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    language: Option<String>,
    gap: Option<f64>,
    unstressed: Option<Vec<String>>,
    silent_final_e: Option<bool>,
    #[serde(default)]
    class: BTreeMap<String, ClassFile>,
}

/// A class of a file.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct ClassFile {
    head: Option<bool>,
    gap: Option<f64>,
    chance: Option<f32>,
    hold: Option<f64>,
    #[serde(default)]
    words: Vec<String>,
    gestures: Option<Vec<ClassGesture>>,
}

/// A word or a stem that some phrase has.
#[derive(Clone, Debug)]
struct Pattern {
    text: String,
    is_stem: bool,
    /// Token of the longest stem that matches every word that this one matches, or [`UNKNOWN`].
    parent: u32,
}

/// Beginnings of phrases with the same words.
#[derive(Clone, Debug, Default)]
struct Node {
    /// Class of the phrase that ends here, and the number of its stressed word.
    end: Option<(u16, u8)>,
    /// Next word's token, and the node after it; sorted.
    next: Vec<(u32, u32)>,
}

/// Rules of a language. A clone is cheap and shares them.
#[derive(Clone, Debug)]
pub struct WordRules(Arc<Compiled>);

#[derive(Debug)]
struct Compiled {
    file: File,
    language: String,
    gap: f64,
    unstressed: Vec<String>,
    silent_e: bool,
    classes: Vec<Class>,
    /// Sorted by text; a token is the number of its pattern and 1.
    patterns: Vec<Pattern>,
    nodes: Vec<Node>,
    fingerprint: u64,
}

/// The longest phrase that begins at a word.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Match {
    pub(crate) class: u16,
    /// Words of the phrase.
    pub(crate) length: usize,
    /// Number of the stressed one.
    pub(crate) stressed: usize,
}

impl WordRules {
    /// Rules of English.
    pub fn english() -> Self {
        static RULES: OnceLock<WordRules> = OnceLock::new();
        RULES.get_or_init(|| Self::own(include_str!("../rules/en.toml"))).clone()
    }

    /// Rules of German.
    pub fn german() -> Self {
        static RULES: OnceLock<WordRules> = OnceLock::new();
        RULES.get_or_init(|| Self::own(include_str!("../rules/de.toml"))).clone()
    }

    fn own(text: &str) -> Self {
        Self::parse(text).expect("rules of this library are tested")
    }

    /// Languages with rules of this library, as [`Self::of`] takes them.
    pub const LANGUAGES: [&'static str; 2] = ["en", "de"];

    /// Rules of a language by its code (`en`, `de-AT`), if this library has some.
    pub fn of(language: &str) -> Option<Self> {
        let code = language.split(['-', '_']).next().unwrap_or_default();
        match code {
            _ if code.eq_ignore_ascii_case("en") => Some(Self::english()),
            _ if code.eq_ignore_ascii_case("de") => Some(Self::german()),
            _ => None,
        }
    }

    /// Reads rules from TOML.
    ///
    /// # Errors
    /// [`RulesError`] if the text is not TOML of this form, or a value is out of range.
    pub fn parse(toml: &str) -> Result<Self, RulesError> {
        compile(read(toml)?)
    }

    /// These rules and those of a file: its words join the class of their name or make a new one, a phrase that both
    /// have is the file's, and what the file sets of a class (`gestures`, `gap`, `chance`, `hold`, `head`) replaces what was.
    ///
    /// # Errors
    /// As [`Self::parse`].
    pub fn with(&self, toml: &str) -> Result<Self, RulesError> {
        let (mut file, more) = (self.0.file.clone(), read(toml)?);
        for phrase in more.class.values().flat_map(|class| &class.words).map(|phrase| plain(phrase)) {
            file.class.values_mut().for_each(|class| class.words.retain(|known| plain(known) != phrase));
        }
        for (name, new) in more.class {
            let class = file.class.entry(name).or_default();
            class.words.extend(new.words);
            class.head = new.head.or(class.head);
            class.gap = new.gap.or(class.gap);
            class.chance = new.chance.or(class.chance);
            class.hold = new.hold.or(class.hold);
            class.gestures = new.gestures.or(class.gestures.take());
        }
        file.language = more.language.or(file.language);
        file.gap = more.gap.or(file.gap);
        file.silent_final_e = more.silent_final_e.or(file.silent_final_e);
        file.unstressed.get_or_insert_default().extend(more.unstressed.unwrap_or_default());
        compile(file)
    }

    /// Code of the language; empty if the file has none.
    pub fn language(&self) -> &str {
        &self.0.language
    }

    #[doc(hidden)]
    /// Classes in alphabetical order.
    pub fn classes(&self) -> &[Class] {
        &self.0.classes
    }

    #[doc(hidden)]
    /// Least time between two strokes of the hands, and of the head, seconds.
    pub fn gap(&self) -> f64 {
        self.0.gap
    }

    #[doc(hidden)]
    /// Number of words, stems and phrases.
    pub fn phrases(&self) -> usize {
        self.0.nodes.iter().filter(|node| node.end.is_some()).count()
    }

    #[doc(hidden)]
    /// First class with a gesture that `knows` does not know, and that gesture's name.
    pub fn unknown_gesture(&self, knows: impl Fn(&str) -> bool) -> Option<(&str, &str)> {
        let all = self.0.classes.iter().flat_map(|class| class.gestures.iter().map(|it| (&*class.name, &*it.name)));
        all.into_iter().find(|(_, gesture)| !knows(gesture))
    }

    #[doc(hidden)]
    /// Hash that distinguishes these rules from others.
    pub fn fingerprint(&self) -> u64 {
        self.0.fingerprint
    }

    #[doc(hidden)]
    /// Number of syllables of a word.
    pub fn syllables(&self, word: &str) -> u32 {
        self.sound(Normal::new(word).as_str()).syllables
    }

    pub(crate) fn sound(&self, word: &str) -> Sound {
        Sound::new(word, &self.0.unstressed, self.0.silent_e)
    }

    /// The token of a word in lower case: of the word itself, or of the longest stem that it begins with.
    pub(crate) fn token(&self, word: &str) -> u32 {
        token(&self.0.patterns, word)
    }

    /// The longest phrase at the beginning of these words.
    pub(crate) fn find(&self, words: &[u32]) -> Option<Match> {
        let mut best = None;
        self.walk(0, words, 0, &mut best);
        best
    }

    fn walk(&self, node: usize, words: &[u32], length: usize, best: &mut Option<Match>) {
        let Node { end, next } = &self.0.nodes[node];
        if let &Some((class, stressed)) = end
            && best.is_none_or(|best| best.length < length)
        {
            *best = Some(Match { class, length, stressed: stressed.into() });
        }
        let Some(&word) = words.get(length) else { return };
        let mut token = word;
        loop {
            // After the word itself its stems, then what stands for any word.
            let wanted = if token == UNKNOWN { ANY } else { token };
            if let Ok(at) = next.binary_search_by_key(&wanted, |edge| edge.0) {
                self.walk(next[at].1 as usize, words, length + 1, best);
            }
            // Only a forged state has a token beyond the patterns.
            let pattern = token.checked_sub(1).and_then(|pattern| self.0.patterns.get(pattern as usize));
            let Some(pattern) = pattern else { return };
            token = pattern.parent;
        }
    }

    #[doc(hidden)]
    /// Classes of a text's words in order, each with its phrase's number of words; `None` for words of no class.
    pub fn classify(&self, text: &str) -> Vec<(usize, Option<&Class>)> {
        let words: Vec<_> = spoken(text).collect();
        let tokens: Vec<u32> = words.iter().map(|word| self.token(Normal::new(word.text).as_str())).collect();
        let (mut at, mut classes) = (0, Vec::new());
        while at < words.len() {
            let most = (at + MAX_PHRASE).min(words.len());
            let end = words[at..most].iter().position(|word| word.is_end).map_or(most, |end| at + end + 1);
            let found = self.find(&tokens[at..end]);
            let length = found.map_or(1, |found| found.length);
            classes.push((length, found.map(|found| &self.0.classes[usize::from(found.class)])));
            at += length;
        }
        classes
    }
}

impl Default for WordRules {
    fn default() -> Self {
        Self::english()
    }
}

fn read(toml: &str) -> Result<File, RulesError> {
    toml::from_str(toml).map_err(|error| RulesError(error.to_string().trim_end().to_owned()))
}

/// A phrase without its mark of stress, in lower case.
fn plain(phrase: &str) -> String {
    let words = phrase.split_whitespace().map(|word| word.strip_prefix('^').unwrap_or(word).to_lowercase());
    words.collect::<Vec<_>>().join(" ")
}

#[expect(clippy::cast_possible_truncation, reason = "a file of rules has fewer words")]
fn number(at: usize) -> u32 {
    at as u32
}

fn token(patterns: &[Pattern], word: &str) -> u32 {
    let find = |text: &str, is_stem: bool| {
        patterns.binary_search_by(|it| (&*it.text, it.is_stem).cmp(&(text, is_stem))).ok().map(|at| number(at) + 1)
    };
    let stems = || word.char_indices().rev().map(|(at, c)| at + c.len_utf8()).find_map(|end| find(&word[..end], true));
    find(word, false).or_else(stems).unwrap_or(UNKNOWN)
}

fn compile(file: File) -> Result<WordRules, RulesError> {
    let gap = file.gap.unwrap_or(1.6);
    if !(0.0..=MAX_GAP).contains(&gap) {
        return Err(RulesError(format!("gap: expected 0 to {MAX_GAP} seconds, got {gap}")));
    }
    if file.class.len() > MAX_CLASSES {
        return Err(RulesError(format!("expected at most {MAX_CLASSES} classes, got {}", file.class.len())));
    }
    let classes = file.class.iter().map(|(name, class)| checked(name, class)).collect::<Result<Vec<_>, _>>()?;
    let mut phrases = BTreeMap::new();
    for (number, (name, class)) in (0_u16..).zip(&file.class) {
        for phrase in &class.words {
            let wrong = |problem: &str| RulesError(format!("class {name}: `{phrase}`: {problem}"));
            let words = words_of(phrase).map_err(wrong)?;
            let stressed = phrase.split_whitespace().position(|word| word.starts_with('^')).unwrap_or(words.len() - 1);
            let stressed = u8::try_from(stressed).unwrap_or(0);
            if let Some((other, _)) = phrases.insert(words, (number, stressed)) {
                let other = &classes[usize::from(other)].name;
                return Err(wrong(&format!("class {other} has it already; leave it in one")));
            }
        }
    }
    let patterns = patterns(phrases.keys().flatten());
    let nodes = nodes(&patterns, &phrases);
    let mut sum = Fingerprint::new();
    sum.add(format!("{file:?}").as_bytes());
    Ok(WordRules(Arc::new(Compiled {
        language: file.language.clone().unwrap_or_default(),
        gap,
        unstressed: file.unstressed.clone().unwrap_or_default(),
        silent_e: file.silent_final_e.unwrap_or(false),
        file,
        classes,
        patterns,
        nodes,
        fingerprint: sum.0,
    })))
}

fn checked(name: &str, class: &ClassFile) -> Result<Class, RulesError> {
    let wrong = |problem: String| Err(RulesError(format!("class {name}: {problem}")));
    let (gap, chance) = (class.gap.unwrap_or(4.0), class.chance.unwrap_or(1.0));
    if !(0.0..=MAX_GAP).contains(&gap) {
        return wrong(format!("gap: expected 0 to {MAX_GAP} seconds, got {gap}"));
    }
    if !(0.0..=1.0).contains(&chance) {
        return wrong(format!("chance: expected 0 to 1, got {chance}"));
    }
    let hold = class.hold.unwrap_or(0.0);
    if !(0.0..=MAX_HOLD).contains(&hold) {
        return wrong(format!("hold: expected 0 to {MAX_HOLD} seconds, got {hold}"));
    }
    let gestures = class.gestures.clone().unwrap_or_default();
    if gestures.len() > usize::from(u8::MAX) {
        return wrong("expected at most 255 gestures".to_owned());
    }
    for ClassGesture { name, weight, strength, speed, .. } in &gestures {
        let is_weight = *weight > 0.0 && *weight <= 1000.0;
        if !(is_weight && (0.0..=1.0).contains(strength) && (0.5..=2.0).contains(speed)) {
            let wanted = "expected a weight of more than 0 to 1000, a strength of 0 to 1 and a speed of 0.5 to 2";
            return wrong(format!("gesture {name}: {wanted}"));
        }
    }
    Ok(Class { name: name.to_owned(), is_head: class.head.unwrap_or(false), gap, chance, hold, gestures })
}

/// Words of a phrase as patterns: stems end in `*`, `_` is any word.
fn words_of(phrase: &str) -> Result<Vec<String>, &'static str> {
    let words: Vec<String> = plain(phrase).split(' ').map(str::to_owned).collect();
    let bodies = || words.iter().map(|word| word.strip_suffix('*').unwrap_or(word));
    if words == [""] {
        return Err("a phrase needs a word");
    }
    if words.len() > MAX_PHRASE {
        return Err("a phrase has six words at most");
    }
    if phrase.split_whitespace().filter(|word| word.starts_with('^')).count() > 1 {
        return Err("a phrase has one stress, `^`, at most");
    }
    if words.iter().all(|word| word == "_") {
        return Err("a phrase needs a word besides `_`");
    }
    if bodies().any(|word| word.len() > MAX_BYTES) {
        return Err("a word has 48 bytes at most");
    }
    // As a text's words are: one could never be said otherwise.
    let is_said = |word: &str| word == "_" || !word.contains(['*', '^']) && spoken(word).map(|it| it.text).eq([word]);
    if !bodies().all(is_said) {
        return Err("a word has letters, digits and apostrophes, a stem ends in `*`, and blanks separate words");
    }
    Ok(words)
}

/// Every word and stem of phrases, sorted.
fn patterns<'a>(words: impl Iterator<Item = &'a String>) -> Vec<Pattern> {
    let mut patterns: Vec<Pattern> = words
        .filter(|word| *word != "_")
        .map(|word| {
            let stem = word.strip_suffix('*');
            Pattern { text: stem.unwrap_or(word).to_owned(), is_stem: stem.is_some(), parent: UNKNOWN }
        })
        .collect();
    let key = |pattern: &Pattern| (pattern.text.clone(), pattern.is_stem);
    patterns.sort_by_key(key);
    patterns.dedup_by_key(|pattern| key(pattern));
    for at in 0..patterns.len() {
        let Pattern { text, is_stem, .. } = &patterns[at];
        let ends = text.char_indices().map(|(at, _)| at).chain((!is_stem).then_some(text.len()));
        let mut stems = ends.filter_map(|end| {
            let wanted = (&text[..end], true);
            patterns.binary_search_by(|it| (&*it.text, it.is_stem).cmp(&wanted)).ok()
        });
        patterns[at].parent = stems.next_back().map_or(UNKNOWN, |stem| number(stem) + 1);
    }
    patterns
}

/// Phrases as a tree; node 0 is its root.
fn nodes(patterns: &[Pattern], phrases: &BTreeMap<Vec<String>, (u16, u8)>) -> Vec<Node> {
    let mut nodes = vec![Node::default()];
    for (words, &end) in phrases {
        let mut node = 0;
        for word in words {
            let stem = word.strip_suffix('*');
            let wanted = (stem.unwrap_or(word), stem.is_some());
            let token = match patterns.binary_search_by(|it| (&*it.text, it.is_stem).cmp(&wanted)) {
                Ok(at) => number(at) + 1,
                Err(_) => ANY,
            };
            node = match nodes[node].next.binary_search_by_key(&token, |edge| edge.0) {
                Ok(at) => nodes[node].next[at].1 as usize,
                Err(at) => {
                    let new = nodes.len();
                    nodes[node].next.insert(at, (token, number(new)));
                    nodes.push(Node::default());
                    new
                }
            };
        }
        nodes[node].end = Some(end);
    }
    nodes
}

#[cfg(test)]
mod tests {
    use super::*;

    const RULES: &str = r#"
        [class.small]
        words = ["small", "tin*", "a little bit"]
        gestures = [{ name = "size_small" }]
        [class.negation]
        head = true
        words = ["no", "not", "no ^way at all"]
        gestures = [{ name = "shake" }]
        [class.nothing]
        words = ["not _ bad*", "tinned", "no problem"]
    "#;

    fn classes<'a>(rules: &'a WordRules, text: &str) -> Vec<(usize, Option<&'a str>)> {
        rules.classify(text).into_iter().map(|(length, class)| (length, class.map(|class| &*class.name))).collect()
    }

    #[test]
    fn the_longest_phrase_counts_and_a_word_before_its_stem() {
        let rules = WordRules::parse(RULES).unwrap();
        let (small, negation, nothing) = (Some("small"), Some("negation"), Some("nothing"));
        assert_eq!(classes(&rules, "Small table"), [(1, small), (1, None)]);
        assert_eq!(classes(&rules, "TINY tinned tin"), [(1, small), (1, nothing), (1, small)]);
        assert_eq!(classes(&rules, "no way at all"), [(4, negation)]);
        // A phrase counts only in full.
        assert_eq!(
            classes(&rules, "no way at home a little"),
            [(1, negation), (1, None), (1, None), (1, None), (1, None), (1, None)]
        );
        assert_eq!(classes(&rules, "not that badly, no problem"), [(3, nothing), (2, nothing)]);
        // A known word as any word, and punctuation that ends a phrase.
        assert_eq!(classes(&rules, "not small bad"), [(3, nothing)]);
        assert_eq!(classes(&rules, "no. Problem"), [(1, negation), (1, None)]);
        assert_eq!(classes(&rules, ""), []);
    }

    #[test]
    fn the_stress_is_where_it_is_marked_or_at_the_end() {
        let rules = WordRules::parse(RULES).unwrap();
        let stressed = |text: &str| {
            let tokens: Vec<u32> = text.split(' ').map(|word| rules.token(word)).collect();
            rules.find(&tokens).unwrap().stressed
        };
        assert_eq!([stressed("no way at all"), stressed("a little bit"), stressed("no")], [1, 2, 0]);
    }

    #[test]
    fn a_host_adds_words_moves_phrases_and_replaces_gestures() {
        let rules = WordRules::parse(RULES).unwrap();
        let more = "[class.negation]\nwords = ['no problem', 'nix']\n[class.small]\ngestures = []\n[class.own]\nwords = ['umo']";
        let both = rules.with(more).unwrap();
        assert_eq!(classes(&both, "umo nix tiny"), [(1, Some("own")), (1, Some("negation")), (1, Some("small"))]);
        assert_eq!(classes(&both, "no problem"), [(2, Some("negation"))]);
        let small = both.classes().iter().find(|class| class.name == "small").unwrap();
        assert!(small.gestures.is_empty());
        assert_ne!(both.fingerprint(), rules.fingerprint());
        assert_eq!(rules.unknown_gesture(|name| name == "shake"), Some(("small", "size_small")));
        assert_eq!(rules.unknown_gesture(|_| true), None);
    }

    #[test]
    fn errors_say_what_to_change() {
        for (toml, wanted) in [
            ("gap = -1", "gap: expected 0 to 600"),
            ("[class.a]\nwords = ['x*y']", "class a: `x*y`"),
            ("[class.a]\nwords = ['']", "needs a word"),
            ("[class.a]\nwords = ['_ _']", "besides `_`"),
            ("[class.a]\nwords = ['a b c d e f g']", "six words"),
            ("[class.a]\nwords = ['^a ^b']", "one stress"),
            ("[class.a]\nwords = ['b']\n[class.c]\nwords = ['B']", "class c: `B`: class a has it already"),
            ("[class.a]\nchance = 2", "class a: chance"),
            ("[class.a]\ngestures = [{ name = 'x', speed = 3 }]", "gesture x"),
            ("[class.a]\ngesture = 1", "line 2"),
            ("[class", "line 1"),
        ] {
            let problem = WordRules::parse(toml).unwrap_err().to_string();
            assert!(problem.contains(wanted), "{toml}: {problem}");
        }
    }

    #[test]
    fn rules_of_this_library_are_whole() {
        for language in WordRules::LANGUAGES {
            let rules = WordRules::of(language).unwrap();
            assert_eq!(rules.language(), language);
            assert!(rules.phrases() >= 300 && rules.classes().len() > 30, "{language}: {}", rules.phrases());
        }
        assert!(WordRules::of("de-AT").is_some() && WordRules::of("fr").is_none());
    }
}
