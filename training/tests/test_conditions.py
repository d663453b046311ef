"""Sounds of the conditions, and what is measured of them and of languages."""

from unittest.mock import patch

import numpy as np
import pytest

from umo_train.metrics import conditions as measured
from umo_train.metrics import interval, languages, lips
from umo_train.metrics.item import Item
from umo_train.speech import conditions, voices
from umo_train.speech.utterance import FRAME_RATE, SAMPLE_RATE, SILENCE, Phone

PITCH = 120


def _speech(seconds: float = 3.0, pitch: float = PITCH, seed: int = 0) -> np.ndarray:
    """Syllables of a buzz through two formants, four a second, over a faint noise."""
    t = np.arange(int(seconds * SAMPLE_RATE)) / SAMPLE_RATE
    buzz = conditions._formants(conditions._voice(np.full(len(t), float(pitch))), (600, 1500), 100)
    loud = np.clip(np.sin(2 * np.pi * (2 + seed / 2) * t), 0, 1)
    return (0.1 * conditions.unit(buzz * loud) + 1e-4 * np.random.default_rng(seed).standard_normal(len(t))).astype(
        "f4"
    )


def _items() -> list[Item]:
    return [
        Item(f"{v}{i}", v, _speech(pitch=p, seed=i))
        for v, p, i in (("a", 110, 0), ("a", 110, 1), ("b", 200, 2), ("b", 200, 3))
    ]


@pytest.fixture(scope="module")
def takes() -> list[conditions.Take]:
    return conditions.takes(_items(), 6.0, 1)


def _rng() -> np.random.Generator:
    return np.random.default_rng(0)


def _rms(sound: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(sound))))


def _strength(samples: np.ndarray, hertz: float) -> float:
    """Power at a frequency over the mean of its surroundings."""
    power = np.abs(np.fft.rfft(samples * np.hanning(len(samples)))) ** 2
    at = round(hertz * len(samples) / SAMPLE_RATE)
    return power[at - 3 : at + 4].max() / power[at - 40 : at + 41].mean()


def _centroid(samples: np.ndarray) -> float:
    power = np.abs(np.fft.rfft(samples)) ** 2
    return float((np.fft.rfftfreq(len(samples), 1 / SAMPLE_RATE) * power).sum() / power.sum())


def test_takes_join_one_speakers_sentences_with_pauses(takes):
    assert [take.voice for take in takes] == ["a", "b"]
    for take in takes:
        assert [round(end - start, 2) for start, end in take.pauses] == [0.5, 1.6, 1.6]
        assert take.pauses[-1][1] == pytest.approx(len(take.samples) / SAMPLE_RATE)
        for start, end in take.pauses:
            assert 0 < np.abs(take.samples[int(start * SAMPLE_RATE) : int(end * SAMPLE_RATE)]).max() < 0.05


def test_pauses_sound_like_the_room():
    hum = 0.01 * np.sin(2 * np.pi * 100 * np.arange(3 * SAMPLE_RATE) / SAMPLE_RATE)
    noise = conditions._room(hum + 1e-3 * _rng().standard_normal(len(hum)), SAMPLE_RATE, _rng())
    assert _rms(noise) == pytest.approx(_rms(hum), rel=0.1)
    assert _centroid(noise) < 500


def test_every_condition_sounds_the_same_twice_and_keeps_time(takes):
    for one in conditions.conditions():
        first, again = (one.make(takes[0], takes, np.random.default_rng(3)) for _ in range(2))
        assert np.array_equal(first, again), one.name
        assert len(first) == pytest.approx(len(takes[0].samples) / one.tempo, abs=2), one.name
        assert np.isfinite(first).all() and 1e-4 < np.abs(first).max() <= 1, one.name
        assert not np.array_equal(first, takes[0].samples), one.name


@pytest.mark.parametrize("decibels", [20, 0])
def test_signal_to_noise_ratio(takes, decibels):
    speech = takes[0].samples
    noise = conditions.pink(len(speech), _rng())
    added = conditions.over(speech, noise, decibels) - speech
    assert 20 * np.log10(_rms(added)) == pytest.approx(-conditions.SPEECH_DB - decibels, abs=0.1)


def test_pink_noise_has_the_same_power_in_each_octave():
    power = np.abs(np.fft.rfft(conditions.pink(1 << 18, np.random.default_rng(1)))) ** 2

    def octave(low: float) -> float:
        return power[int(low * 2**18 / SAMPLE_RATE) : int(2 * low * 2**18 / SAMPLE_RATE)].sum()

    assert octave(250) == pytest.approx(octave(2000), rel=0.1)


