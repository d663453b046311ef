"""Weights of a model file as floats, in any storage type (docs/model-format.md)."""

from collections.abc import Mapping

import torch
from torch import Tensor

_SCALE = ".scale"
_MULTIPLIERS = ".multipliers"
# Values of a row that share a multiplier, and the offset of an int4 code.
_GROUP = 32
_OFFSET = 8


def floats(stored: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """The tensors `stored` of a file in f32: int8 weights are multiplied by their rows' scales, int4 codes also by
    their groups' multipliers. Bytes of other tensors are left out.

    Int4 tensors are `[rows, inputs]`, whatever their original shape; an odd number of inputs is rounded up, since the
    file does not record it.
    """
    out = {}
    for name, tensor in stored.items():
        owner = next((name.removesuffix(end) for end in (_SCALE, _MULTIPLIERS) if name.endswith(end)), None)
        multipliers = stored.get(name + _MULTIPLIERS)
        if owner in stored or (tensor.dtype == torch.uint8 and multipliers is None):
            continue
        values = tensor.float() if multipliers is None else _int4(tensor, multipliers)
        scale = stored.get(name + _SCALE)
        if scale is not None:
            values = values * scale.float().reshape(-1, *[1] * (values.ndim - 1))
        out[name] = values
    return out


def _int4(codes: Tensor, multipliers: Tensor) -> Tensor:
    """Codes, two in a byte, the first in the low bits, times the multipliers of their groups."""
    values = torch.stack([codes & 15, codes >> 4], -1).flatten(1).float() - _OFFSET
    return values * multipliers.float().repeat_interleave(_GROUP, 1)[:, : values.shape[1]]
