"""Training for int8: products as the engine computes them, with gradients as if nothing were rounded."""

from functools import partial

import torch
from torch import Tensor, nn
from torch.nn import functional

# Largest code of int8 weights and inputs, as the engine rounds them.
_CODES = 127.0
# Products that stay in float: what routes, and what `umo quantize` is told to keep.
_KEPT = ("router", "depth.input", "depth.heard")


def rounded(x: Tensor) -> Tensor:
    """Rows (the last dimension) as multiples of a 127th of their largest value; gradients go through unchanged."""
    with torch.no_grad():
        wide = x.float()
        scale = (wide.abs().amax(-1, keepdim=True) / _CODES).clamp(min=1e-12)
        error = ((wide / scale).round() * scale - wide).to(x.dtype)
    return x + error


def _product(linear: nn.Linear, x: Tensor) -> Tensor:
    return functional.linear(rounded(x), rounded(linear.weight), linear.bias)


def round_products(model: nn.Module) -> None:
    """From here on `model` computes every product of the language model as an int8 file does."""
    for name, module in model.named_modules():
        if isinstance(module, nn.Linear) and not any(kept in name for kept in _KEPT):
            module.forward = partial(_product, module)  # type: ignore[method-assign]
        elif hasattr(module, "rounded"):
            module.rounded = True
