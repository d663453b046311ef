"""Synthetic speech with known phones, and the performer's analysis of it."""

import numpy as np
import pytest

from umo_train.performer import perform
from umo_train.performer.prosody import listen
from umo_train.performer.style import STYLES
from umo_train.speech.utterance import SAMPLE_RATE, SILENCE, VOWELS, Phone, Utterance

# Sentences as phones; 1 and 2 after a vowel are its stress.
SENTENCES = (
    "hh ax l ow2 m ay1 f r eh2 n d".split(),
    "w iy1 w er ax b aw1 t t ax g ow2 d aw1 n t ax dh ax m aa2 r k ih t".split(),
    "p iy2 p ax l b ay1 b r eh2 d ae n d m ih1 l k".split(),
    "y uw2 m ey1 hh ae v ax v y uw2 ax v dh ax r ih2 v er".split(),
)


def speech(sentences=SENTENCES, pause: float = 0.5, gain_db=lambda at: 0.0, voice: str = "made") -> Utterance:
    """Sentences between pauses: a buzz for vowels, weaker for voiced sounds, noise for the rest."""
    random = np.random.default_rng(5)
    phones, at = [Phone(SILENCE, 0.0, pause)], pause
    for sentence in sentences:
        for name in sentence:
            stress = int(name[-1]) if name[-1].isdigit() else 0
            name = name.rstrip("012")
            length = (0.09 + 0.03 * stress if name in VOWELS else 0.07) + random.uniform(0.0, 0.02)
            phones.append(Phone(name, at, at + length, stress))
            at += length
        phones.append(Phone(SILENCE, at, at + pause))
        at += pause
    samples = np.zeros(round(at * SAMPLE_RATE))
    for phone in phones:
        first, last = round(phone.start * SAMPLE_RATE), round(phone.end * SAMPLE_RATE)
        t = np.arange(first, last) / SAMPLE_RATE
        loud = 10.0 ** (gain_db(phone.start) / 20.0)
        if phone.name in VOWELS:
            samples[first:last] = (0.2 + 0.05 * phone.stress) * loud * np.sin(2.0 * np.pi * 140.0 * t)
        elif phone.name != SILENCE:
            samples[first:last] = 0.03 * loud * random.standard_normal(last - first)
    return Utterance(voice, "", samples.astype(np.float32), tuple(phones))


@pytest.fixture(scope="session")
def utterance() -> Utterance:
    return speech()


def test_phrases_lie_between_pauses():
    made = speech()
    phrases = listen(made).phrases
    assert len(phrases) == len(SENTENCES)
    pauses = [p for p in made.phones if p.name == SILENCE]
    np.testing.assert_allclose(phrases[:, 0], [p.end for p in pauses[:-1]])
    np.testing.assert_allclose(phrases[:, 1], [p.start for p in pauses[1:]])


def test_accents_are_the_accented_vowels():
    made = speech()
    marked = [p for p in made.phones if p.stress == 2]
    accents = listen(made).accents
    assert 0.8 * len(marked) <= len(accents) <= len(marked)
    for at in accents:
        assert any(p.start <= at <= p.end for p in marked)


def test_given_accents_are_those_of_the_nearest_vowels():
    made = speech()
    own = listen(made).accents
    vowels = [p for p in made.phones if p.name in VOWELS and p.stress < 2]
    given = np.array([vowels[1].start + 0.05, own[2], own[2] + 60.0])
    heard = listen(made, given).accents
    assert len(heard) == 2 and any(vowels[1].start <= at <= vowels[1].end for at in heard) and own[2] in heard
    # Accents come from the sound, even if phones would have some.
    assert len(listen(made, np.zeros(0)).accents) == 0
    moved = perform(made, STYLES["neutral"], 3, given)
    assert not np.array_equal(moved["upper"], perform(made, STYLES["neutral"], 3)["upper"])
    # The mouth follows the phones as before.
    mouth = slice(6, None)
    assert np.abs(moved["face"][:, mouth] - perform(made, STYLES["neutral"], 3)["face"][:, mouth]).mean() < 0.02


def test_accents_without_marks_are_prominent_vowels():
    bare = speech([[name.rstrip("012") for name in sentence] for sentence in SENTENCES])
    heard = listen(bare)
    assert len(heard.accents) >= len(SENTENCES)
    assert np.diff(heard.accents).min() >= 0.3


def test_level_is_relative_to_the_utterance():
    quiet, loud = (listen(speech(gain_db=lambda at, g=g: g)) for g in (-20.0, 0.0))
    spoken = np.zeros(len(loud.t), bool)
    for start, end in loud.phrases:
        spoken |= (loud.t > start) & (loud.t < end)
    assert np.abs(quiet.syllabic_db - loud.syllabic_db)[spoken].max() < 0.5
    assert loud.syllabic_db[spoken].mean() > loud.syllabic_db[~spoken].mean() + 10.0
