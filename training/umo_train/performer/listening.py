"""Listening: the voice is the interlocutor's, and head, brows and mouth respond to it."""

from dataclasses import dataclass, replace

import numpy as np

from umo_train.performer.curves import bumps
from umo_train.performer.prosody import Prosody
from umo_train.skeleton import SHAPE
from umo_train.speech.utterance import SILENCE, Phone, Utterance

# Minimum interval of responses in seconds; they come at the end of a phrase or right after a strong accent.
_APART_S = 1.6
_AFTER_END, _AFTER_ACCENT = 0.6, 0.1
# Period of a nod in seconds, and its depth in radians.
_NOD_S, _DEPTH = (0.36, 0.5), (0.06, 0.13)


@dataclass(frozen=True)
class Answer:
    """Start, number of nods, and whether the face takes part: raised brows or a smile."""

    at: float
    nods: int
    face: str


def unspoken(utterance: Utterance) -> Utterance:
    """An utterance of the same duration without words."""
    samples = np.zeros_like(utterance.samples)
    return replace(utterance, samples=samples, phones=(Phone(SILENCE, 0.0, utterance.seconds),), words=())


def answers(heard: Prosody, random: np.random.Generator) -> list[Answer]:
    """Small signs of listening, where the speaker leaves room for them."""
    ends = [(end + random.uniform(-0.1, 0.25), _AFTER_END) for end in heard.phrases[:, 1]]
    accents = [(at + random.uniform(0.25, 0.45), _AFTER_ACCENT) for at in heard.accents]
    out: list[Answer] = []
    for at, chance in sorted([*ends, *accents]):
        if random.random() < chance and (not out or at - out[-1].at > _APART_S):
            face = str(random.choice(["", "", "brows", "smile"]))
            out.append(Answer(at, int(random.choice([1, 2, 2, 3])), face))
    return out


def nods(given: list[Answer], t: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """The head's pitch `[T]`: each nod of an answer is smaller than the one before."""
    out = np.zeros(len(t))
    for answer in given:
        period, depth = random.uniform(*_NOD_S), random.uniform(*_DEPTH)
        for k in range(answer.nods):
            out += depth * 0.7**k * bumps(t, np.array([answer.at + k * period]), 0.5 * period, 0.55 * period)[:, 0]
    return out


def attend(out: np.ndarray, given: list[Answer], t: np.ndarray) -> None:
    """The face `[T, 52]` of an attentive listener, with its responses."""
    for answer in given:
        rise = bumps(t, np.array([answer.at + 0.3]), 0.4, 0.9)[:, 0]
        if answer.face == "brows":
            out[:, SHAPE["browInnerUp"]] += 0.3 * rise
        for side in ("Left", "Right"):
            if answer.face == "brows":
                out[:, SHAPE["browOuterUp" + side]] += 0.25 * rise
            elif answer.face == "smile":
                out[:, SHAPE["mouthSmile" + side]] += 0.3 * rise
                out[:, SHAPE["cheekSquint" + side]] += 0.2 * rise
