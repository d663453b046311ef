"""The parts of layout `frames` (SPEC 2.12): their channels, positions, and error weights."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from umo_train.skeleton import ARKIT, JOINT, JOINT_NAMES, JOINTS, JOINTS_OF, OFFSETS_M, PARENTS, PARTS

Config = dict[str, Any]

MOST_CODES, MOST_LEVELS = 256, 16
# Names for groups of channels in a plan; a body part's name stands for all of its channels.
_EYES = tuple(name for name in ARKIT if name.startswith(("eye", "brow")))
GROUPS: dict[str, tuple[str, ...]] = {
    "eyes_and_brows": _EYES,
    "mouth_and_cheeks": ("jaw", *(name for name in ARKIT if name not in _EYES)),
    "left_fingers": tuple(name for name in JOINT_NAMES[25:] if name.startswith("left_")),
    "right_fingers": tuple(name for name in JOINT_NAMES[25:] if name.startswith("right_")),
}
# Channels that are neither a rotation nor a single value.
_WIDTHS = {"root_velocity": 3, "contacts": 4}
# Weights of a channel's squared error, per unit: a shape of the face becomes visible at 0.03, the mouth's at 0.015 and
# less.
_SHAPE, _MOUTH, _LIDS = 30.0**2, 65.0**2, 45.0**2
_SPOKEN = ("jawOpen", "mouthClose", "mouthFunnel", "mouthPucker", "mouthRoll", "mouthPress", "mouthLower", "mouthUpper")
# The root network's velocity is used instead; a contact becomes visible at a fifth.
_VELOCITY, _CONTACT = 5.0**2, 5.0**2


@dataclass(frozen=True)
class Part:
    """As in `config.parts`, without the rest codes. A part without channels is an annotation."""

    name: str
    channels: tuple[str, ...]
    codes: int
    levels: int
    width: int = 0
    layers: int = 0
    sampling: Config | None = None

    @property
    def moves(self) -> bool:
        return bool(self.channels)

    def config(self, rest: list[int]) -> Config:
        """Its entry in the model file's config."""
        out: Config = {"name": self.name, "channels": list(self.channels), "codes": self.codes, "levels": self.levels}
        if self.moves:
            out |= {"width": self.width, "layers": self.layers}
        if self.sampling:
            out["sampling"] = self.sampling
        return out | {"rest": rest}


def named(face: list[str]) -> dict[str, list[tuple[str, int]]]:
    """All channels of the four body parts in order: names and numbers of values."""
    joints = {region: [(JOINT_NAMES[joint], 6) for joint in JOINTS_OF[region]] for region in PARTS}
    joints["face"] += [(name, 1) for name in face]
    joints["lower"] += _WIDTHS.items()
    return joints


def columns(part: Part, face: list[str]) -> tuple[str, np.ndarray]:
    """The body part that a part belongs to, and the columns in it of each of its channels.

    Raises `ValueError` if a channel is unknown or channels belong to several body parts.
    """
    at = {}
    for region, entries in named(face).items():
        first = 0
        for name, width in entries:
            at[name] = region, np.arange(first, first + width)
            first += width
    unknown = [name for name in part.channels if name not in at]
    if unknown:
        raise ValueError(f"part `{part.name}`: no channel is called {unknown[0]}: joints, shapes of the face, "
                         "root_velocity and contacts have names")  # fmt: skip
    regions = {at[name][0] for name in part.channels}
    if len(regions) != 1:
        raise ValueError(f"part `{part.name}`: channels of {' and '.join(sorted(regions))}; a part is of one of them")
    return regions.pop(), np.concatenate([at[name][1] for name in part.channels])


def widths(part: Part) -> list[tuple[str, int]]:
    """A part's channels in order, and their numbers of values."""
    return [(name, 6 if name in JOINT else _WIDTHS.get(name, 1)) for name in part.channels]


def own(part: Part, face: list[str], motion: dict[str, np.ndarray]) -> np.ndarray:
    """A part's channels `[T, C]` out of the body parts' channels."""
    region, at = columns(part, face)
    return motion[region][:, at]


