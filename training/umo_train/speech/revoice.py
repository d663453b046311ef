"""Several voices for one motion (paper 3.4): other voices speak its words at the original times."""

import re
import shlex
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from difflib import SequenceMatcher
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from umo_train.data import corpus, recording
from umo_train.speech import voices
from umo_train.speech.utterance import SAMPLE_RATE, SILENCE, Phone, Utterance, Word
from umo_train.speech.variation import leveled
from umo_train.speech.voices import Line, Voice, VoiceError
from umo_train.speech.warp import warped

# Words closer than this are spoken together, seconds.
_BREATH = 0.25
# Words further apart than this are separated by silence.
_PAUSE = 0.06
_FADE = 0.012
# Length of a phrase's sound before its first word and after its last.
_BEFORE, _AFTER = 0.02, 0.05
# Minimum distance of anchors, so that time never stands still.
_STEP = 0.004
_LEVEL = 24


@dataclass(frozen=True)
class CommandVoice:
    """Any program that writes speech to a file: in `command`, `{text}` and `{wav}` stand for the text and the file, and
    the optional `{words}` for a file to which the program writes `start end word` in seconds, one line per word.
    Without these times the words are located by similarity to the recording."""

    name: str
    command: str

    def speak(self, lines: Sequence[Line]) -> Iterator[Utterance]:
        with tempfile.TemporaryDirectory() as folder:
            wav, words = Path(folder, "speech.wav"), Path(folder, "words.txt")
            for line in lines:
                places = {"{text}": line.text, "{wav}": str(wav), "{words}": str(words)}
                self._run([_filled(part, places) for part in shlex.split(self.command)])
                if not wav.is_file():
                    raise VoiceError(f"{self.name}: `{self.command}` wrote no file where {{wav}} is")
                samples = recording.samples(wav)
                yield Utterance(self.name, line.text, samples, (), _read_words(words))
                wav.unlink()
                words.unlink(missing_ok=True)

    def _run(self, command: list[str]) -> None:
        try:
            done = subprocess.run(command, capture_output=True, text=True, check=False)
        except FileNotFoundError as error:
            raise VoiceError(f"{self.name}: program {command[0]} not found") from error
        if done.returncode:
            raise VoiceError(f"{self.name}: {command[0]} failed with {done.returncode}: {done.stderr.strip()[-500:]}")


def _filled(part: str, places: dict[str, str]) -> str:
    """All at once, so that braces in the text are kept."""
    return re.sub(r"\{(text|wav|words)\}", lambda found: places[found[0]], part)


def _read_words(path: Path) -> tuple[Word, ...]:
    if not path.is_file():
        return ()
    rows = (line.split(maxsplit=2) for line in path.read_text("utf-8").splitlines() if line.strip())
    return tuple(Word(text.strip(), float(start), float(end)) for start, end, text in rows)


def find(voice: str | dict[str, Any]) -> Voice:
    """A voice of a plan: the name of a voice of `voices.find`, or a name and a command."""
    return voices.find(voice) if isinstance(voice, str) else CommandVoice(voice["name"], voice["command"])


def revoiced(original: Utterance, voice: Voice) -> np.ndarray:
    """The words of `original` spoken by `voice` at the original times: as many samples as the original has."""
    out = np.zeros(len(original.samples), np.float32)
    phrases = list(_phrases(original.words))
    lines = [Line(" ".join(word.text for word in phrase)) for phrase in phrases]
    for phrase, spoken in zip(phrases, voice.speak(lines), strict=True):
        if len(spoken.samples) == 0:
            raise VoiceError(f"{voice.name}: no speech for `{spoken.text}`")
        first = max(int((phrase[0].start - _BEFORE) * SAMPLE_RATE), 0)
        last = min(int((phrase[-1].end + _AFTER) * SAMPLE_RATE), len(out))
        heard, wanted = _anchors(original, phrase, spoken)
        piece = warped(spoken.samples, heard, wanted - first / SAMPLE_RATE, last - first)
        out[first:last] += piece * _loudness(phrase, first, last)
    return leveled(out, _LEVEL)


