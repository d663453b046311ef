"""Logs that continue from a checkpoint, and atomic checkpoints."""

import csv
from pathlib import Path

import numpy as np
import pytest
import torch

from umo_train.log import EVERY, Log
from umo_train.state import Chance, Saved


def _rows(path: Path) -> list[tuple[int, str, float]]:
    with path.open(newline="") as file:
        return [(int(row["step"]), row["name"], float(row["value"])) for row in csv.DictReader(file)]


def test_a_log_averages_and_keeps_the_rest(tmp_path: Path) -> None:
    log = Log(tmp_path / "run" / "a.csv", 0)
    for step in range(EVERY + 2):
        log.add(step, {"loss": float(step)} | ({"rare": 5.0} if step == 3 else {}))
    assert _rows(log.path) == [(EVERY - 1, "loss", (EVERY - 1) / 2), (EVERY - 1, "rare", 5.0)]
    log.write(EVERY + 1)
    assert _rows(log.path)[2:] == [(EVERY + 1, "loss", EVERY + 0.5)]


def test_a_log_forgets_what_is_done_again(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    log = Log(path, 0)
    for step in range(3 * EVERY):
        log.add(step, {"loss": 1.0})
    log = Log(path, 2 * EVERY)
    for step in range(2 * EVERY, 3 * EVERY):
        log.add(step, {"loss": 2.0})
    assert [(step, value) for step, _, value in _rows(path)] == [(EVERY - 1, 1), (2 * EVERY - 1, 1), (3 * EVERY - 1, 2)]
    # A new run has a new log.
    Log(path, 0)
    assert _rows(path) == []


def test_checkpoints_bring_everything_back(tmp_path: Path) -> None:
    def objects() -> dict:
        model = torch.nn.Linear(3, 2)
        optimizer = torch.optim.AdamW(model.parameters(), 0.1)
        return {"model": model, "optimizer": optimizer}

    def step(model: torch.nn.Linear, optimizer: torch.optim.Optimizer) -> None:
        model(torch.ones(1, 3)).pow(2).sum().backward()
        optimizer.step()
        optimizer.zero_grad()

    one = objects()
    saved = Saved(tmp_path / "deep" / "x.pt", **one)
    assert saved.load() == 0
    step(**one)
    saved.save(1)
    other = objects()
    assert Saved(tmp_path / "deep" / "x.pt", **other).load() == 1
    # Including the optimizer's moments: one more step gives the same weights.
    step(**one)
    step(**other)
    assert torch.equal(one["model"].weight, other["model"].weight)
    assert [path.name for path in (tmp_path / "deep").iterdir()] == ["x.pt"]


def test_draws_go_on(tmp_path: Path) -> None:
    generator = np.random.default_rng(5)
    torch.manual_seed(5)
    generator.random(3), torch.rand(3)
    Saved(tmp_path / "x.pt", chance=Chance(generator)).save(1)
    expected = generator.random(4).tolist(), torch.rand(4).tolist()
    fresh = np.random.default_rng(6)
    Saved(tmp_path / "x.pt", chance=Chance(fresh)).load()
    assert (fresh.random(4).tolist(), torch.rand(4).tolist()) == expected


def test_a_checkpoint_without_what_is_asked_for_is_refused(tmp_path: Path) -> None:
    Saved(tmp_path / "x.pt", model=torch.nn.Linear(1, 1)).save(3)
    with pytest.raises(KeyError, match="optimizer"):
        Saved(tmp_path / "x.pt", optimizer=torch.nn.Linear(1, 1)).load()
