"""One arm's motion over an utterance: movements in time order, chained into gesture phrases, with holds and retraction.

Each movement takes its duration and its path from the stroke in the library with the most similar displacement.
"""

from dataclasses import dataclass

import numpy as np

from umo_train.performer.arms import BEND, STATE, SWIVEL, WRIST
from umo_train.performer.curves import BENDS, path
from umo_train.performer.intent import HOLD, PREPARE, REST, RETRACT, STROKE
from umo_train.performer.strokes import Strokes

# Range of the speed-up or slow-down of a captured movement.
RETIME = (0.7, 1.3)
# Captured movements of one person take longer with their length, to this power.
_POWER = 0.35
# Minimum rest of a hand after a stroke before the next preparation, seconds.
_HOLD_S = 0.02
# Duration of a stroke's recoil and its share of the stroke's length, unless the next movement comes sooner.
_RECOIL_S, _RECOIL = 0.45, 0.16
# Share of the two movements' mean velocities that a hand keeps when turning from preparation into the stroke.
_THROUGH = 0.65
# Minimum seconds per metre of movement: peaks stay below 2.2 m/s.
_S_PER_M = 0.85
_SHORTEST_S, _NO_WAY_M = 0.16, 0.015


@dataclass(frozen=True)
class Way:
    """A captured movement fitted between two states: its own duration, and its bend `[BENDS, STATE]`."""

    seconds: float
    bend: np.ndarray


@dataclass(frozen=True)
class Made:
    """A stroke of an arm: its end, its duration, and the captured duration at its length."""

    at: float
    seconds: float
    captured: float


