//! The checks that make a parsed config one that code may rely on.

use super::{AudioKind, Config, FaceKind, Hubert, Mel, Modality, TemplateItem};
use crate::error::LoadError;
use crate::motion::skeleton::{ARKIT_NAMES, JOINTS};
use crate::part::Part;

/// Largest width of any kind.
const MAX_WIDTH: usize = 1 << 16;
/// Most layers of any stack.
const MAX_LAYERS: usize = 256;
/// Most rows of the embedding table.
const MAX_VOCAB: usize = 1 << 22;

/// Most audio tokens of one window.
const MAX_WINDOW_TOKENS: usize = 1 << 14;

type Check = Result<(), LoadError>;

pub(super) fn check(config: &Config) -> Check {
    check_time(config)?;
    check_audio(config)?;
    check_vocab(config)?;
    check_lm(config)?;
    check_interp(config)?;
    check_motion(config)?;
    check_templates(config)?;
    check_sampling(config)?;
    check_skeleton(config)
}

/// `low <= value <= high`, or the error that names `key`.
fn range(key: &str, value: usize, low: usize, high: usize) -> Check {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    Err(LoadError::config(key, format!("expected {low} to {high}, got {value}")))
}

fn require(ok: bool, key: &str, problem: impl FnOnce() -> String) -> Check {
    if ok { Ok(()) } else { Err(LoadError::config(key, problem())) }
}

/// `0 < value < 1`, as an epsilon or a floor must be.
fn small(key: &str, value: f32) -> Check {
    require(value > 0.0 && value < 1.0, key, || format!("expected a number between 0 and 1, got {value}"))
}

fn check_time(c: &Config) -> Check {
    range("frame_rate", c.frame_rate, 1, 240)?;
    range("keyframe_stride", c.keyframe_stride, 1, 240)?;
    range("prefix", c.prefix, 1, 256)?;
    range("max_target", c.max_target, 1, c.prefix)?;
    range("target", c.target, 1, c.max_target)?;
    range("lookahead", c.lookahead, 0, c.keyframe_stride * c.prefix)?;
    range("vq.codes", c.vq.codes, 1, MAX_WIDTH - 1)
}

fn check_audio(c: &Config) -> Check {
    range("audio.sample_rate", c.audio.sample_rate, 1000, 192_000)?;
    range("audio.token_rate", c.audio.token_rate, 1, 1000)?;
    range("audio.units", c.audio.units, 1, MAX_WIDTH)?;
    require(c.audio.sample_rate.is_multiple_of(c.audio.token_rate), "audio.token_rate", || {
        format!("expected a divisor of the sample rate {}, got {}", c.audio.sample_rate, c.audio.token_rate)
    })?;
    let tokens = c.keyframe_stride * c.audio.token_rate;
    require(tokens >= c.frame_rate && tokens.is_multiple_of(c.frame_rate), "keyframe_stride", || {
        format!(
            "{} frames at {} a second are no whole number of audio tokens at {} a second",
            c.keyframe_stride, c.frame_rate, c.audio.token_rate
        )
    })?;
    range("keyframe_stride", c.tokens_per_keyframe() * (c.prefix + c.max_target), 1, MAX_WINDOW_TOKENS)?;
    match c.audio.kind {
        AudioKind::Hubert => {
            let hubert = c.audio.hubert.as_ref();
            check_hubert(
                hubert.ok_or_else(|| LoadError::config("audio.hubert", "missing, and `audio.kind` is hubert"))?,
                c.hop(),
            )
        }
        AudioKind::Mel => {
            let mel = c.audio.mel.as_ref();
            check_mel(mel.ok_or_else(|| LoadError::config("audio.mel", "missing, and `audio.kind` is mel"))?, c.hop())
        }
    }
}

