"""Trunk and head: stance of the style, breath, sway, nods and turns."""

from dataclasses import dataclass

import numpy as np

from umo_train.performer.curves import bumps, drift, hold_steps
from umo_train.performer.arms import WRIST
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


def stand(
    prosody: Prosody, style: Style, hips: np.ndarray, gestures: Gestures, random: np.random.Generator
) -> Posture:
    """`hips` is the pelvis' own rotation, from the legs; the trunk goes along with the arms a little."""
    t = prosody.t
    energy, openness = style.energy, style.openness
    breath = _breath(t, random, energy)
    slump = 0.5 - openness
    sway = drift(random, t, 0.04, 0.16, 3) * np.array([0.010, 0.022, 0.010]) * (0.6 + 0.9 * energy)
    turn = _turns(prosody, style, random)
    nod = _nods(prosody, style, random)

    lean = np.zeros((len(t), 3))
    lean[:, 0] = 0.05 * slump + 0.02 * (energy - 0.4)
    lean += sway
    # Hips that drop to one side are righted by the spine.
    lean[:, 2] -= 0.5 * hips[:, 2]
    lean[:, 1] += 0.12 * turn[:, 1]
    wrists = gestures.states[..., WRIST]
    lean[:, 1] += 0.10 * (wrists[1, :, 2] - wrists[0, :, 2])
    lean[:, 0] += 0.03 * (wrists[..., 2].mean(axis=0) - 0.05)
    spine = [lean.copy(), lean.copy(), lean.copy()]
    spine[0][:, 0] += 0.02 * slump
    spine[1][:, 0] += 0.05 * slump - 0.004 * breath
    spine[2][:, 0] += 0.10 * slump - 0.012 * breath + 0.06 * nod

    trunk = hips + sum(spine)
    neck = 0.4 * turn - 0.25 * trunk
    neck[:, 0] += 0.4 * nod + 0.06 * slump
    head = 0.6 * turn - 0.45 * trunk
    # Stern brows lower the head, a shy one hangs.
    head[:, 0] += 0.6 * nod + 0.10 * max(0.0, 0.35 - style.mood) + 0.35 * max(0.0, 0.25 - openness) * style.mood
    head[:, 0] -= 0.06 * slump
    collars = np.zeros((2, len(t), 2))
    collars[..., 0] = 0.014 * breath + 0.05 * max(0.0, 0.2 - openness)
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


def _turns(prosody: Prosody, style: Style, random: np.random.Generator) -> np.ndarray:
    """Slow turns and tilts of the head, `[T, 3]`: more while talking, back to the listener at a phrase's end."""
    times, aims = [-1.0], [np.zeros(3)]
    size = np.array([0.045, 0.16, 0.06]) * (0.55 + 0.8 * style.energy)
    for start, end in prosody.phrases:
        at = start - random.uniform(0.0, 0.2)
        while at < end - 0.4:
            times.append(at)
            aims.append(random.normal(0.0, 0.6, 3) * size)
            at += random.uniform(0.9, 2.6) / (0.7 + 0.6 * style.energy)
        # The settle.
        times.append(max(end - 0.15, at - 0.3))
        aims.append(np.array([0.02, 0.0, 0.0]) + random.normal(0.0, 0.25, 3) * size)
    at, until = times[-1] + 3.0, len(prosody.t) / 30.0
    while at < until:
        times.append(at)
        aims.append(random.normal(0.0, 0.5, 3) * size)
        at += random.uniform(2.5, 6.0)
    seconds = np.minimum(np.diff(times, append=times[-1] + 2.0) * 0.9, random.uniform(0.5, 0.9, len(times)))
    return hold_steps(prosody.t, np.array(times), np.array(aims), seconds)


def _nods(prosody: Prosody, style: Style, random: np.random.Generator) -> np.ndarray:
    """Pitch `[T]`: down at accents, with a small lift before."""
    t, accents = prosody.t, prosody.accents
    chosen = random.random(len(accents)) < 0.55 + 0.35 * style.energy
    size = random.uniform(0.05, 0.11, len(accents)) * prosody.weights * (0.45 + 1.1 * style.energy) * chosen
    rise, fall = 0.2 - 0.04 * style.energy, 0.36 - 0.08 * style.energy
    down = bumps(t, accents, rise, fall) @ size
    return down - 0.3 * bumps(t, accents - rise, 0.22, rise) @ size
