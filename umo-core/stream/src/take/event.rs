//! A host's requests, as bytes and for the layers.

use std::fmt;

use umo_core_layers::gesture::Request;
use umo_core_layers::{
    Attention, Controls, GestureOptions, Gestures, LAYERS, Layer, LipShape, Mood, RequestError, Side, WordRules,
};
use umo_core_model::config::Sampling;
use umo_core_model::lm::sampler::Sampler;

use super::TakeError;
use super::log::Put;
use super::reader::{MAX_TEXT, Reader};

/// Number of things that stay in force.
pub(super) const STANDING: usize = 5 + LAYERS;

/// Tags of the events' records.
const WORDS: u8 = 0x41;
const GESTURE: u8 = 0x42;
const LIPS: u8 = 0x43;
const MOOD: u8 = 0x44;
const LOOK: u8 = 0x45;
const ATTENTION: u8 = 0x46;
const LAYER: u8 = 0x47;
const EXPRESSION: u8 = 0x48;
const PROMPT: u8 = 0x49;
const SAMPLER: u8 = 0x4A;

/// Flags of a gesture's record.
const TIMED: u8 = 1;
const AIMED: u8 = 2;

/// Something that a host asked of an avatar.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Event<'a> {
    /// Words and their time, seconds of the audio.
    Words {
        /// The words.
        text: &'a str,
        /// When they begin.
        start: f64,
        /// When they end.
        end: f64,
    },
    /// A gesture.
    Gesture {
        /// Its name.
        name: &'a str,
        /// Its options.
        options: GestureOptions,
    },
    /// The lip shape of a sound.
    Lips {
        /// The shape.
        shape: LipShape,
        /// When the sound begins, seconds of the audio.
        start: f64,
        /// Its duration, seconds.
        duration: f64,
    },
    /// A mood.
    Mood {
        /// The mood.
        mood: Mood,
        /// Its strength, 0 to 1.
        strength: f32,
    },
    /// A place to look at.
    Look {
        /// The place, metres.
        point: [f32; 3],
        /// Strength, 0 to 1; 0 releases the gaze.
        strength: f32,
    },
    /// Attention.
    Attention(Attention),
    /// Gain of a layer.
    Layer {
        /// The layer.
        layer: Layer,
        /// Its gain, 0 to 1.
        gain: f32,
    },
    /// How far body and face follow the voice's arousal, 0 to 1.
    Expression(f32),
    /// A prompt: token ids, little-endian. In force from the next chunk on.
    Prompt(&'a [[u8; 4]]),
    /// Settings of the draws of codes. In force from the next chunk on.
    Sampler(Sampler),
}

/// Data that the layers have when an event reaches them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Known<'a> {
    pub(crate) gestures: &'a Gestures,
    pub(crate) rules: &'a WordRules,
    pub(crate) frame_rate: usize,
    /// Rate of the host's audio.
    pub(crate) sample_rate: usize,
}

/// Numbers of requests that have begun or passed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Passed {
    pub(crate) gestures: u64,
    pub(crate) lips: u64,
    pub(crate) words: u64,
}

impl Passed {
    pub(super) fn all(count: u64) -> Self {
        Self { gestures: count, lips: count, words: count }
    }
}

impl fmt::Display for Event<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Words { text, .. } => write!(f, "words `{text}`"),
            Self::Gesture { name, .. } => write!(f, "gesture `{name}`"),
            Self::Lips { shape, .. } => write!(f, "lips `{}`", shape.name()),
            Self::Mood { .. } => write!(f, "mood"),
            Self::Look { .. } => write!(f, "look"),
            Self::Attention(_) => write!(f, "attention"),
            Self::Layer { layer, .. } => write!(f, "layer {}", layer.name()),
            Self::Expression(_) => write!(f, "expression"),
            Self::Prompt(_) => write!(f, "prompt"),
            Self::Sampler(_) => write!(f, "sampler"),
        }
    }
}

impl<'a> Event<'a> {
    /// Changes the layers' controls as the host's call did. `epoch` is that of the stream.
    pub(crate) fn apply(
        &self,
        controls: &mut Controls,
        known: &Known,
        (epoch, passed): (u32, Passed),
    ) -> Result<(), RequestError> {
        match *self {
            Self::Words { text, start, end } => {
                controls.words.push(known.rules, text, (start, end), (epoch, passed.words))?;
            }
            Self::Gesture { name, ref options } => {
                let request = Request::new(known.gestures, name, options, known.frame_rate, epoch)?;
                controls.gestures.push(request, passed.gestures)?;
            }
            Self::Lips { shape, start, duration } => {
                controls.hints.push((start, duration), shape, known.sample_rate, (epoch, passed.lips))?;
            }
            Self::Mood { mood, strength } => (controls.mood, controls.mood_strength) = (mood, strength),
            Self::Look { point, strength } => (controls.look_at, controls.look_at_strength) = (point, strength),
            Self::Attention(attention) => controls.attention = attention,
            Self::Layer { layer, gain } => controls.layers = controls.layers.with(layer, gain),
            Self::Expression(expression) => controls.expression = expression,
            Self::Sampler(sampler) => controls.activity = sampler.activity,
            // The packets have what came of it.
            Self::Prompt(_) => {}
        }
        Ok(())
    }

