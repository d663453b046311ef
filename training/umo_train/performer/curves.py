"""Smooth curves over time, each evaluated at all frames at once."""

import numpy as np


def ease(s: np.ndarray) -> np.ndarray:
    """Minimum-jerk step: 0 up to s = 0, 1 from s = 1, at rest at both ends."""
    s = np.clip(s, 0.0, 1.0)
    return s * s * s * (10.0 + s * (6.0 * s - 15.0))


# Number of shapes that can bend the path between two keys.
BENDS = 4


def bends(s: np.ndarray) -> np.ndarray:
    """`[..., BENDS]`: 0 with two derivatives at s = 0 and 1; the first is a bump of height 1, the others oscillate."""
    s = np.asarray(s, float)
    bump = 64.0 * (s * (1.0 - s)) ** 3
    return bump[..., None] * np.cos(np.pi * s[..., None] * np.arange(BENDS))


def bumps(t: np.ndarray, peaks: np.ndarray, rise: np.ndarray | float, fall: np.ndarray | float) -> np.ndarray:
    """`[T, n]`: each column rises to 1 at its peak and falls again."""
    away = t[:, None] - np.asarray(peaks)[None]
    return ease(1.0 - np.where(away < 0.0, -away / rise, away / fall))


def plateaus(t: np.ndarray, start: np.ndarray, end: np.ndarray, rise: float, fall: float) -> np.ndarray:
    """`[T]`: 1 within any of the intervals, eased to 0 over `rise` before and `fall` after them."""
    out = np.ones(len(t))
    for a, b in zip(np.atleast_1d(start), np.atleast_1d(end), strict=True):
        first, last = np.searchsorted(t, (a - rise, b + fall))
        near = t[first:last]
        out[first:last] *= 1.0 - ease((near - a + rise) / rise) * ease((b + fall - near) / fall)
    return 1.0 - out


def path(
    t: np.ndarray, times: np.ndarray, values: np.ndarray, rates: np.ndarray, arcs: np.ndarray | None = None
) -> np.ndarray:
    """Through the rows of `values` at `times` (ascending), at each with the velocity in `rates` and zero acceleration:
    minimum jerk where it is at rest. `arcs` `[n, BENDS, C]` bend the path to each row."""
    at = np.clip(np.searchsorted(times, t, side="right") - 1, 0, max(len(times) - 2, 0))
    after = np.minimum(at + 1, len(times) - 1)
    span = np.maximum(times[after] - times[at], 1e-6)
    s = np.clip((t - times[at]) / span, 0.0, 1.0)
    out = values[at] + ease(s)[:, None] * (values[after] - values[at])
    cubed = s * s * s
    out += (span * (s - cubed * (6.0 - s * (8.0 - 3.0 * s))))[:, None] * rates[at]
    out -= (span * cubed * (4.0 - s * (7.0 - 3.0 * s)))[:, None] * rates[after]
    if arcs is not None:
        out += np.einsum("tk,tkc->tc", bends(s), arcs[after])
    return out


def drift(random: np.random.Generator, t: np.ndarray, low: float, high: float, width: int) -> np.ndarray:
    """`[T, width]` of slow wander between `low` and `high` Hz, of unit variance."""
    waves = 5
    hertz = random.uniform(low, high, (width, waves))
    phase = random.uniform(0.0, 2.0 * np.pi, (width, waves))
    size = random.uniform(0.5, 1.0, (width, waves))
    size *= np.sqrt(2.0 / np.sum(size**2, axis=1, keepdims=True))
    return np.einsum("twk,wk->tw", np.sin(2.0 * np.pi * hertz * t[:, None, None] + phase), size)


def hold_steps(t: np.ndarray, times: np.ndarray, values: np.ndarray, seconds: np.ndarray | float) -> np.ndarray:
    """Row k of `values` from `times[k]` on, reached within `seconds`; the first row before that."""
    times, values = np.asarray(times, float), np.asarray(values, float)
    at = np.maximum(np.searchsorted(times, t, side="right") - 1, 0)
    seconds = np.broadcast_to(seconds, times.shape)[at]
    before = values[np.maximum(at - 1, 0)]
    return before + ease((t - times[at]) / seconds)[:, None] * (values[at] - before)


def overlapping_steps(t: np.ndarray, times: np.ndarray, values: np.ndarray, seconds: np.ndarray | float) -> np.ndarray:
    """Like `hold_steps` if each row is reached before the next starts; otherwise both transitions overlap without a
    jump."""
    moved = np.diff(values, axis=0)
    shares = ease((t[:, None] - times[None, 1:]) / np.broadcast_to(seconds, times.shape)[None, 1:])
    return values[0] + shares @ moved
