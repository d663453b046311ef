"""Training data of the live mouth: speech of every level, in rooms and over other sounds, and other sounds alone."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from umo_train.metrics.lips import quiet_parts
from umo_train.mouth.captured import KNOWN, Capture
from umo_train.mouth.features import Front
from umo_train.mouth.sounds import draw
from umo_train.performer import mouth, prosody
from umo_train.performer.style import Style
from umo_train.skeleton import ARKIT
from umo_train.speech.utterance import FRAME_RATE, SAMPLE_RATE, SILENCE, Utterance
from umo_train.speech.variation import leveled, recorded

# Minimum length of a silence that counts as a pause, seconds.
PAUSE_S = 0.25
# Kinds of examples, which a plan weighs.
KINDS = ("spoken", "landmarks", "weights", "untold", "unspoken")
# Frames beside speech in which the presence of a voice is uncertain.
UNSURE = 2


@dataclass(frozen=True)
class Example:
    """One clip: rows of features, and the targets of each frame."""

    # [rows, features] f16, not normalised.
    rows: Tensor
    # [frames, channels] f16.
    mouth: Tensor
    # [frames] whether a voice speaks.
    voice: Tensor
    # [frames] weights of the mouth and of the voice.
    mouth_weight: Tensor
    voice_weight: Tensor
    # [channels] whether each is known.
    known: Tensor
    # [1] index in `KINDS`.
    kind: Tensor


def targets(utterance: Utterance) -> np.ndarray:
    """The performer's speaking mouth without mood `[frames, 52]`."""
    return np.clip(mouth.speak(utterance, prosody.listen(utterance), Style()), 0.0, 1.0)


def moved(faces: Sequence[np.ndarray]) -> list[str]:
    """Names of the channels that move, in ARKit's order."""
    most = np.max([face.max(0) for face in faces], axis=0)
    return [name for name, value in zip(ARKIT, most, strict=True) if value > 0.02]


def voices(silences: Sequence[tuple[float, float]], frames: int) -> tuple[np.ndarray, np.ndarray]:
    """Whether a voice speaks in each frame, and the weight of that, from the times of silence."""
    t = np.arange(frames) / FRAME_RATE
    spoken = np.ones(frames, bool)
    for start, end in silences:
        if end - start >= PAUSE_S:
            spoken &= ~((t >= start) & (t < end))
    weight = np.ones(frames)
    for edge in np.flatnonzero(np.diff(spoken.astype(int))) + 1:
        # The mouth opens ahead of the sound; the reverberation after it is not a voice.
        weight[max(edge - UNSURE, 0) : edge + UNSURE] = 0.2
    return spoken, weight


def silences(utterance: Utterance) -> list[tuple[float, float]]:
    return [(p.start, p.end) for p in utterance.phones if p.name == SILENCE]


def heard(samples: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Speech as recorded by a microphone: a room, other sounds, any level from -62 to 0 dB, 16 bits or unquantised."""
    out = recorded(samples, rng) if rng.random() < 0.6 else leveled(samples, 24)
    if rng.random() < 0.4:
        power = np.sqrt(np.mean(np.square(out))) * 10 ** (-rng.uniform(3, 30) / 20)
        out = out + power * draw(len(out), rng)
    if rng.random() < 0.25:
        # The speaker leans back, or turns up the microphone.
        at = int(rng.integers(len(out)))
        step = 10 ** (rng.uniform(-20, 20) / 20)
        out = np.concatenate([out[:at], out[at:] * step])
    return at_level(out, rng)


def at_level(sound: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """At a level of -62 to -3 dB, clipped and sometimes quantised like a converter."""
    sound = leveled(sound / (np.abs(sound).max() + 1e-9), rng.uniform(3, 62))
    if rng.random() < 0.5:
        sound = np.round(sound * 32767) / 32767
    return np.clip(sound, -1, 1).astype(np.float32)


def spoken(front: Front, utterance: Utterance, channels: Sequence[int], rng: np.random.Generator) -> Example:
    """Speech with known phones."""
    face = targets(utterance)[:, channels]
    voice, weight = voices(silences(utterance), len(face))
    return _example("spoken", front, heard(utterance.samples, rng), face, voice, np.ones(len(face)), weight)


def captured(
    kind: str, front: Front, capture: Capture, channels: Sequence[int], rest: np.ndarray, rng: np.random.Generator
) -> Example:
    """Speech with a captured mouth."""
    face = capture.frames()[:, channels]
    known = np.isin(np.array(ARKIT)[channels], KNOWN)
    # Its room may be as loud as soft speech: other examples teach voice detection.
    voice, weight = np.ones(len(face), bool), np.zeros(len(face))
    # Channels that a capture lacks stay at rest, and are not learned.
    face = np.where(known, face, rest)
    sound = heard(capture.samples, rng)
    return _example(kind, front, sound, face, voice, np.ones(len(face)), weight, known=known)


def untold(front: Front, samples: np.ndarray, rest: np.ndarray, rng: np.random.Generator) -> Example:
    """Speech without known phones: it teaches voice detection, and the mouth at rest."""
    frames = len(samples) * FRAME_RATE // SAMPLE_RATE
    voice, weight = voices(quiet_parts(samples), frames)
    return _example(
        "untold", front, heard(samples, rng), np.tile(rest, (frames, 1)), voice, (~voice & (weight == 1)) * 1.0, weight
    )


def unspoken(front: Front, seconds: float, rest: np.ndarray, rng: np.random.Generator) -> Example:
    """A sound without speech."""
    sound = at_level(draw(int(seconds * SAMPLE_RATE), rng), rng)
    frames = len(sound) * FRAME_RATE // SAMPLE_RATE
    ones = np.ones(frames)
    return _example("unspoken", front, sound, np.tile(rest, (frames, 1)), np.zeros(frames, bool), ones, ones)


def _example(
    kind: str,
    front: Front,
    samples: np.ndarray,
    face: np.ndarray,
    voice: np.ndarray,
    *weights: np.ndarray,
    known: np.ndarray | None = None,
) -> Example:
    rows = front.rows(samples).half()
    known = np.ones(face.shape[1]) if known is None else known
    columns = (face, voice, *weights, known, np.array([KINDS.index(kind)]))
    values = (torch.from_numpy(np.ascontiguousarray(x)).half() for x in columns)
    return Example(rows, *values)
