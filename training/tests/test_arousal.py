"""The reference of a voice's arousal, and the values that the core is held to."""

from pathlib import Path

import numpy as np
import pytest

from umo_train.speech import arousal

GOLDEN = Path(__file__).parents[2] / "umo-core/base/src/arousal/golden.txt"


def test_the_core_is_held_to_these_values() -> None:
    np.testing.assert_allclose(arousal.arousal(arousal.voice()), np.loadtxt(GOLDEN), atol=2e-5)


@pytest.mark.parametrize("hertz", [90.0, 180.0, 320.0])
def test_a_tone_has_its_pitch_and_noise_has_none(hertz: float) -> None:
    at = np.arange(arousal.RATE) / arousal.RATE
    tone = sum(np.sin(2 * np.pi * k * hertz * at) / k for k in range(1, 6))
    _, _, semitones, harmonicity = arousal.steps(0.1 * tone)[10:].T
    np.testing.assert_allclose(semitones, 12 * np.log2(hertz / 100), atol=0.3)
    assert harmonicity.min() > 0.9
    noise = np.random.default_rng(0).normal(0, 0.1, arousal.RATE)
    assert np.median(arousal.steps(noise)[10:, 3]) < arousal.VOICED


def test_a_gain_changes_nothing() -> None:
    voice = arousal.voice()
    np.testing.assert_allclose(arousal.arousal(0.3 * voice), arousal.arousal(voice), atol=0.05)
