"""The measures themselves, on mouths whose answers are known."""

import bench
import captured
import methods
import numpy as np
import pytest
import scores
import visemes
from captured import Recording, Word
from methods import Curve, Method
from umo_train.skeleton import ARKIT, SHAPE

RATE = 25.0
TIMES = np.arange(250) / RATE


def syllables(times: np.ndarray) -> np.ndarray:
    """A mouth that closes every 0.8 s and opens each time by another amount."""
    opening = np.abs(np.sin(np.pi * times / 0.8)) * (1 + 0.3 * np.sin(1.7 * times))
    return np.stack([opening, np.sin(5 * times), np.cos(3 * times)], axis=1)


def recording(words: tuple[Word, ...] = (), seconds: float = 10.0) -> Recording:
    times = np.arange(round(seconds * RATE)) / RATE
    return Recording("one", np.zeros(int(seconds * 1000)), 1000, times, syllables(times), words)


def late(seconds: float) -> dict[str, Curve]:
    times = np.arange(600) / 60
    return {"one": Curve(times, syllables(times - seconds))}


@pytest.mark.parametrize("seconds", [-0.033, 0.0, 0.056, 0.2])
def test_lag_is_measured_between_frames(seconds: float):
    scored = scores.score(late(seconds), 3, scores.truth([recording()]))
    assert scored["lag"].value == pytest.approx(seconds, abs=0.005)
    assert scored["in step"].value > 0.98
    assert (scored["opening"].value > 0.98) == (abs(seconds) < 0.02)


def test_closures_are_found_when_the_mouth_is_on_time():
    known = scores.truth([recording()])
    assert known.closures[0] == pytest.approx(list(0.8 * np.arange(1, 13)), abs=0.021)
    on_time, half_late = (scores.score(late(seconds), 3, known) for seconds in (0.0, 0.3))
    assert on_time["found"].value == 1 and on_time["false"].value == 0
    assert half_late["found"].value == 0 and half_late["false"].value > 0.05
    assert half_late["found in step"].value == 1


def test_a_mouth_that_stays_closed_finds_all_and_pays_for_it():
    times = np.arange(600) / 60
    shut = np.where(times < 9.9, 0.0, 1.0)
    scored = scores.score({"one": Curve(times, np.stack([shut] * 3, axis=1))}, 3, scores.truth([recording()]))
    assert scored["found"].value == 1 and scored["false"].value > 0.95
    assert scored["closures"].value < 0.05


def test_closures_in_words_are_those_of_bilabials_within_speech():
    # Closed at 0.8 ("bin", after silence), 1.6 (b of "blue"), 2.4 (in "at", no bilabial), 3.2 (end of "m").
    spoken = [("sil", 0, 0.75), ("bin", 0.75, 1.5), ("blue", 1.55, 2.2), ("at", 2.2, 2.6), ("m", 2.6, 3.25)]
    words = tuple(Word(*word) for word in spoken)
    times = scores.closures_in_words(recording(words), 0.1, scores.dictionary())
    assert times == pytest.approx([1.6, 3.2])


def test_long_pauses_are_no_closures():
    mouth = syllables(TIMES)
    mouth[(TIMES > 2.3) & (TIMES < 3.3)] = 0
    one = Recording("one", np.zeros(10000), 1000, TIMES, mouth)
    assert scores.closures_between(one, 0.1, 0.3) == pytest.approx([0.8 * n for n in (1, 2, *range(5, 13))])


def test_dictionary_has_every_word_of_the_sentences():
    phones = scores.dictionary()
    assert {word.text for one in captured.ten() for word in one.words} - phones.keys() <= {"sil", "sp"}
    assert len(phones) == 51


def test_long_takes_are_cut_without_loss():
    parts = scores.pieces(recording(seconds=35.0))
    assert len(parts) == 3 and sum(len(part.times) for part in parts) == 875
    assert parts[1].times[0] == pytest.approx(292 / RATE)


