"""Writes a trained model as a umo file (SPEC 3)."""

import json
import zlib
from pathlib import Path
from typing import Any

import torch
from safetensors.torch import load_file, save_file
from torch import Tensor


def tensors(
    audio: dict[str, Tensor],
    language: dict[str, Tensor],
    interpolation: dict[str, Tensor],
    motion: dict[str, dict[str, Tensor]],
    text: bytes | None,
    dtype: torch.dtype,
) -> dict[str, Tensor]:
    """All tensors by name; matrices in `dtype`, tensors that decide nearest neighbours and routing in f32."""
    out = {name: tensor.float() for name, tensor in audio.items()}
    for name, tensor in language.items():
        # The depth network of layout `frames` is a separate network.
        full = name if name.startswith("depth.") else f"lm.{name}"
        out[full] = tensor.float() if "router" in name or "relative" in name else tensor.to(dtype)
    out |= {f"interp.{name}": tensor.to(dtype) for name, tensor in interpolation.items()}
    for part, network in motion.items():
        for name, tensor in network.items():
            out[f"vq.{part}.{name}"] = tensor.float() if "quantizer" in name else tensor.to(dtype)
    out = {name: tensor.detach().contiguous().clone() for name, tensor in out.items()}
    if text is not None:
        out["text.tokenizer"] = torch.frombuffer(bytearray(text), dtype=torch.uint8)
    return out


def sharpen(language: dict[str, Tensor], vocab: dict[str, Any], factors: dict[str, float]) -> None:
    """Scales the logits of parts' codes, in place: one temperature then samples lips sharply and gestures freely."""
    if factors and "lm_head.weight" not in language:
        raise ValueError("`sharpen` needs a plan whose language model has `tie_word_embeddings: false`")
    for part, factor in factors.items():
        first = vocab[part]["first"]
        language["lm_head.weight"][first : first + vocab[part]["codes"]] *= factor


def write(path: Path, config: dict[str, Any], named: dict[str, Tensor]) -> None:
    """Atomic by renaming: an existing file is complete."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part")
    text = json.dumps(config, separators=(",", ":"))
    about = {"format": "umo", "version": "1", "config": text, "checksum": checksum(0), HEADER: checksum(0)}
    save_file(named, part, metadata=about)
    add_checksum(part, text)
    part.rename(path)


# The key of the header's own checksum.
HEADER = "header_checksum"


def checksum(value: int) -> str:
    return f"crc32:{value:08x}"


def add_checksum(path: Path, config: str) -> None:
    """Replaces the placeholders of both checksums: of the config and all bytes after the header, and of the header."""
    with path.open("r+b") as file:
        length = int.from_bytes(file.read(8), "little")
        header = file.read(length)
        value = zlib.crc32(config.encode())
        while piece := file.read(1 << 22):
            value = zlib.crc32(piece, value)
        # The config's own quotes are escaped in the header, so this occurs only once.
        placed = header.replace(f'"checksum":"{checksum(0)}"'.encode(), f'"checksum":"{checksum(value)}"'.encode())
        file.seek(8)
        file.write(sealed(placed))


def sealed(header: bytes) -> bytes:
    """The header with its own checksum, computed over its length and itself with a checksum of 0."""
    value = zlib.crc32(len(header).to_bytes(8, "little") + header)
    return header.replace(f'"{HEADER}":"{checksum(0)}"'.encode(), f'"{HEADER}":"{checksum(value)}"'.encode())


def save_state(path: Path, state: dict[str, Tensor]) -> None:
    save_file({name: tensor.contiguous() for name, tensor in state.items()}, path)


def load_state(path: Path) -> dict[str, Tensor]:
    return load_file(path)
