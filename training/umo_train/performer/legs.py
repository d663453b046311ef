"""Lower body: sway, weight shifts and small steps; legs are solved so that planted feet stay in place."""

from dataclasses import dataclass

import numpy as np

from umo_train.performer.curves import bumps, drift, ease, hold_steps
from umo_train.performer.prosody import Prosody
from umo_train.performer.rotation import about, euler, frame, two_bones
from umo_train.performer.style import Style
from umo_train.skeleton import JOINT, OFFSETS_M, STANDING_HEIGHT_M

_HIPS = OFFSETS_M[[JOINT["left_hip"], JOINT["right_hip"]]]
_THIGH, _SHIN = OFFSETS_M[JOINT["left_knee"]], OFFSETS_M[JOINT["left_ankle"]]
_THIGH_M, _SHIN_M = float(np.linalg.norm(_THIGH)), float(np.linalg.norm(_SHIN))
_SIDES = np.array([1.0, -1.0])
_ANKLE_M = 0.08
# Distance below the height of straight legs.
_EASE_M = 0.007
# A leg reaches its foot exactly up to this share of its length, so the pelvis stays within it.
_SOFT = 0.997


@dataclass(frozen=True)
class Stance:
    """Poses of pelvis and feet at each frame."""

    place: np.ndarray  # [T, 3] of the pelvis, y its height
    hips: np.ndarray  # [T, 3] pitch, yaw, roll of the pelvis
    ankles: np.ndarray  # [2, T, 3]
    heading: np.ndarray  # [2, T] yaw of the feet
    tread: np.ndarray  # [2, T] pitch of the feet, toes down
    contact: np.ndarray  # [2, T]


def stance(prosody: Prosody, style: Style, trunk: np.ndarray, random: np.random.Generator) -> Stance:
    """Stands on both feet with shifting weight; sometimes a foot is repositioned. The pelvis follows the rotation of
    the trunk (pitch, yaw and roll `[T, 3]`)."""
    t = prosody.t
    seconds = len(t) / 30.0
    energy, openness = style.energy, style.openness
    apart = 0.08 + 0.09 * openness + random.uniform(-0.008, 0.008)
    turned = _SIDES * (0.08 + 0.16 * openness + random.normal(0.0, 0.03, 2))
    home = np.stack([_SIDES * apart, np.full(2, _ANKLE_M), random.normal(0.0, 0.03, 2)], -1)

    # Weight: -1 right foot .. 1 left foot.
    times, weights = [-2.0], [random.choice((-1.0, 1.0)) * random.uniform(0.0, 0.8)]
    while times[-1] < seconds:
        times.append(times[-1] + random.uniform(1.7, 4.6) / (0.7 + 0.6 * energy))
        weights.append(-np.sign(weights[-1]) * random.uniform(0.1, 1.0))
    weight = hold_steps(
        t, np.array(times), np.array(weights)[:, None], random.uniform(0.9, 1.3, len(times)) - 0.25 * energy
    )[:, 0]

    ankles = np.repeat(home[:, None], len(t), 1)
    heading = np.repeat(turned[:, None], len(t), 1)
    contact = np.ones((2, len(t)))
    tread = np.zeros((2, len(t)))
    _step(t, times, weights, home, ankles, heading, contact, tread, energy, random)

    wander = drift(random, t, 0.06, 0.3, 3)
    place = np.zeros((len(t), 3))
    middle = ankles.mean(axis=0)
    place[:, 0] = middle[:, 0] + 0.5 * apart * weight * (0.6 + 0.4 * energy) + 0.005 * wander[:, 0]
    place[:, 2] = middle[:, 2] + 0.03 + 0.006 * wander[:, 1]
    hips = np.zeros((len(t), 3))
    # The weight-bearing side is higher.
    hips[:, 2] = 0.1 * weight
    hips[:, 1] = -0.08 * weight + 0.02 * wander[:, 2] + 0.65 * trunk[:, 1] + 0.5 * heading.mean(axis=0)
    hips[:, 0] = 0.015 * wander[:, 0] + 0.2 * trunk[:, 0]
    bob = _bob(prosody, style, random)
    straight = STANDING_HEIGHT_M - _EASE_M - 0.008 * energy - bob
    # A smooth minimum of the two.
    blend = 0.002
    place[:, 1] = -blend * np.logaddexp(-straight / blend, -_reachable(place, hips, ankles) / blend)
    return Stance(place, hips, ankles, heading, tread, contact)