def test_a_telephone_passes_its_band_only():
    tones = {hertz: np.sin(2 * np.pi * hertz * np.arange(SAMPLE_RATE) / SAMPLE_RATE) for hertz in (100, 1000, 6000)}
    heard = {
        hertz: _rms(conditions.telephone(0.3 * tone.astype("f4"))) / _rms(0.3 * tone) for hertz, tone in tones.items()
    }
    assert heard[1000] == pytest.approx(1, abs=0.1)
    assert heard[100] < 0.05 and heard[6000] < 0.05


def test_a_whisper_has_no_pitch_but_the_voices_syllables():
    speech = _speech()
    heard = conditions.whisper(speech, _rng())
    assert _strength(speech, 5 * PITCH) > 20
    assert _strength(heard, 5 * PITCH) < 8
    assert _rms(heard) < 0.2 * _rms(speech)
    assert lips.pearson(lips.envelope(speech, 90), lips.envelope(heard, 90)) > 0.9


def test_a_shout_is_higher_brighter_and_louder():
    speech = _speech()
    heard = conditions.shout(speech)
    high = PITCH * conditions.SHOUT_PITCH
    assert _strength(heard, 4 * high) > 2 * _strength(heard, 5 * PITCH)
    assert _centroid(heard) > 1.2 * _centroid(speech)
    assert _rms(heard) > 1.5 * _rms(speech)
    assert lips.pearson(lips.envelope(speech, 90), lips.envelope(heard, 90)) > 0.9


def test_quick_speech_keeps_its_pitch():
    heard = conditions.quick(_speech())
    assert len(heard) == 2 * SAMPLE_RATE
    assert _strength(heard, 4 * PITCH) > 10


@pytest.mark.parametrize("make", [conditions.laugh, conditions.cough])
def test_laughs_and_coughs_lie_within_pauses(takes, make):
    take = takes[0]
    heard = conditions.between(take, make, 0, _rng())
    added = np.abs(heard - take.samples) > 1e-6
    at = np.arange(len(added)) / SAMPLE_RATE
    for start, end in take.pauses[1:]:
        assert added[(at > start) & (at < end)].mean() > 0.3
    assert not added[~np.any([(at > start) & (at < end) for start, end in take.pauses], axis=0)].any()


def test_laughs_come_five_times_a_second():
    sound = conditions.laugh(_rng())
    loud = np.convolve(np.abs(sound), np.ones(800) / 800, "same")
    lags = np.array([lips.pearson(loud[:-lag], loud[lag:]) for lag in range(1600, 5000, 80)])
    assert (1600 + 80 * int(lags.argmax())) / SAMPLE_RATE == pytest.approx(0.21, abs=0.02)


def test_a_second_talker_needs_a_second_speaker(takes):
    with pytest.raises(ValueError, match="two speakers"):
        conditions.babble(takes[0], takes[:1], _rng())


def test_a_mouth_that_sings_in_pauses_moves_in_them():
    opening = np.zeros(120)
    pauses = [(1.0, 3.0)]
    assert not lips.moving(opening, pauses).any()
    opening[30:90] = 0.2 * (np.arange(60) % 6 > 2)
    assert lips.moving(opening, pauses).all()
    # Still, though open.
    opening[30:90] = 0.5
    assert not lips.moving(opening, pauses).any()


def _seen(opening: np.ndarray) -> measured.Seen:
    return measured.Seen(opening, -opening)


def test_quick_speech_is_compared_at_the_same_sounds(takes):
    take = takes[0]
    frames = len(take.samples) * FRAME_RATE // SAMPLE_RATE

    def seen(count: int, tempo: float) -> measured.Seen:
        return _seen(0.3 + 0.3 * np.sin(np.arange(count) / FRAME_RATE * tempo * 2 * np.pi))

    clean, quick = seen(frames, 1.0), seen(int(frames / 1.5), 1.5)
    found = measured.against(take, clean, quick, 1.5)
    assert found["opening"] > 0.99 and found["width"] > 0.99
    assert found["open"] == pytest.approx(found["open_clean"], abs=0.02)
    assert measured.against(take, clean, quick, 1.0)["opening"] < 0.5


