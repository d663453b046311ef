//! Maps face channels to a character's blendshapes.
//!
//! Shapes are found by name. ARKit's names match in any spelling (`jawOpen`, `JawOpen`, `Head.jaw_open`,
//! `eyeBlink_L`, `BROW-Left-Down`), as do other programs' names of the same shapes (`synonyms`). A shape that covers
//! both sides follows the mean of the two channels, if the sides have no shapes. Characters without ARKit shapes may
//! have the visemes of the Oculus set, VRM's five vowels, or one shape that opens the mouth, and blinks; these are
//! computed from the ARKit channels. The vowels are the corners of a cube of three numbers, 0 to 1: jaw opening
//! (`o`), lip rounding (`r`) and lip width (`w`):
//!
//! ```text
//! aa = o (1-r) (1-w)   ee = o (1-r) w   oh = o r   ou = (1-o) r   ih = (1-o) (1-r) w, only with the jaw slightly open
//! ```

mod synonyms;

use umo_core_pose::face::{Face, FaceKind};
use umo_core_pose::visemes::{VISEME_NAMES, VISEMES, Visemes};

use super::names::words;

/// Value of `jawOpen` at which the jaw counts as open for a vowel.
const OPEN: f32 = 0.7;
/// Value of `mouthFunnel` or `mouthPucker` at which the lips count as round.
const ROUND: f32 = 0.7;
/// Mean of `mouthSmile` and `mouthStretch` over both sides at which the lips count as wide.
const WIDE: f32 = 0.5;

/// VRM's vowels, names of 1.0 and 0.x, in the order of [`Vowels::weights`].
const VOWELS: [&[&str]; 5] = [&["aa", "a"], &["ih", "i"], &["ou", "u"], &["ee", "e"], &["oh", "o"]];

/// Visemes of the Oculus set for the same vowels.
const VISEMES_OF_VOWELS: [&str; 5] = ["aa", "ih", "ou", "E", "oh"];

/// Names of a single shape that opens the mouth.
const OPENS: [&str; 4] = ["mouthopen", "jawdown", "jawdrop", "openmouth"];

/// Names of a shape that closes both lids.
const BLINKS: [&str; 4] = ["blink", "eyesclosed", "eyesclose", "eyeclose"];

/// The words for left and right.
const SIDES: [&str; 2] = ["left", "right"];

/// Source of a shape's weight.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Cause {
    /// A channel and its gain.
    Channel(usize, f32),
    /// The mean of two channels.
    Mean(usize, usize),
    Viseme(usize),
    Vowel(usize),
    /// Mouth opening: the jaw's channel less the lips', over [`OPEN`]. Such a shape shows a speaking mouth, not a
    /// gaping one.
    Open {
        jaw: usize,
        close: usize,
    },
}

/// Channels from which vowels are computed.
#[derive(Clone, Copy, Debug)]
struct Vowels {
    jaw: usize,
    close: usize,
    round: [usize; 2],
    wide: [usize; 4],
}

impl Vowels {
    fn find(face: &Face) -> Option<Self> {
        let find = |name: &str| face.names.iter().position(|known| known == name);
        Some(Self {
            jaw: find("jawOpen")?,
            close: find("mouthClose")?,
            round: [find("mouthFunnel")?, find("mouthPucker")?],
            wide: [
                find("mouthSmileLeft")?,
                find("mouthSmileRight")?,
                find("mouthStretchLeft")?,
                find("mouthStretchRight")?,
            ],
        })
    }

    /// `[5]`, each 0 to 1, with a sum of at most 1.
    fn weights(&self, values: &[f32]) -> [f32; 5] {
        let share = |value: f32, full: f32| (value / full).clamp(0.0, 1.0);
        let o = share(values[self.jaw] - values[self.close], OPEN);
        let r = share(values[self.round[0]].max(values[self.round[1]]), ROUND);
        let w = share(0.5 * self.wide.iter().map(|&channel| values[channel]).sum::<f32>(), WIDE);
        // A closed smiling mouth must not count as speech.
        let apart = (4.0 * o).min(1.0);
        [o * (1.0 - r) * (1.0 - w), apart * (1.0 - o) * (1.0 - r) * w, (1.0 - o) * r, o * (1.0 - r) * w, o * r]
    }
}

