"""Writes and reads the two kinds of files. Tensors are read back as the f32 values that a file really stores."""

import json
import struct
from pathlib import Path

import torch
from safetensors import safe_open
from torch import Tensor

from layout import Config, Shapes

STORAGE = {"F32": torch.float32, "F16": torch.float16, "BF16": torch.bfloat16}
# A file may mix types; this storage has one per prefix.
MIXED = {"audio.": "F32", "lm.": "F32", "interp.": "F16", "vq.": "BF16"}
TYPE_NAMES = {dtype: name for name, dtype in STORAGE.items()} | {
    torch.int8: "I8",
    torch.int64: "I64",
    torch.uint8: "U8",
}
# Small tables stay in F32 in an int8 file, where rounding would only blur choices.
KEPT = ("router", "relative_attention_bias", "centroids", "quantizer", "frame_type", "pos_conv_embed")


def float_type(name: str, storage: str) -> torch.dtype:
    """The type of a tensor in a file without quantised tensors."""
    if storage == "mixed":
        storage = next(kind for prefix, kind in MIXED.items() if name.startswith(prefix))
    return STORAGE[storage]


def pack(tensors: dict[str, Tensor], storage: str) -> dict[str, Tensor]:
    """The tensors as stored in a file of this storage; I8 splits a matrix into itself and `.scale`."""
    if storage != "I8":
        return {name: tensor.to(float_type(name, storage)) for name, tensor in tensors.items()}
    packed: dict[str, Tensor] = {}
    for name, tensor in tensors.items():
        if tensor.dim() < 2 or any(kept in name for kept in KEPT):
            packed[name] = tensor
            continue
        rows = tensor.reshape(len(tensor), -1)
        scale = rows.abs().amax(1) / 127.0
        packed[name] = (rows / scale[:, None]).round().to(torch.int8).reshape(tensor.shape)
        packed[f"{name}.scale"] = scale
    return packed


def unpack(packed: dict[str, Tensor]) -> dict[str, Tensor]:
    """The f32 values represented by packed tensors."""
    out: dict[str, Tensor] = {}
    for name, tensor in packed.items():
        if name.endswith(".scale") and name.removesuffix(".scale") in packed:
            continue
        if tensor.dtype == torch.int8:
            scale = packed[f"{name}.scale"].reshape(-1, *[1] * (tensor.dim() - 1))
            out[name] = tensor.float() * scale
        else:
            out[name] = tensor if tensor.dtype == torch.uint8 else tensor.float()
    return out


def write(path: Path, tensors: dict[str, Tensor], metadata: dict[str, str]) -> None:
    """Writes a safetensors file whose bytes depend only on the contents (the library shuffles its metadata)."""
    wide_first = sorted(tensors.items(), key=lambda item: (-item[1].element_size(), item[0]))
    header: dict[str, object] = {"__metadata__": dict(sorted(metadata.items()))}
    end = 0
    for name, tensor in wide_first:
        start, end = end, end + tensor.numel() * tensor.element_size()
        header[name] = {
            "dtype": TYPE_NAMES[tensor.dtype],
            "shape": list(tensor.shape),
            "data_offsets": [start, end],
        }
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 8)
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as file:
        file.write(struct.pack("<Q", len(text)) + text)
        for _, tensor in wide_first:
            file.write(tensor.contiguous().flatten().view(torch.uint8).numpy().tobytes())


def read(path: Path) -> tuple[dict[str, Tensor], dict[str, str]]:
    """Tensors and metadata of a file, by the safetensors library."""
    with safe_open(path, framework="pt") as file:
        return {name: file.get_tensor(name) for name in file.keys()}, file.metadata()


def read_model(path: Path, shapes: Shapes, storage: str) -> tuple[Config, dict[str, Tensor]]:
    """A model file's config and f32 values, after checking format, names, shapes and types."""
    packed, metadata = read(path)
    assert metadata["format"] == "umo" and metadata["version"] == "1", metadata
    tensors = unpack(packed)
    found = {name: tuple(tensor.shape) for name, tensor in tensors.items() if name != "text.tokenizer"}
    assert found == shapes, {name for name in found.keys() ^ shapes.keys()} or "a shape differs"
    for name, tensor in packed.items():
        if storage != "I8" and name != "text.tokenizer":
            assert tensor.dtype == float_type(name, storage), name
    for name, tensor in tensors.items():
        assert tensor.isfinite().all(), f"{name} is not finite"
    return json.loads(metadata["config"]), tensors
