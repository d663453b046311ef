"""Chained parts from the pelvis outwards: each rotates its first joints to compensate for errors of the parts before
it.

Rotations along a chain of joints add up, and so do the errors of their parts. A part's tokenizer therefore does not
encode the performer's rotation of a joint relative to its true parent, but the rotation that gives the joint the
performer's world rotation from the parent as decoded from the earlier parts' codes. The engine decodes parts
independently: only the encoded targets differ.
"""

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from umo_train.frames import feet, parts
from umo_train.frames.parts import Part
from umo_train.metrics.item import Motion
from umo_train.skeleton import JOINT, JOINT_NAMES, JOINTS_OF, PARENTS, PARTS, matrices, rotation_6d

# Body parts with joints corrected in world space. Fingers are seen relative to their hand, the jaw relative to its
# head.
REGIONS = ("lower", "upper")
_COLUMN = {joint: (region, slice(6 * i, 6 * i + 6)) for region in REGIONS for i, joint in enumerate(JOINTS_OF[region])}
# Parents before their children.
_BODY = tuple(sorted(_COLUMN))


class Said:
    """The motion of one item as decoded so far: the next part's target, and the decoded channels."""

    def __init__(self, motion: Motion, face: list[str]) -> None:
        self.motion, self.face = motion, face
        self.channels = {region: np.array(motion[region], np.float32) for region in PARTS if region in motion}
        # World rotations of the performer, and of decoded joints as decoded.
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
        """`[T, C]`: the part's target."""
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
        """Sets a part's decoded `channels` `[T, C]`."""
        region, at = parts.columns(part, self.face)
        self.channels[region][:, at] = channels
        for joint in sorted(JOINT[name] for name in part.channels if JOINT.get(name) in _COLUMN):
            parent = PARENTS[joint]
            local = self._local(self.channels, joint)
            # Joints not decoded yet will compensate for errors before them.
            self.told[joint] = local if parent < 0 else self.told.get(parent, self.true[parent]) @ local


def before(order: Sequence[Part], part: Part) -> list[Part]:
    """The parts of `order` whose errors a part compensates for: those with joints between its own and the pelvis."""
    found = set()
    for name in part.channels:
        joint = JOINT.get(name)
        while joint in _COLUMN:
            found.add(JOINT_NAMES[joint])
            joint = PARENTS[joint]
    return [one for one in order if found & set(one.channels)]


class Chained:
    """Channels of a part with rotations relative to the start of the part instead of the parent joint, so that errors
    of consecutive joints count as they add up. Other channels are unchanged, as are rotations of fingers and jaw."""

    def __init__(self, part: Part) -> None:
        places, at = {}, 0
        for name, width in parts.widths(part):
            if JOINT.get(name) in _COLUMN:
                places[JOINT[name]] = at
            at += width
        self.joints = tuple(sorted(places))
        self.columns = torch.tensor([[places[joint] + i for i in range(6)] for joint in self.joints], dtype=torch.long)

    def __call__(self, x: Tensor) -> Tensor:
        """`[..., C]` to the same shape, with rotations orthonormalised."""
        if not self.joints:
            return x
        columns = self.columns.to(x.device)
        world: dict[int, Tensor] = {}
        for joint, local in zip(self.joints, feet.matrices(x[..., columns]).unbind(-3), strict=True):
            parent = world.get(PARENTS[joint])
            world[joint] = local if parent is None else feet.product(parent, local)
        turned = torch.stack([world[joint][..., :2, :] for joint in self.joints], -3)
        return x.index_copy(-1, columns.flatten(), turned.flatten(-3))
