import numpy as np
import pytest
import torch

from metrics_motion import swinging
from umo_train.metrics import fgd as f


@pytest.fixture(scope="module")
def model() -> f.AutoEncoder:
    torch.set_num_threads(1)
    return f.train_autoencoder([swinging(200, seed) for seed in range(10)], seed=3, epochs=10)


def test_distance_of_normal_distributions_is_the_formula():
    rng = np.random.default_rng(0)
    # |m|^2 + sum (s_a - s_b)^2 for independent channels.
    a = rng.normal(size=(200_000, 3)) * [1, 2, 3]
    b = rng.normal(size=(200_000, 3)) * [2, 2, 1] + [1, 0, 2]
    assert f.frechet(a, b) == pytest.approx(5 + 1 + 4, rel=0.02)
    assert f.frechet(a, a) == pytest.approx(0, abs=1e-9)


def test_distance_stays_finite_where_covariances_are_singular():
    rng = np.random.default_rng(0)
    few = rng.normal(size=(5, 40))
    assert f.frechet(few, few) == pytest.approx(0, abs=1e-6)
    assert f.frechet(few, few + 1) == pytest.approx(40, rel=1e-4)
    with pytest.raises(ValueError, match="two rows"):
        f.frechet(few[:1], few)


def test_windows_overlap_and_leave_short_motion_out():
    assert f.windows([swinging(f.WINDOW + 2 * f.HOP, 0), swinging(10, 1)]).shape == (3, f.WINDOW, 312)
    with pytest.raises(ValueError, match="34 frames"):
        f.windows([swinging(10, 1)])


def test_training_reconstructs_better_than_the_mean(model):
    x = torch.from_numpy(f.windows([swinging(200, 2)]))
    with torch.no_grad():
        features, made = model(x)
        target = model.normal(x)
    assert features.shape == (len(x), f.FEATURES)
    assert (made - target).square().mean() < 0.75 * target.square().mean()


def test_kindred_motion_is_nearer_than_wilder_and_shuffled_motion(model):
    reference = [swinging(200, seed) for seed in range(100, 130)]
    others = [swinging(200, seed) for seed in range(200, 230)]
    rng = np.random.default_rng(0)
    same = f.fgd(model, others, reference)
    mixed = f.fgd(model, [f.shuffled(motion, rng, 10) for motion in others], reference)
    wild = f.fgd(model, [swinging(200, seed, 0.9) for seed in range(200, 230)], reference)
    assert 1.5 * same < mixed < 0.1 * wild


def test_shuffling_keeps_frames_and_changes_their_order():
    motion = swinging(100, 0)
    mixed = f.shuffled(motion, np.random.default_rng(0))
    assert {row.tobytes() for row in mixed["upper"]} == {row.tobytes() for row in motion["upper"]}
    assert not np.array_equal(mixed["upper"], motion["upper"])


def test_a_model_comes_back_from_its_file(model, tmp_path):
    model.save(tmp_path / "ae.safetensors")
    again = f.AutoEncoder.load(tmp_path / "ae.safetensors")
    motions = [swinging(100, 0)]
    assert again.parts == model.parts and np.array_equal(again.features(motions), model.features(motions))
    torch.manual_seed(0)
    with pytest.raises(ValueError, match="not a motion auto-encoder"):
        from safetensors.torch import save_file

        save_file({"mean": torch.zeros(3)}, tmp_path / "other.safetensors")
        f.AutoEncoder.load(tmp_path / "other.safetensors")


def test_the_package_has_a_judge():
    judge = f.AutoEncoder.load(f.JUDGE)
    reference = [swinging(200, seed) for seed in range(8)]
    near = f.fgd(judge, [swinging(200, seed) for seed in range(8, 16)], reference)
    wild = f.fgd(judge, [swinging(200, seed, 0.9) for seed in range(8, 16)], reference)
    assert judge.parts == f.BODY
    assert 0 < near < wild
