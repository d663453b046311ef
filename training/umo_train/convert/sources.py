"""Tensors of published checkpoints, by name."""

import json
import pickle
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from torch import Tensor

from umo_train.convert.inert import inert
from umo_train.convert.layout import Shapes

Tensors = dict[str, Tensor]

# Hugging Face's names of a checkpoint's files, the safer format first.
_WHOLE = ("model.safetensors", "pytorch_model.bin")
# Keys under which trainers store the weights: PyTorch Lightning and Language of Motion; EMAGE.
_NESTED = ("state_dict", "model_state")


class SourceError(Exception):
    """A problem of a file to convert, and its solution."""


def read(path: Path) -> Tensors:
    """Reads a safetensors or PyTorch file, or a folder written by `save_pretrained`, also with shards."""
    if not path.exists():
        raise SourceError(f"{path}: there is no such file or folder")
    if not path.is_dir():
        return _unwrapped(_safetensors(path) if path.suffix == ".safetensors" else _pickled(path))
    for name in _WHOLE:
        if (path / name).is_file():
            return read(path / name)
        index = path / f"{name}.index.json"
        if index.is_file():
            return _sharded(index)
    raise SourceError(f"{path}: contains neither {', '.join(_WHOLE)} nor an index of shards")


def read_json(path: Path) -> dict[str, Any]:
    """A JSON object."""
    if not path.is_file():
        raise SourceError(f"{path}: there is no such file; it belongs to the checkpoint")
    try:
        found = json.loads(path.read_text("utf-8"))
    except ValueError as error:
        raise SourceError(f"{path}: no JSON: {error}") from error
    if not isinstance(found, dict):
        raise SourceError(f"{path}: expected a JSON object")
    return found


def _sharded(index: Path) -> Tensors:
    weights: dict[str, str] = read_json(index).get("weight_map", {})
    out: Tensors = {}
    for shard in sorted(set(weights.values())):
        out |= read(index.parent / shard)
    missing = sorted(weights.keys() - out.keys())
    if missing:
        raise SourceError(f"{index}: its shards lack {', '.join(missing)}")
    return out


def _safetensors(path: Path) -> Tensors:
    try:
        with safe_open(path, framework="pt") as file:
            return {name: file.get_tensor(name) for name in file.keys()}
    except SafetensorError as error:
        raise SourceError(f"{path}: not a safetensors file: {error}") from error


def _pickled(path: Path) -> dict[str, Any]:
    """A file of `torch.save`. Classes of the trainer, such as its configuration, become inert objects."""
    try:
        try:
            unsafe = torch.serialization.get_unsafe_globals_in_checkpoint(path)
        except ValueError:
            # Written before PyTorch 1.6: not an archive that can be inspected.
            unsafe = []
        with torch.serialization.safe_globals([(inert(name), name) for name in unsafe]):
            found = torch.load(path, map_location="cpu", weights_only=True)
    except (pickle.UnpicklingError, RuntimeError, EOFError, ValueError) as error:
        raise SourceError(f"{path}: not a PyTorch file of weights: {str(error).splitlines()[0]}") from error
    if not isinstance(found, dict):
        raise SourceError(f"{path}: expected tensors by name, got {type(found).__name__}")
    return found


def _unwrapped(found: dict[str, Any]) -> Tensors:
    """The weights of a trainer's file without the name prefix of `DataParallel`."""
    for key in _NESTED:
        if isinstance(found.get(key), dict):
            found = found[key]
    tensors = {name: tensor for name, tensor in found.items() if isinstance(tensor, Tensor)}
    if tensors and all(name.startswith("module.") for name in tensors):
        tensors = {name.removeprefix("module."): tensor for name, tensor in tensors.items()}
    return tensors


def renamed(what: str, source: Tensors, names: dict[str, str], shapes: Shapes, ignored: Iterable[str] = ()) -> Tensors:
    """The tensors `names` (ours to theirs) as f32. Raises an error that lists tensors that are missing, have another
    shape, or are neither requested nor matched by one of the expressions `ignored`."""
    wanted = set(names.values())
    skip = re.compile("|".join(ignored) or r"(?!)")
    problems = [f"missing: {name}" for name in sorted(wanted - source.keys())]
    problems += [f"unknown: {name}" for name in sorted(source.keys() - wanted) if not skip.fullmatch(name)]
    for ours, theirs in names.items():
        if theirs in source and tuple(source[theirs].shape) != shapes[ours]:
            found = list(source[theirs].shape)
            problems.append(f"{theirs}: expected {list(shapes[ours])}, got {found}")
    if problems:
        raise SourceError(f"{what}:\n  " + "\n  ".join(dict.fromkeys(problems)))
    return {ours: source[theirs].float() for ours, theirs in names.items()}


def agree(what: str, ours: dict[str, Any], theirs: dict[str, Any]) -> None:
    """Refuses a checkpoint with a configuration that contradicts ours."""
    differ = [f"{key}: {theirs[key]!r}, the config has {ours[key]!r}" for key in theirs if theirs[key] != ours[key]]
    if differ:
        raise SourceError(f"{what}:\n  " + "\n  ".join(differ))
