"""Codes in int8 compared with codes in f32, chunk by chunk on the same history, and the use of codes."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from umo_train.metrics.item import Item
from umo_train.metrics.program import run, stage
from umo_train.skeleton import PARTS
from umo_train.speech.utterance import SAMPLE_RATE


@dataclass(frozen=True)
class Chunk:
    """Ids of one run of encoder and decoder: the encoder's input, and the f32 output with its markers."""

    encoder: np.ndarray
    decoder: np.ndarray
    codes: dict[str, np.ndarray]


def _options(model: Path | None) -> list[object]:
    return ["--model", model] if model else []


def config_of(umo: Path, model: Path | None) -> dict[str, Any]:
    """The model file's config."""
    return json.loads(run(umo, "model", "inspect", "--config", *([model] if model else [])))


def _marked(vocab: dict[str, Any], name: str, codes: Sequence[int]) -> list[int]:
    """Codes of a part, or audio units, as ids between their markers."""
    of = vocab[name]
    return [of["start"], *(of["first"] + np.asarray(codes, int)).tolist(), of["end"]]


def encoder_ids(config: dict[str, Any], units: Sequence[int], history: dict[str, np.ndarray]) -> np.ndarray:
    """The encoder's input without a text: the template with the window's audio units and the last codes of each
    part."""
    out: list[int] = []
    for piece in config["templates"]["audio_to_motion"]:
        if isinstance(piece, int):
            out.append(piece)
        else:
            out += _marked(config["vocab"], piece, units if piece == "audio" else history[piece])
    return np.array(out, np.int64)


def decoder_ids(config: dict[str, Any], codes: dict[str, np.ndarray]) -> np.ndarray:
    """The decoder's input: the start marker and all its output except the last id, so that row `i` of the logits
    predicts id `i + 1`.
    """
    out = [config["vocab"]["decoder_start"]]
    for part in PARTS:
        out += _marked(config["vocab"], part, codes[part])
    return np.array(out[:-1], np.int64)


def units_of(umo: Path, item: Item, config: dict[str, Any], model: Path | None = None) -> np.ndarray:
    """Audio units of a recording after the silence of a whole prefix, as a stream begins."""
    tokens = config["prefix"] * config["audio"]["token_rate"] * config["keyframe_stride"] // config["frame_rate"]
    silence = np.zeros(tokens * SAMPLE_RATE // config["audio"]["token_rate"], np.float32)
    samples = np.concatenate([silence, np.asarray(item.samples, np.float32)])
    return stage(umo, config["audio"]["kind"], {"audio": samples}, *_options(model))["units"]


def trace(umo: Path, item: Item, model: Path | None = None, most: int = 20, seed: int = 0) -> list[Chunk]:
    """The first chunks of a recording in f32, each with the previous chunks' codes as its history."""
    config = config_of(umo, model)
    prefix, target, rate = config["prefix"], config["target"], config["audio"]["token_rate"]
    # Audio units per keyframe.
    each = rate * config["keyframe_stride"] // config["frame_rate"]
    units = units_of(umo, item, config, model)
    history = {part: np.full(prefix, config["rest"][part]) for part in PARTS}
    chunks = []
    for number in range(min(most, (len(units) // each - prefix) // target)):
        window = units[number * target * each :][: (prefix + target) * each]
        ids = encoder_ids(config, window, history)
        draw = ["--target", target, "--seed", seed * 1009 + number]
        made = stage(umo, "generate", {"input_ids": ids}, *draw, *_options(model))
        codes = {part: made[f"codes.{part}"] for part in PARTS}
        chunks.append(Chunk(ids, decoder_ids(config, codes), codes))
        history = {part: np.concatenate([history[part], codes[part]])[-prefix:] for part in PARTS}
    return chunks


def likeliest(config: dict[str, Any], logits: np.ndarray) -> dict[str, np.ndarray]:
    """The most probable code of each part at each of its positions, from the logits `[rows, vocab]` of a chunk."""
    target = len(logits) // len(PARTS) - 2
    out = {}
    for number, part in enumerate(PARTS):
        # The part's marker is a separate input row, which predicts the first code.
        first = 1 + number * (target + 2)
        of = config["vocab"][part]
        out[part] = logits[first : first + target, of["first"] : of["first"] + of["codes"]].argmax(1)
    return out


def agreement(
    umo: Path,
    chunks: Sequence[Chunk],
    model: Path | None = None,
    other: Path | None = None,
    precision: str | None = None,
) -> dict[str, float]:
    """Share of positions at which f32 of `model` and `precision` of `other` (by default the same file) agree on the
    most probable code, by part and in `all`; both get the codes sampled in f32 so far.

    Another file is computed in its stored precision by default, the same file in int8."""
    precision = precision or ("stored" if other else "int8")
    config = config_of(umo, model)
    same: dict[str, list[np.ndarray]] = {part: [] for part in PARTS}
    for chunk in chunks:
        given = {"input_ids": chunk.encoder, "decoder_input_ids": chunk.decoder}
        exact = stage(umo, "decoder", given, *_options(model), "--precision", "f32")["logits"]
        coarse = stage(umo, "decoder", given, *_options(other or model), "--precision", precision)["logits"]
        a, b = likeliest(config, exact), likeliest(config, coarse)
        for part in PARTS:
            same[part].append(a[part] == b[part])
    shares = {part: float(np.concatenate(rows).mean()) for part, rows in same.items()}
    return shares | {"all": float(np.mean(list(shares.values())))}


def code_counts(chunks: Sequence[Chunk], codes: int) -> dict[str, np.ndarray]:
    """Number of times each code was drawn `[codes]`, by part."""
    return {part: np.bincount(np.concatenate([c.codes[part] for c in chunks]), minlength=codes) for part in PARTS}
