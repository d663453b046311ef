"""Hints for `Session.hint_lips` from the timings of synthesisers: characters, words, or visemes.

Only sounds that the spelling makes all but certain become hints: p, b and m close the lips; f, v and ph bring the lower
lip to the teeth. This holds for English and German spelling; silent letters (lamb, debt, psalm, pneumonia) are left
out, and so are words in capitals (FBI) or with digits (5pm), whose letters are read differently. A word's times locate
its first sound only, not the sounds within it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple, Optional

_SHAPES = {"p": "closed", "b": "closed", "m": "closed", "f": "teeth", "v": "teeth"}
_SILENT_FIRST = ("ps", "pn", "pt", "mn")
_FIRST_SOUND = 0.08
_LONGEST = 0.4
_BEFORE_WORDS = " \t\n\"'(“”‘’„«»¿¡*_-–—"
_RESTART = 0.25
_AZURE = {21: "closed", 18: "teeth", 7: "round"}


class Hint(NamedTuple):
    """A sound that is visible on the lips: arguments of `Session.hint_lips`."""

    shape: str
    start: float
    duration: float

    def after(self, seconds: float) -> Hint:
        """The same hint for speech that starts at `seconds` of the pushed audio."""
        return Hint(self.shape, self.start + seconds, self.duration)


def _sounds(word: str) -> list[tuple[str, int, int]]:
    """Shape, first letter and end of each certain sound of a word in lower case."""
    found: list[tuple[str, int, int]] = []
    at = 0
    while at < len(word):
        letter, rest = word[at], word[at:]
        if at == 0 and rest.startswith(_SILENT_FIRST):
            at += 1
        elif rest.startswith("ph"):
            found.append(("teeth", at, at + 2))
            at += 2
        elif rest.startswith("pt") and word[max(at - 2, 0) : at] == "ei":
            at += 1
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
    """Hints from a text with character times in seconds, as from ElevenLabs."""
    if not len(characters) == len(starts) == len(ends):
        raise ValueError(f"{len(characters)} characters, {len(starts)} starts and {len(ends)} ends: expected the same number of each")
    if any(len(character) != 1 for character in characters):
        raise ValueError("characters must be strings of one character each")
    hints, first = [], 0
    for at in range(len(characters) + 1):
        if at < len(characters) and characters[at].isalpha():
            continue
        beside = [*characters[max(first - 1, 0) : first], *characters[at : at + 1]]
        word = [] if any(character.isdigit() for character in beside) else characters[first:at]
        if "".join(word).isupper():
            word = []
        for shape, start, end in _sounds("".join(character.lower()[:1] for character in word)):
            begin = starts[first + start]
            hints.append(Hint(shape, begin, min(max(ends[first + end - 1] - begin, 0.0), _LONGEST)))
        first = at + 1
    return hints


def of_word(word: str, start: float, end: Optional[float] = None) -> Optional[Hint]:
    """Hint for the first sound of a word, if it is certain; `start` and `end` are the word's, seconds."""
    read = word.strip().lstrip(_BEFORE_WORDS)
    letters = "".join(character for character in read if character.isalpha())
    if not read[:1].isalpha() or letters.isupper() or any(character.isspace() or character.isdigit() for character in read):
        return None
    sounds = _sounds(letters.lower())
    if not sounds or sounds[0][1] > 0:
        return None
    return Hint(sounds[0][0], start, _FIRST_SOUND if end is None else min(max(end - start, 0.0), _FIRST_SOUND))


class Transcript:
    """Hints from a transcript in timed pieces, each a word or a single character, such as LiveKit's `TimedString`.

    Characters of a word may arrive in several calls: its hints are returned when it ends. A piece of several words has
    none, as a sentence starts with some silence. Times must be continuous from piece to piece. If they restart, their
    position in the audio is unknown, so no further hints are returned.
    """

    def __init__(self) -> None:
        self._characters: list[tuple[str, float, float]] = []
        self._last = 0.0
        self._is_lost = False

    def push(self, text: str, start: float, end: float) -> list[Hint]:
        """The hints completed by a piece."""
        if self._is_lost or start < self._last - _RESTART:
            self._is_lost = True
            return []
        self._last = max(self._last, start)
        if len(text) == 1:
            self._characters.append((text, start, end))
            return [] if text.isalnum() else self.finish()
        hints, hint = self.finish(), of_word(text, start, end)
        return hints if hint is None else [*hints, hint]

    def finish(self) -> list[Hint]:
        """Hints of a last word that no other character followed."""
        if not self._characters:
            return []
        characters, starts, ends = zip(*self._characters)
        self._characters = []
        return of_characters(characters, starts, ends)


def of_azure(visemes: Iterable[tuple[float, int]]) -> list[Hint]:
    """Hints from Azure's visemes, each a time in seconds and an id; a viseme ends where the next one starts."""
    known = list(visemes)
    following = [*(time for time, _ in known[1:]), None]
    return [
        Hint(_AZURE[number], time, min(max((_FIRST_SOUND if end is None else end - time), 0.0), _LONGEST))
        for (time, number), end in zip(known, following)
        if number in _AZURE
    ]
