//! Gestures by name: the built-in ones and the host's own.

use std::sync::Arc;

use umo_core_base::error::LoadError;
use umo_core_base::state::Fingerprint;

use super::clip::Gesture;
use super::table::MOTIONS;

/// Upper bound on the gestures that a host may add.
pub const MAX_GESTURES: usize = 256;
/// Longest name of a gesture, bytes.
const MAX_NAME: usize = 64;
/// Names that are too common in a text to ask for the gesture.
const COMMON: [&str; 14] =
    ["up", "down", "here", "there", "you", "we", "us", "all", "list", "past", "future", "see", "come", "huge"];

/// Parts of a body that a gesture moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GestureParts(u32);

impl GestureParts {
    /// Neck and head.
    pub const HEAD: Self = Self(1);
    /// Spine.
    pub const TRUNK: Self = Self(2);
    /// From the left collar to the fingers.
    pub const LEFT_ARM: Self = Self(4);
    /// From the right collar to the fingers.
    pub const RIGHT_ARM: Self = Self(8);
    /// Every part.
    pub const ALL: Self = Self(15);

    /// Converts from the number of [`Self::bits`]; `None` if other bits are set.
    pub const fn from_bits(bits: u32) -> Option<Self> {
        if bits & !Self::ALL.0 == 0 { Some(Self(bits)) } else { None }
    }

    /// Converts to a number: 1 for the head, 2 for the trunk, 4 for the left arm, 8 for the right arm.
    pub const fn bits(self) -> u32 {
        self.0
    }

    /// Union of both.
    #[must_use]
    pub const fn union(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Whether these include every part of `other`.
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    pub(super) const NONE: Self = Self(0);

    pub(super) const fn meets(self, other: Self) -> bool {
        self.0 & other.0 != 0
    }

    pub(super) const fn mirrored(self) -> Self {
        Self(self.0 & 3 | (self.0 & 4) << 1 | (self.0 & 8) >> 1)
    }
}

/// Gestures that an avatar knows: the built-in ones and those that the host added. A clone is cheap and
/// shares them.
#[derive(Clone, Debug, Default)]
pub struct Gestures {
    added: Arc<Vec<Arc<Gesture>>>,
}

impl Gestures {
    /// Creates the set of built-in gestures.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a gesture of the host's own. It replaces one of the same name, even a built-in one. Existing
    /// avatars keep their set. Returns whether the name is new.
    ///
    /// # Errors
    /// [`LoadError::Argument`] if there would be more than [`MAX_GESTURES`].
    pub fn add(&mut self, gesture: Gesture) -> Result<bool, LoadError> {
        let is_new = self.find(gesture.name()).is_none();
        let added = Arc::make_mut(&mut self.added);
        match added.iter().position(|known| known.name() == gesture.name()) {
            Some(known) => added[known] = Arc::new(gesture),
            None if added.len() >= MAX_GESTURES => {
                return Err(LoadError::argument("gestures", format!("a host may add {MAX_GESTURES} gestures at most")));
            }
            None => added.push(Arc::new(gesture)),
        }
        Ok(is_new)
    }

    /// Each name once: built-in gestures in the table's order, then the host's.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        let added = self.added.iter().map(|gesture| gesture.name());
        let first = |name: &str| MOTIONS.iter().position(|motion| motion.name == name);
        let built_in = MOTIONS.iter().map(|motion| motion.name).enumerate();
        let built_in = built_in.filter(move |(at, name)| first(name) == Some(*at)).map(|(_, name)| name);
        built_in.chain(added.filter(move |name| first(name).is_none()))
    }

    /// Number of poses of a gesture, through which its variants go in turn; 0 if the name is unknown.
    pub fn poses(&self, name: &str) -> usize {
        self.find(name).map_or(0, |number| poses(number).count().max(1))
    }

