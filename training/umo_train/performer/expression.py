"""Brows, cheeks and the mood of the face."""

import numpy as np

from umo_train.performer.curves import bumps, drift, hold_steps
from umo_train.performer.prosody import Prosody
from umo_train.performer.style import Style
from umo_train.skeleton import SHAPE


def feel(out: np.ndarray, prosody: Prosody, style: Style, random: np.random.Generator) -> None:
    """Adds mood and accents to the speaking mouth. A mouth's mood changes as a phrase starts, so pauses stay still."""
    t = prosody.t
    strength = 0.55 + 0.6 * style.energy
    mood = 2.0 * style.mood - 1.0
    smile, stern = max(mood, 0.0) ** 0.7 * strength, max(-mood, 0.0) ** 0.7 * strength
    phrases = prosody.phrases
    levels = random.uniform(0.7, 1.15, len(phrases) + 1)
    level = hold_steps(t, np.concatenate([[-9.0], phrases[:, 0]]), levels[:, None], 0.4)[:, 0]
    # A closing or rounding mouth smiles less.
    free = 1.0 - 0.6 * out[:, SHAPE["mouthPucker"]]
    uneven = random.normal(0.0, 0.06, 4)
    warm, cold = smile * level * free, stern * level

    raised = np.zeros(len(t))
    chosen = random.random(len(prosody.accents)) < 0.3 + 0.35 * style.energy
    if chosen.any():
        size = prosody.weights[chosen] * random.uniform(0.2, 0.45, chosen.sum()) * (0.6 + 0.7 * style.energy)
        raised = (bumps(t, prosody.accents[chosen] + 0.03, 0.22, 0.34) * size).max(axis=1)
    alive = 0.02 * drift(random, t, 0.05, 0.25, 3)

    for k, side in enumerate(("Left", "Right")):
        skew = 1.0 + (uneven[k] if k else -uneven[0])

        changes = {
            "mouthSmile": 0.55 * warm * skew,
            "mouthDimple": 0.12 * warm,
            "mouthFrown": 0.4 * cold * skew,
            "mouthPress": 0.15 * cold,
            "cheekSquint": 0.5 * warm + 0.25 * out[:, SHAPE["mouthSmile" + side]],
            "eyeSquint": 0.2 * warm + 0.3 * cold + np.clip(0.03 + alive[:, 0], 0.0, None),
            "eyeWide": 0.3 * raised + 0.12 * max(style.energy - 0.5, 0.0),
            "browDown": np.clip(0.55 * cold + alive[:, 1] - 0.5 * raised, 0.0, None),
            "browOuterUp": np.clip((0.8 * raised * skew + 0.1 * smile + alive[:, 2]), 0.0, None),
            "noseSneer": 0.12 * cold,
        }
        for name, value in changes.items():
            out[:, SHAPE[name + side]] += value
    shy = max(0.0, 0.3 - style.openness)
    out[:, SHAPE["browInnerUp"]] += np.clip(raised * 0.9 + 0.1 * smile + 0.8 * shy + alive[:, 1], 0.0, None)
