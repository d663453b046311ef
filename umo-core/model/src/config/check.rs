//! Validation of a parsed config.

use std::ops::Range;

use umo_core_base::error::LoadError;
use umo_core_pose::names::{ARKIT_NAMES, JOINTS};
use umo_core_pose::part::Part;

use super::{
    AudioKind, Codec, Config, FaceKind, Hubert, Mel, Modality, Mouth, PartSpec, Sampling, TemplateItem, channel_names,
    no_rest,
};

/// Upper bound of every width.
const MAX_WIDTH: usize = 1 << 16;
/// Upper bound of layers in a stack.
const MAX_LAYERS: usize = 256;
/// Upper bound of rows of the embedding table.
const MAX_VOCAB: usize = 1 << 22;

/// Upper bounds of the parts of a list, and of the codes of a keyframe.
pub(crate) const MAX_PARTS: usize = 64;
const MAX_KEYFRAME_CODES: usize = 1024;
/// Upper bound of face channels after the jaw's.
const MAX_FACE_NAMES: usize = 4096;
/// Upper bound of a part's levels.
const MAX_LEVELS: usize = 16;
/// Upper bound of codes per level: a code of a part list fits a byte.
const MAX_LEVEL_CODES: usize = 256;

/// Upper bound of the live mouth's window and width.
const MAX_MOUTH: usize = 1 << 12;
/// Upper bound of audio tokens in a window.
const MAX_WINDOW_TOKENS: usize = 1 << 14;

type Check = Result<(), LoadError>;

pub(super) fn check(config: &Config) -> Check {
    check_time(config)?;
    check_layout(config)?;
    check_audio(config)?;
    check_vocab(config)?;
    check_lm(config)?;
    check_interp(config)?;
    check_motion(config)?;
    config.mouth.as_ref().map_or(Ok(()), |mouth| check_mouth(config, mouth))?;
    check_templates(config)?;
    check_sampling(config)?;
    check_skeleton(config)
}

/// Checks `low <= value <= high`; the error names `key`.
fn range(key: &str, value: usize, low: usize, high: usize) -> Check {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    Err(LoadError::config(key, format!("expected {low} to {high}, got {value}")))
}

fn require(ok: bool, key: &str, problem: impl FnOnce() -> String) -> Check {
    if ok { Ok(()) } else { Err(LoadError::config(key, problem())) }
}

/// Checks `0 < value < 1`, for an epsilon or a floor.
fn small(key: &str, value: f32) -> Check {
    require(value > 0.0 && value < 1.0, key, || format!("expected a number between 0 and 1, got {value}"))
}

fn check_time(c: &Config) -> Check {
    range("frame_rate", c.frame_rate, 1, 240)?;
    range("keyframe_stride", c.keyframe_stride, 1, 240)?;
    range("prefix", c.prefix, 1, 256)?;
    range("max_target", c.max_target, 1, c.prefix)?;
    range("target", c.target, 1, c.max_target)?;
    range("lookahead", c.lookahead, 0, c.keyframe_stride * c.prefix)
}

/// Checks which keys a layout and a part list require, and which have no meaning with them.
fn check_layout(c: &Config) -> Check {
    let frames = c.is_frames();
    presence("depth", c.depth.is_some(), frames, "layout \"frames\"")?;
    for part in Part::ALL {
        let name = part.name();
        presence(&format!("vocab.{name}"), !c.vocab[part].is_absent(), !frames, "layout \"parts\"")?;
        let codec = !c.vq[part].is_absent();
        presence(&format!("vq.{name}"), codec, c.parts.is_none(), "a model without `parts`")?;
    }
    presence("rest", c.rest != no_rest(), c.parts.is_none(), "a model without `parts`")?;
    match &c.parts {
        None => range("vq.codes", c.vq.codes, 1, if frames { MAX_LEVEL_CODES } else { MAX_WIDTH - 1 }),
        Some(parts) => {
            presence("vq.codes", c.vq.codes != 0, false, "a model without `parts`")?;
            check_parts(c, parts)?;
            if frames { Ok(()) } else { check_four(c, parts) }
        }
    }
}

