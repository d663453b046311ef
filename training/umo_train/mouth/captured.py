"""Captured mouths as training data: ARKit's channels fitted to landmarks of a talker, and to weights of a rig.

Both keep the talker's own timing. Their size is the figure's: 1st to 99th percentile of the talker go to the range in
which the performer speaks, so that no talker's habits become everybody's.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.signal import resample_poly

from umo_train.mouth.recordings import read
from umo_train.performer.lips import OPENING
from umo_train.skeleton import ARKIT, SHAPE
from umo_train.speech.utterance import FRAME_RATE, SAMPLE_RATE

# Every n-th sentence of a talker is for tests: the ones that `benches/lips` draws with its seed.
SEED, SHARE = 59, 10
GRID_RATE = 25.0
# Opening, rounding, spread of the corners and jaw of the figure at the talker's 99th percentile.
OPEN, ROUND, SPREAD, JAW_DOWN = 0.5, 0.8, 0.42, 0.42
# Share of the narrowness beyond the rounding that goes to the rounding.
NARROWED = 0.6
# Parts of the opening that lower and upper lip give at most, in their channels' units.
LOWER, UPPER = 0.9, 0.45
_STILL = 1e-6
# Landmarks of MediaPipe's face mesh.
CORNERS, EYES, INNER, CHIN = (61, 291), (33, 263), (13, 14), (1, 152)
UPPER_RED, LOWER_RED = (0, 13), (14, 17)
# Channels that a capture knows; the others are not learned from it.
KNOWN = (
    *("jawOpen", "mouthClose", "mouthFunnel", "mouthPucker", "mouthRollLower", "mouthRollUpper"),
    *("mouthSmileLeft", "mouthSmileRight", "mouthStretchLeft", "mouthStretchRight", "mouthPressLeft"),
    *("mouthPressRight", "mouthLowerDownLeft", "mouthLowerDownRight", "mouthUpperUpLeft", "mouthUpperUpRight"),
)


@dataclass(frozen=True)
class Capture:
    """Speech at 16 kHz, and ARKit's channels `[T, 52]`, `rate` a second."""

    name: str
    samples: np.ndarray
    mouth: np.ndarray
    rate: float

    def faster(self, speed: float) -> "Capture":
        """The same, played `speed` times as fast: voices of another size."""
        count = round(len(self.samples) / speed)
        samples = resample_poly(self.samples, 100, round(100 * speed))[:count].astype(np.float32)
        return replace(self, samples=samples, rate=self.rate * round(100 * speed) / 100)

    def frames(self) -> np.ndarray:
        """Channels at the frames of the samples `[frames, 52]`."""
        t = np.arange(len(self.samples) * FRAME_RATE // SAMPLE_RATE) / FRAME_RATE
        return np.stack([np.interp(t, np.arange(len(self.mouth)) / self.rate, column) for column in self.mouth.T], 1)

    def pieces(self, seconds: float) -> list["Capture"]:
        """Cut into pieces of this length; the last one may be longer."""
        count = max(int(len(self.samples) / SAMPLE_RATE / seconds), 1)
        out = []
        for i in range(count):
            first, last = i * seconds, (i + 1) * seconds
            sound, moved = (
                slice(round(first * rate), round(last * rate) if i + 1 < count else None)
                for rate in (SAMPLE_RATE, self.rate)
            )
            out.append(replace(self, name=f"{self.name}/{i}", samples=self.samples[sound], mouth=self.mouth[moved]))
        return out


def held_out(names: Sequence[str]) -> set[str]:
    """Sentences that `benches/lips` measures."""
    every = sorted(names)
    return set(np.random.default_rng(SEED).permutation(every)[: round(len(every) / SHARE)].tolist())


def landmarks(folder: Path) -> list[Capture]:
    """Sentences of a folder with `landmarks_*.npz`, `words.json` and `audio`, without those held out."""
    words = json.loads((folder / "words.json").read_text())
    left_out = held_out(list(words))
    lengths = {}
    for path in sorted(folder.glob("landmarks_*.npz")):
        with np.load(path) as file:
            points, at = file["landmarks"], {int(point): i for i, point in enumerate(file["index"])}
            for row, name in enumerate(file["names"].tolist()):
                if name not in left_out:
                    lengths[name] = _lengths(points[row, :, :, :2].astype(np.float64), at)
    silent = {name: _silent(words[name], len(found)) for name, found in lengths.items()}
    every = np.concatenate(list(lengths.values()))
    rest = np.median(np.concatenate([found[silent[name]] for name, found in lengths.items()]), axis=0)
    least, most = np.percentile(every, (1, 99), axis=0)
    out = []
    for name, found in lengths.items():
        samples = read(folder / "audio" / f"{name}.opus")
        out.append(Capture(name, samples, fitted(found, rest, least, most), GRID_RATE))
    return out


def _lengths(points: np.ndarray, at: dict[int, int]) -> np.ndarray:
    """`[T, points, 2]` to the gap of the lips, the mouth's width, the red's height over it, that of each lip, and the
    jaw's length, in units of the eyes' distance `[T, 6]`."""

    def distance(pair: tuple[int, int]) -> np.ndarray:
        return np.linalg.norm(points[:, at[pair[0]]] - points[:, at[pair[1]]], axis=-1)

    unit = np.median(distance(EYES))
    width, upper, lower = distance(CORNERS), distance(UPPER_RED), distance(LOWER_RED)
    lengths = (distance(INNER), width, unit * (upper + lower) / width, upper, lower, distance(CHIN))
    return np.stack(lengths, axis=1) / unit


def _silent(words: Sequence[tuple[float, float, str]], frames: int) -> np.ndarray:
    """Frames well within the silences."""
    t = np.arange(frames) / GRID_RATE
    return np.any([(t >= a + 0.15) & (t <= b - 0.2) for a, b, word in words if word in ("sil", "sp")], axis=0)


def fitted(lengths: np.ndarray, rest: np.ndarray, least: np.ndarray, most: np.ndarray) -> np.ndarray:
    """Lengths `[T, 6]` to channels `[T, 52]` with the same opening, width and rounding, scaled."""
    # A length that never moves is at rest.
    up = (lengths - rest) / np.maximum(most - rest, _STILL)
    down = (rest - lengths) / np.maximum(rest - least, _STILL)
    open_ = np.clip((lengths[:, 0] - least[0]) / max(most[0] - least[0], _STILL), 0, 1.3)
    rounded = ROUND * np.clip(up[:, 2] + 0.1, 0, 1.2)
    width = np.where(up[:, 1] > 0, SPREAD * up[:, 1], -ROUND * down[:, 1])
    # Only rounding draws the corners together: a mouth that is narrower than it is round is made rounder.
    rounded += NARROWED * np.maximum(-width - rounded, 0)
    spread = np.clip(width + rounded, 0, 0.8)
    closed = np.clip(1 - open_ / 0.1, 0, 1)
    lower, upper = (closed * np.clip(down[:, i], 0, 1) for i in (4, 3))
    sealed = np.maximum(lower, upper)
    # Pursed lips are round and nearly closed, funnelled ones open.
    share = np.clip(open_ / 0.5, 0.1, 0.6)
    out = np.zeros((len(lengths), len(ARKIT)))

    def put(value: np.ndarray, *names: str) -> None:
        for name in names:
            out[:, SHAPE[name]] = value

    put(rounded * share, "mouthFunnel")
    put(rounded * (1 - share), "mouthPucker")
    put(0.6 * spread, "mouthStretchLeft", "mouthStretchRight")
    put(0.4 * spread, "mouthSmileLeft", "mouthSmileRight")
    put(0.3 * lower, "mouthRollLower")
    put(0.15 * upper, "mouthRollUpper")
    put(0.3 * sealed, "mouthPressLeft", "mouthPressRight")
    put(LOWER * OPEN * open_, "mouthLowerDownLeft", "mouthLowerDownRight")
    put(UPPER * OPEN * open_, "mouthUpperUpLeft", "mouthUpperUpRight")
    return _jaw(out, OPEN * open_ - 0.03 * closed, JAW_DOWN * np.clip(up[:, 5], 0, 1.2))


def _jaw(out: np.ndarray, opening: np.ndarray, jaw: np.ndarray) -> np.ndarray:
    """Sets the jaw, lowered enough for the opening, and the lips that close over it."""
    lips = out @ OPENING
    out[:, SHAPE["jawOpen"]] = np.clip(np.maximum(jaw, opening - lips), 0, 1)
    out[:, SHAPE["mouthClose"]] = np.clip(out @ OPENING - opening, 0, 1)
    return out


def weights(folder: Path, takes: Sequence[str]) -> list[Capture]:
    """Takes of captured rig weights: `NAME.npz` with `weights` and `fps`, `NAME.opus`, `weight_names.txt`."""
    names = (folder / "weight_names.txt").read_text().split()
    found = []
    for take in takes:
        with np.load(folder / f"{take}.npz") as file:
            found.append((take, file["weights"].astype(np.float64), float(file["fps"])))
    every = [_of_rig(values, names) for _, values, _ in found]
    size = OPEN / np.percentile(np.concatenate(every) @ OPENING, 99)
    out = []
    for (take, _, rate), face in zip(found, every, strict=True):
        samples = read(folder / f"{take}.opus")
        scaled = face.copy()
        for name in ("jawOpen", "mouthLowerDownLeft", "mouthLowerDownRight", "mouthUpperUpLeft", "mouthUpperUpRight"):
            scaled[:, SHAPE[name]] *= size
        out.append(Capture(take, samples, np.clip(scaled, 0, 1), rate))
    return out


# ARKit's channels and the rig's shapes, each the mean over the named sides.
RIG = {
    "jawOpen": [("stretch", "c")],
    "mouthFunnel": [("funnel", "dl dr ul ur"), ("oh", "c")],
    "mouthPucker": [("pucker", "l r"), ("oo", "c")],
    "mouthSmileLeft": [("lipCornerPull", "l")],
    "mouthSmileRight": [("lipCornerPull", "r")],
    "mouthStretchLeft": [("lipStretch", "l")],
    "mouthStretchRight": [("lipStretch", "r")],
    "mouthRollLower": [("suck", "dl dr")],
    "mouthRollUpper": [("suck", "ul ur")],
    "mouthPressLeft": [("press", "l")],
    "mouthPressRight": [("press", "r")],
    "mouthLowerDownLeft": [("lowerLipDepress", "l")],
    "mouthLowerDownRight": [("lowerLipDepress", "r")],
    "mouthUpperUpLeft": [("upperLipRaise", "l")],
    "mouthUpperUpRight": [("upperLipRaise", "r")],
}


def _of_rig(values: np.ndarray, names: Sequence[str]) -> np.ndarray:
    """Weights `[T, 116]` to channels `[T, 52]`. Column `i + 1` belongs to name `i`."""
    column = {name: i + 1 for i, name in enumerate(names)}
    out = np.zeros((len(values), len(ARKIT)))
    for name, shapes in RIG.items():
        for shape, sides in shapes:
            prefix = "" if shape.startswith("jaw") else "mouth_"
            out[:, SHAPE[name]] += np.mean([values[:, column[f"{prefix}{shape}_{side}"]] for side in sides.split()], 0)
    return np.clip(out, 0, 1)
