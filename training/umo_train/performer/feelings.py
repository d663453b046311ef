"""Emotions in face and posture: the amounts equal the library's moods (SPEC 2.11.2)."""

from dataclasses import dataclass

import numpy as np

from umo_train.performer.curves import drift, overlapping_steps
from umo_train.performer.prosody import Prosody
from umo_train.skeleton import SHAPE

# Strength in silence relative to speech, and duration of a change, seconds.
_SILENT, _CHANGE_S = 0.8, 0.6


@dataclass(frozen=True)
class Feeling:
    """`face`: for each shape (both sides if there are two), a positive value is added, a negative one removes that
    share. Rotations in radians: pitch of the spine; pitch, yaw and roll of neck with head; lift and pull of both
    collars."""

    face: dict[str, float]
    spine: float = 0.0
    head: tuple[float, float, float] = (0.0, 0.0, 0.0)
    collars: tuple[float, float] = (0.0, 0.0)


FEELINGS = {
    "joy": Feeling(
        {"mouthSmile": 0.62, "mouthDimple": 0.12, "mouthUpperUp": 0.12, "mouthFrown": -0.9, "cheekSquint": 0.55,
         "eyeSquint": 0.38, "browInnerUp": 0.1, "browOuterUp": 0.14, "browDown": -0.9},
        -0.07, (-0.02, 0.0, 0.02), (0.02, -0.03),
    ),
    "sadness": Feeling(
        {"browInnerUp": 0.65, "browDown": 0.14, "browOuterUp": -0.8, "eyeSquint": 0.2, "mouthFrown": 0.5,
         "mouthShrugLower": 0.28, "mouthSmile": -0.85},
        0.14, (0.17, 0.0, 0.035), (-0.06, 0.04),
    ),
    "anger": Feeling(
        {"browDown": 0.8, "browInnerUp": -0.8, "browOuterUp": -0.5, "eyeSquint": 0.35, "eyeWide": 0.25,
         "noseSneer": 0.3, "mouthPress": 0.4, "mouthFrown": 0.28, "mouthSmile": -0.9},
        0.06, (0.04, 0.0, 0.0), (0.05, 0.02),
    ),
    "surprise": Feeling(
        {"browInnerUp": 0.7, "browOuterUp": 0.72, "browDown": -1.0, "eyeWide": 0.6, "eyeSquint": -0.9,
         "jawOpen": 0.14, "mouthFunnel": 0.1},
        -0.06, (-0.05, 0.0, 0.0), (0.07, 0.0),
    ),
    "disgust": Feeling(
        {"noseSneer": 0.65, "browDown": 0.4, "cheekSquint": 0.35, "eyeSquint": 0.4, "mouthUpperUp": 0.36,
         "mouthFrown": 0.3, "mouthSmile": -0.85},
        -0.05, (-0.05, 0.12, 0.045), (0.03, 0.0),
    ),
    "fear": Feeling(
        {"browInnerUp": 0.75, "browOuterUp": 0.3, "browDown": 0.12, "eyeWide": 0.65, "eyeSquint": -0.9,
         "mouthStretch": 0.4, "mouthSmile": -0.85},
        0.06, (-0.04, 0.0, 0.0), (0.12, 0.04),
    ),
}  # fmt: skip
_LIPS = ("mouthClose", "mouthPucker", "mouthFunnel")


def strength(prosody: Prosody, random: np.random.Generator) -> np.ndarray:
    """Strength of an emotion, `[T]`, about 1: varies by phrase, weaker in silence."""
    t, phrases = prosody.t, prosody.phrases
    times, values = [-9.0], [_SILENT * random.uniform(0.8, 1.05)]
    for start, end in phrases:
        times += [start - 0.25, end + 0.2]
        values += [random.uniform(0.8, 1.15), _SILENT * random.uniform(0.8, 1.1)]
    level = overlapping_steps(t, np.maximum.accumulate(times), np.array(values)[:, None], _CHANGE_S)[:, 0]
    return level * (1.0 + 0.06 * drift(random, t, 0.1, 0.4, 1)[:, 0])


def show(out: np.ndarray, feeling: Feeling, level: np.ndarray) -> None:
    """Adds the emotion to a face `[T, 52]`, weaker for an open or rounded mouth."""
    lips = np.max([out[:, SHAPE[name]] for name in _LIPS], axis=0)
    speaks = (1.0 - 0.7 * np.minimum(out[:, SHAPE["jawOpen"]], 1.0)) * (1.0 - 0.7 * np.minimum(lips, 1.0))
    # Lips pressed together for p, b and m are not pulled apart.
    speaks *= 1.0 - np.clip((out[:, SHAPE["mouthPressLeft"]] - 0.06) / 0.2, 0.0, 1.0)
    for name, amount in feeling.face.items():
        # The two sides of a face always differ.
        for side in ("Left", "Right") if name + "Left" in SHAPE else ("",):
            column = SHAPE[name + side]
            room = 1.0 - out[:, column] if amount > 0.0 else out[:, column]
            share = amount * level * (0.94 if side == "Right" else 1.0)
            if amount > 0.0 and name.startswith(("mouth", "jaw")):
                share = share * speaks
            out[:, column] += np.clip(share, -1.0, 1.0) * room
