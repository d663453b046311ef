"""The performer's analysis of speech: phrases, accents and loudness of an utterance."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from umo_train.speech.utterance import FRAME_RATE, SAMPLE_RATE, SILENCE, VOWELS, Utterance

# A silence of at least this length separates phrases and closes the mouth, seconds.
PAUSE_S = 0.2
# Rate of the loudness measurement, Hz.
_RATE = 100
# Accents closer than this are merged.
_ACCENT_GAP_S = 0.3
# A given accent belongs to the nearest vowel within this time.
_ACCENT_NEAR_S = 0.12


@dataclass(frozen=True)
class Prosody:
    """Times in seconds; arrays of one row per phrase, accent or frame."""

    t: np.ndarray
    # Start and end of each phrase `[n, 2]`, separated by pauses.
    phrases: np.ndarray
    # Onset of the stressed vowel, and its prominence (about 1).
    accents: np.ndarray
    weights: np.ndarray
    # Onsets of all vowels.
    syllables: np.ndarray
    # dB above the speech level, per frame: over a phrase, and over a syllable.
    slow_db: np.ndarray
    syllabic_db: np.ndarray


def listen(utterance: Utterance, accents: np.ndarray | None = None) -> Prosody:
    """Analyses an utterance; with `accents`, vowels near these times (seconds) replace the accents of the phones."""
    t = np.arange(utterance.frames) / FRAME_RATE
    phrases = _phrases(utterance)
    slow, syllabic = _loudness(utterance, phrases, t)
    vowels = [phone for phone in utterance.phones if phone.name in VOWELS]
    onsets = np.array([v.start + 0.25 * min(v.end - v.start, 0.12) for v in vowels])
    given = None if accents is None else _nearest(np.array([v.start for v in vowels]), accents)
    kept, weights = _accents(vowels, onsets, np.interp(onsets, t, syllabic) if len(t) else onsets, given)
    return Prosody(t, phrases, kept, weights, onsets, slow, syllabic)


def _nearest(starts: np.ndarray, accents: np.ndarray) -> np.ndarray:
    """Which of the vowels starting at these times `[n]` are nearest to an accent and close enough."""
    chosen = np.zeros(len(starts), bool)
    if len(starts):
        away = np.abs(starts[:, None] - accents)
        near = away.argmin(0)
        chosen[near[away[near, np.arange(len(accents))] <= _ACCENT_NEAR_S]] = True
    return chosen


def _phrases(utterance: Utterance) -> np.ndarray:
    runs: list[list[float]] = []
    for phone in utterance.phones:
        if phone.name == SILENCE and phone.end - phone.start >= PAUSE_S:
            continue
        if phone.name == SILENCE and not runs:
            continue
        if runs and phone.start - runs[-1][1] < PAUSE_S:
            runs[-1][1] = phone.end
        else:
            runs.append([phone.start, phone.end])
    return np.array(runs).reshape(-1, 2)


def _loudness(utterance: Utterance, phrases: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    hop = SAMPLE_RATE // _RATE
    samples = np.asarray(utterance.samples, np.float32)
    count = max(len(samples) // hop, 1)
    squares = np.pad(samples, (0, max(hop - len(samples), 0)))[: count * hop].reshape(count, hop)
    power = gaussian_filter1d(np.einsum("ij,ij->i", squares, squares) / hop, 1.5)
    when = (np.arange(count) + 0.5) / _RATE
    spoken = np.zeros(count, bool)
    for start, end in phrases:
        spoken[int(start * _RATE) : int(np.ceil(end * _RATE))] = True
    # The speech level ignores gaps within speech, like a level meter's gate.
    level = power[spoken] if spoken.any() else power
    level = np.mean(level[level >= 0.05 * level.mean()]) + 1e-9
    db = np.clip(10.0 * np.log10(power / level + 1e-4), -25.0, 15.0)
    smooth = [gaussian_filter1d(db, sigma * _RATE) for sigma in (0.35, 0.06)]
    return np.interp(t, when, smooth[0]), np.interp(t, when, smooth[1])


def _accents(
    vowels: list, onsets: np.ndarray, db: np.ndarray, given: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Accented vowels, from `given` if available; if a voice marks none, the vowels prominent in stress, length and
    loudness."""
    if not vowels:
        return np.zeros(0), np.zeros(0)
    stress = np.array([v.stress for v in vowels])
    length = np.array([v.end - v.start for v in vowels])
    prominence = 0.5 * stress + (length - length.mean()) / (length.std() + 0.02) + (db - db.mean()) / (db.std() + 2.0)
    chosen = stress == 2 if given is None else given
    if given is None and not chosen.any():
        chosen = prominence >= np.quantile(prominence, 0.6)
    kept: list[int] = []
    for index in np.argsort(-prominence, kind="stable"):
        if chosen[index] and all(abs(onsets[index] - onsets[k]) >= _ACCENT_GAP_S for k in kept):
            kept.append(int(index))
    kept.sort()
    return onsets[kept], np.clip(1.0 + 0.15 * prominence[kept], 0.6, 1.5)
