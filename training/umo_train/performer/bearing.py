"""Orientation of head and trunk over an utterance: an attitude for each stretch of speech, and continuous motion."""

from dataclasses import dataclass

import numpy as np

from umo_train.performer.curves import drift, overlapping_steps
from umo_train.performer.prosody import Prosody
from umo_train.performer.style import Style
from umo_train.speech.utterance import FRAME_RATE

# Duration of an attitude, seconds.
_ATTITUDE_S = (1.1, 2.6)
# Standard deviations of an attitude's pitch, yaw and roll, in radians.
_HEAD = np.array([0.056, 0.078, 0.062])
# Share of the head's rotation that the trunk follows, and its delay, seconds.
_TRUNK, _LAG_S = np.array([0.22, 0.6, 0.3]), (0.12, 0.4)
# Pauses of this length or more contain looks around, seconds.
_LONG_S = 2.5


@dataclass(frozen=True)
class Bearing:
    """Pitch, yaw and roll in the world `[T, 3]`, radians."""

    head: np.ndarray
    trunk: np.ndarray


def liveliness(style: Style) -> float:
    """Amount of motion of head and trunk, about 1 for a neutral speaker."""
    return 0.4 + 0.6 * style.energy + 0.55 * style.gesture_rate


def bear(prosody: Prosody, style: Style, random: np.random.Generator) -> Bearing:
    """The head turns ahead of each stretch of speech; the trunk follows."""
    t, size = prosody.t, liveliness(style)
    starts, aims = _attitudes(prosody, random)
    head = overlapping_steps(t, starts, aims * _HEAD * size, random.uniform(0.55, 1.0, len(starts)))
    late = starts + random.uniform(*_LAG_S, len(starts))
    late[1:] = np.maximum(late[1:], late[:-1] + 0.05) if len(late) > 1 else late[1:]
    trunk = overlapping_steps(t, late, aims * _HEAD * _TRUNK * size, random.uniform(0.8, 1.4, len(starts)))
    slow, quick = drift(random, t, 0.08, 0.3, 3), drift(random, t, 0.35, 0.9, 3)
    head = head + (slow * np.array([0.016, 0.02, 0.018]) + quick * np.array([0.012, 0.015, 0.01])) * size
    trunk = trunk + drift(random, t, 0.05, 0.25, 3) * np.array([0.008, 0.016, 0.01]) * size
    return Bearing(head, trunk)


def _attitudes(prosody: Prosody, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Start of each attitude `[n]`, ascending, and its value `[n, 3]`, of unit variance in speech."""
    times, aims = [-9.0], [0.4 * random.normal(0.0, 1.0, 3)]
    seconds = len(prosody.t) / FRAME_RATE
    before = 0.0
    for start, end in prosody.phrases:
        _look_around(times, aims, before, start, random)
        lead = start - random.uniform(0.15, 0.45)
        if lead > times[-1] + 0.4:
            times.append(lead)
            aims.append(_next(aims[-1], random))
        at = max(times[-1], start) + random.uniform(*_ATTITUDE_S)
        while at < end - 0.5:
            # A new stretch starts shortly before an accent: the head moves ahead of it.
            after = prosody.accents[prosody.accents > at]
            at = float(after[0]) - random.uniform(0.25, 0.5) if len(after) and after[0] < at + 1.0 else at
            if at > times[-1] + 0.5:
                times.append(at)
                aims.append(_next(aims[-1], random))
            at = max(at, times[-1]) + random.uniform(*_ATTITUDE_S)
        # Most of the way back to the listener as the phrase ends.
        back = end + random.uniform(-0.35, 0.3)
        if back > times[-1] + 0.5 and random.random() < 0.7:
            times.append(back)
            aims.append(0.35 * random.normal(0.0, 1.0, 3))
        before = end
    _look_around(times, aims, before, seconds, random)
    return np.array(times), np.array(aims)


def _next(now: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """The next attitude, mostly to the other side in yaw or roll."""
    aim = random.normal(0.0, 1.0, 3)
    side = random.choice((1, 2))
    if random.random() < 0.65 and abs(now[side]) > 0.2:
        aim[side] = -np.copysign(max(abs(aim[side]), 0.6), now[side])
    # Looking far down would appear stern.
    return np.clip(aim, -2.0, (0.7, 2.0, 2.0))


def _look_around(
    times: list[float], aims: list[np.ndarray], start: float, end: float, random: np.random.Generator
) -> None:
    """Occasional looks around while waiting."""
    if end - start < _LONG_S:
        return
    at = start + random.uniform(0.8, 1.8)
    while at < end - 1.2:
        if at > times[-1] + 0.5:
            times.append(at)
            aims.append(random.normal(0.0, 1.0, 3) * np.array([0.6, 1.2, 0.7]))
        at += random.uniform(1.4, 3.2)
