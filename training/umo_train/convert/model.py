"""Assembles one umo file from its sources."""

import copy
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from safetensors.torch import save_file

from umo_train.convert import hubert, interp, kmeans, t5, vq
from umo_train.convert.layout import Config, is_weight, shapes
from umo_train.convert.sources import SourceError, Tensors, renamed
from umo_train.export import HEADER, add_checksum, checksum

FORMAT, VERSION = "umo", "1"
TOKENIZER = "text.tokenizer"
DTYPES = {"bf16": torch.bfloat16, "f16": torch.float16, "f32": torch.float32}


@dataclass(frozen=True)
class Model:
    """Contents of a umo file, in f32."""

    config: Config
    tensors: Tensors
    # SentencePiece model of the text vocabulary.
    tokenizer: bytes | None = None


def convert(
    config: Config,
    hubert_folder: Path,
    kmeans_file: Path,
    t5_path: Path,
    vq_files: Sequence[Path],
    *,
    interp_file: Path | None = None,
    tokenizer: Path | None = None,
    experts: int | None = None,
    top_k: int | None = None,
    seed: int = 0,
) -> Model:
    """A model from published weights. Missing tensors are drawn from `seed` and named in the config's notice: rows of
    new tokens, and the interpolation network if no file is given. So are routers, which choose among equal experts."""
    config = copy.deepcopy(config)
    if config["audio"]["kind"] != "hubert":
        raise SourceError("the config's `audio.kind` is not hubert: no published weights exist for it")
    lm = config["lm"]
    lm["experts"] = experts or lm["experts"]
    lm["top_k"] = top_k or lm["top_k"]
    if lm["top_k"] > lm["experts"]:
        raise SourceError(f"top-k of {lm['top_k']}, more than the {lm['experts']} experts")
    tensors = hubert.convert(hubert_folder, config) | kmeans.convert(kmeans_file, config)
    lm_tensors, new_rows = t5.convert(t5_path, config, seed)
    tensors |= lm_tensors | vq.convert(vq_files, config)
    drawn = ["new tokens"] if new_rows else []
    if interp_file is None:
        drawn.append("interpolation network")
        tensors |= interp.untrained(config, seed)
    else:
        tensors |= interp.convert(interp_file, config)
    if drawn:
        config.setdefault("notice", f"Not trained: {' and '.join(drawn)}.")
    return Model(config, tensors, _tokenizer(tokenizer, t5_path))


def _tokenizer(given: Path | None, t5_path: Path) -> bytes | None:
    """The given one, or the one beside T5's weights."""
    path = given or t5_path / "spiece.model"
    if given is not None and not path.is_file():
        raise SourceError(f"{path}: there is no such file")
    return path.read_bytes() if path.is_file() else None


def write(path: Path, model: Model, dtype: str = "bf16") -> None:
    """Writes the umo file; `dtype` is the type of weights and tables. Atomic, as a program may have an older file
    mapped."""
    expected = shapes(model.config)
    checked = renamed("the model", model.tensors, {name: name for name in expected}, expected)
    unfit = [name for name, tensor in checked.items() if not tensor.isfinite().all()]
    if unfit:
        raise SourceError("values that are not numbers in:\n  " + "\n  ".join(unfit))
    out: Tensors = {}
    for name, tensor in checked.items():
        stored = tensor.to(DTYPES[dtype]) if is_weight(name, expected[name]) else tensor
        # Experts are views of one tensor until they are written.
        out[name] = stored.clone(memory_format=torch.contiguous_format)
    large = [name for name, tensor in out.items() if not tensor.isfinite().all()]
    if large:
        raise SourceError(f"values beyond the range of {dtype} in:\n  " + "\n  ".join(large) + "\nuse bf16 or f32")
    if model.tokenizer is not None:
        out[TOKENIZER] = torch.frombuffer(bytearray(model.tokenizer), dtype=torch.uint8)
    config = json.dumps(model.config, ensure_ascii=False)
    sums = {"checksum": checksum(0), HEADER: checksum(0)}
    metadata = {"format": FORMAT, "version": VERSION, "config": config} | sums
    part = path.with_name(f".{path.name}.part")
    try:
        # The library creates files with owner-only permissions; use the usual ones.
        part.touch()
        mode = part.stat().st_mode
        save_file(out, part, metadata)
        add_checksum(part, config)
        part.chmod(mode)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