/// Mapping from face channels to one list of shapes.
#[derive(Clone, Debug)]
pub struct FaceMap {
    shapes: usize,
    channels: usize,
    /// A shape occurs once per cause; causes add up.
    causes: Vec<(usize, Cause)>,
    visemes: Option<Visemes>,
    vowels: Option<Vowels>,
}

impl FaceMap {
    /// Finds the shapes for a face's channels by name. Only ARKit channels have names that characters use.
    pub fn new<S: AsRef<str>>(face: &Face, shapes: &[S]) -> Self {
        let mut map = Self {
            shapes: shapes.len(),
            channels: face.names.len(),
            causes: Vec::new(),
            visemes: Visemes::new(face),
            vowels: Vowels::find(face),
        };
        if face.kind != FaceKind::Arkit {
            return map;
        }
        let spelt: Vec<Spelling> = shapes.iter().map(|shape| Spelling::new(shape.as_ref())).collect();
        let channels: Vec<Spelling> = face.names.iter().map(|name| Spelling::new(name)).collect();
        let same = |shape: &Spelling, channel: &Spelling, name: &str| shape.ends_with(name) && shape.is_on(channel);
        for (at, channel) in channels.iter().enumerate() {
            let name = channel.words.concat();
            let mut found: Vec<_> = (0..spelt.len()).filter(|&shape| same(&spelt[shape], channel, &name)).collect();
            if found.is_empty() {
                let other = |shape: &Spelling| synonyms::of(&name).any(|other| same(shape, channel, other));
                found.extend((0..spelt.len()).filter(|&shape| other(&spelt[shape])));
            }
            map.causes.extend(found.into_iter().map(|shape| (shape, Cause::Channel(at, 1.0))));
        }
        map.add_means(&channels, &spelt);
        if !map.drives(face, "jawOpen") {
            map.add_visemes(&spelt);
        }
        map.add_blinks(face, &spelt);
        map
    }

    /// Maps shapes that cover both sides to the mean of two channels, if neither side has a shape.
    fn add_means(&mut self, channels: &[Spelling], spelt: &[Spelling]) {
        for (left, channel) in channels.iter().enumerate().filter(|(_, channel)| channel.side == Some(0)) {
            let is_other = |other: &Spelling| other.side == Some(1) && other.words == channel.words;
            let Some(right) = channels.iter().position(is_other) else { continue };
            let moves =
                |(_, cause): &(usize, Cause)| matches!(cause, Cause::Channel(at, _) if [left, right].contains(at));
            // `jawLeft` and `mouthLeft` are directions, not halves of a shape.
            if channel.words.len() < 2 || self.causes.iter().any(moves) {
                continue;
            }
            let name = channel.words.concat();
            let is_both = |shape: &Spelling| {
                let other = || synonyms::of(&name).filter(|other| !synonyms::need_side(other));
                shape.side.is_none() && (shape.ends_with(&name) || other().any(|other| shape.ends_with(other)))
            };
            let found = (0..spelt.len()).filter(|&shape| is_both(&spelt[shape]));
            self.causes.extend(found.map(|shape| (shape, Cause::Mean(left, right))));
        }
    }

