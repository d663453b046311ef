"""Keeps hands out of each other and out of the body: wrists are moved apart, ahead of time and smoothly."""

from collections.abc import Callable

import numpy as np
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

from umo_train.performer.arms import WRIST
from umo_train.skeleton import JOINT, JOINTS_OF, places

# Minimum distance of points of two hands: two fingers' thickness and a margin, m.
APART_M = 0.03
# The trunk's half width and half depth including a hand's thickness, m; and how far its centre is in front of the
# spine.
TRUNK_M, AHEAD_M = np.array([0.165, 0.135]), 0.015
_ROUNDS = 6
# Distance of wrists below which hands may touch, m.
_NEAR_M = 0.5
_WIDEN, _SMOOTH = 13, 3.5
_WRISTS = (JOINT["left_wrist"], JOINT["right_wrist"])
_FINGERS = (JOINTS_OF["hands"][:15], JOINTS_OF["hands"][15:])
_SPINE = (JOINT["pelvis"], JOINT["spine2"], JOINT["neck"])


def hand_points(at: np.ndarray) -> np.ndarray:
    """Joint positions `[T, 55, 3]` to points of both hands `[2, T, n, 3]`: joints, tips, centres of the palms."""
    out = []
    for wrist, fingers in zip(_WRISTS, _FINGERS, strict=True):
        bones = at[:, fingers].reshape(len(at), 5, 3, 3)
        tips = bones[:, :, 2] + 0.9 * (bones[:, :, 2] - bones[:, :, 1])
        palm = 0.5 * (bones[:, :4, 0] + at[:, None, wrist])
        out.append(np.concatenate([at[:, [wrist]], at[:, fingers], tips, palm], axis=1))
    return np.stack(out)


def between_hands(points: np.ndarray) -> np.ndarray:
    """Minimum distance of two hands' points `[T]`; distant hands count as `_NEAR_M` apart."""
    out = np.full(points.shape[1], _NEAR_M)
    near = np.linalg.norm(points[0, :, 0] - points[1, :, 0], axis=-1) < _NEAR_M
    if near.any():
        apart = points[0, near][:, :, None] - points[1, near][:, None]
        out[near] = np.sqrt(np.einsum("tijk,tijk->tij", apart, apart).min(axis=(1, 2)))
    return out


def inside_trunk(points: np.ndarray, at: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """Penetration of the deepest point of each hand into the trunk, along its depth `[2, T]`, m; 0 outside."""
    spine = at[:, _SPINE]
    heights = np.clip(points[..., 1], spine[:, :1, 1], spine[:, 2:, 1])
    # Spine position at each point's height, by its lower and upper half.
    share = (heights - spine[:, :1, 1]) / (spine[:, 1:2, 1] - spine[:, :1, 1])
    upper = (heights - spine[:, 1:2, 1]) / (spine[:, 2:, 1] - spine[:, 1:2, 1])
    low = spine[:, :1] + np.clip(share, 0.0, 1.0)[..., None] * (spine[:, 1:2] - spine[:, :1])
    middle = low + np.clip(upper, 0.0, 1.0)[..., None] * (spine[:, 2:] - spine[:, 1:2])
    away = points - middle
    c, s = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    x, z = c * away[..., 0] - s * away[..., 2], s * away[..., 0] + c * away[..., 2] - AHEAD_M
    across = np.clip(np.abs(x) / TRUNK_M[0], 0.0, 1.0)
    depth = TRUNK_M[1] * np.sqrt(1.0 - across**2)
    # Hands at the sides, behind the centre, are ignored.
    inside = np.where(z >= -0.06, depth - z, 0.0)
    level = (points[..., 1] > spine[:, :1, 1] - 0.1) & (points[..., 1] < spine[:, 2:, 1])
    return np.clip(np.where(level, inside, 0.0), 0.0, None).max(axis=-1)


def clear(states: np.ndarray, yaw: np.ndarray, solve: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Arms' states `[2, T, STATE]` with the wrists moved where hands would collide or enter the trunk. `solve` computes
    all joints' local rotations `[T, 55, 3, 3]` of given states; `yaw` is the heading of the wrists' frame."""
    out = states.copy()
    if not out.shape[1]:
        return out
    for _ in range(_ROUNDS):
        local = solve(out)
        at = places(local, np.zeros((len(local), 3)))
        points = hand_points(at)
        close = APART_M - between_hands(points)
        inside = inside_trunk(points, at, yaw)
        if close.max() <= 0.0 and inside.max() <= 0.0:
            break
        if close.max() > 0.0:
            # Both move outwards, and the higher one forward.
            push = _smoothed(np.where(close > 0.0, close + 0.01, 0.0))
            out[..., WRIST.start] += 0.6 * push
            higher = np.tanh((out[0, :, WRIST.start + 1] - out[1, :, WRIST.start + 1]) / 0.03)
            out[0, :, WRIST.start + 2] += 0.25 * push * (1.0 + higher)
            out[1, :, WRIST.start + 2] += 0.25 * push * (1.0 - higher)
        for arm in (0, 1):
            if inside[arm].max() > 0.0:
                out[arm, :, WRIST.start + 2] += _smoothed(inside[arm])
    return out


def _smoothed(push: np.ndarray) -> np.ndarray:
    """At least the requested value, with slow flanks."""
    return gaussian_filter1d(maximum_filter1d(push, _WIDEN, mode="nearest"), _SMOOTH, mode="nearest")