def read(plan: Config, face: list[str]) -> list[Part]:
    """`parts` of a plan, in order.

    Raises `ValueError` if they are invalid for a model file: see the limits in `docs/model-format.md`.
    """
    shared = {key: plan["tokenizers"][key] for key in ("codes", "levels", "width", "layers")}
    groups = GROUPS | {region: tuple(name for name, _ in entries) for region, entries in named(face).items()}
    out = []
    for entry in plan["parts"]:
        given = [name for one in entry.get("channels", ()) for name in groups.get(one, (one,))]
        sizes = {key: entry.get(key, value) for key, value in shared.items()}
        if not given:
            sizes |= {"width": 0, "layers": 0}
        out.append(Part(entry["name"], tuple(given), **sizes, sampling=entry.get("sampling")))
    _check(out, face)
    return out


def _check(parts: list[Part], face: list[str]) -> None:
    names = [part.name for part in parts]
    if len(set(names)) != len(names) or "root" in names:
        raise ValueError("parts: each needs a unique name other than `root`")
    for part in parts:
        if not 1 <= part.codes <= MOST_CODES or not 1 <= part.levels <= MOST_LEVELS:
            raise ValueError(f"part `{part.name}`: 1 to {MOST_CODES} codes and 1 to {MOST_LEVELS} levels, "
                             f"not {part.codes} and {part.levels}")  # fmt: skip
        if part.moves:
            columns(part, face)
    given = [name for part in parts for name in part.channels]
    wanted = [name for entries in named(face).values() for name, _ in entries]
    missing, twice = set(wanted) - set(given), {name for name in given if given.count(name) > 1}
    if missing or twice:
        raise ValueError(f"parts: every channel is in exactly one part; in none: {sorted(missing)}, "
                         f"in several: {sorted(twice)}")  # fmt: skip


def reach_m(joint: int) -> float:
    """Distance from a joint to the furthest point that it moves, in metres; a joint without others moves 3 cm, the head
    its crown."""
    if joint == JOINT["head"]:
        return 0.2
    children = [child for child in range(JOINTS) if PARENTS[child] == joint]
    return max([float(np.linalg.norm(OFFSETS_M[child])) + reach_m(child) for child in children], default=0.03)


# Effective length of the head for its gaze direction, in metres; and of the pelvis, as if it reached to the neck: by
# its bones alone it would weigh a tenth of a thigh, and swaying or boxing would be lost.
_GAZE_M, _PELVIS_M = 0.8, 0.6


def bone_m(joint: int) -> float:
    """Distance from a joint to the furthest point that it moves while all other joints of a part keep their world
    rotation, in metres: the next joint, or for a part's last joint everything visible that it rotates."""
    if joint in (JOINT["head"], JOINT["pelvis"]):
        return _GAZE_M if joint == JOINT["head"] else _PELVIS_M
    children = [child for child in range(JOINTS) if PARENTS[child] == joint]
    if joint in (JOINT["left_wrist"], JOINT["right_wrist"]) or not children:
        return reach_m(joint)
    return max(float(np.linalg.norm(OFFSETS_M[child])) for child in children)


def chained_weights(part: Part) -> np.ndarray:
    """`[C]`: as `weights`, for rotations relative to the start of the part (`chain.Chained`)."""
    out, first = weights(part), 0
    for name, width in widths(part):
        if name in JOINT:
            out[first : first + width] = (100.0 * bone_m(JOINT[name])) ** 2
        first += width
    return out


def weights(part: Part) -> np.ndarray:
    """`[C]`: weight of a channel's squared error. For a rotation, the squared error in centimetres of the furthest
    point that it moves; for neck and head, of an extended one."""
    out: list[float] = []
    for name in part.channels:
        if name in JOINT:
            moved = _GAZE_M if name in ("neck", "head") else reach_m(JOINT[name])
            out += [(100.0 * moved) ** 2] * 6
        elif name == "root_velocity":
            out += [_VELOCITY] * 3
        elif name == "contacts":
            out += [_CONTACT] * 4
        else:
            spoken = name.startswith(_SPOKEN)
            out.append(_MOUTH if spoken else _LIDS if name.startswith("eyeBlink") else _SHAPE)
    return np.array(out, np.float32)
