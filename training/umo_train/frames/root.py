"""The root network of layout `frames` (SPEC 2.7): moves the pelvis so that planted decoded feet stay in place.

The velocity is, except for small terms, linear in the change of the legs' rotations from frame to frame, and such a
small difference of large values is the hardest thing for a network to learn. So it is not learned: the network is the
least-squares solution, written into its layers."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from umo_train.frames import feet
from umo_train.motion.networks import RootNetwork
from umo_train.skeleton import CHANNELS, CONTACT, VELOCITY
from umo_train.speech.utterance import FRAME_RATE
from umo_train.state import Saved

_ROTATIONS = 6 * len(feet.NAMES)
# Output channels of the network: velocity along x and z, and the height.
_SAID = (VELOCITY.start, VELOCITY.start + 2, VELOCITY.start + 1)
# Units that pass these on.
PASSED = 2 * len(_SAID)
# Weight of the change from an item's last frame to the zeros after it: it is large, but not motion.
_END = 1e-3
# Regularisation relative to the mean square of the solution: keeps weights of nearly constant channels small.
_RIDGE = 1e-6


@dataclass(frozen=True)
class RootPlan:
    """Settings of the network: `width` at least 6."""

    width: int
    layers: int
    seed: int = 0


@dataclass(frozen=True)
class RootItem:
    """One item: the performer's lower body `[T, 61]` and the decoded one (each `[T, 61]`), and the pelvis' height
    `[T]`, metres."""

    lower: np.ndarray
    said: tuple[np.ndarray, ...]
    height: np.ndarray


@dataclass(frozen=True)
class Linear:
    """Velocity along x and z as `change` `[54, 2]` times the change of rotations to the next frame, and the height as
    `pose` `[54]` times rotations, plus `offset`."""

    change: np.ndarray
    pose: np.ndarray
    offset: float


def wanted(lower: Tensor, truth: Tensor) -> tuple[Tensor, Tensor]:
    """Velocity `[T - 1, 2]` that best keeps planted feet of a lower body `[T, 61]` in place, and their number; without
    planted feet, the performer's velocity from `truth` `[T, 61]`."""
    planted = truth[:, CONTACT] > 0.5
    both = (planted[1:] & planted[:-1])[..., None]
    moved = feet.places(lower).diff(dim=0)[..., [0, 2]] * FRAME_RATE
    count = both.sum(1)
    own = truth[:-1, VELOCITY][:, [0, 2]]
    return torch.where(count > 0, -(moved * both).sum(1) / count.clamp(min=1), own), count[:, 0].clamp(min=1)


def solve(items: list[RootItem]) -> Linear:
    """Least squares over the performer's legs and the decoded ones."""
    sums = np.zeros((_ROTATIONS, _ROTATIONS)), np.zeros((_ROTATIONS, 2))
    posed, high, count = np.zeros((_ROTATIONS + 1, _ROTATIONS + 1)), np.zeros(_ROTATIONS + 1), 0
    for item in items:
        truth = torch.from_numpy(item.lower)
        for lower in (item.lower, *item.said):
            seen = rooted(torch.from_numpy(lower))
            velocity, weight = (values.double().numpy() for values in wanted(seen, truth))
            x = seen[:, :_ROTATIONS].double().numpy()
            change = np.diff(x, axis=0)
            weighted = change.T * weight
            sums[0][:] += weighted @ change + _END * np.outer(x[-1], x[-1])
            sums[1][:] += weighted @ velocity
            ones = np.concatenate([x, np.ones((len(x), 1))], 1)
            posed += ones.T @ ones
            high += ones.T @ item.height
            count += len(x)
    change = np.linalg.solve(sums[0] + _RIDGE * np.trace(sums[0]) / _ROTATIONS * np.eye(_ROTATIONS), sums[1])
    # About the means: the constant is not regularised.
    mean, at = posed[:-1, -1] / count, high[-1] / count
    spread = posed[:-1, :-1] / count - np.outer(mean, mean)
    ridge = _RIDGE * np.trace(spread) / _ROTATIONS * np.eye(_ROTATIONS)
    pose = np.linalg.solve(spread + ridge, high[:-1] / count - mean * at)
    return Linear(change, pose, float(at - mean @ pose))


@torch.no_grad()
def embed(model: RootNetwork, linear: Linear) -> None:
    """Writes `linear` into a network. The first units of every layer pass it on, in pairs `leaky(x)` and `leaky(-x)`,
    whose difference is 1.2 `x`; all other weights are zero."""
    if model.encoder.main[0].out_channels < PASSED:
        raise ValueError(f"root: a width of at least {PASSED}")
    for weight in model.parameters():
        weight.zero_()
    convs = [m for stack in (model.encoder, model.decoder) for m in stack.main if isinstance(m, nn.Conv1d)]
    rows = [torch.from_numpy(row).float() for row in (*linear.change.T, linear.pose)]
    for k, row in enumerate(rows):
        for sign, unit in ((1.0, 2 * k), (-1.0, 2 * k + 1)):
            first = convs[0].weight[unit, :_ROTATIONS]
            if k < 2:
                # Two taps of the same magnitude: rounded, they still cancel without change.
                first[:, 1], first[:, 2] = -sign * row, sign * row
            else:
                first[:, 1], convs[0].bias[unit] = sign * row, sign * linear.offset
            for conv in convs[1:-1]:
                conv.weight[unit, 2 * k, 1], conv.weight[unit, 2 * k + 1, 1] = sign / 1.2, -sign / 1.2
        convs[-1].weight[_SAID[k], 2 * k, 1], convs[-1].weight[_SAID[k], 2 * k + 1, 1] = 1 / 1.2, -1 / 1.2


def solved(plan: RootPlan, items: list[RootItem], folder: Path) -> RootNetwork:
    """The root from the lower body, original and decoded: `tokenizer_root.pt`."""
    torch.manual_seed(plan.seed)
    model = RootNetwork(plan.width, CHANNELS["lower"], plan.layers)
    embed(model, solve(items))
    Saved(folder / "tokenizer_root.pt", model=model).save(1)
    return model.eval()


def rooted(lower: Tensor) -> Tensor:
    """Input of the root network from decoded channels `[..., 61]`: orthonormal rotations, no velocity (SPEC 2.7)."""
    joints = len(feet.NAMES)
    out = lower.clone()
    proper = feet.matrices(lower[..., : 6 * joints].unflatten(-1, (joints, 6)))[..., :2, :]
    out[..., : 6 * joints] = proper.flatten(-3)
    out[..., VELOCITY] = 0.0
    return out
