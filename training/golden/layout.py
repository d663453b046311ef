"""The contents of a model file: `config`, and the shape of every tensor that follows from it."""

from typing import Any

import skeleton

Config = dict[str, Any]
Shapes = dict[str, tuple[int, ...]]

PARTS = ("face", "hands", "upper", "lower")
CODES = 256
MASK = 256

# In Apple's order, as in ARFaceAnchor.BlendShapeLocation, from eyes to tongue.
ARKIT = (
    "eyeBlinkLeft eyeLookDownLeft eyeLookInLeft eyeLookOutLeft eyeLookUpLeft eyeSquintLeft eyeWideLeft "
    "eyeBlinkRight eyeLookDownRight eyeLookInRight eyeLookOutRight eyeLookUpRight eyeSquintRight eyeWideRight "
    "jawForward jawLeft jawRight jawOpen mouthClose mouthFunnel mouthPucker mouthLeft mouthRight "
    "mouthSmileLeft mouthSmileRight mouthFrownLeft mouthFrownRight mouthDimpleLeft mouthDimpleRight "
    "mouthStretchLeft mouthStretchRight mouthRollLower mouthRollUpper mouthShrugLower mouthShrugUpper "
    "mouthPressLeft mouthPressRight mouthLowerDownLeft mouthLowerDownRight mouthUpperUpLeft mouthUpperUpRight "
    "browDownLeft browDownRight browInnerUp browOuterUpLeft browOuterUpRight cheekPuff "
    "cheekSquintLeft cheekSquintRight noseSneerLeft noseSneerRight tongueOut"
).split()
assert len(ARKIT) == 52


def moving(config: Config) -> list[Config]:
    """The parts of layout `frames` that have channels."""
    return [part for part in config["parts"] if part["channels"]]


def channel_count(config: Config, part: Config) -> int:
    """Channels of a part of layout `frames`: a joint's rotation has 6, a face channel 1."""
    widths = {"root_velocity": 3, "contacts": 4} | dict.fromkeys(config["face"]["names"], 1)
    return sum(widths.get(name, 6) for name in part["channels"])


def is_frames(config: Config) -> bool:
    """Whether decoder positions are keyframes."""
    return config.get("layout") == "frames"


def vocabulary(text: int, units: int, parts: tuple[str, ...] = PARTS) -> Config:
    """Text ids, 3 motion ids, 259 for each part, then the audio units, 2 unused ids and 3 markers."""
    vocab: Config = {"size": 0, "pad": 0, "eos": 1, "decoder_start": 0}
    first = text + 3
    for name, codes, unused in (*((part, CODES, 0) for part in parts), ("audio", units, 2)):
        start = first + codes + unused
        vocab[name] = {"first": first, "codes": codes, "start": start, "end": start + 1, "mask": start + 2}
        first = start + 3
    vocab["size"] = first
    return vocab


def face(expressions: int | None) -> Config:
    """SMPL-X expression coefficients, or ARKit's 52 if no number is given."""
    if expressions is None:
        return {"kind": "arkit", "names": list(ARKIT)}
    return {"kind": "smplx_expression", "names": [f"expression_{i}" for i in range(expressions)]}


def motion(width: int, names: int, layers: tuple[int, int, int, int, int]) -> Config:
    """`config.vq`; `layers` in the order of the parts, then the root network."""
    channels = (6 + names, skeleton.HANDS_CHANNELS, skeleton.UPPER_CHANNELS, *[skeleton.LOWER_CHANNELS] * 2)
    vq: Config = {"codes": CODES, "width": width}
    for name, channel, layer in zip((*PARTS, "root"), channels, layers, strict=True):
        vq[name] = {"channels": channel, "layers": layer}
    return vq


def feature_width(config: Config) -> int:
    """Width of the audio features that are the input of k-means."""
    audio = config["audio"]
    if audio["kind"] == "hubert":
        return int(audio["hubert"]["hidden_size"])
    network = audio["mel"].get("network")
    return int(network["widths"][-1]) if network else bands_width(config)


def bands_width(config: Config) -> int:
    """Width of log-mel features."""
    mel = config["audio"]["mel"]
    return int(mel["bands"] * (1 + mel["deltas"]))


def shapes(config: Config, *, encoders: bool) -> Shapes:
    """Every float tensor of a model file, by name."""
    audio = hubert_shapes(config) if config["audio"]["kind"] == "hubert" else mel_shapes(config)
    units = (config["audio"]["units"], feature_width(config))
    return {
        **audio,
        "audio.kmeans.centroids": units,
        **lm_shapes(config),
        **(depth_shapes(config) if is_frames(config) else {}),
        **interp_shapes(config),
        **motion_shapes(config, encoders=encoders),
        **(mouth_shapes(config["mouth"]) if "mouth" in config else {}),
    }


def _affine(name: str, *shape: int) -> Shapes:
    return {f"{name}.weight": shape, f"{name}.bias": shape[:1]}


