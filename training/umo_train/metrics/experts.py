"""Counts how often each expert is the first choice, by layer, while a model animates."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from safetensors.torch import safe_open

from umo_train.metrics.agreement import Chunk
from umo_train.metrics.motion import use_entropy
from umo_train.stored import floats


def language_model(path: Path) -> torch.nn.Module:
    """The language model of an umo file in f32; int8 and int4 weights are multiplied by their scales."""
    from umo_train.lm.model import LanguageModel

    with safe_open(path, "pt") as file:
        model = LanguageModel(json.loads(file.metadata()["config"]))
        stored = {name: file.get_tensor(name) for name in file.keys() if name.startswith("lm.")}
    model.load_state_dict({name.removeprefix("lm."): tensor for name, tensor in floats(stored).items()})
    return model.eval()


@torch.no_grad()
def first_choices(path: Path, chunks: Sequence[Chunk]) -> dict[str, np.ndarray]:
    """Counts `[experts]` by layer over all rows of all chunks. Empty for a dense model."""
    model = language_model(path)
    counts: dict[str, np.ndarray] = {}
    hooks = []
    for name, module in model.named_modules():
        if hasattr(module, "router"):
            stack, _, number, *_ = name.split(".")

            def count(
                moe: torch.nn.Module, given: tuple[torch.Tensor], _: object, layer: str = f"{stack} {number}"
            ) -> None:
                chosen = (given[0].flatten(0, -2) @ moe.router.weight.T).argmax(1)
                counts[layer] = counts.get(layer, 0) + np.bincount(chosen.numpy(), minlength=len(moe.router.weight))

            hooks.append(module.register_forward_hook(count))
    for chunk in chunks:
        model(torch.from_numpy(chunk.encoder)[None], torch.from_numpy(chunk.decoder)[None])
    for hook in hooks:
        hook.remove()
    return counts


def entropy(counts: dict[str, np.ndarray]) -> float:
    """Mean over layers of the evenness of expert use, 0..1."""
    return use_entropy(np.stack(list(counts.values()))) if counts else 0.0
