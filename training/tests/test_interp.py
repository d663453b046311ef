"""The interpolation network: inputs, targets, and its smoothness terms."""

import copy
from pathlib import Path

import numpy as np
import pytest
import torch

from umo_train.interp import train
from umo_train.interp.model import Interpolation
from umo_train.interp.train import InterpPlan

CODES, STRIDE = 20, 3
CONFIG = {
    "keyframe_stride": STRIDE,
    "vq": {"codes": CODES},
    "interp": {"d_model": 12, "num_heads": 2, "d_ff": 16, "temporal_layers": 2, "part_layers": 1, "max_frames": 40},
}
PLAN = InterpPlan(steps=8, frames=16, batch=6, noise=0.0)


def _model() -> Interpolation:
    torch.manual_seed(0)
    return Interpolation(CONFIG)


def _batch() -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(1)
    truth = torch.randint(0, CODES, (3, 4, 16), generator=generator)
    padding = torch.arange(16) >= torch.tensor([16, 11, 7])[:, None]
    return truth, padding


@torch.no_grad()
def test_padding_has_no_influence() -> None:
    model = _model()
    truth, padding = _batch()
    other = torch.where(padding[:, None], (truth + 3) % CODES, truth)
    before, after = model(truth, padding), model(other, padding)
    seen = ~padding[:, None].expand_as(truth)
    torch.testing.assert_close(before[seen], after[seen])
    # Without the mask it would have.
    assert not torch.allclose(model(truth)[seen], model(other)[seen])
    alone = model(truth[2:, :, :7])
    torch.testing.assert_close(before[2:, :, :7], alone, rtol=1e-4, atol=1e-5)


def test_loss_ignores_padding_and_asks_what_is_masked() -> None:
    model = _model()
    truth, padding = _batch()
    changed = torch.where(padding[:, None], (truth + 3) % CODES, truth)
    loss, values = train.loss_of(model, PLAN, truth, padding, np.random.default_rng(0))
    again, _ = train.loss_of(model, PLAN, changed, padding, np.random.default_rng(0))
    assert loss.item() == pytest.approx(again.item(), rel=1e-5)

    # By hand: keyframes and each item's last frame are given, the rest are targets.
    seen, total, count = truth.clone(), 0.0, 0
    asked = []
    for item, length in enumerate((16, 11, 7)):
        for frame in range(length):
            if frame % STRIDE and frame != length - 1:
                seen[item, :, frame] = CODES
                asked.append((item, frame))
    logits = model(torch.where(padding[:, None], truth.new_tensor(CODES), seen), padding).log_softmax(-1)
    for item, frame in asked:
        for part in range(4):
            row = logits[item, part, frame]
            total += 0.9 * -row[truth[item, part, frame]] + 0.1 * -row.mean()
            count += 1
    assert values["entropy"] == pytest.approx((total / count).item(), rel=1e-4)


def test_smoothness_by_hand_skips_padding() -> None:
    model = _model()
    truth, padding = _batch()
    velocity, acceleration = train._smoothness(model, truth, ~padding)
    first, second = [], []
    for i, part in enumerate(("face", "hands", "upper", "lower")):
        steps, turns = [], []
        for item, length in enumerate((16, 11, 7)):
            vectors = model.embed[part].weight.detach().numpy()[truth[item, i, :length].numpy()]
            steps.append(np.diff(vectors, axis=0))
            turns.append(np.diff(vectors, n=2, axis=0))
        first.append(np.square(np.concatenate(steps)).mean())
        second.append(np.square(np.concatenate(turns)).mean())
    assert velocity.item() == pytest.approx(np.mean(first), rel=1e-4)
    assert acceleration.item() == pytest.approx(np.mean(second), rel=1e-4)


def test_smoothness_pulls_neighbouring_codes_together() -> None:
    model = _model()
    truth, padding = _batch()
    distance, _ = train._smoothness(model, truth, ~padding)
    distance.backward()
    with torch.no_grad():
        for table in model.embed.values():
            table.weight -= 1.0 * table.weight.grad
    assert train._smoothness(model, truth, ~padding)[0] < distance


def test_noise_changes_anchors_alone() -> None:
    """Targets stay the truth: the loss sees noise everywhere."""
    model = _model()
    truth, padding = _batch()
    seen = []
    forward = model.forward
    model.forward = lambda codes, pad=None: seen.append(codes) or forward(codes, pad)
    noisy = InterpPlan(steps=1, frames=16, noise=0.5)
    train.loss_of(model, noisy, truth, padding, np.random.default_rng(0))
    train.loss_of(model, PLAN, truth, padding, np.random.default_rng(0))
    assert torch.equal(seen[0] == CODES, seen[1] == CODES)
    changed = (seen[0] != seen[1])[seen[1] != CODES].float().mean()
    assert 0.3 < changed < 0.65


