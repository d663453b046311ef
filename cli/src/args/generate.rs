//! Settings of a motion that the commands share.

use std::path::PathBuf;

use clap::Args as ClapArgs;
use umo_core::{GestureOptions, GestureParts, Layer, Side};

use super::TUNING;

/// Settings of a motion.
#[derive(Debug, ClapArgs)]
pub struct GenerateArgs {
    /// Random seed: the same seed gives the same motion
    #[arg(long, value_name = "NUMBER", default_value_t = 0)]
    pub seed: u64,
    /// Gain of the layers over the model's motion, 0 to 1, or LAYER=GAIN
    ///
    /// Layers are gaze, idle, asymmetry, nods, mood, feet and body. A number alone is the gain of all.
    #[arg(long, value_name = "GAIN", value_delimiter = ',', value_parser = life_gain)]
    pub layers: Vec<(Option<Layer>, f32)>,
    /// How often hands leave rest, 0 to 1 [default: 0.5, as people do]
    #[arg(long, value_name = "AMOUNT", value_parser = share, hide_short_help = true)]
    pub activity: Option<f32>,
    /// How far body and face follow the arousal of the voice, 0 to 1 [default: 0.5]
    #[arg(long, value_name = "AMOUNT", value_parser = share, hide_short_help = true)]
    pub expression: Option<f32>,
    /// Play a gesture over the motion; may be repeated
    ///
    /// Its name, the time of its stroke in seconds (`wave@2.5`; without a time as soon as possible), then after
    /// commas left, right or both, speed=0.5 to 2, strength=0 to 1, variant=0 to 255, and to=X:Y:Z, a point in metres.
    #[arg(long, value_name = "NAME[@SECONDS]", value_parser = gesture)]
    pub gesture: Vec<GestureArg>,
    /// Add a gesture for --gesture
    ///
    /// NAME=FILE with an animation (glb, gltf, bvh, npz, jsonl), then after commas the time of its stroke and the
    /// parts that it moves (default: all): head, trunk, left-arm, right-arm (`salute=salute.glb,0.6,right-arm`).
    #[arg(long, value_name = "NAME=FILE[,SECONDS][,PART]", value_parser = gesture_clip, help_heading = TUNING, hide_short_help = true)]
    pub gesture_clip: Vec<GestureClip>,
    /// Begin in this pose: SMPL-X motion whose last keyframes become the history
    #[arg(long, value_name = "FILE.npz", help_heading = TUNING, hide_short_help = true)]
    pub start_pose: Option<PathBuf>,
    /// Keyframes per chunk: fewer lower the latency, more lower the cost
    #[arg(long, value_name = "N", help_heading = TUNING, hide_short_help = true)]
    pub target: Option<usize>,
    /// Frames held back for smooth seams between chunks
    #[arg(long, value_name = "FRAMES", help_heading = TUNING, hide_short_help = true)]
    pub lookahead: Option<usize>,
    /// Keyframes of speech after a chunk that the model hears [default: as many as it can for a recording, 0 live]
    #[arg(long, value_name = "KEYFRAMES", help_heading = TUNING, hide_short_help = true)]
    pub horizon: Option<usize>,
    /// Strength of the prompt, 1 to 3, in models of layout `frames` [default: 2.5 for a text alone, else 1]
    #[arg(long, value_name = "STRENGTH", help_heading = TUNING, hide_short_help = true)]
    pub guidance: Option<f32>,
    /// Low-pass of the body's motion: standard deviation in frames, 0 to 1.5; 0 for none
    #[arg(long, value_name = "FRAMES", help_heading = TUNING, hide_short_help = true)]
    pub smoothing: Option<f32>,
    /// Sampling temperature, 0 to 100 [default: the model's, at most 0.7 for a text alone]
    ///
    /// Lower is calmer, 0 takes the likeliest code.
    #[arg(long, value_name = "NUMBER", conflicts_with = "greedy", value_parser = temperature, help_heading = TUNING, hide_short_help = true)]
    pub temperature: Option<f32>,
    /// Take the likeliest code instead of sampling
    #[arg(long, conflicts_with = "seed", help_heading = TUNING, hide_short_help = true)]
    pub greedy: bool,
}

