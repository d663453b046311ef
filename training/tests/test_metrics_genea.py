import numpy as np
import pytest

from metrics_motion import still, swinging, turned
from test_metrics_beat import clicks
from umo_train.metrics import genea
from umo_train.skeleton import JOINT


def test_beats_on_the_onsets_align_and_a_still_body_has_none():
    """An arm turns back on each click, and half-way between two of them in the other take."""
    times = np.arange(0.5, 12, 0.9)
    sound = clicks(times, 12)

    def arm(late: float) -> dict[str, np.ndarray]:
        # Slightly slower on one side, as a minimum needs a lowest frame.
        angle = 0.5 * np.cos(np.pi * (np.arange(360) / 30 - times[0] - late - 0.01) / 0.9)
        return turned(still(360), JOINT["left_elbow"], angle)

    on, weights = genea.beat_alignment([(sound, arm(0.0))])
    off, _ = genea.beat_alignment([(sound, arm(0.45))])
    assert weights.tolist() == [360 - 2 * genea.EDGE]
    # Only the wrist moves of the thirteen joints. The clicks are heard up to a step of 32 ms late.
    assert on[0] == pytest.approx([1 / 13, 1 / 13], rel=0.05)
    assert off[0] == pytest.approx(np.exp(-(0.45**2) / (2 * 0.3**2)) / 13, rel=0.4)
    np.testing.assert_array_equal(genea.beat_alignment([(sound, still(360))])[0], [[0, 0]])


def test_diversity_and_variance_are_of_the_take_about_its_own_mean():
    raised = turned(still(60), JOINT["left_elbow"], np.full(60, 1.0))
    assert genea.l1_diversity(raised) == pytest.approx(0, abs=1e-9)
    assert genea.pose_variance(raised) == pytest.approx(0, abs=1e-9)
    turning = turned(still(60), JOINT["left_elbow"], np.where(np.arange(60) < 30, 0.2, -0.2))
    assert genea.pose_variance(turning) == pytest.approx(0.2**2 / (55 * 3))
    assert genea.l1_diversity(swinging(90, 0, 0.6)) > 1.5 * genea.l1_diversity(swinging(90, 0, 0.3)) > 0