fn check_hubert(h: &Hubert, hop: usize) -> Check {
    let layers = h.conv_dim.len();
    range("audio.hubert.conv_dim", layers, 1, 32)?;
    require(h.conv_kernel.len() == layers, "audio.hubert.conv_kernel", || {
        format!("expected {layers} numbers as in conv_dim, got {}", h.conv_kernel.len())
    })?;
    require(h.conv_stride.len() == layers, "audio.hubert.conv_stride", || {
        format!("expected {layers} numbers as in conv_dim, got {}", h.conv_stride.len())
    })?;
    for ((&dim, &kernel), &stride) in h.conv_dim.iter().zip(&h.conv_kernel).zip(&h.conv_stride) {
        range("audio.hubert.conv_dim", dim, 1, MAX_WIDTH)?;
        range("audio.hubert.conv_kernel", kernel, 1, 64)?;
        range("audio.hubert.conv_stride", stride, 1, kernel)?;
    }
    let step = h.conv_stride.iter().fold(1_usize, |a, &b| a.saturating_mul(b));
    require(step == hop, "audio.hubert.conv_stride", || {
        format!("expected steps whose product is the {hop} samples of one token, got {step}")
    })?;
    require(h.receptive_field() <= 2 * hop, "audio.hubert.conv_kernel", || {
        format!("expected a receptive field of at most {} samples, got {}", 2 * hop, h.receptive_field())
    })?;
    range("audio.hubert.hidden_size", h.hidden_size, 1, MAX_WIDTH)?;
    range("audio.hubert.intermediate_size", h.intermediate_size, 1, MAX_WIDTH)?;
    range("audio.hubert.num_attention_heads", h.num_attention_heads, 1, h.hidden_size)?;
    divides("audio.hubert.num_attention_heads", h.num_attention_heads, h.hidden_size)?;
    range("audio.hubert.num_hidden_layers", h.num_hidden_layers, 1, MAX_LAYERS)?;
    range("audio.hubert.num_conv_pos_embeddings", h.num_conv_pos_embeddings, 1, 1024)?;
    range("audio.hubert.num_conv_pos_embedding_groups", h.num_conv_pos_embedding_groups, 1, h.hidden_size)?;
    divides("audio.hubert.num_conv_pos_embedding_groups", h.num_conv_pos_embedding_groups, h.hidden_size)?;
    small("audio.hubert.layer_norm_eps", h.layer_norm_eps)
}

fn divides(key: &str, divisor: usize, value: usize) -> Check {
    require(value.is_multiple_of(divisor), key, || format!("expected a divisor of {value}, got {divisor}"))
}

fn check_mel(m: &Mel, hop: usize) -> Check {
    range("audio.mel.window", m.window, hop, 2 * hop)?;
    range("audio.mel.fft", m.fft, m.window, MAX_WIDTH)?;
    range("audio.mel.bands", m.bands, 1, 1024)?;
    range("audio.mel.deltas", m.deltas, 0, 3)?;
    if let Some(network) = &m.network {
        range("audio.mel.network.taps", network.taps, 1, 64)?;
        let layers = network.widths.len();
        require((1..=8).contains(&layers), "audio.mel.network.widths", || {
            format!("expected 1 to 8 layers, got {layers}")
        })?;
        network.widths.iter().try_for_each(|&width| range("audio.mel.network.widths", width, 1, 4096))?;
    }
    small("audio.mel.floor", m.floor)
}

fn check_vocab(c: &Config) -> Check {
    let v = &c.vocab;
    range("vocab.size", v.size, 1, MAX_VOCAB)?;
    for (key, id) in [("vocab.pad", v.pad), ("vocab.eos", v.eos), ("vocab.decoder_start", v.decoder_start)] {
        range(key, id, 0, v.size - 1)?;
    }
    for part in Part::ALL {
        check_modality(part.name(), &v[part], c.vq.codes, v.size)?;
    }
    check_modality("audio", &v.audio, c.audio.units, v.size)
}

fn check_modality(name: &str, m: &Modality, codes: usize, size: usize) -> Check {
    require(m.codes == codes, &format!("vocab.{name}.codes"), || format!("expected {codes}, got {}", m.codes))?;
    let last = m.first.saturating_add(m.codes - 1);
    require(last < size, &format!("vocab.{name}.first"), || {
        format!("{} codes from id {} on end beyond the vocabulary of {size}", m.codes, m.first)
    })?;
    for (key, id) in [("start", m.start), ("end", m.end), ("mask", m.mask)] {
        range(&format!("vocab.{name}.{key}"), id, 0, size - 1)?;
    }
    Ok(())
}

fn check_lm(c: &Config) -> Check {
    let lm = &c.lm;
    range("lm.d_model", lm.d_model, 1, MAX_WIDTH)?;
    range("lm.d_kv", lm.d_kv, 1, 1024)?;
    range("lm.d_ff", lm.d_ff, 1, MAX_WIDTH)?;
    range("lm.num_heads", lm.num_heads, 1, 1024)?;
    range("lm.num_heads", lm.num_heads * lm.d_kv, 1, MAX_WIDTH)?;
    range("lm.num_layers", lm.num_layers, 1, MAX_LAYERS)?;
    range("lm.num_decoder_layers", lm.num_decoder_layers, 1, MAX_LAYERS)?;
    range("lm.relative_attention_num_buckets", lm.relative_attention_num_buckets, 4, 4096)?;
    let distance = lm.relative_attention_max_distance;
    range("lm.relative_attention_max_distance", distance, lm.relative_attention_num_buckets / 2 + 1, 1 << 20)?;
    small("lm.layer_norm_epsilon", lm.layer_norm_epsilon)?;
    require(lm.feed_forward_proj == "gated-gelu", "lm.feed_forward_proj", || {
        format!("expected \"gated-gelu\", got {:?}", lm.feed_forward_proj)
    })?;
    range("lm.experts", lm.experts, 1, umo_kernels::experts::MAX_EXPERTS)?;
    range("lm.top_k", lm.top_k, 1, lm.experts)
}

