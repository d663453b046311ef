"""Voices that report the times of phones and words: flite, festival and espeak-ng behind one interface."""

import ctypes
import ctypes.util
import os
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib import resources
from math import gcd
from pathlib import Path
from typing import ClassVar, Protocol

import numpy as np
from scipy.io import wavfile
from scipy.signal import resample_poly

from umo_train.speech.utterance import SAMPLE_RATE, SILENCE, VOWELS, Phone, Utterance, Word


@dataclass(frozen=True)
class Line:
    """A sentence to speak; `stretch` above 1 is slower, `pitch` multiplies the voice's own."""

    text: str
    stretch: float = 1.0
    pitch: float = 1.0


class Voice(Protocol):
    """A speaker. Lines are batched because starting a program costs more than a sentence."""

    name: str

    def speak(self, lines: Sequence[Line]) -> Iterator[Utterance]: ...


class VoiceError(RuntimeError):
    """A program of a voice is missing or failed; the message says which and how to install it."""


@dataclass(frozen=True)
class Segment:
    """A phone as named by a program, with its syllable's and word's properties."""

    name: str
    end: float
    stressed: bool
    accented: bool
    # Index of the word in the sentence from 1, 0 for none.
    word: int
    text: str


# Names of CMU's radio set that are not in `PHONES`.
_RADIO = {"axr": "er", "dx": "d", "el": "l", "em": "m", "en": "n", "hv": "hh", "nx": "n", "h#": "pau", "brth": "pau"}


def _utterance(voice: str, line: Line, samples: np.ndarray, segments: Sequence[Segment]) -> Utterance:
    """Phones that cover the samples' duration exactly, and their words."""
    seconds = len(samples) / SAMPLE_RATE
    phones: list[Phone] = []
    words: list[Word] = []
    spans: dict[int, list] = {}
    start = 0.0
    for segment in segments:
        end = min(segment.end, seconds)
        if end <= start:
            continue
        name = _RADIO.get(segment.name, segment.name)
        stress = (1 + segment.accented if segment.stressed else 0) if name in VOWELS else 0
        if name == SILENCE and phones and phones[-1].name == SILENCE:
            phones[-1] = Phone(SILENCE, phones[-1].start, end)
        else:
            phones.append(Phone(name, start, end, stress))
        if segment.word:
            spans.setdefault(segment.word, [segment.text, start, end])[2] = end
        start = end
    if seconds > start:
        phones.append(Phone(SILENCE, start, seconds))
    words = [Word(text, begin, end) for text, begin, end in spans.values()]
    return Utterance(voice, line.text, samples, tuple(phones), tuple(words))


