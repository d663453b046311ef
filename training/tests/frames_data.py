"""A small plan of layout `frames` for tests: parts of both kinds and of several levels, a config, and codes."""

from typing import Any

import numpy as np
import torch

from umo_train.frames import parts
from umo_train.frames.parts import Part
from umo_train.skeleton import ARKIT

FACE = list(ARKIT)
PLAN: dict[str, Any] = {
    "tokenizers": {"codes": 12, "levels": 2, "width": 10, "layers": 2},
    "parts": [
        {"name": "intent", "codes": 13, "levels": 1},
        {"name": "upper", "channels": ["upper"], "levels": 4, "codes": 7},
        {"name": "hands", "channels": ["hands"], "levels": 1, "layers": 1},
        {"name": "lower", "channels": ["lower"], "width": 9, "levels": 3},
        {"name": "mouth", "channels": ["mouth_and_cheeks"]},
        {"name": "eyes", "channels": ["eyes_and_brows"], "levels": 1},
    ],
}
PARTS = parts.read(PLAN, FACE)
SLOTS = sum(part.levels for part in PARTS)
BODY = [part.name in ("intent", "upper", "hands", "lower") for part in PARTS]
COUNTS = np.repeat([part.codes for part in PARTS], [part.levels for part in PARTS])
AUDIO = {"first": 43, "codes": 20, "start": 65, "end": 66, "mask": 67}
LM = {
    "d_model": 16,
    "d_kv": 5,
    "d_ff": 20,
    "num_heads": 3,
    "num_layers": 2,
    "num_decoder_layers": 2,
    "relative_attention_num_buckets": 8,
    "relative_attention_max_distance": 30,
    "layer_norm_epsilon": 1e-6,
    "feed_forward_proj": "gated-gelu",
    "tie_word_embeddings": False,
    "experts": 3,
    "top_k": 2,
}
CONFIG: dict[str, Any] = {
    "layout": "frames",
    "frame_rate": 30,
    "keyframe_stride": 3,
    "prefix": 4,
    "target": 2,
    "max_target": 4,
    "audio": {"token_rate": 50, "ahead": 3},
    "vocab": {"size": 68, "pad": 0, "eos": 1, "decoder_start": 0, "audio": AUDIO},
    "lm": LM,
    "depth": {
        "d_model": 12,
        "num_heads": 3,
        "d_ff": 17,
        "num_layers": 2,
        "layer_norm_epsilon": 1e-6,
        "before": True,
        "heard": 2,
    },
    "interp": {"d_model": 12, "num_heads": 2, "d_ff": 16, "temporal_layers": 2, "part_layers": 1, "max_frames": 40},
    "face": {"kind": "arkit", "names": FACE},
    "parts": [part.config([level % part.codes for level in range(part.levels)]) for part in PARTS],
    "templates": {
        "audio_to_motion": [8, "audio", 9, 10, "text", 11, "history", 1],
        "text_to_motion": [10, "text", 11, "history", 1],
    },
}


def codes(*shape: int, seed: int = 0) -> torch.Tensor:
    """Random codes `[..., J]`."""
    return torch.from_numpy(np.random.default_rng(seed).integers(0, COUNTS, (*shape, SLOTS)))


def part(name: str) -> Part:
    return next(part for part in PARTS if part.name == name)


def at(name: str) -> slice:
    """Columns of a part's codes."""
    first = 0
    for one in PARTS:
        if one.name == name:
            return slice(first, first + one.levels)
        first += one.levels
    raise KeyError(name)
