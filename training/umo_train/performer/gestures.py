"""Gestures of both arms: chosen at accents, timed so that a stroke ends on the stressed vowel."""

from dataclasses import dataclass

import numpy as np

from umo_train.performer.arm_track import ArmTrack
from umo_train.performer.arms import BEND, FINGERS, STATE, SWIVEL, TILT, TWIST, WRIST
from umo_train.performer.curves import drift, plateaus
from umo_train.performer.fingers import SHAPES
from umo_train.performer.prosody import Prosody
from umo_train.performer.style import Style
from umo_train.speech.utterance import FRAME_RATE

# What wrists can do, in radians.
LIMITS = {TWIST: (-1.5, 1.5), BEND: (-1.0, 1.1), TILT: (-0.35, 0.4)}
_COUNTING = ("point", "two", "three")


@dataclass(frozen=True)
class Gestures:
    """The arms' states `[2, T, STATE]`, left first, how far the shoulders are shrugged `[T]`, and the phases of both
    arms' gestures `[2, T]`."""

    states: np.ndarray
    shrug: np.ndarray
    phases: np.ndarray


def state(
    wrist: tuple[float, float, float], swivel=0.0, twist=0.3, bend=0.1, tilt=0.0, shape: str = "relaxed"
) -> np.ndarray:
    """One arm's state from readable values."""
    out = np.empty(STATE)
    out[WRIST], out[SWIVEL], out[TWIST], out[BEND], out[TILT] = wrist, swivel, twist, bend, tilt
    out[FINGERS] = SHAPES[shape]
    return out


def _rests(style: Style, random: np.random.Generator) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Each arm's idle state, and where it waits between gestures of a lively talker."""
    o = style.openness
    hang = state((0.215 + 0.11 * o, -0.478 + 0.02 * o, 0.05), swivel=0.5 * o, twist=0.35)
    idle = [hang.copy(), hang.copy()]
    folded = random.random() < 4.5 * (0.32 - o)
    if folded:
        over, under = random.permutation(2)
        idle[over] = state((0.085, -0.385, 0.215), twist=0.55, bend=0.0, shape="relaxed")
        idle[under] = state((0.095, -0.42, 0.19), twist=0.5, bend=0.05, shape="relaxed")
    for arm in idle:
        arm[WRIST] += random.normal(0.0, 0.006 if folded else 0.012, 3)
        arm[TWIST] += random.normal(0.0, 0.1)
        arm[FINGERS] *= random.uniform(0.8, 1.3)
    if random.random() < 4.0 * (style.gesture_rate - 0.6) and not folded:
        ready = [state((0.14 + 0.06 * o, -0.315, 0.23), twist=0.25, bend=0.0) for _ in range(2)]
        for arm in ready:
            arm[WRIST] += random.normal(0.0, 0.015, 3)
    else:
        ready = idle
    return idle, ready


