//! Dimensions of random models, a mel filter bank, and a plausible skeleton.

use std::collections::BTreeMap;
use std::f32::consts::PI;

use umo_core::{ARKIT_NAMES, Config, Face, FaceKind, PerPart, Sampling, Skeleton};
use umo_core_model::config::{
    Audio, AudioKind, Codec, Hubert, Interp, Layout, Lm, Mel, Modality, TemplateItem, Vocab, Vq,
};

use crate::args::Size;

/// Notice that every run with such a model prints.
const NOTICE: &str = "untrained model: structure only";

/// Number of pieces of the small text vocabulary, `cli/assets/text.model`.
const PIECES: usize = 180;

/// Returns the config of a random model.
pub(super) fn config(size: Size) -> Config {
    let (name, audio, text_ids) = match size {
        Size::Base => ("umo-base-random", hubert(), 32_100),
        Size::Small => ("umo-small-random", mel(40, 100), PIECES),
        Size::Tiny => ("umo-tiny-random", mel(3, 5), PIECES),
    };
    let codes = vq(size).codes;
    let vocab = vocab(text_ids, codes, audio.units, if size == Size::Base { 505 } else { audio.units + 3 });
    Config {
        name: name.to_owned(),
        license: "MIT OR Apache-2.0".to_owned(),
        notice: Some(NOTICE.to_owned()),
        frame_rate: 30,
        keyframe_stride: 6,
        prefix: 10,
        target: 5,
        max_target: 10,
        lookahead: 9,
        layout: Layout::Parts,
        parts: None,
        audio,
        vocab,
        lm: lm(size),
        depth: None,
        interp: interp(size),
        vq: vq(size),
        face: face(size),
        mouth: None,
        templates: templates(),
        prompts: None,
        rest: PerPart::default(),
        sampling: Sampling { temperature: 1.0, top_k: 50, top_p: 1.0 },
        skeleton: skeleton(),
    }
}

fn hubert() -> Audio {
    let hubert = Hubert {
        conv_dim: vec![512; 7],
        conv_kernel: vec![10, 3, 3, 3, 3, 2, 2],
        conv_stride: vec![5, 2, 2, 2, 2, 2, 2],
        hidden_size: 768,
        intermediate_size: 3072,
        num_attention_heads: 12,
        num_hidden_layers: 9,
        num_conv_pos_embeddings: 128,
        num_conv_pos_embedding_groups: 16,
        layer_norm_eps: 1e-5,
        do_normalize: false,
    };
    Audio {
        kind: AudioKind::Hubert,
        sample_rate: 16_000,
        token_rate: 50,
        units: 500,
        ahead: 0,
        accents: None,
        hubert: Some(hubert),
        mel: None,
    }
}

fn mel(bands: usize, units: usize) -> Audio {
    let mel = Mel { window: 400, fft: 512, bands, floor: 1e-5, deltas: 1, network: None };
    Audio {
        kind: AudioKind::Mel,
        sample_rate: 16_000,
        token_rate: 50,
        units,
        ahead: 0,
        accents: None,
        hubert: None,
        mel: Some(mel),
    }
}

/// Lays out the vocabulary: text ids, three ids of `motion`, each part's codes with three markers,
/// then `audio_ids` of audio.
fn vocab(text_ids: usize, codes: usize, units: usize, audio_ids: usize) -> Vocab {
    let block = |first: usize, codes: usize, ids: usize| {
        let marker = first + ids - 3;
        Modality { first, codes, start: marker, end: marker + 1, mask: marker + 2 }
    };
    let part = |i: usize| block(text_ids + 3 + i * (codes + 3), codes, codes + 3);
    let audio = text_ids + 3 + 4 * (codes + 3);
    Vocab {
        size: audio + audio_ids,
        pad: 0,
        eos: 1,
        decoder_start: 0,
        face: part(0),
        hands: part(1),
        upper: part(2),
        lower: part(3),
        audio: block(audio, units, audio_ids),
    }
}

fn lm(size: Size) -> Lm {
    let (d_model, d_kv, d_ff, num_heads, layers) = match size {
        Size::Base => (768, 64, 2048, 12, 12),
        Size::Small => (96, 24, 192, 4, 2),
        Size::Tiny => (4, 3, 5, 2, 1),
    };
    Lm {
        d_model,
        d_kv,
        d_ff,
        num_heads,
        num_layers: layers,
        num_decoder_layers: layers,
        relative_attention_num_buckets: 32,
        relative_attention_max_distance: 128,
        layer_norm_epsilon: 1e-6,
        feed_forward_proj: "gated-gelu".to_owned(),
        tie_word_embeddings: false,
        experts: 4,
        top_k: 1,
    }
}

fn interp(size: Size) -> Interp {
    let (d_model, d_ff, temporal_layers) = match size {
        Size::Base => (256, 1024, 4),
        Size::Small => (96, 192, 2),
        Size::Tiny => (4, 5, 1),
    };
    Interp { d_model, num_heads: 4, d_ff, temporal_layers, part_layers: 1, max_frames: 128 }
}

fn vq(size: Size) -> Vq {
    let (codes, width, layers) = match size {
        Size::Base => (256, 256, 2),
        Size::Small => (256, 48, 2),
        Size::Tiny => (7, 3, 1),
    };
    let codec = |channels, layers| Codec { channels, layers };
    Vq {
        codes,
        width,
        face: codec(6 + face(size).names.len(), layers),
        hands: codec(180, layers),
        upper: codec(78, layers),
        lower: codec(61, 2 * layers),
        root: codec(61, 2 * layers),
    }
}

