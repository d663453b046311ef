"""Margins of discrete choices. A case whose smallest margin is below `LEAST` is drawn again."""

from torch import Tensor

LEAST = 1e-3


class Margin:
    """Records the smallest margin."""

    def __init__(self) -> None:
        self.smallest = float("inf")

    def largest(self, scores: Tensor, chosen: int = 1) -> None:
        """The gap between the last chosen and the first refused score of each row, relative to the row's largest."""
        if scores.shape[-1] == chosen or scores.numel() == 0:
            return
        ordered = scores.sort(-1, descending=True).values
        gap = ordered[..., chosen - 1] - ordered[..., chosen]
        self.smallest = min(self.smallest, (gap / scores.abs().amax(-1).clamp(min=1.0)).min().item())

    def nearest(self, squared: Tensor) -> None:
        """The gap between the two smallest squared distances of each row, relative to the second."""
        ordered = squared.sort(-1).values
        self.smallest = min(self.smallest, (1.0 - ordered[..., 0] / ordered[..., 1]).min().item())

    def require(self, holds: bool) -> None:
        """Rejects the case unless a condition holds."""
        if not holds:
            self.smallest = 0.0
