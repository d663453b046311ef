"""Gestures of both arms: phrases of chained strokes, each timed to end on a stressed vowel."""

from dataclasses import dataclass, replace

import numpy as np

from umo_train.performer import strokes
from umo_train.performer.arm_track import ArmTrack, Made
from umo_train.performer.arms import BEND, FINGERS, STATE, SWIVEL, TILT, TWIST, WRIST
from umo_train.performer.curves import drift, plateaus
from umo_train.performer.fingers import SHAPES
from umo_train.performer.intent import PREPARE
from umo_train.performer.prosody import Prosody
from umo_train.performer.strokes import Strokes
from umo_train.performer.style import Style
from umo_train.speech.utterance import FRAME_RATE

# Range of the wrists, in radians.
LIMITS = {TWIST: (-1.5, 1.5), BEND: (-1.0, 1.1), TILT: (-0.35, 0.4)}
# Space of gesturing hands: outward, up and forward of the midpoint between the shoulders, m.
_LOW, _HIGH = np.array([0.07, -0.40, 0.19]), np.array([0.37, -0.05, 0.41])
# Positions of idle hands.
RESTS = ("hanging", "clasped", "loose", "across", "hip")
_COUNTING = ("point", "two", "three")
# A pause of at least this length ends a gesture phrase, seconds.
_PAUSE_S = 1.1
# With more time than this before the next stroke, a raised hand moves elsewhere, seconds.
_ROAM_S = 1.0
# Between phrases closer than this the hands stay up, seconds.
_STAY_S = 0.9
# Delay of hand and fingers behind the wrist, seconds.
_TRAIL_S = 0.05


@dataclass(frozen=True)
class Gestures:
    """The arms' states `[2, T, STATE]`, left first, the shrug of the shoulders `[T]`, the phases of both arms' gestures
    `[2, T]`, and the strokes of each arm."""

    states: np.ndarray
    shrug: np.ndarray
    phases: np.ndarray
    made: tuple[list[Made], list[Made]]


@dataclass(frozen=True)
class Phrase:
    """A gesture phrase: accents from `first` to before `last`, the leading hand, the other hand's participation (0..1),
    the hand shape, twist and position of the phrase, and its size."""

    first: int
    last: int
    leading: int
    other: float
    shape: str
    twist: float
    place: np.ndarray
    size: float


def state(
    wrist: tuple[float, float, float], swivel=0.0, twist=0.3, bend=0.1, tilt=0.0, shape: str = "relaxed"
) -> np.ndarray:
    """One arm's state from named values."""
    out = np.empty(STATE)
    out[WRIST], out[SWIVEL], out[TWIST], out[BEND], out[TILT] = wrist, swivel, twist, bend, tilt
    out[FINGERS] = SHAPES[shape]
    return out


def rest(kind: str, style: Style, random: np.random.Generator) -> list[np.ndarray]:
    """Both arms, left first, in one of `RESTS`."""
    o = style.openness
    hang = state((0.205 + 0.09 * o, -0.478 + 0.02 * o, 0.05), swivel=0.4 * o, twist=0.35)
    one, other = random.permutation(2)
    out = [hang.copy(), hang.copy()]
    if kind == "clasped":
        # In front of the belly: one hand lies in the other.
        out[one] = state((0.115, -0.3, 0.25), swivel=0.15, twist=0.35, bend=0.25)
        out[other] = state((0.105, -0.33, 0.205), swivel=0.15, twist=0.1, bend=0.3)
    elif kind == "loose":
        # Fingertips pointing at each other, apart.
        out = [state((0.165, -0.32, 0.235), swivel=0.2, twist=-0.15, bend=0.15) for _ in range(2)]
        out[one][WRIST] += (0.01, -0.03, -0.02)
    elif kind == "across":
        out[one] = state((0.1, -0.31, 0.225), swivel=0.1, twist=0.35, bend=0.1)
    elif kind == "hip":
        out[one] = state((0.24, -0.385, 0.0), swivel=1.3, twist=-0.5, bend=0.65, tilt=0.2)
    elif kind != "hanging":
        raise KeyError(kind)
    near = kind == "clasped"
    for arm in out:
        arm[WRIST] += random.normal(0.0, 0.004 if near else 0.012, 3)
        arm[TWIST] += random.normal(0.0, 0.06)
        arm[FINGERS] *= random.uniform(0.8, 1.3)
    return out


