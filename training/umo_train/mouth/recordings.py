"""Recorded voices with the times of their phones, found by pocketsphinx, whose English model and dictionary are free.

    python -m umo_train.mouth.recordings FOLDER --out WORK/corpus/recordings

`FOLDER/text.csv` has `name|text`, `FOLDER/NAME.EXTENSION` the sound. Clips with a word that the dictionary lacks, or
whose text does not fit, are left out.
"""

import argparse
import csv
import re
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import soundfile
from scipy.signal import resample_poly
from tqdm import tqdm

from umo_train.data.corpus import Item, write_item
from umo_train.speech.utterance import PHONES, SAMPLE_RATE, SILENCE, VOWELS, Phone, Utterance, Word
from umo_train.speech.variation import leveled

_FRAME_S = 0.01
# Names of pocketsphinx that say silence or noise.
_NOISES = frozenset({"SIL", "+NSN+", "+SPN+"})
# An AH that is shorter is the reduced vowel: the dictionary does not tell them apart.
_REDUCED_S = 0.08


def read(path: Path) -> np.ndarray:
    """Samples at 16 kHz, mono."""
    samples, rate = soundfile.read(path, dtype="float32", always_2d=True)
    return resample_poly(samples.mean(1), SAMPLE_RATE, rate).astype(np.float32)


def align(samples: np.ndarray, text: str) -> Utterance | None:
    """The utterance with the times of its phones, or nothing where the text does not fit."""
    from pocketsphinx import Decoder

    words = re.sub(r"[^a-z' ]", " ", text.lower()).split()
    decoder = Decoder(lm=None, loglevel="FATAL")
    if not words or any(decoder.lookup_word(word) is None for word in words):
        return None
    raw = (np.clip(samples, -1, 1) * 32767).astype(np.int16).tobytes()
    # The first pass finds the words and how they are pronounced, the second their phones.
    decoder.set_align_text(" ".join(words))
    try:
        _decode(decoder, raw)
        if decoder.hyp() is None:
            return None
        decoder.set_alignment()
        _decode(decoder, raw)
    except RuntimeError:
        return None
    alignment = decoder.get_alignment()
    if alignment is None:
        return None
    phones: list[Phone] = []
    found: list[Word] = []
    for word in alignment:
        spoken = [_phone(phone) for phone in word]
        if spoken and spoken[0].name != SILENCE:
            name = re.sub(r"\(\d+\)$", "", word.name)
            found.append(Word(name, spoken[0].start, spoken[-1].end))
            spoken = _stressed(spoken, len(name) > 3)
        phones += spoken
    seconds = len(samples) / SAMPLE_RATE
    phones = _covering(phones, seconds)
    return Utterance("", text, samples, tuple(phones), tuple(found))


def _decode(decoder: Any, raw: bytes) -> None:
    decoder.start_utt()
    decoder.process_raw(raw, full_utt=True)
    decoder.end_utt()


def _phone(entry: Any) -> Phone:
    start, end = entry.start * _FRAME_S, (entry.start + entry.duration) * _FRAME_S
    name = SILENCE if entry.name in _NOISES else entry.name.lower()
    if name == "ah" and end - start < _REDUCED_S:
        name = "ax"
    assert name in PHONES, entry.name
    return Phone(name, start, end)


def _stressed(phones: list[Phone], accented: bool) -> list[Phone]:
    """The longest vowel of a word carries its stress: the dictionary does not say which does."""
    vowels = [i for i, phone in enumerate(phones) if phone.name in VOWELS - {"ax"}]
    if vowels:
        longest = max(vowels, key=lambda i: phones[i].end - phones[i].start)
        phones[longest] = replace(phones[longest], stress=1 + accented)
    return phones


def _covering(phones: list[Phone], seconds: float) -> list[Phone]:
    """Phones without gaps, neighbouring silences joined, up to the end."""
    out: list[Phone] = []
    at = 0.0
    for phone in (*phones, Phone(SILENCE, seconds, seconds)):
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


def _align_clip(job: tuple[Path, str, str, Path, int]) -> float:
    path, text, voice, out, index = job
    target = out / "speech" / f"{index:05}.npz"
    if not target.exists():
        utterance = align(leveled(read(path), 24), text)
        if utterance is None:
            return 0.0
        write_item(out, Item(f"{index:05}", "train", "neutral", "", index, replace(utterance, voice=voice)))
    return 1.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="recordings and text.csv")
    parser.add_argument("--out", type=Path, required=True, help="corpus to write")
    parser.add_argument("--every", type=int, default=1, help="take every n-th clip (default: all)")
    parser.add_argument("--workers", type=int, default=1)
    options = parser.parse_args()
    sounds = {path.stem: path for path in options.folder.iterdir() if path.suffix != ".csv"}
    with (options.folder / "text.csv").open() as file:
        rows = [row for row in csv.reader(file, delimiter="|", quoting=csv.QUOTE_NONE) if row and row[0] in sounds]
    jobs = [
        (sounds[name], text, options.folder.name, options.out, index)
        for index, (name, text, *_) in enumerate(rows)
        if index % options.every == 0
    ]
    with ProcessPoolExecutor(options.workers) as pool:
        aligned = sum(tqdm(pool.map(_align_clip, jobs), "aligned", len(jobs), unit="clip"))
    print(f"{aligned:.0f} of {len(jobs)} clips")


if __name__ == "__main__":
    main()
