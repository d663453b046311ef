"""Every tensor required by a umo config (docs/model-format.md), by name."""

from collections.abc import Iterator
from typing import Any

from umo_train.skeleton import PARTS

Config = dict[str, Any]
Shapes = dict[str, tuple[int, ...]]

# Tensors that decide a code, an expert or a position stay in full precision; they are small.
_EXACT = (".moe.router.", "relative_attention_bias", "centroids", ".quantizer.", "audio.mel.")


def shapes(config: Config, *, encoders: bool = True) -> Shapes:
    """All tensors and their shapes; `encoders` includes those needed only for tokenising motion."""
    out = audio_shapes(config) | {name: shape for part in (_lm, _interp) for name, shape in part(config)}
    out.update(_codecs(config, encoders))
    out.update(_mouth(config))
    return out


def audio_shapes(config: Config) -> Shapes:
    """Tensors of the audio tokenizer."""
    return dict(_hubert(config) if config["audio"]["kind"] == "hubert" else _mel(config))


def is_weight(name: str, shape: tuple[int, ...]) -> bool:
    """Whether a tensor is a product's weights or a table, which may be stored in fewer bits."""
    return len(shape) > 1 and not any(part in name for part in _EXACT)


Entries = Iterator[tuple[str, tuple[int, ...]]]


def _affine(name: str, *shape: int) -> Entries:
    yield f"{name}.weight", shape
    yield f"{name}.bias", shape[:1]


def _hubert(config: Config) -> Entries:
    h, root = config["audio"]["hubert"], "audio.hubert"
    hidden, before = h["hidden_size"], 1
    for i, (width, kernel) in enumerate(zip(h["conv_dim"], h["conv_kernel"], strict=True)):
        yield f"{root}.feature_extractor.conv_layers.{i}.conv.weight", (width, before, kernel)
        before = width
    yield from _affine(f"{root}.feature_extractor.conv_layers.0.layer_norm", h["conv_dim"][0])
    yield from _affine(f"{root}.feature_projection.layer_norm", before)
    yield from _affine(f"{root}.feature_projection.projection", hidden, before)
    group = hidden // h["num_conv_pos_embedding_groups"]
    yield from _affine(f"{root}.encoder.pos_conv_embed.conv", hidden, group, h["num_conv_pos_embeddings"])
    yield from _affine(f"{root}.encoder.layer_norm", hidden)
    for i in range(h["num_hidden_layers"]):
        layer = f"{root}.encoder.layers.{i}"
        for which in ("k_proj", "v_proj", "q_proj", "out_proj"):
            yield from _affine(f"{layer}.attention.{which}", hidden, hidden)
        yield from _affine(f"{layer}.layer_norm", hidden)
        yield from _affine(f"{layer}.feed_forward.intermediate_dense", h["intermediate_size"], hidden)
        yield from _affine(f"{layer}.feed_forward.output_dense", hidden, h["intermediate_size"])
        yield from _affine(f"{layer}.final_layer_norm", hidden)
    yield "audio.kmeans.centroids", (config["audio"]["units"], hidden)