class ArmTrack:
    """Keys are added in time order; between keys the arm moves with minimum jerk and the captured bend."""

    def __init__(self, idle: np.ndarray, slow: float, library: Strokes, random: np.random.Generator) -> None:
        self.idle, self.slow, self.library, self.random = idle, slow, library, random
        self.times, self.values = [-3.0], [idle]
        self.rates, self.arcs = [np.zeros(STATE)], [np.zeros((BENDS, STATE))]
        # Gesture phase on the way to each key.
        self.phases = [REST]
        self.made: list[Made] = []
        self.raised = False
        # Whether the newest key is the recoil of the one before it.
        self._recoils = False

    @property
    def now(self) -> np.ndarray:
        return self.values[-1]

    @property
    def struck(self) -> np.ndarray:
        """Position of the hand at its last stroke, or its current one."""
        return self.values[-2] if self._recoils else self.values[-1]

    @property
    def until(self) -> float:
        return self.times[-1]

    @property
    def free(self) -> float:
        """Time from which the arm is free."""
        return (self.times[-2] if self._recoils else self.until) + (_HOLD_S if self.raised else 0.0)

    @property
    def _waiting(self) -> int:
        """Phase of an idle arm."""
        return HOLD if self.raised else REST

    def _key(
        self, at: float, value: np.ndarray, phase: int, rate: np.ndarray | None = None, arc: np.ndarray | None = None
    ) -> None:
        self.times.append(max(at, self.times[-1] + 0.03))
        self.values.append(value)
        self.rates.append(np.zeros(STATE) if rate is None else rate)
        self.arcs.append(np.zeros((BENDS, STATE)) if arc is None else arc)
        self.phases.append(phase)

    def way(self, start: np.ndarray, end: np.ndarray) -> Way:
        """A captured movement between two states of the arm."""
        bend = np.zeros((BENDS, STATE))
        far = float(np.linalg.norm(end[WRIST] - start[WRIST]))
        if far < _NO_WAY_M:
            return Way(0.3, bend)
        index = self.library.near(start[WRIST], end[WRIST], self.random)
        long = float(np.linalg.norm(self.library.end[index] - self.library.start[index]))
        seconds = float(self.library.seconds[index]) * (far / long) ** _POWER
        bend[:, WRIST] = np.clip(0.8 * self.library.bent(index, start[WRIST], end[WRIST]), -0.3 * far, 0.3 * far)
        return Way(max(seconds, _SHORTEST_S, _S_PER_M * far), bend)

    def stroke(
        self, at: float, prepared: np.ndarray, struck: np.ndarray, wait: float = 0.0, swing: np.ndarray | None = None
    ) -> bool:
        """Prepares, strokes so that it ends at `at`, and recoils; returns whether there was time for it.

        `wait` is how long the prepared hand waits; without a wait, `swing` is its velocity as it turns into the stroke,
        m/s.
        """
        there = self.way(prepared, struck)
        if self._recoils and at - self.until < (there.seconds + self.way(self.now, prepared).seconds) * 1.2:
            before = self.struck
        else:
            before = self.now
        get_ready = self.way(before, prepared)
        natural = there.seconds + get_ready.seconds
        begin = self.free if before is self.struck else self.until + (_HOLD_S if self.raised else 0.0)
        rather = self.slow * float(self.random.uniform(0.92, 1.08))
        spare = (at - begin) / natural
        if self.raised:
            # A raised hand moves more slowly rather than wait.
            rather = float(np.clip((at - begin - wait - self.random.uniform(0.0, 0.03)) / natural, rather, RETIME[1]))
        factor = min(rather, spare, RETIME[1])
        if factor < RETIME[0]:
            return False
        if before is not self.now:
            self.drop_recoil()
        stroke_s, ready_s = factor * there.seconds, factor * get_ready.seconds
        wait = wait if at - begin >= stroke_s + ready_s + wait else 0.0
        start = at - stroke_s - wait - ready_s
        self._wait(start)
        lift = get_ready.bend.copy()
        lift[0, SWIVEL] += 0.1 * float(np.linalg.norm(prepared[WRIST] - self.now[WRIST]))
        if wait > 0.05:
            self._key(at - stroke_s - wait, prepared, PREPARE, arc=lift)
            self._key(at - stroke_s, prepared, HOLD)
        else:
            rate = np.zeros(STATE)
            # Through the turning point without a stop.
            rate[WRIST] = _THROUGH * (
                (prepared[WRIST] - before[WRIST]) / max(ready_s, 0.2) + (struck[WRIST] - prepared[WRIST]) / stroke_s
            )
            if swing is not None:
                rate[WRIST] += swing
            self._key(at - stroke_s, prepared, PREPARE, rate, lift)
        self._key(at, struck, STROKE, arc=there.bend)
        recoil = struck.copy()
        recoil[WRIST] += _RECOIL * (prepared[WRIST] - struck[WRIST])
        recoil[BEND] += 0.4 * _RECOIL * (prepared[BEND] - struck[BEND])
        self._key(at + _RECOIL_S, recoil, HOLD)
        self.raised = self._recoils = True
        self.made.append(Made(at, stroke_s, there.seconds))
        return True

    def drop_recoil(self) -> None:
        """Removes the recoil, so that the hand continues from the stroke's end."""
        if self._recoils:
            for keys in (self.times, self.values, self.rates, self.arcs, self.phases):
                keys.pop()
            self._recoils = False

    def move(self, at: float, to: np.ndarray, phase: int, raised: bool, slower: float = 1.25) -> None:
        """Moves to a state at a relaxed pace, from `at` or as soon as possible."""
        if at < self.until:
            self.drop_recoil()
        self._recoils = False
        way = self.way(self.now, to)
        self._wait(at)
        self._key(self.until + slower * self.slow * way.seconds, to, phase, arc=0.8 * way.bend)
        self.raised = raised

    def _wait(self, until: float) -> None:
        """A holding hand sinks a little; one that continues at once does not stop."""
        if until - self.until > 0.3 and self.raised:
            self._key(until, self._sunk(0.013), HOLD)
        elif until - self.until > _HOLD_S:
            self._key(until, self.now, self._waiting)

    def retract(self, hold_s: float, to: np.ndarray | None = None) -> None:
        """Holds, then returns to rest, or to another waiting position."""
        if self.raised:
            self.move(self.free + hold_s, self.idle if to is None else to, RETRACT, raised=False, slower=1.2)

    def _sunk(self, metres: float) -> np.ndarray:
        """State of a holding hand after sinking."""
        out = self.now.copy()
        out[WRIST.start + 1] -= metres
        return out

    def curve(self, t: np.ndarray) -> np.ndarray:
        """`[T, STATE]`."""
        return path(t, *(np.array(keys) for keys in (self.times, self.values, self.rates, self.arcs)))

    def phase(self, t: np.ndarray) -> np.ndarray:
        """Gesture phase of the arm, `[T]`."""
        after = np.searchsorted(self.times, t, side="right")
        return np.array([*self.phases, self._waiting])[after]
