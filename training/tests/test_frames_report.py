"""The tokenizer report: errors of known sizes, and the bars."""

import numpy as np
import pytest

from frames_data import FACE
from metrics_motion import still, turned
from umo_train.frames import report
from umo_train.frames.report import BARS, Row
from umo_train.metrics.item import Item
from umo_train.motion.networks import RootNetwork
from umo_train.skeleton import CHANNELS, CONTACT, JOINT, VELOCITY
from umo_train.speech.utterance import Phone


def _item(motion: dict[str, np.ndarray]) -> Item:
    frames = len(motion["lower"])
    phones = tuple(Phone("AH", t, t + 0.1, 2) for t in np.arange(0.5, frames / 30 - 0.5, 0.8))
    return Item("one", "voice", np.zeros(frames * 16000 // 30, np.float32), phones, motion)


def test_motion_that_is_as_it_was_has_no_errors() -> None:
    motion = turned(still(200), JOINT["left_elbow"], 0.2 * np.sin(np.arange(200) / 5))
    motion["lower"][:, CONTACT] = 1
    found = report.row("same", [_item(motion)], [motion], [motion])
    assert (found.wrists_cm, found.head_deg, found.face) == (0, 0, 0)
    assert found.slide_cm_s == pytest.approx(0, abs=1e-6) and found.jerk_m_s3 > 0


def test_errors_are_as_large_as_they_are() -> None:
    motion = still(60)
    motion["lower"][:, CONTACT] = 1
    # The elbow is 25 cm from the wrist; a wrist's position is relative to the pelvis.
    other = turned(still(60), JOINT["left_elbow"], np.full(60, 0.04))
    other = turned(other, JOINT["neck"], np.full(60, np.radians(2.0)))
    other["face"][:, 6:] = 0.25
    sliding = still(60)
    sliding["lower"][:, VELOCITY.start] = 0.02
    found = report.row("moved", [_item(motion)], [other], [sliding])
    assert found.wrists_cm == pytest.approx(100 * 0.25 * 0.04 / 2, rel=0.01)
    assert found.wrists_95_cm == pytest.approx(100 * 0.25 * 0.04, rel=0.01)
    assert found.head_deg == pytest.approx(2.0, rel=1e-3)
    assert found.face == pytest.approx(0.25 - motion["face"][0, 6:].mean(), abs=1e-6)
    assert found.slide_cm_s == pytest.approx(2.0, rel=1e-3)


def test_small_angles_are_told() -> None:
    one = np.tile(np.eye(3), (1, 1, 1))
    c, s = np.cos(1e-5), np.sin(1e-5)
    assert report.turned_deg(one, np.array([[[1, 0, 0], [0, c, -s], [0, s, c]]])) == pytest.approx(np.degrees(1e-5))


def test_turning_points_on_accents_are_beats() -> None:
    """An arm that stops at every accent, and the same half a beat late."""
    t = np.arange(720) / 30
    period = 0.8
    item, ratios = _item(still(720)), []
    for late in (0.0, period / 2):
        swing = 0.3 * np.cos(np.pi * (t - 0.5 - late) / period)
        motion = turned(still(720), JOINT["left_elbow"], swing)
        ratios.append(report.row("swing", [item], [motion], [motion]).beats)
    assert ratios[0] > 1.5 and ratios[1] < 0.5


def test_feet_are_those_of_the_root_network() -> None:
    """The walk comes from the root network, whatever velocity the codes have."""
    motion = {region: np.array(rows) for region, rows in still(30).items()}
    motion["lower"][:, VELOCITY] = 5.0
    root = RootNetwork(4, CHANNELS["lower"], 1).eval()
    for weight in root.parameters():
        weight.requires_grad_(False).zero_()
    walked = report.walked(motion, root)
    assert (walked["lower"][:, VELOCITY] == 0).all() and (motion["lower"][:, VELOCITY] == 5.0).all()


def test_bars_are_of_the_row_with_all_levels() -> None:
    before = Row("before", 1.9, 0, 0, 0, 100.0, 0, 0)
    good = Row("4 levels", 1.5, 1.0, 2.0, 0.3, 129.0, 0.2, 0.01)
    bad = Row("keyframes", 1.4, 1.6, 2.0, 0.5, 131.0, 0.4, 0.01)
    assert all(bar.met(good, before) for bar in BARS) and not any(bar.met(bad, before) for bar in BARS)
    said = report.markdown([before, good, bad])
    assert said.count("| met |") == 5 and "missed" not in said
    assert report.markdown([before, bad, good]).count("| missed |") == 5
    assert len(FACE) == 52
