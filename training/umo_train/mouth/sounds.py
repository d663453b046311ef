"""Synthetic sounds without speech: noise, hum, machines, music, knocks, birds, rubbing."""

import itertools
from collections.abc import Callable

import numpy as np
from scipy.signal import butter, lfilter, sosfilt

from umo_train.speech.utterance import SAMPLE_RATE

Rng = np.random.Generator


def _unit(sound: np.ndarray) -> np.ndarray:
    return sound / (np.sqrt(np.mean(np.square(sound))) + 1e-9)


def _time(count: int) -> np.ndarray:
    return np.arange(count) / SAMPLE_RATE


def noise(count: int, rng: Rng) -> np.ndarray:
    """White, pink, brown or band-limited; sometimes it swells."""
    white = rng.standard_normal(count)
    kind = rng.integers(4)
    if kind == 1:
        # Kellet's filter: 3 dB an octave within 0.5 dB above 20 Hz.
        poles = (0.99886, 0.99332, 0.96900, 0.86650, 0.55000, -0.7616)
        gains = (0.0555179, 0.0750759, 0.1538520, 0.3104856, 0.5329522, -0.0168980)
        white = sum(lfilter([g], [1, -p], white) for p, g in zip(poles, gains, strict=True)) + 0.5362 * white
    elif kind == 2:
        white = sosfilt(butter(1, rng.uniform(40, 1500), output="sos", fs=SAMPLE_RATE), white)
    elif kind == 3:
        low = float(np.exp(rng.uniform(np.log(60), np.log(4000))))
        white = sosfilt(
            butter(2, [low, min(low * rng.uniform(1.2, 6), 7800)], "bandpass", output="sos", fs=SAMPLE_RATE), white
        )
    if rng.random() < 0.4:
        white = white * _swell(count, rng, rng.uniform(0.1, 3.0))
    return _unit(white)


def _swell(count: int, rng: Rng, hertz: float) -> np.ndarray:
    """0.1 to 1, changing irregularly at about the given rate."""
    points = max(int(count / SAMPLE_RATE * hertz) + 2, 3)
    return np.interp(np.linspace(0, points - 1, count), np.arange(points), rng.uniform(0.1, 1.0, points))


def hum(count: int, rng: Rng) -> np.ndarray:
    """Mains or an engine: harmonics of one pitch, which may drift, over little or much noise."""
    pitch = rng.choice([50.0, 60.0, rng.uniform(40, 400)])
    drift = 1.0 + (rng.uniform(0, 0.3) * _swell(count, rng, 0.5) if rng.random() < 0.4 else 0.0)
    phase = 2 * np.pi * np.cumsum(pitch * drift * np.ones(count)) / SAMPLE_RATE
    slope = rng.uniform(0.3, 2.0)
    out = sum(rng.random() * np.sin(k * phase + rng.uniform(0, 6)) / k**slope for k in range(1, 25) if k * pitch < 7000)
    return _unit(_unit(out) + 10 ** rng.uniform(-3.0, -0.2) * noise(count, rng))


def music(count: int, rng: Rng) -> np.ndarray:
    """Two to four voices in one key at one tempo: chords, a melody, a bass, arpeggios; drums at times."""
    beat = float(60.0 / rng.uniform(60, 200))
    key = float(rng.uniform(45, 57))
    out = np.zeros(count)
    for _ in range(rng.integers(1, 4)):
        out += rng.uniform(0.2, 1.0) * _unit(_voice(count, rng, key, beat))
    if rng.random() < 0.5:
        out += rng.uniform(0.2, 1.5) * _unit(_drums(count, rng, beat))
    if rng.random() < 0.3:
        out = sosfilt(butter(2, rng.uniform(600, 5000), output="sos", fs=SAMPLE_RATE), out)
    return _unit(out + float(10 ** rng.uniform(-5, -2)) * rng.standard_normal(count))


_SCALE = np.array([0, 2, 4, 5, 7, 9, 11])


