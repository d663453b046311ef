"""Brows, cheeks and the mood of the face."""

import numpy as np

from umo_train.performer.curves import bumps, drift, overlapping_steps, plateaus
from umo_train.performer.prosody import Prosody
from umo_train.performer.style import Style
from umo_train.skeleton import SHAPE


def feel(out: np.ndarray, prosody: Prosody, style: Style, random: np.random.Generator) -> None:
    """Adds mood and accents to the speaking mouth. The mouth's mood changes at the start of a phrase, so pauses stay
    still.
    """
    t = prosody.t
    strength = 0.55 + 0.6 * style.energy
    mood = 2.0 * style.mood - 1.0
    smile, stern = max(mood, 0.0) ** 0.7 * strength, max(-mood, 0.0) ** 0.7 * strength
    phrases = prosody.phrases
    levels = random.uniform(0.7, 1.15, len(phrases) + 1)
    level = overlapping_steps(t, np.concatenate([[-9.0], phrases[:, 0]]), levels[:, None], 0.4)[:, 0]
    # A closing or rounding mouth smiles less.
    free = 1.0 - 0.6 * out[:, SHAPE["mouthPucker"]]
    uneven = random.normal(0.0, 0.03, 4)
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


def unsettle(out: np.ndarray, prosody: Prosody, random: np.random.Generator) -> None:
    """Adds irregularity: left and right differ, sideways shifts, breath and swallowing in pauses. Layered over the
    speaking mouth; touching lips stay in contact."""
    t = prosody.t
    talking = plateaus(t, prosody.phrases[:, 0], prosody.phrases[:, 1], 0.15, 0.25) if len(prosody.phrases) else 0.0 * t
    slow, quick = drift(random, t, 0.08, 0.5, 6), drift(random, t, 0.8, 2.2, 3)
    # One side leads slightly, and which one changes slowly; each channel has its own share.
    bias, habit = 0.02 * slow[:, 0], random.normal(0.0, 0.02)
    for name in SHAPE:
        if not name.endswith("Left") or name in ("mouthLeft", "jawLeft") or name.startswith("eye"):
            continue
        own = habit + bias + random.normal(0.0, 0.012)
        out[:, SHAPE[name]] *= 1.0 + own
        out[:, SHAPE[name[:-4] + "Right"]] *= 1.0 - own
    shift = talking * (0.035 * slow[:, 1] + 0.02 * quick[:, 0]) + 0.008 * slow[:, 2]
    grind = talking * (0.025 * slow[:, 3] + 0.012 * quick[:, 1]) + 0.006 * slow[:, 4]
    for name, value in (("mouth", shift), ("jaw", grind)):
        out[:, SHAPE[name + "Left"]] += np.clip(value, 0.0, None)
        out[:, SHAPE[name + "Right"]] += np.clip(-value, 0.0, None)
    sealed = np.clip(out[:, SHAPE["mouthPressLeft"]] / 0.34, 0.0, 1.0)
    # Air behind closed lips, a nose that follows the upper lip, corners that draw in.
    out[:, SHAPE["cheekPuff"]] += 0.07 * sealed * talking * np.clip(1.0 + 0.5 * slow[:, 5], 0.2, None)
    out[:, SHAPE["jawForward"]] += talking * np.clip(0.02 + 0.02 * slow[:, 3] + 0.01 * quick[:, 0], 0.0, None)
    dimple = np.clip(0.03 + 0.04 * slow[:, 4] + 0.02 * quick[:, 2], 0.0, None)
    for k, side in enumerate(("Left", "Right")):
        out[:, SHAPE["noseSneer" + side]] += 0.2 * out[:, SHAPE["mouthUpperUp" + side]]
        out[:, SHAPE["mouthDimple" + side]] += dimple * talking * (1.0 + 0.08 * (-1) ** k)
    _pauses(out, t, 1.0 - talking, random)


def _pauses(out: np.ndarray, t: np.ndarray, silent: np.ndarray, random: np.random.Generator) -> None:
    """Keeps closed lips alive: the jaw moves behind them, and sometimes they press, roll and swallow."""
    wander = drift(random, t, 0.4, 1.4, 4)
    jaw = silent * np.clip(0.018 + 0.012 * wander[:, 0], 0.0, None)
    times = np.cumsum(random.uniform(3.0, 9.0, len(t) // 90 + 2))
    swallow = bumps(t, times, 0.3, 0.45).max(axis=1) * silent
    jaw += 0.035 * swallow
    out[:, SHAPE["jawOpen"]] += jaw
    # Keep the distance of the lips.
    out[:, SHAPE["mouthClose"]] += jaw
    out[:, SHAPE["mouthShrugLower"]] += silent * (np.clip(0.015 + 0.012 * wander[:, 1], 0.0, None) + 0.12 * swallow)
    for side, own in (("Left", wander[:, 2]), ("Right", wander[:, 3])):
        out[:, SHAPE["mouthPress" + side]] += silent * (np.clip(0.015 + 0.012 * own, 0.0, None) + 0.12 * swallow)