def choose_rest(style: Style, random: np.random.Generator) -> str:
    """A rest that suits the style: shy people hold on to themselves, open ones stand openly."""
    o = style.openness
    shares = np.array([0.9 + 1.6 * o, 1.0 - 0.6 * o, 0.9, 0.6, 0.35 * o])
    return str(random.choice(RESTS, p=shares / shares.sum()))


def _poses(kind: str, style: Style, size: float, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Position of a hand before and after the stroke of a gesture."""
    o, side = style.openness, random.normal(0.0, 0.025)
    high = 0.03 * random.normal() + 0.05 * (style.energy - 0.5)
    out = 0.05 * random.normal() + 0.13 * (o - 0.4)
    if kind == "beat":
        end = state((0.2 + out, -0.27 + high, 0.28), twist=random.uniform(0.1, 0.9), bend=0.15)
        start = end.copy()
        start[WRIST] += np.array([0.02, 0.13, -0.015]) * size
        start[BEND] -= 0.35
    elif kind == "pinch":
        end = state((0.17 + 0.7 * out, -0.2 + high, 0.33), twist=0.35, bend=0.05, shape="pinch")
        start = end.copy()
        start[WRIST] += np.array([0.0, 0.09, -0.05]) * size
        start[BEND] -= 0.3
    elif kind == "chop":
        end = state((0.16 + 0.6 * out, -0.29 + high, 0.33), twist=0.05, bend=0.0, tilt=-0.15, shape="flat")
        start = end.copy()
        start[WRIST] += np.array([0.02, 0.17, -0.05]) * size
        start[TILT] = 0.3
    elif kind == "fist":
        end = state((0.18 + 0.6 * out, -0.24 + high, 0.3), twist=0.2, bend=0.1, shape="fist")
        start = end.copy()
        start[WRIST] += np.array([0.03, 0.13, -0.05]) * size
    elif kind == "sweep":
        palm = random.choice((-0.9, 1.1))
        start = state((0.1 + side, -0.2 + high, 0.29), twist=0.4 * palm, bend=0.1, shape="open")
        end = state((0.3 + out + 0.12 * size, -0.24 + high, 0.27), swivel=0.2, twist=palm, bend=-0.15, shape="open")
    elif kind == "open":
        end = state((0.27 + out + 0.05 * size, -0.3 + high, 0.3), twist=-1.2, bend=-0.1, shape="open")
        start = state((0.16 + 0.5 * out, -0.2 + high, 0.24), twist=-0.3, bend=0.2)
    elif kind == "frame":
        end = state((0.13 + 0.7 * out, -0.25 + high, 0.31), twist=0.05, bend=0.1, shape="open")
        start = end.copy()
        start[WRIST] += np.array([-0.03, 0.11, -0.03]) * size
    elif kind == "point":
        end = state((0.2 + out, -0.16 + high, 0.38 + 0.05 * size), twist=0.8, bend=0.0, shape="point")
        start = state((0.24 + out, -0.08 + high, 0.22), twist=0.3, bend=-0.2, shape="point")
    elif kind == "count":
        end = state((0.22 + 0.6 * out, -0.1 + high, 0.28), twist=0.7, bend=-0.1, shape="point")
        start = end.copy()
        start[WRIST] += np.array([0.01, 0.08, -0.06]) * size
        start[BEND] -= 0.25
    elif kind == "shrug":
        end = state((0.33 + out, -0.27 + high, 0.2), swivel=-0.1, twist=-1.3, bend=-0.35, shape="open")
        start = state((0.24 + out, -0.35, 0.2), twist=-0.4, bend=0.1)
    else:
        raise KeyError(kind)
    # Not in front of the face.
    for pose in (start, end):
        pose[WRIST.start + 1] = min(pose[WRIST.start + 1], -0.05)
    return start, end


def _kind(style: Style, random: np.random.Generator) -> str:
    stern = max(0.0, 0.5 - style.mood) * 2.0
    weights = {
        "beat": 1.0,
        "pinch": 0.5,
        "chop": 0.2 + 1.2 * stern,
        "fist": 0.05 + 0.5 * stern + 0.15 * max(0.0, style.energy - 0.6),
        "sweep": 0.2 + 0.9 * style.openness,
        "open": 0.15 + 1.3 * style.openness,
        "frame": 0.3 + 0.5 * style.openness,
        "point": 0.1 + 0.4 * style.energy + 0.5 * stern,
        "count": 0.05 + 0.4 * max(0.0, style.gesture_rate - 0.4),
        "shrug": 0.3 * style.openness * style.mood + 0.04,
    }
    share = np.cumsum(list(weights.values()))
    return list(weights)[int(np.searchsorted(share, random.random() * share[-1]))]


def plan(prosody: Prosody, style: Style, random: np.random.Generator) -> list[Phrase]:
    """Gesture phrases of about 2 to 6 s, with shorter rests for more frequent gestures."""
    accents, rate = prosody.accents, style.gesture_rate
    usual = int(random.random() < 0.7)
    both = 0.45 + 0.25 * style.openness + 0.15 * style.energy + 0.3 * rate
    out: list[Phrase] = []
    index, rest_until = 0, random.exponential(1.5 * (1.0 - rate) ** 2)
    while index < len(accents):
        if accents[index] < rest_until:
            index += 1
            continue
        seconds = float(np.clip(random.lognormal(np.log(3.2 + 1.8 * rate), 0.35), 2.0, 7.5))
        last = index + 1
        while last < len(accents) and accents[last] < accents[index] + seconds and not _paused(prosody, last):
            last += 1
        while last < min(index + 3, len(accents)) and accents[last] < accents[last - 1] + 1.6:
            # A single stroke is not a phrase.
            last += 1
        leading = usual if random.random() < 0.75 else 1 - usual
        other = 0.0 if random.random() > both else float(random.uniform(0.5, 0.95))
        place = _home(style) + random.normal(0.0, 1.0, 3) * np.array([0.035, 0.035, 0.025])
        size = (0.58 + 0.78 * style.energy) * random.uniform(0.85, 1.2)
        shape = _shape(style, random)
        out.append(
            Phrase(index, last, leading, other, shape, random.choice((-1.05, -0.7, -0.3, 0.1, 0.5)), place, size)
        )
        rest_until = accents[last - 1] + 0.25 + random.exponential(0.3 + 8.0 * (1.0 - rate) ** 1.8)
        index = last
    return out


def _paused(prosody: Prosody, index: int) -> bool:
    """Whether there is a long pause before an accent."""
    phrase = int(np.searchsorted(prosody.phrases[:, 0], prosody.accents[index], side="right")) - 1
    if phrase < 1 or prosody.accents[index - 1] > prosody.phrases[phrase, 0]:
        return False
    return prosody.phrases[phrase, 0] - prosody.phrases[phrase - 1, 1] > _PAUSE_S


def _home(style: Style) -> np.ndarray:
    return np.array([0.2 + 0.14 * (style.openness - 0.4), -0.25 + 0.05 * (style.energy - 0.5), 0.29])


def _shape(style: Style, random: np.random.Generator) -> str:
    shares = {"relaxed": 1.0, "open": 0.4 + 0.8 * style.openness, "pinch": 0.35, "flat": 0.3, "point": 0.12}
    names = list(shares)
    return str(random.choice(names, p=np.array(list(shares.values())) / sum(shares.values())))


def gesticulate(prosody: Prosody, style: Style, random: np.random.Generator) -> Gestures:
    """Performs the phrases: at each accent a stroke, a smaller beat, or a hold."""
    t, energy = prosody.t, style.energy
    library = strokes.library()
    idle = rest(choose_rest(style, random), style, random)
    tracks = [ArmTrack(idle[k], 1.15 - 0.3 * energy, library, random) for k in (0, 1)]
    shrugs: list[float] = []
    phrases = plan(prosody, style, random)
    for number, phrase in enumerate(phrases):
        _perform(phrase, prosody, style, tracks, shrugs, random)
        following = prosody.accents[phrases[number + 1].first] if number + 1 < len(phrases) else np.inf
        if following - prosody.accents[phrase.last - 1] > 2.0 and random.random() < 0.5:
            idle = rest(choose_rest(style, random), style, random)
        # Both go down at nearly the same time.
        down = max((track.free for track in tracks if track.raised), default=0.0)
        down += min(float(random.choice(library.hold)), 0.6) if random.random() < 0.5 else 0.0
        for hand, track in enumerate(tracks):
            gap = following - down
            if gap < _STAY_S + 0.9:
                _roam(track, float(following), phrase, random)
                continue
            low = idle[hand]
            if gap < 2.0 + 4.0 * max(style.gesture_rate - 0.5, 0.0) and random.random() < style.gesture_rate:
                # Needed again soon: it only sinks to its waiting position.
                low = _waiting_place(phrase.place, random)
            track.retract(max(down - track.free, 0.0) + random.uniform(0.0, 0.08), low)
    for hand, track in enumerate(tracks):
        track.retract(random.uniform(0.3, 0.6), idle[hand])
        if track.now is not idle[hand]:
            track.raised = True
            track.retract(0.8, idle[hand])
    phases = np.stack([track.phase(t) for track in tracks])
    return Gestures(
        _alive(tracks, t, energy, random), _shrug(t, shrugs, energy), phases, (tracks[0].made, tracks[1].made)
    )


def _waiting_place(place: np.ndarray, random: np.random.Generator) -> np.ndarray:
    out = state((0.13, -0.36, 0.24), twist=0.35, bend=0.05)
    out[WRIST] += random.normal(0.0, 0.015, 3) + 0.3 * (place - np.array([0.2, -0.25, 0.29]))
    out[TWIST] += random.normal(0.0, 0.15)
    return out


def _perform(
    phrase: Phrase, prosody: Prosody, style: Style, tracks: list[ArmTrack], shrugs: list[float],
    random: np.random.Generator,
) -> None:  # fmt: skip
    """One phrase: strokes of the leading hand, some of them joined by the other."""
    follows = 0.8 + 0.2 * style.gesture_rate
    kind, counted = "", 0
    for number in range(phrase.first, phrase.last):
        at, weight = float(prosody.accents[number]), float(prosody.weights[number])
        edge = number in (phrase.first, phrase.last - 1)
        if not edge and random.random() > follows:
            continue
        size = phrase.size * min(random.uniform(0.75, 1.2) * weight, 1.35)
        drawn = random.random()
        if 0 < counted < len(_COUNTING):
            kind = "count"
        elif drawn < 0.24 and kind not in ("", "count"):
            kind = "again"
        elif drawn < 0.66:
            kind = "captured"
        else:
            kind = _kind(style, random)
        counted = counted % len(_COUNTING) + 1 if kind == "count" else 0
        lead = phrase.leading
        _roam(tracks[lead], at, phrase, random)
        start, end, partner = _pair(kind, phrase, style, size, tracks[lead], random)
        if kind == "count":
            start[FINGERS] = end[FINGERS] = SHAPES[_COUNTING[counted - 1]]
        done = _strike(tracks[lead], at, start, end, size, random)
        if not done:
            # No time to get there: a smaller stroke at the hand's position.
            start, end = _again(tracks[lead].struck, 0.55 * size, random)
            done = tracks[lead].raised and _strike(tracks[lead], at, start, end, size, random)
        if done and kind == "shrug":
            shrugs.append(at)
        together = kind in ("frame", "shrug") or (kind != "count" and random.random() < phrase.other)
        if done and together:
            _join(tracks[1 - lead], at, start, end, partner, phrase, size, random)
            continue
        second = tracks[1 - lead]
        if second.raised and random.random() < 0.9:
            # It moves along a little.
            _strike(second, at, *_again(second.struck, 0.5 * size, random), size, random)
        _roam(second, at + 0.3, phrase, random)
        if done and tracks[1 - lead].raised and at - tracks[1 - lead].until > 0.7 and random.random() < 0.3:
            # An uninvolved hand goes down.
            tracks[1 - lead].retract(0.1)


def _roam(track: ArmTrack, until: float, phrase: Phrase, random: np.random.Generator) -> None:
    """With much time before the next stroke, a raised hand moves elsewhere meanwhile."""
    while track.raised and until - track.free > _ROAM_S:
        to = track.struck.copy()
        way = random.normal(0.0, 1.0, 3) * np.array([0.1, 0.08, 0.06])
        way *= max(1.0, (0.1 + 0.06 * phrase.size) / float(np.linalg.norm(way)))
        to[WRIST] = _inside(phrase.place + 0.4 * (to[WRIST] - phrase.place) + way * (0.5 + 0.5 * phrase.size))
        to[TWIST] += random.normal(0.0, 0.25)
        track.move(track.free + random.choice((0.0, 0.0, random.uniform(0.1, 0.3))), to, PREPARE, raised=True)


def _pair(
    kind: str, phrase: Phrase, style: Style, size: float, track: ArmTrack, random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, int]:
    """Position of a hand before and after a stroke, and for a captured one the index of the other arm's movement in the
    library, or -1."""
    if kind == "again" and track.raised:
        return *_again(track.struck, size, random), -1
    if kind in ("captured", "again"):
        index = _near(phrase, size, track, random)
        return *_captured(index, phrase, size, track, random), int(track.library.partner[index])
    start, end = _poses(kind, style, size, random)
    shift = 0.8 * (phrase.place - _home(style))
    for pose in (start, end):
        pose[WRIST] = _inside(pose[WRIST] + shift)
    return start, end, -1


def _raised(library: Strokes) -> np.ndarray:
    """Which movements are of raised arms."""
    return (library.end[:, 1] > -0.36) & (library.start[:, 1] > -0.44)


def _drawn_in(library: Strokes, phrase: Phrase, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Starts and ends of all movements, moved into the space of gestures."""
    scale, middle = 0.52 + 0.22 * size, library.end[_raised(library)].mean(axis=0)
    return phrase.place + scale * (library.start - middle), phrase.place + scale * (library.end - middle)


def _near(phrase: Phrase, size: float, track: ArmTrack, random: np.random.Generator) -> int:
    """A movement of the library that starts near the hand."""
    start, end = _drawn_in(track.library, phrase, size)
    here = track.struck[WRIST] if track.raised else phrase.place + np.array([0.0, 0.06, -0.02])
    far = np.linalg.norm(_inside(start) - here, axis=1) + 0.25 * np.linalg.norm(_inside(end) - phrase.place, axis=1)
    # Strokes mostly go down, outward or forward.
    far += np.where(end[:, 1] - start[:, 1] > 0.06, 0.06, 0.0) + np.where(_raised(track.library), 0.0, 9.0)
    return int(random.choice(np.argpartition(far, 12)[:12]))


def _captured(
    index: int, phrase: Phrase, size: float, track: ArmTrack, random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Start and end of a movement of the library."""
    start, end = _drawn_in(track.library, phrase, size)
    turn = phrase.twist + random.normal(0.0, 0.2)
    out = []
    for place, twist, bend in ((start[index], turn - 0.25, -0.12), (end[index], turn + random.normal(0.1, 0.2), 0.1)):
        pose = state(tuple(_inside(place)), twist=twist, bend=bend + random.normal(0.0, 0.08), shape=phrase.shape)
        pose[FINGERS] *= random.uniform(0.85, 1.15)
        out.append(pose)
    return out[0], out[1]


def _inside(place: np.ndarray) -> np.ndarray:
    """Moved into the space of gestures, smoothly near its bounds."""
    middle, half = 0.5 * (_LOW + _HIGH), 0.5 * (_HIGH - _LOW)
    away = (place - middle) / half
    return middle + half * np.where(
        np.abs(away) < 0.6, away, np.sign(away) * (0.6 + 0.4 * np.tanh((np.abs(away) - 0.6) / 0.4))
    )


def _strike(
    track: ArmTrack, at: float, start: np.ndarray, end: np.ndarray, size: float, random: np.random.Generator
) -> bool:
    wait = random.uniform(0.08, 0.2) if random.random() < 0.08 else 0.0
    if track.raised:
        # With more time, the hand draws back further.
        more = float(np.clip((at - track.free) / 0.6, 1.0, 1.5 + 0.8 * size))
        start[WRIST] = _inside(end[WRIST] + more * (start[WRIST] - end[WRIST]))
    swing = np.array([random.normal(0.0, 0.12), random.normal(0.0, 0.06), random.uniform(0.1, 0.32)]) * size
    return track.stroke(at, start, end, wait, swing)


def _join(
    track: ArmTrack, at: float, start: np.ndarray, end: np.ndarray, partner: int, phrase: Phrase, size: float,
    random: np.random.Generator,
) -> None:  # fmt: skip
    """The other hand: similar for two-handed gestures, else with its own path, and never the mirror image."""
    if partner >= 0 and random.random() < 0.6:
        own = replace(phrase, twist=phrase.twist + random.normal(0.0, 0.3))
        start, end = _captured(partner, own, 0.8 * size, track, random)
    else:
        share = random.uniform(0.6, 1.0)
        start, end = start.copy(), end.copy()
        start[WRIST] = end[WRIST] + share * (start[WRIST] - end[WRIST])
    shift = random.normal(0.0, 1.0, 3) * np.array([0.028, 0.03, 0.02]) - np.array([0.0, 0.012, 0.008])
    for pose in (start, end):
        pose[WRIST] = _inside(pose[WRIST] + shift)
        pose[TWIST] += random.normal(0.0, 0.15)
        pose[FINGERS] = 0.7 * pose[FINGERS] + 0.3 * np.array(SHAPES["relaxed"])
    _strike(track, at + random.uniform(0.0, 0.015), start, end, 0.85 * size, random)


def _again(now: np.ndarray, size: float, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A smaller stroke at the hand's position."""
    up, down = now.copy(), now.copy()
    up[WRIST] += np.array([0.015, 0.16, -0.04]) * size + random.normal(0.0, 0.012, 3)
    up[WRIST.start + 1] = min(up[WRIST.start + 1], -0.04)
    up[BEND] -= 0.25
    down[WRIST] = _inside(down[WRIST] + random.normal(0.0, 1.0, 3) * np.array([0.022, 0.015, 0.022]))
    return up, down


def _shrug(t: np.ndarray, times: list[float], energy: float) -> np.ndarray:
    times = np.array(times)
    return (0.6 + 0.4 * energy) * plateaus(t, times, times + 0.25, 0.26, 0.5)


def _alive(tracks: list[ArmTrack], t: np.ndarray, energy: float, random: np.random.Generator) -> np.ndarray:
    """The tracks' states with tremor, and hands trailing behind their arms."""
    out = np.stack([track.curve(t) for track in tracks])
    late = np.stack([track.curve(t - _TRAIL_S) for track in tracks])
    for channels in (BEND, TILT, FINGERS):
        out[..., channels] = late[..., channels]
    lively = 0.6 + 0.8 * energy
    slow = drift(random, t, 0.08, 0.3, 6).T.reshape(2, 3, len(t)).swapaxes(1, 2)
    quick = drift(random, t, 0.35, 0.9, 6).T.reshape(2, 3, len(t)).swapaxes(1, 2)
    # A raised hand is less still than a hanging one.
    up = np.clip((out[..., 1:2] + 0.4) / 0.16, 0.0, 1.0)
    out[..., WRIST] += (0.006 * slow + (0.003 + 0.004 * up) * quick) * lively
    # The higher, the further forward: elbows do not fold up.
    short = 0.13 + 0.4 * np.clip(out[..., 1] + 0.3, 0.0, None) - out[..., 2]
    out[..., 2] += up[..., 0] * 0.5 * (short + np.sqrt(short**2 + 0.06**2))
    out[..., SWIVEL] += 0.05 * lively * drift(random, t, 0.1, 0.5, 2).T
    out[..., TWIST] += 0.06 * lively * drift(random, t, 0.1, 0.5, 2).T
    out[..., FINGERS] += 0.03 * drift(random, t, 0.05, 0.4, 14).T.reshape(2, 7, len(t)).swapaxes(1, 2)
    if len(t) > 2:
        rising = np.gradient(out[..., 1], axis=1) * FRAME_RATE
        out[..., BEND] += 0.3 * np.tanh(0.45 * rising)
    for channel, (low, high) in LIMITS.items():
        middle, half = (low + high) / 2.0, (high - low) / 2.0
        out[..., channel] = middle + half * np.tanh(np.arctanh(0.98) * (out[..., channel] - middle) / half)
    out[..., FINGERS] = np.clip(out[..., FINGERS], 0.0, 1.05)
    return out
