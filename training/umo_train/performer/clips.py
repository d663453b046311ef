"""Transfers whole-body clips of other skeletons to the project's own: rotations of 55 joints and the root's path."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation, Slerp

from umo_train.performer import captures
from umo_train.skeleton import CONTACT_JOINTS, JOINT, JOINT_NAMES, OFFSETS_M, PARENTS, STANDING_HEIGHT_M, places
from umo_train.speech.utterance import FRAME_RATE

# Names of the nodes that correspond to our joints, in the two supported conventions; `{s}` is the side.
_FINGERS = ("index", "middle", "pinky", "ring", "thumb")
_UNREAL = {
    "pelvis": "pelvis", "spine1": "spine_01", "spine2": "spine_02", "spine3": "spine_03", "neck": "neck_01",
    "head": "head", "collar": "clavicle_{s}", "shoulder": "upperarm_{s}", "elbow": "lowerarm_{s}", "wrist": "hand_{s}",
    "hip": "thigh_{s}", "knee": "calf_{s}", "ankle": "foot_{s}", "foot": "ball_{s}", "finger": "{f}_0{k}_{s}",
}  # fmt: skip
_RIGIFY = {
    "pelvis": "DEF-hips", "spine1": "DEF-spine.001", "spine2": "DEF-spine.002", "spine3": "DEF-spine.003",
    "neck": "DEF-neck", "head": "DEF-head", "collar": "DEF-shoulder.{S}", "shoulder": "DEF-upper_arm.{S}",
    "elbow": "DEF-forearm.{S}", "wrist": "DEF-hand.{S}", "hip": "DEF-thigh.{S}", "knee": "DEF-shin.{S}",
    "ankle": "DEF-foot.{S}", "foot": "DEF-toe.{S}", "finger": "DEF-f_{f}.0{k}.{S}",
}  # fmt: skip
# The joint that a bone leads to, for bones whose rest directions differ between skeletons.
_LEADS = {"shoulder": "elbow", "elbow": "wrist", "wrist": "middle1", "hip": "knee", "knee": "ankle", "ankle": "foot"}
# Height of a standing foot's joints above the floor: ankle, ball.
_ANKLE_M, _BALL_M = 0.08, 0.02


@dataclass(frozen=True)
class Clip:
    """Rotations of all joints relative to their parents `[T, 55, 3, 3]` at 30 frames a second."""

    name: str
    local: np.ndarray


def read(path: Path) -> list[Clip]:
    """All animations of a glTF file. Raises `ValueError` if it is not one or its joints are unknown."""
    return [_retargeted(clip, path) for clip in captures.clips(path)]


def _retargeted(clip: captures.Clip, path: Path) -> Clip:
    node = _nodes(clip, path)
    t = np.arange(0, len(clip.local), captures.RATE // FRAME_RATE)
    turned, _ = captures.world(clip.local[t], clip.offsets[t], clip.parents)
    rest, at = captures.world(clip.rest_local[None], clip.rest_offsets[None], clip.parents)
    rest, at = rest[0], at[0]
    out = np.empty((len(t), len(JOINT_NAMES), 3, 3))
    local = np.tile(np.eye(3), (len(t), len(JOINT_NAMES), 1, 1))
    for joint, name in enumerate(JOINT_NAMES):
        parent = PARENTS[joint]
        if joint not in node:
            out[:, joint] = out[:, parent]
            continue
        # Rotated in the world like the other skeleton's bone, starting from its rest direction.
        out[:, joint] = turned[:, node[joint]] @ rest[node[joint]].T @ _between(joint, name, node, at)
        local[:, joint] = out[:, joint] if parent < 0 else np.swapaxes(out[:, parent], -1, -2) @ out[:, joint]
    return Clip(clip.name, local)


def _nodes(clip: captures.Clip, path: Path) -> dict[int, int]:
    """The other skeleton's node for each of our joints."""
    for names in (_UNREAL, _RIGIFY):
        out = {}
        for joint, name in enumerate(JOINT_NAMES):
            theirs = _their_name(name, names)
            if theirs in clip.nodes:
                out[joint] = clip.nodes.index(theirs)
        if {JOINT[name] for name in ("pelvis", "head", "left_wrist", "right_wrist", "left_ankle")} <= set(out):
            return out
    raise ValueError(f"{path}: joints are named neither as Unreal's mannequin nor as Rigify's skeleton")


