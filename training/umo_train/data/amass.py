"""AMASS: motion capture without speech, for text-to-motion and for the motion codecs."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from umo_train.data import smplx
from umo_train.data.clip import Clip, DataError, folder
from umo_train.skeleton import EXTRA_CHANNELS

_FETCH = "fetch sets of AMASS (SMPL-X or SMPL+H) and unpack them there"
# A person's shape and intermediate results of fitting are stored beside the motion.
_NO_MOTION = ("shape.npz", "_stagei.npz")
# AMASS has Z up; here Y is.
_UPRIGHT = Rotation.from_euler("x", -90, degrees=True)


def amass(root: Path, face: int = EXTRA_CHANNELS["face"]) -> Iterator[Clip]:
    """Clips of all `.npz` below `root` at 30 frames a second, starting at the origin and facing +Z; `face` coefficients
    at rest, as AMASS has no faces."""
    folder(root, _FETCH)
    paths = sorted(path for path in root.rglob("*.npz") if not path.name.endswith(_NO_MOTION))
    if not paths:
        raise DataError(f"{root}: no .npz with motion below it: {_FETCH}")
    return (_clip(root, path, face) for path in paths)


def _clip(root: Path, path: Path, face: int) -> Clip:
    keys = ("mocap_framerate", "mocap_frame_rate")
    arrays = smplx.load(path, ("poses", "trans"), keys)
    rate = next((float(arrays[key]) for key in keys if key in arrays), 0.0)
    if not 1.0 <= rate <= 1000.0:
        raise DataError(f"{path}: no {' or '.join(keys)} between 1 and 1000 in it")
    matrices, translation = smplx.pose(path, arrays["poses"]), arrays["trans"]
    if translation.shape != (len(matrices), 3):
        raise DataError(f"{path}: trans of shape {list(translation.shape)}, expected [{len(matrices)}, 3]")
    matrices = smplx.resampled_rotations(matrices, rate)
    matrices, translation = _turned(matrices, smplx.resampled(translation, rate))
    motion = smplx.channels(matrices, translation, np.zeros((len(matrices), face)))
    name = path.relative_to(root).with_suffix("").as_posix()
    # Data sets have a folder for each person.
    return Clip(name, path.parent.name, None, motion, translation.astype(np.float32))


def _turned(matrices: np.ndarray, translation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotated to Y up, starting at the floor's origin with the pelvis facing +Z in the first frame."""
    pelvis = _UPRIGHT * Rotation.from_matrix(matrices[:, 0])
    forward = pelvis[0].apply((0.0, 0.0, 1.0))
    heading = Rotation.from_euler("y", -np.arctan2(forward[0], forward[2]))
    out = matrices.copy()
    out[:, 0] = (heading * pelvis).as_matrix()
    at = (heading * _UPRIGHT).apply(translation)
    return out, at - at[0] * (1.0, 0.0, 1.0)
