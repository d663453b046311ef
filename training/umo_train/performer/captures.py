"""Readers of published captured and animated motion: trajectories of both arms.

`cmu` reads the distributed arrays of the CMU Graphics Lab's captures (`expmap`, `parent`, `offset_mm`, `fps`); `gltf`
reads glTF 2.0 clips (`.gltf` with its `.bin`, or `.glb`).
"""

import json
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import interp1d
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation, Slerp

from umo_train.performer.arms import FORE_M, UPPER_M
from umo_train.performer.rotation import unit

RATE = 60
# Joints of pelvis, chest, shoulders, elbows and wrists (left first).
_CMU = (0, 15, 21, 30, 22, 31, 23, 32)
_GLTF = (
    ("DEF-hips", "DEF-spine.003", "DEF-upper_arm.L", "DEF-upper_arm.R", "DEF-forearm.L", "DEF-forearm.R",
     "DEF-hand.L", "DEF-hand.R"),
    ("pelvis", "spine_03", "upperarm_l", "upperarm_r", "lowerarm_l", "lowerarm_r", "hand_l", "hand_r"),
)  # fmt: skip


@dataclass(frozen=True)
class Arms:
    """One capture at `RATE` frames a second: wrist and elbow `[2, T, 3]`, left first, each outward, up and forward of
    the midpoint between the shoulders in the trunk's frame, in metres scaled to the project's own arms."""

    name: str
    wrist: np.ndarray
    elbow: np.ndarray


def cmu(path: Path) -> Arms:
    """Raises `ValueError` if an array is missing or has another shape."""
    with np.load(path) as data:
        missing = {"expmap", "parent", "offset_mm", "fps"} - set(data.files)
        if missing:
            raise ValueError(f"{path}: no array {', '.join(sorted(missing))}")
        expmap, parents, offsets = data["expmap"].astype(float), data["parent"], data["offset_mm"].astype(float) / 1000
        rate = float(data["fps"])
    joints = len(parents)
    if expmap.ndim != 2 or expmap.shape[1] != 3 + 3 * joints or offsets.shape != (joints, 3) or joints <= max(_CMU):
        raise ValueError(f"{path}: `expmap` {expmap.shape} does not fit {joints} joints of at least {max(_CMU) + 1}")
    # The data's matrices apply to row vectors.
    local = Rotation.from_rotvec(-expmap[:, 3:].reshape(-1, 3)).as_matrix().reshape(-1, joints, 3, 3)
    return _arms(path.stem, _places(local, np.broadcast_to(offsets, local.shape[:-1]), parents)[:, _CMU], rate)


@dataclass(frozen=True)
class Clip:
    """One animation of a glTF file at `RATE` frames a second: rotations `[T, N, 3, 3]` and positions `[T, N, 3]` of its
    nodes relative to their parents (-1 for none), and the same at rest `[N, ...]`."""

    name: str
    nodes: tuple[str, ...]
    parents: np.ndarray
    local: np.ndarray
    offsets: np.ndarray
    rest_local: np.ndarray
    rest_offsets: np.ndarray


def gltf(path: Path) -> list[Arms]:
    """One per animation. Raises `ValueError` if the file is not glTF or has no known arms."""
    made = clips(path)
    known = next((row for row in _GLTF if made and set(row) <= set(made[0].nodes)), None)
    if known is None:
        raise ValueError(f"{path}: no nodes named as in {' or '.join(row[2] for row in _GLTF)}")
    at = [made[0].nodes.index(name) for name in known]
    return [_arms(clip.name, _places(clip.local, clip.offsets, clip.parents)[:, at], RATE) for clip in made]


def clips(path: Path) -> list[Clip]:
    """All animations of a file. Raises `ValueError` if it is not glTF."""
    scene, binary = _gltf(path)
    nodes = scene["nodes"]
    parents = np.full(len(nodes), -1)
    for index, node in enumerate(nodes):
        parents[node.get("children", [])] = index
    return [_clip(scene, binary, clip, parents) for clip in scene["animations"]]


def _gltf(path: Path) -> tuple[dict, bytes]:
    data = path.read_bytes()
    try:
        if data[:4] == b"glTF":
            length = struct.unpack_from("<I", data, 12)[0]
            return json.loads(data[20 : 20 + length]), data[28 + length :]
        scene = json.loads(data)
        return scene, (path.parent / scene["buffers"][0]["uri"]).read_bytes()
    except (struct.error, ValueError, KeyError, IndexError) as error:
        raise ValueError(f"{path}: not a glTF file: {error}") from error


