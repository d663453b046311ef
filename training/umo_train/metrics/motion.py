"""Body measures: joint positions, smoothness, sliding of planted feet."""

import numpy as np

from umo_train.metrics.item import Motion
from umo_train.skeleton import CONTACT, CONTACT_JOINTS, JOINTS_OF, VELOCITY, places, rotations
from umo_train.speech.utterance import FRAME_RATE

# Height of a standing foot's joint above the floor (see `skeleton.STANDING_HEIGHT_M`).
FOOT_HEIGHT_M = 0.02
# Heights of ankles and balls of the feet in the rest pose.
_REST_HEIGHT_M = np.array([0.08, 0.02, 0.08, 0.02])


def joint_places(motion: Motion, walking: bool = True) -> np.ndarray:
    """Positions of all joints `[T, 55, 3]` in metres.

    The pelvis moves by its velocity (frame `i` adds that of frame `i - 1`), at the height that puts the lowest foot
    joint on the floor; with `walking` false it stays at the origin.
    """
    local = rotations(motion)
    at = places(local, np.zeros((len(local), 3)))
    if walking:
        walked = np.zeros((len(local), 3))
        walked[1:] = np.cumsum(motion["lower"][:-1, VELOCITY], 0) / FRAME_RATE
        walked[:, 1] = FOOT_HEIGHT_M - at[:, CONTACT_JOINTS, 1].min(1)
        at += walked[:, None]
    return at


def joint_speed(motion: Motion, joints: tuple[int, ...] = JOINTS_OF["upper"]) -> np.ndarray:
    """Mean speed of joints relative to the pelvis, m/s `[T]`: central differences."""
    at = joint_places(motion, walking=False)[:, joints]
    return np.linalg.norm(np.gradient(at, 1 / FRAME_RATE, axis=0), axis=-1).mean(1)


def jerk(motion: Motion, joints: tuple[int, ...] = JOINTS_OF["upper"]) -> float:
    """Mean magnitude of the third derivative of positions relative to the pelvis, m/s^3."""
    at = joint_places(motion, walking=False)[:, joints]
    return float(np.linalg.norm(np.diff(at, 3, axis=0) * FRAME_RATE**3, axis=-1).mean())


def contacts(motion: Motion, reach_m: float = 0.02) -> np.ndarray:
    """Which of the four foot joints are on the floor `[T, 4]`, by height alone: with a speed criterion, sliding feet
    would not count as planted."""
    height = joint_places(motion)[:, CONTACT_JOINTS, 1]
    return height < _REST_HEIGHT_M + reach_m


def foot_slide(motion: Motion, planted: np.ndarray | None = None) -> float:
    """Mean horizontal speed of planted foot joints, m/s; 0 without any.

    `planted` `[T, 4]` are the contacts; by default the motion's own channels if there are any, else by height.
    """
    if planted is None:
        planted = np.asarray(motion["lower"][:, CONTACT]) > 0.5
        if not planted.any():
            planted = contacts(motion)
    at = joint_places(motion)[:, CONTACT_JOINTS][..., [0, 2]]
    speed = np.linalg.norm(np.diff(at, axis=0), axis=-1) * FRAME_RATE
    both = planted[1:] & planted[:-1]
    return float(speed[both].mean()) if both.any() else 0.0


def use_entropy(counts: np.ndarray) -> float:
    """Evenness of the use of codes or experts, along the last axis and averaged over the others: entropy relative to
    uniform use, 0 (one does everything) to 1. Rows without any use are ignored."""
    counts = np.asarray(counts, np.float64).reshape(-1, np.shape(counts)[-1])
    counts = counts[counts.sum(1) > 0]
    if counts.size == 0 or counts.shape[1] < 2:
        return 0.0
    share = counts / counts.sum(1, keepdims=True)
    entropy = -np.sum(share * np.log(share, out=np.zeros_like(share), where=share > 0), 1)
    return float((entropy / np.log(counts.shape[1])).mean())
