"""Parts from the pelvis outwards: each turns its first joints so that what the parts before it said wrong is made good.

The rotations of a chain of joints add up, and so do the errors of the parts that say them. A part's tokenizer therefore
does not say a joint's rotation as the performer has it, but the one that turns the joint as the performer has it in the
world, from where the parts before it, as their codes decode, have turned its parent. The engine decodes parts without
regard to each other: only what is encoded differs.
"""

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from umo_train.frames import feet, parts
from umo_train.frames.parts import Part
from umo_train.metrics.item import Motion
from umo_train.skeleton import JOINT, JOINT_NAMES, JOINTS_OF, PARENTS, PARTS, matrices, rotation_6d

# Body parts whose joints are turned in the world. Fingers are seen on their hand, the jaw on its head.
REGIONS = ("lower", "upper")
_COLUMN = {joint: (region, slice(6 * i, 6 * i + 6)) for region in REGIONS for i, joint in enumerate(JOINTS_OF[region])}
# Parents before their children.
_BODY = tuple(sorted(_COLUMN))


class Said:
    """One item's motion, as far as parts have said it: what a part is to say now, and what it said."""

    def __init__(self, motion: Motion, face: list[str]) -> None:
        self.motion, self.face = motion, face
        self.channels = {region: np.array(motion[region], np.float32) for region in PARTS if region in motion}
        # World rotations as the performer has them, and of the joints that were said, as said.
        self.true: dict[int, np.ndarray] = {}
        self.told: dict[int, np.ndarray] = {}
        if all(region in motion for region in REGIONS):
            for joint in _BODY:
                local = self._local(motion, joint)
                parent = PARENTS[joint]
                self.true[joint] = local if parent < 0 else self.true[parent] @ local

    @staticmethod
    def _local(motion: Motion, joint: int) -> np.ndarray:
        region, at = _COLUMN[joint]
        return matrices(np.asarray(motion[region])[:, at].astype(np.float64))

    def aims(self, part: Part) -> np.ndarray:
        """`[T, C]` what the part is to say."""
        region, at = parts.columns(part, self.face)
        out = np.array(self.motion[region][:, at], np.float32)
        first = 0
        for name, width in parts.widths(part):
            joint = JOINT.get(name)
            if joint in _COLUMN and PARENTS[joint] in self.told:
                local = np.swapaxes(self.told[PARENTS[joint]], -1, -2) @ self.true[joint]
                out[:, first : first + width] = rotation_6d(local)
            first += width
        return out

    def say(self, part: Part, channels: np.ndarray) -> None:
        """`channels` `[T, C]` are what the part's codes decode to."""
        region, at = parts.columns(part, self.face)
        self.channels[region][:, at] = channels
        for joint in sorted(JOINT[name] for name in part.channels if JOINT.get(name) in _COLUMN):
            parent = PARENTS[joint]
            local = self._local(self.channels, joint)
            # What was not said yet will make good what is wrong before it.
            self.told[joint] = local if parent < 0 else self.told.get(parent, self.true[parent]) @ local


def before(order: Sequence[Part], part: Part) -> list[Part]:
    """The parts of `order` whose errors a part makes good: those with joints between its own and the pelvis."""
    found = set()
    for name in part.channels:
        joint = JOINT.get(name)
        while joint in _COLUMN:
            found.add(JOINT_NAMES[joint])
            joint = PARENTS[joint]
    return [one for one in order if found & set(one.channels)]


class Chained:
    """Channels of a part whose rotations are not from a joint's parent, but from where the part begins: errors of
    joints that follow each other are then seen as they add up. Other channels stay as they are, and so do rotations
    of fingers and jaw."""

    def __init__(self, part: Part) -> None:
        places, at = {}, 0
        for name, width in parts.widths(part):
            if JOINT.get(name) in _COLUMN:
                places[JOINT[name]] = at
            at += width
        self.joints = tuple(sorted(places))
        self.columns = torch.tensor([[places[joint] + i for i in range(6)] for joint in self.joints], dtype=torch.long)

    def __call__(self, x: Tensor) -> Tensor:
        """`[..., C]` to the same, rotations made proper."""
        if not self.joints:
            return x
        columns = self.columns.to(x.device)
        world: dict[int, Tensor] = {}
        for joint, local in zip(self.joints, feet.matrices(x[..., columns]).unbind(-3), strict=True):
            parent = world.get(PARENTS[joint])
            world[joint] = local if parent is None else feet.product(parent, local)
        turned = torch.stack([world[joint][..., :2, :] for joint in self.joints], -3)
        return x.index_copy(-1, columns.flatten(), turned.flatten(-3))