def _mel(config: Config) -> Entries:
    m = config["audio"]["mel"]
    width = m["bands"] * (1 + m["deltas"])
    yield "audio.mel.window.weight", (m["window"],)
    yield "audio.mel.filters.weight", (m["bands"], m["fft"] // 2 + 1)
    yield "audio.mel.mean", (width,)
    yield "audio.mel.scale", (width,)
    network = m.get("network", {"taps": 1, "widths": []})
    inputs = network["taps"] * width
    for i, outputs in enumerate(network["widths"]):
        yield f"audio.mel.network.{i}.weight", (outputs, inputs)
        yield f"audio.mel.network.{i}.bias", (outputs,)
        inputs = outputs
    if blocks := network.get("blocks"):
        inner = network["widths"][0]
        for i in range(blocks["count"]):
            for j, taps in enumerate((blocks["kernel"], 1)):
                yield f"audio.mel.network.blocks.{i}.{j}.weight", (inner, inner, taps)
                yield f"audio.mel.network.blocks.{i}.{j}.bias", (inner,)
    width = network["widths"][-1] if network["widths"] else width
    yield "audio.kmeans.centroids", (config["audio"]["units"], width)


def _mouth(config: Config) -> Entries:
    """Tensors of the live mouth, if the config has one."""
    m = config.get("mouth")
    if m is None:
        return
    features, width, channels = m["bands"] + 2, m["width"], len(m["channels"])
    yield "mouth.window.weight", (m["window"],)
    yield "mouth.filters.weight", (m["bands"], m["fft"] // 2 + 1)
    yield "mouth.mean", (features,)
    yield "mouth.scale", (features,)
    yield "mouth.rest", (channels,)
    yield from _affine("mouth.input", width, features, m["taps"])
    for i in range(len(m["dilations"])):
        yield from _affine(f"mouth.blocks.{i}.0", width, width, m["kernel"])
        yield from _affine(f"mouth.blocks.{i}.1", width, width, 1)
    yield from _affine("mouth.head", channels + 1, width, 1)


def _lm(config: Config) -> Entries:
    lm, rows = config["lm"], config["vocab"]["size"]
    yield "lm.shared.weight", (rows, lm["d_model"])
    yield from _stack(lm, "encoder", lm["num_layers"], ("SelfAttention",))
    yield from _stack(lm, "decoder", lm["num_decoder_layers"], ("SelfAttention", "EncDecAttention"))
    if not lm["tie_word_embeddings"]:
        yield "lm.lm_head.weight", (rows, lm["d_model"])


def _stack(lm: Config, stack: str, layers: int, attentions: tuple[str, ...]) -> Entries:
    d, inner = lm["d_model"], lm["num_heads"] * lm["d_kv"]
    bias = f"lm.{stack}.block.0.layer.0.SelfAttention.relative_attention_bias.weight"
    yield bias, (lm["relative_attention_num_buckets"], lm["num_heads"])
    for i in range(layers):
        block = f"lm.{stack}.block.{i}.layer"
        for j, attention in enumerate(attentions):
            for which in "qkv":
                yield f"{block}.{j}.{attention}.{which}.weight", (inner, d)
            yield f"{block}.{j}.{attention}.o.weight", (d, inner)
            yield f"{block}.{j}.layer_norm.weight", (d,)
        last = f"{block}.{len(attentions)}"
        yield f"{last}.layer_norm.weight", (d,)
        yield f"{last}.moe.router.weight", (lm["experts"], d)
        for e in range(lm["experts"]):
            for which, shape in (("wi_0", (lm["d_ff"], d)), ("wi_1", (lm["d_ff"], d)), ("wo", (d, lm["d_ff"]))):
                yield f"{last}.moe.experts.{e}.{which}.weight", shape
    yield f"lm.{stack}.final_layer_norm.weight", (d,)


def _interp(config: Config) -> Entries:
    c, codes = config["interp"], config["vq"]["codes"]
    d = c["d_model"]
    yield "interp.frame_type.weight", (3, d)
    yield "interp.position.weight", (c["max_frames"], d)
    for part in PARTS:
        yield f"interp.embed.{part}.weight", (codes + 1, d)
        yield from _affine(f"interp.head.{part}", codes, d)
    for layer in interp_layers(config):
        yield f"{layer}.self_attn.in_proj_weight", (3 * d, d)
        yield f"{layer}.self_attn.in_proj_bias", (3 * d,)
        yield from _affine(f"{layer}.self_attn.out_proj", d, d)
        yield from _affine(f"{layer}.linear1", c["d_ff"], d)
        yield from _affine(f"{layer}.linear2", d, c["d_ff"])
        yield from _affine(f"{layer}.norm1", d)
        yield from _affine(f"{layer}.norm2", d)
    yield from _affine("interp.norm", d)


def interp_layers(config: Config) -> list[str]:
    """Names of the interpolation network's layers."""
    counts = (("temporal", config["interp"]["temporal_layers"]), ("part", config["interp"]["part_layers"]))
    return [f"interp.{stack}.{i}" for stack, layers in counts for i in range(layers)]


def _codecs(config: Config, encoders: bool) -> Entries:
    vq = config["vq"]
    for part in (*PARTS, "root"):
        if part != "root":
            yield f"vq.{part}.quantizer.embedding.weight", (vq["codes"], vq["width"])
        if encoders or part == "root":
            yield from _encoder(f"vq.{part}.encoder.main", vq["width"], vq[part]["channels"], vq[part]["layers"])
        yield from _decoder(f"vq.{part}.decoder.main", vq["width"], vq[part]["channels"], vq[part]["layers"])


def _residual(name: str, width: int) -> Entries:
    yield from _affine(f"{name}.model.0", width, width, 3)
    yield from _affine(f"{name}.model.2", width, width, 3)


def _encoder(name: str, width: int, channels: int, layers: int) -> Entries:
    for i in range(layers):
        yield from _affine(f"{name}.{3 * i}", width, width if i else channels, 3)
        yield from _residual(f"{name}.{3 * i + 2}", width)


def _decoder(name: str, width: int, channels: int, layers: int) -> Entries:
    yield from _residual(f"{name}.0", width)
    yield from _residual(f"{name}.1", width)
    for i in range(layers):
        yield from _affine(f"{name}.{2 + 2 * i}", channels if i == layers - 1 else width, width, 3)
    yield from _affine(f"{name}.{2 + 2 * layers}", channels, channels, 3)
