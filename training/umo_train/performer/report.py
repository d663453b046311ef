"""Statistics of a performance's motion quality, for comparison with people's."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import argrelmin, find_peaks
from scipy.spatial.transform import Rotation

from umo_train.performer.prosody import Prosody
from umo_train.skeleton import CONTACT, CONTACT_JOINTS, JOINT, JOINTS_OF, PARENTS, SHAPE, VELOCITY, places, rotations
from umo_train.speech.utterance import FRAME_RATE

# Time shifts in seconds for the reference value of accent alignment.
_SHIFTS_S = (0.43, 0.71, 1.13, 1.57, 2.03, 2.69)
_BEAT_SIGMA_S = 0.1
# Speed below which wrists are still, and above which (`_MOVING`) they gesture, in m/s.
_STILL, _MOVING = 0.04, 0.25
_GROUPS = {
    "pelvis": ("pelvis",),
    "spine": ("spine1", "spine2", "spine3"),
    "collar": ("left_collar", "right_collar"),
    "shoulder": ("left_shoulder", "right_shoulder"),
    "elbow": ("left_elbow", "right_elbow"),
    "wrist": ("left_wrist", "right_wrist"),
    "hip": ("left_hip", "right_hip"),
    "knee": ("left_knee", "right_knee"),
}


@dataclass(frozen=True)
class Take:
    """Motion with its speaker's utterance."""

    motion: dict[str, np.ndarray]
    prosody: Prosody


def world_places(motion: dict[str, np.ndarray]) -> np.ndarray:
    """World positions of all joints `[T, 55, 3]`, m."""
    at = np.zeros((len(motion["height"]), 3))
    at[1:] = np.cumsum(motion["lower"][:-1, VELOCITY].astype(np.float64), axis=0) / FRAME_RATE
    at[:, 1] = motion["height"]
    return places(rotations(motion), at)


def world_rotation(local: np.ndarray, joint: int) -> np.ndarray:
    """World rotation of a joint `[T, 3, 3]`."""
    out = local[:, joint]
    while (joint := PARENTS[joint]) >= 0:
        out = local[:, joint] @ out
    return out


def head_angles(motion: dict[str, np.ndarray]) -> np.ndarray:
    """The head's yaw, pitch and roll about its mean, in the world `[T, 3]`, degrees."""
    turned = Rotation.from_matrix(world_rotation(rotations(motion), JOINT["head"]))
    return (turned.mean().inv() * turned).as_euler("YXZ", degrees=True)


def wrist_paths(motion: dict[str, np.ndarray]) -> np.ndarray:
    """Both wrists in the pelvis' frame, smoothed by a frame `[2, T, 3]`, m, left first."""
    local = rotations(motion)
    at = places(local, np.zeros((len(local), 3)))[:, [JOINT["left_wrist"], JOINT["right_wrist"]]]
    at = np.einsum("tji,twj->wti", local[:, JOINT["pelvis"]], at)
    return gaussian_filter1d(at, 1.0, axis=1)


def jerk(at: np.ndarray) -> np.ndarray:
    """Magnitude of the third derivative of positions `[T, ..., 3]`, m/s^3."""
    return np.linalg.norm(np.diff(at, n=3, axis=0), axis=-1) * FRAME_RATE**3


def runs(flags: np.ndarray) -> np.ndarray:
    """First and one past the last index of each run of true `[n, 2]`."""
    return np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8))).reshape(-1, 2)


def alignment(events: np.ndarray, turns: np.ndarray, seconds: float) -> float | None:
    """Proximity of turning points to events, relative to shifted events; None without any."""
    if not len(events) or not len(turns):
        return None

    def closeness(at: np.ndarray) -> float:
        nearest = np.abs(np.subtract.outer(at, turns)).min(axis=1)
        return float(np.exp(-(nearest**2) / (2.0 * _BEAT_SIGMA_S**2)).mean())

    return closeness(events) / float(np.mean([closeness((events + shift) % seconds) for shift in _SHIFTS_S]))


def measure(takes: Sequence[Take]) -> dict[str, float]:
    """The numbers over all takes: means of each take's, or percentiles over all frames."""
    rows = [_body(take) | _face(take) for take in takes]
    out = {name: float(np.mean([row[name] for row in rows if row[name] is not None])) for name in rows[0]}
    return out | _pooled(takes)


def _body(take: Take) -> dict[str, float | None]:
    motion, prosody = take.motion, take.prosody
    local, minutes = rotations(motion), len(motion["height"]) / FRAME_RATE / 60.0
    out: dict[str, float | None] = {}
    angles = head_angles(motion)
    for name, value in zip(("yaw", "pitch", "roll"), angles.std(axis=0), strict=True):
        out[f"head {name} sd, deg"] = value
    head = world_rotation(local, JOINT["head"])
    turning = Rotation.from_matrix(np.swapaxes(head[:-1], -1, -2) @ head[1:]).magnitude()
    out["head below 5 deg/s"] = float((gaussian_filter1d(np.degrees(turning) * FRAME_RATE, 1.0) < 5.0).mean())
    wrists = wrist_paths(motion)
    speed = np.linalg.norm(np.gradient(wrists, axis=1), axis=-1) * FRAME_RATE
    fastest = speed.max(axis=0)
    out["both hands still"] = float((fastest < _STILL).mean())
    out["path of both wrists, m/min"] = speed.sum() / FRAME_RATE / minutes
    found = runs(np.convolve(fastest > _MOVING, np.ones(9), "same") > 0)
    out["gesture phrases a minute"] = len(found) / minutes
    out["strokes a minute"] = sum(len(_stroke_peaks(v)) for v in speed) / minutes
    for group, names in _GROUPS.items():
        out[f"{group} rms, deg"] = float(np.mean([_spread(local[:, JOINT[name]]) for name in names]))
    root = gaussian_filter1d(world_places(motion)[:, 0, 0], 5.0)
    out["weight shifts a minute"] = sum(len(find_peaks(s * root, prominence=0.02)[0]) for s in (1, -1)) / minutes
    at = places(local, np.zeros((len(local), 3)))[:, JOINTS_OF["upper"]]
    turns = argrelmin(np.linalg.norm(np.gradient(at, axis=0), axis=-1).mean(axis=1), order=7)[0] / FRAME_RATE
    seconds = 60.0 * minutes
    out["body's turns on accents, own / shifted"] = alignment(prosody.accents, turns, seconds)
    nods = find_peaks(gaussian_filter1d(angles[:, 1], 1.0), distance=5)[0] / FRAME_RATE
    out["nods on accents, own / shifted"] = alignment(prosody.accents, nods, seconds)
    return out


