"""LibriSpeech: read speech with its text, for pre-training on audio and text."""

from collections.abc import Iterator
from pathlib import Path

from umo_train.data import recording
from umo_train.data.clip import Clip, DataError, file, folder
from umo_train.speech.utterance import Utterance

_FETCH = "fetch a set of LibriSpeech, such as train-clean-100, and unpack it there"


def librispeech(root: Path) -> Iterator[Clip]:
    """Utterances below `root`, in folders `speaker/chapter`, without phones and words, as they have no times."""
    texts = sorted(folder(root, _FETCH).rglob("*.trans.txt"))
    if not texts:
        raise DataError(f"{root}: no .trans.txt below it: {_FETCH}")
    return (clip for path in texts for clip in _chapter(path))


def _chapter(path: Path) -> Iterator[Clip]:
    for number, line in enumerate(path.read_text("utf-8").splitlines(), 1):
        if not line.strip():
            continue
        name, _, text = line.partition(" ")
        if name.count("-") != 2 or not text.strip():
            raise DataError(f"{path}: line {number}: expected SPEAKER-CHAPTER-NUMBER and a text, got `{line}`")
        sound = recording.samples(file(path.parent / f"{name}.flac", f"{path.name} has its text: fetch it again"))
        speaker = name.split("-")[0]
        yield Clip(name, speaker, Utterance(f"librispeech_{speaker}", text.strip().lower(), sound, ()))
