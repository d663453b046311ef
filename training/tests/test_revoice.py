import sys
from dataclasses import replace

import numpy as np
import pytest
import soundfile

from umo_train.data import corpus
from umo_train.speech import revoice, voices
from umo_train.speech.utterance import SAMPLE_RATE, Phone, Utterance, Word
from umo_train.speech.voices import Line, VoiceError
from umo_train.speech.warp import warped


def tone(hertz: float, seconds: float) -> np.ndarray:
    return np.sin(2 * np.pi * hertz * np.arange(int(seconds * SAMPLE_RATE)) / SAMPLE_RATE).astype(np.float32)


def pitch(samples: np.ndarray) -> float:
    spectrum = np.abs(np.fft.rfft(samples * np.hanning(len(samples)), 1 << 17))
    return float(spectrum.argmax() * SAMPLE_RATE / (1 << 17))


@pytest.mark.parametrize("factor", [0.5, 0.8, 1.0, 1.6, 2.5])
def test_pitch_and_loudness_stay_at_any_speed(factor):
    samples = tone(170.0, 1.0)
    out = warped(samples, np.array([0.0, 1.0]), np.array([0.0, factor]), int(factor * SAMPLE_RATE))
    inner = out[2000:-2000]
    assert abs(pitch(inner) - 170) < 2
    assert abs(np.sqrt(np.mean(inner**2)) - 0.5**0.5) < 0.03
    if factor == 1.0:
        np.testing.assert_allclose(inner, samples[2000:-2000], atol=1e-5)


def test_clicks_land_where_they_are_wanted():
    heard, wanted = np.array([0.1, 0.3, 0.45, 0.8, 1.0]), np.array([0.05, 0.4, 0.5, 0.7, 1.3])
    samples = np.zeros(int(1.2 * SAMPLE_RATE), np.float32)
    for time in heard:
        at = int(time * SAMPLE_RATE)
        samples[at : at + 160] = np.random.default_rng(at).normal(size=160)
    out = warped(samples, heard, wanted, int(1.5 * SAMPLE_RATE))
    for time in wanted:
        near = slice(max(int((time - 0.05) * SAMPLE_RATE), 0), int((time + 0.05) * SAMPLE_RATE))
        loud = np.abs(out[near])
        centre = near.start / SAMPLE_RATE + (loud * np.arange(len(loud))).sum() / loud.sum() / SAMPLE_RATE
        assert abs(centre - time - 0.005) < 0.02, time


class Bursts:
    """A voice that speaks each word as noise in its own band, at times that it reports or not."""

    def __init__(self, speed: float, told: bool) -> None:
        self.name, self.speed, self.told = f"bursts {speed}", speed, told

    def speak(self, lines):
        for line in lines:
            words, at = [], 0.1
            for i, text in enumerate(line.text.split()):
                length = (0.15 + 0.05 * (i % 3)) * self.speed
                words.append(Word(text, at, at + length))
                at += length + (0.08 if i % 2 else 0.0)
            samples = np.zeros(int((at + 0.2) * SAMPLE_RATE), np.float32)
            for word in words:
                first, last = int(word.start * SAMPLE_RATE), int(word.end * SAMPLE_RATE)
                samples[first:last] = tone(BAND[word.text], 2.0)[: last - first]
            yield Utterance(self.name, line.text, samples, (), tuple(words) if self.told else ())


BAND = {"one": 300.0, "two": 620.0, "three": 1100.0, "four": 1700.0, "five": 2600.0, "six": 3900.0}
TIMES = [(0.2, 0.5), (0.5, 0.62), (0.75, 1.2), (1.9, 2.1), (2.1, 2.6), (2.7, 2.8)]


def spoken_bursts() -> Utterance:
    samples = np.zeros(3 * SAMPLE_RATE, np.float32)
    words = [Word(text, *times) for text, times in zip(BAND, TIMES, strict=True)]
    for word in words:
        first, last = int(word.start * SAMPLE_RATE), int(word.end * SAMPLE_RATE)
        samples[first:last] = tone(BAND[word.text], 1.0)[: last - first]
    return Utterance("original", " ".join(BAND), samples, (), tuple(words))


def heard_words(samples: np.ndarray) -> dict[str, tuple[float, float]]:
    """Start and end of the loud part of each word's band, to 10 ms."""
    frames = np.lib.stride_tricks.sliding_window_view(samples, 320)[::80]
    spectrum = np.abs(np.fft.rfft(frames * np.hanning(320), 1024))
    out = {}
    for text, hertz in BAND.items():
        level = spectrum[:, round(hertz * 1024 / SAMPLE_RATE)]
        loud = np.flatnonzero(level > 0.4 * level.max())
        out[text] = ((loud[0] * 80 + 160) / SAMPLE_RATE, (loud[-1] * 80 + 160) / SAMPLE_RATE)
    return out


