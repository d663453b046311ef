"""Words for `Session.hint_words` from the timings of synthesisers: words or characters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Optional

_LETTER = 0.07
"""Seconds of a letter in speech, for words whose end is unknown."""
_MOST_WORDS = 64
_LONGEST = 30.0
_RESTART = 0.25


class Word(NamedTuple):
    """A word with its punctuation, or several, and their time in seconds: arguments of `Session.hint_words`."""

    text: str
    start: float
    end: float

    def after(self, seconds: float) -> Word:
        """The same word in speech that starts at `seconds` of the pushed audio."""
        return Word(self.text, self.start + seconds, self.end + seconds)


def of_word(text: str, start: float, end: Optional[float] = None) -> Optional[Word]:
    """The word, or None for an empty text and for more words or seconds than `hint_words` takes. Without an `end` it is
    estimated from the letters.
    """
    said = text.strip()
    end = start + min(_LETTER * len(said), _LONGEST) if end is None else max(start, end)
    if not said or "\0" in said or len(said.split()) > _MOST_WORDS or not 0.0 <= start <= end <= start + _LONGEST:
        return None
    return Word(said, start, end)


def of_characters(characters: Sequence[str], starts: Sequence[float], ends: Sequence[float]) -> list[Word]:
    """Words of a text with character times in seconds, as from ElevenLabs."""
    if not len(characters) == len(starts) == len(ends):
        raise ValueError(
            f"{len(characters)} characters, {len(starts)} starts and {len(ends)} ends: expected the same number of each"
        )
    words, first = [], 0
    for at in range(len(characters) + 1):
        if at < len(characters) and not characters[at].isspace():
            continue
        word = of_word("".join(characters[first:at]), starts[first], ends[at - 1]) if at > first else None
        if word is not None:
            words.append(word)
        first = at + 1
    return words


class Transcript:
    """Words of a transcript in timed pieces, each some words or a single character, such as LiveKit's `TimedString`.

    A word in characters may arrive in several calls: it is returned when it ends. Times must be continuous from piece
    to piece. If they restart, their position in the audio is unknown, so no further words are returned.
    """

    def __init__(self) -> None:
        self._characters: list[tuple[str, float, float]] = []
        self._last = 0.0
        self._is_lost = False

    def push(self, text: str, start: float, end: float) -> list[Word]:
        """The words completed by a piece."""
        if self._is_lost or start < self._last - _RESTART:
            self._is_lost = True
            return []
        self._last = max(self._last, start)
        if len(text) == 1 and not text.isspace():
            self._characters.append((text, start, end))
            return []
        words, word = self.finish(), of_word(text, start, end)
        return words if word is None else [*words, word]

    def finish(self) -> list[Word]:
        """A last word that no other character followed."""
        if not self._characters:
            return []
        characters, starts, ends = zip(*self._characters)
        self._characters = []
        return of_characters(characters, starts, ends)
