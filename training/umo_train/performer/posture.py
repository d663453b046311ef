"""Trunk and head: stance of the style, breath, sway, nods and turns."""

from dataclasses import dataclass

import numpy as np

from umo_train.performer.arms import WRIST
from umo_train.performer.curves import bumps, drift, hold_steps, path
from umo_train.performer.gestures import Gestures
from umo_train.performer.prosody import Prosody
from umo_train.performer.style import Style


@dataclass(frozen=True)
class Posture:
    """Local pitch, yaw and roll `[T, 3]` of each joint in radians, positive pitch forward, yaw to the left."""

    pelvis: np.ndarray
    spine: tuple[np.ndarray, np.ndarray, np.ndarray]
    neck: np.ndarray
    head: np.ndarray
    # Of the left and right collar: lift, and pull forward.
    collars: np.ndarray
    # Breath, -1 out .. 1 in.
    breath: np.ndarray

    @property
    def gaze(self) -> np.ndarray:
        """The head's whole turn against the world, summed (angles are small)."""
        return self.pelvis + sum(self.spine) + self.neck + self.head


def stand(prosody: Prosody, style: Style, hips: np.ndarray, gestures: Gestures, random: np.random.Generator) -> Posture:
    """`hips` is the pelvis' own rotation, from the legs; the trunk goes along with the arms a little."""
    t = prosody.t
    energy, openness = style.energy, style.openness
    breath = _breath(t, random, energy)
    slump = 0.5 - openness
    sway = drift(random, t, 0.03, 0.12, 3) * np.array([0.006, 0.012, 0.006]) * (0.6 + 0.9 * energy)
    rhythm = _rhythm(prosody, random)
    sway += rhythm[:, :3] * np.array([0.007, 0.012, 0.008]) * (0.5 + 1.1 * energy)
    turn = rhythm[:, 3:] * np.array([0.035, 0.11, 0.045]) * (0.55 + 0.8 * energy)
    turn += _idle_turns(prosody, random) * np.array([0.05, 0.14, 0.03])
    nod = _nods(prosody, style, random)

    lean = np.zeros((len(t), 3))
    lean[:, 0] = 0.05 * slump + 0.05 * (energy - 0.4)
    lean += sway
    # Hips that drop to one side are righted by the spine.
    lean[:, 2] -= 0.5 * hips[:, 2]
    lean[:, 1] += 0.12 * turn[:, 1]
    wrists = gestures.states[..., WRIST]
    lean[:, 1] += 0.10 * (wrists[1, :, 2] - wrists[0, :, 2])
    lean[:, 0] += 0.03 * (wrists[..., 2].mean(axis=0) - 0.05)
    spine = [lean.copy(), lean.copy(), lean.copy()]
    spine[0][:, 0] += 0.02 * slump + 0.05 * nod
    spine[1][:, 0] += 0.05 * slump - 0.004 * breath + 0.06 * nod
    spine[2][:, 0] += 0.10 * slump - 0.012 * breath + 0.12 * nod

    trunk = hips + sum(spine)
    neck = 0.4 * turn - 0.25 * trunk
    neck[:, 0] += 0.4 * nod + 0.06 * slump
    head = 0.6 * turn - 0.45 * trunk
    # Stern brows lower the head, a shy one hangs.
    head[:, 0] += 0.6 * nod + 0.10 * max(0.0, 0.35 - style.mood) + 0.8 * max(0.0, 0.25 - openness) * style.mood
    head[:, 0] -= 0.06 * slump
    collars = np.zeros((2, len(t), 2))
    collars[..., 0] = 0.014 * breath + 0.35 * max(0.0, 0.2 - openness)
    collars[..., 1] = 0.10 * slump
    # A raised wrist takes its collar along.
    collars[..., 0] += 0.9 * np.clip(wrists[..., 1] + 0.40, 0.0, None) ** 2 + 0.3 * gestures.shrug
    collars[..., 1] += 0.25 * np.clip(wrists[..., 2] - 0.20, 0.0, None)
    tilt = 0.08 * gestures.shrug * random.choice((-1.0, 1.0))
    head[:, 2] += tilt
    neck[:, 2] += 0.5 * tilt
    return Posture(hips, tuple(spine), neck, head, collars, breath)


def _breath(t: np.ndarray, random: np.random.Generator, energy: float) -> np.ndarray:
    rate = random.uniform(0.2, 0.27) + 0.04 * energy
    phase = 2.0 * np.pi * (rate * t + random.random()) + 0.3 * drift(random, t, 0.03, 0.08, 1)[:, 0]
    # In is quicker than out.
    return np.sin(phase + 0.35 * np.sin(phase))


def _rhythm(prosody: Prosody, random: np.random.Generator) -> np.ndarray:
    """`[T, 6]` of unit variance in speech: the body goes from accent to accent and turns there, and comes back to rest
    after the phrase. The first three columns move at every accent, the others at some."""
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
            # Away from where it is, so that it does move.
            aim[:3] = -np.copysign(aim[:3], values[-1][:3] + 1e-9 * aim[:3])
            aim[3:] = np.where(random.random(3) < 0.55, aim[3:] * random.uniform(0.2, 1.0), values[-1][3:])
            times.append(at)
            values.append(aim)
        times.append(max(times[-1] + 0.5, end + 0.25))
        values.append(np.zeros(6))
    values = np.array(values)
    return path(prosody.t, np.array(times), values, np.zeros_like(values))


def _idle_turns(prosody: Prosody, random: np.random.Generator) -> np.ndarray:
    """`[T, 3]` of unit variance: looks around, only in long silences."""
    times, values = [-1.0], [np.zeros(3)]
    seconds = len(prosody.t) / 30.0
    gaps = zip(np.append(0.0, prosody.phrases[:, 1]), np.append(prosody.phrases[:, 0], seconds), strict=True)
    for start, end in gaps:
        at = start + random.uniform(1.0, 2.5)
        while at < end - 1.5:
            times.append(at)
            values.append(random.normal(0.0, 1.0, 3))
            at += random.uniform(2.0, 5.0)
        if at > start + 2.5:
            times.append(max(times[-1] + 0.9, end - 0.6))
            values.append(np.zeros(3))
    return hold_steps(prosody.t, np.array(times), np.array(values), 0.8)


def _nods(prosody: Prosody, style: Style, random: np.random.Generator) -> np.ndarray:
    """Pitch `[T]`: down at accents, with a small lift before."""
    t, accents = prosody.t, prosody.accents
    chosen = random.random(len(accents)) < 0.6 + 0.35 * style.energy
    size = random.uniform(0.05, 0.11, len(accents)) * prosody.weights * (0.45 + 1.1 * style.energy) * chosen
    down = bumps(t, accents, 0.26, 0.4) @ size
    return down - 0.25 * bumps(t, accents - 0.26, 0.3, 0.26) @ size
