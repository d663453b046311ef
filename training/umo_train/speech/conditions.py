"""Speech as microphones hear it: over noise, voices and music, by telephone, whispered, shouted, quick, with laughs and
coughs in its pauses, and beside another talker. Formulas and signal processing; times are those of the clean take, or
`tempo` times as quick."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby, islice

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.linalg import solve_toeplitz
from scipy.ndimage import gaussian_filter1d
from scipy.signal import butter, lfilter, resample_poly, sosfilt

from umo_train.metrics.item import Item
from umo_train.mouth import sounds
from umo_train.speech.utterance import SAMPLE_RATE
from umo_train.speech.variation import leveled
from umo_train.speech.warp import warped

Rng = np.random.Generator

# Level of speech, dB below full scale, root mean square. Whispers are 20 dB softer and shouts 12 dB louder: less than
# the 20 dB and more between calm speech and a real shout, which a recorder's gain takes back in part.
SPEECH_DB, WHISPER_DB, SHOUT_DB = 24.0, 44.0, 12.0
# Pauses between the sentences of a take, and before its first, seconds.
GAP_S, FIRST_GAP_S = 1.6, 0.5
QUICK = 1.5
# Pitch of a shout over that of speech (Rostolland 1982: half an octave and more).
SHOUT_PITCH = 1.4
BABBLE_TALKERS = 6

# Linear prediction: order, window and hop in samples at 16 kHz.
_ORDER, _WINDOW, _HOP, _RING = 18, 512, 128, 256


@dataclass(frozen=True)
class Take:
    """Sentences of one speaker at a common level, with known pauses `(start, end)` in seconds."""

    name: str
    voice: str
    samples: np.ndarray
    pauses: tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Condition:
    """How a take sounds: `make(take, takes of all, rng)`; `tempo` is its speed over the clean take's."""

    name: str
    make: Callable[[Take, Sequence[Take], Rng], np.ndarray]
    tempo: float = 1.0


def takes(recordings: Sequence[Item], seconds: float, most: int) -> list[Take]:
    """Neighbouring recordings of each speaker, joined by pauses into takes of at least `seconds`, at most `most` of a
    speaker; a rest that is shorter than half of it is left out."""
    out = []
    for voice, items in groupby(sorted(recordings, key=lambda item: (item.voice, item.name)), key=lambda i: i.voice):
        for items_of_one in islice(_batches(items, seconds), most):
            out.append(_take(items_of_one[0].name, voice, [item.samples for item in items_of_one]))
    return out


def _batches(items: Iterator[Item], seconds: float) -> Iterator[list[Item]]:
    batch: list[Item] = []
    for item in items:
        batch.append(item)
        if sum(i.seconds for i in batch) >= seconds:
            yield batch
            batch = []
    if sum(i.seconds for i in batch) >= seconds / 2:
        yield batch


def _take(name: str, voice: str, sentences: Sequence[np.ndarray]) -> Take:
    level = [leveled(samples, SPEECH_DB) for samples in sentences]
    pieces, pauses, at = [], [], 0
    for gap, sentence in zip([FIRST_GAP_S] + [GAP_S] * len(level), [*level, np.zeros(0)], strict=True):
        silence = round(gap * SAMPLE_RATE)
        pauses.append((at / SAMPLE_RATE, (at + silence) / SAMPLE_RATE))
        pieces += [_room(level[0], silence, np.random.default_rng(at)), sentence]
        at += silence + len(sentence)
    return Take(name, voice, np.concatenate(pieces).astype(np.float32), tuple(pauses))


