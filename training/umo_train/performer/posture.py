"""Trunk and head: stance of the style, breath, sway, nods and turns."""

from dataclasses import dataclass

import numpy as np

from umo_train.performer.arms import WRIST
from umo_train.performer.bearing import Bearing, liveliness
from umo_train.performer.curves import bumps, drift, path
from umo_train.performer.feelings import FEELINGS, Feeling
from umo_train.performer.gestures import Gestures
from umo_train.performer.prosody import Prosody
from umo_train.performer.style import Style

# Limits of the head's own rotation: pitch, yaw and roll in radians.
_NECK_LIMIT = np.array([0.42, 0.6, 0.36])


@dataclass(frozen=True)
class Posture:
    """Local pitch, yaw and roll `[T, 3]` of each joint in radians, positive pitch forward, yaw to the left."""

    pelvis: np.ndarray
    spine: tuple[np.ndarray, np.ndarray, np.ndarray]
    neck: np.ndarray
    head: np.ndarray
    # Left and right collar: lift, and pull forward.
    collars: np.ndarray
    # Breath, -1 out .. 1 in.
    breath: np.ndarray

    @property
    def gaze(self) -> np.ndarray:
        """The head's total rotation in the world, summed (angles are small)."""
        return self.pelvis + sum(self.spine) + self.neck + self.head


def stand(
    prosody: Prosody, style: Style, hips: np.ndarray, bearing: Bearing, gestures: Gestures, nods: np.ndarray,
    felt: np.ndarray, random: np.random.Generator,
) -> Posture:  # fmt: skip
    """`hips` is the pelvis' own rotation, from the legs; the trunk follows the arms a little. `nods` `[T]` are added to
    those at accents, and `felt` `[T]` is the strength of the style's emotion."""
    t = prosody.t
    energy, openness, lively = style.energy, style.openness, liveliness(style)
    breath = _breath(t, random, energy)
    slump = 0.5 - openness
    rhythm = _rhythm(prosody, random)
    sway = rhythm[:, :3] * np.array([0.032, 0.055, 0.038]) * (0.45 + 0.75 * energy)
    turn = rhythm[:, 3:] * np.array([0.03, 0.07, 0.05]) * (0.45 + 0.7 * energy)
    nod = _nods(prosody, style, random) + nods
    feeling = FEELINGS[style.feeling] if style.feeling else Feeling({})

    wrists = gestures.states[..., WRIST]
    trunk = bearing.trunk + sway
    trunk[:, 0] += 0.15 * slump + 0.13 * (energy - 0.4) + 0.06 * (wrists[..., 2].mean(axis=0) - 0.05)
    # The side of the reaching hand comes forward.
    trunk[:, 1] += 0.28 * (wrists[1, :, 2] - wrists[0, :, 2])
    trunk[:, 2] -= 0.10 * (wrists[1, :, 1] - wrists[0, :, 1])
    # The spine compensates for hips that drop to one side.
    bend = trunk - hips * np.array([0.5, 0.75, 0.85])
    spine = [share * bend for share in (0.3, 0.34, 0.36)]
    spine[0][:, 0] += 0.02 * slump + 0.05 * nod
    spine[1][:, 0] += 0.05 * slump - 0.004 * breath + 0.06 * nod
    spine[2][:, 0] += 0.10 * slump - 0.014 * breath + 0.12 * nod
    for k, share in ((1, 0.45), (2, 0.55)):
        spine[k][:, 0] += share * feeling.spine * felt

    # Neck and head do the part of the rotation that the trunk does not.
    own = bearing.head + turn
    own[:, 0] += nod + 0.02 * slump
    # A stern style lowers the head, a shy one lets it hang.
    own[:, 0] += 0.10 * max(0.0, 0.35 - style.mood) + 0.8 * max(0.0, 0.25 - openness) * style.mood
    own[:, 2] += 0.13 * gestures.shrug * random.choice((-1.0, 1.0))
    # The neck does not compensate for the emotion's bend of the spine: its head has its own rotation.
    bent = np.array([feeling.spine, 0.0, 0.0]) * felt[:, None]
    own -= (hips + sum(spine) - bent) * np.array([0.8, 0.55, 0.75])
    own += np.array(feeling.head) * felt[:, None]
    own = _NECK_LIMIT * np.tanh(own / _NECK_LIMIT)
    neck, head = own * np.array([0.42, 0.4, 0.45]), own * np.array([0.58, 0.6, 0.55])
    collars = _collars(wrists, gestures.shrug, breath, style, lively, t, random)
    collars += np.array(feeling.collars) * felt[:, None]
    return Posture(hips, tuple(spine), neck, head, collars, breath)