    /// Maps the Oculus set if most of it is present, else the vowels of VRM or of that set, else a shape that opens
    /// the mouth.
    fn add_visemes(&mut self, spelt: &[Spelling]) {
        let marked = |shape: &Spelling, name: &str| {
            let text = shape.text();
            let rest = text.strip_suffix(&name.to_lowercase());
            rest.is_some_and(|rest| rest.ends_with("viseme") || rest.ends_with("vrcv"))
        };
        let place = |name: &str| {
            // Ready Player Me spells it `viseme_I`.
            let other = [("ih", "i"), ("oh", "o"), ("ou", "u")].into_iter().find(|(known, _)| *known == name);
            let names = std::iter::once(name).chain(other.map(|(_, other)| other));
            names.into_iter().find_map(|name| spelt.iter().position(|shape| marked(shape, name)))
        };
        let found: Vec<_> = VISEME_NAMES.iter().enumerate().filter_map(|(at, name)| Some((place(name)?, at))).collect();
        if self.visemes.is_some() && found.len() > VISEMES / 2 {
            self.causes.extend(found.into_iter().map(|(shape, viseme)| (shape, Cause::Viseme(viseme))));
            return;
        }
        let Some(vowels) = self.vowels else { return };
        let before = self.causes.len();
        for (vowel, names) in VOWELS.iter().enumerate() {
            let found = spelt.iter().position(|shape| names.contains(&shape.text().as_str()));
            let found = found.or_else(|| place(VISEMES_OF_VOWELS[vowel]));
            self.causes.extend(found.map(|shape| (shape, Cause::Vowel(vowel))));
        }
        if self.causes.len() == before {
            let opens = |name: &&str| spelt.iter().position(|shape| shape.side.is_none() && shape.ends_with(name));
            let open = Cause::Open { jaw: vowels.jaw, close: vowels.close };
            self.causes.extend(OPENS.iter().find_map(opens).map(|shape| (shape, open)));
        }
    }

    /// Maps a shape of both lids, if no single lid has a shape.
    fn add_blinks(&mut self, face: &Face, spelt: &[Spelling]) {
        let channel = |name: &str| face.names.iter().position(|known| known == name);
        let Some((left, right)) = channel("eyeBlinkLeft").zip(channel("eyeBlinkRight")) else { return };
        let moves = |(_, cause): &(usize, Cause)| matches!(cause, Cause::Channel(at, _) | Cause::Mean(at, _) if [left, right].contains(at));
        if self.causes.iter().any(moves) {
            return;
        }
        let shape = |name: &&str| spelt.iter().position(|shape| shape.text() == *name);
        self.causes.extend(BLINKS.iter().find_map(shape).map(|both| (both, Cause::Mean(left, right))));
    }

    /// Adds a cause: `shape` follows `gain` times a channel, besides its other causes. Returns whether both exist.
    pub fn link(&mut self, face: &Face, channel: &str, shape: usize, gain: f32) -> bool {
        let found = face.names.iter().position(|name| name == channel).filter(|_| shape < self.shapes);
        self.causes.extend(found.map(|channel| (shape, Cause::Channel(channel, gain))));
        found.is_some()
    }

    /// Removes all causes of a shape.
    pub fn release(&mut self, shape: usize) {
        self.causes.retain(|(at, _)| *at != shape);
    }

    /// Whether a shape follows this channel directly.
    pub fn drives(&self, face: &Face, channel: &str) -> bool {
        let is = |at: usize| face.names.get(at).is_some_and(|name| name == channel);
        self.causes.iter().any(|(_, cause)| matches!(cause, Cause::Channel(at, _) if is(*at)))
    }

    /// Whether any shape opens the mouth; if so, a jaw bone must not open it as well.
    pub fn opens_mouth(&self, face: &Face) -> bool {
        self.drives(face, "jawOpen") || !self.speaking().is_empty()
    }

    /// Shapes that replace `jawOpen`: visemes, vowels, or the one that opens the mouth.
    pub fn speaking(&self) -> Vec<usize> {
        let speaks = |cause: &Cause| matches!(cause, Cause::Viseme(_) | Cause::Vowel(_) | Cause::Open { .. });
        self.causes.iter().filter(|(_, cause)| speaks(cause)).map(|(shape, _)| *shape).collect()
    }

    /// The shape that opens the mouth, if no visemes or vowels do.
    pub fn plain_mouth(&self) -> Option<usize> {
        self.causes.iter().find(|(_, cause)| matches!(cause, Cause::Open { .. })).map(|(shape, _)| *shape)
    }

    /// Number of shapes, moved or not.
    pub fn shapes(&self) -> usize {
        self.shapes
    }

    /// Shapes that move, without duplicates, in ascending order.
    pub fn moved(&self) -> Vec<usize> {
        let mut moved: Vec<_> = self.causes.iter().map(|(shape, _)| *shape).collect();
        moved.sort_unstable();
        moved.dedup();
        moved
    }

