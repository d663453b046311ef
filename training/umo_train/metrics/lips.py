"""Does the mouth say what is heard: against a reference, at closures, in pauses, and with the loudness.

How far it is open is told by `performer.lips.lip_opening`.
"""

from collections.abc import Iterable, Sequence

import numpy as np
from scipy.ndimage import gaussian_filter1d

from umo_train.skeleton import matrices
from umo_train.speech.utterance import FRAME_RATE, SAMPLE_RATE, SILENCE, Phone

CLOSING = frozenset("pbm")
# The neutral mouth (all coefficients 0) is closed: opening 0. A wide open one is some 45 mm between the lips, so 0.05
# is about 2 mm: what soft lips take up when they meet, and less than a pixel of a face 250 pixels high.
CLOSED = 0.05
# A pause's first and last tenth of a second belong to the sounds beside it: a mouth closes after the one and opens
# ahead of the other (anticipation of 100 ms and more is ordinary).
PAUSE_MARGIN = 3
PAUSE_S = 0.4
# What a still mouth may change in between: about 3 mm, as breathing and swallowing do; a short vowel opens 0.2 or more.
STILL = 0.08
# Standard deviation of the smoothing, frames (50 ms): leaves syllables, takes away bursts and single glottal pulses.
SMOOTH = 1.5


def pearson(a: np.ndarray, b: np.ndarray) -> float:
    """Pearson's correlation; 0 where either does not vary, as a mouth that never moves follows nothing."""
    a, b = np.asarray(a, np.float64) - np.mean(a), np.asarray(b, np.float64) - np.mean(b)
    size = np.sqrt((a @ a) * (b @ b))
    return float(a @ b / size) if size > 1e-9 * len(a) else 0.0


def jaw_opening(face: np.ndarray) -> np.ndarray:
    """Channels of the face `[T, 58]` to the angle in radians by which the jaw joint turns about its hinge (X)."""
    turn = matrices(np.asarray(face[:, :6], np.float64))
    return np.arctan2(turn[:, 2, 1], turn[:, 2, 2])


def closures(opening: np.ndarray, phones: Iterable[Phone], slack: int = 1) -> np.ndarray:
    """For each p, b or m whether the lips close in its time or at most `slack` frames from it `[count]`."""
    reached = []
    for phone in phones:
        if phone.name in CLOSING:
            first = max(round(phone.start * FRAME_RATE) - slack, 0)
            last = round(phone.end * FRAME_RATE) + slack
            if first < len(opening):
                reached.append(opening[first : last + 1].min() <= CLOSED)
    return np.array(reached, bool)


def pauses(opening: np.ndarray, silences: Iterable[tuple[float, float]]) -> np.ndarray:
    """For each silence (start and end in seconds) of at least 0.4 s whether the mouth is still in it `[count]`."""
    still = []
    for start, end in silences:
        if end - start < PAUSE_S - 1e-6:
            continue
        inner = opening[round(start * FRAME_RATE) + PAUSE_MARGIN : round(end * FRAME_RATE) - PAUSE_MARGIN]
        if len(inner) >= 2:
            still.append(np.ptp(inner) <= STILL)
    return np.array(still, bool)


def silences(phones: Sequence[Phone]) -> list[tuple[float, float]]:
    """Times of silence, in seconds; neighbours are one."""
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
    """Silences of a recording without phones: where its envelope is `below_db` under its loud parts (95th
    percentile)."""
    loudness = envelope(samples, len(samples) * FRAME_RATE // SAMPLE_RATE)
    quiet = np.concatenate([[False], loudness < np.percentile(loudness, 95) * 10 ** (below_db / 20), [False]])
    edges = np.flatnonzero(np.diff(quiet.astype(int))).reshape(-1, 2)
    return [(start / FRAME_RATE, end / FRAME_RATE) for start, end in edges]


def lag_correlation(pairs: Sequence[tuple[np.ndarray, np.ndarray]], most: int = 2) -> dict[int, float]:
    """Correlation of the mouth with the envelope, by lag in frames (positive: the mouth is late), over all recordings.

    Each pair is `(opening [T], envelope [T])`. A recording's level says nothing of its speaker: envelopes are divided
    by their own 95th percentile. The lag is one for all: a speaker's best is the largest value.
    """
    scaled = [(mouth, sound / max(np.percentile(sound, 95), 1e-6)) for mouth, sound in pairs]
    out = {}
    for lag in range(-most, most + 1):
        mouth = [m[max(lag, 0) : len(m) + min(lag, 0)] for m, _ in scaled]
        sound = [s[max(-lag, 0) : len(s) - max(lag, 0)] for _, s in scaled]
        out[lag] = pearson(np.concatenate(mouth), np.concatenate(sound))
    return out
