"""Codes in int8 compared with codes in f32 for models of layout `frames`, chunk by chunk on the same history."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from umo_train.metrics.agreement import config_of, units_of
from umo_train.metrics.item import Item
from umo_train.metrics.program import stage

Codes = dict[str, np.ndarray]


@dataclass(frozen=True)
class FrameChunk:
    """One run: the encoder's input, and the keyframes sampled in f32, `[N, levels]` of each part."""

    ids: np.ndarray
    history: Codes
    codes: Codes


def encoder_ids(config: dict[str, Any], units: Sequence[int]) -> np.ndarray:
    """The encoder's input without a text."""
    audio, out = config["vocab"]["audio"], []
    for piece in config["templates"]["audio_to_motion"]:
        if isinstance(piece, int):
            out.append(piece)
        elif piece == "audio":
            out += [audio["start"], *(audio["first"] + np.asarray(units, int)).tolist(), audio["end"]]
        elif piece == "history":
            out += range(config["vocab"]["size"], config["vocab"]["size"] + config["prefix"])
    return np.array(out, np.int64)


def _named(group: str, codes: Codes) -> Codes:
    return {f"{group}.{name}": values.astype(np.int64) for name, values in codes.items()}


def trace(umo: Path, item: Item, model: Path | None = None, most: int = 20, seed: int = 0) -> list[FrameChunk]:
    """The first chunks of a recording in f32, each with the previous chunks' codes as its history, and with full
    lookahead audio."""
    config, options = config_of(umo, model), (["--model", model] if model else [])
    prefix, target = config["prefix"], config["target"]
    each = config["audio"]["token_rate"] * config["keyframe_stride"] // config["frame_rate"]
    heard = (prefix + target + config["audio"].get("ahead", 0)) * each
    units = units_of(umo, item, config, model)
    history = {part["name"]: np.tile(np.asarray(part["rest"]), (prefix, 1)) for part in config["parts"]}
    chunks = []
    for number in range(min(most, (len(units) - heard) // (target * each) + 1)):
        ids = encoder_ids(config, units[number * target * each :][:heard])
        draw = ["--target", target, "--seed", seed * 1009 + number]
        made = stage(umo, "generate", {"input_ids": ids} | _named("history", history), *draw, *options)
        codes = {name: made[f"codes.{name}"] for name in history}
        chunks.append(FrameChunk(ids, history, codes))
        history = {name: np.concatenate([rows, codes[name]])[-prefix:] for name, rows in history.items()}
    return chunks


def _heard(umo: Path, chunk: FrameChunk, config: dict[str, Any], *options: object) -> Codes:
    """The encoder's states where the chunk's keyframes are heard, if the depth network uses them."""
    if "heard" not in config["depth"]:
        return {}
    hidden = stage(umo, "encoder", {"input_ids": chunk.ids} | _named("history", chunk.history), *options)["hidden"]
    each = config["audio"]["token_rate"] * config["keyframe_stride"] // config["frame_rate"]
    start = int(np.flatnonzero(chunk.ids == config["vocab"]["audio"]["start"])[0]) + 1
    count = len(next(iter(chunk.codes.values())))
    first = (config["prefix"] + np.arange(count)) * each
    last = (config["prefix"] + count + config["audio"].get("ahead", 0)) * each - 1
    tokens = {key: config["depth"][key] for key in ("heard", "body_heard") if key in config["depth"]}
    return {key: hidden[start + np.minimum(first + token, last)] for key, token in tokens.items()}


def _logits(umo: Path, chunk: FrameChunk, config: dict[str, Any], *options: object) -> Codes:
    """Logits of each part, `[N, levels, codes]`, with teacher forcing."""
    codes = _named("codes", chunk.codes)
    given = {"input_ids": chunk.ids} | _named("history", chunk.history) | codes
    hidden = stage(umo, "decoder", given, *options)["hidden"]
    heard = _heard(umo, chunk, config, *options)
    before = {name: np.concatenate([chunk.history[name][-1:], rows[:-1]]) for name, rows in chunk.codes.items()}
    made = stage(umo, "depth", {"hidden": hidden} | heard | codes | _named("before", before), *options)
    return {name: made[f"logits.{name}"] for name in chunk.codes}


def agreement(
    umo: Path,
    chunks: Sequence[FrameChunk],
    model: Path | None = None,
    other: Path | None = None,
    precision: str | None = None,
) -> dict[str, float]:
    """As `agreement.agreement`: the share of codes, by part and in `all`, for which f32 of `model` and `precision` of
    `other` agree on the most probable one, both given the codes sampled in f32 so far."""
    return compare(umo, chunks, model, other, precision)[0]


def compare(
    umo: Path,
    chunks: Sequence[FrameChunk],
    model: Path | None = None,
    other: Path | None = None,
    precision: str | None = None,
) -> tuple[dict[str, float], float]:
    """The result of `agreement`, and the relative root mean square error of the logits, after subtracting each code's
    mean.
    """
    precision = precision or ("stored" if other else "int8")
    exact, coarse = ([*(["--model", path] if path else []), "--precision"] for path in (model, other or model))
    config = config_of(umo, model)
    same: dict[str, list[np.ndarray]] = {}
    error = power = 0.0
    for chunk in chunks:
        one, two = _logits(umo, chunk, config, *exact, "f32"), _logits(umo, chunk, config, *coarse, precision)
        for name in one:
            same.setdefault(name, []).append((one[name].argmax(-1) == two[name].argmax(-1)).ravel())
            wanted, got = (logits - logits.mean(-1, keepdims=True) for logits in (one[name], two[name]))
            error, power = error + float(((got - wanted) ** 2).sum()), power + float((wanted**2).sum())
    shares = {name: float(np.concatenate(rows).mean()) for name, rows in same.items()}
    shares["all"] = float(np.concatenate([row for rows in same.values() for row in rows]).mean())
    return shares, (error / power) ** 0.5


def code_counts(chunks: Sequence[FrameChunk], config: dict[str, Any]) -> Codes:
    """Number of times each first code of a part was sampled."""
    return {
        part["name"]: np.bincount(
            np.concatenate([chunk.codes[part["name"]][:, 0] for chunk in chunks]).astype(int), minlength=part["codes"]
        )
        for part in config["parts"]
    }
