"""Time-warps speech with its pitch kept: waveform-similarity overlap-add (WSOLA) along a map of times."""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from umo_train.speech.utterance import SAMPLE_RATE

_WINDOW = 400
_HOP = _WINDOW // 2
# Maximum shift of a window for aligning waves: half a period of a voice of 60 Hz.
_REACH = 134


def warped(samples: np.ndarray, heard: np.ndarray, wanted: np.ndarray, length: int) -> np.ndarray:
    """`length` samples in which the sound at `heard[i]` seconds of `samples` is at `wanted[i]`; both ascend. Outside of
    them, time runs unchanged."""
    margin = _WINDOW + _REACH
    source = np.pad(samples.astype(np.float32), margin)
    centres = np.arange(0, length + _HOP, _HOP)
    aims = _mapped(centres / SAMPLE_RATE, heard, wanted) * SAMPLE_RATE - _WINDOW // 2 + margin
    aims = np.clip(np.round(aims).astype(int), _REACH, len(source) - _WINDOW - _REACH - 1)
    energies = np.convolve(source**2, np.ones(_WINDOW), "valid")
    fade = np.hanning(_WINDOW + 1)[:-1].astype(np.float32)
    out = np.zeros(length + 2 * _WINDOW, np.float32)
    at = int(aims[0])
    for centre, aim in zip(centres, aims, strict=True):
        following = source[at + _HOP : at + _HOP + _WINDOW] if centre else source[at : at + _WINDOW]
        # Nothing follows the source's end.
        at = int(aim) if len(following) < _WINDOW else aim - _REACH + _most_alike(source, energies, aim, following)
        out[centre : centre + _WINDOW] += fade * source[at : at + _WINDOW]
    # The first window's centre is at sample 0.
    return out[_WINDOW // 2 : _WINDOW // 2 + length]


def _most_alike(source: np.ndarray, energies: np.ndarray, aim: int, following: np.ndarray) -> int:
    """The window around `aim` that best continues the last one; the middle one if all are silent."""
    around = sliding_window_view(source[aim - _REACH : aim + _REACH + _WINDOW], _WINDOW)
    scores = around @ following / np.sqrt(np.maximum(energies[aim - _REACH : aim + _REACH + 1], 1e-6))
    scores[_REACH] += 1e-6
    return int(scores.argmax())


def _mapped(times: np.ndarray, heard: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Position of each time in the source."""
    inside = np.interp(times, wanted, heard)
    before, after = np.minimum(times - wanted[0], 0), np.maximum(times - wanted[-1], 0)
    return inside + before + after
