"""Centroids of a k-means as published by fairseq: scikit-learn's `MiniBatchKMeans`, dumped by joblib."""

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import torch
from joblib.numpy_pickle import NumpyArrayWrapper, NumpyUnpickler

from umo_train.convert.inert import inert
from umo_train.convert.layout import Config, audio_shapes
from umo_train.convert.sources import SourceError, Tensors, read, renamed

_NAME = "audio.kmeans.centroids"
_ATTRIBUTE = "cluster_centers_"


class _Array(NumpyArrayWrapper):
    """joblib's class without its unpickling of object arrays, which older versions allow."""

    def read_array(self, unpickler: NumpyUnpickler, *arguments: Any) -> np.ndarray:
        if self.dtype.hasobject:
            raise pickle.UnpicklingError("an array of objects instead of numbers")
        return super().read_array(unpickler, *arguments)


# Sufficient for numbers; every other class becomes an inert object.
_KNOWN = {
    ("joblib.numpy_pickle", "NumpyArrayWrapper"): _Array,
    # scikit-learn before 0.23 had its own copy.
    ("sklearn.externals.joblib.numpy_pickle", "NumpyArrayWrapper"): _Array,
    ("numpy", "ndarray"): np.ndarray,
    ("numpy", "dtype"): np.dtype,
}


class _Unpickler(NumpyUnpickler):
    def find_class(self, module: str, name: str) -> Any:
        return _KNOWN.get((module, name)) or inert(f"{module}.{name}")


def convert(path: Path, config: Config) -> Tensors:
    """`audio.kmeans.centroids` from a joblib dump, a `.npy` of rows, or a safetensors file with one tensor."""
    if not path.is_file():
        raise SourceError(f"{path}: there is no such file")
    if path.suffix == ".safetensors":
        found = read(path)
        name = next(iter(found)) if len(found) == 1 else _NAME
    else:
        name = _ATTRIBUTE
        found = {name: torch.from_numpy(_rows(path))}
    return renamed(f"{path} (k-means)", found, {_NAME: name}, audio_shapes(config))


def _rows(path: Path) -> np.ndarray:
    if path.suffix == ".npy":
        return np.load(path, allow_pickle=False)
    with path.open("rb") as file:
        if file.peek(1)[:1] != b"\x80":
            raise SourceError(f"{path}: not a joblib dump, or a compressed one: dump it again with `compress=0`")
        try:
            model = _Unpickler(str(path), file, ensure_native_byte_order=True).load()
        except Exception as error:
            # A pickle that is damaged or needs other classes can fail in any way.
            raise SourceError(f"{path}: cannot read a k-means from it: {error}") from error
    rows = getattr(model, _ATTRIBUTE, model)
    if not isinstance(rows, np.ndarray):
        raise SourceError(f"{path}: no `{_ATTRIBUTE}` in it, which scikit-learn's k-means have")
    return np.ascontiguousarray(rows, dtype=np.float32)
