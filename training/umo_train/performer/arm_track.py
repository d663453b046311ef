"""One arm's course over an utterance: key states in time order, with holds, co-articulation and retraction."""

import numpy as np

from umo_train.performer.arms import BEND, SWIVEL, WRIST
from umo_train.performer.curves import path
from umo_train.performer.intent import HOLD, PREPARE, REST, RETRACT, STROKE

# A hand that waits longer than this between two gestures goes to rest meanwhile.
_PATIENCE_S = 1.3
# A hand that has struck rests at least so long before the next preparation.
_HOLD_S = 0.03
# A stroke recoils over this time, by this share of its way, unless the next gesture comes sooner.
_RECOIL_S, _RECOIL = 0.34, 0.2
# Seconds a stroke needs for each metre: peaks stay under 2.4 m/s.
_S_PER_M = 0.8


class ArmTrack:
    """Keys are added in time order; between keys the arm moves with minimum jerk."""

    def __init__(self, idle: np.ndarray, ready: np.ndarray, slow: float, stroke_s: float) -> None:
        self.idle, self.ready, self.slow, self.stroke_s = idle, ready, slow, stroke_s
        zero = np.zeros_like(idle)
        self.times, self.values, self.rates, self.arcs = [-3.0], [idle], [zero], [zero]
        # What the arm does on the way to each key.
        self.phases = [REST]
        self.raised = False
        # The newest key is the recoil of the one before it.
        self._recoils = False

    @property
    def now(self) -> np.ndarray:
        return self.values[-1]

    @property
    def until(self) -> float:
        return self.times[-1]

    @property
    def _waiting(self) -> int:
        """What an arm does that has nothing to do."""
        return HOLD if self.raised else REST

    def _key(
        self,
        at: float,
        value: np.ndarray,
        phase: int,
        rate: np.ndarray | None = None,
        arc: np.ndarray | None = None,
    ) -> None:
        zero = np.zeros_like(value)
        self.times.append(max(at, self.times[-1] + 0.03))
        self.values.append(value)
        self.rates.append(zero if rate is None else rate)
        self.arcs.append(zero if arc is None else arc)
        self.phases.append(phase)

    def _travel(self, to: np.ndarray) -> float:
        """Seconds to get there unhurried."""
        return self.slow * (0.2 + 0.75 * float(np.linalg.norm(to[WRIST] - self.now[WRIST])))

    def _stroke(self, prepared: np.ndarray, struck: np.ndarray) -> float:
        return max(self.stroke_s, _S_PER_M * float(np.linalg.norm(struck[WRIST] - prepared[WRIST])))

    def fits(self, at: float, prepared: np.ndarray, struck: np.ndarray) -> bool:
        """Whether there is time for a stroke that ends at `at`."""
        begin = self.times[-2] if self._recoils else self.until
        spare = at - begin - (_HOLD_S if self.raised else 0.0)
        return spare >= self._stroke(prepared, struck) + 0.75 * self._travel(prepared)

    def gesture(
        self, at: float, prepared: np.ndarray, struck: np.ndarray, late: float, swing: np.ndarray, bow: float
    ) -> None:
        """Prepares, strokes so that it ends at `at`, and recoils.

        `late` is how long the prepared hand waits; where it does not, `swing` is its velocity as it turns into the
        stroke, m/s. `bow` is how far the stroke's path bends outward, m.
        """
        stroke_s = self._stroke(prepared, struck)
        ready_by = at - stroke_s - late
        if self._recoils and ready_by - self._travel(prepared) < self.until:
            for keys in (self.times, self.values, self.rates, self.arcs, self.phases):
                keys.pop()
        if self.raised and ready_by - self._travel(prepared) - self.until > _PATIENCE_S:
            pause = ready_by - self._travel(prepared) - self.until
            self.retract(0.3, self.ready if pause < 3.5 else self.idle)
        earliest = self.until + (_HOLD_S if self.raised else 0.0)
        if ready_by - self._travel(prepared) < earliest:
            ready_by = at - stroke_s
            late = 0.0
        begin = max(ready_by - self._travel(prepared), earliest)
        far = float(np.linalg.norm(prepared[WRIST] - self.now[WRIST]))
        self._key(begin, self._sunk(0.012) if self.raised else self.now, self._waiting)
        lift, bend = np.zeros_like(prepared), np.zeros_like(prepared)
        lift[WRIST.start + 2], lift[SWIVEL] = 0.12 * far, 0.1 * far
        bend[WRIST.start] = bow
        if late > 0.03:
            self._key(ready_by, prepared, PREPARE, arc=lift)
            self._key(at - stroke_s, prepared, HOLD)
        else:
            rate = np.zeros_like(prepared)
            rate[WRIST] = swing
            self._key(at - stroke_s, prepared, PREPARE, rate, lift)
        self._key(at, struck, STROKE, arc=bend)
        recoil = struck.copy()
        recoil[WRIST] += _RECOIL * (prepared[WRIST] - struck[WRIST])
        recoil[BEND] += 0.4 * _RECOIL * (prepared[BEND] - struck[BEND])
        self._key(at + _RECOIL_S, recoil, HOLD)
        self.raised = self._recoils = True

    def rise(self, at: float) -> None:
        """From idle to where the hand waits, before there is anything to stress."""
        if self.ready is not self.idle:
            self._key(at, self.idle, REST)
            self._key(at + 1.3 * self._travel(self.ready), self.ready, PREPARE)
            self.raised = True

    def retract(self, hold_s: float, to: np.ndarray) -> None:
        """Holds, then goes back to rest."""
        if not self.raised:
            return
        self._recoils = False
        travel = 0.2 * self.slow + 1.35 * self._travel(to)
        self._key(self.until + hold_s, self._sunk(0.015), HOLD)
        # Around the hip.
        arc = np.zeros_like(to)
        arc[WRIST.start] = 0.04
        self._key(self.until + travel, to, RETRACT, arc=arc)
        self.raised = to is self.ready and to is not self.idle

    def _sunk(self, metres: float) -> np.ndarray:
        """A hand that holds sinks a little."""
        out = self.now.copy()
        out[WRIST.start + 1] -= metres
        return out

    def curve(self, t: np.ndarray) -> np.ndarray:
        """`[T, STATE]`."""
        return path(t, *(np.array(keys) for keys in (self.times, self.values, self.rates, self.arcs)))

    def phase(self, t: np.ndarray) -> np.ndarray:
        """The phase of a gesture that the arm is in, `[T]`."""
        after = np.searchsorted(self.times, t, side="right")
        return np.array([*self.phases, self._waiting])[after]
