"""Locates the words of a recording in another recording of the same words, by dynamic time warping."""

from collections.abc import Sequence

import librosa
import numpy as np

from umo_train.speech.utterance import SAMPLE_RATE, Utterance, Word

_HOP = 80
# Length of the compared sound before the first word and after the last, seconds.
_MARGIN = 0.05
# Decibels below the loudest at which speech starts and ends.
_SILENCE = 40


def boundaries(original: Utterance, phrase: Sequence[Word], samples: np.ndarray) -> list[tuple[float, float]]:
    """Times of the start and the end of each word of `phrase`, in `samples` and in the original."""
    wanted = np.array([time for word in phrase for time in (word.start, word.end)])
    return list(zip(heard(original.samples, wanted, samples).tolist(), wanted.tolist(), strict=True))


def heard(original: np.ndarray, wanted: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """Times in `samples` that correspond to the ascending times `wanted` in `original`: the first is the start of
    speech, the last its end."""
    first = max(int((wanted[0] - _MARGIN) * SAMPLE_RATE), 0)
    ours = original[first : int((wanted[-1] + _MARGIN) * SAMPLE_RATE)]
    theirs, (begin, end) = librosa.effects.trim(samples, top_db=_SILENCE, frame_length=2 * _HOP, hop_length=_HOP)
    _, path = librosa.sequence.dtw(_features(theirs), _features(ours), metric="euclidean", backtrack=True)
    path = path[::-1]
    # Several of their frames may match one of ours: use the middle one.
    frames, where = np.unique(path[:, 1], return_inverse=True)
    middle = np.bincount(where, path[:, 0]) / np.bincount(where)
    times = np.interp((wanted * SAMPLE_RATE - first) / _HOP, frames, middle) * _HOP / SAMPLE_RATE
    # Start and end come from the speech level: similarity is unreliable in silence.
    times[0], times[-1] = 0.0, (end - begin) / SAMPLE_RATE
    return times + begin / SAMPLE_RATE


def _features(samples: np.ndarray) -> np.ndarray:
    """Cepstra and their differences `[26, t]`, normalised by mean and scale to reduce the speaker's influence."""
    cepstra = librosa.feature.mfcc(y=samples, sr=SAMPLE_RATE, n_mfcc=13, n_fft=512, hop_length=_HOP, n_mels=40)
    rows = np.concatenate([cepstra, 3 * librosa.feature.delta(cepstra, width=9, mode="nearest")])
    return (rows - rows.mean(1, keepdims=True)) / (rows.std(1, keepdims=True) + 1e-6)
