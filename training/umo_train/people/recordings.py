"""Sound files with their readers and, if available, their texts."""

import csv
import re
from dataclasses import dataclass
from pathlib import Path

from umo_train.data.clip import DataError, folder

SUFFIXES = frozenset({".flac", ".mp3", ".ogg", ".opus", ".wav"})
# LibriSpeech: reader, chapter, utterance.
_LIBRISPEECH = re.compile(r"(\d+)-\d+-\d+")


@dataclass(frozen=True)
class Recording:
    """`text` is None if unknown."""

    name: str
    reader: str
    path: Path
    text: str | None


def recordings(root: Path) -> list[Recording]:
    """All below `root`, by name.

    | text | in | lines |
    | --- | --- | --- |
    | rhasspy's voice data sets | `text.csv` | `name\\|text` |
    | LJ Speech | `metadata.csv` | `name\\|text\\|text in words` |
    | LibriSpeech | `*.trans.txt` | `name TEXT` |

    A file of LibriSpeech has its reader's number in its name; all others of a folder are one reader's.

    Raises `DataError` for a folder without sound files, and for texts of which none belongs to a sound file.
    """
    below = sorted(folder(root, "fetch the recordings and unpack them there").rglob("*"))
    sounds = {path.stem: path for path in below if path.suffix.lower() in SUFFIXES}
    if not sounds:
        raise DataError(f"{root}: no sound file below it ({', '.join(sorted(SUFFIXES))}): fetch the recordings")
    texts: dict[str, str] = {}
    for path in below:
        if path.name in ("text.csv", "metadata.csv"):
            texts |= _columns(path)
        elif path.name.endswith(".trans.txt"):
            texts |= _lines(path)
    if texts and not texts.keys() & sounds.keys():
        raise DataError(f"{root}: its texts are of other files, as {next(iter(texts))}: fetch the recordings again")
    return [Recording(name, _reader(name, root), path, texts.get(name)) for name, path in sorted(sounds.items())]


def _reader(name: str, root: Path) -> str:
    found = _LIBRISPEECH.match(name)
    return f"{root.name}-{found[1]}" if found else root.name


def _columns(path: Path) -> dict[str, str]:
    with path.open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.reader(file, delimiter="|", quoting=csv.QUOTE_NONE) if row]
    for number, row in enumerate(rows, 1):
        if len(row) < 2 or not row[-1].strip():
            raise DataError(
                f"{path}: line {number}: expected a name and a text with | between them, got `{'|'.join(row)}`"
            )
    return {row[0]: row[-1].strip() for row in rows}


def _lines(path: Path) -> dict[str, str]:
    rows = (line.partition(" ") for line in path.read_text("utf-8").splitlines() if line.strip())
    return {name: text.strip().lower() for name, _, text in rows}
