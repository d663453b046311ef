"""The step `pack`: the language model's training data as one file, small enough to copy to a machine with a GPU.

Only codes of keyframes and audio units: 19 MB for 19 hours, whereas corpus and run have several GB.
"""

import io
import json
import lzma
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from umo_train.frames.examples import FrameExamples, FrameStream
from umo_train.frames.parts import Part

Config = dict[str, Any]
NAME = "packed.xz"


@dataclass
class Packed:
    """The model file's config, and the input of `FrameExamples` for each split."""

    config: Config
    silence: int
    delay: int | None
    body: list[bool]
    splits: dict[str, list[FrameStream]]

    def examples(self, parts: list[Part], split: str, *, augment: bool) -> FrameExamples:
        return FrameExamples(
            self.config, parts, self.body, self.splits[split], self.silence, augment=augment, delay=self.delay
        )


def write(path: Path, packed: Packed) -> None:
    """Writes codes of keyframes only: the frames in between are not used."""
    stride: int = packed.config["keyframe_stride"]
    about: Config = {"config": packed.config, "silence": packed.silence, "delay": packed.delay, "body": packed.body}
    about["splits"] = {}
    codes, units = [], []
    for split, streams in packed.splits.items():
        about["splits"][split] = [_described(stream, stride) for stream in streams]
        codes += [stream.codes[::stride].astype(np.int16) for stream in streams if stream.codes is not None]
        units += [stream.units.astype(np.int16).ravel() for stream in streams if stream.units is not None]
    # Code-major order, so that rarely changing values are adjacent and compress well.
    arrays = {
        "codes": np.concatenate(codes).T.copy() if codes else np.zeros((0, 0), np.int16),
        "units": np.concatenate(units) if units else np.zeros(0, np.int16),
        "about": np.frombuffer(json.dumps(about).encode(), np.uint8),
    }
    file = io.BytesIO()
    np.savez(file, **arrays)
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part")
    part.write_bytes(lzma.compress(file.getvalue(), preset=4))
    part.rename(path)


def _described(stream: FrameStream, stride: int) -> Config:
    return {
        "keyframes": None if stream.codes is None else len(stream.codes[::stride]),
        "units": None if stream.units is None else stream.units.shape,
        "prompts": [prompt.tolist() for prompt in stream.prompts],
        "told": stream.told,
        "weight": stream.weight,
        "begins": stream.begins,
        "person": stream.person,
    }


def read(path: Path) -> Packed:
    with np.load(io.BytesIO(lzma.decompress(path.read_bytes()))) as arrays:
        codes, units, about = arrays["codes"].T, arrays["units"], json.loads(arrays["about"].tobytes())
    stride, at, heard = about["config"]["keyframe_stride"], 0, 0
    splits: dict[str, list[FrameStream]] = {}
    for split, entries in about["splits"].items():
        splits[split] = []
        for entry in entries:
            mine = said = None
            if entry["keyframes"] is not None:
                # Repeated for every frame, of which examples take the keyframes.
                mine = codes[at : at + entry["keyframes"]].repeat(stride, 0)
                at += entry["keyframes"]
            if entry["units"] is not None:
                count = int(np.prod(entry["units"]))
                said = units[heard : heard + count].reshape(entry["units"])
                heard += count
            prompts = tuple(np.array(prompt, np.int64) for prompt in entry["prompts"])
            told, weight, person = entry["told"], entry["weight"], entry.get("person", False)
            splits[split].append(FrameStream(mine, said, prompts, told, weight, tuple(entry["begins"]), person))
    return Packed(about["config"], about["silence"], about["delay"], about["body"], splits)
