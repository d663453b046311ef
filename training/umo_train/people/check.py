"""Accuracy of the detected phones and accents, compared with voices that report theirs."""

import random
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from umo_train.people import align
from umo_train.people.accents import accented
from umo_train.speech import voices
from umo_train.speech.sentences import sentence
from umo_train.speech.utterance import SILENCE, VOWELS, Phone, Utterance

Method = Callable[[Utterance], Utterance | None]
_STEP_S = 0.01
# Groups of phones that look the same on the mouth.
_CLASSES = (
    "p b m", "f v", "th dh", "t d n l k g ng hh", "s z", "sh zh ch jh", "r er", "w uw uh", "y iy ih ey",
    "aa ae ah aw ay", "eh ax", "ao ow oy", SILENCE,
)  # fmt: skip
_CLASS = {name: number for number, names in enumerate(_CLASSES) for name in names.split()}


def methods(language: str) -> dict[str, Method]:
    """Methods of finding phones, by name."""
    if language.startswith("en"):
        return {
            "known text": lambda spoken: align.from_text(spoken.samples, spoken.text),
            "known text, pronounced by espeak-ng": lambda spoken: align.from_text(
                spoken.samples, spoken.text, "en-us", dictionary=False
            ),
            "sound alone": lambda spoken: align.from_sound(spoken.samples),
            "warped espeak-ng": lambda spoken: align.from_synthesiser(spoken.samples, spoken.text, "en-us"),
        }
    return {
        "known text, pronounced by espeak-ng": lambda spoken: align.from_text(spoken.samples, spoken.text, language),
        "warped espeak-ng": lambda spoken: align.from_synthesiser(spoken.samples, spoken.text, language),
    }


def spoken(voice: str, count: int, seed: int = 0) -> list[Utterance]:
    """Sentences of a voice that reports its phones' times."""
    chance = random.Random(f"{seed} {voice}")
    return list(voices.find(voice).speak([voices.Line(sentence(chance)) for _ in range(count)]))


def agreement(truth: Sequence[Utterance], method: Method) -> dict[str, float]:
    """`found`: the share of utterances with any phones; of these, `frames`: the share of 10 ms frames with the true
    phone, `shapes`: with one that looks the same on the mouth; `edge` and `edge95`: start error of speech sounds in
    milliseconds, median and 95th percentile, for correct phones; `lips`: the share of true p, b and m with one of
    these within 50 ms."""
    pairs = [(true, method(true)) for true in truth]
    found = [(true, heard) for true, heard in pairs if heard is not None]
    if not found:
        return {"found": 0.0}
    frames = [(_frames(true), _frames(heard)) for true, heard in found]
    ours = np.concatenate([b for _, b in frames])
    true = np.concatenate([a for a, _ in frames])
    shapes = np.array([_CLASS[name] for name in true]) == np.array([_CLASS[name] for name in ours])
    edges = np.concatenate([_edges(true, heard) for true, heard in found])
    lips = [hit for true, heard in found for hit in _lips(true, heard)]
    return {
        "found": len(found) / len(pairs),
        "frames": float((true == ours).mean()),
        "shapes": float(shapes.mean()),
        "edge": 1000 * float(np.median(edges)),
        "edge95": 1000 * float(np.quantile(edges, 0.95)),
        "lips": float(np.mean(lips)),
    }


def accents(truth: Sequence[Utterance]) -> dict[str, float]:
    """Detected accents compared with those that the voice was told to make: `precision`, `recall`, and the precision of
    the same number of accents on random vowels (`chance`)."""
    hits, heard, told, vowels = 0, 0, 0, 0
    for true in truth:
        bare = replace(true, phones=tuple(replace(phone, stress=min(phone.stress, 1)) for phone in true.phones))
        for ours, theirs in zip(accented(bare).phones, true.phones, strict=True):
            hits += ours.stress == theirs.stress == 2
            heard += ours.stress == 2
            told += theirs.stress == 2
            vowels += theirs.name in VOWELS
    return {"precision": hits / max(heard, 1), "recall": hits / max(told, 1), "chance": told / max(vowels, 1)}


def _frames(utterance: Utterance) -> np.ndarray:
    times = (np.arange(int(utterance.seconds / _STEP_S)) + 0.5) * _STEP_S
    ends = np.array([phone.end for phone in utterance.phones])
    names = np.array([phone.name for phone in utterance.phones])
    return names[np.minimum(np.searchsorted(ends, times, side="right"), len(names) - 1)]


def _edges(true: Utterance, heard: Utterance) -> np.ndarray:
    """Start error of each true phone, if the same phone is detected at some time during it."""
    out = []
    for phone in true.phones:
        near = [other for other in heard.phones if other.end > phone.start and other.start < phone.end]
        same = [other.start for other in near if other.name == phone.name != SILENCE]
        if same:
            out.append(min(abs(phone.start - start) for start in same))
    return np.array(out)


def _lips(true: Utterance, heard: Utterance) -> list[bool]:
    def closed(phones: Sequence[Phone]) -> list[Phone]:
        return [phone for phone in phones if phone.name in ("p", "b", "m")]

    ours = closed(heard.phones)
    return [
        any(other.start - 0.05 <= (phone.start + phone.end) / 2 <= other.end + 0.05 for other in ours)
        for phone in closed(true.phones)
    ]
