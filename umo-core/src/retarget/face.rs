//! Face channels to the shapes that a character has.
//!
//! Shapes are found by name. ARKit's names are taken however they are spelt (`jawOpen`, `JawOpen`,
//! `Head.jaw_open`, `eyeBlink_L`). Characters without them may have the visemes of the Oculus set,
//! or VRM's five vowels and blinks; those are made of the ARKit channels. The vowels stand at the
//! corners of three numbers, 0 to 1: how far the jaw is open (`o`), how round the lips are (`r`),
//! how wide (`w`):
//!
//! ```text
//! aa = o (1-r) (1-w)   ee = o (1-r) w   oh = o r   ou = (1-o) r   ih = (1-o) (1-r) w, only with the jaw open a little
//! ```

use super::names::words;
use crate::config::{Face, FaceKind};
use crate::motion::visemes::{VISEME_NAMES, VISEMES, Visemes};

/// The jaw is open for a vowel at this much of `jawOpen`.
const OPEN: f32 = 0.7;
/// Lips are round at this much of `mouthFunnel` or `mouthPucker`.
const ROUND: f32 = 0.7;
/// Lips are wide at this much of `mouthSmile` and `mouthStretch`, both sides taken together.
const WIDE: f32 = 0.5;

/// VRM's vowels, 1.0 and 0.x, in the order of [`Vowels`].
const VOWELS: [&[&str]; 5] = [&["aa", "a"], &["ih", "i"], &["ou", "u"], &["ee", "e"], &["oh", "o"]];

/// What makes a shape's weight.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Cause {
    /// A channel, so much of it.
    Channel(usize, f32),
    /// The mean of two channels.
    Mean(usize, usize),
    Viseme(usize),
    Vowel(usize),
}

/// Which channels vowels are made of.
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

    /// `[5]`, 0 to 1, together at most 1.
    fn weights(&self, values: &[f32]) -> [f32; 5] {
        let share = |value: f32, full: f32| (value / full).clamp(0.0, 1.0);
        let o = share(values[self.jaw] - values[self.close], OPEN);
        let r = share(values[self.round[0]].max(values[self.round[1]]), ROUND);
        let w = share(0.5 * self.wide.iter().map(|&channel| values[channel]).sum::<f32>(), WIDE);
        // A closed mouth that smiles says nothing.
        let apart = (4.0 * o).min(1.0);
        [o * (1.0 - r) * (1.0 - w), apart * (1.0 - o) * (1.0 - r) * w, (1.0 - o) * r, o * (1.0 - r) * w, o * r]
    }
}

/// Which shapes of one list move, and by what.
#[derive(Clone, Debug)]
pub struct FaceMap {
    shapes: usize,
    channels: usize,
    /// A shape comes again where several causes add up.
    causes: Vec<(usize, Cause)>,
    visemes: Option<Visemes>,
    vowels: Option<Vowels>,
}

