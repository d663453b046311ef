//! Rotations, translations and weights over time: the single animation of a file.

use gltf_json as json;
use json::animation::{Animation, Channel, Interpolation, Property, Sampler, Target};
use json::validation::Checked::Valid;
use json::{Accessor, Index, Node};
use umo_core_base::memory::collected;
use umo_core_pose::clip::Clip;

use crate::builder::{self, Builder};

/// An animation under construction; its keys are the clip's frames.
pub(crate) struct Tracks {
    times: Index<Accessor>,
    pub(crate) animation: Animation,
}

impl Tracks {
    pub(crate) fn new(builder: &mut Builder, clip: &Clip) -> Self {
        let times: Vec<f32> = collected((0..clip.rotations.len()).map(|f| f as f32 / clip.frame_rate));
        let times = builder.times(&times);
        let animation = Animation {
            channels: Vec::new(),
            samplers: Vec::new(),
            name: Some("speech".to_owned()),
            extensions: None,
            extras: None,
        };
        Self { times, animation }
    }

    /// Adds a channel; `output` has a value for every frame.
    pub(crate) fn add(&mut self, node: Index<Node>, property: Property, output: Index<Accessor>) {
        let sampler = builder::index(self.animation.samplers.len());
        self.animation.samplers.push(Sampler {
            input: self.times,
            output,
            interpolation: Valid(Interpolation::Linear),
            extensions: None,
            extras: None,
        });
        self.animation.channels.push(Channel {
            sampler,
            target: Target { node, path: Valid(property), extensions: None, extras: None },
            extensions: None,
            extras: None,
        });
    }
}

/// Rotations of a joint over time.
pub(crate) fn track(clip: &Clip, joint: usize) -> Vec<[f32; 4]> {
    continuous(clip.rotations.iter().map(|frame| frame[joint]))
}

/// Normalises rotations and flips signs so that neighbours are in one hemisphere: not every program takes the shorter
/// way between two quaternions.
pub(crate) fn continuous(rotations: impl ExactSizeIterator<Item = [f32; 4]>) -> Vec<[f32; 4]> {
    let mut before = [0.0, 0.0, 0.0, 1.0];
    collected(rotations.map(|q| {
        let length = q.iter().map(|x| x * x).sum::<f32>().sqrt();
        let dot: f32 = q.iter().zip(before).map(|(a, b)| a * b).sum();
        let sign = if dot < 0.0 { -1.0 } else { 1.0 };
        before = q.map(|x| x * sign / length);
        before
    }))
}
