import numpy as np
import pytest
from scipy.io import wavfile

from metrics_motion import still, turned
from umo_train.metrics import body, measure
from umo_train.metrics.item import captured
from umo_train.skeleton import JOINT

SECONDS = np.arange(300) / 30


def test_the_heads_deviation_is_that_of_its_turns_about_each_axis():
    for axis, place in (("y", 0), ("x", 1), ("z", 2)):
        turns = turned(still(300), JOINT["head"], np.radians(10) * np.sin(2 * np.pi * SECONDS), axis)
        found = body.head_deviation(turns)
        assert found[place] == pytest.approx(10 / np.sqrt(2), rel=0.02)
        assert np.delete(found, place) == pytest.approx([0, 0], abs=0.1)


def test_a_turn_of_the_whole_body_is_none_of_the_head():
    turns = turned(still(300), JOINT["pelvis"], 0.3 * np.sin(SECONDS), "y")
    assert body.head_deviation(turns) == pytest.approx([0, 0, 0], abs=1e-6)
    assert body.wrist_speed(turns) == pytest.approx(np.zeros(300), abs=1e-6)


def test_phrases_are_as_long_as_a_wrist_gestures_with_short_rests():
    speed = np.zeros(300)
    speed[30:60] = 1.0
    # A rest of 6 frames is merged, one of 90 is not.
    speed[66:90] = 0.5
    speed[180:195] = 0.3
    margin = 2 * (body.JOINED // 2) / 30
    assert body.phrases(speed) == pytest.approx([2.0 + margin, 0.5 + margin])
    assert len(body.phrases(np.full(300, 0.2))) == 0


def test_a_swing_of_the_elbow_has_its_speed_and_jerk():
    forearm = 0.25
    # Small, so that the wrist moves on a line.
    swing = turned(still(300), JOINT["left_elbow"], 0.05 * np.sin(2 * np.pi * SECONDS))
    assert body.wrist_jerk(swing).max() == pytest.approx(forearm * 0.05 * (2 * np.pi) ** 3, rel=0.03)
    wide = turned(still(300), JOINT["left_elbow"], 0.4 * np.sin(2 * np.pi * SECONDS))
    assert body.wrist_speed(wide).max() == pytest.approx(forearm * 0.4 * 2 * np.pi, rel=0.1)
    assert body.body([wide])["phrase_median"] == pytest.approx(10, abs=0.1)
    at_rest = body.body([still(300)])
    assert (at_rest["hands_still"], at_rest["phrase_median"], at_rest["wrist_jerk_95"]) == (1.0, None, 0.0)


def test_captured_mouths_are_compared_at_the_best_lag(tmp_path):
    rng = np.random.default_rng(0)
    wavfile.write(tmp_path / "a.wav", 16000, rng.normal(0, 0.1, 160000).astype(np.float32))
    with pytest.raises(FileNotFoundError, match="no captured mouths"):
        captured(tmp_path)
    opening = np.clip(rng.normal(0.3, 0.2, 300), 0, 1)
    np.savez(tmp_path / "a.npz", opening=opening)
    ((item, read),) = captured(tmp_path)
    assert item.seconds == pytest.approx(10) and read == pytest.approx(opening)
    face = still(300)["face"]
    face[:, 6 + 17] = np.roll(opening, 1)
    made = measure.Made(item, still(300) | {"face": face})
    found = measure.captured_mouth([made], [opening])["a"]
    assert found["correlation"] > 0.95 and abs(found["envelope_correlation"]) < 0.3
    np.savez(tmp_path / "b.npz", opening=opening)
    with pytest.raises(FileNotFoundError, match="no sound beside it"):
        captured(tmp_path)