@pytest.mark.parametrize("told", [True, False])
@pytest.mark.parametrize("speed", [0.6, 1.0, 1.7])
def test_words_land_within_40_ms(told, speed):
    """Whether the voice reports word times, or they are found by similarity."""
    original = spoken_bursts()
    out = revoice.revoiced(original, Bursts(speed, told))
    assert out.shape == original.samples.shape
    for word in original.words:
        start, end = heard_words(out)[word.text]
        assert abs(start - word.start) < 0.04 and abs(end - word.end) < 0.04, word
    # Silence where nobody speaks.
    assert np.abs(out[int(1.3 * SAMPLE_RATE) : int(1.8 * SAMPLE_RATE)]).max() == 0


def test_words_that_a_voice_reads_otherwise_move_together():
    ours = [Word("in", 0.0, 0.2), Word("1984", 0.2, 1.0), Word("it", 1.0, 1.3)]
    texts = "in nineteen eighty four it".split()
    theirs = tuple(Word(text, 0.3 * i, 0.3 * i + 0.3) for i, text in enumerate(texts))
    original = Utterance("a", "", np.zeros(2 * SAMPLE_RATE, np.float32), (), tuple(ours))
    spoken = Utterance("b", "", np.zeros(2 * SAMPLE_RATE, np.float32), (), theirs)
    heard, wanted = revoice._anchors(original, ours, spoken)
    np.testing.assert_allclose(np.interp([0.3, 1.2, 1.5], heard, wanted), [0.2, 1.0, 1.3], atol=0.005)


def test_phones_are_anchors_inside_words():
    word = Word("map", 0.0, 0.6)
    ours = (Phone("m", 0.0, 0.3), Phone("ae", 0.3, 0.5, 1), Phone("p", 0.5, 0.6))
    theirs = (Phone("m", 0.1, 0.15), Phone("ae", 0.15, 0.4, 1), Phone("p", 0.4, 0.5))
    empty = np.zeros(SAMPLE_RATE, np.float32)
    original = Utterance("a", "map", empty, ours, (word,))
    spoken = Utterance("b", "map", empty, theirs, (Word("map", 0.1, 0.5),))
    heard, wanted = revoice._anchors(original, [word], spoken)
    np.testing.assert_allclose(heard, [0.1, 0.15, 0.4, 0.5])
    np.testing.assert_allclose(wanted, [0.0, 0.3, 0.5, 0.6])


@pytest.fixture(scope="module")
def sentence():
    try:
        return next(iter(voices.find("espeak-en-us").speak([Line("the quick brown fox jumps over a lazy dog today")])))
    except VoiceError as error:
        pytest.skip(str(error))


def test_real_voices_are_found_in_each_other(sentence):
    """A synthetic speaker's words found by similarity in another's speech, compared with the reported times."""
    other = next(iter(voices.find("espeak-en-us+f3").speak([Line(sentence.text, 1.3, 1.3)])))
    silent = replace(other, words=(), phones=())
    heard, wanted = revoice._anchors(sentence, list(sentence.words), silent)
    told_heard, told_wanted = (np.array([w.start for w in u.words]) for u in (other, sentence))
    error = np.abs(np.interp(told_heard, heard, wanted) - told_wanted)
    assert error.max() < 0.04, error


def test_a_command_is_a_voice(tmp_path, sentence):
    program = tmp_path / "speak.py"
    program.write_text(
        "import sys, shutil\n"
        "text, wav, words = sys.argv[1:]\n"
        f"assert text == {sentence.text!r}, text\n"
        f"shutil.copy({str(tmp_path / 'said.wav')!r}, wav)\n"
        "open(words, 'w').write('0.1 0.4 the\\n0.4 0.9 quick\\n')\n"
    )
    soundfile.write(tmp_path / "said.wav", sentence.samples, SAMPLE_RATE)
    voice = revoice.find({"name": "mine", "command": f"{sys.executable} {program} {{text}} {{wav}} {{words}}"})
    said = next(iter(voice.speak([Line(sentence.text)])))
    assert said.words == (Word("the", 0.1, 0.4), Word("quick", 0.4, 0.9))
    np.testing.assert_allclose(said.samples, sentence.samples, atol=1e-4)
    with pytest.raises(VoiceError, match="program nowhere not found"):
        list(revoice.CommandVoice("x", "nowhere {text} {wav}").speak([Line("a")]))
    with pytest.raises(VoiceError, match="failed with 1"):
        list(revoice.CommandVoice("x", f"{sys.executable} {program} other {{wav}} {{words}}").speak([Line("a")]))
    with pytest.raises(VoiceError, match="wrote no file"):
        list(revoice.CommandVoice("x", f"{sys.executable} -c pass").speak([Line("a")]))


def test_training_items_get_a_row_for_each_voice(tmp_path):
    for i, split in enumerate(("train", "test")):
        corpus.write_item(tmp_path, corpus.Item(f"{i:05}", split, "", "", i, spoken_bursts()))
    revoice.revoice_corpus(tmp_path, [Bursts(0.8, True), Bursts(1.4, True)], 1)
    first, second = (corpus.read_voices(path) for path in corpus.paths(tmp_path, "speech"))
    assert [len(samples) for samples in first] == [3 * SAMPLE_RATE] * 2 and second == []
    assert np.abs(first[0] - first[1]).max() > 0.1
