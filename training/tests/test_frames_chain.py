"""Chained parts: later parts compensate for errors of earlier ones."""

import numpy as np
import pytest
import torch

from frames_data import FACE
from umo_train.frames import chain, parts, tokenizers
from umo_train.frames.networks import ResidualVqVae
from umo_train.frames.parts import Part
from umo_train.frames.report import heads, turned_deg
from umo_train.performer.rotation import about, euler
from umo_train.skeleton import CHANNELS, JOINT, JOINTS_OF, PARENTS, places, rotation_6d, rotations

LOWER = Part("lower", tuple(name for name, _ in parts.named([])["lower"]), 8, 2, 6, 1)
TORSO = Part("torso", ("spine1", "spine2", "spine3", "left_collar", "right_collar"), 8, 1, 6, 1)
HEAD = Part("head", ("neck", "head"), 8, 3, 6, 1)
ARM = Part("arm", ("left_shoulder", "left_elbow", "left_wrist"), 8, 1, 6, 1)


def _motion(frames: int = 12, seed: int = 0) -> dict[str, np.ndarray]:
    random = np.random.default_rng(seed)
    out = {}
    for region, width in CHANNELS.items():
        joints = len(JOINTS_OF[region])
        turns = euler(random.normal(0, 0.2, (frames, joints, 3)))
        rest = random.uniform(0, 1, (frames, width - 6 * joints))
        out[region] = np.concatenate([rotation_6d(turns).reshape(frames, -1), rest], 1).astype(np.float32)
    return out


def _wrong(channels: np.ndarray, joints: int, seed: int = 1) -> np.ndarray:
    """The channels with each rotation off by a few degrees."""
    random = np.random.default_rng(seed)
    out = channels.copy()
    out[:, : 6 * joints] += random.normal(0, 0.03, (len(out), 6 * joints))
    return out


def _world(local: np.ndarray, name: str) -> np.ndarray:
    joint, out = JOINT[name], local[:, JOINT[name]]
    while (joint := PARENTS[joint]) >= 0:
        out = local[:, joint] @ out
    return out


def test_a_part_that_says_its_aims_undoes_the_errors_before_it() -> None:
    motion = _motion()
    said = chain.Said(motion, FACE)
    said.say(LOWER, _wrong(said.aims(LOWER), 9))
    spoilt = turned_deg(_world(rotations(said.channels), "head"), heads(motion)).mean()
    said.say(TORSO, _wrong(said.aims(TORSO), 5))
    for part in (HEAD, ARM):
        said.say(part, said.aims(part))
    assert spoilt > 1.0
    for name in ("head", "left_wrist"):
        errors = turned_deg(_world(rotations(said.channels), name), _world(rotations(motion), name))
        assert errors.max() < 0.01
    # The arm's start is off with the trunk; its motion relative to that is not.
    at, truly = (places(rotations(m), np.zeros((12, 3))) for m in (said.channels, motion))
    reach = [p[:, JOINT["left_wrist"]] - p[:, JOINT["left_shoulder"]] for p in (at, truly)]
    np.testing.assert_allclose(reach[0], reach[1], atol=1e-4)


def test_a_part_is_told_nothing_of_what_comes_after_it() -> None:
    """From the tips inwards, parts encode the performer's own rotations, and no error is compensated twice."""
    motion = _motion()
    said = chain.Said(motion, FACE)
    np.testing.assert_allclose(said.aims(ARM), parts.own(ARM, FACE, motion), atol=1e-6)
    said.say(LOWER, _wrong(said.aims(LOWER), 9))
    # The trunk between pelvis and arm will compensate for the pelvis.
    np.testing.assert_allclose(said.aims(ARM), parts.own(ARM, FACE, motion), atol=1e-6)
    assert np.abs(said.aims(TORSO) - parts.own(TORSO, FACE, motion)).max() > 1e-3


def test_fingers_and_face_are_said_as_they_are() -> None:
    motion = _motion()
    said = chain.Said(motion, FACE)
    said.say(LOWER, _wrong(said.aims(LOWER), 9))
    said.say(ARM, _wrong(said.aims(ARM), 3))
    for name, channels in (
        ("hands", tuple(name for name, _ in parts.named([])["hands"])),
        ("mouth", ("jaw", "jawOpen")),
    ):
        part = Part(name, channels, 8, 1, 6, 1)
        np.testing.assert_array_equal(said.aims(part), parts.own(part, FACE, motion))


def test_codes_of_a_part_follow_from_those_before_it() -> None:
    torch.manual_seed(0)
    order = [LOWER, TORSO, HEAD]
    models = {part.name: ResidualVqVae(part, len(parts.columns(part, FACE)[1])).eval() for part in order}
    motion = _motion(40)
    codes, said = tokenizers.encode(order, models, motion, FACE)
    assert {name: rows.shape for name, rows in codes.items()} == {"lower": (40, 2), "torso": (40, 1), "head": (40, 3)}
    # A part's decoded channels are at their positions.
    with torch.no_grad():
        wanted = models["head"].motion(torch.from_numpy(codes["head"].astype(np.int64))[None])[0].numpy()
    np.testing.assert_allclose(parts.own(HEAD, FACE, said.channels), wanted, atol=1e-5)
    some, _ = tokenizers.encode(order, {"lower": models["lower"]}, motion, FACE)
    assert list(some) == ["lower"] and (some["lower"] == codes["lower"]).all()


def test_an_arm_makes_good_what_trunk_and_pelvis_say() -> None:
    order = [LOWER, TORSO, HEAD, ARM]
    assert chain.before(order, ARM) == [LOWER, TORSO, ARM] and chain.before(order[:1], HEAD) == [LOWER]
    assert chain.before(order[:2], Part("mouth", ("jaw",), 8, 1, 6, 1)) == []


def test_rotations_of_a_part_add_up_along_it() -> None:
    part = Part("arm", ("left_wrist", "left_shoulder", "left_elbow"), 8, 1, 6, 1)
    angles = {"left_shoulder": 0.1, "left_elbow": 0.2, "left_wrist": 0.4}
    six = [rotation_6d(about("z", np.array(angles[name]))) for name in part.channels]
    found = chain.Chained(part)(torch.from_numpy(1.3 * np.concatenate(six))[None])
    wanted = [rotation_6d(about("z", np.array(angle))) for angle in (0.7, 0.1, 0.3)]
    np.testing.assert_allclose(found[0].numpy(), np.concatenate(wanted), atol=1e-6)


@pytest.mark.parametrize("name", ["contacts", "root_velocity"])
def test_channels_that_are_no_rotations_stay(name: str) -> None:
    at = 54 if name == "root_velocity" else 57
    x = torch.randn(2, 5, 61)
    assert (chain.Chained(LOWER)(x)[..., at : at + 3] == x[..., at : at + 3]).all()
