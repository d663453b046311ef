"""Types yielded by every reader."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from umo_train.speech.utterance import Utterance


class DataError(Exception):
    """A problem of a data set: the file, and the solution."""


@dataclass(frozen=True)
class Clip:
    """Speech, motion or both, of the same length: `speech.frames` is the number of frames of `motion`."""

    name: str
    speaker: str
    speech: Utterance | None = None
    # Channels of each part, f32 `[T, C]`.
    motion: dict[str, np.ndarray] | None = None
    # Position of the pelvis, f32 `[T, 3]`, metres, Y up, from which the root's velocity and height are learned.
    translation: np.ndarray | None = None


def folder(path: Path, what: str) -> Path:
    """`path`, if it is a folder; else an error."""
    if not path.is_dir():
        raise DataError(f"{path}: there is no such folder: {what}")
    return path


def file(path: Path, what: str) -> Path:
    """`path`, if it is a file; else an error."""
    if not path.is_file():
        raise DataError(f"{path}: there is no such file: {what}")
    return path
