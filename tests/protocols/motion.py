"""Motion in files that `umo animate` wrote, read with NumPy alone: glTF, and quaternions x y z w."""

import json
import struct
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}
FLOAT = 5126


@dataclass
class Gltf:
    """A .glb or .vrma file: its nodes and its first animation."""

    nodes: list[dict]
    extensions: dict
    # Node and property to times and values.
    tracks: dict[tuple[int, str], tuple[np.ndarray, np.ndarray]]
    parents: dict[int, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for parent, node in enumerate(self.nodes):
            self.parents.update(dict.fromkeys(node.get("children", []), parent))

    def index(self, name: str) -> int:
        return next(i for i, node in enumerate(self.nodes) if node.get("name") == name)

    def rest(self, node: int) -> np.ndarray:
        """World rotation of a node without animation."""
        own = np.array(self.nodes[node].get("rotation", (0, 0, 0, 1)), float)
        return product(self.rest(self.parents[node]), own) if node in self.parents else own

    def values(self, node: int, path: str, times: np.ndarray) -> np.ndarray:
        """Values of a property at these times, linear between keys."""
        keys, values = self.tracks[node, path]
        if path == "rotation":
            return between(keys, values, times)
        return np.stack([np.interp(times, keys, column) for column in values.T], axis=-1)

    def world(self, node: int, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """World rotation and position of a node at these times."""
        at = [np.tile(self.nodes[node].get(path, rest), (len(times), 1)) for path, rest in RESTS]
        for place, (path, _) in enumerate(RESTS):
            if (node, path) in self.tracks:
                at[place] = self.values(node, path, times)
        rotation, position = at
        if node in self.parents:
            turn, origin = self.world(self.parents[node], times)
            return product(turn, rotation), origin + rotated(turn, position)
        return rotation, position


RESTS = (("rotation", (0.0, 0.0, 0.0, 1.0)), ("translation", (0.0, 0.0, 0.0)))


def read(path: str) -> Gltf:
    data = Path(path).read_bytes()
    (length,) = struct.unpack_from("<I", data, 12)
    root = json.loads(data[20 : 20 + length])
    binary = data[28 + length :]

    def accessor(index: int) -> np.ndarray:
        entry = root["accessors"][index]
        view, width = root["bufferViews"][entry["bufferView"]], WIDTHS[entry["type"]]
        assert entry["componentType"] == FLOAT and "byteStride" not in view, entry
        start = view.get("byteOffset", 0) + entry.get("byteOffset", 0)
        values = np.frombuffer(binary, "<f4", entry["count"] * width, start).astype(float)
        return values.reshape(-1, width) if width > 1 else values

    tracks = {}
    for animation in root.get("animations", [])[:1]:
        for channel in animation["channels"]:
            sampler, target = animation["samplers"][channel["sampler"]], channel["target"]
            keys, values = accessor(sampler["input"]), accessor(sampler["output"])
            tracks[target["node"], target["path"]] = keys, values.reshape(len(keys), -1)
    return Gltf(root["nodes"], root.get("extensions", {}), tracks)


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    a, b = np.broadcast_arrays(a, b)
    vector = a[..., 3:] * b[..., :3] + b[..., 3:] * a[..., :3] + np.cross(a[..., :3], b[..., :3])
    scalar = a[..., 3:] * b[..., 3:] - np.sum(a[..., :3] * b[..., :3], axis=-1, keepdims=True)
    return np.concatenate([vector, scalar], axis=-1)


def inverse(rotation: np.ndarray) -> np.ndarray:
    return rotation * [-1, -1, -1, 1]


def rotated(rotation: np.ndarray, vector: np.ndarray) -> np.ndarray:
    side = 2 * np.cross(rotation[..., :3], vector)
    return vector + rotation[..., 3:] * side + np.cross(rotation[..., :3], side)


def between(keys: np.ndarray, values: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Spherical interpolation between neighbouring keys."""
    after = np.clip(np.searchsorted(keys, times, side="right"), 1, len(keys) - 1)
    a, b = values[after - 1], values[after]
    share = np.clip((times - keys[after - 1]) / (keys[after] - keys[after - 1]), 0, 1)[:, None]
    cosine = np.sum(a * b, axis=-1, keepdims=True)
    b, cosine = np.where(cosine < 0, -b, b), np.clip(np.abs(cosine), 0, 1)
    angle = np.arccos(cosine)
    is_far = angle > 1e-4
    sine = np.where(is_far, np.sin(angle), 1)
    first = np.where(is_far, np.sin((1 - share) * angle) / sine, 1 - share)
    second = np.where(is_far, np.sin(share * angle) / sine, share)
    mixed = first * a + second * b
    return mixed / np.linalg.norm(mixed, axis=-1, keepdims=True)


def angles(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angle between rotations, degrees."""
    turn = product(inverse(a), b)
    return np.degrees(2 * np.arctan2(np.linalg.norm(turn[..., :3], axis=-1), np.abs(turn[..., 3])))
