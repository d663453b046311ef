"""`.vrma`: VRM Animation 1.0, for any VRM avatar, as `umo animate` writes it.

Bones are in VRM's T-pose. The face is VRM's vowels and blinks; what it has no expression for is ARKit's shapes, and the eyes are the gaze.
"""

from __future__ import annotations

import json
import struct
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ._library import JOINT_COUNT, lib

if TYPE_CHECKING:
    from ._motion import Motion

Floats = npt.NDArray[np.float32]

JAW, EYES = 22, (23, 24)
# From the pelvis to the ball of the left foot, and how high that is above the floor.
LEG, SOLE = (1, 4, 7, 10), np.float32(0.02)
# Limbs that the T-pose has along an axis: a joint, the one at the bone's end, and where that is.
LIMBS = (
    *((1, 4, (0, -1, 0)), (4, 7, (0, -1, 0)), (2, 5, (0, -1, 0)), (5, 8, (0, -1, 0))),
    *((16, 18, (1, 0, 0)), (18, 20, (1, 0, 0)), (20, 28, (1, 0, 0))),
    *((17, 19, (-1, 0, 0)), (19, 21, (-1, 0, 0)), (21, 43, (-1, 0, 0))),
)
FINGERS = tuple(
    f"{finger}{part}"
    for finger in ("Index", "Middle", "Little", "Ring")
    for part in ("Proximal", "Intermediate", "Distal")
) + ("ThumbMetacarpal", "ThumbProximal", "ThumbDistal")
# The bones of VRM's humanoid, in the order of the joints.
BONES = (
    *("hips", "leftUpperLeg", "rightUpperLeg", "spine", "leftLowerLeg", "rightLowerLeg", "chest", "leftFoot", "rightFoot"),
    *("upperChest", "leftToes", "rightToes", "neck", "leftShoulder", "rightShoulder", "head", "leftUpperArm", "rightUpperArm"),
    *("leftLowerArm", "rightLowerArm", "leftHand", "rightHand", "jaw", "leftEye", "rightEye"),
    *(f"left{finger}" for finger in FINGERS),
    *(f"right{finger}" for finger in FINGERS),
)
EXPRESSIONS = ("aa", "ih", "ou", "ee", "oh", "blinkLeft", "blinkRight")
# Channels that the expressions and the gaze say already: an avatar with both would open its mouth twice.
SAID = ("jaw", "mouth", "tongue", "eyeBlink", "eyeLook")
# How much of `jawOpen`, of `mouthFunnel` or `mouthPucker`, and of half of `mouthSmile` and `mouthStretch` makes a vowel open, round, wide.
OPEN, ROUND, WIDE = np.float32(0.7), np.float32(0.7), np.float32(0.5)


def vrma(motion: Motion) -> bytes:
    """The file's bytes."""
    from ._save import is_arkit

    if motion.skeleton is None:
        raise ValueError("vrma needs a skeleton, and a Motion that was not made by umo has none; save .npz or .csv")
    parents, offsets = motion.skeleton
    offsets, arkit = offsets.astype(np.float32), is_arkit(motion.names)
    file = _File(np.arange(len(motion), dtype=np.float32) / np.float32(motion.rate))
    file.nodes = _bones(parents, offsets)
    # With ARKit's channels the mouth opens by the vowels.
    bones = {name: joint for joint, name in enumerate(BONES) if joint not in EYES and not (joint == JAW and arkit)}
    tracks = _tracks(motion.rotations)
    for joint in sorted(bones.values()):
        file.moves(joint, "rotation", tracks[:, joint])
    file.moves(0, "translation", offsets[0] + motion.translation)
    roots, expressions = [0], {"preset": {}, "custom": {}}  # type: tuple[list[int], dict[str, dict[str, Any]]]
    if arkit:
        others = [name for name in motion.names if not name.startswith(SAID)]
        weights = _weights(motion)
        for kind, names in (("preset", EXPRESSIONS), ("custom", others)):
            for name in names:
                values = weights[name] if kind == "preset" else motion.channel(name)
                rows = np.zeros((len(motion), 3), np.float32)
                rows[:, 0] = values.clip(0, 1)
                roots.append(file.node(name))
                file.moves(roots[-1], "translation", rows)
                expressions[kind][name] = {"node": roots[-1]}
    gaze = file.node("gaze")
    file.moves(gaze, "rotation", _gaze(tracks))
    between: Floats = (offsets[EYES[0]] + offsets[EYES[1]]) * np.float32(0.5)
    extension: dict[str, Any] = {
        "specVersion": "1.0",
        "humanoid": {"humanBones": {name: {"node": joint} for name, joint in bones.items()}},
        "lookAt": {"node": gaze, "offsetFromHeadBone": between.astype(float).tolist()},
    }
    if arkit:
        extension["expressions"] = expressions
    return file.bytes([*roots, gaze], {"VRMC_vrm_animation": extension})