    /// The event, and the number of the value that it sets, if that stays in force until it is set anew.
    pub(super) fn standing(&self) -> Option<(usize, Event<'static>)> {
        Some(match *self {
            Self::Mood { mood, strength } => (0, Event::Mood { mood, strength }),
            Self::Look { point, strength } => (1, Event::Look { point, strength }),
            Self::Attention(attention) => (2, Event::Attention(attention)),
            Self::Expression(expression) => (3, Event::Expression(expression)),
            Self::Sampler(sampler) => (4, Event::Sampler(sampler)),
            Self::Layer { layer, gain } => (5 + layer as usize, Event::Layer { layer, gain }),
            Self::Words { .. } | Self::Gesture { .. } | Self::Lips { .. } | Self::Prompt(_) => return None,
        })
    }

    /// Writes the event's record.
    pub(super) fn write(&self, out: &mut Put) {
        match *self {
            Self::Words { text, start, end } => {
                out.tag(WORDS).f64(start).f64(end).text(text);
            }
            Self::Gesture { name, options } => {
                let GestureOptions { at, speed, strength, side, target, variant } = options;
                let flags = if at.is_some() { TIMED } else { 0 } | if target.is_some() { AIMED } else { 0 };
                out.tag(GESTURE).bytes(&[flags, side as u8, variant]).f32s(&[speed, strength]);
                if let Some(at) = at {
                    out.f64(at);
                }
                out.f32s(target.as_ref().map_or(&[], |place| &place[..])).text(name);
            }
            Self::Lips { shape, start, duration } => {
                out.tag(LIPS).bytes(&[shape as u8]).f64(start).f64(duration);
            }
            Self::Mood { mood, strength } => {
                out.tag(MOOD).bytes(&[mood as u8]).f32s(&[strength]);
            }
            Self::Look { point, strength } => {
                out.tag(LOOK).f32s(&point).f32s(&[strength]);
            }
            Self::Attention(attention) => {
                out.tag(ATTENTION).bytes(&[attention as u8]);
            }
            Self::Layer { layer, gain } => {
                out.tag(LAYER).bytes(&[layer as u8]).f32s(&[gain]);
            }
            Self::Expression(expression) => {
                out.tag(EXPRESSION).f32s(&[expression]);
            }
            Self::Prompt(ids) => {
                out.tag(PROMPT).count(ids.len()).bytes(ids.as_flattened());
            }
            Self::Sampler(Sampler { sampling, seed, activity, expression }) => {
                let top_k = u32::try_from(sampling.top_k).unwrap_or(u32::MAX);
                out.tag(SAMPLER).bytes(&seed.to_le_bytes()).bytes(&top_k.to_le_bytes());
                out.f32s(&[sampling.temperature, sampling.top_p, activity, expression]);
            }
        }
    }

    /// Reads the record of an event after its tag.
    pub(super) fn read(tag: u8, from: &mut Reader<'a>) -> Result<Self, TakeError> {
        Ok(match tag {
            WORDS => Self::Words { start: from.f64("time")?, end: from.f64("time")?, text: from.text("words")? },
            GESTURE => Self::gesture(from)?,
            LIPS => Self::Lips {
                shape: from.one("lip shape", &LipShape::ALL)?,
                start: from.f64("time")?,
                duration: from.f64("time")?,
            },
            MOOD => Self::Mood { mood: from.one("mood", &Mood::ALL)?, strength: from.share("mood")? },
            LOOK => Self::Look { point: place(from)?, strength: from.share("look")? },
            ATTENTION => Self::Attention(from.one("attention", &Attention::ALL)?),
            LAYER => Self::Layer { layer: from.one("layer", &Layer::ALL)?, gain: from.share("gain of a layer")? },
            EXPRESSION => Self::Expression(from.share("expression")?),
            PROMPT => Self::Prompt(from.items()?),
            SAMPLER => Self::sampler(from)?,
            _ => return Err(TakeError::Field("kind of record")),
        })
    }

    fn gesture(from: &mut Reader<'a>) -> Result<Self, TakeError> {
        let flags = from.u8("gesture")?;
        if flags & !(TIMED | AIMED) != 0 {
            return Err(TakeError::Field("gesture"));
        }
        let (side, variant) = (from.one("gesture's side", &Side::ALL)?, from.u8("gesture's variant")?);
        let (speed, strength) = (from.f32("gesture's speed")?, from.f32("gesture's strength")?);
        let at = if flags & TIMED != 0 { Some(from.f64("gesture's time")?) } else { None };
        let target = if flags & AIMED != 0 { Some(place(from)?) } else { None };
        let options = GestureOptions { at, speed, strength, side, target, variant };
        Ok(Self::Gesture { name: from.text("gesture's name")?, options })
    }

    fn sampler(from: &mut Reader<'a>) -> Result<Self, TakeError> {
        let (seed, top_k) = (from.u64("seed")?, from.small("top_k")?);
        let temperature = from.within("temperature", 0.0, 100.0)?;
        let sampling = Sampling { temperature, top_k, top_p: from.share("top_p")? };
        let (activity, expression) = (from.share("activity")?, from.share("expression")?);
        Ok(Self::Sampler(Sampler { sampling, seed, activity, expression }))
    }
}

fn place(from: &mut Reader) -> Result<[f32; 3], TakeError> {
    Ok([from.f32("place")?, from.f32("place")?, from.f32("place")?])
}

/// Part of a text that a record has room for.
pub(super) fn shortened(text: &str) -> &str {
    &text[..text.floor_char_boundary(MAX_TEXT)]
}
