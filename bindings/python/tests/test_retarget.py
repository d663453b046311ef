"""Poses on other characters: bones by name or number, in any axes, with arms that keep out of wide bodies."""

import numpy as np
import pytest

import umo

ELBOW = umo.JOINTS.index("left_elbow")


@pytest.fixture(scope="module")
def body(model):
    """The model's own skeleton: its bones at rest, in glTF's axes."""
    parents, offsets = model.skeleton()
    places = np.zeros((len(umo.JOINTS), 3), np.float32)
    for joint, parent in enumerate(parents):
        places[joint] = offsets[joint] + (places[parent] if parent >= 0 else 0)
    rotations = np.tile(np.float32([0, 0, 0, 1]), (len(umo.JOINTS), 1))
    return list(umo.JOINTS), np.array(parents), places, rotations


def barrel(places):
    """A wide trunk: points, the bone of each, and triangles."""
    points, bones, triangles = [], [], []
    low, high = places[1, 1] - 0.05, places[16, 1]
    for ring in range(31):
        for side in range(24):
            turn = 2 * np.pi * side / 24
            points.append((0.3 * np.sin(turn), low + (high - low) * ring / 30, 0.35 * np.cos(turn)))
            bones.append(0 if ring < 6 else 3 if ring < 15 else 9)
            if ring < 30:
                a, b = 24 * ring + side, 24 * ring + (side + 1) % 24
                triangles += [(a, b, a + 24), (b, b + 24, a + 24)]
    return {"vertices": points, "vertex_bones": bones, "indices": triangles}


@pytest.fixture
def pose():
    """A left hand before the belly."""
    rotations = np.tile(np.float32([0, 0, 0, 1]), (len(umo.JOINTS), 1))
    rotations[16] = 0, 0, -np.sin(0.6), np.cos(0.6)
    rotations[18] = 0, -np.sin(0.95), 0, np.cos(0.95)
    return rotations, np.float32([0.1, 0.02, -0.2])


def apart(a, b):
    return 2 * np.arccos(np.minimum(np.abs(np.sum(a * b, axis=-1)), 1))


def test_the_models_own_skeleton_keeps_its_pose(model, body, pose):
    with umo.Retarget(model, *body, gain=0) as character:
        assert character.joints.tolist() == list(range(len(umo.JOINTS)))
        rotations, place = character.apply(*pose)
    assert apart(rotations, pose[0]).max() < 2e-3
    # Height goes by the floor.
    assert np.allclose((place - body[2][0] - pose[1])[[0, 2]], 0, atol=1e-3)


def test_arms_keep_out_of_a_wide_body(model, body, pose):
    names, parents, places, rotations = body
    character = umo.Retarget(model, [f"bone {at}" for at in range(len(names))], parents, places, rotations, joints=np.arange(len(names)), **barrel(places))
    turned, _ = character.apply(*pose)
    assert apart(turned[ELBOW], pose[0][ELBOW]) > 0.1
    assert apart(turned[17], pose[0][17]) < 0.06
    thinner = umo.Retarget(model, *body, girths={"pelvis": 0.5, "belly": 0.5, "chest": 0.5}, **barrel(places))
    assert apart(thinner.apply(*pose)[0][16], turned[16]) > 0.1
    half = umo.Retarget(model, *body, gain=0.5, **barrel(places)).apply(*pose)[0]
    assert 0.02 < apart(half[ELBOW], pose[0][ELBOW]) < apart(turned[ELBOW], pose[0][ELBOW])


def test_wrong_characters_are_errors(model, body, pose):
    names, parents, places, rotations = body
    for wrong, word in [
        ({"gain": 2}, "gain"),
        ({"girths": {"tail": 1}}, "belly"),
        ({"axes": "maya"}, "unity"),
        ({"vertices": [[0, 0, 0]]}, "vertex_bones"),
        ({"vertices": [[0, 0, 0]], "vertex_bones": [99]}, "bone 99"),
        ({"vertices": [[0, 0, 0]], "vertex_bones": [0], "indices": [[0, 0, 1]]}, "indices"),
        ({"vertices": [[0, 0, 0]], "vertex_bones": [0], "indices": [[0, 0, -1]]}, "negative"),
        ({"joints": [0]}, "joints"),
    ]:
        with pytest.raises((umo.Error, ValueError), match=word):
            umo.Retarget(model, *body, **wrong)
    with pytest.raises(ValueError, match="places"):
        umo.Retarget(model, names, parents, places[1:], rotations)
    with pytest.raises(umo.Error, match="left_elbow"):
        umo.Retarget(model, ["" if name == "left_elbow" else name for name in names], parents, places, rotations)
    character = umo.Retarget(model, *body)
    with pytest.raises(ValueError, match="55"):
        character.apply(pose[0][1:], pose[1])
    with pytest.raises(umo.Error, match="finite"):
        character.apply(pose[0], [0, np.nan, 0])
    character.close()
    with pytest.raises(umo.Error, match="freed"):
        character.apply(*pose)
