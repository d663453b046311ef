"""A library of arm movements cut from captures: their displacement, duration, and path.

A movement is a minimum-jerk path from start to end plus a deviation: `BENDS` smooth shapes over its time, which vanish
with their first two derivatives at both ends. So it can connect any start and end, and keeps its own path and timing.
"""

from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path

import numpy as np

from umo_train.performer.captures import RATE, Arms
from umo_train.performer.curves import BENDS, bends, ease
from umo_train.performer.rotation import unit

FILE = "strokes.npz"
# Minimum peak speed of a movement in m/s, and share of the peak speed at which it ends.
_PEAK, _CALM = 0.35, 0.35
_SECONDS, _METRES = (0.2, 1.3), (0.06, 1.0)
# Arms held out at the start of a capture are not gestures.
_FARTHEST_M = 0.58
# Faster than any person's arm: a capture error.
_FASTEST = 7.0


@dataclass(frozen=True)
class Strokes:
    """For each movement, as a left arm: source names and index, duration in seconds `[n]`, start and end `[n, 3]`
    (outward, up, forward of the midpoint between the shoulders, m), deviation `[n, BENDS, 3]`, hold time afterwards
    `[n]`, and index of the other arm's simultaneous movement or -1 `[n]`."""

    sources: np.ndarray
    source: np.ndarray
    seconds: np.ndarray
    start: np.ndarray
    end: np.ndarray
    bend: np.ndarray
    hold: np.ndarray
    partner: np.ndarray

    def __len__(self) -> int:
        return len(self.seconds)

    def near(self, start: np.ndarray, end: np.ndarray, random: np.random.Generator, among: int = 6) -> int:
        """One of the movements with the most similar displacement and start."""
        ways = self.end - self.start
        way = end - start
        length = float(np.linalg.norm(way)) + 1e-6
        turned = 1.0 - unit(ways) @ (way / length)
        longer = np.log(np.linalg.norm(ways, axis=1) / length)
        apart = np.linalg.norm(self.start - start, axis=1)
        far = 1.5 * turned + 0.3 * np.abs(longer) + 0.8 * apart
        return int(random.choice(np.argpartition(far, among)[:among]))

    def bent(self, index: int, start: np.ndarray, end: np.ndarray) -> np.ndarray:
        """The movement's deviation on the path from `start` to `end` `[BENDS, 3]`: rotated and scaled with it."""
        old, new = self.end[index] - self.start[index], end - start
        ratio = float(np.linalg.norm(new) / np.linalg.norm(old))
        a, b = unit(old), unit(new + 1e-9)
        axis, cosine = np.cross(a, b), float(a @ b)
        if cosine < -0.9:
            # If the direction is reversed, left and right of the path would be swapped.
            return np.zeros((BENDS, 3))
        cross = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
        turn = np.eye(3) + cross + cross @ cross / (1.0 + cosine)
        return ratio * self.bend[index] @ turn.T


@cache
def library() -> Strokes:
    """The package's library."""
    with resources.as_file(resources.files("umo_train.performer") / FILE) as path:
        return read(path)


def read(path: Path) -> Strokes:
    with np.load(path) as data:
        floats = ("seconds", "start", "end", "bend", "hold")
        return Strokes(**{name: data[name].astype(float) if name in floats else data[name] for name in data.files})


def write(path: Path, strokes: Strokes) -> None:
    arrays = {name: getattr(strokes, name) for name in Strokes.__dataclass_fields__}
    np.savez_compressed(path, **{k: v.astype(np.float16) if v.dtype == float else v for k, v in arrays.items()})


def cut(captures: list[Arms]) -> Strokes:
    """All movements of both arms."""
    rows, pairs = [], []
    for number, arms in enumerate(captures):
        spans = [_spans(arms.wrist[arm]) for arm in (0, 1)]
        base = [len(rows), len(rows) + len(spans[0])]
        for arm in (0, 1):
            for index, (a, b) in enumerate(spans[arm]):
                following = spans[arm][index + 1][0] if index + 1 < len(spans[arm]) else len(arms.wrist[arm])
                path = arms.wrist[arm][a : b + 1]
                rows.append((number, (b - a) / RATE, path[0], path[-1], _bend(path), max(following - b, 0) / RATE))
                overlap = [(min(b, d) - max(a, c), k) for k, (c, d) in enumerate(spans[1 - arm])]
                most, other = max(overlap, default=(0, -1))
                pairs.append(base[1 - arm] + other if most > 0.5 * (b - a) else -1)
    source, seconds, start, end, bend, hold = (np.array(column) for column in zip(*rows, strict=True))
    names = np.array([arms.name for arms in captures])
    return Strokes(names, source.astype(np.int16), seconds, start, end, bend, hold, np.array(pairs, np.int16))


def _spans(wrist: np.ndarray) -> list[tuple[int, int]]:
    """First and last frame of each movement: from calm to calm around each peak of the speed."""
    from scipy.signal import find_peaks

    speed = np.linalg.norm(np.gradient(wrist, axis=0), axis=1) * RATE
    peaks = find_peaks(speed, height=_PEAK, prominence=0.25, distance=6)[0]
    out = []
    for peak in peaks:
        if speed[peak] > _FASTEST:
            continue
        calm = np.flatnonzero(speed < _CALM * speed[peak])
        before, after = calm[calm < peak], calm[calm > peak]
        if not len(before) or not len(after):
            continue
        # Extend to the minimum speed beyond, if it is near.
        a, b = int(before[-1]), int(after[0])
        a -= int(np.argmin(speed[max(a - 6, 0) : a + 1][::-1]))
        b += int(np.argmin(speed[b : b + 7]))
        long, far = (b - a) / RATE, float(np.linalg.norm(wrist[b] - wrist[a]))
        inside = np.abs(wrist[[a, b], 0]).max() < _FARTHEST_M
        if _SECONDS[0] <= long <= _SECONDS[1] and _METRES[0] <= far <= _METRES[1] and inside:
            if out and a < out[-1][1] - 2:
                continue
            out.append((a, b))
    return out


def _bend(path: np.ndarray) -> np.ndarray:
    """The best fitting deviation `[BENDS, 3]`."""
    s = np.linspace(0.0, 1.0, len(path))
    straight = path[0] + ease(s)[:, None] * (path[-1] - path[0])
    basis = bends(s)
    gram = basis.T @ basis + 0.02 * len(s) * np.eye(BENDS) * np.mean(basis**2)
    return np.linalg.solve(gram, basis.T @ (path - straight))
