"""Words and phones from a Praat TextGrid written by the Montreal Forced Aligner."""

import re
from pathlib import Path

from praatio import textgrid
from praatio.utilities.errors import PraatioException

from umo_train.data.clip import DataError
from umo_train.speech.utterance import PHONES, SILENCE, VOWELS, Phone, Word

_SILENT = frozenset({"", "sil", "sp", "spn", "pau", "<eps>"})
# ARPAbet's unstressed vowel and additions of other dictionaries, mapped to this package's phones.
_SAME = {"ah0": "ax", "ix": "ih", "axr": "er", "hv": "hh", "dx": "t", "nx": "n", "en": "n", "em": "m", "el": "l"}
_STRESS = re.compile(r"([a-z]+)([012])?")

Spans = list[tuple[float, float, str]]


def alignment(path: Path, seconds: float) -> tuple[tuple[Word, ...], tuple[Phone, ...]]:
    """Words, and phones with silence in all gaps, up to `seconds`."""
    try:
        grid = textgrid.openTextgrid(str(path), includeEmptyIntervals=False, duplicateNamesMode="rename")
    except (PraatioException, ValueError, IndexError, UnicodeError) as error:
        raise DataError(f"{path}: cannot read a TextGrid from it, fetch it again: {error}") from error
    words = [Word(text, start, end) for start, end, text in _tier(path, grid, "words", seconds)]
    phones = [_phone(path, *span) for span in _tier(path, grid, "phones", seconds)]
    return tuple(word for word in words if word.text.lower() not in _SILENT), tuple(_covering(phones, seconds))


def _tier(path: Path, grid: textgrid.Textgrid, name: str, seconds: float) -> Spans:
    """The intervals of a tier that start before `seconds`, truncated there."""
    names = {found.lower(): found for found in grid.tierNames}
    if name not in names:
        raise DataError(f"{path}: no tier `{name}`, it has {', '.join(grid.tierNames)}: align the speech again")
    entries = grid.getTier(names[name]).entries
    return [(start, min(end, seconds), label.strip()) for start, end, label in entries if start < seconds]


def _phone(path: Path, start: float, end: float, label: str) -> Phone:
    label = label.lower()
    if label in _SILENT:
        return Phone(SILENCE, start, end)
    parts = _STRESS.fullmatch(label)
    name = _SAME.get(label) or (parts and _SAME.get(parts[1], parts[1]))
    if name not in PHONES:
        raise DataError(f"{path}: phone `{label}` at {start:.2f} s is not ARPAbet's: align with an ARPAbet dictionary")
    return Phone(name, start, end, int(name in VOWELS and parts[2] == "1"))


def _covering(phones: list[Phone], seconds: float) -> list[Phone]:
    """The phones with silence in the gaps, and neighbouring silences joined."""
    out: list[Phone] = []
    at = 0.0
    for phone in [*phones, Phone(SILENCE, seconds, seconds)]:
        # Times are decimal fractions: less than a tenth of a millisecond is not a gap.
        if phone.start > at + 1e-4:
            out.append(Phone(SILENCE, at, phone.start))
        if phone.end > phone.start:
            out.append(phone)
        at = max(at, phone.end)
    joined: list[Phone] = []
    for phone in out:
        if joined and joined[-1].name == phone.name == SILENCE:
            joined[-1] = Phone(SILENCE, joined[-1].start, phone.end)
        else:
            joined.append(phone)
    return joined
