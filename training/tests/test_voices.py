"""Voices report correct phone times. Voices whose program is missing are skipped."""

import ctypes.util
import shutil
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from umo_train.speech import variation, voices
from umo_train.speech.utterance import PHONES, SAMPLE_RATE, SILENCE, VOWELS, Utterance

NAMES = (
    "flite-slt",
    "flite-rms",
    "flite-awb",
    "flite-kal",
    "festival-kal_diphone",
    "festival-ked_diphone",
    "festival-cmu_us_slt_arctic_hts",
    "espeak-en-us",
    "espeak-en-gb-x-rp+f4",
)
LINES = (
    voices.Line("Maybe we should open all of the windows, and then go out.", stretch=1.1),
    voices.Line("Bob pushed five boxes over a fabulous bridge in the morning."),
    voices.Line("Honestly, my mother never measured anything.", stretch=0.9, pitch=1.1),
)
STEP = 80


def _needs(name: str) -> None:
    program, _, speaker = name.partition("-")
    if program == "flite":
        found = shutil.which("gcc") and any(Path("/usr/include").glob("**/flite/flite.h"))
        missing = None if found else "gcc and flite1-dev"
    elif program == "festival":
        there = shutil.which("festival") and any(Path("/usr/share/festival/voices").glob(f"*/{speaker}"))
        missing = None if there else f"festival and its voice {speaker}"
    else:
        missing = None if ctypes.util.find_library("espeak-ng") else "libespeak-ng-dev"
    if missing:
        pytest.skip(f"{name} is missing: install {missing}")


@cache
def _spoken(name: str) -> tuple[Utterance, ...]:
    return tuple(voices.find(name).speak(LINES))


def _displacement(utterance: Utterance, late: float) -> float:
    """Shift in seconds that phones delayed by `late` seconds need for vowels to be loudest and pauses quietest."""
    level = np.add.reduceat(utterance.samples**2, np.arange(0, len(utterance.samples), STEP))
    decibels = 10 * np.log10(level + 1e-5)
    kind = np.zeros(len(decibels))
    for phone in utterance.phones:
        first, last = ((t + late) * SAMPLE_RATE / STEP for t in (phone.start, phone.end))
        kind[max(0, round(first)) : max(0, round(last))] = (phone.name in VOWELS) - 2.0 * (phone.name == SILENCE)
    reach = int(0.15 * SAMPLE_RATE / STEP)
    fits = []
    for lag in range(-reach, reach + 1):
        moved = np.pad(kind, reach, constant_values=-2.0)[reach - lag : reach - lag + len(kind)]
        fits.append(np.corrcoef(moved, decibels)[0, 1])
    return (int(np.argmax(fits)) - reach) * STEP / SAMPLE_RATE


@pytest.mark.parametrize("name", NAMES)
def test_labels_agree_with_energy(name: str) -> None:
    _needs(name)
    together = variation.joined(list(_spoken(name)), [0.2] * (len(LINES) + 1))
    assert abs(_displacement(together, 0.0)) <= 0.030
    # Wrong labels are detected.
    assert _displacement(together, 0.08) == pytest.approx(-0.08, abs=0.03)


@pytest.mark.parametrize("name", NAMES)
def test_phones_cover_all_time(name: str) -> None:
    _needs(name)
    spoken = _spoken(name)
    assert len(spoken) == len(LINES)
    for line, utterance in zip(LINES, spoken, strict=True):
        assert utterance.voice == name and utterance.text == line.text and utterance.samples.dtype == np.float32
        assert 1.0 < utterance.seconds < 8.0 and 0.02 < np.abs(utterance.samples).max() <= 1.0
        ends = [0.0, *(phone.end for phone in utterance.phones)]
        np.testing.assert_allclose(ends, [*(p.start for p in utterance.phones), utterance.seconds], atol=1e-6)
        assert {phone.name for phone in utterance.phones} <= PHONES
        assert all(phone.end > phone.start for phone in utterance.phones)
        assert all(phone.stress == 0 for phone in utterance.phones if phone.name not in VOWELS)
        # Long words have their stress.
        assert sum(phone.stress > 0 for phone in utterance.phones) >= 4


@pytest.mark.parametrize("name", NAMES)
def test_words_are_those_of_the_text(name: str) -> None:
    _needs(name)
    for line, utterance in zip(LINES, _spoken(name), strict=True):
        wanted = [word.strip(",.").lower() for word in line.text.split()]
        heard = [word.text.strip(",.").lower() for word in utterance.words]
        # Voices may merge short words.
        assert len(set(wanted) & set(heard)) >= 0.7 * len(set(wanted)), heard
        assert all(a.end <= b.start + 1e-6 for a, b in pairwise(utterance.words))


@pytest.mark.parametrize("name", ["flite-slt", "espeak-en-us", "festival-kal_diphone"])
def test_stretch_makes_speech_longer(name: str) -> None:
    _needs(name)
    text = LINES[1].text
    quick, slow = voices.find(name).speak([voices.Line(text, 0.85), voices.Line(text, 1.25)])
    assert slow.seconds > 1.2 * quick.seconds


def test_unknown_voices_are_refused_with_the_known() -> None:
    with pytest.raises(voices.VoiceError, match="slt"):
        voices.find("flite-nobody")


def test_a_missing_program_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(voices.VoiceError, match="install festival"):
        list(voices.find("festival-kal_diphone").speak(LINES[:1]))
