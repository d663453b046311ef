"""Rotations over time, as stacks of 3 x 3 matrices."""

import numpy as np


def about(axis: str, angle: np.ndarray) -> np.ndarray:
    """Rotations by `angle` [...] about a coordinate axis: `[..., 3, 3]`."""
    angle = np.asarray(angle, float)
    c, s = np.cos(angle), np.sin(angle)
    first, second = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    out = np.zeros((*angle.shape, 3, 3))
    fixed = "xyz".index(axis)
    out[..., fixed, fixed] = 1.0
    out[..., first, first] = out[..., second, second] = c
    out[..., first, second], out[..., second, first] = -s, s
    return out


def euler(angles: np.ndarray) -> np.ndarray:
    """Pitch, yaw and roll `[..., 3]`: `Ry Rx Rz`, each about X, Y and Z."""
    return about("y", angles[..., 1]) @ about("x", angles[..., 0]) @ about("z", angles[..., 2])


def unit(v: np.ndarray) -> np.ndarray:
    """Vectors `[..., 3]` scaled to length 1."""
    return v / np.sqrt(np.einsum("...i,...i->...", v, v))[..., None]


def frame(along: np.ndarray, hinge: np.ndarray) -> np.ndarray:
    """Matrices with the columns `along`, `hinge` made orthogonal to it, and their cross product."""
    along = unit(along)
    hinge = unit(hinge - np.einsum("...i,...i->...", hinge, along)[..., None] * along)
    return np.stack([along, hinge, np.cross(along, hinge)], -1)


def two_bones(
    reach: np.ndarray, pole: np.ndarray, upper: float, lower: float, soft: float = 0.97
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Directions of both bones and their hinge for an end at `reach` [..., 3], with the middle joint towards `pole`.

    A reach beyond `soft` of the chain's length is smoothly shortened to stay just below it.
    """
    length = np.sqrt(np.einsum("...i,...i->...", reach, reach))
    aim = reach / length[..., None]
    longest = 0.999 * (upper + lower)
    over = np.clip(length - soft * longest, 0.0, None)
    room = (1.0 - soft) * longest
    length = np.minimum(length, soft * longest) + room * (1.0 - np.exp(-over / room))
    hinge = unit(np.cross(pole, aim))
    side = np.cross(aim, hinge)
    cosine = np.clip((upper**2 + length**2 - lower**2) / (2.0 * upper * length), -1.0, 1.0)
    first = cosine[..., None] * aim + np.sqrt(1.0 - cosine**2)[..., None] * side
    second = unit(length[..., None] * aim - upper * first)
    return first, second, hinge
