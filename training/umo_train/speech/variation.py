"""Varies speech: other speakers by resampling, and the effects of microphones, rooms and distances."""

from dataclasses import replace

import numpy as np
from scipy.signal import butter, fftconvolve, resample_poly, sosfilt

from umo_train.speech.utterance import SAMPLE_RATE, Phone, Utterance, Word


def faster(utterance: Utterance, factor: float) -> Utterance:
    """Plays `factor` times as fast: pitch and formants rise together, as of a smaller speaker; times are scaled."""
    up, down = round(100 / factor), 100
    samples = resample_poly(utterance.samples, up, down).astype(np.float32)
    scale = len(samples) / len(utterance.samples)
    return replace(
        utterance,
        samples=samples,
        phones=tuple(Phone(p.name, p.start * scale, p.end * scale, p.stress) for p in utterance.phones),
        words=tuple(Word(w.text, w.start * scale, w.end * scale) for w in utterance.words),
    )


def joined(utterances: list[Utterance], gaps: list[float]) -> Utterance:
    """Joins several utterances, with `gaps[i]` seconds of silence before the i-th, and one more at the end."""
    samples, phones, words = [], [], []
    at = 0
    for utterance, gap in zip((*utterances, None), gaps, strict=True):
        silence = np.zeros(int(gap * SAMPLE_RATE), np.float32)
        if len(silence):
            phones.append(Phone("pau", at / SAMPLE_RATE, (at + len(silence)) / SAMPLE_RATE))
            samples.append(silence)
            at += len(silence)
        if utterance is not None:
            start = at / SAMPLE_RATE
            phones += [replace(p, start=p.start + start, end=p.end + start) for p in utterance.phones]
            words += [replace(w, start=w.start + start, end=w.end + start) for w in utterance.words]
            samples.append(utterance.samples)
            at += len(utterance.samples)
    merged: list[Phone] = []
    for phone in phones:
        if merged and phone.name == merged[-1].name == "pau":
            merged[-1] = replace(merged[-1], end=phone.end)
        else:
            merged.append(phone)
    text = " ".join(u.text for u in utterances)
    return Utterance(utterances[0].voice, text, np.concatenate(samples), tuple(merged), tuple(words))


def leveled(samples: np.ndarray, decibels: float) -> np.ndarray:
    """At `decibels` below full scale, root mean square over the non-silent parts."""
    loud = samples[np.abs(samples) > 1e-3]
    rms = np.sqrt(np.mean(loud**2)) if len(loud) else 1.0
    return (samples * (10 ** (-decibels / 20) / rms)).astype(np.float32)


def recorded(samples: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """As recorded by a random microphone in a random room: gain, band limits, a spectral tilt, reverberation and noise,
    each with its own probability. Times are unchanged."""
    out = samples
    if rng.random() < 0.5:
        out = _in_room(out, rng)
    if rng.random() < 0.6:
        # A tilt of -6..6 dB per decade-ish: first-order shelf around 1 kHz.
        gain = rng.uniform(-0.45, 0.6)
        low = sosfilt(butter(1, 1000, output="sos", fs=SAMPLE_RATE), out)
        out = low * (1 + gain) + (out - low) * (1 - gain)
    if rng.random() < 0.3:
        low, high = rng.uniform(50, 300), rng.uniform(3400, 7800)
        out = sosfilt(butter(2, [low, high], "bandpass", output="sos", fs=SAMPLE_RATE), out)
    out = leveled(out, rng.uniform(16, 34))
    below_speech = rng.uniform(22, 65)
    level = np.sqrt(np.mean(out**2)) * 10 ** (-below_speech / 20)
    out = out + _noise(len(out), rng) * level
    return np.clip(out, -1, 1).astype(np.float32)


def _in_room(samples: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Convolved with noise that decays by 60 dB in 0.1 to 0.6 s, the direct sound first."""
    seconds = rng.uniform(0.1, 0.6)
    time = np.arange(int(seconds * SAMPLE_RATE)) / SAMPLE_RATE
    tail = rng.standard_normal(len(time)) * np.exp(-6.9 * time / seconds)
    tail *= rng.uniform(0.1, 0.6) / np.sqrt((tail**2).sum())
    tail[0] = 1.0
    return fftconvolve(samples, tail)[: len(samples)]


def _noise(count: int, rng: np.random.Generator) -> np.ndarray:
    """Unit noise between white and brown, as from fans, streets and preamplifiers."""
    white = rng.standard_normal(count)
    if rng.random() < 0.5:
        return white
    low = sosfilt(butter(1, rng.uniform(100, 2000), output="sos", fs=SAMPLE_RATE), white)
    return low / (np.sqrt(np.mean(low**2)) + 1e-12)