class _Loudness:
    """A mouth as open as the speech is loud."""

    def __call__(self, samples: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        face = np.zeros((len(samples) * FRAME_RATE // SAMPLE_RATE, 58))
        face[:, 6 + lips.ARKIT.index("jawOpen")] = 5 * lips.envelope(samples, len(face))
        return face, np.ones(len(face))


def _made(takes: list[conditions.Take]) -> dict:
    """The measure with a mouth in place of the program."""
    with patch.object(measured, "delayed", lambda subject, samples, seed: measured.live(_Loudness(), samples)):
        return measured.measure(_subject(), _Loudness(), takes, measured.chosen(True), say=lambda *_, **__: None)


def _subject() -> measured.Subject:
    return measured.Subject(umo=None, model=None)


def test_the_tables_have_all_rows_and_tell_music_from_a_telephone(takes):
    found = _made(takes)
    text = measured.markdown(found)
    for name in (measured.CLEAN, measured.OTHER, *measured.SMALL):
        assert text.count(f"| {name} |") == 2
    rows = {name: measured.estimates(seen, found["live"][measured.CLEAN]) for name, seen in found["live"].items()}
    assert rows[measured.CLEAN]["opening"].value == pytest.approx(1)
    assert rows["telephone"]["opening"].value > rows["music, 0 dB"]["opening"].value
    # Loudness sings along with music.
    assert rows["music, 0 dB"]["moving"].value > rows[measured.CLEAN]["moving"].value


def test_what_is_broken_is_said(takes):
    found = _made(takes)
    mouth = _Loudness()
    with patch.object(measured, "delayed", lambda subject, samples, seed: measured.live(mouth, samples)):
        assert measured.failures(_subject(), mouth, found) == []
        found["live"]["telephone"][0]["opening"] = -2.0
        found["delayed"]["music, 0 dB"][0]["moving"] = float("nan")
        said = measured.failures(_subject(), mouth, found)
    assert len(said) == 2 and "not finite" in said[0] and "by telephone" in said[1]
    del found["live"]["telephone"]
    with patch.object(measured, "delayed", lambda *_: _seen(np.full(90, 0.4))):
        said = measured.failures(_subject(), mouth, found)
    assert "live: no rows ['telephone']" in said and any("silence opens" in one for one in said)


def test_intervals_hold_the_truth_and_shrink():
    rng = np.random.default_rng(0)
    held = [interval.mean(rng.normal(0.5, 0.2, 20)) for _ in range(100)]
    assert 85 <= sum(one.low <= 0.5 <= one.high for one in held) <= 100
    few, many = interval.mean(rng.normal(0, 1, 10)), interval.mean(rng.normal(0, 1, 1000))
    assert many.high - many.low < 0.3 * (few.high - few.low)
    assert interval.ratio(np.array([1.0, 2.0]), np.array([2.0, 4.0])).value == 0.5
    assert np.isnan(interval.ratio(np.zeros(2), np.zeros(2)).value)


PHONES = (
    Phone(SILENCE, 0.0, 0.5),
    Phone("m", 0.5, 0.6),
    Phone("aa", 0.6, 0.9),
    Phone("b", 0.9, 1.0),
    Phone("iy", 1.0, 1.2),
    Phone("ae", 1.2, 1.5),
    Phone(SILENCE, 1.5, 2.0),
)


def test_expected_openings_follow_vowel_heights():
    wanted = languages.expected(PHONES, 60)
    assert wanted[22] > 0.8 > wanted[33] > wanted[17] and wanted[5] < 0.01
    assert wanted[:15].max() < wanted[40]


def test_shut_vowels_are_open_ones_with_shut_lips():
    opening = np.full(60, 0.3)
    assert languages.shut_vowels(opening, PHONES).tolist() == [False, False]
    opening[18:27] = 0
    assert languages.shut_vowels(opening, PHONES).tolist() == [True, False]


def test_closures_by_chance_are_those_at_other_times_of_the_speech():
    opening = np.full(60, 0.3)
    opening[:14] = opening[45:] = 0
    assert languages.by_chance(PHONES, opening) == 0
    # b's closure: by another quarter of the second it is at m, which starts it.
    opening[27:30] = 0
    assert lips.closures(opening, PHONES).sum() == 1
    assert languages.by_chance(PHONES, opening) == pytest.approx(1 / 3)
    assert languages.by_chance(PHONES, np.zeros(60)) == 2


def test_there_are_four_sentences_in_each_of_eleven_languages():
    found = languages.sentences()
    assert list(found) == list(languages.NAMES) and len(found) == 11
    assert all(len(lines) == 4 and len(set(lines)) == 4 for lines in found.values())


def test_every_sound_of_the_languages_is_known():
    """Only espeak-ng's own marks of pauses are silent; an unknown sound would be a shut mouth."""
    for language, lines in languages.sentences().items():
        voice = voices.Espeak(language)
        names: set[str] = set()
        with patch.object(
            voice, "_phone", lambda name, known=voice._phone, names=names: (names.add(name), known(name))[1]
        ):
            said = list(voice.speak([voices.Line(text) for text in lines]))
        silent = {name for name in names if voice._phone(name) == SILENCE}
        assert not any(name.strip("_:;|!") for name in silent), (language, silent)
        assert sum(p.name in lips.CLOSING for one in said for p in one.phones) >= 15, language


def test_spanish_b_between_vowels_is_no_closure():
    voice = voices.Espeak("es")
    assert [voice._phone(name) for name in ("b", "B", "p", "m", "a", "**")] == ["b", "v", "p", "m", "aa", "r"]
    assert voices.Espeak("en-us")._phone("a") == "ae"
