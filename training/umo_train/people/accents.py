"""Detects the vowels that a reader accents, by pitch, loudness and length."""

from dataclasses import replace

import librosa
import numpy as np

from umo_train.speech.utterance import SAMPLE_RATE, VOWELS, Utterance

_HOP = 160
_LOWEST_HZ, _HIGHEST_HZ = 60.0, 420.0
# Vowels are compared with those within this time, seconds: pitch and loudness fall along a phrase.
_NEAR_S = 1.5
# Accents closer than this are merged.
_GAP_S = 0.3
# Standard deviations above its neighbours from which a vowel counts as accented.
_LEAST = 0.35
_WEIGHTS = {"pitch": 0.45, "loudness": 0.3, "length": 0.25}


def accented(utterance: Utterance) -> Utterance:
    """The utterance with stress 2 on the accented vowels, and none on others: detected accents replace the stress from
    text or dictionary."""
    where = [i for i, phone in enumerate(utterance.phones) if phone.name in VOWELS]
    out = [replace(phone, stress=min(phone.stress, 1)) for phone in utterance.phones]
    if not where:
        return replace(utterance, phones=tuple(out))
    at = np.array([out[i].start for i in where])
    prominence = sum(
        weight * values for weight, values in zip(_WEIGHTS.values(), _features(utterance, where), strict=True)
    )
    for k in np.argsort(-prominence, kind="stable"):
        near = np.abs(at - at[k]) < _GAP_S
        if prominence[k] > _LEAST and not any(out[where[j]].stress == 2 for j in np.flatnonzero(near)):
            out[where[k]] = replace(out[where[k]], stress=2)
    return replace(utterance, phones=tuple(out))


def _features(utterance: Utterance, where: list[int]) -> list[np.ndarray]:
    """Highest pitch, maximum loudness and length of each vowel, relative to its neighbours' median, in standard
    deviations of the utterance."""
    samples = np.pad(np.asarray(utterance.samples, np.float32), (0, 1024))
    pitch = librosa.yin(samples, fmin=_LOWEST_HZ, fmax=_HIGHEST_HZ, sr=SAMPLE_RATE, frame_length=1024, hop_length=_HOP)
    level = 10 * np.log10(librosa.feature.rms(y=samples, frame_length=512, hop_length=_HOP)[0] ** 2 + 1e-8)
    count = min(len(pitch), len(level))
    semitones, level = 12 * np.log2(pitch[:count]), level[:count]
    rows = []
    for i in where:
        phone = utterance.phones[i]
        first = min(int(phone.start * SAMPLE_RATE / _HOP), count - 1)
        frames = slice(first, max(first + 1, int(np.ceil(phone.end * SAMPLE_RATE / _HOP))))
        # The upper quartile: the maximum is prone to pitch errors.
        rows.append((np.quantile(semitones[frames], 0.75), level[frames].max(), np.log(phone.end - phone.start)))
    middles = np.array([(utterance.phones[i].start + utterance.phones[i].end) / 2 for i in where])
    out = []
    for values in np.array(rows).T:
        near = np.abs(middles[:, None] - middles) < _NEAR_S
        above = values - np.array([np.median(values[row]) for row in near])
        spread = 1.4826 * np.median(np.abs(above)) + 1e-3
        out.append(np.clip(above / spread, -3.0, 3.0))
    return out