fn face(size: Size) -> Face {
    let coefficients = |count| (0..count).map(|i| format!("expression_{i}")).collect();
    match size {
        Size::Base => Face { kind: FaceKind::SmplxExpression, names: coefficients(100) },
        Size::Small => Face { kind: FaceKind::Arkit, names: ARKIT_NAMES.map(str::to_owned).to_vec() },
        Size::Tiny => Face { kind: FaceKind::SmplxExpression, names: coefficients(2) },
    }
}

/// Returns the templates. Random weights ignore the words, so a few ids stand for them.
fn templates() -> BTreeMap<String, Vec<TemplateItem>> {
    let id = TemplateItem::Id;
    let name = |name: &str| TemplateItem::Name(name.to_owned());
    let parts = ["face", "hands", "upper", "lower"].map(name);
    let with_audio = [id(8), name("audio"), id(9)];
    let with_text = [id(10), name("text"), id(11)];
    let template = |groups: &[&[TemplateItem]]| groups.concat();
    BTreeMap::from([
        ("audio_to_motion".to_owned(), template(&[&with_audio, &parts, &[id(1)]])),
        ("audio_to_motion_with_text".to_owned(), template(&[&with_audio, &with_text, &parts, &[id(1)]])),
        ("text_to_motion".to_owned(), template(&[&with_text, &parts, &[id(1)]])),
    ])
}

/// Returns the window, triangular filters, mean or scale of a mel tokenizer.
#[expect(clippy::cast_precision_loss, reason = "window lengths are far below 2^24")]
pub(super) fn mel_values(config: &Config, name: &str) -> Vec<f32> {
    let Some(mel) = &config.audio.mel else { return Vec::new() };
    match name {
        "audio.mel.window.weight" => {
            (0..mel.window).map(|i| 0.5 - 0.5 * (2.0 * PI * i as f32 / mel.window as f32).cos()).collect()
        }
        "audio.mel.filters.weight" => filters(mel, config.audio.sample_rate as f32),
        "audio.mel.mean" => [vec![-4.0; mel.bands], vec![0.0; mel.bands * mel.deltas]].concat(),
        _ => [vec![0.4; mel.bands], vec![1.5; mel.bands * mel.deltas]].concat(),
    }
}

/// Returns triangular filters with corners equally spaced on the mel scale `2595 log10(1 + hz / 700)`.
#[expect(clippy::cast_precision_loss, reason = "band and bin numbers are far below 2^24")]
fn filters(mel: &Mel, sample_rate: f32) -> Vec<f32> {
    let to_mel = |hz: f32| 2595.0 * (1.0 + hz / 700.0).log10();
    let to_hz = |mel: f32| 700.0 * (10.0_f32.powf(mel / 2595.0) - 1.0);
    let (low, high) = (to_mel(60.0), to_mel(sample_rate / 2.0));
    let corner = |i: usize| to_hz(low + (high - low) * i as f32 / (mel.bands + 1) as f32);
    let bins = mel.fft / 2 + 1;
    let mut weights = Vec::with_capacity(mel.bands * bins);
    for band in 0..mel.bands {
        let (left, center, right) = (corner(band), corner(band + 1), corner(band + 2));
        for bin in 0..bins {
            let hz = bin as f32 * sample_rate / mel.fft as f32;
            let rising = (hz - left) / (center - left);
            let falling = (right - hz) / (right - center);
            weights.push(rising.min(falling).max(0.0));
        }
    }
    weights
}

/// Returns an estimated skeleton of a person of 1.7 m: SMPL-X's parents, rounded offsets.
#[rustfmt::skip]
fn skeleton() -> Skeleton {
    let parents = vec![
        -1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 15, 15, 15,
        20, 25, 26, 20, 28, 29, 20, 31, 32, 20, 34, 35, 20, 37, 38,
        21, 40, 41, 21, 43, 44, 21, 46, 47, 21, 49, 50, 21, 52, 53,
    ];
    let mut offsets_m = vec![
        [0.0, 0.0, 0.0], [0.08, -0.08, 0.0], [-0.08, -0.08, 0.0], [0.0, 0.11, -0.01], [0.03, -0.38, 0.0],
        [-0.03, -0.38, 0.0], [0.0, 0.13, 0.0], [-0.01, -0.40, -0.03], [0.01, -0.40, -0.03], [0.0, 0.05, 0.02],
        [0.03, -0.05, 0.12], [-0.03, -0.05, 0.12], [0.0, 0.21, -0.04], [0.07, 0.11, -0.02], [-0.07, 0.11, -0.02],
        [0.0, 0.09, 0.03], [0.10, 0.04, -0.01], [-0.10, 0.04, -0.01], [0.26, -0.01, -0.02], [-0.26, -0.01, -0.02],
        [0.25, 0.01, 0.0], [-0.25, 0.01, 0.0], [0.0, 0.0, 0.02], [0.03, 0.06, 0.06], [-0.03, 0.06, 0.06],
    ];
    // Index, middle, pinky, ring, thumb: the first joint from the wrist, then two bones along the finger.
    let fingers: [([f32; 3], f32); 5] = [
        ([0.10, -0.01, 0.02], 0.033), ([0.11, 0.0, 0.0], 0.034), ([0.09, -0.02, -0.04], 0.022),
        ([0.10, -0.01, -0.02], 0.030), ([0.04, -0.02, 0.03], 0.031),
    ];
    for side in [1.0, -1.0] {
        for (base, bone) in fingers {
            offsets_m.push([side * base[0], base[1], base[2]]);
            offsets_m.push([side * bone, 0.0, 0.0]);
            offsets_m.push([side * bone * 0.8, 0.0, 0.0]);
        }
    }
    Skeleton { parents, offsets_m }
}
