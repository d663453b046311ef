"""Training for int8: products as computed by the engine, with straight-through gradients."""

from functools import partial

import torch
from torch import Tensor, nn
from torch.nn import functional

# Largest magnitude of int8 codes of weights and inputs, as in the engine.
_CODES = 127.0
# Products that stay in float: routers, and those excluded from `umo model quantize`.
_KEPT = ("router", "depth.input", "depth.heard")


def rounded(x: Tensor) -> Tensor:
    """Rounds rows (the last dimension) to multiples of a 127th of their largest value; gradients pass through
    unchanged.
    """
    with torch.no_grad():
        wide = x.float()
        scale = (wide.abs().amax(-1, keepdim=True) / _CODES).clamp(min=1e-12)
        error = ((wide / scale).round() * scale - wide).to(x.dtype)
    return x + error


def _product(linear: nn.Linear, x: Tensor) -> Tensor:
    return functional.linear(rounded(x), rounded(linear.weight), linear.bias)


def _gated_product(linear: nn.Linear, x: Tensor) -> Tensor:
    linear.crest = crest_factor(x) if linear.training and x.requires_grad else None
    return _product(linear, x)


def crest_factor(x: Tensor) -> Tensor:
    """Mean squared logarithm of the crest factor (peak over root mean square) of rows, which determines the error of
    rounding them to int8. 2.3 for normal numbers in rows of 384, 3.9 for products of their GELU with normal numbers."""
    squares = x.float().square()
    return (squares.amax(-1).clamp(min=1e-12) / squares.mean(-1).clamp(min=1e-12)).log().mean()


def round_products(model: nn.Module) -> None:
    """Makes `model` compute every product of the language model as an int8 file does."""
    for name, module in model.named_modules():
        if isinstance(module, nn.Linear) and not any(kept in name for kept in _KEPT):
            product = _gated_product if name.endswith(".wo") else _product
            module.forward = partial(product, module)  # type: ignore[method-assign]
        elif hasattr(module, "rounded"):
            module.rounded = True


def crest_of_gates(model: nn.Module) -> Tensor:
    """Mean `crest_factor` of the last inputs of the gated products (`wo`): a GELU times a linear part has outliers,
    which no rotation can spread. Zero if nothing is rounded."""
    found = [module.crest for module in model.modules() if getattr(module, "crest", None) is not None]
    return torch.stack(found).mean() if found else torch.zeros((), device=next(model.parameters()).device)