    /// Synonyms of a gesture, which are accepted wherever its name is.
    pub fn other_names(&self, name: &str) -> impl Iterator<Item = &'static str> {
        let motion = MOTIONS.iter().find(|motion| motion.name == name);
        motion.map_or(&[][..], |motion| motion.words).iter().copied()
    }

    /// Time from a gesture's start to its stroke at speed 1, seconds; `None` if the name is unknown.
    pub fn stroke(&self, name: &str) -> Option<f64> {
        let number = self.find(name)? as usize;
        let built_in = || MOTIONS.get(number).map(|motion| motion.preparation + motion.stroke);
        self.added(number).map(Gesture::stroke).or_else(built_in).map(f64::from)
    }

    /// Returns the name of the gesture that a text mentions, such as `wave` for "a person waves". Searches
    /// names and synonyms; the longest match counts. `None` if the text mentions no gesture.
    pub fn in_text(&self, text: &str) -> Option<&str> {
        let text = format!("_{}_", normal(text));
        let added = self.added.iter().map(|gesture| (gesture.name(), gesture.name()));
        let built_in = MOTIONS.iter().flat_map(|m| m.words.iter().chain([&m.name]).map(|word| (m.name, *word)));
        let said = |word: &str| !COMMON.contains(&word) && text.contains(&format!("_{}_", normal(word)));
        let found = built_in.chain(added).filter(|(_, word)| said(word));
        found.max_by_key(|(_, word)| word.len()).map(|(name, _)| name)
    }

    /// Returns the number of a named gesture. ASCII case is ignored, and spaces and hyphens count as
    /// underscores.
    pub(crate) fn find(&self, name: &str) -> Option<u32> {
        let is = |known: &str| is_same_name(known, name);
        let added = self.added.iter().position(|gesture| is(gesture.name())).map(|at| MOTIONS.len() + at);
        let named = || MOTIONS.iter().position(|motion| is(motion.name));
        let meant = || MOTIONS.iter().position(|motion| motion.words.iter().any(|word| is(word)));
        let found = added.or_else(named).or_else(meant)?;
        u32::try_from(found).ok()
    }

    /// Returns the number of a variant's pose: the gesture itself, or another motion of its name.
    pub(super) fn pose(&self, gesture: u32, variant: u8) -> u32 {
        let count = poses(gesture).count().max(1);
        poses(gesture).nth(usize::from(variant) % count).unwrap_or(gesture)
    }

    /// Returns one of the host's own gestures by its number.
    pub(super) fn added(&self, number: usize) -> Option<&Gesture> {
        self.added.get(number.checked_sub(MOTIONS.len())?).map(|gesture| &**gesture)
    }

    /// Hash that distinguishes this set from others.
    pub(crate) fn fingerprint(&self) -> u64 {
        let mut sum = Fingerprint::new();
        MOTIONS.iter().for_each(|motion| sum.add(motion.name.as_bytes()));
        self.added.iter().for_each(|gesture| gesture.add_to(&mut sum));
        sum.0
    }
}

/// Numbers of the motions of a built-in gesture's name; none for a host's gesture.
fn poses(gesture: u32) -> impl Iterator<Item = u32> {
    let name = MOTIONS.get(gesture as usize).map(|motion| motion.name);
    (0..).zip(&MOTIONS).filter(move |(_, motion)| Some(motion.name) == name).map(|(number, _)| number)
}

/// Rejects names that could not be given on a command line.
pub(super) fn check_name(name: &str) -> Result<(), LoadError> {
    let is_good = |c: char| c.is_alphanumeric() || c == '_' || c == '-' || c == ' ';
    if (1..=MAX_NAME).contains(&name.len()) && name.chars().all(is_good) {
        return Ok(());
    }
    let problem = format!("expected 1 to {MAX_NAME} bytes of letters, digits, _, - and spaces, got {name:?}");
    Err(LoadError::argument("gesture's name", problem))
}

fn plain(c: char) -> char {
    if c == ' ' || c == '-' { '_' } else { c.to_ascii_lowercase() }
}

fn is_same_name(a: &str, b: &str) -> bool {
    a.chars().map(plain).eq(b.chars().map(plain))
}

/// Returns a text's words in lower case, joined by underscores.
fn normal(text: &str) -> String {
    let words = text.split(|c: char| !c.is_alphanumeric()).filter(|word| !word.is_empty());
    words.collect::<Vec<_>>().join("_").to_lowercase()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gestures_are_found_by_names_and_in_texts() {
        let set = Gestures::new();
        let name = |text: &str| set.find(text).and_then(|at| MOTIONS.get(at as usize)).map(|motion| motion.name);
        assert_eq!(name("wave"), Some("wave"));
        assert_eq!(name("Thumbs-Up"), Some("thumbs_up"));
        assert_eq!(name("yes"), Some("nod"));
        assert_eq!(name("no"), Some("shake"));
        assert_eq!(name("come"), Some("beckon"));
        assert_eq!(name("there"), Some("there"));
        assert_eq!(name("sing"), None);
        assert!(set.names().count() >= 40);
        assert_eq!(name(""), None);
        for (text, wanted) in [
            ("wave", Some("wave")),
            ("A person waves, then stands.", Some("wave")),
            ("someone shakes his head", Some("shake")),
            ("count to five", Some("count")),
            ("gives a thumbs up!", Some("thumbs_up")),
            ("walks around", None),
            ("a waveform", None),
            ("walks up there and sits down", None),
            ("someone drinks", Some("drink")),
            ("", None),
        ] {
            assert_eq!(set.in_text(text), wanted, "{text}");
        }
    }

    #[test]
    fn parts_are_numbers_and_mirror() {
        let arms = GestureParts::LEFT_ARM.union(GestureParts::HEAD);
        assert_eq!(GestureParts::from_bits(arms.bits()), Some(arms));
        assert_eq!(GestureParts::from_bits(16), None);
        assert_eq!(arms.mirrored(), GestureParts::RIGHT_ARM.union(GestureParts::HEAD));
        assert!(arms.contains(GestureParts::HEAD) && !arms.contains(GestureParts::ALL));
    }
}