def hubert_shapes(config: Config) -> Shapes:
    h = config["audio"]["hubert"]
    hidden, ffn = h["hidden_size"], h["intermediate_size"]
    out: Shapes = {}
    before = 1
    for i, (dim, kernel) in enumerate(zip(h["conv_dim"], h["conv_kernel"], strict=True)):
        out[f"feature_extractor.conv_layers.{i}.conv.weight"] = (dim, before, kernel)
        before = dim
    out |= _affine("feature_extractor.conv_layers.0.layer_norm", h["conv_dim"][0])
    out |= _affine("feature_projection.layer_norm", before)
    out |= _affine("feature_projection.projection", hidden, before)
    per_group = hidden // h["num_conv_pos_embedding_groups"]
    out |= _affine("encoder.pos_conv_embed.conv", hidden, per_group, h["num_conv_pos_embeddings"])
    out |= _affine("encoder.layer_norm", hidden)
    for i in range(h["num_hidden_layers"]):
        layer = f"encoder.layers.{i}"
        for projection in ("k_proj", "v_proj", "q_proj", "out_proj"):
            out |= _affine(f"{layer}.attention.{projection}", hidden, hidden)
        out |= _affine(f"{layer}.layer_norm", hidden)
        out |= _affine(f"{layer}.feed_forward.intermediate_dense", ffn, hidden)
        out |= _affine(f"{layer}.feed_forward.output_dense", hidden, ffn)
        out |= _affine(f"{layer}.final_layer_norm", hidden)
    return {f"audio.hubert.{name}": shape for name, shape in out.items()}


