//! Dimensions of random models of layout `frames`: like [`sizes`](super::sizes), with more
//! parts and levels, and a depth network.

use umo_core::{Config, Part, PerPart};
use umo_core_model::config::{Codec, Depth, Layout, Modality, PartSpec, TemplateItem, channel_names};

use super::sizes;
use crate::args::Size;

/// Keyframes of audio after the chunk.
const AHEAD: usize = 3;

/// Returns the config of a random model.
pub(super) fn config(size: Size) -> Config {
    let mut config = sizes::config(size);
    let parts = match size {
        Size::Base => body(&config, 4, 256, 2),
        Size::Small => body(&config, 2, 48, 2),
        Size::Tiny => tiny(&config),
    };
    config.name = config.name.replace("-random", "-frames-random");
    config.layout = Layout::Frames;
    config.depth = Some(depth(size));
    config.audio.ahead = AHEAD;
    // Ids of parts are needed only if the language model writes codes as tokens.
    let audio = config.vocab.face.first;
    let shift = config.vocab.audio.first - audio;
    let moved = |id: usize| id - shift;
    let Modality { first, codes, start, end, mask } = config.vocab.audio;
    config.vocab.audio =
        Modality { first: moved(first), codes, start: moved(start), end: moved(end), mask: moved(mask) };
    config.vocab.size = moved(config.vocab.size);
    let none = Modality::default();
    (config.vocab.face, config.vocab.hands, config.vocab.upper, config.vocab.lower) = (none, none, none, none);
    let none = Codec::default();
    (config.vq.face, config.vq.hands, config.vq.upper, config.vq.lower) = (none, none, none, none);
    config.vq.codes = 0;
    config.rest = PerPart::from_fn(|_| usize::MAX);
    for items in config.templates.values_mut() {
        let is_part =
            |item: &TemplateItem| Part::ALL.iter().any(|part| *item == TemplateItem::Name(part.name().to_owned()));
        let at = items.iter().position(is_part).expect("every template has the parts");
        items.retain(|item| !is_part(item));
        items.insert(at, TemplateItem::Name("history".to_owned()));
    }
    config.parts = Some(parts);
    config
}

fn depth(size: Size) -> Depth {
    let (d_model, num_heads, d_ff, num_layers) = match size {
        Size::Base => (256, 4, 512, 3),
        Size::Small => (48, 4, 96, 2),
        Size::Tiny => (6, 2, 7, 2),
    };
    let (heard, body_heard) = (Some(1), Some(3));
    Depth { d_model, num_heads, d_ff, num_layers, layer_norm_epsilon: 1e-6, before: true, heard, body_heard }
}

/// Returns the names of a body part's channels that satisfy `wanted`.
fn named(config: &Config, part: Part, wanted: impl Fn(&str) -> bool) -> Vec<String> {
    let names = channel_names(part, &config.face).into_iter();
    names.filter(|(name, _)| wanted(name)).map(|(name, _)| name.to_owned()).collect()
}

fn part(
    name: &str,
    channels: Vec<String>,
    (codes, levels): (usize, usize),
    (width, layers): (usize, usize),
) -> PartSpec {
    let rest = (0..levels).map(|level| level % codes).collect();
    PartSpec { name: name.to_owned(), channels, codes, levels, width, layers, rest, sampling: None }
}

/// Returns seven parts: the face, each hand, the torso with the head, each arm, and the lower body.
fn body(config: &Config, levels: usize, width: usize, layers: usize) -> Vec<PartSpec> {
    let limb = |name: &str, side: &str| {
        name.starts_with(side) && ["shoulder", "elbow", "wrist"].iter().any(|joint| name.ends_with(joint))
    };
    let of = |part: Part, wanted: &dyn Fn(&str) -> bool| named(config, part, wanted);
    let codes = (256, levels);
    vec![
        part("face", of(Part::Face, &|_| true), codes, (width, layers)),
        part("hand_left", of(Part::Hands, &|name| name.starts_with("left")), codes, (width, layers)),
        part("hand_right", of(Part::Hands, &|name| name.starts_with("right")), codes, (width, layers)),
        part("torso", of(Part::Upper, &|name| !limb(name, "left") && !limb(name, "right")), codes, (width, layers)),
        part("arm_left", of(Part::Upper, &|name| limb(name, "left")), codes, (width, layers)),
        part("arm_right", of(Part::Upper, &|name| limb(name, "right")), codes, (width, layers)),
        part("lower", of(Part::Lower, &|_| true), codes, (width, 2 * layers)),
    ]
}

/// Returns five parts of 1 to 4 levels and an annotation, all of different shapes and not in body order.
fn tiny(config: &Config) -> Vec<PartSpec> {
    let of = |part: Part, wanted: &dyn Fn(&str) -> bool| named(config, part, wanted);
    vec![
        part("lower", of(Part::Lower, &|_| true), (7, 2), (3, 2)),
        part("intent", Vec::new(), (3, 1), (0, 0)),
        part("brows", of(Part::Face, &|name| name != "jaw"), (5, 1), (2, 1)),
        part("hands", of(Part::Hands, &|_| true), (6, 3), (5, 1)),
        part("jaw", of(Part::Face, &|name| name == "jaw"), (7, 4), (4, 2)),
        part("upper", of(Part::Upper, &|_| true), (4, 2), (3, 1)),
    ]
}
