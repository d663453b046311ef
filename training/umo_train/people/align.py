"""Finds the phones of a recording and their times.

With a text: pocketsphinx, whose acoustic model and dictionary are free (`pip install pocketsphinx`). Words missing in
its dictionary, and those of other languages, are pronounced as by espeak-ng, mapped to English phones. English without
a text: pocketsphinx's most probable phones. Otherwise: the text spoken by espeak-ng, warped to the recording.
"""

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from umo_train.speech import voices
from umo_train.speech.utterance import PHONES, SAMPLE_RATE, SILENCE, VOWELS, Phone, Utterance, Word

_FRAME_S = 0.01
# Silence added around pocketsphinx's input: it misses words at the edges of the sound.
_MARGIN_S = 0.3
# pocketsphinx's names of silence and noise.
_NOISES = frozenset({"SIL", "+NSN+", "+SPN+", "<s>", "</s>", "<sil>"})
# A shorter AH is the reduced vowel: the dictionary does not distinguish them.
_REDUCED_S = 0.08
_PUNCTUATION = " ,.;:!?\"'()[]{}*_-\u2013\u2014\u201e\u201c\u201d\u2018\u2019\u00ab\u00bb"
# Pauses within a recording: this many decibels below its speech, for this long.
_PAUSE_DB, _PAUSE_S = 28.0, 0.15


def phones(samples: np.ndarray, text: str | None, language: str) -> Utterance | None:
    """The utterance with its phones, which cover its whole duration, and its words, if known; None if the text does not
    match the sound. `samples` at 16 kHz, `language` as named by espeak-ng."""
    if text is None:
        return from_sound(samples) if language.startswith("en") else None
    found = from_text(samples, text, language)
    if found is None:
        found = from_sound(samples, text) if language.startswith("en") else from_synthesiser(samples, text, language)
    return found


def from_text(
    samples: np.ndarray, text: str, language: str = "en", *, dictionary: bool | None = None
) -> Utterance | None:
    """From a known text; None if it does not match. Words are pronounced according to the English dictionary, if
    `language` is English and `dictionary` is true, else as by espeak-ng."""
    from pocketsphinx import Decoder

    # There is only one path to find. Unless `bestpath` is false, the decoder fails if the text is ambiguous.
    decoder = Decoder(lm=None, beam=1e-64, pbeam=1e-64, wbeam=1e-64, bestpath=False, loglevel="FATAL")
    words = [word for token in text.split() if (word := token.strip(_PUNCTUATION))]
    if not words:
        return None
    names = [_known(decoder, word, language, i, dictionary=dictionary is not False) for i, word in enumerate(words)]
    texts = {name: word for name, word in zip(names, words, strict=True) if name is not None}
    # The first pass finds the words and their pronunciations, the second their phones.
    decoder.set_align_text(" ".join(name for name in names if name is not None))
    try:
        _decode(decoder, samples)
        if decoder.hyp() is None:
            return None
        decoder.set_alignment()
        _decode(decoder, samples)
    except RuntimeError:
        return None
    alignment = decoder.get_alignment()
    if alignment is None:
        return None
    found: list[Phone] = []
    spoken: list[Word] = []
    for word in alignment:
        its = [_phone(phone.name, phone.start, phone.start + phone.duration) for phone in word]
        if its and its[0].name != SILENCE:
            spoken.append(Word(texts[re.sub(r"\(\d+\)$", "", word.name)], its[0].start, its[-1].end))
            its = stressed(its)
        found += its
    phones = covering(_paused(found, samples), len(samples) / SAMPLE_RATE)
    return Utterance("", text, samples, tuple(phones), tuple(spoken))


def _known(decoder: Any, word: str, language: str, number: int, *, dictionary: bool) -> str | None:
    """The decoder's name of a word; None if nothing of it is spoken."""
    name = word.lower().replace("\u2019", "'")
    if dictionary and language.startswith("en") and decoder.lookup_word(name) is not None:
        return name
    voice = voices.Espeak("en-us" if language == "en" else language)
    (spoken,) = voice.speak([voices.Line(word)])
    pronounced = [
        "AH" if phone.name == "ax" else phone.name.upper() for phone in spoken.phones if phone.name != SILENCE
    ]
    if not pronounced:
        return None
    name = f"word{number}"
    decoder.add_word(name, " ".join(pronounced), True)
    return name


