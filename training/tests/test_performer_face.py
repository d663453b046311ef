"""The performer's face compared with the phones."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from test_performer_speech import SENTENCES, speech
from umo_train.performer import STYLES, lip_opening, perform
from umo_train.performer.lips import CLOSED
from umo_train.performer.perform import JAW_OPEN
from umo_train.performer.prosody import listen
from umo_train.performer.report import Take, measure
from umo_train.skeleton import SHAPE, matrices
from umo_train.speech.utterance import SILENCE

PAUSES = "jaw speed in pauses over speech"
MOUTH = [6 + index for name, index in SHAPE.items() if name.startswith(("mouth", "jaw", "tongue"))]


def shape(motion, name):
    return motion["face"][:, 6 + SHAPE[name]]


def frames(phone):
    """Frames within a phone, or at least the nearest one."""
    first, last = int(np.ceil(phone.start * 30)), int(np.floor(phone.end * 30))
    return slice(first, last + 1) if last >= first else slice(last, last + 1)


@pytest.fixture(scope="module", params=["neutral", "excited", "stern"])
def performed(request):
    made = speech()
    return made, perform(made, STYLES[request.param], 3)


def test_lips_meet_at_p_b_m_for_two_frames(performed):
    made, motion = performed
    opening = lip_opening(motion["face"])
    closures = [p for p in made.phones if p.name in "pbm"]
    assert len(closures) >= 9
    for phone in closures:
        middle = round((phone.start + 0.45 * (phone.end - phone.start)) * 30)
        assert (opening[middle - 1 : middle + 2] < CLOSED).sum() >= 2


def test_lips_part_at_open_vowels(performed):
    made, motion = performed
    opening = lip_opening(motion["face"])
    for phone in made.phones:
        if phone.name in ("aa", "ae", "ay", "aw") and phone.stress:
            assert opening[frames(phone)].max() > 0.27


def test_lower_lip_meets_teeth_at_f_v(performed):
    made, motion = performed
    for phone in made.phones:
        if phone.name in "fv":
            at = round((phone.start + phone.end) * 15)
            assert shape(motion, "mouthRollLower")[at] > 0.4
            assert shape(motion, "mouthLowerDownLeft")[at] < 0.1
            assert lip_opening(motion["face"])[at] < 0.2


def test_rounding(performed):
    made, motion = performed
    pucker = shape(motion, "mouthPucker") + shape(motion, "mouthFunnel")
    rounded = [pucker[frames(p)].max() for p in made.phones if p.name in ("w", "uw", "ow")]
    spread = [pucker[round((p.start + p.end) * 15)] for p in made.phones if p.name in ("iy", "ae", "eh")]
    assert min(rounded) > 0.4
    assert np.median(spread) < 0.15


def test_mouth_is_shut_and_nearly_still_in_pauses(performed):
    made, motion = performed
    for phone in made.phones:
        if phone.name == SILENCE:
            inner = slice(round(phone.start * 30) + 4, round(phone.end * 30) - 3)
            assert np.ptp(motion["face"][inner][:, MOUTH], axis=0).max() < 0.2
            assert lip_opening(motion["face"])[inner].max() < CLOSED
            assert np.ptp(lip_opening(motion["face"])[inner]) < 0.02


def test_mouth_is_not_frozen_in_pauses():
    """The jaw moves behind closed lips, far less than in speech."""
    made = speech(SENTENCES * 3, pause=2.0)
    heard = listen(made)
    shares = [measure([Take(perform(made, STYLES["neutral"], s), heard)])[PAUSES] for s in range(4)]
    assert 0.04 < np.mean(shares) < 0.3


def test_left_and_right_of_the_face_differ_as_peoples():
    made = speech(SENTENCES * 3)
    takes = [Take(perform(made, STYLES["neutral"], seed), listen(made)) for seed in range(4)]
    assert 0.05 <= measure(takes)["left against right, share of range"] <= 0.2


def test_ranges_are_of_the_captured_face():
    made = speech(SENTENCES * 3)
    found = measure([Take(perform(made, STYLES["neutral"], seed), listen(made)) for seed in range(4)])
    # Captured: jaw 0.10 to 0.13, lower lip up to 0.20.
    assert 0.08 < found["jawOpen sd"] < 0.14
    assert 0.13 < found["mouthLowerDown sd"] < 0.22


def test_shapes_that_hardly_moved_do_so():
    made = speech(SENTENCES * 6)
    face = np.concatenate([perform(made, STYLES["explaining"], seed)["face"] for seed in range(3)])[:, 6:]
    for name in ("jawLeft", "jawRight", "mouthLeft", "mouthRight", "cheekPuff", "noseSneerLeft", "mouthDimpleRight",
                 "mouthShrugUpper", "mouthShrugLower", "jawForward", "tongueOut"):  # fmt: skip
        assert face[:, SHAPE[name]].max() > 0.03, name


@pytest.mark.parametrize("style", ["neutral", "explaining"])
def test_without_a_mood_nobody_frowns_or_sneers(style):
    made = speech(SENTENCES * 6)
    for seed in range(6):
        face = perform(made, STYLES[style], seed)["face"][:, 6:]
        for side in ("Left", "Right"):
            assert face[:, SHAPE["browDown" + side]].max() < 0.15
            assert face[:, SHAPE["mouthFrown" + side]].max() < 0.05
            assert face[:, SHAPE["noseSneer" + side]].max() < 0.2
            assert face[:, SHAPE["eyeSquint" + side]].mean() < 0.15


def test_jaw_turns_as_it_opens(performed):
    _, motion = performed
    turn = matrices(motion["face"][:, :6].astype(np.float64))
    np.testing.assert_allclose(np.arcsin(turn[:, 2, 1]), JAW_OPEN * shape(motion, "jawOpen"), atol=1e-6)


def test_opening_follows_loudness():
    rise = perform(speech(gain_db=lambda at: 0.0 if at < 3.0 else -12.0), STYLES["neutral"], 1)
    level = perform(speech(), STYLES["neutral"], 1)
    opening = lip_opening(rise["face"]), lip_opening(level["face"])
    assert opening[0][15:80].sum() > 1.02 * opening[1][15:80].sum()
    assert opening[0][105:].sum() < 0.85 * opening[1][105:].sum()


def test_stressed_vowels_open_wider():
    bare = [[name.rstrip("012") + ("0" if name[-1].isdigit() else "") for name in s] for s in SENTENCES]
    jaws = []
    for sentences in (bare, SENTENCES):
        made = speech(sentences)
        jaws.append(lip_opening(perform(made, STYLES["neutral"], 1)["face"]).mean())
    assert jaws[1] > 1.03 * jaws[0]


def test_ten_keys_a_second_carry_the_mouth(performed):
    _, motion = performed
    face = motion["face"][:, MOUTH]
    keys = np.arange(0, len(face), 3)
    between = CubicSpline(keys, face[keys])(np.arange(keys[-1] + 1))
    error = np.sqrt(np.mean((between - face[: keys[-1] + 1]) ** 2))
    assert error < 0.27 * face.std()


def test_blinks_are_quick_and_regular():
    lids = shape(perform(speech(SENTENCES * 6), STYLES["neutral"], 4), "eyeBlinkLeft")
    shut = np.concatenate([[0], lids > 0.5, [0]]).astype(int)
    starts, ends = np.flatnonzero(np.diff(shut) == 1), np.flatnonzero(np.diff(shut) == -1)
    seconds = len(lids) / 30
    assert seconds / 6.5 <= len(starts) <= seconds / 1.0
    assert (ends - starts).max() <= 7
    assert lids[shut[1:-1] > 0].max() > 0.85


def test_eyes_look_the_same_way():
    motion = perform(speech(SENTENCES * 3), STYLES["neutral"], 4)
    np.testing.assert_array_equal(shape(motion, "eyeLookOutLeft"), shape(motion, "eyeLookInRight"))
    np.testing.assert_array_equal(shape(motion, "eyeLookInLeft"), shape(motion, "eyeLookOutRight"))
    assert (shape(motion, "eyeLookOutLeft") * shape(motion, "eyeLookInLeft")).max() == 0.0
    assert shape(motion, "eyeLookOutLeft").max() > 0.1
    assert shape(motion, "eyeLookInLeft").max() > 0.1


def test_mood_shows():
    smile = {name: shape(perform(speech(), STYLES[name], 2), "mouthSmileLeft").mean() for name in STYLES}
    frown = {name: shape(perform(speech(), STYLES[name], 2), "browDownLeft").mean() for name in STYLES}
    assert smile["excited"] > smile["shy"] > smile["neutral"] >= smile["stern"]
    assert frown["stern"] > 0.2 > frown["neutral"]
