"""Hugging Face's HuBERT: the used layers, with the position convolution's weight norm folded."""

from pathlib import Path

from umo_train.convert.layout import Config, audio_shapes
from umo_train.convert.sources import SourceError, Tensors, agree, read, read_json, renamed

_PREFIX = "audio.hubert."
_CONVOLUTION = "encoder.pos_conv_embed.conv"
# Scale and direction of the weight norm, named by transformers before and after PyTorch's parametrizations.
_SCALE = (f"{_CONVOLUTION}.weight_g", f"{_CONVOLUTION}.parametrizations.weight.original0")
_DIRECTION = (f"{_CONVOLUTION}.weight_v", f"{_CONVOLUTION}.parametrizations.weight.original1")
# Settings that identify the specification's network among its variants.
_FORM = {
    "feat_extract_norm": "group",
    "feat_extract_activation": "gelu",
    "hidden_act": "gelu",
    "conv_bias": False,
    "do_stable_layer_norm": False,
    "conv_pos_batch_norm": False,
    "feat_proj_layer_norm": True,
}
_SIZES = (
    "conv_dim", "conv_kernel", "conv_stride", "hidden_size", "intermediate_size", "num_attention_heads",
    "num_conv_pos_embeddings", "num_conv_pos_embedding_groups", "layer_norm_eps",
)  # fmt: skip
# Used only in training, or by heads on the features.
_IGNORED = (r"masked_spec_embed", r"(lm_head|projector|classifier)\..*", r"layer_weights")


def convert(folder: Path, config: Config) -> Tensors:
    """`audio.hubert.*` from a folder with `config.json` and weights. Whether samples are normalised comes from the
    config, not from `preprocessor_config.json`: it must match the fitting of the k-means."""
    _check(folder, config)
    source = {name.removeprefix("hubert."): tensor for name, tensor in read(folder).items()}
    _fold(source)
    wanted = {name: shape for name, shape in audio_shapes(config).items() if name.startswith(_PREFIX)}
    names = {name: name.removeprefix(_PREFIX) for name in wanted}
    used = config["audio"]["hubert"]["num_hidden_layers"]
    beyond = [rf"encoder\.layers\.{i}\..*" for i in range(used, _layers(folder))]
    return renamed(f"{folder} (HuBERT)", source, names, wanted, (*_IGNORED, *beyond))


def check_form(folder: Path) -> None:
    """Refuses variants of the specification's network."""
    path = folder / "config.json"
    theirs = read_json(path)
    agree(f"{path}", _FORM, {key: theirs[key] for key in _FORM if key in theirs})


def _layers(folder: Path) -> int:
    return int(read_json(folder / "config.json").get("num_hidden_layers", 12))


def _check(folder: Path, config: Config) -> None:
    hubert, theirs = config["audio"]["hubert"], read_json(folder / "config.json")
    agree(f"{folder / 'config.json'}", hubert | _FORM, {k: theirs[k] for k in (*_SIZES, *_FORM) if k in theirs})
    if _layers(folder) < hubert["num_hidden_layers"]:
        raise SourceError(f"{folder}: {_layers(folder)} layers, the config asks for {hubert['num_hidden_layers']}")


def _fold(source: Tensors) -> None:
    """Replaces `g` and `v` with `g * v / |v|`, with the norm of `v` over all dimensions except the kernel's taps."""
    for scale, direction in zip(_SCALE, _DIRECTION, strict=True):
        if scale in source and direction in source:
            g, v = source.pop(scale).double(), source.pop(direction).double()
            folded = v * (g / v.square().sum((0, 1), keepdim=True).sqrt())
            source[f"{_CONVOLUTION}.weight"] = folded.float()
