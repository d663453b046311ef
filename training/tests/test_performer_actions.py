"""Clips of other skeletons, and the actions made from them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from umo_train.performer import actions, captures, clips
from umo_train.skeleton import CHANNELS, CONTACT, JOINT, JOINT_NAMES, JOINTS, OFFSETS_M, PARENTS, places, rotations

# Rest angle of the other skeleton's arms in degrees: it stands in an A-pose.
HANG = 45.0


def turn(axis, degrees):
    return Rotation.from_euler(axis, degrees, degrees=True).as_matrix()


def _inverse(turned):
    return np.swapaxes(turned, -1, -2)


def mannequin(local):
    """Our skeleton under Unreal's names, with hanging arms at rest and arbitrarily rotated bones: frames in which every
    joint has the world rotation that `local` `[T, 55, 3, 3]` gives ours."""
    names = tuple(clips._their_name(name, clips._UNREAL) or f"other {name}" for name in JOINT_NAMES)
    random = np.random.default_rng(0)
    bone = Rotation.random(JOINTS, random_state=random).as_matrix()
    rest, world = np.tile(np.eye(3), (JOINTS, 1, 1)), np.empty_like(local)
    for joint, parent in enumerate(PARENTS):
        hanging = {"left_shoulder": -HANG, "right_shoulder": HANG}.get(JOINT_NAMES[joint])
        rest[joint] = turn("z", hanging) if hanging else (rest[parent] if parent >= 0 else np.eye(3))
        world[:, joint] = local[:, joint] if parent < 0 else world[:, parent] @ local[:, joint]
    # Its bone is rotated like ours: from its hanging rest direction to our direction.
    theirs, still = world @ bone, rest @ bone

    def local_to_parent(joint, turned):
        parent = PARENTS[joint]
        return (
            turned[..., joint, :, :] if parent < 0 else _inverse(turned[..., parent, :, :]) @ turned[..., joint, :, :]
        )

    offsets = np.array(OFFSETS_M)
    for joint, parent in enumerate(PARENTS):
        if parent >= 0:
            offsets[joint] = still[parent].T @ rest[parent] @ OFFSETS_M[joint]
    moved, quiet = (np.stack([local_to_parent(j, all_) for j in range(JOINTS)], -3) for all_ in (theirs, still))
    return captures.Clip(
        "Turn", names, np.array(PARENTS), moved, np.tile(offsets, (len(local), 1, 1)), quiet, offsets
    )  # fmt: skip


def some(frames=24):
    """Rotations of a body that moves its trunk, an arm and a knee."""
    local, s = np.tile(np.eye(3), (frames, JOINTS, 1, 1)), np.linspace(0.0, 1.0, frames)
    for name, axis, most in (
        ("spine2", "x", 30),
        ("left_shoulder", "z", -50),
        ("left_elbow", "y", 70),
        ("right_knee", "x", 40),
    ):
        local[:, JOINT[name]] = Rotation.from_euler(axis, (most * s)[:, None], degrees=True).as_matrix()
    return local


def test_bones_point_where_the_other_skeletons_do():
    local = some()
    found = clips._retargeted(mannequin(local), Path("turn.glb")).local
    every = captures.RATE // 30
    want, got = (places(x, np.zeros((len(x), 3))) for x in (local[::every], found))
    np.testing.assert_allclose(got, want, atol=1e-6)


def test_other_names_are_refused():
    clip = mannequin(some(2))
    with pytest.raises(ValueError, match="named neither"):
        clips._retargeted(replace(clip, nodes=("bone",) * len(clip.nodes)), Path("x.glb"))


def test_mirrored_twice_is_the_same():
    local = some()
    other = clips.mirrored(local)
    np.testing.assert_allclose(clips.mirrored(other), local)
    at, mirror = (places(x, np.zeros((len(x), 3))) for x in (local, other))
    np.testing.assert_allclose(mirror[:, JOINT["right_wrist"]], at[:, JOINT["left_wrist"]] * (-1, 1, 1), atol=1e-9)


def test_blending_ends_where_it_should():
    one, other = some(), clips.mirrored(some())
    np.testing.assert_allclose(clips.blended(one, other, np.zeros(len(one))), one, atol=1e-9)
    np.testing.assert_allclose(clips.blended(one, other, np.ones(len(one))), other, atol=1e-9)


def test_who_stands_stays_where_the_feet_are():
    local = np.tile(np.eye(3), (60, JOINTS, 1, 1))
    # Both knees bend and straighten again.
    bend = 25.0 * np.sin(np.linspace(0.0, np.pi, 60))
    for side in ("left", "right"):
        for name, share in (("hip", -1.0), ("knee", 2.0), ("ankle", -1.0)):
            local[:, JOINT[f"{side}_{name}"]] = Rotation.from_euler(
                "x", (share * bend)[:, None], degrees=True
            ).as_matrix()
    place, contact = clips.standing(local)
    at = places(local, place)[:, [JOINT["left_ankle"], JOINT["right_ankle"]]]
    assert np.linalg.norm(at - at[0], axis=-1).max() < 0.01
    assert place[:, 1].min() < place[0, 1] - 0.02
    assert contact.min() == 1.0


@pytest.fixture(scope="module")
def found():
    raised = np.tile(np.eye(3), (45, JOINTS, 1, 1))
    raised[:, JOINT["left_shoulder"]] = turn("z", 80.0)
    return {name: raised for action in actions.ACTIONS.values() for name in action.clips}


@pytest.mark.parametrize("name", ["bow", "dance"])
def test_an_action_is_done_and_ends(found, name):
    silence, motion = actions.act(actions.ACTIONS[name], found, 12.0, 3)
    assert silence.samples.max() == silence.samples.min() == 0.0
    assert {part: motion[part].shape[1] for part in CHANNELS} == CHANNELS
    assert {len(motion[part]) for part in CHANNELS} == {silence.frames} == {len(motion["height"])}
    at = places(rotations(motion), np.zeros((silence.frames, 3)))
    highest = at[:, [JOINT["left_wrist"], JOINT["right_wrist"]], 1].max(1)
    up = highest > at[:, JOINT["head"], 1]
    assert not up[:20].any()
    assert up.sum() > 20
    assert not up[-10:].any()
    assert set(np.unique(motion["lower"][:, CONTACT])) <= {0.0, 1.0}


def test_a_clip_that_is_missing_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(clips, "read", lambda path: [clips.Clip("Bow", some())])
    with pytest.raises(ValueError, match="Confused"):
        actions.read_clips([tmp_path / "a.glb"])
