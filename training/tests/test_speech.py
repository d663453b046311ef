"""Sentences depend on their seeds alone; speech augmentation keeps times correct."""

import random
from itertools import pairwise

import numpy as np
import pytest

from test_performer_speech import SENTENCES, speech
from umo_train.speech import variation
from umo_train.speech.sentences import sentence
from umo_train.speech.utterance import SAMPLE_RATE, SILENCE, Phone, Utterance, Word


def test_sentences_follow_from_their_seed() -> None:
    def drawn(seed: int) -> list[str]:
        chance = random.Random(seed)
        return [sentence(chance) for _ in range(50)]

    assert drawn(1) == drawn(1) and drawn(1) != drawn(2)
    texts = drawn(3)
    assert all(text[-1] in ".?" and text[0].isupper() and text.isascii() for text in texts)
    assert len(set(texts)) > 45


def _utterance(name: str, samples: int) -> Utterance:
    """A vowel between silences."""
    end = samples / SAMPLE_RATE
    phones = (Phone(SILENCE, 0, 0.1), Phone("aa", 0.1, end - 0.2, 1), Phone(SILENCE, end - 0.2, end))
    values = np.random.default_rng(samples).uniform(-0.5, 0.5, samples).astype(np.float32)
    values[: SAMPLE_RATE // 10] = 0
    values[-SAMPLE_RATE // 5 :] = 0
    return Utterance("made", name, values, phones, (Word(name, 0.1, end - 0.2),))


def _covered(utterance: Utterance) -> None:
    """Phones follow each other without gaps, from the first sample to the last, and no two silences are adjacent."""
    ends = [0.0, *(phone.end for phone in utterance.phones)]
    starts = [*(phone.start for phone in utterance.phones), utterance.seconds]
    np.testing.assert_allclose(ends, starts, atol=1e-9)
    names = [phone.name for phone in utterance.phones]
    assert not any(a == b == SILENCE for a, b in pairwise(names))


def test_joined_speech_keeps_times() -> None:
    one, two = _utterance("one", 16000), _utterance("two", 12000)
    joined = variation.joined([one, two], [0.5, 0.25, 1.0])
    assert joined.text == "one two" and len(joined.samples) == 8000 + 16000 + 4000 + 12000 + 16000
    _covered(joined)
    words = [(word.text, word.start, word.end) for word in joined.words]
    assert words == [("one", pytest.approx(0.6), pytest.approx(1.3)), ("two", pytest.approx(1.85), pytest.approx(2.3))]
    assert [phone.name for phone in joined.phones] == [SILENCE, "aa", SILENCE, "aa", SILENCE]
    # Samples match their times.
    for word, source in zip(joined.words, (one, two), strict=True):
        first = round(word.start * SAMPLE_RATE)
        np.testing.assert_array_equal(joined.samples[first : first + 100], source.samples[1600:1700])


def test_speech_joined_without_gaps_is_covered_too() -> None:
    _covered(variation.joined([_utterance("one", 16000), _utterance("two", 12345)], [0.0, 0.0, 0.0]))


@pytest.mark.parametrize("factor", [0.86, 1.0, 1.2])
def test_faster_speech_keeps_times(factor: float) -> None:
    source = speech(SENTENCES[:2])
    faster = variation.faster(source, factor)
    assert len(faster.samples) == pytest.approx(len(source.samples) / factor, rel=0.01)
    ends = [phone.end for phone in faster.phones]
    np.testing.assert_allclose(ends, [phone.end * faster.seconds / source.seconds for phone in source.phones])
    assert ends[-1] == pytest.approx(faster.seconds, abs=1e-3)

    def onset(utterance: Utterance) -> float:
        return float(np.argmax(np.abs(utterance.samples) > 0.02) / SAMPLE_RATE)

    # Speech begins where the labels say, before and after.
    for utterance in (source, faster):
        assert onset(utterance) == pytest.approx(utterance.phones[1].start, abs=0.02)


def test_levels_are_of_what_is_not_silent() -> None:
    tone = np.sin(np.arange(16000) * 0.3).astype(np.float32) * 0.2
    for samples in (tone, np.concatenate([np.zeros(30000, np.float32), tone])):
        loud = variation.leveled(samples, 20.0)[-16000:]
        assert 20 * np.log10(np.sqrt(np.mean(loud**2))) == pytest.approx(-20.0, abs=0.2)


def test_recordings_differ_and_keep_times() -> None:
    click = np.zeros(16000, np.float32)
    click[8000] = 0.9
    heard = [variation.recorded(click, np.random.default_rng(seed)) for seed in range(30)]
    np.testing.assert_array_equal(heard[0], variation.recorded(click, np.random.default_rng(0)))
    for samples in heard:
        assert len(samples) == len(click) and np.abs(samples).max() <= 1 and samples.dtype == np.float32
        # Rooms and filters smear, but the direct sound stays in place.
        assert abs(int(np.abs(samples).argmax()) - 8000) <= 16
    assert len({samples.tobytes() for samples in heard}) == len(heard)
    # Some are in rooms: much of the energy arrives later.
    late = [np.square(s[8100:12000]).sum() / np.square(s[7900:8100]).sum() for s in heard]
    assert min(late) < 0.01 and max(late) > 0.05
