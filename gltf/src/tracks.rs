//! Rotations, translations and weights over time: the single animation of a file.

use std::collections::BTreeMap;

use gltf_json as json;
use json::animation::{Animation, Channel, Interpolation, Property, Sampler, Target};
use json::validation::Checked::Valid;
use json::{Accessor, Index, Node};
use umo_core_base::memory::collected;
use umo_core_pose::clip::Clip;
use umo_core_pose::rotation::Quat;

use crate::builder::{self, Builder};
use crate::keys::Bound;

/// An animation under construction. Its keys are the clip's frames, or those that hold each track within a bound.
pub(crate) struct Tracks {
    frame_rate: f32,
    bound: Option<Bound>,
    /// Times of all frames; `None` with a bound.
    times: Option<Index<Accessor>>,
    /// Times of the tracks that have fewer keys, by their frames.
    fewer: BTreeMap<Vec<usize>, Index<Accessor>>,
    pub(crate) animation: Animation,
}

impl Tracks {
    pub(crate) fn new(builder: &mut Builder, clip: &Clip, bound: Option<Bound>) -> Self {
        let frame_rate = clip.frame_rate;
        let times = bound.is_none().then(|| {
            let times: Vec<f32> = collected((0..clip.rotations.len()).map(|f| f as f32 / frame_rate));
            builder.times(&times)
        });
        let animation = Animation {
            channels: Vec::new(),
            samplers: Vec::new(),
            name: Some("speech".to_owned()),
            extensions: None,
            extras: None,
        };
        Self { frame_rate, bound, times, fewer: BTreeMap::new(), animation }
    }

    /// Adds a node's rotations, one for every frame.
    pub(crate) fn rotations(&mut self, builder: &mut Builder, node: Index<Node>, mut values: Vec<Quat>) {
        let keys = self.bound.map(|bound| bound.rotations(&values));
        if let Some(keys) = &keys {
            values = continuous(keys.iter().map(|&frame| values[frame]));
        }
        let output = builder.vectors(&values);
        self.add(builder, (node, Property::Rotation), keys, output);
    }

    /// Adds a node's places, one for every frame.
    pub(crate) fn places(&mut self, builder: &mut Builder, node: Index<Node>, mut values: Vec<[f32; 3]>) {
        let keys = self.bound.map(|bound| bound.places(&values));
        if let Some(keys) = &keys {
            values = collected(keys.iter().map(|&frame| values[frame]));
        }
        let output = builder.vectors(&values);
        self.add(builder, (node, Property::Translation), keys, output);
    }

    /// Adds the weights of a node's shapes, `[frames, shapes]`: glTF has one track for them all.
    pub(crate) fn weights(&mut self, builder: &mut Builder, node: Index<Node>, values: &[f32], shapes: usize) {
        let keys = self.bound.map(|bound| bound.rows(values, shapes, |_| false));
        let output = match &keys {
            Some(keys) => {
                let kept: Vec<f32> =
                    keys.iter().flat_map(|frame| &values[frame * shapes..][..shapes]).copied().collect();
                builder.scalars(kept.into_iter())
            }
            None => builder.scalars(values.iter().copied()),
        };
        self.add(builder, (node, Property::MorphTargetWeights), keys, output);
    }

    /// Adds a channel; `output` has a value for each of `keys`, without them for every frame.
    fn add(
        &mut self,
        builder: &mut Builder,
        (node, property): (Index<Node>, Property),
        keys: Option<Vec<usize>>,
        output: Index<Accessor>,
    ) {
        let input = match keys {
            Some(keys) => {
                let seconds: Vec<f32> = keys.iter().map(|&frame| frame as f32 / self.frame_rate).collect();
                *self.fewer.entry(keys).or_insert_with(|| builder.times(&seconds))
            }
            None => self.times.expect("made without a bound"),
        };
        let sampler = builder::index(self.animation.samplers.len());
        self.animation.samplers.push(Sampler {
            input,
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
pub(crate) fn track(clip: &Clip, joint: usize) -> Vec<Quat> {
    continuous(clip.rotations.iter().map(|frame| frame[joint]))
}

/// Normalises rotations and flips signs so that neighbours are in one hemisphere: not every program takes the shorter
/// way between two quaternions.
pub(crate) fn continuous(rotations: impl ExactSizeIterator<Item = Quat>) -> Vec<Quat> {
    let mut before = [0.0, 0.0, 0.0, 1.0];
    collected(rotations.map(|q| {
        let length = q.iter().map(|x| x * x).sum::<f32>().sqrt();
        let dot: f32 = q.iter().zip(before).map(|(a, b)| a * b).sum();
        let sign = if dot < 0.0 { -1.0 } else { 1.0 };
        before = q.map(|x| x * sign / length);
        before
    }))
}