def from_sound(samples: np.ndarray, text: str = "") -> Utterance | None:
    """From the sound alone: the most probable English phones, and no words; None without speech."""
    from pocketsphinx import Decoder, get_model_path

    if not samples.any():
        return None
    model = get_model_path("en-us/en-us-phone.lm.bin")
    decoder = Decoder(allphone=model, lm=None, dict=None, beam=1e-20, pbeam=1e-20, lw=2.0, loglevel="FATAL")
    try:
        _decode(decoder, samples)
    except RuntimeError:
        return None
    found = [_phone(entry.word, entry.start_frame, entry.end_frame + 1) for entry in decoder.seg() or ()]
    if all(phone.name == SILENCE for phone in found):
        return None
    return Utterance("", text, samples, tuple(covering(_paused(found, samples), len(samples) / SAMPLE_RATE)))


def from_synthesiser(samples: np.ndarray, text: str, language: str) -> Utterance | None:
    """From espeak-ng's speech of the text, warped to the recording by similarity; None if either has no sound."""
    from umo_train.speech import alike

    (spoken,) = voices.Espeak(language).speak([voices.Line(text)])
    sounding = [phone for phone in spoken.phones if phone.name != SILENCE]
    if not sounding or not samples.any():
        return None
    first, last = sounding[0].start, sounding[-1].end
    inside = [phone for phone in spoken.phones if first <= phone.start and phone.end <= last]
    wanted = np.array([phone.start for phone in inside] + [last])
    times = alike.heard(spoken.samples, wanted, samples)
    seconds = len(samples) / SAMPLE_RATE
    moved = [
        replace(phone, start=float(start), end=float(end))
        for phone, start, end in zip(inside, times, times[1:], strict=False)
    ]
    words = tuple(
        Word(word.text, float(np.interp(word.start, wanted, times)), float(np.interp(word.end, wanted, times)))
        for word in spoken.words
    )
    return Utterance("", text, samples, tuple(covering(_paused(moved, samples), seconds)), words)


def _decode(decoder: Any, samples: np.ndarray) -> None:
    padded = np.pad(samples, int(_MARGIN_S * SAMPLE_RATE))
    decoder.start_utt()
    decoder.process_raw((np.clip(padded, -1, 1) * 32767).astype(np.int16).tobytes(), full_utt=True)
    decoder.end_utt()


def _phone(name: str, first: int, end: int) -> Phone:
    """From pocketsphinx's phone, in frames."""
    ours = SILENCE if name in _NOISES else name.lower()
    if ours == "ah" and (end - first) * _FRAME_S < _REDUCED_S:
        ours = "ax"
    assert ours in PHONES, name
    return Phone(ours, max(first * _FRAME_S - _MARGIN_S, 0.0), max(end * _FRAME_S - _MARGIN_S, 0.0))


def stressed(word: list[Phone]) -> list[Phone]:
    """The longest vowel of a word gets its stress, which the dictionary does not mark."""
    vowels = [i for i, phone in enumerate(word) if phone.name in VOWELS - {"ax"}]
    if vowels:
        longest = max(vowels, key=lambda i: word[i].end - word[i].start)
        word[longest] = replace(word[longest], stress=1)
    return word


def covering(found: Sequence[Phone], seconds: float) -> list[Phone]:
    """Phones without gaps, neighbouring silences joined, up to the end."""
    out: list[Phone] = []
    at = 0.0
    for phone in (*found, Phone(SILENCE, seconds, seconds)):
        start, end = max(phone.start, at), min(phone.end, seconds)
        for name, first, last, stress in ((SILENCE, at, start, 0), (phone.name, start, end, phone.stress)):
            if last - first < 1e-6:
                continue
            if out and out[-1].name == name == SILENCE:
                out[-1] = replace(out[-1], end=last)
            else:
                out.append(Phone(name, first, last, stress))
            at = last
    return out


def _paused(found: list[Phone], samples: np.ndarray) -> list[Phone]:
    """Cuts phones where the reader is silent: pauses are detected, not guessed from a text."""
    hop = int(_FRAME_S * SAMPLE_RATE)
    count = len(samples) // hop
    power = (samples[: count * hop].astype(np.float64).reshape(count, hop) ** 2).mean(1)
    silent = power < np.quantile(power, 0.9) * 10 ** (-_PAUSE_DB / 10)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], silent, [False]]).astype(int)))
    pauses = [(a * _FRAME_S, b * _FRAME_S) for a, b in edges.reshape(-1, 2) if (b - a) * _FRAME_S >= _PAUSE_S]
    out = []
    for phone in found:
        start, end = phone.start, phone.end
        for first, last in pauses:
            if first <= start < last:
                start = min(last, end)
            elif start < first < end:
                end = first
        if end > start:
            out.append(replace(phone, start=start, end=end))
    return out
