"""Training of layout `frames`: the weight of each code, the loss computed by hand, and continuing from a checkpoint."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from frames_data import BODY, CONFIG, PARTS, SLOTS, at, codes
from test_frames_examples import SILENCE, _stream
from umo_train.frames import train
from umo_train.frames.examples import FrameExamples
from umo_train.frames.model import FrameModel
from umo_train.frames.train import FrameStagePlan

PLAN = FrameStagePlan("stage", 7, 1e-2, {"a2m": 4.0, "t2m": 1.0}, batch=4, targets=(1, 2), warmup=2, save_every=4)


def test_later_levels_count_less_and_what_changes_counts_more() -> None:
    plan = replace(PLAN, level_weight=0.5, change_weight=3.0)
    said, before = codes(1, 3), codes(1, seed=1)[:, :]
    upper = at("upper")
    # The part's first code: as before the chunk, another, the same again.
    before[0, upper.start] = 2
    said[0, :, upper.start] = torch.tensor([2, 5, 5])
    # A change in later levels only is not another motion.
    said[0, 2, upper.start + 1] = (said[0, 1, upper.start + 1] + 1) % 7
    weight = train.code_weights(PARTS, plan, said, before)[0, :, upper]
    torch.testing.assert_close(weight[0], torch.tensor([1.0, 0.5, 0.25, 0.125]))
    torch.testing.assert_close(weight[1], torch.tensor([3.0, 1.5, 0.75, 0.375]))
    torch.testing.assert_close(weight[2], weight[0])
    even = train.code_weights(PARTS, replace(plan, level_weight=1.0, change_weight=1.0), said, before)
    assert (even == 1).all()


def test_what_is_not_known_counts_nothing_and_makes_no_change() -> None:
    said, before = codes(1, 2), codes(1, seed=1)
    said[0, 1, at("mouth")] = -1
    before[0, at("upper")] = -1
    weight = train.code_weights(PARTS, PLAN, said, before)[0]
    assert (weight[1, at("mouth")] == 0).all()
    assert weight[0, at("upper")].tolist() == pytest.approx([0.7**i for i in range(4)])


def test_the_loss_by_hand() -> None:
    said = codes(2, 3)
    said[1, 2] = -1
    weight = torch.rand(2, 3, SLOTS) * (said >= 0)
    generator = torch.Generator().manual_seed(0)
    logits = {part.name: torch.randn(6, part.levels, part.codes, generator=generator) for part in PARTS}
    total = count = 0.0
    for row in range(6):
        for part in PARTS:
            for level in range(part.levels):
                slot = at(part.name).start + level
                code = int(said.view(6, -1)[row, slot])
                if code >= 0:
                    w = float(weight.view(6, -1)[row, slot])
                    total -= w * float(logits[part.name][row, level].log_softmax(-1)[code])
                    count += w
    assert train.entropy(PARTS, logits, said, weight).item() == pytest.approx(total / count, rel=1e-4)


class _Stop(Exception):
    pass


def _examples() -> FrameExamples:
    return FrameExamples(CONFIG, PARTS, BODY, [_stream(), _stream(frames=45)], SILENCE)


def _trained(
    folder: Path, monkeypatch: pytest.MonkeyPatch, plan: FrameStagePlan, stop: int | None = None
) -> FrameModel:
    torch.manual_seed(0)
    model = FrameModel(CONFIG, PARTS)
    if stop is None:
        return train.train_stage(plan, model, _examples(), _examples(), folder)
    add = train.Log.add

    def stopping(log: train.Log, step: int, values: dict[str, float]) -> None:
        if step == stop:
            raise _Stop
        add(log, step, values)

    with monkeypatch.context() as patch:
        patch.setattr(train.Log, "add", stopping)
        with pytest.raises(_Stop):
            train.train_stage(plan, model, _examples(), _examples(), folder)
    return model


def test_a_resumed_stage_ends_where_an_uninterrupted_one_does(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plan = replace(PLAN, heard=0.5)
    whole = _trained(tmp_path / "whole", monkeypatch, plan)
    _trained(tmp_path / "parts", monkeypatch, plan, stop=5)
    resumed = _trained(tmp_path / "parts", monkeypatch, plan)
    for (name, one), other in zip(whole.named_parameters(), resumed.parameters(), strict=True):
        assert torch.equal(one, other), name
    with (tmp_path / "whole" / "lm_stage.csv").open(newline="") as file:
        found = {row["name"] for row in csv.DictReader(file)}
    assert {"held_out_upper", "held_out_copied_upper", "held_out_intent", "held_out_loss", "top1_layer0"} <= found


def test_a_piece_ends_with_a_checkpoint_from_which_the_next_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = _trained(tmp_path / "whole", monkeypatch, PLAN)
    done = 0
    while done < PLAN.steps:
        torch.manual_seed(0)
        model = FrameModel(CONFIG, PARTS)
        try:
            # Its time is always used up: a piece is one step.
            train.train_stage(PLAN, model, _examples(), _examples(), tmp_path / "parts", until=0.0)
        except train.Interrupted as over:
            done += 1
            assert f"after {done} of {PLAN.steps} steps" in str(over)
        else:
            break
    assert done == PLAN.steps
    for (name, one), other in zip(whole.named_parameters(), model.parameters(), strict=True):
        assert torch.equal(one, other), name


def test_training_lowers_the_loss(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Keyframes of these streams count up, so the next one is predictable."""
    plan = replace(PLAN, steps=80, batch=8, targets=(5,), tasks={"a2m": 1.0}, rate=5e-3, bf16=False, save_every=1000)
    examples = FrameExamples(CONFIG, PARTS, BODY, [_stream()], SILENCE, augment=False)
    torch.manual_seed(0)
    model = FrameModel(CONFIG, PARTS)
    before = train.evaluate(model, examples, plan, 2)
    after = train.evaluate(train.train_stage(plan, model, examples, examples, tmp_path), examples, plan, 2)
    assert after["loss"] < 0.5 * before["loss"]
    assert after["copied_intent"] < 0.1


def test_every_weight_is_trained() -> None:
    """Every table, head and layer contributes to the loss."""
    torch.manual_seed(0)
    model = FrameModel(CONFIG, PARTS)
    rng = np.random.default_rng(0)
    device = torch.device("cpu")
    for task in ("a2m", "t2m"):
        batch = _examples().chunk(16, 2, rng, task=task)
        ids, history, said, mask = train.inputs(batch, device)
        logits, _ = model(ids, history, said, mask, train.places_of(batch, device))
        weight = train.code_weights(PARTS, PLAN, said, torch.from_numpy(batch.before))
        train.entropy(PARTS, logits, said, weight).backward()
    untouched = [name for name, p in model.named_parameters() if p.grad is None or not p.grad.any()]
    # No code follows a keyframe's last one.
    assert untouched == ["depth.embed.eyes.weight"]
