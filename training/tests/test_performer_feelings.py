"""Emotions and listening: their effects, and what they must not change."""

import numpy as np
import pytest

from test_performer_speech import SENTENCES, speech
from umo_train.performer import STYLES, feelings, lip_opening, listening, perform
from umo_train.performer.lips import CLOSED
from umo_train.performer.prosody import listen
from umo_train.performer.style import PROMPTS, UNTOLD, draw
from umo_train.skeleton import JOINT, SHAPE, rotations


def mean(motion, name):
    return motion["face"][:, 6 + SHAPE[name]].mean()


def pitch(motion, *joints):
    """Mean forward pitch in degrees, summed over the joints."""
    local = rotations(motion)
    return np.degrees(sum(np.arctan2(local[:, JOINT[j], 2, 1], local[:, JOINT[j], 2, 2]) for j in joints)).mean()


@pytest.fixture(scope="module")
def spoken():
    return speech(SENTENCES * 2)


@pytest.fixture(scope="module")
def made(spoken):
    return {name: perform(spoken, STYLES[name], 5) for name in STYLES}


@pytest.mark.parametrize(
    ("style", "shape"),
    [
        ("joyful", "mouthSmileLeft"), ("sad", "browInnerUp"), ("angry", "browDownLeft"),
        ("surprised", "browOuterUpLeft"), ("disgusted", "noseSneerLeft"), ("afraid", "eyeWideLeft"),
    ],
)  # fmt: skip
def test_an_emotion_shows_in_the_face(made, style, shape):
    assert mean(made[style], shape) > mean(made["neutral"], shape) + 0.2
    assert mean(made[style], shape) > 0.75 * max(mean(made[name], shape) for name in STYLES)


def test_an_emotion_shows_in_the_posture(made):
    trunk = ("spine1", "spine2", "spine3", "neck", "head")
    assert pitch(made["sad"], *trunk) > pitch(made["neutral"], *trunk) + 6.0
    assert pitch(made["joyful"], *trunk) < pitch(made["angry"], *trunk)


def test_an_emotion_is_never_the_same_for_long(spoken):
    level = feelings.strength(listen(spoken), np.random.default_rng(1))
    assert 0.5 < level.min() < level.max() < 1.5
    assert level.std() > 0.03


def test_lips_meet_whatever_is_felt(spoken, made):
    for style in ("joyful", "sad", "angry", "surprised", "disgusted", "afraid"):
        opening = lip_opening(made[style]["face"])
        for phone in (p for p in spoken.phones if p.name in "pbm"):
            middle = round((phone.start + 0.45 * (phone.end - phone.start)) * 30)
            assert opening[middle - 1 : middle + 2].min() < CLOSED, style


def test_a_listener_says_nothing_and_nods(spoken):
    heard = listen(spoken)
    counts = []
    for seed in range(6):
        motion = perform(spoken, STYLES["listening"], seed)
        assert lip_opening(motion["face"]).max() < 2.0 * CLOSED
        assert (motion["intent"] == 0).all()
        counts.append(len(listening.answers(heard, np.random.default_rng(seed))))
    assert np.mean(counts) >= 1.0


def test_nods_go_down_and_back():
    t = np.arange(120) / 30.0
    given = [listening.Answer(1.0, 2, "")]
    nods = listening.nods(given, t, np.random.default_rng(0))
    assert nods[0] == nods[-1] == 0.0
    assert nods.max() > 0.05


def test_who_was_told_nothing_is_drawn_most():
    import random

    chance = random.Random(0)
    drawn = [draw(chance) for _ in range(4000)]
    styles = [style for style, _ in drawn]
    assert set(styles) == set(STYLES)
    assert all(prompt in PROMPTS[style] for style, prompt in drawn)
    assert 0.3 < np.mean([style in UNTOLD for style in styles]) < 0.55
