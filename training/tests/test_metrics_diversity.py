import numpy as np
import pytest

from metrics_motion import still, swinging, turned
from umo_train.metrics import diversity as d
from umo_train.skeleton import JOINT


def test_distance_between_two_poses_is_that_of_their_places():
    raised = turned(still(20), JOINT["left_elbow"], np.full(20, np.pi / 2))
    # The forearm (0.25 m and 5 mm) and a hand of 15 joints turn up by a right angle; each moves by its reach, right and
    # up.
    assert d.l1_between([still(20), raised]) == pytest.approx(d.l1_between([raised, still(20)]))
    assert 2 * 0.25 * 16 < d.l1_between([still(20), raised]) < 2 * 0.45 * 16
    assert d.l1_between([raised, raised]) == 0
    assert d.l1_between([raised]) == 0


def test_spread_grows_with_movement():
    assert d.l1_spread([still(50)]) == pytest.approx(0, abs=1e-9)
    assert d.l1_spread([swinging(90, 0, 0.6)]) > 1.5 * d.l1_spread([swinging(90, 0, 0.3)]) > 0


def test_prompts_differ_where_their_takes_do():
    same = {"a": [swinging(60, 1)], "b": [swinging(60, 1)]}
    assert d.across_prompts(same) == 0
    assert d.across_prompts(same | {"c": [swinging(60, 2)]}) > 0
    assert d.across_prompts({"a": [still(60), swinging(60, 1)]}) == 0


def test_prompts_that_do_something_are_told_apart_and_others_are_not():
    sizes = {"calm": 0.1, "excited": 0.6}
    made = [
        (prompt, f"s{i}", swinging(270, i + 100 * (prompt == "calm"), size))
        for prompt, size in sizes.items()
        for i in range(6)
    ]
    assert d.separability(made) > 0.9
    rng = np.random.default_rng(0)
    mute = [(prompt, speech, swinging(270, int(rng.integers(1e6)))) for prompt, speech, _ in made]
    assert d.separability(mute) < 0.75
    with pytest.raises(ValueError, match="two prompts"):
        d.separability(made[:6])
