"""Where the words of a recording are in another recording of the same words: dynamic time warping of their sounds."""

from collections.abc import Sequence

import librosa
import numpy as np

from umo_train.speech.utterance import SAMPLE_RATE, Utterance, Word

_HOP = 80
# Of a recording, what is compared before the first word and after the last, by seconds.
_MARGIN = 0.05
# Decibels below the loudest at which speech begins and ends.
_SILENCE = 40


def boundaries(original: Utterance, phrase: Sequence[Word], samples: np.ndarray) -> list[tuple[float, float]]:
    """Times in `samples` and in the original of the start and the end of each word of `phrase`."""
    wanted = np.array([time for word in phrase for time in (word.start, word.end)])
    return list(zip(heard(original.samples, wanted, samples).tolist(), wanted.tolist(), strict=True))


def heard(original: np.ndarray, wanted: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """Times in `samples` at which is said what `original` says at the times `wanted`, which ascend: the first is where
    speech begins, the last where it ends."""
    first = max(int((wanted[0] - _MARGIN) * SAMPLE_RATE), 0)
    ours = original[first : int((wanted[-1] + _MARGIN) * SAMPLE_RATE)]
    theirs, (begin, end) = librosa.effects.trim(samples, top_db=_SILENCE, frame_length=2 * _HOP, hop_length=_HOP)
    _, path = librosa.sequence.dtw(_features(theirs), _features(ours), metric="euclidean", backtrack=True)
    path = path[::-1]
    # Several of their frames may be as one of ours: the middle one.
    frames, where = np.unique(path[:, 1], return_inverse=True)
    middle = np.bincount(where, path[:, 0]) / np.bincount(where)
    times = np.interp((wanted * SAMPLE_RATE - first) / _HOP, frames, middle) * _HOP / SAMPLE_RATE
    # The ends are where speech is: likeness says little of silence.
    times[0], times[-1] = 0.0, (end - begin) / SAMPLE_RATE
    return times + begin / SAMPLE_RATE


def _features(samples: np.ndarray) -> np.ndarray:
    """Cepstra and their changes `[26, t]`, as little of the speaker in them as a mean and a scale can take out."""
    cepstra = librosa.feature.mfcc(y=samples, sr=SAMPLE_RATE, n_mfcc=13, n_fft=512, hop_length=_HOP, n_mels=40)
    rows = np.concatenate([cepstra, 3 * librosa.feature.delta(cepstra, width=9, mode="nearest")])
    return (rows - rows.mean(1, keepdims=True)) / (rows.std(1, keepdims=True) + 1e-6)