def _stroke_peaks(speed: np.ndarray) -> np.ndarray:
    return find_peaks(speed, height=0.35, prominence=0.2, distance=5)[0]


def _spread(local: np.ndarray) -> float:
    """Root mean square of the deviation from the mean rotation, degrees."""
    turned = Rotation.from_matrix(local)
    return float(np.degrees(np.sqrt(np.mean((turned.mean().inv() * turned).magnitude() ** 2))))


def _face(take: Take) -> dict[str, float | None]:
    face, t = take.motion["face"][:, 6:].astype(np.float64), take.prosody.t
    minutes = len(t) / FRAME_RATE / 60.0
    lids = face[:, SHAPE["eyeBlinkLeft"]]
    out: dict[str, float | None] = {"blinks a minute": len(find_peaks(lids, height=0.6, distance=6)[0]) / minutes}
    across = 30.0 * (face[:, SHAPE["eyeLookOutLeft"]] - face[:, SHAPE["eyeLookInLeft"]])
    up = 30.0 * (face[:, SHAPE["eyeLookUpLeft"]] - face[:, SHAPE["eyeLookDownLeft"]])
    shift = np.sqrt(np.diff(across) ** 2 + np.diff(up) ** 2) * FRAME_RATE
    out["gaze shifts a minute"] = len(find_peaks(shift, height=60.0, distance=4)[0]) / minutes
    jaw = face[:, SHAPE["jawOpen"]]
    out["jawOpen sd"] = float(jaw.std())
    for name in ("mouthLowerDown", "mouthUpperUp", "mouthSmile", "mouthStretch"):
        out[f"{name} sd"] = float(face[:, SHAPE[name + "Left"]].std())
    for name in ("mouthShrugUpper", "mouthFunnel", "mouthPucker"):
        out[f"{name} sd"] = float(face[:, SHAPE[name]].std())
    speech = np.zeros(len(t), bool)
    for start, end in take.prosody.phrases:
        speech |= (t >= start - 0.1) & (t <= end + 0.1)
    speed = np.abs(np.gradient(jaw))
    out["jaw speed in pauses over speech"] = (
        float(speed[~speech].mean() / speed[speech].mean()) if speech.any() else None
    )
    pairs = [
        (face[:, SHAPE[n]], face[:, SHAPE[n[:-4] + "Right"]])
        for n in SHAPE
        if n.endswith("Left") and n.startswith(("mouth", "brow", "cheek", "nose")) and n != "mouthLeft"
    ]
    out["left against right, share of range"] = float(
        np.mean([np.abs(a - b).max() / max(np.ptp(a), np.ptp(b)) for a, b in pairs if max(np.ptp(a), np.ptp(b)) > 0.02])
    )
    return out


def _pooled(takes: Sequence[Take]) -> dict[str, float]:
    phrases, peaks, wrist_jerk, head_jerk, slide = [], [], [], [], []
    for take in takes:
        wrists = wrist_paths(take.motion)
        speed = np.linalg.norm(np.gradient(wrists, axis=1), axis=-1) * FRAME_RATE
        moving = np.convolve(speed.max(axis=0) > _MOVING, np.ones(9), "same") > 0
        phrases.append(np.diff(runs(moving), axis=1)[:, 0] / FRAME_RATE)
        peaks += [v[_stroke_peaks(v)] for v in speed]
        at = places(rotations(take.motion), np.zeros((len(take.motion["height"]), 3)))
        wrist_jerk.append(jerk(at[:, [JOINT["left_wrist"], JOINT["right_wrist"]]]).max(axis=1))
        head_jerk.append(jerk(at[:, JOINT["head"]]))
        feet = world_places(take.motion)[:, CONTACT_JOINTS]
        planted = take.motion["lower"][:, CONTACT] > 0.5
        moved = np.linalg.norm(np.diff(feet[..., [0, 2]], axis=0), axis=-1) * FRAME_RATE * 100.0
        slide.append(moved[planted[1:] & planted[:-1]])
    # A mere listener makes none.
    lengths, fastest = np.concatenate(phrases), np.concatenate(peaks)
    out = {"gesture phrase, median s": float(np.median(lengths)) if len(lengths) else 0.0}
    for share in (5, 50, 95):
        out[f"stroke peak {share} %, m/s"] = float(np.percentile(fastest, share)) if len(fastest) else 0.0
    for share in (50, 95):
        out[f"wrist jerk {share} %, m/s3"] = float(np.percentile(np.concatenate(wrist_jerk), share))
    out["head jerk 95 %, m/s3"] = float(np.percentile(np.concatenate(head_jerk), 95))
    out["planted feet's slide 95 %, cm/s"] = float(np.percentile(np.concatenate(slide), 95))
    return out
