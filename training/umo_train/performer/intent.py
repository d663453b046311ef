"""The arms' intent as one code per frame: the phase of a gesture, and its arm."""

import numpy as np

REST, PREPARE, STROKE, HOLD, RETRACT = range(5)
PHASES = ("rest", "prepare", "stroke", "hold", "retract")
SIDES = ("left", "right", "both")
# Rest, and the other phases of the left arm, the right arm and both.
CODES = 1 + (len(PHASES) - 1) * len(SIDES)
# Priority of phases if the arms are in different ones.
_FIRST = np.argsort([STROKE, PREPARE, HOLD, RETRACT, REST])


def code(phase: int, side: str) -> int:
    """0 is rest for either side."""
    return 0 if phase == REST else 1 + (phase - 1) * len(SIDES) + SIDES.index(side)


def name(code: int) -> str:
    if code == 0:
        return PHASES[REST]
    phase, side = divmod(code - 1, len(SIDES))
    return f"{PHASES[1 + phase]} {SIDES[side]}"


def codes(phases: np.ndarray) -> np.ndarray:
    """Phases of both arms `[2, T]`, left first, to codes `[T]`."""
    left, right = phases
    ahead = _FIRST[right] < _FIRST[left]
    phase = np.where(ahead, right, left)
    side = np.where(left == right, 2, ahead.astype(int))
    return np.where(phase == REST, 0, 1 + (phase - 1) * len(SIDES) + side).astype(np.uint8)