def _accessor(scene: dict, binary: bytes, index: int) -> np.ndarray:
    about = scene["accessors"][index]
    view = scene["bufferViews"][about["bufferView"]]
    if about["componentType"] != 5126 or "byteStride" in view:
        raise ValueError("glTF: only packed 32-bit floats are supported")
    width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[about["type"]]
    start = view.get("byteOffset", 0) + about.get("byteOffset", 0)
    return np.frombuffer(binary, "<f4", about["count"] * width, start).reshape(-1, width).astype(float)


def _clip(scene: dict, binary: bytes, clip: dict, parents: np.ndarray) -> Clip:
    tracks = []
    for channel in clip["channels"]:
        sampler = clip["samplers"][channel["sampler"]]
        at, values = (_accessor(scene, binary, sampler[name]) for name in ("input", "output"))
        tracks.append((channel["target"]["node"], channel["target"]["path"], at[:, 0], values))
    t = np.arange(0.0, max(at[-1] for _, _, at, _ in tracks), 1.0 / RATE)
    nodes = scene["nodes"]
    rest_local = Rotation.from_quat([node.get("rotation", (0, 0, 0, 1)) for node in nodes]).as_matrix()
    rest_offsets = np.array([node.get("translation", (0, 0, 0)) for node in nodes], float)
    local, offsets = np.tile(rest_local, (len(t), 1, 1, 1)), np.tile(rest_offsets, (len(t), 1, 1))
    for node, kind, at, values in tracks:
        inside = np.clip(t, at[0], at[-1])
        if kind == "rotation":
            turned = Rotation.from_quat(values)
            local[:, node] = (Slerp(at, turned)(inside) if len(at) > 1 else turned[np.zeros(len(t), int)]).as_matrix()
        elif kind == "translation" and len(at) > 1:
            offsets[:, node] = interp1d(at, values, axis=0)(inside)
    names = tuple(node.get("name", "") for node in nodes)
    return Clip(clip["name"], names, parents, local, offsets, rest_local, rest_offsets)


def _places(local: np.ndarray, offsets: np.ndarray, parents: np.ndarray) -> np.ndarray:
    return world(local, offsets, parents)[1]


def world(local: np.ndarray, offsets: np.ndarray, parents: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """World rotations `[T, N, 3, 3]` and positions `[T, N, 3]` of all joints."""
    world, at, done = np.empty_like(local), np.zeros(offsets.shape), np.zeros(len(parents), bool)

    def place(joint: int) -> None:
        parent = int(parents[joint])
        if done[joint]:
            return
        if parent < 0:
            world[:, joint], at[:, joint] = local[:, joint], offsets[:, joint]
        else:
            place(parent)
            world[:, joint] = world[:, parent] @ local[:, joint]
            at[:, joint] = at[:, parent] + (world[:, parent] @ offsets[:, joint, :, None])[..., 0]
        done[joint] = True

    for joint in range(len(parents)):
        place(joint)
    return world, at


def _arms(name: str, at: np.ndarray, rate: float) -> Arms:
    """Computed from the positions of `_CMU`'s joints `[T, 8, 3]`."""
    t = np.arange(0.0, (len(at) - 1) / rate, 1.0 / RATE)
    at = interp1d(np.arange(len(at)) / rate, at, axis=0)(t)
    middle = 0.5 * (at[:, 2] + at[:, 3])
    up = unit(middle - at[:, 0])
    left = at[:, 2] - at[:, 3]
    left = unit(left - np.einsum("ti,ti->t", left, up)[:, None] * up)
    # Rows: left, up, forward.
    frame = np.stack([left, up, np.cross(left, up)], 1)
    length = np.linalg.norm(at[:, 4] - at[:, 2], axis=-1) + np.linalg.norm(at[:, 6] - at[:, 4], axis=-1)
    scale = (UPPER_M + FORE_M) / np.median(length)
    placed = np.einsum("tij,tkj->kti", frame, at[:, 4:] - middle[:, None]) * scale
    placed[1::2, :, 0] *= -1.0
    placed = gaussian_filter1d(placed, 0.025 * RATE, axis=1)
    return Arms(name, placed[2:], placed[:2])
