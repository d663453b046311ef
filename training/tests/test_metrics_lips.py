import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from metrics_motion import still
from umo_train.metrics import lips
from umo_train.performer.lips import lip_opening
from umo_train.skeleton import SHAPE, rotation_6d
from umo_train.speech.utterance import SAMPLE_RATE, Phone


def face(frames: int, **shapes: np.ndarray | float) -> np.ndarray:
    out = still(frames)["face"]
    for name, value in shapes.items():
        out[:, 6 + SHAPE[name]] = value
    return out


def test_lips_open_with_the_jaw_and_shut_with_mouth_close():
    assert lip_opening(face(2))[0] == 0
    assert lip_opening(face(2, jawOpen=0.8))[0] > 0.4
    assert lip_opening(face(2, jawOpen=0.5, mouthClose=0.5))[0] < lips.CLOSED


def test_jaw_opening_is_its_angle():
    motion = face(4)
    motion[:, :6] = rotation_6d(Rotation.from_euler("x", [[0], [0.1], [0.2], [-0.1]]).as_matrix())
    assert lips.jaw_opening(motion) == pytest.approx([0, 0.1, 0.2, -0.1], abs=1e-6)


def test_correlation_of_a_constant_is_none():
    ramp = np.arange(50.0)
    assert lips.pearson(ramp, 3 * ramp + 1) == pytest.approx(1)
    assert lips.pearson(ramp, -ramp) == pytest.approx(-1)
    assert lips.pearson(ramp, np.full(50, 0.7)) == 0


def test_closures_count_within_one_frame_only():
    phones = [Phone("p", 1.0, 1.1), Phone("aa", 1.1, 1.5), Phone("m", 2.0, 2.1), Phone("b", 3.0, 3.1)]
    opening = np.full(120, 0.4)
    opening[31] = 0.0
    opening[64] = 0.0  # m ends in frame 63: one frame late counts
    opening[95] = 0.0  # b ends in frame 93: two frames late does not
    assert lips.closures(opening, phones).tolist() == [True, True, False]
    assert not lips.closures(np.full(120, 0.4), phones).any()
    assert lips.closures(np.zeros(120), phones).all()


def test_pauses_are_still_only_if_nothing_moves_in_them():
    phones = [
        Phone("pau", 0.0, 0.5),
        Phone("pau", 0.5, 1.0),
        Phone("aa", 1.0, 2.0),
        Phone("pau", 2.0, 2.3),
        Phone("pau", 3.0, 3.5),
    ]
    quiet = lips.silences(phones)
    assert quiet == [(0.0, 1.0), (2.0, 2.3), (3.0, 3.5)]
    opening = np.zeros(120)
    opening[30:60] = 0.5
    assert lips.pauses(opening, quiet).tolist() == [True, True]
    opening[97] = 0.3
    assert lips.pauses(opening, quiet).tolist() == [True, False]


def syllables(seed: int, seconds: int = 8) -> np.ndarray:
    """Noise with a loudness that varies about four times a second."""
    rng = np.random.default_rng(seed)
    knots = rng.uniform(0, 1, seconds * 8)
    level = np.interp(np.arange(seconds * SAMPLE_RATE) / SAMPLE_RATE * 8, np.arange(len(knots)), knots)
    return (level * rng.normal(size=len(level)) * 0.1).astype(np.float32)


def test_the_envelope_follows_the_level():
    samples = np.concatenate([np.zeros(SAMPLE_RATE), np.full(SAMPLE_RATE, 0.5)])
    sound = lips.envelope(samples, 60)
    assert sound[:25].max() < 0.01 and sound[35:55] == pytest.approx(0.5, abs=0.01)
    assert lips.quiet_parts(samples) == [pytest.approx((0.0, 1.0), abs=0.15)]


@pytest.mark.parametrize("late", [-2, 0, 2])
def test_the_best_lag_is_that_of_the_mouth(late):
    pairs = []
    for seed in range(3):
        sound = lips.envelope(syllables(seed), 240)
        pairs.append((np.roll(sound, late) * 3, sound * 10.0**seed))
    found = lips.lag_correlation(pairs)
    assert max(found, key=found.get) == late
    assert found[late] > 0.99
    assert late == 0 or found[-late] < 0.9


def test_a_mouth_of_another_sentence_does_not_follow():
    pairs = [(lips.envelope(syllables(seed + 10), 240), lips.envelope(syllables(seed), 240)) for seed in range(4)]
    assert max(lips.lag_correlation(pairs).values()) < 0.3
    assert max(lips.lag_correlation([(np.full(240, 0.3), pairs[0][1])]).values()) == 0