/// A sampling temperature.
fn temperature(text: &str) -> Result<f32, String> {
    text.parse().ok().filter(|value| (0.0..=100.0).contains(value)).ok_or_else(|| "expected 0 to 100".to_owned())
}

/// A number from 0 to 1.
fn share(text: &str) -> Result<f32, String> {
    text.parse().ok().filter(|value| (0.0..=1.0).contains(value)).ok_or_else(|| "expected 0 to 1".to_owned())
}

/// Gain of all layers, or of one.
fn life_gain(text: &str) -> Result<(Option<Layer>, f32), String> {
    let (layer, gain) = match text.split_once('=') {
        Some((name, gain)) => {
            let known = || Layer::ALL.map(Layer::name).join(", ");
            let layer = Layer::ALL.into_iter().find(|layer| layer.name() == name);
            (Some(layer.ok_or_else(|| format!("no layer is called {name}; there are {}", known()))?), gain)
        }
        None => (None, text),
    };
    match gain.parse() {
        Ok(gain) if (0.0..=1.0).contains(&gain) => Ok((layer, gain)),
        _ => Err("expected a gain of 0 to 1, or LAYER=GAIN".to_owned()),
    }
}

/// A gesture to play.
#[derive(Clone, Debug, PartialEq)]
pub struct GestureArg {
    /// Its name.
    pub name: String,
    /// Options.
    pub options: GestureOptions,
}

fn gesture(text: &str) -> Result<GestureArg, String> {
    let mut words = text.split(',');
    let what = words.next().unwrap_or_default();
    let (name, at) = what.split_once('@').map_or((what, None), |(name, at)| (name, Some(at)));
    let mut options = GestureOptions::default();
    let number = |text: &str| text.parse::<f32>().map_err(|_| format!("`{text}` is not a number"));
    if let Some(at) = at {
        options.at = Some(at.parse().map_err(|_| format!("`{at}` is not a number of seconds"))?);
    }
    for word in words {
        match word.split_once('=') {
            None if word == "left" => options.side = Side::Left,
            None if word == "right" => options.side = Side::Right,
            None if word == "both" => options.side = Side::Both,
            Some(("speed", value)) => options.speed = number(value)?,
            Some(("strength", value)) => options.strength = number(value)?,
            Some(("variant", value)) => {
                options.variant = value.parse().map_err(|_| format!("`{value}` is not a variant, 0 to 255"))?;
            }
            Some(("to", value)) => {
                let place = value.split(':').map(number).collect::<Result<Vec<_>, _>>()?;
                options.target = Some(place.try_into().map_err(|_| format!("`{value}` is not a place X:Y:Z"))?);
            }
            _ => return Err(format!("`{word}`: expected left, right, both, speed=, strength=, variant= or to=X:Y:Z")),
        }
    }
    Ok(GestureArg { name: name.to_owned(), options })
}

/// A gesture from a file.
#[derive(Clone, Debug, PartialEq)]
pub struct GestureClip {
    /// Its name.
    pub name: String,
    /// Its frames.
    pub file: PathBuf,
    /// Time of its stroke in seconds; `None` for its middle.
    pub stroke: Option<f32>,
    /// The parts that it moves.
    pub parts: GestureParts,
}

pub(super) fn gesture_clip(text: &str) -> Result<GestureClip, String> {
    let (name, rest) = text.split_once('=').ok_or("expected NAME=FILE")?;
    let mut words = rest.split(',');
    let file = PathBuf::from(words.next().unwrap_or_default());
    let (mut stroke, mut parts) = (None, None);
    for word in words {
        let part = match word {
            "head" => GestureParts::HEAD,
            "trunk" => GestureParts::TRUNK,
            "left-arm" => GestureParts::LEFT_ARM,
            "right-arm" => GestureParts::RIGHT_ARM,
            _ => {
                let problem = || format!("`{word}`: expected seconds, head, trunk, left-arm or right-arm");
                stroke = Some(word.parse().map_err(|_| problem())?);
                continue;
            }
        };
        parts = Some(parts.map_or(part, |parts: GestureParts| parts.union(part)));
    }
    Ok(GestureClip { name: name.to_owned(), file, stroke, parts: parts.unwrap_or(GestureParts::ALL) })
}
