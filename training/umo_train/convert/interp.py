"""The interpolation network, which has not been published: trained weights from a file, or untrained ones to train."""

from pathlib import Path

import torch
from torch import nn

from umo_train.convert.layout import Config, interp_layers, shapes
from umo_train.convert.sources import Tensors, read, renamed

_PREFIX = "interp."
_TABLE_STD = 0.02


def convert(path: Path, config: Config) -> Tensors:
    """`interp.*` from a file, with or without the prefix; other tensors of a umo file are ignored."""
    found = read(path)
    own = {name: tensor for name, tensor in found.items() if name.startswith(_PREFIX)}
    source = own or {_PREFIX + name: tensor for name, tensor in found.items()}
    wanted = _wanted(config)
    return renamed(f"{path} (interpolation network)", source, {name: name for name in wanted}, wanted)


def untrained(config: Config, seed: int) -> Tensors:
    """Weights with PyTorch's initialisation."""
    sizes, out = config["interp"], {}
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        for layer in interp_layers(config):
            module = nn.TransformerEncoderLayer(sizes["d_model"], sizes["num_heads"], sizes["d_ff"])
            out |= {f"{layer}.{name}": tensor for name, tensor in module.state_dict().items()}
        for name, shape in _wanted(config).items():
            if name.startswith("interp.head.") and name.endswith(".weight"):
                head = nn.Linear(shape[1], shape[0])
                out |= {name: head.weight.data, name.removesuffix("weight") + "bias": head.bias.data}
            elif name not in out and len(shape) > 1:
                out[name] = _TABLE_STD * torch.randn(shape)
    out |= {"interp.norm.weight": torch.ones(sizes["d_model"]), "interp.norm.bias": torch.zeros(sizes["d_model"])}
    return out


def _wanted(config: Config) -> dict[str, tuple[int, ...]]:
    return {name: shape for name, shape in shapes(config).items() if name.startswith(_PREFIX)}
