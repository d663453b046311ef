"""Arousal of a voice as umo hears it (docs/spec.md 2.22), in numpy: the reference for umo-core's implementation.

`python -m umo_train.speech.arousal figures FILE…` prints what the readers of recordings have, mean and deviation:
the figures of the core. `golden FILE` writes the values that the core is held to, of a voice made here.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import soundfile
from numpy.lib.stride_tricks import sliding_window_view
from scipy.signal import lfilter, resample_poly

RATE = 16_000
STEP_S, STEPS_PER_VALUE = 0.025, 4
STEP = int(RATE * STEP_S)
FACTOR, CORNER_HZ = 4, 1000.0
WINDOW, LEAST_LAG, MOST_LAG = 160, 10, 66
LEAST_PEAK, PEAK_SHARE, VOICED = 0.3, 0.85, 0.6
MOST_SEMITONES, MOST_RISE_DB, MODULATION_DB, SYLLABLE_DB = 4.0, 20.0, 40.0, 1.0
PEAK_S, SYLLABLE_S, NOW_S, PHRASE_S, PROSODY_S, SPEAKER_S = 0.05, 0.4, 0.6, 2.0, 4.0, 30.0
# Mean and deviation among readers, and weight.
FIGURES = {"slope": (0.62, 0.15, 0.35), "rate": (2.5, 0.6, 0.2), "rise": (4.3, 0.8, 0.5), "tilt": (-3.8, 2.5, 0.2)}
MOST_DEVIATIONS = 2.0
# Mean of all this over readers' recordings.
USUAL = 0.12
OWN_WEIGHTS = {"level": 0.4, "pitch": 0.15, "tilt": 0.1}
LEAST_VOICED, WHISPER, EVIDENCE_STEPS = 0.4, 3.0, 16.0
LEAST_MODULATION, MODULATION_RANGE, SPEECH_SHARE = 5.0, 3.0, 0.3
MEANS = {
    "level": NOW_S,
    "speaker_level": SPEAKER_S,
    "rise": PHRASE_S,
    "sounds": PROSODY_S,
    "voiced": PHRASE_S,
    "pitch": NOW_S,
    "speaker_pitch": SPEAKER_S,
    "slope": PROSODY_S,
    "tilt": PHRASE_S,
    "speaker_tilt": SPEAKER_S,
    "modulated": PROSODY_S,
    "modulation": PROSODY_S,
    "peak": PEAK_S,
    "syllable": SYLLABLE_S,
    "rate": PROSODY_S,
}


class Mean:
    """A mean over an exponential window that is exact from its first value on."""

    def __init__(self, seconds: float) -> None:
        self.keeps, self.weight, self.value = np.exp(-STEP_S / seconds), 0.0, 0.0

    def add(self, value: float) -> None:
        self.weight = self.keeps * self.weight + 1
        self.value += (value - self.value) / self.weight

    def evidence(self) -> float:
        return self.weight / (self.weight + EVIDENCE_STEPS)


class VoiceLevels:
    """Noise and loud level of a sound (docs/spec.md 2.11.1)."""

    def __init__(self) -> None:
        self.noise = self.loud = -80.0

    def hear(self, level: float) -> bool:
        self.noise += (1 - np.exp(-STEP_S / (6.0 if level > self.noise else 0.1))) * (level - self.noise)
        self.loud += (1 - np.exp(-STEP_S / (0.05 if level > self.loud else 12.0))) * (max(level, -80.0) - self.loud)
        return level > -80 and level > self.noise + 8 and level > self.loud - 26


def pitch(low: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lag and harmonicity of the samples before each end, by the normalised square difference (McLeod, Wyvill 2005)."""
    size = WINDOW + MOST_LAG + 2
    windows = sliding_window_view(np.concatenate([np.zeros(size), low]), size)[ends]
    newest = windows[:, -WINDOW:]
    power = np.concatenate([np.zeros((len(windows), 1)), np.cumsum(windows**2, 1)], 1)
    heights = np.zeros((len(windows), MOST_LAG + 2))
    for lag in range(LEAST_LAG - 2, MOST_LAG + 2):
        start = size - WINDOW - lag
        both = power[:, size] - power[:, size - WINDOW] + power[:, start + WINDOW] - power[:, start]
        heights[:, lag] = 2 * (newest * windows[:, start : start + WINDOW]).sum(1) / (both + 1e-9)
    before, middle, after = (heights[:, LEAST_LAG - 1 + by : MOST_LAG + 1 + by] for by in (-1, 0, 1))
    peaks = np.where((middle > LEAST_PEAK) & (middle >= before) & (middle > after), middle, 0.0)
    first = np.argmax((peaks > 0) & (peaks >= PEAK_SHARE * peaks.max(1, keepdims=True)), 1)
    row = np.arange(len(windows))
    before, middle, after = before[row, first], middle[row, first], after[row, first]
    curve = before - 2 * middle + after
    offset = np.where(curve < 0, 0.5 * (before - after) / np.where(curve < 0, curve, -1.0), 0.0)
    found = peaks.max(1) > 0
    return first + LEAST_LAG - 1 + offset, np.where(found, middle, 0.0)