def test_map_mixes_linearly_from_rest():
    weights = np.zeros((3, 15))
    weights[1, visemes.INDEX["aa"]], weights[2, visemes.INDEX["PP"]] = 0.5, 1
    assert visemes.mouth(weights).tolist() == [[0, 0, 0], [0.5, 0, 0], [0, 0, 0]]
    opening, width, rounding = visemes.SHAPES.T
    vowel = {name: visemes.INDEX[name] for name in ("aa", "E", "ih", "oh", "ou")}
    assert opening.argmax() == vowel["aa"] and width.argmax() == vowel["ih"] and rounding.argmax() == vowel["ou"]


def test_arkit_becomes_visemes_as_in_the_library():
    faces = np.zeros((4, len(ARKIT)))
    for row, values in enumerate(({}, {"jawOpen": 0.6}, {"mouthPucker": 0.8, "jawOpen": 0.1}, {"mouthFunnel": 0.5})):
        for name, value in values.items():
            faces[row, SHAPE[name]] = value
    weights = methods.arkit_visemes(faces)
    assert weights.sum(1) == pytest.approx(np.ones(4))
    assert [visemes.VISEMES[best] for best in weights.argmax(1)] == ["sil", "aa", "ou", "CH"]


def test_mouth_of_landmarks_is_in_units_of_the_eyes():
    index = [61, 291, 33, 263, 13, 14, 0, 17]
    points = [(0, 0), (40, 0), (-20, -50), (60, -50), (20, -2), (20, 2), (20, -10), (20, 10)]
    landmarks = np.array([[(x, y, 0) for x, y in points]])
    assert captured.mouth_of_landmarks(landmarks, index)[0] == pytest.approx([4 / 80, 40 / 80, 16 / 40])
    assert captured.mouth_of_landmarks(3 * landmarks, index)[0] == pytest.approx([4 / 80, 40 / 80, 16 / 40])


def test_weights_are_named_a_column_further_on():
    shapes = [f"funnel_{side}" for side in ("dl", "dr", "ul", "ur")] + [
        f"suck_{side}" for side in ("dl", "dr", "ul", "ur")
    ]
    halves = ("lowerLipDepress", "upperLipRaise", "press", "pucker", "lipStretch", "lipCornerPull")
    shapes += [f"{half}_{side}" for half in halves for side in "lr"] + ["stretch_c", "oo_c", "oh_c"]
    names = [f"mouth_{shape}" for shape in shapes]
    weights = np.zeros((2, len(names) + 1))
    weights[1, names.index("mouth_stretch_c") + 1] = 0.7
    weights[1, names.index("mouth_oo_c") + 1] = 0.2
    assert captured.mouth_of_weights(weights, names) == pytest.approx(np.array([[0, 0, 0], [0.7, -0.2, 0.2]]))


@pytest.mark.parametrize(("late", "broken"), [(0.0, None), (0.2, "lag of"), (None, "another sentence")])
def test_facts_break_with_the_mouth(late: float | None, broken: str | None, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(scores, "DRAWS", 10)
    recordings = captured.ten()
    curves = {one.name: Curve(one.times, one.mouth) for one in recordings}
    # The mouth of the method in question: late by some time, or that of another sentence.
    others = [*recordings[1:], recordings[0]]
    wrong = {one.name: curves[other.name] for one, other in zip(recordings, others, strict=True)}
    if late is not None:
        wrong = {name: Curve(curve.times + late, curve.mouth) for name, curve in curves.items()}
    made = [Method(methods.DEFAULT, True, wrong, 0.1, 1)]
    made += [Method(label, False, curves, 0.1, 1) for label in (methods.LIVE, "loudness")]
    capture = bench.measured("", recordings, made)
    if broken is None:
        bench.check(recordings, capture)
    else:
        with pytest.raises(AssertionError, match=broken):
            bench.check(recordings, capture)