def _read_wav(path: Path) -> np.ndarray:
    rate, data = wavfile.read(path)
    data = data.astype(np.float32) / 32768
    if rate != SAMPLE_RATE:
        common = gcd(rate, SAMPLE_RATE)
        data = resample_poly(data, SAMPLE_RATE // common, rate // common).astype(np.float32)
    return data


def _run(command: Sequence[str], stdin: str, package: str) -> str:
    try:
        done = subprocess.run(command, input=stdin, capture_output=True, text=True, check=False)
    except FileNotFoundError as error:
        raise VoiceError(f"{command[0]} is missing: install {package}") from error
    if done.returncode:
        raise VoiceError(f"{command[0]} failed with {done.returncode}: {done.stderr.strip()[-500:]}")
    return done.stdout


def _segments(block: str) -> list[Segment]:
    """`name TAB end TAB stressed TAB accented TAB word number TAB word` per line."""
    rows = (row.split("\t") for row in block.strip("\n").splitlines())
    return [
        Segment(name, float(end), stressed == "1", accented == "1", int(word), text)
        for name, end, stressed, accented, word, text in rows
    ]


class Flite:
    """flite's voices. Built once from `flite_times.c`: the program alone does not report stress and words."""

    # kal16's times are too long: its labels are of the voice at another speed.
    PITCH_HZ: ClassVar = {"rms": 95.0, "slt": 172.0, "awb": 130.0, "kal": 95.0}

    def __init__(self, speaker: str) -> None:
        self.speaker, self.name = speaker, f"flite-{speaker}"

    def speak(self, lines: Sequence[Line]) -> Iterator[Utterance]:
        with tempfile.TemporaryDirectory() as folder:
            rows = [
                f"{self.speaker}\t{line.stretch:.3f}\t{self.PITCH_HZ[self.speaker] * line.pitch:.1f}\t"
                f"{folder}/{i}.wav\t{line.text}\n"
                for i, line in enumerate(lines)
            ]
            blocks = _run([str(_flite_times())], "".join(rows), "flite1-dev").split("\n\n")
            for i, (line, block) in enumerate(zip(lines, blocks, strict=False)):
                yield _utterance(self.name, line, _read_wav(Path(folder, f"{i}.wav")), _segments(block))


def _flite_times() -> Path:
    program = Path.home() / ".cache" / "umo_train" / "flite_times"
    source = resources.files("umo_train.speech") / "flite_times.c"
    with resources.as_file(source) as path:
        if program.exists() and program.stat().st_mtime >= path.stat().st_mtime:
            return program
        program.parent.mkdir(parents=True, exist_ok=True)
        libraries = [f"-lflite_cmu_us_{voice}" for voice in ("rms", "slt", "awb", "kal", "kal16")]
        libraries += ["-lflite_usenglish", "-lflite_cmulex", "-lflite", "-lm"]
        # Rename atomically: several processes build it at once, and a running program must not be overwritten.
        part = program.with_suffix(f".{os.getpid()}")
        _run(["gcc", "-O2", "-o", str(part), str(path), *libraries], "", "gcc and flite1-dev")
        part.replace(program)
    return program


class Festival:
    """festival's voices, in one run of the program per batch."""

    def __init__(self, speaker: str) -> None:
        self.speaker, self.name = speaker, f"festival-{speaker}"

    def speak(self, lines: Sequence[Line]) -> Iterator[Utterance]:
        script = (resources.files("umo_train.speech") / "festival_times.scm").read_text()
        with tempfile.TemporaryDirectory() as folder:
            calls = [script, f"(voice_{self.speaker})\n"]
            for i, line in enumerate(lines):
                text = line.text.replace("\\", " ").replace('"', " ")
                calls.append(f'(umo_speak "{text}" {line.stretch:.3f} "{folder}/{i}.wav")\n')
            program = Path(folder, "lines.scm")
            program.write_text("".join(calls))
            blocks = _run(["festival", "--batch", str(program)], "", "festival and its voices").split("\n\n")
            for i, (line, block) in enumerate(zip(lines, blocks, strict=False)):
                samples = _read_wav(Path(folder, f"{i}.wav"))
                yield _utterance(self.name, line, samples, _segments(block))


# espeak-ng's mnemonics for English. A diphthong with r becomes its vowel and "er".
_ESPEAK = {
    "@": "ax", "3": "er", "3:": "er", "@L": "l", "@2": "ax", "@5": "ax", "a": "ae", "aa": "ae", "a#": "ax", "A:": "aa",
    "A": "aa", "A@": "aa", "A#": "aa", "E": "eh", "E2": "eh", "e@": "eh", "e:": "ey", "e": "eh", "eI": "ey", "I": "ih",
    "I2": "ih", "I#": "ih", "i": "iy", "i:": "iy", "i@": "ih", "i@3": "ih", "0": "aa", "0#": "aa", "O": "ao",
    "O:": "ao", "O@": "ao", "o@": "ao", "O2": "ao", "o:": "ow", "o": "ow", "OI": "oy", "oI": "oy", "oU": "ow",
    "aU": "aw", "aI": "ay", "aI@": "ay", "aI3": "ay", "aU@": "aw", "u:": "uw", "u": "uw", "U": "uh", "U@": "uh",
    "V": "ah", "VI": "ay", "p": "p", "b": "b", "t": "t", "t#": "d", "t2": "t", "d": "d", "d#": "d", "k": "k", "g": "g",
    "tS": "ch", "dZ": "jh", "f": "f", "v": "v", "T": "th", "D": "dh", "s": "s", "z": "z", "z#": "z", "S": "sh",
    "Z": "zh", "h": "hh", "m": "m", "n": "n", "n-": "n", "N": "ng", "l": "l", "l-": "l", "L": "l", "l#": "l", "r": "r",
    "r-": "r", "R": "r", "R2": "r", "w": "w", "w#": "w", "j": "y", "x": "k", "C": "hh", "?": "t", "m-": "m",
}  # fmt: skip

# Substitutes for sounds that English lacks, and for those with other mnemonics.
_ESPEAK_GERMAN = _ESPEAK | {
    "a": "aa", "3": "ax", "E:": "eh", "y:": "uw", "y": "uh", "Y:": "er", "W": "er", "W~": "er", "OY": "oy", "UR": "uh",
    "ts": "s", "pF": "f", "O~": "ao", "A~": "aa", "EI": "ey",
}  # fmt: skip

# Sounds of other languages by what lips do: closures are exact, and "B", the Spanish b between vowels, is none.
_ESPEAK_OTHER = {
    "a": "aa", "A": "aa", "0": "aa", "V": "ah", "&": "ah", "@": "ax", "3": "er", "8": "uh", "E": "eh", "e": "ey",
    "W": "er", "Y": "er", "y": "uw", "i": "iy", "I": "ih", "u": "uw", "U": "uh", "o": "ow", "O": "ao", "ju": "uw",
    "p": "p", "b": "b", "m": "m", "B": "v", "f": "f", "v": "v", "w": "w", "t": "t", "d": "d", "n": "n", "N": "ng",
    "k": "k", "g": "g", "Q": "g", "x": "k", "X": "k", "q": "k", "c": "k", "C": "hh", "h": "hh", "H": "hh", "?": "t",
    "s": "s", "z": "z", "S": "sh", "Z": "zh", "T": "th", "D": "dh", "l": "l", "L": "l", "r": "r", "R": "r", "*": "r",
    "**": "r", ";": "y", "j": "y", "tS": "ch", "dZ": "jh",
}  # fmt: skip


class Espeak:
    """espeak-ng through its C library, the only way to get times."""

    _WORD, _PHONEME, _LIST_END = 1, 7, 0
    _library: ctypes.CDLL | None = None
    # Delay of its phone events, measured by shifting them against the samples' energy: the same for every voice.
    LATE_S = 0.04

    class _Event(ctypes.Structure):
        _fields_ = (
            ("type", ctypes.c_int),
            ("unique_identifier", ctypes.c_uint),
            ("text_position", ctypes.c_int),
            ("length", ctypes.c_int),
            ("audio_position", ctypes.c_int),
            ("sample", ctypes.c_int),
            ("user_data", ctypes.c_void_p),
            ("id", ctypes.c_char * 8),
        )

    def __init__(self, language: str, variant: str = "") -> None:
        self.voice = f"{language}+{variant}" if variant else language
        self.name = f"espeak-{self.voice}"

    def speak(self, lines: Sequence[Line]) -> Iterator[Utterance]:
        library = self._load()
        if library.espeak_SetVoiceByName(self.voice.encode()):
            raise VoiceError(f"espeak-ng has no voice {self.voice}")
        for line in lines:
            rate, pitch = 1, 3
            library.espeak_SetParameter(rate, int(165 / line.stretch), 0)
            library.espeak_SetParameter(pitch, int(np.clip(50 * line.pitch, 1, 99)), 0)
            yield self._one(library, line)

    @classmethod
    def _load(cls) -> ctypes.CDLL:
        if cls._library is None:
            name = ctypes.util.find_library("espeak-ng")
            if name is None:
                raise VoiceError("libespeak-ng is missing: install libespeak-ng1 or libespeak-ng-dev")
            cls._library = ctypes.CDLL(name)
            synchronous, phoneme_events = 2, 1
            cls._rate = cls._library.espeak_Initialize(synchronous, 0, None, phoneme_events)
            if cls._rate <= 0:
                raise VoiceError("espeak-ng does not start: its data files are missing")
        return cls._library

    def _one(self, library: ctypes.CDLL, line: Line) -> Utterance:
        pieces: list[np.ndarray] = []
        events: list[tuple[int, int, int, int, str]] = []

        def hear(samples: object, count: int, event: object) -> int:
            if samples and count:
                pieces.append(np.ctypeslib.as_array(samples, (count,)).copy())
            i = 0
            while event[i].type != self._LIST_END:
                e = event[i]
                events.append((e.type, e.sample, e.text_position, e.length, e.id.decode("utf-8", "replace")))
                i += 1
            return 0

        pointer = ctypes.POINTER
        callback = ctypes.CFUNCTYPE(ctypes.c_int, pointer(ctypes.c_short), ctypes.c_int, pointer(self._Event))(hear)
        library.espeak_SetSynthCallback(callback)
        text, utf8, position_character = line.text.encode(), 1, 1
        library.espeak_Synth(text, len(text) + 1, 0, position_character, 0, utf8, None, None)
        library.espeak_Synchronize()
        raw = np.concatenate(pieces).astype(np.float32) / 32768
        common = gcd(self._rate, SAMPLE_RATE)
        samples = resample_poly(raw, SAMPLE_RATE // common, self._rate // common).astype(np.float32)
        return _utterance(self.name, line, samples, self._segments(line, events, len(raw) / self._rate))

    def _segments(self, line: Line, events: Sequence[tuple[int, int, int, int, str]], seconds: float) -> list[Segment]:
        """Events give the start of each phone, the text's transcription the stressed vowels."""
        rows: list[tuple[float, str, int, str]] = []
        word, text = 0, ""
        for kind, sample, position, length, name in events:
            if kind == self._WORD:
                word += 1
                text = line.text[max(position - 1, 0) : max(position - 1, 0) + length]
            elif kind == self._PHONEME:
                rows.append((max(sample / self._rate - self.LATE_S, 0.0), self._phone(name), word, text))
        stresses = self._stresses(line.text)
        vowels = [row for row in rows if row[1] in VOWELS]
        # If their numbers disagree, no vowel is marked as stressed.
        marked = iter(stresses if len(stresses) == len(vowels) else [False] * len(vowels))
        ends = [row[0] for row in rows[1:]] + [seconds]
        segments = []
        for (_, phone, word, text), end in zip(rows, ends, strict=True):
            stressed = phone in VOWELS and next(marked)
            # Function words carry a mark too; accents fall on longer ones.
            accented = stressed and len(text) > 3
            segments.append(Segment(phone, end, stressed, accented, 0 if phone == SILENCE else word, text))
        if rows and rows[0][0] > 0:
            segments.insert(0, Segment(SILENCE, rows[0][0], False, False, 0, ""))
        return segments

    def _phone(self, name: str) -> str:
        """A mnemonic as one of `PHONES`: by the longest known prefix."""
        known = {"en": _ESPEAK, "de": _ESPEAK_GERMAN}.get(self.voice[:2], _ESPEAK_OTHER)
        bare = name.lstrip("',%=_:;|!*")
        return known.get(name) or known.get(bare) or known.get(bare[:2]) or known.get(bare[:1]) or SILENCE

    def _stresses(self, text: str) -> list[bool]:
        """Whether each vowel of the transcription carries primary stress."""
        transcribe = self._load().espeak_TextToPhonemes
        transcribe.restype = ctypes.c_char_p
        rest = ctypes.c_char_p(text.encode())
        utf8, separated_by_underscore = 1, ord("_") << 8
        stresses = []
        while rest.value:
            clause = transcribe(ctypes.byref(rest), utf8, separated_by_underscore) or b""
            for name in clause.decode().replace(" ", "_").split("_"):
                if name and self._phone(name) in VOWELS:
                    stresses.append(name.startswith("'"))
        return stresses


def find(name: str) -> Voice:
    """The voice of a name in a config: `flite-slt`, `festival-ked_diphone`, `espeak-en-us+f3`."""
    program, _, speaker = name.partition("-")
    if program == "espeak":
        return Espeak(*speaker.split("+"))
    if program == "festival":
        return Festival(speaker)
    if program == "flite" and speaker in Flite.PITCH_HZ:
        return Flite(speaker)
    known = f"flite-{{{','.join(Flite.PITCH_HZ)}}}, festival-NAME or espeak-LANGUAGE[+VARIANT]"
    raise VoiceError(f"no voice {name}: {known}")