/// Checks that layout `parts` has the paper's four parts, whose codes are tokens.
fn check_four(c: &Config, parts: &[PartSpec]) -> Check {
    let names = || parts.iter().map(|part| part.name.as_str());
    require(names().eq(Part::ALL.map(Part::name)), "parts", || {
        let got = names().collect::<Vec<_>>().join(", ");
        format!("layout \"parts\" has face, hands, upper and lower in this order, got {got}; \"frames\" has any")
    })?;
    for (i, part) in parts.iter().enumerate() {
        let key = |what: &str| format!("parts[{i}].{what}");
        require(part.levels == 1, &key("levels"), || {
            format!("expected 1 in layout \"parts\", got {}; \"frames\" has levels", part.levels)
        })?;
        require(part.codes == parts[0].codes, &key("codes"), || {
            format!("expected {} as {} has, got {}", parts[0].codes, parts[0].name, part.codes)
        })?;
        let its_own = part.channels(&c.face).is_some_and(|channels| channels.part.name() == part.name);
        require(its_own, &key("channels"), || {
            format!("expected all channels of {} and no others in layout \"parts\"", part.name)
        })?;
    }
    Ok(())
}

/// Checks that a key is present if and only if `wanted`.
fn presence(key: &str, there: bool, wanted: bool, of: &str) -> Check {
    require(there == wanted, key, || {
        if wanted { format!("missing, and required in {of}") } else { format!("expected none: it is a key of {of}") }
    })
}

fn check_parts(c: &Config, parts: &[PartSpec]) -> Check {
    range("parts", parts.len(), 1, MAX_PARTS)?;
    range("face.names", c.face.names.len(), 0, MAX_FACE_NAMES)?;
    let mut owners: Vec<(Part, Range<usize>, &str)> = Vec::new();
    for (i, part) in parts.iter().enumerate() {
        let key = |what: &str| format!("parts[{i}].{what}");
        let letters = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
        let name = &part.name;
        let good = (1..=32).contains(&name.len()) && name.chars().all(letters) && name != "root";
        require(good, &key("name"), || {
            format!("expected 1 to 32 lowercase letters, digits and _, and not \"root\", got {name:?}")
        })?;
        require(parts[..i].iter().all(|other| other.name != *name), &key("name"), || {
            format!("{name:?} appears a second time")
        })?;
        range(&key("codes"), part.codes, 1, MAX_LEVEL_CODES)?;
        range(&key("levels"), part.levels, 1, MAX_LEVELS)?;
        range(&key("rest"), part.rest.len(), part.levels, part.levels)?;
        part.rest.iter().try_for_each(|&code| range(&key("rest"), code, 0, part.codes - 1))?;
        if let Some(sampling) = part.sampling {
            check_draws(&key("sampling"), sampling)?;
        }
        if part.is_annotation() {
            range(&key("width"), part.width, 0, 0)?;
            range(&key("layers"), part.layers, 0, 0)?;
            continue;
        }
        range(&key("width"), part.width, 1, MAX_WIDTH)?;
        range(&key("layers"), part.layers, 1, 16)?;
        let known = |name: &String| {
            Part::ALL.into_iter().any(|part| channel_names(part, &c.face).iter().any(|(known, _)| known == name))
        };
        if let Some(unknown) = part.channels.iter().find(|name| !known(name)) {
            return Err(LoadError::config(key("channels"), format!("there is no channel {unknown:?}")));
        }
        let channels = part.channels(&c.face).ok_or_else(|| {
            LoadError::config(key("channels"), "expected channels of one of face, hands, upper and lower, got several")
        })?;
        for (range, channel) in channels.ranges.into_iter().zip(&part.channels) {
            let twice = owners.iter().any(|(part, other, _)| *part == channels.part && *other == range);
            require(!twice, &key("channels"), || format!("{channel:?} appears a second time"))?;
            owners.push((channels.part, range, channel));
        }
    }
    for part in Part::ALL {
        for (name, range) in channel_names(part, &c.face) {
            let owned = owners.iter().any(|(owner, at, _)| *owner == part && *at == range);
            require(owned, "parts", || format!("no part has the channel {name:?}"))?;
        }
    }
    let codes: usize = parts.iter().map(|part| part.levels).sum();
    require(codes <= MAX_KEYFRAME_CODES, "parts", || {
        format!("expected at most {MAX_KEYFRAME_CODES} codes of a keyframe, got {codes}")
    })
}