def _voice(count: int, rng: Rng, key: float, beat: float) -> np.ndarray:
    """An instrument that plays one to five notes at once, with its own rhythm."""
    notes = int(rng.choice([1, 1, 2, 3, 3, 4, 5]))
    every = beat * float(rng.choice([0.25, 0.5, 1.0, 2.0, 4.0]))
    held = every * float(rng.choice([0.4, 0.9, 1.0, 1.5]))
    octave = int(rng.integers(-1, 3))
    slope, odd = rng.uniform(0.3, 2.5), rng.random() < 0.3
    gains = np.array([(rng.uniform(0.5, 1) if rng.random() < 0.9 else 0) / k**slope for k in range(1, 30)])
    if odd:
        gains[1::2] = 0
    attack = float(np.exp(rng.uniform(np.log(0.002), np.log(0.25))))
    decay = float(np.exp(rng.uniform(np.log(0.1), np.log(15))))
    vibrato, detuned = rng.uniform(0, 0.008) * (rng.random() < 0.5), rng.random() < 0.3
    out = np.zeros(count)
    steady = rng.random() < 0.5
    for k in range(int(count / SAMPLE_RATE / every) + 1):
        if rng.random() < (0.0 if steady else 0.3):
            continue
        at = int((k + (0.0 if steady else rng.normal(0, 0.02))) * every * SAMPLE_RATE)
        length = min(int(held * SAMPLE_RATE), count - at)
        if at < 0 or length < 50:
            continue
        root, t = int(rng.integers(7)), _time(length)
        # Rises, decays, and ends within 10 ms.
        shape = np.minimum(t / attack, 1.0) * np.exp(-t * decay) * np.minimum((t[-1] - t) / 0.01, 1.0)
        for step in range(notes):
            degree = root + 2 * step
            hertz = 440 * 2 ** ((key + _SCALE[degree % 7] + 12 * (degree // 7 + octave) - 69) / 12)
            for tuning in (1.0, 1.006) if detuned else (1.0,):
                wobble = vibrato / 5.5 * hertz * np.cos(2 * np.pi * 5.5 * t)
                phase = 2 * np.pi * hertz * tuning * t - wobble + rng.uniform(0, 6)
                tone = sum(g * np.sin((h + 1) * phase) for h, g in enumerate(gains) if g and (h + 1) * hertz < 7600)
                out[at : at + length] += shape * tone
    return out


def _drums(count: int, rng: Rng, beat: float) -> np.ndarray:
    out = np.zeros(count)
    pattern = rng.random(8)
    pitch, fall = rng.uniform(40, 120), rng.uniform(15, 60)
    for k in range(int(count / SAMPLE_RATE / beat * 2)):
        at = int(k * beat / 2 * SAMPLE_RATE)
        length = min(int(0.15 * SAMPLE_RATE), count - at)
        if length > 10 and pattern[k % 8] > 0.4:
            t = _time(length)
            hit = np.sin(2 * np.pi * pitch * t) if pattern[k % 8] > 0.7 else 0.5 * rng.standard_normal(length)
            out[at : at + length] += hit * np.exp(-t * fall)
    return out


def knocks(count: int, rng: Rng) -> np.ndarray:
    """Keys, doors and steps: short resonances at irregular times over faint noise."""
    out = 0.003 * rng.standard_normal(count)
    at = 0
    rate = float(np.exp(rng.uniform(np.log(0.5), np.log(10))))
    while (at := at + int(rng.exponential(SAMPLE_RATE / rate)) + 200) < count:
        length = min(int(rng.uniform(0.01, 0.25) * SAMPLE_RATE), count - at)
        t = _time(length)
        tone = sum(np.sin(2 * np.pi * rng.uniform(80, 5000) * t) for _ in range(3))
        hit = (tone + rng.uniform(0, 3) * rng.standard_normal(length)) * np.exp(-t * rng.uniform(20, 200))
        out[at : at + length] += rng.uniform(0.1, 1) * hit
    return _unit(out)


def tones(count: int, rng: Rng) -> np.ndarray:
    """Beeps, ringing, sweeps and birds: single tones that come, go and slide."""
    out = 0.003 * rng.standard_normal(count)
    at, slide = 0, rng.random() < 0.5
    while at < count - 100:
        length = min(int(rng.uniform(0.05, 1.0) * SAMPLE_RATE), count - at)
        start = float(np.exp(rng.uniform(np.log(200), np.log(6000))))
        end = start * rng.uniform(0.5, 1.8) if slide else start
        phase = 2 * np.pi * np.cumsum(np.linspace(start, min(end, 7500), length)) / SAMPLE_RATE
        edge = np.minimum(1.0, np.minimum(np.arange(length), np.arange(length)[::-1]) / 80)
        out[at : at + length] += np.sin(phase) * edge
        at += length + int(rng.exponential(0.3) * SAMPLE_RATE)
    return _unit(out)


def silence(count: int, rng: Rng) -> np.ndarray:
    """A microphone without a speaker."""
    return 0.001 * noise(count, rng)


_KINDS: tuple[tuple[Callable[[int, Rng], np.ndarray], float], ...] = (
    (noise, 0.24),
    (hum, 0.14),
    (music, 0.32),
    (knocks, 0.12),
    (tones, 0.12),
    (silence, 0.06),
)


def draw(count: int, rng: Rng) -> np.ndarray:
    """One to three of these in sequence, with gaps and different levels, or two together; at unit power."""
    kinds, shares = [make for make, _ in _KINDS], [share for _, share in _KINDS]
    out = np.zeros(count)
    pieces = int(rng.integers(1, 4))
    edges = np.sort(np.concatenate([[0], rng.integers(0, count, pieces - 1), [count]]))
    for first, last in itertools.pairwise(edges):
        gap = int(rng.uniform(0, 1.0) * SAMPLE_RATE) if rng.random() < 0.5 else 0
        length = int(last - first) - gap
        if length < SAMPLE_RATE // 4:
            continue
        make, other = rng.choice(len(kinds), 2, p=shares)
        sound = kinds[make](length, rng)
        if rng.random() < 0.2:
            sound = sound + 10 ** (-rng.uniform(0, 20) / 20) * kinds[other](length, rng)
        out[first + gap : last] = sound * 10 ** (-rng.uniform(0, 25) / 20 * (pieces > 1))
    # Microphone noise under everything.
    return _unit(out + 10 ** (-rng.uniform(35, 80) / 20) * _unit(noise(count, rng)) * (np.abs(out).max() + 1e-3))
