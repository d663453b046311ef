"""Beat constancy (Liu et al. 2022, BEAT): whether speech onsets coincide with turning points of the upper body."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import argrelmin, find_peaks

from umo_train.metrics.item import Item, Motion
from umo_train.metrics.motion import joint_places, joint_speed
from umo_train.skeleton import JOINTS_OF
from umo_train.speech.utterance import FRAME_RATE, SAMPLE_RATE

# BEAT's, seconds.
SIGMA_S = 0.3
# Real speech has 4.6 onsets a second: with BEAT's width everything is close to one. With turning points placed exactly
# on the onsets of 23 recordings (VCTK, LibriSpeech), own audio scored at most 1.05 times shifted audio at 0.3 s, and
# 1.25 to 1.32 times at 0.1 s. With one event a second (accented syllables) it is 2 times at 0.3 s.
SHARP_SIGMA_S = 0.1
# A minimum must be the lowest within this many frames on each side, as in BEAT's code.
ORDER = 7
# Smooth-BC: standard deviation of the positions' low-pass, frames (-3 dB at 2 Hz). A minimum of the speed counts if its
# shallower side is deeper than `DEPTH_M_S` and this share of the speed that the low-pass removes, which is jitter.
SMOOTHED, DEPTH_M_S, OF_JITTER = 2.0, 0.03, 0.4
# Shifts of the audio, seconds: at least 0.4, so that a syllable does not meet its neighbour's gesture, and not
# multiples of each other, so that a steady rhythm does not always meet itself.
SHIFTS_S = (0.43, 0.71, 1.13, 1.57, 2.03, 2.69)


def onsets(samples: np.ndarray) -> np.ndarray:
    """Times of onsets in speech at 16 kHz, seconds: peaks of the spectral flux, moved back to the energy's rise."""
    import librosa

    samples = np.asarray(samples, np.float32)
    hop = SAMPLE_RATE // 100
    return librosa.onset.onset_detect(y=samples, sr=SAMPLE_RATE, hop_length=hop, backtrack=True, units="time")


def stressed(item: Item) -> np.ndarray:
    """Starts of the vowels of accented words' stressed syllables, seconds, where strokes should fall. Without accents,
    all stressed syllables."""
    most = min(max((phone.stress for phone in item.phones), default=0), 2)
    return np.array([phone.start for phone in item.phones if most and phone.stress >= most])


def turning_points(motion: Motion) -> np.ndarray:
    """Times of minimal mean speed of the upper body, seconds."""
    return argrelmin(joint_speed(motion), order=ORDER)[0] / FRAME_RATE


def smooth_turning_points(motion: Motion) -> np.ndarray:
    """Turning points that jitter does not make, for Smooth-BC, seconds: minima of the mean speed of the smoothed upper
    body that stand out of it.

    arXiv 2601.04236 names such a measure; its text was not at hand, so that the definition is ours.
    """
    places = joint_places(motion, walking=False)[:, JOINTS_OF["upper"]]
    smooth = gaussian_filter1d(places, SMOOTHED, axis=0)

    def speed(at: np.ndarray) -> np.ndarray:
        return np.linalg.norm(np.gradient(at, 1 / FRAME_RATE, axis=0), axis=-1).mean(1)

    depth = DEPTH_M_S + OF_JITTER * np.median(speed(places - smooth))
    return find_peaks(-speed(smooth), prominence=depth)[0] / FRAME_RATE


def constancy(events: np.ndarray, turns: np.ndarray, sigma: float = SIGMA_S) -> float:
    """Mean over the audio's events of `exp(-d^2 / 2 sigma^2)`, with `d` the time to the nearest turning point; 0
    without any."""
    if len(events) == 0 or len(turns) == 0:
        return 0.0
    nearest = np.abs(np.subtract.outer(events, turns)).min(1)
    return float(np.exp(-(nearest**2) / (2 * sigma**2)).mean())


@dataclass(frozen=True)
class Beat:
    """Constancy over all recordings with their own audio and with shifted audio."""

    own: float
    shifted: float

    @property
    def ratio(self) -> float:
        return self.own / self.shifted if self.shifted > 0 else 0.0


def beat(pairs: Sequence[tuple[np.ndarray, np.ndarray, float]], sigma: float = SIGMA_S) -> Beat:
    """`pairs` are `(events, turning points, seconds)` of each recording; each counts by its number of events.

    Audio is shifted cyclically, so that the same amount overlaps the motion. Recordings shorter than twice the smallest
    shift are left out.
    """
    own, shifted, weights = [], [], []
    for events, turns, seconds in pairs:
        shifts = [shift for shift in SHIFTS_S if SHIFTS_S[0] <= seconds - shift]
        if len(events) and shifts:
            own.append(constancy(events, turns, sigma))
            shifted.append(np.mean([constancy(np.mod(events + shift, seconds), turns, sigma) for shift in shifts]))
            weights.append(len(events))
    if not weights:
        return Beat(0.0, 0.0)
    return Beat(float(np.average(own, weights=weights)), float(np.average(shifted, weights=weights)))
