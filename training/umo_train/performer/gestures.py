"""Gestures of both arms: chosen at accents, timed so that a stroke ends on the stressed vowel."""

import numpy as np

from umo_train.performer.arms import FINGERS, STATE, SWIVEL, TILT, TWIST, WRIST, BEND
from umo_train.performer.curves import drift, path
from umo_train.performer.fingers import SHAPES
from umo_train.performer.prosody import Prosody
from umo_train.performer.style import Style


def state(wrist, swivel=0.0, twist=0.3, bend=0.1, tilt=0.0, shape="relaxed") -> np.ndarray:
    """One arm's state from readable values."""
    out = np.empty(STATE)
    out[WRIST], out[SWIVEL], out[TWIST], out[BEND], out[TILT], out[FINGERS] = wrist, swivel, twist, bend, tilt, SHAPES[shape]
    return out


def rest(style: Style, random: np.random.Generator) -> np.ndarray:
    """`[2, STATE]`: arms hanging, elbows a little bent."""
    out = np.stack([state((0.225 + 0.075 * style.openness, -0.475, 0.05), twist=0.35) for _ in range(2)])
    out[:, WRIST] += random.normal(0.0, 0.008, (2, 3))
    return out


def gesticulate(prosody: Prosody, style: Style, random: np.random.Generator) -> np.ndarray:
    """`[2, T, STATE]`."""
    t = prosody.t
    idle = rest(style, random)
    leading = int(random.random() < 0.7)
    out = np.empty((2, len(t), STATE))
    for hand in (0, 1):
        share = 1.0 if hand == leading else 0.5
        chosen = random.random(len(prosody.accents)) < share * (0.15 + 0.75 * style.gesture_rate)
        times, values = [-2.0], [idle[hand]]
        for at in prosody.accents[chosen]:
            size = (0.5 + 0.7 * style.energy) * random.uniform(0.8, 1.2)
            stroke = 0.2 - 0.05 * style.energy
            low = state((0.2 + 0.12 * style.openness, -0.26, 0.26), twist=0.2, bend=-0.1)
            high = low.copy()
            high[WRIST] += np.array([0.02, 0.10, -0.01]) * size
            prepare = max(at - stroke - 0.35, times[-1] + 0.05)
            if at - stroke < prepare + 0.15:
                continue
            if prepare - times[-1] > 1.0 and times[-1] > 0.0:
                times += [times[-1] + 0.2, times[-1] + 0.9]
                values += [values[-1], idle[hand]]
                prepare = max(prepare, times[-1] + 0.02)
            times += [prepare, at - stroke, at]
            values += [values[-1], high, low]
        times += [times[-1] + 0.3, times[-1] + 1.1]
        values += [values[-1], idle[hand]]
        out[hand] = path(t, np.array(times), np.array(values))
    out[..., WRIST] += 0.003 * drift(random, t, 0.1, 0.4, 6).T.reshape(2, 3, -1).swapaxes(1, 2)
    out[..., FINGERS] += 0.02 * drift(random, t, 0.05, 0.3, 14).T.reshape(2, 7, -1).swapaxes(1, 2)
    return out
