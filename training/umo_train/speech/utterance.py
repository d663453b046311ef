"""Speech with phone and word times: output of voices, input of the performer."""

from dataclasses import dataclass, field

import numpy as np

SAMPLE_RATE = 16000
FRAME_RATE = 30
SILENCE = "pau"
VOWELS = frozenset("aa ae ah ao aw ax ay eh er ey ih iy ow oy uh uw".split())
# CMU's set in lower case with the reduced vowel "ax"; every voice's own names are mapped to it.
PHONES = VOWELS | frozenset("b ch d dh f g hh jh k l m n ng p r s sh t th v w y z zh".split()) | {SILENCE}


@dataclass(frozen=True)
class Phone:
    """One of `PHONES`, from `start` to `end` in seconds."""

    name: str
    start: float
    end: float
    # For vowels: 0 unstressed, 1 the stressed syllable of its word, 2 that of an accented word. Others: 0.
    stress: int = 0


@dataclass(frozen=True)
class Word:
    """A word as written, in seconds."""

    text: str
    start: float
    end: float


@dataclass(frozen=True)
class Utterance:
    """Samples at 16 kHz, -1..1, with phones that cover the whole duration (silences included) and words."""

    voice: str
    text: str
    samples: np.ndarray
    phones: tuple[Phone, ...]
    words: tuple[Word, ...] = field(default=())

    @property
    def seconds(self) -> float:
        return len(self.samples) / SAMPLE_RATE

    @property
    def frames(self) -> int:
        """Number of frames of its motion: `floor(seconds * 30)`."""
        return len(self.samples) * FRAME_RATE // SAMPLE_RATE
