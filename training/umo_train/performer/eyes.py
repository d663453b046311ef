"""Blinks and gaze."""

import numpy as np

from umo_train.performer.curves import bumps, drift, hold_steps
from umo_train.performer.prosody import Prosody
from umo_train.performer.style import Style
from umo_train.skeleton import SHAPE
from umo_train.speech.utterance import FRAME_RATE

# Rotation for an eyeLook* of 1, in radians.
FULL_LOOK = 0.52
# In pauses of at least this length, the eyes wander, seconds.
_WAIT_S = 1.2


def blink(out: np.ndarray, prosody: Prosody, random: np.random.Generator) -> None:
    """Lids: every 2 to 6 s and at phrase ends, 6 frames each."""
    t = prosody.t
    gaps = random.uniform(2.0, 6.0, len(t) // 60 + 2)
    times = np.cumsum(gaps) - random.uniform(0.0, 2.0)
    ends = prosody.phrases[random.random(len(prosody.phrases)) < 0.6, 1] + 0.08
    times = np.sort(np.concatenate([times[times < len(t) / 30.0], ends]))
    if len(times):
        times = times[np.diff(times, prepend=-1.0) > 0.6]
    lids = bumps(t, np.round(times * 30.0) / 30.0, 0.09, 0.15).max(axis=1, initial=0.0)
    for side in ("Left", "Right"):
        shut = SHAPE["eyeBlink" + side]
        out[:, shut] = np.maximum(out[:, shut], 0.95 * lids)
        for other in ("eyeWide", "eyeSquint"):
            out[:, SHAPE[other + side]] *= 1.0 - 0.8 * lids


def look(out: np.ndarray, prosody: Prosody, style: Style, head: np.ndarray, random: np.random.Generator) -> None:
    """Gaze: fixed on the listener while the head (`[T, 3]` pitch, yaw, roll) moves, away when a phrase starts."""
    times, aims = [-1.0], [np.zeros(2)]
    _wait(times, aims, prosody, style, random)
    away = 0.45 + 0.4 * (0.5 - style.openness)
    for start, end in prosody.phrases:
        if random.random() < away:
            aim = np.array([random.choice((-1.0, 1.0)) * random.uniform(0.12, 0.32), random.uniform(-0.22, 0.12)])
            times += [start - random.uniform(0.0, 0.25), start + random.uniform(0.5, 1.2)]
            aims += [aim, np.zeros(2)]
        at = start + random.uniform(1.0, 2.5)
        while at < end:
            times.append(at)
            near = random.random() < 0.7
            aims.append(random.normal(0.0, 0.035 if near else 0.16, 2) * (1.0, 0.5))
            at += random.uniform(0.5, 1.0) if not near else random.uniform(1.0, 2.6)
    order = np.argsort(times, kind="stable")
    gaze = hold_steps(prosody.t, np.array(times)[order], np.array(aims)[order], 0.07)
    # Shy and sad eyes look lower than the listener's.
    gaze[:, 1] -= 0.16 * max(0.0, 0.3 - style.openness) + (0.08 if style.feeling == "sadness" else 0.0)
    yaw = gaze[:, 0] - head[:, 1] + 0.004 * drift(random, prosody.t, 0.3, 1.2, 1)[:, 0]
    down = -gaze[:, 1] - head[:, 0]
    yaw, down = (0.9 * np.tanh(x / FULL_LOOK / 0.9) for x in (yaw, down))
    left, right = np.clip(yaw, 0.0, None), np.clip(-yaw, 0.0, None)
    for name, value in (("OutLeft", left), ("InRight", left), ("InLeft", right), ("OutRight", right)):
        out[:, SHAPE["eyeLook" + name]] = value
    for side in ("Left", "Right"):
        out[:, SHAPE["eyeLookDown" + side]] = np.clip(down, 0.0, None)
        out[:, SHAPE["eyeLookUp" + side]] = np.clip(-down, 0.0, None)
        # Lids follow a lowered eye.
        out[:, SHAPE["eyeBlink" + side]] = 0.35 * np.clip(down, 0.0, None)


def _wait(
    times: list[float], aims: list[np.ndarray], prosody: Prosody, style: Style, random: np.random.Generator
) -> None:
    """While waiting, the gaze alternates between the other's eyes and mouth, and sometimes goes elsewhere; less for a
    listener.
    """
    edges = np.concatenate([[0.0], prosody.phrases.ravel(), [len(prosody.t) / FRAME_RATE]]).reshape(-1, 2)
    elsewhere = 0.12 if style.listens else 0.3
    for before, after in edges[edges[:, 1] - edges[:, 0] > _WAIT_S]:
        at = before + random.uniform(0.3, 1.0)
        while at < after - 0.4:
            far = random.random() < elsewhere
            times.append(at)
            aims.append(random.normal(0.0, 1.0, 2) * ((0.2, 0.09) if far else (0.03, 0.025)))
            at += random.uniform(0.5, 1.1) if far else random.uniform(0.7, 2.4)
        times.append(after - 0.2)
        aims.append(np.zeros(2))
