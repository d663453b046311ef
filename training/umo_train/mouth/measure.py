"""Quality of a mouth in speech and silence: compared with the performer, over levels, noises and real recordings."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from umo_train.data import corpus
from umo_train.metrics import lips
from umo_train.mouth import sounds
from umo_train.mouth.recordings import read
from umo_train.mouth.run import Mouth
from umo_train.performer.lips import lip_opening
from umo_train.skeleton import SHAPE
from umo_train.speech.utterance import FRAME_RATE, SAMPLE_RATE
from umo_train.speech.variation import leveled

# Number of channels before the coefficients.
_JAW = 6
# A mouth counts as shut up to this distance of the lips and this opening of the jaw: 2 mm, and 5 % of its range.
SHUT_LIPS, SHUT_JAW = lips.CLOSED, 0.05


def against_performer(mouth: Mouth, folder: Path, split: str, alter: Callable | None = None) -> dict[str, float]:
    """Correlations of jaw and lip opening over all items of a split, closures at p, b, m and stillness in pauses."""
    rows: list[tuple[np.ndarray, ...]] = []
    closed, still = [], []
    for item in corpus.items(folder, split):
        samples = item.utterance.samples
        face, _ = mouth(samples if alter is None else alter(samples))
        wanted = corpus.read_motion(folder, item.name, ("face",))["face"]
        count = min(len(face), len(wanted))
        jaws = (x[:count, _JAW + SHAPE["jawOpen"]] for x in (face, wanted))
        rows.append((*jaws, lip_opening(face)[:count], lip_opening(wanted)[:count]))
        closed.append(lips.closures(lip_opening(face), item.utterance.phones))
        still.append(lips.pauses(lip_opening(face), lips.silences(item.utterance.phones)))
    jaw, wanted_jaw, lip, wanted_lip = (np.concatenate(column) for column in zip(*rows, strict=True))
    return {
        "jaw": lips.pearson(jaw, wanted_jaw),
        "lips": lips.pearson(lip, wanted_lip),
        "closed": float(np.concatenate(closed).mean()),
        "still": float(np.concatenate(still).mean()),
        "open": float(lip.mean()),
        "wanted open": float(wanted_lip.mean()),
    }


def at_levels(mouth: Mouth, folder: Path, levels: Sequence[float]) -> dict[float, dict[str, float]]:
    """The held-out voices at root mean square levels of the speech, dB of full scale, in 16 bits."""

    def at(decibels: float) -> Callable[[np.ndarray], np.ndarray]:
        def alter(samples: np.ndarray) -> np.ndarray:
            return np.clip(np.round(leveled(samples, -decibels) * 32767) / 32767, -1, 1).astype(np.float32)

        return alter

    return {level: against_performer(mouth, folder, "test_voice", at(level)) for level in levels}


def shut(face: np.ndarray) -> np.ndarray:
    """Whether the mouth is shut in each frame."""
    return (lip_opening(face) <= SHUT_LIPS) & (face[:, _JAW + SHAPE["jawOpen"]] <= SHUT_JAW)


def _pink(count: int, rng: np.random.Generator) -> np.ndarray:
    spectrum = np.fft.rfft(rng.standard_normal(count))
    spectrum[1:] /= np.sqrt(np.arange(1, len(spectrum)))
    return np.fft.irfft(spectrum, count)


def _mains(count: int, rng: np.random.Generator) -> np.ndarray:
    t = np.arange(count) / SAMPLE_RATE
    return sum(np.sin(2 * np.pi * 50 * k * t + k) / k for k in range(1, 12)) + 0.01 * rng.standard_normal(count)


def _chords(count: int, rng: np.random.Generator) -> np.ndarray:
    """Four chords, half a second each, of decaying sawtooth tones."""
    out = np.zeros(count)
    length = SAMPLE_RATE // 2
    t = np.arange(length) / SAMPLE_RATE
    for k in range(count // length):
        for semitone in np.array([[0, 4, 7], [5, 9, 12], [7, 11, 14], [9, 12, 16]][k % 4]):
            hertz = 220 * 2 ** (semitone / 12)
            tone = sum(np.sin(2 * np.pi * hertz * h * t) / h for h in range(1, int(7000 / hertz)))
            out[k * length : (k + 1) * length] += tone * np.exp(-3 * t) * np.minimum(t / 0.01, 1)
    return out + 1e-4 * rng.standard_normal(count)


NOISES: dict[str, Callable[[int, np.random.Generator], np.ndarray]] = {
    "white noise": lambda count, rng: rng.standard_normal(count),
    "pink noise": _pink,
    "mains hum": _mains,
    "chords": _chords,
    "music": sounds.music,
    "knocks": sounds.knocks,
    "tones": sounds.tones,
}


def shut_over(mouth: Mouth, seconds: float = 20.0, levels: Sequence[float] = (-60, -40, -20, -6)) -> dict[str, float]:
    """Share of frames with a shut mouth over each noise, at four levels."""
    out = {}
    for name, make in NOISES.items():
        frames = []
        for level in levels:
            sound = make(int(seconds * SAMPLE_RATE), np.random.default_rng((987, int(-level))))
            sound = sound / np.sqrt(np.mean(np.square(sound))) * 10 ** (level / 20)
            frames.append(shut(mouth(np.clip(sound, -1, 1).astype(np.float32))[0]))
        out[name] = float(np.concatenate(frames).mean())
    return out


def recordings(mouth: Mouth, paths: Sequence[Path]) -> dict[str, dict[str, float]]:
    """Real speech: correlation of the opening with the loudness at the best of five lags, the mouth's opening, and the
    share shut in silences."""
    out = {}
    for path in paths:
        samples = read(path)
        face, gate = mouth(samples)
        opening = lip_opening(face)
        follows = lips.lag_correlation([(opening, lips.envelope(samples, len(opening)))])
        # The gate takes time to shut, and a mouth opens ahead of the sound.
        spans = ((int(a * FRAME_RATE) + 8, int(b * FRAME_RATE) - 4) for a, b in lips.quiet_parts(samples))
        quiet = [shut(face)[first:last] for first, last in spans if last > first]
        frames = np.concatenate([*quiet, np.zeros(0, bool)])
        out[path.name] = {
            "envelope": max(follows.values()),
            "lag": float(max(follows, key=follows.get)),
            "95th percentile": float(np.percentile(opening, 95)),
            "gate": float(gate.mean()),
            "shut in silences": float(frames.mean()) if len(frames) else 1.0,
        }
    return out
