"""Interpolation of vectors between keyframes: comparison with the golden reference, targets, and learning."""

from pathlib import Path

import numpy as np
import pytest
import torch

import frames as reference
from frames_data import CONFIG, FACE, PARTS, SLOTS, codes
from umo_train.frames import interp, parts
from umo_train.frames.interp import VectorInterpolation, VectorPlan
from umo_train.frames.networks import ResidualVqVae

MOVING = [part for part in PARTS if part.moves]
PLAN = VectorPlan(steps=12, frames=20, batch=4)


def _model(*, fresh: bool = False) -> VectorInterpolation:
    torch.manual_seed(0)
    model = VectorInterpolation(CONFIG, PARTS).eval()
    if not fresh:
        for head in model.head.values():
            torch.nn.init.normal_(head.weight, std=0.3)
    return model


def _books() -> dict[str, ResidualVqVae]:
    torch.manual_seed(1)
    return {part.name: ResidualVqVae(part, len(parts.columns(part, FACE)[1])).eval() for part in MOVING}


def _vectors(batch: int, frames: int) -> dict[str, torch.Tensor]:
    return {part.name: torch.randn(batch, frames, part.width) for part in MOVING}


@torch.no_grad()
def test_it_is_the_reference() -> None:
    model, vectors = _model(), _vectors(1, 14)
    known = interp.anchors(14, 3)
    shown = {name: rows * known[:, None] for name, rows in vectors.items()}
    state = {f"interp.{name}": tensor for name, tensor in model.state_dict().items()}
    wanted = reference.VectorInterpolation(CONFIG, state)({name: rows[0] for name, rows in shown.items()}, known)
    found = model(shown, known)
    for name, rows in wanted.items():
        torch.testing.assert_close(found[name][0], rows, rtol=1e-4, atol=1e-5)


@torch.no_grad()
def test_known_frames_go_through_and_a_new_one_draws_straight_lines() -> None:
    vectors, known = _vectors(2, 14), interp.anchors(14, 3)
    assert known.nonzero()[:, 0].tolist() == [0, 3, 6, 9, 12, 13]
    hidden = {name: rows * known[:, None] for name, rows in vectors.items()}
    for fresh in (True, False):
        out = _model(fresh=fresh)(hidden, known)
        for name, rows in out.items():
            assert torch.equal(rows[:, known], vectors[name][:, known])
            at = known.nonzero()[:, 0].numpy()
            line = np.stack([np.interp(range(14), at, vectors[name][0, known, c]) for c in range(rows.shape[-1])], 1)
            straight = np.allclose(rows[0].numpy(), line, atol=1e-5)
            assert straight == fresh


def test_what_is_masked_has_no_influence() -> None:
    """The true values between keyframes are targets, not inputs."""
    model, truth, books = _model(), _vectors(2, 14), _books()
    seen = []
    forward = model.forward
    model.forward = lambda vectors, known: seen.append((vectors, known)) or forward(vectors, known)
    interp.loss_of(model, PLAN, truth, books)
    vectors, known = seen[0]
    for name, rows in vectors.items():
        assert (rows[:, ~known] == 0).all() and torch.equal(rows[:, known], truth[name][:, known])


def test_errors_by_hand() -> None:
    random = np.random.default_rng(0)
    y, x = random.standard_normal((2, 3, 7, 4))
    weight = np.array([1.0, 2.0, 0.0, 0.5])
    plan = VectorPlan(steps=1, frames=7, velocity=3.0, acceleration=5.0)
    total, terms = interp.errors(*(torch.from_numpy(v) for v in (y, x, weight)), plan)
    wanted = [(weight * np.diff(y - x, n=n, axis=1) ** 2).sum(-1).mean() for n in range(3)]
    assert terms == pytest.approx(wanted)
    assert total.item() == pytest.approx(wanted[0] + 3 * wanted[1] + 5 * wanted[2])


def test_the_loss_is_of_vectors_and_of_what_they_decode_to() -> None:
    model, truth, books = _model(), _vectors(2, 14), _books()
    both, values = interp.loss_of(model, PLAN, truth, books)
    alone, _ = interp.loss_of(model, VectorPlan(steps=1, frames=20, decoded=0.0), truth, books)
    assert both.item() > alone.item() > 0
    assert {f"{what}_{part.name}" for what in ("vectors", "motion") for part in MOVING} == set(values)
    # Linear interpolation is exact for linear truth.
    line = {
        name: interp.straight(rows * interp.anchors(14, 3)[:, None], interp.anchors(14, 3))
        for name, rows in truth.items()
    }
    assert interp.loss_of(_model(fresh=True), PLAN, line, books)[0].item() == pytest.approx(0, abs=1e-6)


def test_windows_begin_at_keyframes() -> None:
    items = [np.tile(np.arange(n)[:, None], (1, SLOTS)) for n in (12, 50)]
    lengths = set()
    for step in range(60):
        rows = interp.windows(PLAN, items, 3, np.random.default_rng(step))
        lengths.add(rows.shape[1])
        assert (rows[:, 0] % 3 == 0).all() and (np.diff(rows, axis=1) == 1).all()
    assert min(lengths) == 6 and max(lengths) == 20


def test_vectors_are_the_sums_of_levels() -> None:
    books, said = _books(), codes(2, 5)
    found = interp.vectors_of(PARTS, books, said)
    assert set(found) == {part.name for part in MOVING}
    torch.testing.assert_close(found["hands"], books["hands"].vectors(said[..., 5:6]))


def test_it_learns_what_straight_lines_do_not_say(tmp_path: Path) -> None:
    """Codes with the period of the stride: frames between keyframes repeat, and are not on a line."""
    items = [codes(3, seed=4).numpy()[np.arange(60) % 3]]
    books = _books()
    plan = VectorPlan(steps=120, frames=20, batch=4, rate=5e-3)
    truth = interp.vectors_of(PARTS, books, torch.from_numpy(items[0][None, :16]))
    before = interp.loss_of(_model(fresh=True), plan, truth, books)[0].item()
    model = interp.train(plan, CONFIG, PARTS, items, books, tmp_path)
    after = interp.loss_of(model, plan, truth, books)[0].item()
    assert after < 0.5 * before


def test_a_resumed_network_ends_where_an_uninterrupted_one_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(interp, "SAVE_EVERY", 4)
    items = [codes(40).numpy()]

    class Stop(Exception):
        pass

    def stop(_log: object, step: int, _values: object) -> None:
        if step == 6:
            raise Stop

    whole = interp.train(PLAN, CONFIG, PARTS, items, _books(), tmp_path / "whole")
    with monkeypatch.context() as patch:
        patch.setattr(interp.Log, "add", stop)
        with pytest.raises(Stop):
            interp.train(PLAN, CONFIG, PARTS, items, _books(), tmp_path / "parts")
    resumed = interp.train(PLAN, CONFIG, PARTS, items, _books(), tmp_path / "parts")
    assert all(torch.equal(a, b) for a, b in zip(whole.parameters(), resumed.parameters(), strict=True))