def _collars(
    wrists: np.ndarray, shrug: np.ndarray, breath: np.ndarray, style: Style, lively: float, t: np.ndarray,
    random: np.random.Generator,
) -> np.ndarray:  # fmt: skip
    """A raised or reaching arm moves its shoulder blade; shoulders breathe and are never quite still."""
    out = np.zeros((2, len(t), 2))
    out[..., 0] = 0.02 * breath + 0.3 * max(0.0, 0.2 - style.openness)
    out[..., 1] = 0.10 * (0.5 - style.openness)
    raised, reached, out_ = wrists[..., 1] + 0.46, wrists[..., 2] - 0.08, wrists[..., 0] - 0.22
    out[..., 0] += 0.42 * _ramp(raised, 0.08) + 0.16 * _ramp(out_, 0.05) + 0.3 * shrug
    out[..., 1] += 0.55 * _ramp(reached, 0.06) - 0.35 * _ramp(out_, 0.05)
    idle = drift(random, t, 0.06, 0.3, 4).T.reshape(2, 2, len(t)).swapaxes(1, 2)
    return out + idle * np.array([0.012, 0.016]) * lively


def _ramp(x: np.ndarray, soft: float) -> np.ndarray:
    """0 below 0 and `x` above, smooth in between."""
    return 0.5 * (x + np.sqrt(x * x + soft * soft)) - 0.5 * soft


def _breath(t: np.ndarray, random: np.random.Generator, energy: float) -> np.ndarray:
    rate = random.uniform(0.2, 0.27) + 0.04 * energy
    phase = 2.0 * np.pi * (rate * t + random.random()) + 0.3 * drift(random, t, 0.03, 0.08, 1)[:, 0]
    # Inhaling is faster than exhaling.
    return np.sin(phase + 0.35 * np.sin(phase))


def _rhythm(prosody: Prosody, random: np.random.Generator) -> np.ndarray:
    """`[T, 6]` of unit variance in speech: the body moves from accent to accent, and returns to rest after the phrase.
    The first three columns move at every accent, the others at some."""
    times, values = [-1.0], [np.zeros(6)]
    for start, end in prosody.phrases:
        inside = prosody.accents[(prosody.accents >= start) & (prosody.accents <= end)]
        if not len(inside):
            continue
        begin = max(inside[0] - 0.6, times[-1] + 0.05)
        if begin < inside[0] - 0.2:
            times.append(begin)
            values.append(values[-1])
        for at in inside:
            if at - times[-1] < 0.25:
                continue
            aim = random.uniform(0.8, 1.6, 6) * random.choice((-1.0, 1.0), 6)
            # Away from the current value, so that it does move.
            aim[:3] = -np.copysign(aim[:3], values[-1][:3] + 1e-9 * aim[:3])
            aim[3:] = np.where(random.random(3) < 0.55, aim[3:] * random.uniform(0.2, 1.0), values[-1][3:])
            times.append(at)
            values.append(aim)
        times.append(max(times[-1] + 0.5, end + 0.25))
        values.append(np.zeros(6))
    values = np.array(values)
    return path(prosody.t, np.array(times), values, np.zeros_like(values))


def _nods(prosody: Prosody, style: Style, random: np.random.Generator) -> np.ndarray:
    """Pitch `[T]`: down at accents, with a small lift before."""
    t, accents = prosody.t, prosody.accents
    chosen = random.random(len(accents)) < 0.6 + 0.35 * style.energy
    size = random.uniform(0.05, 0.11, len(accents)) * prosody.weights * (0.45 + 1.1 * style.energy) * chosen
    down = bumps(t, accents, 0.26, 0.4) @ size
    return down - 0.25 * bumps(t, accents - 0.26, 0.3, 0.26) @ size
