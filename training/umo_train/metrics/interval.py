"""Numbers with their 95 % intervals: bootstrap over recordings, or over groups of them such as speakers."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

DRAWS = 2000


@dataclass(frozen=True)
class Estimate:
    """A number over `count` recordings, and its interval."""

    value: float
    low: float
    high: float
    count: int

    def text(self, places: int = 2, scale: float = 1.0) -> str:
        value, low, high = (f"{number * scale:.{places}f}" for number in (self.value, self.low, self.high))
        return f"{value} ({low} to {high})" if self.count > 1 else value


def bootstrap(rows: np.ndarray, statistic: Callable[[np.ndarray], np.ndarray], seed: int = 0) -> Estimate:
    """`statistic` maps `[..., recordings, columns]` to `[...]`; recordings are drawn again with replacement."""
    drawn = np.random.default_rng(seed).integers(0, len(rows), (DRAWS, len(rows)))
    low, high = np.percentile(statistic(rows[drawn]), (2.5, 97.5))
    return Estimate(float(statistic(rows)), float(low), float(high), len(rows))


def mean(values: np.ndarray) -> Estimate:
    return bootstrap(np.asarray(values, np.float64)[:, None], lambda rows: rows[..., 0].mean(-1))


def grouped_mean(
    values: np.ndarray, groups: Sequence[str], seed: int = 0, weights: np.ndarray | None = None
) -> Estimate:
    """Weighted mean; whole groups are drawn again."""
    index = np.unique(groups, return_inverse=True)[1]
    weights = np.ones(len(values)) if weights is None else weights
    return ratio(np.bincount(index, weights * values), np.bincount(index, weights), seed)


def ratio(values: np.ndarray, references: np.ndarray, seed: int = 0) -> Estimate:
    """Ratio of sums, as of shares whose parts differ in size; NaN if the references are 0."""

    def divided(rows: np.ndarray) -> np.ndarray:
        above, below = rows[..., 0].sum(-1), rows[..., 1].sum(-1)
        return np.divide(above, below, out=np.full(np.shape(below), np.nan), where=np.asarray(below) != 0)

    return bootstrap(np.stack([values, references], 1).astype(np.float64), divided, seed)
