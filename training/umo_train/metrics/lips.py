"""Whether the mouth matches the sound: compared with a reference, at closures, in pauses, and with the loudness.

Its opening is defined by `performer.lips.lip_opening`.
"""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import gaussian_filter1d

from umo_train.performer.lips import JAW
from umo_train.skeleton import ARKIT, matrices
from umo_train.speech.utterance import FRAME_RATE, SAMPLE_RATE, SILENCE, Phone

CLOSING = frozenset("pbm")
# The neutral mouth (all coefficients 0) is closed: opening 0. A wide open one has about 45 mm between the lips, so 0.05
# is about 2 mm: the compression of soft lips when they meet, and less than a pixel of a face 250 pixels high.
CLOSED = 0.05
# The first and last tenth of a second of a pause belong to the adjacent sounds: a mouth closes after one and opens
# ahead of the next (anticipation of 100 ms and more is normal).
PAUSE_MARGIN = 3
PAUSE_S = 0.4
# Maximum variation of a still mouth in between: about 3 mm, as in breathing and swallowing; a short vowel opens 0.2 or
# more.
STILL = 0.08
# Standard deviation of the smoothing, frames (50 ms): keeps syllables, removes bursts and single glottal pulses.
SMOOTH = 1.5
# Channels that draw the corners of the mouth apart, and those that draw them together.
_WIDTHS = {
    "mouthStretchLeft": 0.5,
    "mouthStretchRight": 0.5,
    "mouthSmileLeft": 0.5,
    "mouthSmileRight": 0.5,
    "mouthPucker": -1.0,
    "mouthFunnel": -1.0,
}
WIDTH = np.array([_WIDTHS.get(name, 0.0) for name in ARKIT])


def pearson(a: np.ndarray, b: np.ndarray) -> float:
    """Pearson's correlation; 0 if either does not vary, as a mouth that never moves follows nothing."""
    a, b = np.asarray(a, np.float64) - np.mean(a), np.asarray(b, np.float64) - np.mean(b)
    size = np.sqrt((a @ a) * (b @ b))
    return float(a @ b / size) if size > 1e-9 * len(a) else 0.0


def jaw_opening(face: np.ndarray) -> np.ndarray:
    """Face channels `[T, 58]` to the angle in radians of the jaw joint about its hinge (X)."""
    turn = matrices(np.asarray(face[:, :6], np.float64))
    return np.arctan2(turn[:, 2, 1], turn[:, 2, 2])


def closures(opening: np.ndarray, phones: Iterable[Phone], slack: int = 1) -> np.ndarray:
    """For each p, b or m, whether the lips close during it or within `slack` frames `[count]`."""
    reached = []
    for phone in phones:
        if phone.name in CLOSING:
            first = max(round(phone.start * FRAME_RATE) - slack, 0)
            last = round(phone.end * FRAME_RATE) + slack
            if first < len(opening):
                reached.append(opening[first : last + 1].min() <= CLOSED)
    return np.array(reached, bool)


def pauses(opening: np.ndarray, silences: Iterable[tuple[float, float]]) -> np.ndarray:
    """For each silence (start and end in seconds) of at least 0.4 s, whether the mouth is still during it `[count]`."""
    still = []
    for start, end in silences:
        if end - start < PAUSE_S - 1e-6:
            continue
        inner = opening[round(start * FRAME_RATE) + PAUSE_MARGIN : round(end * FRAME_RATE) - PAUSE_MARGIN]
        if len(inner) >= 2:
            still.append(np.ptp(inner) <= STILL)
    return np.array(still, bool)


def moving(opening: np.ndarray, silences: Iterable[tuple[float, float]]) -> np.ndarray:
    """Whether the mouth moves in each stretch of 0.4 s within silences, without their margins `[stretches]`."""
    size = round(PAUSE_S * FRAME_RATE)
    moved = [np.zeros(0, bool)]
    for start, end in silences:
        inner = opening[round(start * FRAME_RATE) + PAUSE_MARGIN : round(end * FRAME_RATE) - PAUSE_MARGIN]
        if len(inner) >= size:
            moved.append(np.ptp(sliding_window_view(inner, size), axis=1) > STILL)
    return np.concatenate(moved)


def width(face: np.ndarray) -> np.ndarray:
    """Face channels `[T, 58]` to the mouth's width `[T]`: 0 at rest, 1 fully stretched, -1 fully puckered."""
    return face[..., JAW:] @ WIDTH.astype(face.dtype)


def silences(phones: Sequence[Phone]) -> list[tuple[float, float]]:
    """Times of silence in seconds, adjacent ones merged."""
    found: list[tuple[float, float]] = []
    for phone in phones:
        if phone.name != SILENCE:
            continue
        start = found.pop()[0] if found and abs(found[-1][1] - phone.start) < 1e-3 else phone.start
        found.append((start, phone.end))
    return found


def envelope(samples: np.ndarray, frames: int) -> np.ndarray:
    """Loudness of speech at 16 kHz at each frame `[frames]`: root mean square of the frame around it, smoothed."""
    hop = SAMPLE_RATE / FRAME_RATE
    power = np.concatenate([[0.0], np.cumsum(np.asarray(samples, np.float64) ** 2)])
    edges = np.clip(np.round((np.arange(frames + 1) - 0.5) * hop).astype(int), 0, len(samples))
    width = np.maximum(np.diff(edges), 1)
    return gaussian_filter1d(np.sqrt(np.diff(power[edges]) / width), SMOOTH)


def quiet_parts(samples: np.ndarray, below_db: float = -35.0) -> list[tuple[float, float]]:
    """Silences of recordings without phones: where the envelope is `below_db` under its 95th percentile."""
    loudness = envelope(samples, len(samples) * FRAME_RATE // SAMPLE_RATE)
    quiet = np.concatenate([[False], loudness < np.percentile(loudness, 95) * 10 ** (below_db / 20), [False]])
    edges = np.flatnonzero(np.diff(quiet.astype(int))).reshape(-1, 2)
    return [(start / FRAME_RATE, end / FRAME_RATE) for start, end in edges]


def lag_correlation(pairs: Sequence[tuple[np.ndarray, np.ndarray]], most: int = 2) -> dict[int, float]:
    """Correlation of the mouth with the envelope, by lag in frames (positive: the mouth is late), over all recordings.

    Each pair is `(opening [T], envelope [T])`. A recording's level is arbitrary: envelopes are divided by their own
    95th percentile. The lag is common to all: a speaker's best is the largest value.
    """
    scaled = [(mouth, sound / max(np.percentile(sound, 95), 1e-6)) for mouth, sound in pairs]
    out = {}
    for lag in range(-most, most + 1):
        mouth = [m[max(lag, 0) : len(m) + min(lag, 0)] for m, _ in scaled]
        sound = [s[max(-lag, 0) : len(s) - max(lag, 0)] for _, s in scaled]
        out[lag] = pearson(np.concatenate(mouth), np.concatenate(sound))
    return out
