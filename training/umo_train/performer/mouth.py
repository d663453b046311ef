"""The speaking mouth: phones to ARKit mouth channels with coarticulation.

Each phone's dominance is its time span blurred by a Gaussian (a smooth rise and fall over about 100 ms) times its
strength; a channel is the mean of the phones' targets weighted by dominance (Cohen and Massaro 1993). Contacts, which a
mean cannot guarantee, and silence are layered over it.
"""

import numpy as np
from scipy.ndimage import gaussian_filter1d

from umo_train.performer.curves import plateaus
from umo_train.performer.prosody import PAUSE_S, Prosody
from umo_train.performer.style import Style
from umo_train.performer.visemes import CHANNEL, CHANNELS, JAW, REST, ROUND, SHAPE, STRENGTHS, TARGETS, aims
from umo_train.skeleton import ARKIT
from umo_train.skeleton import SHAPE as ARKIT_INDEX
from umo_train.speech.utterance import FRAME_RATE, SILENCE, VOWELS, Utterance

# Dominance is computed at this many points per frame.
_FINE = 4
# Standard deviations of the blur in seconds: rounding starts earlier and lasts longer than the rest.
_BLUR_S = ((JAW, 0.04), (ROUND, 0.052), (SHAPE, 0.04))
# Lips meet for at least two frames at any frame alignment: half of their contact time, travel time, and the shorter
# travel next to a short vowel.
_CONTACT_S, _TRAVEL_S, _HASTE_S = 0.034, 0.095, 0.065
_STRESS_GAIN = (0.88, 1.0, 1.15)
# Vowels are this far below the speech level; a difference of this size goes most of the way to the bounds of the
# opening.
_TYPICAL_DB, _DB = 3.0, 4.0
# People's jaws move less than phones' targets and their lips more: in captured faces, the jaw's deviation is 0.13 of
# its range with the lips' own shapes in addition.
_JAW, _LOWER, _UPPER, _SHRUG = 0.72, 1.5, 1.3, 2.0
# Times before speech at which the lips start to part after a pause, and after speech until they are together, seconds.
_ANTICIPATE_S, _RELAX_S = 0.1, 0.13


def speak(utterance: Utterance, prosody: Prosody, style: Style) -> np.ndarray:
    """`[T, 52]`, of which only mouth and jaw are set."""
    t = prosody.t
    mouth = _coarticulate(utterance)
    gain = _opening_gain(prosody) * (0.84 + 0.32 * style.energy)
    shut = _contacts(utterance, t, "pbm", 0.45)
    bite = _contacts(utterance, t, "fv", 0.5) * (1.0 - shut)
    idle = _silences(utterance, prosody)

    talk = (1.0 - idle)[:, None]
    mouth = REST + talk * (mouth - REST)
    column = {name: mouth[:, index] for name, index in CHANNEL.items()}
    jaw = _JAW * column["jawOpen"] * (1.0 + (gain - 1.0) * talk[:, 0]) * (1.0 - 0.45 * shut) * (1.0 - 0.4 * bite)
    parted = 1.0 - shut
    lips = gain * parted
    sealed = 1.0 - parted * (1.0 - idle)

    out = np.zeros((len(t), len(ARKIT)))

    def put(name: str, value: np.ndarray) -> None:
        for side in ("Left", "Right") if name + "Left" in ARKIT_INDEX else ("",):
            out[:, ARKIT_INDEX[name + side]] = value

    put("jawOpen", jaw)
    put("jawForward", column["jawForward"] + 0.02 * bite)
    put("mouthClose", jaw * sealed)
    put("mouthFunnel", column["mouthFunnel"] * (1.0 - 0.8 * shut) * (1.0 - 0.5 * bite))
    put("mouthPucker", column["mouthPucker"] * (1.0 - 0.5 * shut))
    put("mouthStretch", column["mouthStretch"] * (1.0 - 0.5 * shut))
    put("mouthSmile", column["mouthSmile"] * (1.0 - 0.5 * shut))
    put("mouthLowerDown", _LOWER * column["mouthLowerDown"] * lips * (1.0 - bite))
    put("mouthUpperUp", _UPPER * column["mouthUpperUp"] * lips)
    put("mouthShrugLower", _SHRUG * column["mouthShrugLower"] + 0.06 * shut)
    put("mouthShrugUpper", _SHRUG * column["mouthShrugUpper"] + 0.13 * shut)
    put("tongueOut", column["tongueOut"] * parted)
    put("mouthPress", 0.34 * shut + 0.05 * idle)
    put("mouthRollLower", 0.24 * shut + 0.5 * bite + 0.02 * idle)
    put("mouthRollUpper", 0.2 * shut)
    return out


