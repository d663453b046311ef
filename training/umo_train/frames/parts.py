"""The parts of layout `frames` (SPEC 2.12): which channels each has, where they are, and what its errors cost."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from umo_train.skeleton import ARKIT, JOINT, JOINT_NAMES, JOINTS, JOINTS_OF, OFFSETS_M, PARENTS, PARTS

Config = dict[str, Any]

MOST_CODES, MOST_LEVELS = 256, 16
# Names that stand for several channels in a plan; the name of a body part stands for all of its channels.
_EYES = tuple(name for name in ARKIT if name.startswith(("eye", "brow")))
GROUPS: dict[str, tuple[str, ...]] = {
    "eyes_and_brows": _EYES,
    "mouth_and_cheeks": ("jaw", *(name for name in ARKIT if name not in _EYES)),
    "left_fingers": tuple(name for name in JOINT_NAMES[25:] if name.startswith("left_")),
    "right_fingers": tuple(name for name in JOINT_NAMES[25:] if name.startswith("right_")),
}
# Channels that are neither a rotation nor one value.
_WIDTHS = {"root_velocity": 3, "contacts": 4}
# Of a channel's squared error, per unit: a shape of the face shows at 0.03, the mouth's own at 0.015 and less.
_SHAPE, _MOUTH, _LIDS = 30.0**2, 65.0**2, 45.0**2
_SPOKEN = ("jawOpen", "mouthClose", "mouthFunnel", "mouthPucker", "mouthRoll", "mouthPress", "mouthLower", "mouthUpper")
# The root network's velocity is what is used; a contact shows at a fifth.
_VELOCITY, _CONTACT = 5.0**2, 5.0**2


@dataclass(frozen=True)
class Part:
    """As `config.parts` has it, but for the codes of rest. A part without channels is an annotation."""

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
    """Every channel of the four body parts in their order: names and how many values each has."""
    joints = {region: [(JOINT_NAMES[joint], 6) for joint in JOINTS_OF[region]] for region in PARTS}
    joints["face"] += [(name, 1) for name in face]
    joints["lower"] += _WIDTHS.items()
    return joints


def columns(part: Part, face: list[str]) -> tuple[str, np.ndarray]:
    """The body part that a part belongs to, and the columns in it of each of its channels.

    Raises `ValueError` where a channel has no such name or they are of several body parts.
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
    """A part's channels in their order, and how many values each has."""
    return [(name, 6 if name in JOINT else _WIDTHS.get(name, 1)) for name in part.channels]


def own(part: Part, face: list[str], motion: dict[str, np.ndarray]) -> np.ndarray:
    """A part's channels `[T, C]` of those of the body parts."""
    region, at = columns(part, face)
    return motion[region][:, at]


def read(plan: Config, face: list[str]) -> list[Part]:
    """`parts` of a plan, in order.

    Raises `ValueError` where they are not what a model file may have: `docs/model-format.md` has the limits.
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
        raise ValueError("parts: each needs a name of its own, and none is `root`")
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
    """How far from a joint the furthest place is that it moves, in metres; a joint without others moves 3 cm, the head
    its crown."""
    if joint == JOINT["head"]:
        return 0.2
    children = [child for child in range(JOINTS) if PARENTS[child] == joint]
    return max([float(np.linalg.norm(OFFSETS_M[child])) + reach_m(child) for child in children], default=0.03)


# Where a face looks is seen as if the head were so long, in metres; and a pelvis' turn as if it reached to the neck:
# by its bones alone it would count a tenth of a thigh, and who boxes or sways would stand.
_GAZE_M, _PELVIS_M = 0.8, 0.6


def bone_m(joint: int) -> float:
    """How far from a joint the furthest place is that it moves while all other joints of a part keep their turn in the
    world, in metres: the next joint, or of one that ends the part all that a person sees turn."""
    if joint in (JOINT["head"], JOINT["pelvis"]):
        return _GAZE_M if joint == JOINT["head"] else _PELVIS_M
    children = [child for child in range(JOINTS) if PARENTS[child] == joint]
    if joint in (JOINT["left_wrist"], JOINT["right_wrist"]) or not children:
        return reach_m(joint)
    return max(float(np.linalg.norm(OFFSETS_M[child])) for child in children)


def chained_weights(part: Part) -> np.ndarray:
    """`[C]`: as `weights`, where rotations are from where the part begins (`chain.Chained`)."""
    out, first = weights(part), 0
    for name, width in widths(part):
        if name in JOINT:
            out[first : first + width] = (100.0 * bone_m(JOINT[name])) ** 2
        first += width
    return out


def weights(part: Part) -> np.ndarray:
    """`[C]`: what a channel's squared error costs. Of a rotation, the squared error in centimetres of the furthest
    place that it moves; of neck and head, that of a longer one."""
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
