"""The mouth as a part of a model file: written separately, and added to a model."""

import json
import os
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import safe_open
from safetensors.torch import save_file
from torch import Tensor

from umo_train.export import HEADER, checksum, sealed

# Data start at a multiple of this, so that a memory map of the file is aligned for any type.
_ALIGN = 64


def write(path: Path, about: dict[str, Any], tensors: dict[str, Tensor]) -> None:
    """Writes the part alone: its tensors, and `config.mouth` in the metadata."""
    part = path.with_suffix(".part")
    save_file(tensors, part, metadata={"mouth": json.dumps(about)})
    part.rename(path)


def read(path: Path) -> tuple[dict[str, Any], dict[str, Tensor]]:
    """Reads the output of `write`, or the part of a model file that has one. Raises `ValueError` for other files."""
    with safe_open(path, framework="pt") as file:
        about = file.metadata() or {}
        mouth = json.loads(about["mouth"]) if "mouth" in about else json.loads(about.get("config", "{}")).get("mouth")
        if mouth is None:
            raise ValueError(f"{path}: neither a live mouth nor a model with one")
        return mouth, {name: file.get_tensor(name) for name in file.keys() if name.startswith("mouth.")}


def add(model: Path, part: Path, out: Path) -> None:
    """Writes `model` with the part of `part`, replacing its own, if it has one. All other tensors keep their bytes and
    order."""
    about, tensors = read(part)
    with model.open("rb") as file:
        header = json.loads(file.read(int.from_bytes(file.read(8), "little")))
        data = file.read()
    metadata = header.pop("__metadata__")
    kept = {name: entry for name, entry in header.items() if not name.startswith("mouth.")}
    pieces, entries, end = [], {}, 0
    for name, entry in sorted(kept.items(), key=lambda item: item[1]["data_offsets"]):
        first, last = entry["data_offsets"]
        pieces.append(data[first:last])
        entries[name] = entry | {"data_offsets": [end, end + last - first]}
        end += last - first
    for name, tensor in sorted(tensors.items()):
        raw = tensor.contiguous().flatten().view(torch.uint8).numpy().tobytes()
        kind = {torch.float32: "F32", torch.bfloat16: "BF16"}[tensor.dtype]
        pieces.append(raw)
        entries[name] = {"dtype": kind, "shape": list(tensor.shape), "data_offsets": [end, end + len(raw)]}
        end += len(raw)
    config = json.dumps(json.loads(metadata["config"]) | {"mouth": about}, separators=(",", ":"), ensure_ascii=False)
    value = zlib.crc32(config.encode())
    for piece in pieces:
        value = zlib.crc32(piece, value)
    metadata = metadata | {"config": config, "checksum": checksum(value), HEADER: checksum(0)}
    text = json.dumps(
        {"__metadata__": metadata, **dict(sorted(entries.items()))}, separators=(",", ":"), ensure_ascii=False
    )
    raw_text = text.encode()
    raw_text += b" " * (-(len(raw_text) + 8) % _ALIGN)
    temporary = out.with_suffix(".tmp")
    with temporary.open("wb") as file:
        file.write(len(raw_text).to_bytes(8, "little") + sealed(raw_text))
        file.writelines(pieces)
    os.replace(temporary, out)


def rest_of(tensors: dict[str, Tensor]) -> np.ndarray:
    return tensors["mouth.rest"].numpy()