def _coarticulate(utterance: Utterance) -> np.ndarray:
    """`[T, len(CHANNELS)]`: targets weighted by dominance."""
    rows, gains, ends = [], [], []
    for phone in utterance.phones:
        at = phone.start
        for row, share in aims(phone.name):
            at += share * (phone.end - phone.start)
            rows.append(row)
            gains.append(_STRESS_GAIN[phone.stress] if phone.name in VOWELS else 1.0)
            ends.append(at)
    frames, rate = utterance.frames, FRAME_RATE * _FINE
    targets, strengths = TARGETS[rows], STRENGTHS[rows]
    targets[:, CHANNEL["jawOpen"]] *= gains
    edges = np.round(np.array(ends) * rate).astype(int)
    edges[-1] = max(edges[-1], frames * _FINE + 1)
    span = np.repeat(np.arange(len(rows)), np.diff(edges, prepend=0))
    strong, aimed = strengths[span], (strengths * targets)[span]
    out = np.empty((frames, len(CHANNELS)))
    for channels, seconds in _BLUR_S:
        columns, sigma = list(channels), seconds * rate
        # All channels of a group share their dominance.
        total = gaussian_filter1d(strong[:, columns[0]], sigma, mode="nearest")[::_FINE][:frames]
        blurred = gaussian_filter1d(aimed[:, columns], sigma, axis=0, mode="nearest")[::_FINE][:frames]
        out[:, columns] = blurred / total[:, None]
    return out


def _opening_gain(prosody: Prosody) -> np.ndarray:
    """0.55 .. 1.45 depending on the loudness of phrase and syllable."""
    db = 0.4 * prosody.slow_db + 0.6 * prosody.syllabic_db + _TYPICAL_DB
    return 1.0 + 0.45 * np.tanh(db / _DB)


def _contacts(utterance: Utterance, t: np.ndarray, names: str, centre: float) -> np.ndarray:
    """1 while one of these phones holds its contact."""
    out = np.ones(len(t))
    phones = utterance.phones
    for k, phone in enumerate(phones):
        if phone.name not in tuple(names):
            continue
        length = phone.end - phone.start
        middle, half = phone.start + centre * length, max(0.3 * length, _CONTACT_S)
        # Leave room for neighbours: a vowel is free at its middle, another sound at its far end.
        before, after = phones[max(k - 1, 0)], phones[min(k + 1, len(phones) - 1)]
        since = before.start + (0.5 * (before.end - before.start) if before.name in VOWELS else 0.0)
        until = after.end - (0.5 * (after.end - after.start) if after.name in VOWELS else 0.0)
        rise = np.clip(middle - half - since, _HASTE_S, _TRAVEL_S)
        fall = np.clip(until - middle - half, _HASTE_S, _TRAVEL_S)
        out *= 1.0 - plateaus(t, middle - half, middle + half, rise, fall)
    return 1.0 - out


def _silences(utterance: Utterance, prosody: Prosody) -> np.ndarray:
    """1 where the mouth is at rest."""
    out = np.zeros(len(prosody.t))
    t = prosody.t
    for phone in utterance.phones:
        if phone.name == SILENCE and phone.end - phone.start >= PAUSE_S:
            first, last = phone.start <= 0.0, phone.end >= utterance.seconds - 1e-3
            start = phone.start - 1.0 if first else phone.start + 0.6 * _RELAX_S
            end = phone.end + 1.0 if last else phone.end - 0.7 * _ANTICIPATE_S
            rest = plateaus(t, start, max(end, start), _RELAX_S, _ANTICIPATE_S)
            out = 1.0 - (1.0 - out) * (1.0 - rest)
    return out