fn check_interp(c: &Config) -> Check {
    let i = &c.interp;
    range("interp.d_model", i.d_model, 1, MAX_WIDTH)?;
    range("interp.num_heads", i.num_heads, 1, i.d_model)?;
    divides("interp.num_heads", i.num_heads, i.d_model)?;
    range("interp.d_ff", i.d_ff, 1, MAX_WIDTH)?;
    range("interp.temporal_layers", i.temporal_layers, 1, MAX_LAYERS)?;
    range("interp.part_layers", i.part_layers, 0, MAX_LAYERS)?;
    range("interp.max_frames", i.max_frames, c.keyframe_stride * (c.prefix + c.max_target - 1) + 1, MAX_WIDTH)
}

fn check_motion(c: &Config) -> Check {
    range("vq.width", c.vq.width, 1, MAX_WIDTH)?;
    let names = c.face.names.len();
    range("face.names", names, 0, 4096)?;
    if c.face.kind == FaceKind::Arkit {
        let mut given: Vec<&str> = c.face.names.iter().map(String::as_str).collect();
        let mut wanted = ARKIT_NAMES.to_vec();
        given.sort_unstable();
        wanted.sort_unstable();
        require(given == wanted, "face.names", || {
            format!("expected the 52 ARKit blendshape names, got {names} names{}", first_unknown(&c.face.names))
        })?;
    }
    let sizes = [
        ("vq.face", c.vq.face, 6 + names),
        ("vq.hands", c.vq.hands, 180),
        ("vq.upper", c.vq.upper, 78),
        ("vq.lower", c.vq.lower, 61),
        ("vq.root", c.vq.root, 61),
    ];
    for (key, codec, channels) in sizes {
        range(&format!("{key}.channels"), codec.channels, channels, channels)?;
        range(&format!("{key}.layers"), codec.layers, 1, 16)?;
    }
    for part in Part::ALL {
        range(&format!("rest.{}", part.name()), c.rest[part], 0, c.vq.codes - 1)?;
    }
    Ok(())
}

fn first_unknown(names: &[String]) -> String {
    let unknown = names.iter().find(|name| !ARKIT_NAMES.contains(&name.as_str()));
    unknown.map_or_else(String::new, |name| format!(" with {name:?} among them"))
}

fn check_templates(c: &Config) -> Check {
    require(!c.templates.is_empty(), "templates", || "expected at least one template".to_owned())?;
    for (name, items) in &c.templates {
        let key = format!("templates.{name}");
        range(&key, items.len(), 1, 4096)?;
        for (i, item) in items.iter().enumerate() {
            match item {
                TemplateItem::Id(id) => range(&format!("{key}[{i}]"), *id, 0, c.vocab.size - 1)?,
                TemplateItem::Name(what) => {
                    let known = what == "audio" || what == "text" || Part::ALL.iter().any(|part| part.name() == what);
                    require(known, &format!("{key}[{i}]"), || {
                        format!("expected a token id, \"audio\", \"text\" or a part, got {what:?}")
                    })?;
                    let twice = items[..i].contains(item);
                    require(!twice, &format!("{key}[{i}]"), || format!("{what:?} appears a second time"))?;
                }
            }
        }
    }
    Ok(())
}

fn check_sampling(c: &Config) -> Check {
    let s = &c.sampling;
    require((0.0..=100.0).contains(&s.temperature), "sampling.temperature", || {
        format!("expected 0 to 100, got {}", s.temperature)
    })?;
    require(s.top_p > 0.0 && s.top_p <= 1.0, "sampling.top_p", || {
        format!("expected more than 0 and at most 1, got {}", s.top_p)
    })
}

fn check_skeleton(c: &Config) -> Check {
    let (parents, offsets) = (&c.skeleton.parents, &c.skeleton.offsets_m);
    range("skeleton.parents", parents.len(), JOINTS, JOINTS)?;
    range("skeleton.offsets_m", offsets.len(), JOINTS, JOINTS)?;
    require(parents[0] == -1, "skeleton.parents[0]", || format!("expected -1, got {}", parents[0]))?;
    for (joint, &parent) in parents.iter().enumerate().skip(1) {
        let ok = usize::try_from(parent).is_ok_and(|parent| parent < joint);
        require(ok, &format!("skeleton.parents[{joint}]"), || format!("expected 0 to {}, got {parent}", joint - 1))?;
    }
    let finite = offsets.iter().flatten().all(|v| v.is_finite() && v.abs() < 1000.0);
    require(finite, "skeleton.offsets_m", || "expected metres below 1000".to_owned())
}