def _room(recording: np.ndarray, count: int, rng: Rng) -> np.ndarray:
    """Noise with the spectrum and level of a recording's quietest 50 ms: no room is silent in the digital sense."""
    size = SAMPLE_RATE // 20
    pieces = recording[: len(recording) // size * size].reshape(-1, size)
    quietest = pieces[np.argmin((pieces**2).sum(1))]
    shape = gaussian_filter1d(np.abs(np.fft.rfft(quietest * np.hanning(size))), 1)
    white = np.fft.rfft(rng.standard_normal(count))
    colour = np.interp(np.linspace(0, 1, len(white)), np.linspace(0, 1, len(shape)), shape)
    return np.sqrt(np.mean(quietest**2)) * unit(np.fft.irfft(white * colour, count))


def unit(sound: np.ndarray) -> np.ndarray:
    return sound / (np.sqrt(np.mean(np.square(sound))) + 1e-9)


def over(samples: np.ndarray, sound: np.ndarray, decibels: float) -> np.ndarray:
    """Speech over another sound at a signal-to-noise ratio."""
    return _clipped(samples + unit(sound) * 10 ** (-(SPEECH_DB + decibels) / 20))


def _clipped(sound: np.ndarray) -> np.ndarray:
    return np.clip(sound, -1, 1).astype(np.float32)


def pink(count: int, rng: Rng) -> np.ndarray:
    """Power of 1/f above 20 Hz."""
    spectrum = np.fft.rfft(rng.standard_normal(count))
    hertz = np.fft.rfftfreq(count, 1 / SAMPLE_RATE)
    return np.fft.irfft(np.where(hertz < 20, 0, spectrum / np.sqrt(np.maximum(hertz, 20))), count)


def _other(take: Take, everyone: Sequence[Take], rng: Rng) -> np.ndarray:
    """A take of another speaker without its pauses, from a random place on, as long as `take`."""
    others = [one for one in everyone if one.voice != take.voice]
    if not others:
        raise ValueError("babble and a second talker need recordings of two speakers at least")
    other = others[rng.integers(len(others))]
    at = np.arange(len(other.samples)) / SAMPLE_RATE
    spoken = ~np.any([(at >= start) & (at < end) for start, end in other.pauses], axis=0)
    speech = other.samples[spoken]
    return np.resize(np.roll(speech, int(rng.integers(len(speech)))), len(take.samples))


def babble(take: Take, everyone: Sequence[Take], rng: Rng) -> np.ndarray:
    return sum(unit(_other(take, everyone, rng)) for _ in range(BABBLE_TALKERS))


def telephone(samples: np.ndarray) -> np.ndarray:
    """300 to 3,400 Hz, 8 kHz, eight bits on the mu-law curve (ITU-T G.711)."""
    band = sosfilt(butter(4, [300, 3400], "bandpass", output="sos", fs=SAMPLE_RATE), samples)
    narrow = np.clip(resample_poly(band, 1, 2), -1, 1)
    curve = np.sign(narrow) * np.log1p(255 * np.abs(narrow)) / np.log(256)
    coded = np.round(curve * 127) / 127
    return _clipped(resample_poly(np.sign(coded) * (256 ** np.abs(coded) - 1) / 255, 2, 1))


def whisper(samples: np.ndarray, rng: Rng) -> np.ndarray:
    """Noise in place of the voice, through the vocal tract found by linear prediction. The pre-emphasis is not taken
    back: whispers lack the voice's low frequencies, and vowels lose more than consonants."""
    bright = np.append(samples[:1], samples[1:] - 0.97 * samples[:-1])
    shape, gain = _vocal_tract(bright)
    frames = _frames(rng.standard_normal(len(samples))) * gain[:, None]
    return leveled(_synthesized(frames, shape, len(samples)), WHISPER_DB)


def shout(samples: np.ndarray) -> np.ndarray:
    """Higher pitch in the same vocal tract, more of the high frequencies, louder, and overdriven a little."""
    shape, _ = _vocal_tract(samples)
    frames = [lfilter(a, [1], np.append(f, np.zeros(_RING))) for a, f in zip(shape, _frames(samples), strict=True)]
    residual = _added(frames, len(samples))
    seconds, longer = len(samples) / SAMPLE_RATE, int(len(samples) * SHOUT_PITCH)
    slow = warped(residual, np.array([0, seconds]), np.array([0, seconds * SHOUT_PITCH]), longer)
    high = np.interp(np.arange(len(samples)) * SHOUT_PITCH, np.arange(longer), slow)
    loud = _synthesized(_frames(high), shape, len(samples))
    # A first-order shelf: 12 dB more above 1 kHz.
    loud = loud + 3 * sosfilt(butter(1, 1000, "highpass", output="sos", fs=SAMPLE_RATE), loud)
    return np.tanh(leveled(loud, SHOUT_DB)).astype(np.float32)


def quick(samples: np.ndarray) -> np.ndarray:
    """`QUICK` times as quick, at the same pitch."""
    seconds = len(samples) / SAMPLE_RATE
    return warped(samples, np.array([0, seconds]), np.array([0, seconds / QUICK]), int(len(samples) / QUICK))


def _frames(samples: np.ndarray) -> np.ndarray:
    """Overlapping windows that add up to the samples `[count, window]`."""
    padded = np.pad(samples, (_WINDOW - _HOP, _WINDOW))
    return sliding_window_view(padded, _WINDOW)[::_HOP] * np.hanning(_WINDOW + 1)[:-1] / 2


def _vocal_tract(samples: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Prediction filters `[count, order + 1]` of all windows, and the level of what they leave."""
    frames = _frames(samples)
    power = np.abs(np.fft.rfft(frames, 2 * _WINDOW)) ** 2
    alike = np.fft.irfft(power)[:, : _ORDER + 1]
    alike[:, 0] = alike[:, 0] * (1 + 1e-6) + 1e-9
    shape = np.array([np.append(1, -solve_toeplitz(r[:-1], r[1:])) for r in alike])
    return shape, np.sqrt(np.maximum((shape * alike).sum(1), 0))


def _synthesized(frames: np.ndarray, shape: np.ndarray, count: int) -> np.ndarray:
    ringing = np.pad(frames, ((0, 0), (0, _RING)))
    return _added([lfilter([1], a, frame) for a, frame in zip(shape, ringing, strict=True)], count)


def _added(frames: Sequence[np.ndarray], count: int) -> np.ndarray:
    out = np.zeros(len(frames) * _HOP + _WINDOW + _RING)
    for i, frame in enumerate(frames):
        out[i * _HOP : i * _HOP + len(frame)] += frame
    return out[_WINDOW - _HOP :][:count]


def _formants(source: np.ndarray, hertz: Sequence[float], width: float) -> np.ndarray:
    """Resonances in a row, each with unit gain at 0 Hz."""
    for centre in hertz:
        radius = np.exp(-np.pi * width / SAMPLE_RATE)
        poles = [1, -2 * radius * np.cos(2 * np.pi * centre / SAMPLE_RATE), radius**2]
        source = lfilter([sum(poles)], poles, source)
    return source


def _voice(hertz: np.ndarray) -> np.ndarray:
    """Glottal buzz of a pitch contour: harmonics that fall by 6 dB an octave, radiation included."""
    phase = 2 * np.pi * np.cumsum(hertz) / SAMPLE_RATE
    return sum(np.sin(k * phase) / k for k in range(1, int(7000 / hertz.max())))


def laugh(rng: Rng) -> np.ndarray:
    """A bout of five calls, 210 ms apart, each a breath and a falling central vowel, ever lower and softer (lengths
    and pitches after Bachorowski, Smoski and Owren 2001)."""
    calls, pitch = 5, rng.uniform(220, 380)
    period, breath, vowel = (int(s * SAMPLE_RATE) for s in (0.21, 0.06, 0.1))
    out = np.zeros(calls * period)
    for call in range(calls):
        fall = np.linspace(1.1, 0.9, vowel) * (1 - 0.05 * call) * pitch * rng.uniform(0.95, 1.05)
        sound = np.concatenate([0.35 * rng.standard_normal(breath), unit(_voice(fall)) * np.hanning(vowel) * 1.6])
        out[call * period : call * period + len(sound)] += (1 - 0.12 * call) * sound
    return unit(_formants(out, (650, 1300, 2600, 3600), 110))


def cough(rng: Rng) -> np.ndarray:
    """Two coughs of three phases: a burst, a weaker flow, a short voice (Korpas, Sadlonova and Vrabec 1996)."""
    pieces = []
    for _ in range(2):
        burst, flow, voiced = (int(s * SAMPLE_RATE) for s in (0.06, 0.16, rng.uniform(0.06, 0.12)))
        t = np.arange(burst + flow) / SAMPLE_RATE
        decay = np.exp(-t / 0.025) + 0.25 * np.exp(-t / 0.12)
        end = 0.35 * unit(_voice(np.linspace(260, 160, voiced))) * np.hanning(voiced)
        pieces += [decay * rng.standard_normal(len(t)), end, np.zeros(int(0.12 * SAMPLE_RATE))]
    return unit(_formants(np.concatenate(pieces), (550, 1400, 2500), 350))


def between(take: Take, make: Callable[[Rng], np.ndarray], louder_db: float, rng: Rng) -> np.ndarray:
    """A sound in the middle of each pause that has room for it."""
    out = take.samples.copy()
    for start, end in take.pauses:
        sound = make(rng) * 10 ** ((louder_db - SPEECH_DB) / 20)
        first = int((start + end) / 2 * SAMPLE_RATE) - len(sound) // 2
        if first > start * SAMPLE_RATE and first + len(sound) < end * SAMPLE_RATE:
            out[first : first + len(sound)] += sound
    return _clipped(out)


def conditions() -> tuple[Condition, ...]:
    """All, in the order of the table."""
    levels = (20, 10, 5, 0)
    noises = {
        "pink noise": lambda take, everyone, rng: pink(len(take.samples), rng),
        "babble": babble,
        "music": lambda take, everyone, rng: sounds.music(len(take.samples), rng),
    }

    def noisy(make: Callable, decibels: float) -> Callable:
        return lambda take, everyone, rng: over(take.samples, make(take, everyone, rng), decibels)

    return (
        *(Condition(f"{name}, {db} dB", noisy(make, db)) for name, make in noises.items() for db in levels),
        Condition("telephone", lambda take, everyone, rng: telephone(take.samples)),
        Condition("whisper", lambda take, everyone, rng: whisper(take.samples, rng)),
        Condition("shout", lambda take, everyone, rng: shout(take.samples)),
        Condition("quick, 1.5 times", lambda take, everyone, rng: quick(take.samples), QUICK),
        Condition("laughter in the pauses", lambda take, everyone, rng: between(take, laugh, 0, rng)),
        Condition("coughs in the pauses", lambda take, everyone, rng: between(take, cough, 6, rng)),
        Condition("second talker, 10 dB below", noisy(_other, 10)),
        Condition("second talker, as loud", noisy(_other, 0)),
    )
