"""The stages of the language model: the mixture of tasks, the rate, and continuing from a checkpoint."""

import csv
from pathlib import Path

import numpy as np
import pytest
import torch

from test_lm_examples import CONFIG, SILENCE, _stream
from umo_train.lm import train
from umo_train.lm.examples import Examples
from umo_train.lm.model import LanguageModel
from umo_train.lm.train import StagePlan, task_chances

LM = {
    "d_model": 8,
    "d_kv": 4,
    "d_ff": 12,
    "num_heads": 2,
    "num_layers": 1,
    "num_decoder_layers": 1,
    "relative_attention_num_buckets": 8,
    "relative_attention_max_distance": 16,
    "layer_norm_epsilon": 1e-6,
    "feed_forward_proj": "gated-gelu",
    "tie_word_embeddings": False,
    "experts": 2,
    "top_k": 1,
}


def test_task_mixture_by_hand() -> None:
    tasks = {"a": 16.0, "b": 4.0, "never": 0.0}
    assert task_chances(tasks, 0.5) == pytest.approx({"a": 2 / 3, "b": 1 / 3})
    assert task_chances(tasks, 1.0) == pytest.approx({"a": 0.8, "b": 0.2})
    assert task_chances(tasks, 0.0) == pytest.approx({"a": 0.5, "b": 0.5})


def test_the_rate_warms_up_and_falls_to_its_end() -> None:
    plan = StagePlan("x", 1000, {}, 1.0, warmup=100, final_rate=0.1)
    rates = np.array([train.rate_at(step, plan) for step in range(1001)])
    assert rates[0] == pytest.approx(0.01) and rates.argmax() in range(95, 105)
    assert rates[1000] == pytest.approx(0.1) and (np.diff(rates[105:]) < 0).all()


class _Stop(Exception):
    pass


def _trained(folder: Path, monkeypatch: pytest.MonkeyPatch, *, stop_after: int | None = None) -> LanguageModel:
    plan = StagePlan(
        "stage2",
        7,
        {"a2m": 4, "part": 2, "t2a": 1},
        1e-2,
        batch=4,
        targets=(1, 2),
        warmup=2,
        save_every=4,
    )
    torch.manual_seed(0)
    model = LanguageModel(CONFIG | {"lm": LM})
    examples = Examples(CONFIG, [_stream(), _stream(frames=45)], SILENCE)
    if stop_after is not None:
        add = train.Log.add

        def stop(log: train.Log, step: int, values: dict[str, float]) -> None:
            if step == stop_after:
                raise _Stop
            add(log, step, values)

        monkeypatch.setattr(train.Log, "add", stop)
        with pytest.raises(_Stop):
            train.train_stage(plan, model, examples, examples, folder)
        monkeypatch.undo()
        return model
    return train.train_stage(plan, model, examples, examples, folder)


def test_a_resumed_stage_ends_where_an_uninterrupted_one_does(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = _trained(tmp_path / "whole", monkeypatch)
    # Stopped at step 5, after the checkpoint of step 4; the steps since then are repeated.
    stopped = _trained(tmp_path / "parts", monkeypatch, stop_after=5)
    assert not torch.equal(stopped.shared.weight, whole.shared.weight)
    resumed = _trained(tmp_path / "parts", monkeypatch)
    for (name, one), other in zip(whole.named_parameters(), resumed.parameters(), strict=True):
        assert torch.equal(one, other), name
    saved = [torch.load(tmp_path / f / "lm_stage2.pt", weights_only=True)["optimizer"] for f in ("whole", "parts")]
    assert all(torch.equal(a, b) for a, b in zip(*(s["copies"] for s in saved), strict=True))


def test_the_log_holds_a_short_stage_and_its_evaluation(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _trained(tmp_path, monkeypatch)
    with (tmp_path / "lm_stage2.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    names = {row["name"] for row in rows}
    assert {"held_out_face", "held_out_loss", "top1_layer0", "used_layer1"} <= names
    assert {row["step"] for row in rows} == {"6"}
    shares = [float(row["value"]) for row in rows if row["name"].startswith("top1_layer")]
    assert len(shares) == 2 and all(0.5 <= share <= 1 for share in shares)


def test_steps_too_small_for_bf16_add_up() -> None:
    linear = torch.nn.Linear(1, 1, bias=False).to(torch.bfloat16)
    torch.nn.init.ones_(linear.weight)
    optimizer = train.Master(linear, 1e-4, (0.9, 0.99), 0.0)
    for _ in range(100):
        linear.weight.grad = torch.ones_like(linear.weight)
        optimizer.step()
    # 1e-4 is below half of bf16's distance to the next number below 1, 2^-8.
    assert optimizer.copies[0].item() == pytest.approx(0.99, abs=1e-3)
    assert linear.weight.item() == pytest.approx(0.99, abs=4e-3) and linear.weight.item() < 1