def _phrases(words: Sequence[Word]) -> Iterator[list[Word]]:
    phrase: list[Word] = []
    for word in words:
        if phrase and word.start - phrase[-1].end >= _BREATH:
            yield phrase
            phrase = []
        phrase.append(word)
    if phrase:
        yield phrase


def _anchors(original: Utterance, phrase: list[Word], spoken: Utterance) -> tuple[np.ndarray, np.ndarray]:
    """Corresponding times in `spoken` and in the original."""
    pairs = _by_words(original.phones, phrase, spoken) if spoken.words else []
    if len(pairs) < 2:
        from umo_train.speech import alike

        pairs = alike.boundaries(original, phrase, spoken.samples)
    ascending: list[tuple[float, float]] = []
    for heard, wanted in sorted(pairs, key=lambda pair: pair[1]):
        if not ascending or (heard > ascending[-1][0] + _STEP and wanted > ascending[-1][1] + _STEP):
            ascending.append((heard, wanted))
    return np.array([a for a, _ in ascending]), np.array([b for _, b in ascending])


def _by_words(phones: Sequence[Phone], phrase: list[Word], spoken: Utterance) -> list[tuple[float, float]]:
    """Starts and ends of equal words, of stretches of differing words, and of equal phones in equal words."""
    names = [[_plain(word.text) for word in words] for words in (spoken.words, phrase)]
    out = []
    for kind, i, j, k, m in SequenceMatcher(None, *names, autojunk=False).get_opcodes():
        if kind == "equal":
            for theirs, ours in zip(spoken.words[i:j], phrase[k:m], strict=True):
                out += [(theirs.start, ours.start), (theirs.end, ours.end)]
                out += _by_phones(_within(spoken.phones, theirs), _within(phones, ours))
        elif kind == "replace":
            out += [(spoken.words[i].start, phrase[k].start), (spoken.words[j - 1].end, phrase[m - 1].end)]
    return out


def _by_phones(theirs: list[Phone], ours: list[Phone]) -> list[tuple[float, float]]:
    """Starts of equal phones after equal phones: common transitions."""
    names = [[phone.name for phone in phones] for phones in (theirs, ours)]
    blocks = SequenceMatcher(None, *names, autojunk=False).get_matching_blocks()
    return [(theirs[i + n].start, ours[j + n].start) for i, j, size in blocks for n in range(1, size)]


def _within(phones: Sequence[Phone], word: Word) -> list[Phone]:
    return [p for p in phones if p.name != SILENCE and word.start - 1e-3 <= p.start and p.end <= word.end + 1e-3]


def _plain(text: str) -> str:
    return re.sub(r"[^\w]", "", text.lower())


def _loudness(phrase: list[Word], first: int, last: int) -> np.ndarray:
    """1 in words, 0 before and after the phrase and in its pauses, with ramps at their edges."""
    corners, values = [first / SAMPLE_RATE, first / SAMPLE_RATE + _FADE], [0.0, 1.0]
    for before, after in pairwise(phrase):
        if after.start - before.end >= _PAUSE:
            corners += [before.end, before.end + _FADE, after.start - _FADE, after.start]
            values += [1.0, 0.0, 0.0, 1.0]
    corners += [last / SAMPLE_RATE - _FADE, last / SAMPLE_RATE]
    return np.interp(np.arange(first, last) / SAMPLE_RATE, corners, [*values, 1.0, 0.0]).astype(np.float32)


def revoice_corpus(folder: Path, speakers: Sequence[Voice], workers: int) -> None:
    """Every training item with known words in each voice, `voices/NAME.npz`: additional rows of its audio tokens."""
    jobs = [(folder, path, speakers) for path in corpus.paths(folder, "speech") if not _target(folder, path).exists()]
    with ProcessPoolExecutor(workers) as pool:
        list(tqdm(pool.map(_revoice_item, jobs), "voices", len(jobs), unit="item"))


def _target(folder: Path, path: Path) -> Path:
    return folder / "voices" / path.name


def _revoice_item(job: tuple[Path, Path, Sequence[Voice]]) -> None:
    folder, path, speakers = job
    item = corpus.read_item(path)
    if item.split == "train" and item.utterance.words:
        data = {f"{i:02}": corpus.int16(revoiced(item.utterance, voice)) for i, voice in enumerate(speakers)}
        corpus.write(_target(folder, path), data)