def steps(samples: np.ndarray) -> np.ndarray:
    """Level in dBFS, tilt in dB, pitch in semitones over 100 Hz, and harmonicity of each step, `[steps, 4]`."""
    count = len(samples) // STEP
    samples = samples[: count * STEP].astype(np.float64)
    share = 1 - np.exp(-2 * np.pi * CORNER_HZ / RATE)
    low = samples
    for _ in range(2):
        low = lfilter([share], [1, share - 1], low)

    def power(part: np.ndarray) -> np.ndarray:
        return (part.reshape(count, STEP) ** 2).sum(1)

    level = np.clip(20 * np.log10(np.maximum(np.sqrt(power(samples) / STEP), 1e-5)), None, 0.0)
    tilt = 10 * np.log10((power(samples - low) + 1e-12) / (power(low) + 1e-12))
    lag, harmonicity = pitch(low[FACTOR - 1 :: FACTOR], (np.arange(count) + 1) * STEP // FACTOR)
    return np.stack([level, tilt, 12 * np.log2(RATE / FACTOR / np.maximum(lag, 1) / 100), harmonicity], 1)


def hear(samples: np.ndarray) -> Iterator[dict[str, Mean]]:
    """The running means after each value's steps; the same objects each time."""
    voice, means = VoiceLevels(), {name: Mean(seconds) for name, seconds in MEANS.items()}
    level_before, semitones_before, is_syllable = -100.0, None, False
    for number, (level, tilt, semitones, harmonicity) in enumerate(steps(samples), 1):
        is_on = voice.hear(level)
        modulated = max(level, voice.loud - MODULATION_DB)
        means["modulated"].add(modulated)
        means["modulation"].add((modulated - means["modulated"].value) ** 2)
        means["sounds"].add(is_on)
        for name in ("peak", "syllable"):
            means[name].add(modulated)
        height, was_syllable = means["peak"].value - means["syllable"].value, is_syllable
        is_syllable = height > (-SYLLABLE_DB if was_syllable else SYLLABLE_DB)
        is_voiced = is_on and harmonicity > VOICED
        if is_on:
            for name in ("level", "speaker_level"):
                means[name].add(level)
            means["rise"].add(min(abs(level - level_before), MOST_RISE_DB))
            means["voiced"].add(is_voiced)
            means["rate"].add((is_syllable and not was_syllable) / STEP_S)
        if is_voiced:
            for name in ("pitch", "speaker_pitch"):
                means[name].add(semitones)
            if semitones_before is not None:
                means["slope"].add(min(abs(semitones - semitones_before), MOST_SEMITONES))
            for name in ("tilt", "speaker_tilt"):
                means[name].add(tilt)
        level_before, semitones_before = level, semitones if is_voiced else None
        if number % STEPS_PER_VALUE == 0:
            yield means


def score(means: dict[str, Mean]) -> float:
    """Arousal by the running means, 0 to 1."""
    voice = sum(
        weight * np.clip((means[name].value - usual) / deviation, -MOST_DEVIATIONS, MOST_DEVIATIONS)
        for name, (usual, deviation, weight) in FIGURES.items()
    )
    own = sum(weight * (means[name].value - means[f"speaker_{name}"].value) for name, weight in OWN_WEIGHTS.items())
    whisper = WHISPER * max(0.0, 1 - means["voiced"].value / LEAST_VOICED)
    total = means["slope"].evidence() * (voice + own - USUAL) - means["voiced"].evidence() * whisper
    modulation = np.clip((np.sqrt(means["modulation"].value) - LEAST_MODULATION) / MODULATION_RANGE, 0, 1)
    return 0.5 + 0.5 * modulation * min(1.0, means["sounds"].value / SPEECH_SHARE) * np.tanh(total)


def arousal(samples: np.ndarray) -> np.ndarray:
    """Arousal of a voice at 16 kHz, ten values a second."""
    return np.array([score(means) for means in hear(samples)])


def read(path: Path, seconds: float | None = None) -> np.ndarray:
    """The mean of a recording's channels at 16 kHz."""
    samples, rate = soundfile.read(path, always_2d=True)
    samples = resample_poly(samples.mean(1), RATE, rate)
    return samples if seconds is None else samples[: int(seconds * RATE)]


def voice() -> np.ndarray:
    """A voice of syllables and phrases that grows lively after 6 s and whispers after 9 s."""
    at = np.arange(12 * RATE) / RATE
    lively = (at >= 6).astype(float)
    hertz = (110 + 50 * lively) * (1 + (0.05 + 0.2 * lively) * np.sin(2 * np.pi * 0.7 * at))
    phase = 2 * np.pi * np.cumsum(hertz) / RATE
    tone = sum(np.sin(k * phase) / k ** (1.6 - 0.6 * lively) for k in range(1, 9))
    hiss = np.sin(at * RATE * at * RATE * 0.37)
    loud = np.maximum(0, np.sin(2 * np.pi * 4.3 * at)) * (at % 1.9 < 1.5) * (0.05 + 0.1 * lively)
    return loud * np.where(at >= 9, 0.3 * hiss, tone) + 1e-4 * hiss


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["figures", "golden", "values"])
    parser.add_argument("files", type=Path, nargs="+")
    args = parser.parse_args()
    if args.what == "golden":
        args.files[0].write_text("".join(f"{value:.5f}\n" for value in arousal(voice())))
    elif args.what == "values":
        for path in args.files:
            values = arousal(read(path))
            print(f"{path.stem} {np.mean(values):.3f}")
    else:
        found = []
        for path in args.files:
            found.append([[means[name].value for name in FIGURES] for means in hear(read(path, 8))][-1])
        for name, mean, deviation in zip(FIGURES, np.mean(found, 0), np.std(found, 0), strict=True):
            print(f"{name} {mean:.2f} {deviation:.2f}")


if __name__ == "__main__":
    main()