class _File:
    """A glTF file in the making, whose nodes move at the given times."""

    def __init__(self, times: Floats) -> None:
        self.nodes: list[dict[str, Any]] = []
        self._data, self._views, self._accessors = bytearray(), list[dict[str, Any]](), list[dict[str, Any]]()
        self._samplers, self._channels = list[dict[str, Any]](), list[dict[str, Any]]()
        self._values(times)
        self._accessors[0].update(min=[float(times.min())], max=[float(times.max())])

    def node(self, name: str) -> int:
        self.nodes.append({"name": name})
        return len(self.nodes) - 1

    def moves(self, node: int, what: str, values: Floats) -> None:
        """`values` are of each time."""
        sampler = {"input": 0, "interpolation": "LINEAR", "output": self._values(values)}
        self._channels.append({"sampler": len(self._samplers), "target": {"node": node, "path": what}})
        self._samplers.append(sampler)

    def _values(self, values: Floats) -> int:
        data = np.ascontiguousarray(values, "<f4").tobytes()
        self._views.append({"buffer": 0, "byteLength": len(data), "byteOffset": len(self._data)})
        self._data += data
        kind = "SCALAR" if values.ndim == 1 else f"VEC{values.shape[1]}"
        view = len(self._views) - 1
        self._accessors.append({"bufferView": view, "count": len(values), "componentType": 5126, "type": kind})
        return view

    def bytes(self, roots: list[int], extensions: dict[str, Any]) -> bytes:
        document = {
            "accessors": self._accessors,
            "animations": [{"channels": self._channels, "name": "speech", "samplers": self._samplers}],
            "asset": {"generator": f"umo {lib.umo_version().decode()}", "version": "2.0"},
            "buffers": [{"byteLength": len(self._data)}],
            "bufferViews": self._views,
            "scene": 0,
            "extensions": extensions,
            "extensionsUsed": list(extensions),
            "nodes": self.nodes,
            "scenes": [{"nodes": roots}],
        }
        text = json.dumps(document, ensure_ascii=False, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        size = 12 + 8 + len(text) + 8 + len(self._data)
        if size >= 1 << 32:
            raise ValueError("the animation is longer than a vrma file can be, 4 GiB")
        head = struct.pack("<4sII", b"glTF", 2, size) + struct.pack("<I4s", len(text), b"JSON")
        return head + text + struct.pack("<I4s", len(self._data), b"BIN\0") + bytes(self._data)


def _bones(parents: npt.NDArray[np.int32], offsets: Floats) -> list[dict[str, Any]]:
    """One node per joint, in the T-pose: what turns a limb along its axis is in the rest pose, so that rotations stay as they are."""
    world = np.zeros((JOINT_COUNT, 4), np.float32)
    world[:, 3] = 1
    for joint, end, axis in LIMBS:
        world[joint] = _shortest(offsets[end], np.array(axis, np.float32))
    nodes = []
    for joint, name in enumerate(BONES):
        offset, turn, parent = offsets[joint].copy(), world[joint], int(parents[joint])
        if parent < 0:
            height = np.float32(0)
            for part in LEG:
                height += offsets[part][1]
            offset[1] = SOLE - height
        else:
            turn = _product(world[parent] * np.array([-1, -1, -1, 1], np.float32), turn)
        below = [child for child in range(joint + 1, JOINT_COUNT) if parents[child] == joint]
        node: dict[str, Any] = {"children": below} if below else {}
        nodes.append({**node, "name": name, "rotation": _short(turn), "translation": _short(offset)})
    return nodes


def _short(values: Floats) -> list[float]:
    """The shortest decimals that are the same single floats."""
    return [float(np.format_float_positional(value, unique=True)) for value in values]


def _shortest(bone: Floats, axis: Floats) -> Floats:
    """The shortest turn of a bone to an axis, which is not its opposite."""
    (x, y, z), (a, b, c) = bone, axis
    length = np.sqrt(x * x + y * y + z * z)
    return _unit(np.array([y * c - z * b, z * a - x * c, x * b - y * a, length + (x * a + y * b + z * c)], np.float32))


def _product(first: Floats, second: Floats) -> Floats:
    (ax, ay, az, aw), (bx, by, bz, bw) = first.astype(float), second.astype(float)
    return _unit(
        np.array(
            [
                aw * bx + ax * bw + ay * bz - az * by,
                aw * by - ax * bz + ay * bw + az * bx,
                aw * bz + ax * by - ay * bx + az * bw,
                aw * bw - ax * bx - ay * by - az * bz,
            ]
        )
    )


def _unit(rotations: npt.NDArray[Any]) -> Floats:
    """Rotations of length 1 with `w >= 0`. Sums are in one order, so that every digit is that of the program `umo`."""
    x, y, z, w = np.moveaxis(rotations.astype(float), -1, 0)
    length = np.copysign(np.sqrt(x * x + y * y + z * z + w * w), np.where(w < 0, -1.0, 1.0))
    return np.stack([x / length, y / length, z / length, w / length + 0.0], -1).astype(np.float32)


def _tracks(rotations: Floats) -> Floats:
    """Rotations of exact length, each on the same side as the one before: not every program takes the shorter way."""
    x, y, z, w = np.moveaxis(rotations, -1, 0)
    lengths = np.sqrt(x * x + y * y + z * z + w * w)[..., None]
    before = np.zeros(rotations.shape[1:], np.float32)
    before[:, 3] = 1
    tracks = np.empty(rotations.shape, np.float32)
    for frame, each in enumerate(rotations):
        dot = each * before
        sign = np.where(dot[:, 0] + dot[:, 1] + dot[:, 2] + dot[:, 3] < 0, np.float32(-1), np.float32(1))
        before = tracks[frame] = each * sign[:, None] / lengths[frame]
    return tracks


def _gaze(tracks: Floats) -> Floats:
    """Where the eyes look, against the head: the middle of both."""
    left, right = tracks[:, EYES[0]], tracks[:, EYES[1]]
    dot = left * right
    is_far = dot[:, 0] + dot[:, 1] + dot[:, 2] + dot[:, 3] < 0
    return _unit(left + np.where(is_far[:, None], -right, right))


def _weights(motion: Motion) -> dict[str, Floats]:
    """VRM's expressions."""
    one, half = np.float32(1), np.float32(0.5)

    def share(values: Floats, full: np.float32) -> Floats:
        return (values / full).clip(0, 1)

    def of(name: str) -> Floats:
        return motion.channel(name)

    opened = share(of("jawOpen") - of("mouthClose"), OPEN)
    rounded = share(np.maximum(of("mouthFunnel"), of("mouthPucker")), ROUND)
    sides = of("mouthSmileLeft") + of("mouthSmileRight") + of("mouthStretchLeft") + of("mouthStretchRight")
    wide = share(half * sides, WIDE)
    # A closed mouth that smiles says nothing.
    apart = np.minimum(np.float32(4) * opened, one)
    return {
        "aa": opened * (one - rounded) * (one - wide),
        "ih": apart * (one - opened) * (one - rounded) * wide,
        "ou": (one - opened) * rounded,
        "ee": opened * (one - rounded) * wide,
        "oh": opened * rounded,
        "blinkLeft": of("eyeBlinkLeft"),
        "blinkRight": of("eyeBlinkRight"),
    }
