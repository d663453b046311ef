"""Captured mouths: speech, and the opening, width and rounding of the lips measured at the same time."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import soundfile

TEN = Path(__file__).parent / "ten"
# The tenth of GRID that is measured, by a seed that nothing was chosen by.
SEED, SHARE = 59, 10
# Takes of the actress that the mouth network learned from (`training/configs/mouth.yaml`): not measured.
LEARNED = ("2_01", "2_02")
# Landmarks of MediaPipe's face mesh.
CORNERS, EYES, INNER = (61, 291), (33, 263), (13, 14)
UPPER_RED, LOWER_RED = (0, 13), (14, 17)
GRID_RATE, SCALE = 25.0, 1 / 16
# Values are written in steps of 0.0001.
STEPS = 1e4


@dataclass(frozen=True)
class Word:
    text: str
    start: float
    end: float


@dataclass(frozen=True)
class Recording:
    """Speech with its captured mouth: opening, width and rounding `[T, 3]` at `times [T]` in seconds. `words` is empty
    where they are unknown."""

    name: str
    samples: np.ndarray
    rate: int
    times: np.ndarray
    mouth: np.ndarray
    words: tuple[Word, ...] = ()

    @property
    def seconds(self) -> float:
        return len(self.samples) / self.rate

    @property
    def text(self) -> str:
        return " ".join(
            word.text for word in self.words if word.text not in ("sil", "sp")
        )


def _read(path: Path) -> tuple[np.ndarray, int]:
    samples, rate = soundfile.read(path, dtype="float32", always_2d=True)
    return samples.mean(1), rate


def mouth_of_landmarks(landmarks: np.ndarray, index: Sequence[int]) -> np.ndarray:
    """Landmarks `[T, points, 2 or more]` of the mesh's points `index` to the mouth `[T, 3]`.

    Lengths are in units of the distance of the eyes' outer corners, its median over the recording. Rounding is the
    height of the red of both lips over the mouth's width: pursed lips are thick and narrow. The landmarks' depth does
    not serve: it comes from one picture, and rounded vowels have it no different from others.
    """
    at = {int(point): column for column, point in enumerate(index)}

    def distance(pair: tuple[int, int]) -> np.ndarray:
        first, second = (
            landmarks[:, at[point], :2].astype(np.float64) for point in pair
        )
        return np.linalg.norm(first - second, axis=-1)

    width = distance(CORNERS)
    unit = np.median(distance(EYES))
    rounding = (distance(UPPER_RED) + distance(LOWER_RED)) / width
    return np.stack([distance(INNER) / unit, width / unit, rounding], axis=1)


def grid(folder: Path, names: Sequence[str] | None = None) -> list[Recording]:
    """The seeded tenth of the talker's sentences, or the named ones: `landmarks_*.npz`, `words.json`, `audio`."""
    words = json.loads((folder / "words.json").read_text())
    if names is None:
        every = sorted(words)
        names = sorted(
            np.random.default_rng(SEED)
            .permutation(every)[: round(len(every) / SHARE)]
            .tolist()
        )
    mouths = {}
    for path in sorted(folder.glob("landmarks_*.npz")):
        with np.load(path) as file:
            rows = {str(name): row for row, name in enumerate(file["names"])}
            landmarks, index = file["landmarks"], file["index"]
        wanted = [name for name in names if name in rows]
        mouths |= {
            name: mouth_of_landmarks(landmarks[rows[name]] * SCALE, index)
            for name in wanted
        }
    out = []
    for name in names:
        samples, rate = _read(folder / "audio" / f"{name}.opus")
        times = np.arange(len(mouths[name])) / GRID_RATE
        out.append(
            Recording(
                name,
                samples,
                rate,
                times,
                mouths[name],
                tuple(Word(w, a, b) for a, b, w in words[name]),
            )
        )
    return out


def mouth_of_weights(weights: np.ndarray, names: Sequence[str]) -> np.ndarray:
    """Weights `[T, 116]` of the actress's rig to the mouth `[T, 3]`.

    Column `i + 1` of the weights belongs to line `i` of `weight_names.txt`: only so do the left and right half of each
    shape move alike, and the loudness go with the jaw. Opening is `umo_train.performer.lips.lip_opening` with the rig's
    counterparts of ARKit's shapes; width is spreading less narrowing; rounding is the sum of the four rounded shapes.
    """
    column = {name: index + 1 for index, name in enumerate(names)}

    def mean(name: str, sides: str) -> np.ndarray:
        return np.mean(
            [weights[:, column[f"mouth_{name}_{side}"]] for side in sides.split()],
            axis=0,
        )

    funnel, suck = mean("funnel", "dl dr ul ur"), mean("suck", "dl dr ul ur")
    raised = mean("lowerLipDepress", "l r") + mean("upperLipRaise", "l r")
    opening = (
        mean("stretch", "c")
        + 0.2 * raised
        + 0.05 * funnel
        - 0.1 * suck
        - 0.06 * mean("press", "l r")
    )
    rounding = mean("pucker", "l r") + funnel + mean("oo", "c") + mean("oh", "c")
    width = mean("lipStretch", "l r") + mean("lipCornerPull", "l r") - rounding
    return np.stack([np.maximum(opening, 0.0), width, rounding], axis=1).astype(
        np.float64
    )


def face(folder: Path) -> list[Recording]:
    """Takes of captured weights (`*.npz` with `weights` and `fps`) with their sound, and `weight_names.txt`, without
    those that umo learned from."""
    names = (folder / "weight_names.txt").read_text().split()
    out = []
    for path in sorted(
        path for path in folder.glob("*.npz") if path.stem not in LEARNED
    ):
        with np.load(path) as file:
            mouth, rate = mouth_of_weights(file["weights"], names), float(file["fps"])
        out.append(
            Recording(
                path.stem,
                *_read(path.with_suffix(".opus")),
                np.arange(len(mouth)) / rate,
                mouth,
            )
        )
    return out


def ten(folder: Path = TEN) -> list[Recording]:
    """The ten sentences of the repository."""
    out = []
    for name, entry in json.loads((folder / "mouths.json").read_text()).items():
        mouth = np.array(entry["mouth"]) / STEPS
        words = tuple(Word(text, start, end) for start, end, text in entry["words"])
        out.append(
            Recording(
                name,
                *_read(folder / f"{name}.opus"),
                np.arange(len(mouth)) / GRID_RATE,
                mouth,
                words,
            )
        )
    return out
