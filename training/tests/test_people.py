"""People's recordings: their formats, the phones and accents found in them, and the resulting items."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import soundfile

from umo_train.data import corpus
from umo_train.data.clip import DataError
from umo_train.people import align, check
from umo_train.people.accents import accented
from umo_train.people.make import FIRST, HELD_OUT, PeoplePlan, hours, make_people
from umo_train.people.recordings import recordings
from umo_train.performer import perform
from umo_train.performer.style import STYLES
from umo_train.speech import voices
from umo_train.speech.utterance import SAMPLE_RATE, SILENCE, Phone, Utterance

TEXTS = ("the small boat came home before the rain", "people move more than we believe")


def _sound(path: Path, samples: np.ndarray | None = None) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    soundfile.write(path, np.full(1600, 0.1, np.float32) if samples is None else samples, SAMPLE_RATE)
    return path


def _texts(path: Path, *lines: str) -> None:
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


@pytest.fixture(scope="module")
def slt() -> list[Utterance]:
    return list(voices.find("flite-slt").speak([voices.Line(text) for text in TEXTS]))


def test_published_forms_are_read(tmp_path: Path) -> None:
    for name in ("ada/a1.wav", "ada/a2.flac", "lj/wavs/LJ1.wav", "libri/7/9/7-9-0001.flac", "libri/8/9/8-9-0001.flac"):
        _sound(tmp_path / name)
    _texts(tmp_path / "ada/text.csv", 'a1|He said "no".', "a3|Of a file that is not here.")
    _texts(tmp_path / "lj/metadata.csv", "LJ1|Of 2 forms.|Of two forms.")
    _texts(tmp_path / "libri/7/9/7-9.trans.txt", "7-9-0001 A TEXT")
    ada, lj, libri = (recordings(tmp_path / name) for name in ("ada", "lj", "libri"))
    assert [(one.name, one.reader, one.text) for one in ada] == [("a1", "ada", 'He said "no".'), ("a2", "ada", None)]
    assert [one.text for one in lj] == ["Of two forms."]
    assert [(one.reader, one.text) for one in libri] == [("libri-7", "a text"), ("libri-8", None)]


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no such folder"):
        recordings(tmp_path / "none")
    with pytest.raises(DataError, match="no sound file"):
        recordings(tmp_path)
    _sound(tmp_path / "a.wav")
    _texts(tmp_path / "text.csv", "b|Another file's.")
    with pytest.raises(DataError, match="of other files, as b"):
        recordings(tmp_path)
    _texts(tmp_path / "text.csv", "a no line of two columns")
    with pytest.raises(DataError, match="line 1: expected a name and a text"):
        recordings(tmp_path)


def test_phones_of_a_known_text_are_where_they_are_spoken(slt: list[Utterance]) -> None:
    got = check.agreement(slt, lambda true: align.from_text(true.samples, true.text))
    assert got["found"] == 1 and got["frames"] > 0.75 and got["edge"] < 15 and got["lips"] > 0.85, got
    # The same with words pronounced by another program.
    got = check.agreement(slt, lambda true: align.from_text(true.samples, true.text, "en-us", dictionary=False))
    assert got["found"] == 1 and got["frames"] > 0.65 and got["edge"] < 20, got
    # Few match with another text.
    other = check.agreement(slt, lambda true: align.from_text(true.samples, "eleven awful owls"))
    assert other["found"] == 0 or other["frames"] < 0.4, other


def test_phones_are_found_without_a_text(slt: list[Utterance]) -> None:
    got = check.agreement(slt, lambda true: align.from_sound(true.samples))
    assert got["found"] == 1 and got["shapes"] > 0.55 and got["edge"] < 20, got
    assert align.from_sound(np.zeros(SAMPLE_RATE, np.float32)) is None


def test_words_that_no_dictionary_has_are_pronounced() -> None:
    (true,) = voices.find("flite-slt").speak([voices.Line("the old zorbleen moved")])
    found = align.from_text(true.samples, "The old zorbleen, moved …")
    assert found is not None
    assert [word.text for word in found.words] == ["The", "old", "zorbleen", "moved"]
    assert abs(found.words[2].start - true.words[2].start) < 0.06


def test_german_is_aligned_and_warped() -> None:
    lines = [voices.Line("Man möchte fünf Bäume pflanzen, und zwei Äpfel essen.")]
    true = list(voices.find("espeak-de+f2").speak(lines))
    for method in check.methods("de").values():
        got = check.agreement(true, method)
        assert got["found"] == 1 and got["shapes"] > 0.4 and got["edge"] < 40 and got["lips"] > 0.7, got
    assert not {"uh", "er", "oy"} - {phone.name for phone in true[0].phones}


@pytest.mark.parametrize("way", ["text", "sound", "synthesiser"])
def test_pauses_are_those_of_the_recording(slt: list[Utterance], way: str) -> None:
    true = slt[0]
    word = true.words[4]
    cut = int(word.start * SAMPLE_RATE)
    noise = 1e-4 * np.random.default_rng(0).standard_normal(SAMPLE_RATE // 2).astype(np.float32)
    samples = np.concatenate([true.samples[:cut], noise, true.samples[cut:]])
    find = {
        "text": lambda: align.from_text(samples, true.text),
        "sound": lambda: align.from_sound(samples),
        "synthesiser": lambda: align.from_synthesiser(samples, true.text, "en-us"),
    }
    found = find[way]()
    start, end = cut / SAMPLE_RATE, (cut + len(noise)) / SAMPLE_RATE
    inside = [phone for phone in found.phones if phone.end > start + 0.06 and phone.start < end - 0.06]
    assert {phone.name for phone in inside} == {SILENCE}
    assert found.phones[0].start == 0 and found.phones[-1].end == len(samples) / SAMPLE_RATE
    assert all(a.end == b.start for a, b in zip(found.phones, found.phones[1:], strict=False))


def _vowels(high: int | None, loud: int | None) -> Utterance:
    """Twelve vowels between consonants; one is a fourth higher, another 8 dB louder than the rest."""
    phones, pieces, at = [], [], 0.0
    for k in range(12):
        t = np.arange(int(0.16 * SAMPLE_RATE)) / SAMPLE_RATE
        hertz = 150 * (2 ** (5 / 12) if k == high else 1.0)
        wave = sum(np.sin(2 * np.pi * n * hertz * t) / n for n in range(1, 8))
        pieces += [0.05 * wave * (2.5 if k == loud else 1.0), np.zeros(int(0.08 * SAMPLE_RATE))]
        phones += [Phone("aa", at, at + 0.16), Phone("t", at + 0.16, at + 0.24)]
        at += 0.24
    samples = np.concatenate(pieces).astype(np.float32)
    return Utterance("", "", samples, (*phones, Phone(SILENCE, at, at + 1e-3)))


@pytest.mark.parametrize(("high", "loud"), [(3, 8), (9, 5)])
def test_what_stands_out_is_accented(high: int, loud: int) -> None:
    found = accented(_vowels(high, loud))
    assert [i // 2 for i, phone in enumerate(found.phones) if phone.stress == 2] == sorted((high, loud))
    # The text's accents do not count, and without vowels there are none.
    told = replace(found, phones=tuple(replace(phone, stress=2) for phone in _vowels(None, None).phones))
    assert not any(phone.stress == 2 for phone in accented(replace(told, samples=_vowels(None, None).samples)).phones)
    assert accented(Utterance("", "", np.zeros(160, np.float32), ())).phones == ()


def test_people_become_items(tmp_path: Path, slt: list[Utterance]) -> None:
    for reader in range(100, 111):
        _sound(tmp_path / f"read/{reader}-1-0001.wav", slt[reader % 2].samples)
    for k, spoken in enumerate(slt):
        _sound(tmp_path / f"one/s{k}.wav", spoken.samples)
    _texts(tmp_path / "one/text.csv", *(f"s{k}|{text}" for k, text in enumerate(TEXTS)))
    plan = PeoplePlan(tmp_path, {"one": "en", "read": "en"}, seconds_per_item=4.0, takes=2, seed=3)
    folder = tmp_path / "corpus"
    make_people(plan, folder, 1)
    items = list(corpus.items(folder))
    train = [item for item in items if item.split == "train"]
    held = [item for item in items if item.split == HELD_OUT]
    # Both sentences of a reader form one item; every tenth reader is held out.
    assert len(train) == 2 * (1 + 10) and [item.utterance.voice for item in held] == [corpus.PEOPLE + "read-109"]
    first, second = train[:2]
    assert [item.name for item in (first, second)] == [f"{FIRST:05}", f"{FIRST + 1:05}"]
    assert first.utterance.text == " ".join(TEXTS) and len(first.utterance.words) == 14
    assert first.utterance.seconds != second.utterance.seconds or first.style != second.style
    assert any(phone.stress == 2 for phone in first.utterance.phones)
    assert hours(folder)["people"] > 0 and hours(folder)["synthesisers"] == 0
    # A second run makes nothing, and missing files of a first run are remade identically.
    before = (folder / f"speech/{FIRST}.npz").stat().st_mtime_ns
    make_people(plan, folder, 1)
    assert (folder / f"speech/{FIRST}.npz").stat().st_mtime_ns == before
    again = tmp_path / "again"
    make_people(plan, again, 1)
    assert all(
        np.array_equal(a.utterance.samples, b.utterance.samples)
        for a, b in zip(items, corpus.items(again), strict=True)
    )
    # The performer treats them like synthesisers' utterances.
    motion = perform(first.utterance, STYLES[first.style], first.seed)
    assert len(motion["upper"]) == first.utterance.frames
