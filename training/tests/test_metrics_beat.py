import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from metrics_motion import still, turned
from umo_train.metrics import beat as b
from umo_train.skeleton import JOINT, JOINTS_OF, matrices, rotation_6d
from umo_train.speech.utterance import SAMPLE_RATE


def clicks(times: np.ndarray, seconds: float) -> np.ndarray:
    out = np.random.default_rng(0).normal(size=int(seconds * SAMPLE_RATE)) * 1e-4
    for time in times:
        at = int(time * SAMPLE_RATE)
        out[at : at + 800] += np.hanning(1600)[800:] * np.sin(np.arange(800) * 0.4) * 0.5
    return out.astype(np.float32)


def strokes(times: np.ndarray, frames: int) -> dict[str, np.ndarray]:
    """An arm that moves back and forth slowly, turning at the given times."""
    angle = np.interp(np.arange(frames) / 30, times, 0.5 * (-1.0) ** np.arange(len(times)))
    smooth = np.convolve(np.pad(angle, 4, mode="edge"), np.hanning(9) / np.hanning(9).sum(), "valid")
    return turned(still(frames), JOINT["left_shoulder"], smooth)


TIMES = np.cumsum(np.random.default_rng(1).uniform(0.7, 1.3, 18))


def test_onsets_are_where_the_clicks_are():
    found = b.onsets(clicks(TIMES, 22))
    assert len(found) == len(TIMES)
    assert np.abs(found - TIMES).max() < 0.05


def test_turning_points_are_where_the_arm_turns_back():
    found = b.turning_points(strokes(TIMES, 660))
    nearest = np.abs(np.subtract.outer(TIMES[1:-1], found)).min(1)
    assert nearest.max() < 0.07


def test_constancy_of_known_distances():
    assert b.constancy(np.array([1.0, 2.0]), np.array([1.0, 2.3]), 0.3) == pytest.approx((1 + np.exp(-0.5)) / 2)
    assert b.constancy(np.array([]), np.array([1.0])) == 0
    assert b.constancy(np.array([1.0]), np.array([])) == 0


def test_motion_on_the_beat_beats_shifted_audio_and_motion_off_it_does_not():
    on = [(TIMES, b.turning_points(strokes(TIMES, 660)), 22.0)]
    off = [(TIMES, b.turning_points(strokes(TIMES + 0.5, 660)), 22.0)]
    for sigma in (b.SIGMA_S, b.SHARP_SIGMA_S):
        assert b.beat(on, sigma).ratio > 1.3
        assert b.beat(off, sigma).ratio < 1
    assert b.beat(on, b.SHARP_SIGMA_S).ratio > b.beat(on, b.SIGMA_S).ratio


def test_a_body_that_never_moves_keeps_no_beat():
    assert b.beat([(TIMES, b.turning_points(still(660)), 22.0)]) == b.Beat(0.0, 0.0)
    assert b.Beat(0.0, 0.0).ratio == 0


def jittered(motion: dict[str, np.ndarray], degrees: float) -> dict[str, np.ndarray]:
    """Each joint of the upper body trembles about an axis, independently in each frame."""
    rng = np.random.default_rng(2)
    out = motion
    for joint in JOINTS_OF["upper"]:
        turns = matrices(out["upper"][:, 6 * JOINTS_OF["upper"].index(joint) :][:, :6].astype(np.float64))
        tremble = Rotation.from_euler("z", np.radians(degrees) * rng.normal(size=(len(turns), 1))).as_matrix()
        out = {name: values.copy() for name, values in out.items()}
        at = 6 * JOINTS_OF["upper"].index(joint)
        out["upper"][:, at : at + 6] = rotation_6d(turns @ tremble)
    return out


def test_smooth_turning_points_are_where_the_arm_turns_back():
    found = b.smooth_turning_points(strokes(TIMES, 660))
    assert len(found) == len(TIMES[1:-1])
    assert np.abs(np.subtract.outer(TIMES[1:-1], found)).min(1).max() < 0.07
    assert len(b.smooth_turning_points(still(660))) == 0


def test_jitter_raises_bc_and_not_smooth_bc():
    events, wander = np.arange(0.2, 21.8, 0.25), strokes(TIMES, 660)

    def constancy(points, motion) -> float:
        return b.beat([(events, points(motion), 22.0)]).own

    plain, smooth = constancy(b.turning_points, wander), constancy(b.smooth_turning_points, wander)
    for degrees in (0.25, 0.5, 1.0, 2.0):
        rough = jittered(wander, degrees)
        assert constancy(b.turning_points, rough) > plain + 0.05
        assert constancy(b.smooth_turning_points, rough) <= smooth + 1e-9
