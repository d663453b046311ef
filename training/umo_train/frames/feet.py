"""Positions of the feet under a pelvis, to measure the lower body's errors."""

import torch
from torch import Tensor

from umo_train.skeleton import CONTACT_JOINTS, JOINT, JOINT_NAMES, JOINTS_OF, OFFSETS_M, PARENTS

_LEGS = JOINTS_OF["lower"]
NAMES = tuple(JOINT_NAMES[joint] for joint in _LEGS)


def matrices(six: Tensor) -> Tensor:
    """`[..., 6]` to rotation matrices `[..., 3, 3]` by Gram-Schmidt."""
    first = torch.nn.functional.normalize(six[..., :3], dim=-1)
    second = six[..., 3:] - (first * six[..., 3:]).sum(-1, keepdim=True) * first
    second = torch.nn.functional.normalize(second, dim=-1)
    return torch.stack([first, second, torch.linalg.cross(first, second)], -2)


def product(a: Tensor, b: Tensor) -> Tensor:
    """Product of matrices `[..., 3, 3]` with matrices or vectors `[3]`. PyTorch's own is slow for such small ones."""
    return (a * b).sum(-1) if b.dim() == 1 else (a[..., :, :, None] * b[..., None, :, :]).sum(-2)


def places(lower: Tensor) -> Tensor:
    """Lower-body channels `[..., 61]` to positions of the four floor-contact joints relative to the pelvis,
    `[..., 4, 3]`, metres."""
    local = matrices(lower[..., : 6 * len(_LEGS)].unflatten(-1, (len(_LEGS), 6)))
    offsets = torch.as_tensor(OFFSETS_M, dtype=lower.dtype, device=lower.device)
    world, at = {JOINT["pelvis"]: local[..., 0, :, :]}, {JOINT["pelvis"]: torch.zeros_like(local[..., 0, 0, :])}
    for i, joint in enumerate(_LEGS[1:], 1):
        parent = PARENTS[joint]
        at[joint] = at[parent] + product(world[parent], offsets[joint])
        world[joint] = product(world[parent], local[..., i, :, :])
    return torch.stack([at[joint] for joint in CONTACT_JOINTS], -2)