fn check_audio(c: &Config) -> Check {
    range("audio.sample_rate", c.audio.sample_rate, 1000, 192_000)?;
    range("audio.token_rate", c.audio.token_rate, 1, 1000)?;
    range("audio.units", c.audio.units, 1, MAX_WIDTH)?;
    range("audio.ahead", c.audio.ahead, 0, if c.is_frames() { c.prefix } else { 0 })?;
    if let Some(accents) = c.audio.accents {
        range("audio.accents.first", accents.first, 1, c.audio.units - 1)?;
        range("audio.accents.delay", accents.delay, 0, c.audio.token_rate)?;
    }
    require(c.audio.sample_rate.is_multiple_of(c.audio.token_rate), "audio.token_rate", || {
        format!("expected a divisor of the sample rate {}, got {}", c.audio.sample_rate, c.audio.token_rate)
    })?;
    let tokens = c.keyframe_stride * c.audio.token_rate;
    require(tokens >= c.frame_rate && tokens.is_multiple_of(c.frame_rate), "keyframe_stride", || {
        format!(
            "{} frames at {} a second are not a whole number of audio tokens at {} a second",
            c.keyframe_stride, c.frame_rate, c.audio.token_rate
        )
    })?;
    range(
        "keyframe_stride",
        c.tokens_per_keyframe() * (c.prefix + c.max_target + c.audio.ahead),
        1,
        MAX_WINDOW_TOKENS,
    )?;
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

fn even(key: &str, value: usize) -> Check {
    require(value.is_multiple_of(2), key, || format!("expected an even number, got {value}"))
}

fn check_mel(m: &Mel, hop: usize) -> Check {
    range("audio.mel.window", m.window, hop, 2 * hop)?;
    range("audio.mel.fft", m.fft, m.window, MAX_WIDTH)?;
    even("audio.mel.fft", m.fft)?;
    range("audio.mel.bands", m.bands, 1, 1024)?;
    range("audio.mel.deltas", m.deltas, 0, 3)?;
    if let Some(network) = &m.network {
        range("audio.mel.network.taps", network.taps, 1, 64)?;
        let layers = network.widths.len();
        require((1..=8).contains(&layers), "audio.mel.network.widths", || {
            format!("expected 1 to 8 layers, got {layers}")
        })?;
        network.widths.iter().try_for_each(|&width| range("audio.mel.network.widths", width, 1, 4096))?;
        if let Some(blocks) = network.blocks {
            require(layers > 1, "audio.mel.network.widths", || "expected a layer behind the blocks".to_owned())?;
            range("audio.mel.network.blocks.kernel", blocks.kernel, 1, 64)?;
            range("audio.mel.network.blocks.count", blocks.count, 1, 64)?;
        }
    }
    small("audio.mel.floor", m.floor)
}

fn check_mouth(c: &Config, m: &Mouth) -> Check {
    range("mouth.window", m.window, 1, MAX_MOUTH)?;
    range("mouth.fft", m.fft, m.window, MAX_WIDTH)?;
    even("mouth.fft", m.fft)?;
    range("mouth.bands", m.bands, 1, 1024)?;
    small("mouth.floor", m.floor)?;
    range("mouth.rows", m.rows, 1, (c.audio.sample_rate / c.frame_rate).min(64))?;
    range("mouth.ahead", m.ahead, 1, 64)?;
    range("mouth.taps", m.taps, 1, 64)?;
    range("mouth.width", m.width, 1, MAX_MOUTH)?;
    range("mouth.kernel", m.kernel, 1, 16)?;
    let blocks = m.dilations.len();
    require(blocks <= 16, "mouth.dilations", || format!("expected at most 16 blocks, got {blocks}"))?;
    m.dilations.iter().try_for_each(|&dilation| range("mouth.dilations", dilation, 1, 256))?;
    range("mouth.behind", m.behind, 0, 64)?;
    require(c.face.kind == FaceKind::Arkit, "mouth", || "expected a face of kind arkit".to_owned())?;
    require(!m.channels.is_empty(), "mouth.channels", || "expected at least one name".to_owned())?;
    for (i, name) in m.channels.iter().enumerate() {
        require(c.face.names.contains(name), "mouth.channels", || format!("`{name}` is not in `face.names`"))?;
        require(!m.channels[..i].contains(name), "mouth.channels", || format!("`{name}` is listed twice"))?;
    }
    Ok(())
}

fn check_vocab(c: &Config) -> Check {
    let v = &c.vocab;
    range("vocab.size", v.size, 1, MAX_VOCAB)?;
    for (key, id) in [("vocab.pad", v.pad), ("vocab.eos", v.eos), ("vocab.decoder_start", v.decoder_start)] {
        range(key, id, 0, v.size - 1)?;
    }
    for part in Part::ALL.into_iter().filter(|_| !c.is_frames()) {
        check_modality(part.name(), &v[part], c.part_codes(), v.size)?;
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
    range("lm.top_k", lm.top_k, 1, lm.experts)?;
    let Some(depth) = &c.depth else { return Ok(()) };
    range("depth.d_model", depth.d_model, 1, 4096)?;
    range("depth.num_heads", depth.num_heads, 1, depth.d_model)?;
    divides("depth.num_heads", depth.num_heads, depth.d_model)?;
    range("depth.d_ff", depth.d_ff, 1, MAX_WIDTH)?;
    range("depth.num_layers", depth.num_layers, 1, MAX_LAYERS)?;
    if let Some(heard) = depth.heard {
        range("depth.heard", heard, 0, c.tokens_per_keyframe() - 1)?;
    }
    if let Some(heard) = depth.body_heard {
        require(depth.heard.is_some(), "depth.body_heard", || "expected depth.heard beside it".to_owned())?;
        range("depth.body_heard", heard, 0, (1 + c.audio.ahead) * c.tokens_per_keyframe() - 1)?;
    }
    small("depth.layer_norm_epsilon", depth.layer_norm_epsilon)
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
    range("face.names", names, 0, MAX_FACE_NAMES)?;
    if c.face.kind == FaceKind::Arkit {
        let mut given: Vec<&str> = c.face.names.iter().map(String::as_str).collect();
        let mut wanted = ARKIT_NAMES.to_vec();
        given.sort_unstable();
        wanted.sort_unstable();
        require(given == wanted, "face.names", || {
            format!("expected the 52 ARKit blendshape names, got {names} names{}", first_unknown(&c.face.names))
        })?;
    }
    if c.parts.is_some() {
        return check_codec("vq.root", c.vq.root, 61);
    }
    let sizes = [
        ("vq.face", c.vq.face, 6 + names),
        ("vq.hands", c.vq.hands, 180),
        ("vq.upper", c.vq.upper, 78),
        ("vq.lower", c.vq.lower, 61),
        ("vq.root", c.vq.root, 61),
    ];
    for (key, codec, channels) in sizes {
        check_codec(key, codec, channels)?;
    }
    for part in Part::ALL {
        range(&format!("rest.{}", part.name()), c.rest[part], 0, c.vq.codes - 1)?;
    }
    Ok(())
}

fn check_codec(key: &str, codec: Codec, channels: usize) -> Check {
    range(&format!("{key}.channels"), codec.channels, channels, channels)?;
    range(&format!("{key}.layers"), codec.layers, 1, 16)
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
                    let history = match c.is_frames() {
                        true => what == "history",
                        false => Part::ALL.iter().any(|part| part.name() == what),
                    };
                    require(what == "audio" || what == "text" || history, &format!("{key}[{i}]"), || {
                        let history = if c.is_frames() { "\"history\"" } else { "a part" };
                        format!("expected a token id, \"audio\", \"text\" or {history}, got {what:?}")
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
    check_draws("sampling", c.sampling)
}

fn check_draws(key: &str, s: Sampling) -> Check {
    require((0.0..=100.0).contains(&s.temperature), &format!("{key}.temperature"), || {
        format!("expected 0 to 100, got {}", s.temperature)
    })?;
    require(s.top_p > 0.0 && s.top_p <= 1.0, &format!("{key}.top_p"), || {
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
