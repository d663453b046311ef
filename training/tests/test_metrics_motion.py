import numpy as np
import pytest

from metrics_motion import still, swinging, turned
from umo_train.metrics import motion as m
from umo_train.metrics.item import Item, load, load_folder, save, speaker_of
from umo_train.skeleton import JOINT, VELOCITY
from umo_train.speech.utterance import Phone


def test_jerk_is_that_of_a_known_swing():
    t = np.arange(300) / 30
    moved = turned(still(300), JOINT["left_elbow"], 0.1 * np.sin(2 * np.pi * t))
    # The wrist is the only upper body joint that the elbow moves: a third derivative of 0.25 m * 0.1 * (2 pi)^3.
    want = 0.25 * 0.1 * (2 * np.pi) ** 3 * (2 / np.pi) / 13
    assert m.jerk(moved) == pytest.approx(want, rel=0.03)
    assert m.jerk(still(300)) == pytest.approx(0, abs=1e-6)


def test_feet_slide_as_fast_as_the_pelvis_drifts_and_only_while_planted():
    motion = still(60)
    assert m.foot_slide(motion) == pytest.approx(0, abs=1e-9)
    motion["lower"][:, VELOCITY.start] = 0.2
    assert m.foot_slide(motion) == pytest.approx(0.2, rel=1e-5)
    assert m.foot_slide(motion, np.zeros((60, 4), bool)) == 0


def test_contacts_are_found_by_height():
    lifted = turned(still(30), JOINT["left_hip"], np.full(30, -0.8), "x")
    assert m.contacts(still(30)).all()
    assert (m.contacts(lifted) == [False, False, True, True]).all()


def test_feet_stand_on_the_floor():
    lowest = m.joint_places(still(3))[:, [7, 8, 10, 11], 1].min(1)
    assert lowest == pytest.approx(m.FOOT_HEIGHT_M)


def test_use_entropy_is_one_when_even_and_zero_when_one_does_everything():
    assert m.use_entropy(np.ones(4)) == pytest.approx(1)
    assert m.use_entropy([8, 0, 0, 0]) == 0
    assert m.use_entropy([[1, 1, 0, 0], [1, 1, 1, 1], [0, 0, 0, 0]]) == pytest.approx(0.75)


def test_items_come_back_as_they_were_saved(tmp_path):
    phones = (Phone("pau", 0.0, 0.2), Phone("aa", 0.2, 0.5, 2))
    item = Item(
        "a",
        "v",
        np.ones(8000, np.float32),
        phones,
        swinging(15, 0),
        {"calm": [still(15), swinging(15, 1)]},
        "voice",
        "calm",
        still(15),
    )
    save(item, tmp_path / "a.npz")
    save(Item("b", "v", np.zeros(1600, np.float32)), tmp_path / "b.npz")
    got, bare = load_folder(tmp_path)
    assert got.phones == phones and got.frames == 15 and (got.split, got.prompt) == ("voice", "calm")
    assert np.array_equal(got.again["upper"], still(15)["upper"])
    assert bare.motion is None and bare.again is None and bare.takes == {}
    assert np.array_equal(got.motion["upper"], item.motion["upper"])
    assert np.array_equal(got.takes["calm"][1]["upper"], item.takes["calm"][1]["upper"])


def test_items_with_other_channels_are_refused(tmp_path):
    motion = still(15) | {"upper": np.zeros((15, 77), np.float32)}
    save(Item("a", "v", np.ones(8000, np.float32), motion=motion), tmp_path / "a.npz")
    with pytest.raises(ValueError, match=r"upper: expected \[frames, 78\], got \[15, 77\]"):
        load(tmp_path / "a.npz")


@pytest.mark.parametrize(
    ("name", "speaker"), [("p225_003.wav", "p225"), ("198-209-0000.hq.ogg", "198"), ("Mark_joy.wav", "Mark")]
)
def test_speakers_begin_the_names_of_files(name, speaker, tmp_path):
    assert speaker_of(tmp_path / name) == speaker
