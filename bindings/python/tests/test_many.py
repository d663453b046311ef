"""Several recordings in one call."""

import numpy as np
import pytest

import umo


def test_each_has_the_frames_that_it_has_alone(hello, model):
    samples, rate = hello
    recordings = [samples[:rate], samples, samples[rate : 3 * rate], np.repeat(samples[: 2 * rate, None], 2, 1)]
    motions = umo.animate(recordings, rate, model=model, seed=[1, 2, 3, 4], mood=[None, "joy", None, None], jobs=3)
    assert [len(motion) for motion in motions] == [30, len(samples) * 30 // rate, 60, 60]
    for recording, motion, seed, mood in zip(recordings, motions, (1, 2, 3, 4), (None, "joy", None, None)):
        alone = umo.animate(recording, rate, model=model, seed=seed, mood=mood)
        np.testing.assert_array_equal(motion.rotations, alone.rotations)
        np.testing.assert_array_equal(motion.face, alone.face)


def test_lists_of_numbers_are_one_recording(hello, model):
    samples, rate = hello
    assert isinstance(umo.animate((samples[:rate] / 32768).tolist(), rate, model=model), umo.Motion)


def test_what_does_not_fit_is_said(hello, model):
    samples, rate = hello
    with pytest.raises(ValueError, match="2 values of seed: expected one, or 1"):
        umo.animate([samples], rate, model=model, seed=[1, 2])
    with pytest.raises(ValueError, match="jobs 0"):
        umo.animate([samples], rate, model=model, jobs=0)