def _their_name(name: str, names: dict[str, str]) -> str:
    if "_" not in name:
        return names.get(name, "")
    side, _, what = name.partition("_")
    finger = next((f for f in _FINGERS if what.startswith(f)), None)
    form = names["finger"] if finger else names.get(what, "")
    if finger == "thumb":
        form = form.replace("f_", "")
    return form.format(s=side[0], S=side[0].upper(), f=finger, k=what[-1])


def _between(joint: int, name: str, node: dict[int, int], at: np.ndarray) -> np.ndarray:
    """The rotation from our bone's rest direction to theirs."""
    side, _, what = name.partition("_")
    finger = any(what.startswith(f) for f in _FINGERS)
    if finger:
        child = joint + 1 if what[-1] in "12" else joint
    elif what in _LEADS:
        child = JOINT[f"{side}_{_LEADS[what]}"]
    else:
        return np.eye(3)
    if child not in node or (finger and what[-1] == "3"):
        # The last bone of a finger points like the one before it.
        before = JOINT[name[:-1] + "2"]
        return _between(before, JOINT_NAMES[before], node, at) if finger and before in node else np.eye(3)
    ours, theirs = OFFSETS_M[child], at[node[child]] - at[node[joint]]
    return Rotation.align_vectors(_framed(theirs), _framed(ours))[0].as_matrix()


def _framed(direction: np.ndarray) -> np.ndarray:
    """A direction with the perpendicular nearest to the forward axis: no rotation about the bone."""
    along = direction / np.linalg.norm(direction)
    other = np.array([0.0, 0.0, 1.0]) if abs(along[2]) < 0.9 else np.array([0.0, 1.0, 0.0])
    other = other - other @ along * along
    return np.stack([along, other / np.linalg.norm(other)])


def mirrored(local: np.ndarray) -> np.ndarray:
    """Left and right exchanged."""
    swap = [JOINT.get(_other(name), joint) for joint, name in enumerate(JOINT_NAMES)]
    sign = np.array([[1.0, -1.0, -1.0], [-1.0, 1.0, 1.0], [-1.0, 1.0, 1.0]])
    return local[:, swap] * sign


def _other(name: str) -> str:
    if name.startswith("left_"):
        return "right_" + name[5:]
    return "left_" + name[6:] if name.startswith("right_") else name


def resampled(local: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """Resampled at times in frames `[T]`."""
    frames = np.clip(frames, 0, len(local) - 1)
    out = np.empty((len(frames), *local.shape[1:]))
    for joint in range(local.shape[1]):
        out[:, joint] = Slerp(np.arange(len(local)), Rotation.from_matrix(local[:, joint]))(frames).as_matrix()
    return out


def blended(one: np.ndarray, other: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Rotations between `one` and `other`, at `share` `[T]` of the way."""
    turn = Rotation.from_matrix((np.swapaxes(one, -1, -2) @ other).reshape(-1, 3, 3)).as_rotvec()
    turn = turn.reshape(*one.shape[:2], 3) * share[:, None, None]
    return one @ Rotation.from_rotvec(turn.reshape(-1, 3)).as_matrix().reshape(one.shape)


def standing(local: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position of the pelvis `[T, 3]` for which the lower foot is on the floor and standing feet stay in place, and the
    contact of `CONTACT_JOINTS` `[T, 4]`."""
    at = places(local, np.zeros((len(local), 3)))
    ankles, balls = at[:, [JOINT["left_ankle"], JOINT["right_ankle"]]], at[:, [JOINT["left_foot"], JOINT["right_foot"]]]
    lowest = np.minimum(ankles[..., 1] - _ANKLE_M, balls[..., 1] - _BALL_M)
    place = np.zeros((len(local), 3))
    place[:, 1] = np.minimum(gaussian_filter1d(-lowest.min(1), 1.0), STANDING_HEIGHT_M)
    moved = np.diff(np.stack([ankles, balls], 2).mean(2)[..., [0, 2]], axis=0)
    # The lower foot bears the weight; of two on the floor, the one that moves less against the other.
    weight = np.exp(-(lowest - lowest.min(1, keepdims=True)) / 0.008)[1:]
    weight /= weight.sum(1, keepdims=True)
    way = -(moved * weight[..., None]).sum(1)
    place[1:, [0, 2]] = np.cumsum(gaussian_filter1d(way, 0.7, axis=0), axis=0)
    feet = (at + place[:, None])[:, CONTACT_JOINTS]
    speed = np.linalg.norm(np.gradient(feet, axis=0), axis=-1) * FRAME_RATE
    floor = np.array([_ANKLE_M, _BALL_M, _ANKLE_M, _BALL_M])
    contact = ((feet[..., 1] - floor < 0.025) & (speed < 0.12)).astype(float)
    return place, contact