def test_anchors_are_untouched_and_everything_else_is_filled() -> None:
    model = _model().eval()
    codes = np.random.default_rng(0).integers(0, CODES, (4, 13))
    masked = codes.copy()
    masked[:, np.arange(13) % STRIDE != 0] = CODES
    out = train.fill(model, masked)
    assert (out[:, ::STRIDE] == codes[:, ::STRIDE]).all() and out.max() < CODES
    logits = model(torch.from_numpy(masked)[None])[0]
    hidden = masked == CODES
    assert (out[hidden] == logits.argmax(-1).numpy()[hidden]).all()


def test_windows_begin_at_keyframes() -> None:
    plan = InterpPlan(steps=1, frames=16, batch=200)
    codes = [np.tile(np.arange(n), (4, 1)) for n in (12, 50)]
    windows, padding = train._windows(plan, codes, STRIDE, np.random.default_rng(0))
    lengths = (~padding).sum(1)
    assert lengths.min() == plan.shortest * STRIDE and lengths.max() == 16
    for window, length in zip(windows, lengths.tolist(), strict=True):
        assert window[0, 0] % STRIDE == 0 and (window[:, :length].diff() == 1).all()
    assert windows.max() == 49


class _Stop(Exception):
    pass


def test_a_resumed_network_ends_where_an_uninterrupted_one_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(train, "SAVE_EVERY", 3)
    codes = [np.random.default_rng(2).integers(0, CODES, (4, 40))]
    whole = copy.deepcopy(train.train(PLAN, CONFIG, codes, tmp_path / "whole").state_dict())
    with monkeypatch.context() as patch:

        def stop(log: train.Log, step: int, values: dict[str, float]) -> None:
            if step == 4:
                raise _Stop

        patch.setattr(train.Log, "add", stop)
        with pytest.raises(_Stop):
            train.train(PLAN, CONFIG, codes, tmp_path / "parts")
    resumed = train.train(PLAN, CONFIG, codes, tmp_path / "parts").state_dict()
    assert all(torch.equal(whole[name], resumed[name]) for name in whole)


def _circle() -> tuple[Interpolation, dict[str, torch.Tensor]]:
    """A network that knows codes on a circle: the code between two others is the one nearest to their mean."""
    sizes = {"d_model": 64, "num_heads": 4, "d_ff": 32, "temporal_layers": 2, "part_layers": 1, "max_frames": 40}
    torch.manual_seed(0)
    model = Interpolation(CONFIG | {"interp": sizes}).eval()
    turns = torch.arange(CODES) * (2 * np.pi / CODES)
    books = {part: torch.stack([turns.cos(), turns.sin()], 1) for part in model.embed}
    model.know(books)
    return model, books


@torch.no_grad()
def test_an_untrained_network_that_knows_the_codes_interpolates() -> None:
    """Keyframes two codes apart: the frames in between go from one to the next."""
    model, _ = _circle()
    keys = np.arange(0, 10, 2)
    codes = np.full((4, 13), CODES)
    codes[:, ::STRIDE] = keys
    out = train.fill(model, codes)
    # The other layers add a little.
    off = np.array([out[:, at] - keys[at // STRIDE] - at % STRIDE * 2 / 3 for at in range(13) if at % STRIDE])
    assert np.abs(off).max() < 2 and np.abs(off.mean()) < 0.3
    held = np.array([3, 7, 11, 15])[:, None]
    codes[:, ::STRIDE] = held
    assert np.abs(train.fill(model, codes) - held).max() <= 1


def test_what_is_like_the_truth_costs_less() -> None:
    model, books = _circle()
    alike = train.likeness(books, 0.1)
    torch.testing.assert_close(alike.sum(-1), torch.ones(4, CODES))
    assert alike[0, 5, 5] > alike[0, 5, 6] > alike[0, 5, 7] and alike[0, 5, 6] == pytest.approx(float(alike[0, 5, 4]))
    plan = InterpPlan(steps=1, frames=16, noise=0.0, smoothing=0.5, near=0.1)
    truth, padding = _batch()

    def loss(by: int) -> float:
        """For a network that confidently predicts the code `by` further on, in every part."""
        rows = torch.nn.functional.one_hot((truth + by) % CODES, CODES).float() * 20
        model.forward = lambda codes, padding=None: rows
        return train.loss_of(model, plan, truth, padding, np.random.default_rng(0), alike)[0].item()

    assert loss(0) < loss(1) < loss(2) < loss(5)


def test_near_needs_the_vectors(tmp_path: Path) -> None:
    plan = InterpPlan(steps=1, frames=16, near=0.1)
    with pytest.raises(ValueError, match="code vectors"):
        train.train(plan, CONFIG, [np.zeros((4, 20), np.int64)], tmp_path)
