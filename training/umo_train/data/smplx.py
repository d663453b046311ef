"""Converts motion capture in SMPL-X parameters to the channels of the four parts."""

from pathlib import Path

import numpy as np
from scipy.ndimage import binary_opening
from scipy.spatial.transform import Rotation

from umo_train.data.clip import DataError
from umo_train.skeleton import CONTACT_JOINTS, JOINT, JOINTS, JOINTS_OF, places, rotation_6d
from umo_train.speech.utterance import FRAME_RATE

# Limits of a planted joint: speed in m/s, and height above the floor in m. The first is EMAGE's 1 cm a frame.
PLANTED_SPEED = 0.3
PLANTED_HEIGHT = 0.05
# A joint's floor is a low percentile of its heights, so that one bad frame does not define it.
_FLOOR_PERCENTILE = 5
# Contacts of a single frame are noise.
_SHORTEST_CONTACT = 2


def load(path: Path, wanted: tuple[str, ...], optional: tuple[str, ...] = ()) -> dict[str, np.ndarray]:
    """Arrays of an `.npz`, without object arrays."""
    try:
        with np.load(path, allow_pickle=False) as arrays:
            missing = [name for name in wanted if name not in arrays.files]
            if missing:
                raise DataError(f"{path}: no {', '.join(missing)} in it, it has {', '.join(arrays.files)}")
            return {name: arrays[name] for name in (*wanted, *optional) if name in arrays.files}
    except (OSError, ValueError, EOFError) as error:
        raise DataError(f"{path}: not an .npz of numbers, fetch it again: {error}") from error


def pose(path: Path, poses: np.ndarray) -> np.ndarray:
    """Axis-angle `[T, 165]` of SMPL-X, or `[T, 156]` of SMPL-H (no jaw and eyes), to matrices `[T, 55, 3, 3]`."""
    frames = len(poses)
    if poses.ndim != 2 or poses.shape[1] not in (156, 3 * JOINTS) or frames == 0:
        found = list(poses.shape)
        raise DataError(f"{path}: poses of shape {found}, expected [T, 165] or [T, 156]: use SMPL-X or SMPL-H")
    if not np.isfinite(poses).all():
        raise DataError(f"{path}: poses that are not numbers")
    vectors = np.zeros((frames, JOINTS, 3))
    given = poses.reshape(frames, -1, 3)
    if given.shape[1] == JOINTS:
        vectors[:] = given
    else:
        vectors[:, : JOINT["jaw"]], vectors[:, JOINT["left_index1"] :] = given[:, :22], given[:, 22:]
    return Rotation.from_rotvec(vectors.reshape(-1, 3)).as_matrix().reshape(frames, JOINTS, 3, 3)


def resampled_rotations(matrices: np.ndarray, rate: float) -> np.ndarray:
    """`[T, J, 3, 3]` at `rate` to 30 a second, by spherical interpolation."""
    before, after, part = _between(len(matrices), rate)
    first = Rotation.from_matrix(matrices[before].reshape(-1, 3, 3))
    turn = (first.inv() * Rotation.from_matrix(matrices[after].reshape(-1, 3, 3))).as_rotvec()
    joints = matrices.shape[1]
    part_way = Rotation.from_rotvec(np.repeat(part, joints)[:, None] * turn)
    return (first * part_way).as_matrix().reshape(-1, joints, 3, 3)


def resampled(values: np.ndarray, rate: float) -> np.ndarray:
    """`[T, C]` at `rate` to 30 a second, by linear interpolation."""
    before, after, part = _between(len(values), rate)
    return values[before] + part[:, None] * (values[after] - values[before])


def _between(frames: int, rate: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """For each new frame the old ones around it, and its relative position between them, 0..1."""
    # Slightly more than the exact end, so that rounding does not drop the last frame.
    at = np.arange(0.0, frames - 1 + 1e-6, rate / FRAME_RATE)
    before = np.minimum(at.astype(int), frames - 1)
    return before, np.minimum(before + 1, frames - 1), np.clip(at - before, 0.0, 1.0)


def channels(matrices: np.ndarray, translation: np.ndarray, face: np.ndarray) -> dict[str, np.ndarray]:
    """Rotations `[T, 55, 3, 3]`, positions of the pelvis `[T, 3]` and the face's coefficients `[T, n]` to the four
    parts.
    """
    six = rotation_6d(matrices)
    parts = {part: six[:, list(joints)].reshape(len(six), -1) for part, joints in JOINTS_OF.items()}
    parts["face"] = np.concatenate([parts["face"], face], 1)
    parts["lower"] = np.concatenate([parts["lower"], velocity(translation), contacts(matrices, translation)], 1)
    return {part: values.astype(np.float32) for part, values in parts.items()}


def velocity(translation: np.ndarray) -> np.ndarray:
    """Velocity in m/s over the floor, such that a frame's position is the previous one plus its velocity for 1/30 s;
    upwards 0.
    """
    if len(translation) < 2:
        return np.zeros((len(translation), 3))
    steps = FRAME_RATE * np.diff(translation, axis=0)
    steps = np.concatenate([steps, steps[-1:]])
    return steps * (1.0, 0.0, 1.0)


def contacts(matrices: np.ndarray, translation: np.ndarray) -> np.ndarray:
    """0 or 1 for each of `CONTACT_JOINTS`, `[T, 4]`: joints that neither move nor are in the air."""
    at = places(matrices, translation)[:, list(CONTACT_JOINTS)]
    if len(at) < 2:
        return np.ones((len(at), len(CONTACT_JOINTS)))
    speed = FRAME_RATE * np.linalg.norm(np.diff(at, axis=0), axis=-1)
    speed = np.concatenate([speed, speed[-1:]])
    height = at[..., 1] - np.percentile(at[..., 1], _FLOOR_PERCENTILE, axis=0)
    planted = (speed < PLANTED_SPEED) & (height < PLANTED_HEIGHT)
    return binary_opening(planted, np.ones((_SHORTEST_CONTACT, 1))).astype(np.float64)