def _poses(kind: str, style: Style, size: float, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray, float]:
    """Where a hand is before and after the stroke of a gesture, and how far its path bows outward."""
    o, side = style.openness, random.normal(0.0, 0.025)
    high = 0.03 * random.normal() + 0.05 * (style.energy - 0.5)
    out = 0.05 * random.normal() + 0.13 * (o - 0.4)
    bow = 0.0
    if kind == "beat":
        end = state((0.2 + out, -0.27 + high, 0.28), twist=random.uniform(0.1, 0.9), bend=0.15)
        start = end.copy()
        start[WRIST] += np.array([0.02, 0.13, -0.015]) * size
        start[BEND] -= 0.35
    elif kind == "pinch":
        end = state((0.17 + 0.7 * out, -0.2 + high, 0.33), twist=0.35, bend=0.05, shape="pinch")
        start = end.copy()
        start[WRIST] += np.array([0.0, 0.09, -0.05]) * size
        start[BEND] -= 0.3
    elif kind == "chop":
        end = state((0.16 + 0.6 * out, -0.29 + high, 0.33), twist=0.05, bend=0.0, tilt=-0.15, shape="flat")
        start = end.copy()
        start[WRIST] += np.array([0.02, 0.17, -0.05]) * size
        start[TILT] = 0.3
    elif kind == "fist":
        end = state((0.18 + 0.6 * out, -0.24 + high, 0.3), twist=0.2, bend=0.1, shape="fist")
        start = end.copy()
        start[WRIST] += np.array([0.03, 0.13, -0.05]) * size
    elif kind == "sweep":
        palm = random.choice((-0.9, 1.1))
        start = state((0.1 + side, -0.2 + high, 0.29), twist=0.4 * palm, bend=0.1, shape="open")
        end = state((0.3 + out + 0.12 * size, -0.24 + high, 0.27), swivel=0.2, twist=palm, bend=-0.15, shape="open")
    elif kind == "open":
        end = state((0.27 + out + 0.05 * size, -0.3 + high, 0.3), twist=-1.2, bend=-0.1, shape="open")
        start = state((0.16 + 0.5 * out, -0.2 + high, 0.24), twist=-0.3, bend=0.2)
        bow = 0.03
    elif kind == "frame":
        end = state((0.13 + 0.7 * out, -0.25 + high, 0.31), twist=0.05, bend=0.1, shape="open")
        start = end.copy()
        start[WRIST] += np.array([-0.03, 0.11, -0.03]) * size
    elif kind == "point":
        end = state((0.2 + out, -0.16 + high, 0.38 + 0.05 * size), twist=0.8, bend=0.0, shape="point")
        start = state((0.24 + out, -0.08 + high, 0.22), twist=0.3, bend=-0.2, shape="point")
    elif kind == "count":
        end = state((0.22 + 0.6 * out, -0.1 + high, 0.28), twist=0.7, bend=-0.1, shape="point")
        start = end.copy()
        start[WRIST] += np.array([0.01, 0.08, -0.06]) * size
        start[BEND] -= 0.25
    elif kind == "shrug":
        end = state((0.33 + out, -0.27 + high, 0.2), swivel=-0.1, twist=-1.3, bend=-0.35, shape="open")
        start = state((0.24 + out, -0.35, 0.2), twist=-0.4, bend=0.1)
    else:
        raise KeyError(kind)
    # Not before the face.
    for pose in (start, end):
        pose[WRIST.start + 1] = min(pose[WRIST.start + 1], -0.05)
    return start, end, bow


def _kind(style: Style, random: np.random.Generator) -> str:
    stern = max(0.0, 0.5 - style.mood) * 2.0
    weights = {
        "beat": 1.0,
        "pinch": 0.5,
        "chop": 0.2 + 1.2 * stern,
        "fist": 0.05 + 0.5 * stern + 0.15 * max(0.0, style.energy - 0.6),
        "sweep": 0.2 + 0.9 * style.openness,
        "open": 0.15 + 1.3 * style.openness,
        "frame": 0.3 + 0.5 * style.openness,
        "point": 0.1 + 0.4 * style.energy + 0.5 * stern,
        "count": 0.05 + 0.4 * max(0.0, style.gesture_rate - 0.4),
        "shrug": 0.3 * style.openness * style.mood + 0.04,
    }
    share = np.cumsum(list(weights.values()))
    return list(weights)[int(np.searchsorted(share, random.random() * share[-1]))]