def mel_shapes(config: Config) -> Shapes:
    mel = config["audio"]["mel"]
    width = bands_width(config)
    out: Shapes = {
        "audio.mel.window.weight": (mel["window"],),
        "audio.mel.filters.weight": (mel["bands"], mel["fft"] // 2 + 1),
        "audio.mel.mean": (width,),
        "audio.mel.scale": (width,),
    }
    network = mel.get("network", {"taps": 1, "widths": []})
    before = network["taps"] * width
    for i, outputs in enumerate(network["widths"]):
        out |= _affine(f"audio.mel.network.{i}", outputs, before)
        before = outputs
    blocks, width = network.get("blocks", {"count": 0}), network["widths"][0] if network["widths"] else 0
    for i in range(blocks["count"]):
        out |= _affine(f"audio.mel.network.blocks.{i}.0", width, width, blocks["kernel"])
        out |= _affine(f"audio.mel.network.blocks.{i}.1", width, width, 1)
    return out


def mouth_shapes(mouth: Config) -> Shapes:
    bands, width, channels = mouth["bands"], mouth["width"], len(mouth["channels"])
    out: Shapes = {
        "window.weight": (mouth["window"],),
        "filters.weight": (bands, mouth["fft"] // 2 + 1),
        "mean": (bands + 2,),
        "scale": (bands + 2,),
        "rest": (channels,),
        **_affine("input", width, bands + 2, mouth["taps"]),
        **_affine("head", channels + 1, width, 1),
    }
    for i in range(len(mouth["dilations"])):
        out |= _affine(f"blocks.{i}.0", width, width, mouth["kernel"]) | _affine(f"blocks.{i}.1", width, width, 1)
    return {f"mouth.{name}": shape for name, shape in out.items()}


def lm_shapes(config: Config) -> Shapes:
    lm, vocab = config["lm"], config["vocab"]["size"]
    d, ffn, inner = lm["d_model"], lm["d_ff"], lm["num_heads"] * lm["d_kv"]
    out: Shapes = {"shared.weight": (vocab, d)}
    if is_frames(config):
        out["frames.type.weight"] = (2, d)
        out |= {f"frames.embed.{part['name']}.weight": (_codes(part), d) for part in config["parts"]}
    elif not lm["tie_word_embeddings"]:
        out["lm_head.weight"] = (vocab, d)
    for stack, layers in (("encoder", lm["num_layers"]), ("decoder", lm["num_decoder_layers"])):
        attentions = ["SelfAttention"] + (["EncDecAttention"] if stack == "decoder" else [])
        for i in range(layers):
            block = f"{stack}.block.{i}.layer"
            for j, attention in enumerate(attentions):
                for projection in "qkv":
                    out[f"{block}.{j}.{attention}.{projection}.weight"] = (inner, d)
                out[f"{block}.{j}.{attention}.o.weight"] = (d, inner)
                out[f"{block}.{j}.layer_norm.weight"] = (d,)
            last = len(attentions)
            out[f"{block}.{last}.layer_norm.weight"] = (d,)
            out[f"{block}.{last}.moe.router.weight"] = (lm["experts"], d)
            for e in range(lm["experts"]):
                expert = f"{block}.{last}.moe.experts.{e}"
                out[f"{expert}.wi_0.weight"] = out[f"{expert}.wi_1.weight"] = (ffn, d)
                out[f"{expert}.wo.weight"] = (d, ffn)
        bias = f"{stack}.block.0.layer.0.SelfAttention.relative_attention_bias.weight"
        out[bias] = (lm["relative_attention_num_buckets"], lm["num_heads"])
        out[f"{stack}.final_layer_norm.weight"] = (d,)
    return {f"lm.{name}": shape for name, shape in out.items()}


def _codes(part: Config) -> int:
    return int(part["levels"] * part["codes"])


def depth_shapes(config: Config) -> Shapes:
    sizes = config["depth"]
    d, ffn = sizes["d_model"], sizes["d_ff"]
    slots = sum(part["levels"] for part in config["parts"])
    out: Shapes = {"input.weight": (d, config["lm"]["d_model"]), "position.weight": (slots, d), "norm.weight": (d,)}
    if "heard" in sizes:
        out["heard.weight"] = out["input.weight"]
    for i in range(sizes["num_layers"]):
        layer = f"layers.{i}"
        out |= {f"{layer}.attention.{name}.weight": (d, d) for name in "qkvo"}
        out[f"{layer}.attention_norm.weight"] = out[f"{layer}.feed_forward_norm.weight"] = (d,)
        out[f"{layer}.feed_forward.wi_0.weight"] = out[f"{layer}.feed_forward.wi_1.weight"] = (ffn, d)
        out[f"{layer}.feed_forward.wo.weight"] = (d, ffn)
    for part in config["parts"]:
        out[f"embed.{part['name']}.weight"] = out[f"head.{part['name']}.weight"] = (_codes(part), d)
        if sizes.get("before"):
            out[f"before.{part['name']}.weight"] = (_codes(part), d)
    return {f"depth.{name}": shape for name, shape in out.items()}


def interp_shapes(config: Config) -> Shapes:
    interp = config["interp"]
    d, ffn = interp["d_model"], interp["d_ff"]
    out: Shapes = {"frame_type.weight": (3, d), "position.weight": (interp["max_frames"], d)}
    if is_frames(config):
        out["mask.weight"] = (len(moving(config)), d)
        for part in moving(config):
            out |= _affine(f"input.{part['name']}", d, part["width"])
            out |= _affine(f"head.{part['name']}", part["width"], d)
    else:
        for name in PARTS:
            out[f"embed.{name}.weight"] = (CODES + 1, d)
            out |= _affine(f"head.{name}", CODES, d)
    out |= _affine("norm", d)
    for group in ("temporal", "part"):
        for i in range(interp[f"{group}_layers"]):
            layer = f"{group}.{i}"
            out[f"{layer}.self_attn.in_proj_weight"] = (3 * d, d)
            out[f"{layer}.self_attn.in_proj_bias"] = (3 * d,)
            out |= _affine(f"{layer}.self_attn.out_proj", d, d)
            out |= _affine(f"{layer}.linear1", ffn, d)
            out |= _affine(f"{layer}.linear2", d, ffn)
            out |= _affine(f"{layer}.norm1", d) | _affine(f"{layer}.norm2", d)
    return {f"interp.{name}": shape for name, shape in out.items()}


def _residual(name: str, width: int) -> Shapes:
    return _affine(f"{name}.model.0", width, width, 3) | _affine(f"{name}.model.2", width, width, 3)


def _motion_encoder(name: str, width: int, channels: int, layers: int) -> Shapes:
    out: Shapes = {}
    for i in range(layers):
        out |= _affine(f"{name}.{3 * i}", width, channels if i == 0 else width, 3)
        out |= _residual(f"{name}.{3 * i + 2}", width)
    return out


def _motion_decoder(name: str, width: int, channels: int, layers: int) -> Shapes:
    out = _residual(f"{name}.0", width) | _residual(f"{name}.1", width)
    for i in range(layers):
        out |= _affine(f"{name}.{2 + 2 * i}", channels if i == layers - 1 else width, width, 3)
    return out | _affine(f"{name}.{2 + 2 * layers}", channels, channels, 3)


def motion_shapes(config: Config, *, encoders: bool) -> Shapes:
    vq = config["vq"]
    out: Shapes = {}
    parts = {name: (vq["width"], vq[name]["channels"], vq[name]["layers"], CODES) for name in PARTS if name in vq}
    if is_frames(config):
        parts = {
            part["name"]: (part["width"], channel_count(config, part), part["layers"], _codes(part))
            for part in moving(config)
        }
    parts["root"] = (vq["width"], vq["root"]["channels"], vq["root"]["layers"], 0)
    for name, (*sizes, codes) in parts.items():
        out |= _motion_decoder(f"vq.{name}.decoder.main", *sizes)
        if encoders or name == "root":
            out |= _motion_encoder(f"vq.{name}.encoder.main", *sizes)
        if name != "root":
            out[f"vq.{name}.quantizer.embedding.weight"] = (codes, sizes[0])
    return out
