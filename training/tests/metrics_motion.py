"""Synthetic motion for the metrics' tests: a standing person with hanging, movable arms."""

import numpy as np
from scipy.spatial.transform import Rotation

from umo_train.skeleton import CHANNELS, JOINTS_OF, PARTS, rotation_6d


def still(frames: int) -> dict[str, np.ndarray]:
    """The rest pose with both feet planted."""
    motion = {part: np.zeros((frames, CHANNELS[part]), np.float32) for part in PARTS}
    for part, joints in JOINTS_OF.items():
        motion[part][:, : 6 * len(joints)] = np.tile(rotation_6d(np.eye(3)), len(joints))
    motion["lower"][:, 57:61] = 1
    return motion


def turned(motion: dict[str, np.ndarray], joint: int, angles: np.ndarray, axis: str = "z") -> dict[str, np.ndarray]:
    """The motion with a joint rotated by angles `[T]` about an axis."""
    part = next(part for part, joints in JOINTS_OF.items() if joint in joints)
    at = 6 * JOINTS_OF[part].index(joint)
    out = {name: values.copy() for name, values in motion.items()}
    out[part][:, at : at + 6] = rotation_6d(Rotation.from_euler(axis, np.asarray(angles)[:, None]).as_matrix())
    return out


def swinging(frames: int, seed: int, size: float = 0.3) -> dict[str, np.ndarray]:
    """Arms that wander slowly."""
    rng = np.random.default_rng(seed)
    motion = still(frames)
    for joint in (16, 17, 18, 19):
        time = np.arange(frames) / 30
        angles = size * sum(np.sin(2 * np.pi * rate * time + rng.uniform(0, 2 * np.pi)) for rate in (0.3, 0.7, 1.1))
        motion = turned(motion, joint, angles)
    return motion