    /// Describes the causes of a shape.
    pub fn cause(&self, face: &Face, shape: usize) -> String {
        let name = |at: usize| face.names.get(at).map_or("", String::as_str);
        let causes = self.causes.iter().filter(|(at, _)| *at == shape).map(|(_, cause)| match *cause {
            Cause::Channel(at, 1.0) => name(at).to_owned(),
            Cause::Channel(at, gain) => format!("{gain} {}", name(at)),
            Cause::Mean(left, right) => format!("mean of {} and {}", name(left), name(right)),
            Cause::Viseme(at) => format!("viseme {}", VISEME_NAMES[at]),
            Cause::Vowel(at) => format!("vowel {}", VOWELS[at][0]),
            Cause::Open { jaw, close } => format!("{} less {}, over {OPEN}", name(jaw), name(close)),
        });
        causes.collect::<Vec<_>>().join(" + ")
    }

    /// Writes the weights of the shapes that move, 0 to 1, and leaves the others unchanged. Does not allocate. Panics
    /// if there are fewer values than channels, or fewer weights than shapes.
    pub fn apply(&self, values: &[f32], weights: &mut [f32]) {
        let (values, weights) = (&values[..self.channels], &mut weights[..self.shapes]);
        let visemes = self.visemes.as_ref().map(|visemes| visemes.weights(values));
        let vowels = self.vowels.map(|vowels| vowels.weights(values));
        self.causes.iter().for_each(|(shape, _)| weights[*shape] = 0.0);
        for &(shape, cause) in &self.causes {
            let value = match cause {
                Cause::Channel(channel, gain) => gain * values[channel],
                Cause::Mean(left, right) => 0.5 * (values[left] + values[right]),
                Cause::Viseme(viseme) => visemes.map_or(0.0, |weights| weights[viseme]),
                Cause::Vowel(vowel) => vowels.map_or(0.0, |weights| weights[vowel]),
                Cause::Open { jaw, close } => (values[jaw] - values[close]).max(0.0) / OPEN,
            };
            weights[shape] = (weights[shape] + value).clamp(0.0, 1.0);
        }
    }
}

/// A shape's name: its words in lower case without the side, and the side.
#[derive(Clone, Debug)]
struct Spelling {
    words: Vec<String>,
    /// Index into [`SIDES`].
    side: Option<usize>,
}

impl Spelling {
    fn new(name: &str) -> Self {
        let mut words = words(name);
        for word in &mut words {
            match word.as_str() {
                "l" => "left".clone_into(word),
                "r" => "right".clone_into(word),
                _ => {}
            }
        }
        // `facs_bs_BrowDownLeft_div2`
        if words.len() > 2 && words.ends_with(&["div".to_owned(), "2".to_owned()]) {
            words.truncate(words.len() - 2);
        }
        let side_of = |word: &String| SIDES.iter().position(|side| side == word);
        let sides: Vec<_> = words.iter().enumerate().filter_map(|(at, word)| Some((at, side_of(word)?))).collect();
        // `Eye_L_Look_R`: the eye's side, then the direction.
        if let [.., (eye, whose), (to, where_to)] = sides[..]
            && eye > 0
            && words[eye - 1] == "eye"
            && words.get(eye + 1).is_some_and(|word| word == "look")
            && to == eye + 2
        {
            (if whose == where_to { "out" } else { "in" }).clone_into(&mut words[to]);
            words.remove(eye);
            return Self { words, side: Some(whose) };
        }
        let Some(&(at, side)) = sides.last() else { return Self { words, side: None } };
        words.remove(at);
        Self { words, side: Some(side) }
    }

    /// The whole name, with its side last.
    fn text(&self) -> String {
        self.words.concat() + self.side.map_or("", |side| SIDES[side])
    }

    /// Whether the last words, joined, are `name`.
    fn ends_with(&self, name: &str) -> bool {
        (0..self.words.len()).any(|from| self.words[from..].concat() == name)
    }

    /// Whether a channel may move this shape: it has no side, or the same side.
    fn is_on(&self, channel: &Self) -> bool {
        channel.side.is_none() || self.side == channel.side
    }
}

#[cfg(test)]
mod tests;
