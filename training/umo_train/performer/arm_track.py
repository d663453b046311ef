"""One arm's course over an utterance: key states in time order, with holds, co-articulation and retraction."""

import numpy as np

from umo_train.performer.arms import SWIVEL, WRIST
from umo_train.performer.curves import path

# A hand that waits longer than this between two gestures goes to rest meanwhile.
_PATIENCE_S = 1.3
# The least time between the ends of two strokes of a hand, and of a preparation.
NEXT_STROKE_S, _PREPARE_S = 0.34, 0.17


class ArmTrack:
    """Keys are added in time order; between keys the arm moves with minimum jerk and it is at rest at each."""

    def __init__(self, idle: np.ndarray, ready: np.ndarray, slow: float) -> None:
        self.idle, self.ready, self.slow = idle, ready, slow
        self.times, self.values, self.arcs = [-3.0], [idle], [np.zeros_like(idle)]
        self.raised = False

    @property
    def now(self) -> np.ndarray:
        return self.values[-1]

    @property
    def until(self) -> float:
        return self.times[-1]

    def free(self, at: float) -> bool:
        """Whether a stroke may end at `at`."""
        return at - self.until >= (NEXT_STROKE_S if self.raised else 0.5)

    def key(self, at: float, value: np.ndarray, arc: np.ndarray | None = None) -> None:
        self.times.append(max(at, self.times[-1] + 0.03))
        self.values.append(value)
        self.arcs.append(np.zeros_like(value) if arc is None else arc)

    def gesture(
        self, at: float, prepared: np.ndarray, struck: np.ndarray, stroke_s: float, hold_s: float, late: float, bow: float
    ) -> None:
        """Prepares, strokes so that it ends at `at`, and holds. `late` is how long the prepared hand waits, `bow` how
        far the stroke's path bends outward, in metres."""
        far = float(np.linalg.norm(prepared[WRIST] - self.now[WRIST]))
        travel = self.slow * (0.26 + 0.6 * far)
        begin = at - stroke_s - late - travel
        if self.raised and begin - self.until > _PATIENCE_S:
            self.retract(hold_s, self.ready if begin - self.until < 3.0 else self.idle)
        begin = max(begin, self.until + (0.07 if self.raised else 0.0))
        drawn = min(at - stroke_s, max(begin + _PREPARE_S, begin + travel))
        # No time for the whole way: a smaller preparation from where the hand is.
        share = min(1.0, (drawn - begin) / (0.6 * travel))
        prepared = self.now + share * (prepared - self.now)
        # A hand that holds sinks a little.
        sunk = self.now.copy()
        if self.raised:
            sunk[WRIST.start + 1] -= 0.012
        self.key(begin, sunk)
        lift = np.zeros_like(prepared)
        lift[WRIST.start + 2], lift[SWIVEL] = 0.12 * far, 0.15 * far
        self.key(drawn, prepared, lift)
        if at - stroke_s > self.until + 0.04:
            self.key(at - stroke_s, prepared)
        arc = np.zeros_like(prepared)
        arc[WRIST.start] = bow
        self.key(at, struck, arc)
        self.raised = True

    def retract(self, hold_s: float, to: np.ndarray) -> None:
        """Holds, then goes back to rest."""
        if not self.raised:
            return
        far = float(np.linalg.norm(to[WRIST] - self.now[WRIST]))
        sunk = self.now.copy()
        sunk[WRIST.start + 1] -= 0.015
        self.key(self.until + hold_s, sunk)
        self.key(self.until + self.slow * (0.42 + 1.1 * far), to)
        self.raised = to is self.ready

    def curve(self, t: np.ndarray) -> np.ndarray:
        """`[T, STATE]`."""
        return path(t, np.array(self.times), np.array(self.values), np.array(self.arcs))
