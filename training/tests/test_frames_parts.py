"""Parts of layout `frames`: their channels, valid plans, and the cost of errors."""

import copy

import numpy as np
import pytest

from frames_data import FACE, PLAN
from umo_train.frames import parts
from umo_train.frames.parts import Part
from umo_train.skeleton import CHANNELS, JOINTS_OF


def test_every_channel_is_in_one_part_and_comes_back_to_its_place() -> None:
    motion = {region: np.arange(2 * width, dtype=np.float32).reshape(2, width) for region, width in CHANNELS.items()}
    back = {region: np.full_like(rows, -1) for region, rows in motion.items()}
    for part in parts.read(PLAN, FACE):
        if part.moves:
            region, at = parts.columns(part, FACE)
            back[region][:, at] = parts.own(part, FACE, motion)
    assert all((back[region] == motion[region]).all() for region in motion)


def test_channels_are_in_the_order_of_their_list() -> None:
    part = Part("arms", ("right_elbow", "left_shoulder"), 4, 1, 8, 1)
    region, at = parts.columns(part, FACE)
    assert region == "upper"
    names = list(JOINTS_OF["upper"])
    wanted = [6 * names.index(19) + np.arange(6), 6 * names.index(16) + np.arange(6)]
    assert at.tolist() == np.concatenate(wanted).tolist()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"codes": 257}, "1 to 256 codes"),
        ({"levels": 17}, "1 to 16 levels"),
        ({"channels": ["left_knee", "head"]}, "lower and upper"),
        ({"channels": ["tail"]}, "no channel is called tail"),
        ({"channels": ["head"]}, r"in none: \['left_collar'"),
        ({"name": "hands"}, "a unique name"),
        ({"name": "root"}, "other than `root`"),
    ],
)
def test_what_no_file_may_have_is_refused(change: dict, said: str) -> None:
    plan = copy.deepcopy(PLAN)
    plan["parts"][1] |= change
    with pytest.raises(ValueError, match=said):
        parts.read(plan, FACE)


def test_a_channel_in_two_parts_is_refused() -> None:
    plan = copy.deepcopy(PLAN)
    plan["parts"].append({"name": "again", "channels": ["jawOpen"]})
    with pytest.raises(ValueError, match=r"in several: \['jawOpen'\]"):
        parts.read(plan, FACE)


def test_an_annotation_has_neither_width_nor_layers() -> None:
    intent, upper, *_ = parts.read(PLAN, FACE)
    assert intent.config([0]) == {"name": "intent", "channels": [], "codes": 13, "levels": 1, "rest": [0]}
    assert {"width", "layers"} <= set(upper.config([0] * 4))


def test_a_shoulder_costs_more_than_the_wrist_that_it_moves() -> None:
    weight = parts.weights(Part("arm", ("left_shoulder", "left_elbow", "left_wrist"), 4, 1, 8, 1))
    shoulder, elbow, wrist = weight.reshape(3, 6)[:, 0]
    # The arm is 0.53 m from shoulder to wrist, and the longest finger's last joint 0.16 m beyond.
    assert shoulder > elbow > wrist and 60**2 < shoulder < 80**2


def test_the_head_weighs_as_what_the_face_looks_at() -> None:
    weight = parts.weights(Part("head", ("neck", "head", "left_wrist"), 4, 1, 8, 1)).reshape(3, 6)[:, 0]
    assert weight[0] == weight[1] == 80**2 > 10 * weight[2]