impl FaceMap {
    /// Finds shapes by name for a face's channels. Only ARKit's channels have names that others
    /// know.
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
        let spelt: Vec<Vec<String>> = shapes.iter().map(|shape| spelling(shape.as_ref())).collect();
        for (channel, name) in face.names.iter().enumerate() {
            let name = spelling(name).concat();
            let found = spelt.iter().enumerate().filter(|(_, words)| ends_with(words, &name));
            map.causes.extend(found.map(|(shape, _)| (shape, Cause::Channel(channel, 1.0))));
        }
        if !map.drives(face, "jawOpen") {
            map.add_visemes(&spelt);
        }
        map.add_blinks(face, &spelt);
        map
    }

    /// The Oculus set where there is most of it, else VRM's vowels.
    fn add_visemes(&mut self, spelt: &[Vec<String>]) {
        let marked = |words: &[String], name: &str| {
            let text = words.concat();
            let rest = text.strip_suffix(&name.to_lowercase());
            rest.is_some_and(|rest| rest.ends_with("viseme") || rest.ends_with("vrcv"))
        };
        let place = |name: &str| spelt.iter().position(|words| marked(words, name));
        let found: Vec<_> = VISEME_NAMES.iter().enumerate().filter_map(|(at, name)| Some((place(name)?, at))).collect();
        if self.visemes.is_some() && found.len() > VISEMES / 2 {
            self.causes.extend(found.into_iter().map(|(shape, viseme)| (shape, Cause::Viseme(viseme))));
        } else if self.vowels.is_some() {
            for (vowel, names) in VOWELS.iter().enumerate() {
                let found = spelt.iter().position(|words| names.contains(&words.concat().as_str()));
                self.causes.extend(found.map(|shape| (shape, Cause::Vowel(vowel))));
            }
        }
    }

    /// `blinkLeft` and `blinkRight`, or `blink` for both.
    fn add_blinks(&mut self, face: &Face, spelt: &[Vec<String>]) {
        let shape = |name: &str| spelt.iter().position(|words| words.concat() == name);
        let channel = |name: &str| face.names.iter().position(|known| known == name);
        let Some((left, right)) = channel("eyeBlinkLeft").zip(channel("eyeBlinkRight")) else { return };
        if self.drives(face, "eyeBlinkLeft") {
            return;
        }
        if let Some((on_left, on_right)) = shape("blinkleft").zip(shape("blinkright")) {
            let channel = |channel| Cause::Channel(channel, 1.0);
            self.causes.extend([(on_left, channel(left)), (on_right, channel(right))]);
        } else if let Some(both) = shape("blink") {
            self.causes.push((both, Cause::Mean(left, right)));
        }
    }

    /// Lets a shape follow `gain` times a channel, with whatever else moves it. Says whether there
    /// are both.
    pub fn link(&mut self, face: &Face, channel: &str, shape: usize, gain: f32) -> bool {
        let found = face.names.iter().position(|name| name == channel).filter(|_| shape < self.shapes);
        self.causes.extend(found.map(|channel| (shape, Cause::Channel(channel, gain))));
        found.is_some()
    }

    /// Leaves a shape alone.
    pub fn release(&mut self, shape: usize) {
        self.causes.retain(|(at, _)| *at != shape);
    }

    /// Whether some shape follows this channel itself.
    pub fn drives(&self, face: &Face, channel: &str) -> bool {
        let is = |at: usize| face.names.get(at).is_some_and(|name| name == channel);
        self.causes.iter().any(|(_, cause)| matches!(cause, Cause::Channel(at, _) if is(*at)))
    }

    /// Whether some shape opens the mouth: a jaw that turns would open it twice.
    pub fn opens_mouth(&self, face: &Face) -> bool {
        let speaks = |cause: &Cause| matches!(cause, Cause::Viseme(_) | Cause::Vowel(_));
        self.drives(face, "jawOpen") || self.causes.iter().any(|(_, cause)| speaks(cause))
    }

    /// Number of shapes, moved or not.
    pub fn shapes(&self) -> usize {
        self.shapes
    }

    /// The shapes that move, once each, in order.
    pub fn moved(&self) -> Vec<usize> {
        let mut moved: Vec<_> = self.causes.iter().map(|(shape, _)| *shape).collect();
        moved.sort_unstable();
        moved.dedup();
        moved
    }

    /// What a shape follows, in words.
    pub fn cause(&self, face: &Face, shape: usize) -> String {
        let name = |at: usize| face.names.get(at).map_or("", String::as_str);
        let causes = self.causes.iter().filter(|(at, _)| *at == shape).map(|(_, cause)| match *cause {
            Cause::Channel(at, 1.0) => name(at).to_owned(),
            Cause::Channel(at, gain) => format!("{gain} {}", name(at)),
            Cause::Mean(left, right) => format!("mean of {} and {}", name(left), name(right)),
            Cause::Viseme(at) => format!("viseme {}", VISEME_NAMES[at]),
            Cause::Vowel(at) => format!("vowel {}", VOWELS[at][0]),
        });
        causes.collect::<Vec<_>>().join(" + ")
    }

    /// Writes the weights of the shapes that move, 0 to 1, and leaves the others. Never allocates.
    /// Panics where there are fewer values than channels, or fewer weights than shapes.
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
            };
            weights[shape] = (weights[shape] + value).clamp(0.0, 1.0);
        }
    }
}

/// Words of a shape's name, with its side written out.
fn spelling(name: &str) -> Vec<String> {
    let mut words = words(name);
    for word in &mut words {
        match word.as_str() {
            "l" => "left".clone_into(word),
            "r" => "right".clone_into(word),
            _ => {}
        }
    }
    words
}

/// Whether words end with a name, from the start of one of them.
fn ends_with(words: &[String], name: &str) -> bool {
    let tail = |from: usize| words[from..].concat();
    (0..words.len()).any(|from| tail(from) == name)
}

#[cfg(test)]
mod tests;