def _bob(prosody: Prosody, style: Style, random: np.random.Generator) -> np.ndarray:
    """Bending of the knees at accents, in metres: only for lively styles."""
    accents = prosody.accents
    size = 0.016 * max(0.0, style.energy - 0.3) * random.random(len(accents)) * prosody.weights
    return bumps(prosody.t, accents, 0.22, 0.4) @ size


def _reachable(place: np.ndarray, hips: np.ndarray, ankles: np.ndarray) -> np.ndarray:
    """The greatest pelvis height for which both ankles are within the legs' reach."""
    sockets = (euler(hips)[None] @ _HIPS[:, None, :, None])[..., 0]
    flat = (place + sockets - ankles)[..., [0, 2]]
    reach = _SOFT * 0.999 * (_THIGH_M + _SHIN_M)
    limit = ankles[..., 1] - sockets[..., 1] + np.sqrt(reach**2 - np.einsum("...i,...i->...", flat, flat))
    # A lifted foot does not bear weight.
    return limit.min(axis=0)


def _step(
    t: np.ndarray, times: list[float], weights: list[float], home: np.ndarray, ankles: np.ndarray, heading: np.ndarray,
    contact: np.ndarray, tread: np.ndarray, energy: float, random: np.random.Generator,
) -> None:  # fmt: skip
    """While the weight (`weights` from `times` on) rests on one foot, the other may be repositioned near its home:
    written into `ankles`, `heading`, `contact` and `tread`."""
    at, turned = home.copy(), heading[:, 0].copy() if len(t) else np.zeros(2)
    straight = turned.copy()
    for k in range(1, len(times) - 1):
        if random.random() > 0.3 + 0.3 * energy or abs(weights[k]) < 0.45:
            continue
        foot = 1 if weights[k] > 0.0 else 0
        start = times[k] + random.uniform(0.75, 0.95)
        length = random.uniform(0.4, 0.55)
        if start + length + 0.1 > times[k + 1]:
            continue
        target = home[foot] + np.clip(random.normal(0.0, 1.0, 3), -1.6, 1.6) * np.array([0.022, 0.0, 0.045])
        aim = straight[foot] + random.normal(0.0, 0.07)
        s = (t - start) / length
        moving = (s > 0.0) & (s < 1.0)
        ankles[foot] += ease(s)[:, None] * (target - at[foot])
        heading[foot] += ease(s) * (aim - turned[foot])
        lift = (4.0 * np.clip(s, 0.0, 1.0) * (1.0 - np.clip(s, 0.0, 1.0))) ** 2
        ankles[foot, :, 1] += 0.035 * lift
        tread[foot] += 0.12 * lift
        contact[foot][moving] = 0.0
        at[foot], turned[foot] = target, aim


def solve(stance: Stance) -> dict[str, np.ndarray]:
    """Local rotations of pelvis, hips, knees, ankles and feet, `[T, 3, 3]` each."""
    pelvis = euler(stance.hips)
    sockets = stance.place + (pelvis[None] @ _HIPS[:, None, :, None])[..., 0]
    forward = about("y", stance.heading)
    pole = forward[..., :, 2]
    mirror = np.array([[1.0, 1.0, 1.0], [-1.0, 1.0, 1.0]])
    first, second, hinge = two_bones(stance.ankles - sockets, pole, _THIGH_M, _SHIN_M, soft=_SOFT)
    foot = forward @ about("x", stance.tread)
    out = {"pelvis": pelvis}
    axis = np.array([1.0, 0.0, 0.0])
    for k, side in enumerate(("left", "right")):
        thigh = frame(first[k], hinge[k]) @ frame(_THIGH * mirror[k], axis).T
        shin = frame(second[k], hinge[k]) @ frame(_SHIN * mirror[k], axis).T
        out[side + "_hip"] = np.swapaxes(pelvis, -1, -2) @ thigh
        out[side + "_knee"] = np.swapaxes(thigh, -1, -2) @ shin
        out[side + "_ankle"] = np.swapaxes(shin, -1, -2) @ foot[k]
        out[side + "_foot"] = about("x", -stance.tread[k])
    return out
