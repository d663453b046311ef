"""Training of the motion tokenizers: codes between keyframes, the loss, and continuing from a checkpoint."""

from pathlib import Path

import numpy as np
import pytest
import torch

from umo_train.motion import train
from umo_train.motion.channels import weights
from umo_train.motion.train import TokenizerPlan
from umo_train.skeleton import ARKIT, CHANNELS

PLAN = TokenizerPlan(width=6, layers=2, codes=16, steps=40, stride=3, batch=4, frames=24, rate=3e-3)


@pytest.mark.parametrize("phase", [0, 1, 2])
@pytest.mark.parametrize("frames", [10, 12])
def test_between_keyframes_vectors_are_mixed_linearly(phase: int, frames: int) -> None:
    vectors = torch.randn(2, frames, 3, dtype=torch.float64)
    kept = np.arange(phase, frames, 3)
    # numpy repeats the first and the last value beyond them, as does the mix.
    expected = np.stack(
        [[np.interp(np.arange(frames), kept, row[kept, c]) for c in range(3)] for row in vectors.numpy()]
    ).transpose(0, 2, 1)
    np.testing.assert_allclose(train._between(vectors, 3, phase).numpy(), expected, atol=1e-7)


def _motions(count: int = 5) -> list[np.ndarray]:
    """Waves of different speeds: 78 channels with few degrees of freedom."""
    random = np.random.default_rng(0)
    mix = random.standard_normal((4, CHANNELS["upper"]))
    time = np.arange(80)[:, None]
    out = []
    for _ in range(count):
        waves = np.sin(time * random.uniform(0.05, 0.4, 4) + random.uniform(0, 6, 4))
        out.append((waves @ mix * 0.3 + 0.5).astype(np.float32))
    return out


class _Stop(Exception):
    pass


def _stopping(monkeypatch: pytest.MonkeyPatch, after: int) -> None:
    add = train.Log.add

    def stop(log: train.Log, step: int, values: dict[str, float]) -> None:
        if step == after:
            raise _Stop
        add(log, step, values)

    monkeypatch.setattr(train.Log, "add", stop)


def _same(one: torch.nn.Module, other: torch.nn.Module) -> bool:
    pairs = zip(one.state_dict().values(), other.state_dict().values(), strict=True)
    return all(torch.equal(a, b) for a, b in pairs)


def test_a_resumed_tokenizer_ends_where_an_uninterrupted_one_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(train, "SAVE_EVERY", 15)
    whole = train.train_part(PLAN, "upper", _motions(), tmp_path / "whole")
    with monkeypatch.context() as patch:
        _stopping(patch, 20)
        with pytest.raises(_Stop):
            train.train_part(PLAN, "upper", _motions(), tmp_path / "parts")
    assert torch.load(tmp_path / "parts" / "tokenizer_upper.pt", weights_only=True)["step"] == 15
    # Whatever random numbers were drawn in between.
    torch.manual_seed(123)
    resumed = train.train_part(PLAN, "upper", _motions(), tmp_path / "parts")
    assert _same(whole, resumed)
    logs = [(tmp_path / name / "tokenizer_upper.csv").read_text().splitlines() for name in ("whole", "parts")]
    assert logs[0][-1] == logs[1][-1] and logs[0][-1].startswith("39,")


def test_a_resumed_root_network_ends_where_an_uninterrupted_one_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(train, "SAVE_EVERY", 4)
    random = np.random.default_rng(1)
    motions = [(random.standard_normal((60, 61)).astype(np.float32), np.ones(60, np.float32)) for _ in range(3)]
    plan = TokenizerPlan(width=4, layers=4, codes=8, steps=9, stride=3, batch=2, frames=24)
    whole = train.train_root(plan, motions, tmp_path / "whole")
    with monkeypatch.context() as patch:
        _stopping(patch, 6)
        with pytest.raises(_Stop):
            train.train_root(plan, motions, tmp_path / "parts")
    assert _same(whole, train.train_root(plan, motions, tmp_path / "parts"))


def test_a_tokenizer_learns(tmp_path: Path) -> None:
    plan = TokenizerPlan(width=12, layers=2, codes=32, steps=150, stride=3, batch=4, frames=24, rate=5e-3)
    motions = _motions(12)
    model = train.train_part(plan, "upper", motions, tmp_path)
    codes = train.tokenize(model, motions[0])
    assert codes.shape == (80,) and codes.dtype == np.int16
    with torch.no_grad():
        again = model.motion(torch.from_numpy(codes.astype(np.int64))[None])[0].numpy()
    spread = np.square(motions[0] - np.mean(motions[0], 0)).mean()
    assert np.square(again - motions[0]).mean() < 0.5 * spread


def test_checkpoints_without_draws_are_read(tmp_path: Path) -> None:
    """Checkpoints from before random states were stored."""
    model = train.train_part(PLAN, "upper", _motions(), tmp_path)
    path = tmp_path / "tokenizer_upper.pt"
    data = torch.load(path, weights_only=True)
    del data["chance"]
    torch.save(data, path)
    assert _same(model, train.train_part(PLAN, "upper", _motions(), tmp_path))


def test_weights_put_the_mouth_first() -> None:
    face = weights("face", CHANNELS["face"])
    assert face[6:].argmax() == ARKIT.index("jawOpen") or face[6:].argmax() == ARKIT.index("mouthClose")
    assert face[6 + ARKIT.index("jawOpen")] > face[6 + ARKIT.index("browInnerUp")]
    assert (weights("face", 106) == 1).all()