def gesticulate(prosody: Prosody, style: Style, random: np.random.Generator) -> Gestures:
    """Walks the accents: a gesture, a beat of hands that are up, or nothing."""
    t, energy = prosody.t, style.energy
    idle, ready = _rests(style, random)
    tracks = [ArmTrack(idle[k], ready[k], 1.2 - 0.4 * energy, 0.24 - 0.07 * energy) for k in (0, 1)]
    leading = int(random.random() < 0.75)
    rate = 0.08 + 0.72 * style.gesture_rate
    both = 0.15 + 0.35 * style.openness + 0.15 * energy
    phrase = np.searchsorted(prosody.phrases[:, 0], prosody.accents, side="right")
    shrugs: list[float] = []
    counted, last, before, repeats = 0, -9.0, -1, [0, 0]
    if len(prosody.phrases):
        for track in tracks:
            track.rise(float(prosody.phrases[0, 0]) - random.uniform(0.1, 0.4))
    for at, weight, where in zip(prosody.accents, prosody.weights, phrase, strict=True):
        amount = (0.45 + 0.75 * energy) * min(random.uniform(0.75, 1.2) * weight, 1.3)
        counting = 0 < counted < 3 and at - last < 1.4
        done = ()
        if counting or random.random() < rate:
            kind = "count" if counting else _kind(style, random)
            counted = (counted + 1 if counting else 1) if kind == "count" else 0
            # A frame and a shrug take both hands, a count or a point one.
            pair = kind in ("frame", "shrug") or (kind not in ("count", "point") and random.random() < both)
            one = leading if random.random() < 0.8 or kind == "count" else 1 - leading
            start, end, bow = _poses(kind, style, amount, random)
            if kind == "count":
                start[FINGERS] = end[FINGERS] = SHAPES[_COUNTING[counted - 1]]
            done = _strike(tracks, (one, 1 - one) if pair else (one,), at, start, end, amount, bow, random)
            for hand in done:
                repeats[hand] = 0
            if kind == "shrug" and done:
                shrugs.append(at)
        if not done and where == before and random.random() < 0.4 + 0.5 * energy:
            for hand, track in enumerate(tracks):
                if track.raised and at - track.until < 1.5 and repeats[hand] < 2:
                    repeats[hand] += 1
                    done += _strike(tracks, (hand,), at, *_again(track.now, 0.6 * amount, random), amount, 0.0, random)
        elif done and len(done) == 1 and random.random() < 0.5:
            # A hand that has no part goes down.
            tracks[1 - done[0]].retract(0.15, (ready if random.random() < 0.5 else idle)[1 - done[0]])
        if done:
            last = at
        before = where
    for hand, track in enumerate(tracks):
        track.retract(random.uniform(0.3, 0.6), idle[hand])
        if track.now is not idle[hand]:
            track.raised = True
            track.retract(1.2, idle[hand])
    phases = np.stack([track.phase(t) for track in tracks])
    return Gestures(_alive(tracks, t, random), _shrug(t, shrugs, energy), phases)


def _strike(
    tracks: list[ArmTrack], hands: tuple[int, ...], at: float, start: np.ndarray, end: np.ndarray,
    amount: float, bow: float, random: np.random.Generator,
) -> tuple[int, ...]:  # fmt: skip
    """The hands that had the time for it."""
    late = random.uniform(0.08, 0.25) if random.random() < 0.2 else 0.0
    swing = np.array([random.normal(0.0, 0.12), random.normal(0.0, 0.08), random.uniform(0.25, 0.5)]) * amount
    done = []
    for hand in hands:
        a, b = start.copy(), end.copy()
        if done:
            # The second hand is never quite the first's mirror image.
            shift = random.normal(0.0, 0.012, 3)
            a[WRIST] += shift
            b[WRIST] += shift
        if tracks[hand].fits(at, a, b):
            tracks[hand].gesture(at, a, b, late, swing, bow)
            done.append(hand)
    return tuple(done)


def _again(now: np.ndarray, amount: float, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A small beat where the hand is."""
    up, down = now.copy(), now.copy()
    up[WRIST] += np.array([0.01, 0.1, -0.02]) * amount
    up[WRIST.start + 1] = min(up[WRIST.start + 1], -0.04)
    up[BEND] -= 0.25
    down[WRIST] += random.normal(0.0, 0.012, 3)
    return up, down


def _shrug(t: np.ndarray, times: list[float], energy: float) -> np.ndarray:
    times = np.array(times)
    return (0.6 + 0.4 * energy) * plateaus(t, times, times + 0.25, 0.26, 0.5)


def _alive(tracks: list[ArmTrack], t: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """The tracks' states with what nobody can keep still, and hands that trail behind their arms."""
    out = np.stack([track.curve(t) for track in tracks])
    wander = drift(random, t, 0.08, 0.4, 6).T.reshape(2, 3, len(t)).swapaxes(1, 2)
    out[..., WRIST] += 0.004 * wander
    out[..., FINGERS] += 0.025 * drift(random, t, 0.05, 0.3, 14).T.reshape(2, 7, len(t)).swapaxes(1, 2)
    if len(t) > 2:
        rising = np.gradient(out[..., 1], axis=1) * FRAME_RATE
        out[..., BEND] += 0.3 * np.tanh(0.45 * rising)
    for channel, (low, high) in LIMITS.items():
        middle, half = (low + high) / 2.0, (high - low) / 2.0
        out[..., channel] = middle + half * np.tanh(np.arctanh(0.98) * (out[..., channel] - middle) / half)
    out[..., FINGERS] = np.clip(out[..., FINGERS], 0.0, 1.05)
    return out
