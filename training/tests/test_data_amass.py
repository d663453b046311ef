import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from umo_train import skeleton
from umo_train.data import smplx
from umo_train.data.amass import amass
from umo_train.data.clip import DataError

UPRIGHT = Rotation.from_euler("x", 90, degrees=True)


def write(path, poses, trans, **more):
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, poses=poses, trans=trans, gender="male", betas=np.zeros(16), **more)


def standing(frames, width=156, turn=0.0):
    """Upright in AMASS's axes: Z up, at 0 degrees facing away from +Y."""
    poses = np.zeros((frames, width))
    poses[:, :3] = (Rotation.from_euler("z", turn, degrees=True) * UPRIGHT).as_rotvec()
    return poses


def test_clips_are_found_in_folders_and_shapes_are_not_clips(tmp_path):
    for name in ("CMU/01/b_poses", "CMU/01/a_poses", "KIT/3/c_stageii"):
        write(tmp_path / f"{name}.npz", standing(8), np.zeros((8, 3)), mocap_framerate=120.0)
    np.savez(tmp_path / "CMU/01/shape.npz", betas=np.zeros(16))
    clips = list(amass(tmp_path))
    assert [clip.name for clip in clips] == ["CMU/01/a_poses", "CMU/01/b_poses", "KIT/3/c_stageii"]
    assert clips[0].speaker == "01" and clips[0].speech is None
    assert {part: values.shape[1] for part, values in clips[0].motion.items()} == skeleton.CHANNELS
    assert next(iter(amass(tmp_path, face=100))).motion["face"].shape[1] == 106


@pytest.mark.parametrize("rate", [60.0, 100.0, 120.0, 25.0])
def test_rotations_are_resampled_on_great_arcs(tmp_path, rate):
    """An elbow at constant angular speed keeps it at 30 frames a second."""
    speed, seconds = 1.3, 2.0
    time = np.arange(int(seconds * rate) + 1) / rate
    poses = standing(len(time))
    elbow = skeleton.JOINT["left_elbow"]
    poses[:, 3 * elbow : 3 * elbow + 3] = np.outer(speed * time, (0.0, 0.6, 0.8))
    trans = np.outer(time, (0.0, 0.0, 0.1)) + (0.0, 0.0, 1.0)
    write(tmp_path / "x.npz", poses, trans, mocap_frame_rate=rate)
    clip = next(iter(amass(tmp_path)))
    found = Rotation.from_matrix(skeleton.rotations(clip.motion)[:, elbow]).as_rotvec()
    wanted = np.outer(speed * np.arange(61) / 30, (0.0, 0.6, 0.8))
    np.testing.assert_allclose(found, wanted, atol=1e-5)
    np.testing.assert_allclose(clip.translation[:, 1], 1.0 + 0.1 * np.arange(61) / 30, atol=1e-5)


def test_resampling_is_spherical_interpolation():
    """For arbitrary rotations, joint by joint: equal to scipy's `Slerp`."""
    turns = Rotation.random(2 * 9, rng=np.random.default_rng(0)).as_matrix().reshape(9, 2, 3, 3)
    found = smplx.resampled_rotations(turns, 25.0)
    at = np.arange(len(found)) / 30
    assert len(found) == 10
    for joint in range(2):
        wanted = Slerp(np.arange(9) / 25, Rotation.from_matrix(turns[:, joint]))(at).as_matrix()
        np.testing.assert_allclose(found[:, joint], wanted, atol=1e-9)


def test_people_stand_upright_and_face_forward_from_the_origin(tmp_path):
    frames, turn = 30, 130.0
    walk = Rotation.from_euler("z", turn, degrees=True).apply(np.outer(np.arange(frames) / 30, (0.0, -1.2, 0.0)))
    write(tmp_path / "x.npz", standing(frames, turn=turn), walk + (3.0, 2.0, 0.9), mocap_framerate=30.0)
    clip = next(iter(amass(tmp_path)))
    np.testing.assert_allclose(skeleton.rotations(clip.motion)[:, 0], np.tile(np.eye(3), (frames, 1, 1)), atol=1e-6)
    np.testing.assert_allclose(clip.translation[0], (0.0, 0.9, 0.0), atol=1e-6)
    # Facing and walking -Y in AMASS is walking +Z here.
    np.testing.assert_allclose(clip.motion["lower"][:, skeleton.VELOCITY], np.tile((0, 0, 1.2), (frames, 1)), atol=1e-5)


def test_hands_of_both_bodies_land_on_the_hands(tmp_path):
    small, large = standing(3), standing(3, 165)
    small[:, 3 * 22 :] = large[:, 3 * 25 :] = 0.3 * np.random.default_rng(0).normal(size=90)
    small[:, 3:66] = large[:, 3:66] = 0.1
    write(tmp_path / "h.npz", small, np.zeros((3, 3)), mocap_framerate=30.0)
    write(tmp_path / "x.npz", large, np.zeros((3, 3)), mocap_frame_rate=30.0)
    first, second = amass(tmp_path)
    for part in skeleton.PARTS:
        np.testing.assert_array_equal(first.motion[part], second.motion[part])
    assert np.abs(first.motion["hands"][0] - np.tile([1, 0, 0, 0, 1, 0], 30)).max() > 0.1


def test_contacts_are_of_feet_that_stand_still(tmp_path):
    """The left leg lifts for a while by bending hip and knee; the right one stands throughout."""
    frames = 60
    matrices = np.tile(np.eye(3), (frames, skeleton.JOINTS, 1, 1))
    lift = np.clip(np.minimum(np.arange(frames) - 15, 45 - np.arange(frames)) / 8, 0, 1)
    matrices[:, skeleton.JOINT["left_hip"]] = Rotation.from_euler("x", -1.2 * lift[:, None]).as_matrix()
    matrices[:, skeleton.JOINT["left_knee"]] = Rotation.from_euler("x", 1.2 * lift[:, None]).as_matrix()
    found = smplx.contacts(matrices, np.tile((0, skeleton.STANDING_HEIGHT_M, 0), (frames, 1)))
    left, right = found[:, :2], found[:, 2:]
    assert right.all()
    assert left[:15].all() and left[46:].all() and not left[18:43].any()


def test_sliding_feet_touch_nothing():
    frames = 20
    matrices = np.tile(np.eye(3), (frames, skeleton.JOINTS, 1, 1))
    slide = np.outer(np.arange(frames) / 30, (1.0, 0.0, 0.0)) + (0, skeleton.STANDING_HEIGHT_M, 0)
    assert not smplx.contacts(matrices, slide).any()
    assert smplx.contacts(matrices, slide * (0.2, 1, 1)).all()


def test_wrong_files_are_named(tmp_path):
    def refused(says):
        with pytest.raises(DataError, match=says):
            list(amass(tmp_path))

    refused("no .npz with motion below it: fetch sets of AMASS")
    path = tmp_path / "a.npz"
    write(path, standing(4), np.zeros((4, 3)))
    refused(r"a.npz: no mocap_framerate or mocap_frame_rate")
    write(path, standing(4), np.zeros((3, 3)), mocap_framerate=30.0)
    refused(r"trans of shape \[3, 3\], expected \[4, 3\]")
    write(path, np.full((4, 156), np.nan), np.zeros((4, 3)), mocap_framerate=30.0)
    refused("poses that are not numbers")
    np.savez(path, poses=np.array([{}], dtype=object), trans=np.zeros((1, 3)))
    refused("not an .npz of numbers")
