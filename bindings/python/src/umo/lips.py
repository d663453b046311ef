"""Hints for `Session.hint_lips` of the times that synthesisers give: characters, words, or visemes.

Only what the spelling makes all but certain becomes a hint: p, b and m close the lips, f, v and ph bring the lower one to the
teeth. English and German are spelled so; letters that are not spoken there (lamb, debt, psalm, pneumonia) are left out. A word's
own times say where its first sound begins, and nothing of those within it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple, Optional

_SHAPES = {"p": "closed", "b": "closed", "m": "closed", "f": "teeth", "v": "teeth"}
_SILENT_FIRST = ("ps", "pn", "pt", "mn")
_FIRST_SOUND = 0.08
_LONGEST = 0.4
_AZURE = {21: "closed", 18: "teeth", 7: "round"}


class Hint(NamedTuple):
    """A sound that one sees on the lips: arguments of `Session.hint_lips`."""

    shape: str
    start: float
    duration: float

    def after(self, seconds: float) -> Hint:
        """The same sound where its speech begins at a time of the audio that was pushed."""
        return Hint(self.shape, self.start + seconds, self.duration)


def _sounds(word: str) -> list[tuple[str, int, int]]:
    """The shape of each certain sound of a word in lower case, its first letter and the one after its last."""
    found: list[tuple[str, int, int]] = []
    at = 0
    while at < len(word):
        letter, rest = word[at], word[at:]
        if at == 0 and rest.startswith(_SILENT_FIRST):
            at += 1
        elif rest.startswith("ph"):
            found.append(("teeth", at, at + 2))
            at += 2
        elif letter == "b" and (rest == "bt" or rest == "bts" or (at > 0 and word[at - 1] == "m" and rest in ("b", "bs"))):
            at += 1
        elif letter in _SHAPES:
            end = at + 2 if rest[1:2] == letter else at + 1
            found.append((_SHAPES[letter], at, end))
            at = end
        else:
            at += 1
    return found


def of_characters(characters: Sequence[str], starts: Sequence[float], ends: Sequence[float]) -> list[Hint]:
    """Hints of a text whose characters have times, seconds, as ElevenLabs gives them."""
    if not len(characters) == len(starts) == len(ends):
        raise ValueError(f"{len(characters)} characters, {len(starts)} starts and {len(ends)} ends: expected as many of each")
    if any(len(character) != 1 for character in characters):
        raise ValueError("characters must be strings of one character each")
    hints, first = [], 0
    for at in range(len(characters) + 1):
        if at < len(characters) and characters[at].isalpha():
            continue
        for shape, start, end in _sounds("".join(character.lower()[:1] for character in characters[first:at])):
            begin = starts[first + start]
            hints.append(Hint(shape, begin, min(max(ends[first + end - 1] - begin, 0.0), _LONGEST)))
        first = at + 1
    return hints


def of_word(word: str, start: float, end: float) -> Optional[Hint]:
    """A hint of the sound that a word begins with, where it is certain; `start` and `end` are the word's, seconds."""
    letters = "".join(character for character in word.lower() if character.isalpha())
    sounds = _sounds(letters)
    if not sounds or sounds[0][1] > 0:
        return None
    return Hint(sounds[0][0], start, min(max(end - start, 0.0), _FIRST_SOUND))


def of_azure(visemes: Iterable[tuple[float, int]]) -> list[Hint]:
    """Hints of Azure's visemes, each the time in seconds and the id; a viseme ends where the next one begins."""
    known = list(visemes)
    following = [*(time for time, _ in known[1:]), None]
    return [
        Hint(_AZURE[number], time, min(max((_FIRST_SOUND if end is None else end - time), 0.0), _LONGEST))
        for (time, number), end in zip(known, following)
        if number in _AZURE
    ]
