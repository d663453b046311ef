"""Initial weights of the language model: Flan-T5 of any size, or another checkpoint that `umo_train.convert` reads."""

from pathlib import Path
from typing import Any

from torch import Tensor

from umo_train.convert import t5


def from_t5(path: Path, config: dict[str, Any], *, dense: bool, seed: int) -> dict[str, Tensor]:
    """State of `LanguageModel(config, dense=dense)`: rows of new tokens are drawn, and unless dense every expert is a
    copy of the feed-forward (sparse upcycling)."""
    tensors, _ = t5.convert(path, config, seed)
    if not dense:
        return {name.removeprefix("lm."): tensor for name, tensor in tensors.items()}
    return {t5.dense_name(name): tensor for name, tensor in tensors.items() if ".moe.router." not in name}
