"""Voice activity with hysteresis, and the mouth gated by it (SPEC 2.10)."""

import numpy as np

# Probabilities above which a voice starts, and below which it ends.
OPENS, SHUTS = 0.6, 0.4
# Consecutive frames below the second until the mouth shuts.
HOLD = 6
# Opening and closing of the gate per frame.
OPENING, SHUTTING = 0.5, 0.125


def gate(odds: np.ndarray) -> np.ndarray:
    """Log-odds of a voice to the weight of the network's mouth, 0 to 1, for each frame."""
    opened, speaks, without = 0.0, False, 0
    out = np.empty(len(odds))
    for i, probability in enumerate((1.0 / (1.0 + np.exp(-np.asarray(odds, np.float64)))).tolist()):
        without = min(without + 1, HOLD) if probability < SHUTS else 0
        speaks = probability >= OPENS or (speaks and without < HOLD)
        opened = min(opened + OPENING, 1.0) if speaks else max(opened - SHUTTING, 0.0)
        out[i] = opened
    return out


def gated(outputs: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """The network's outputs `[frames, channels + 1]` to channels `[frames, channels]`."""
    follow = gate(outputs[:, -1])[:, None]
    return np.clip(rest + follow * (np.clip(outputs[:, :-1], 0, 1) - rest), 0, 1)
