"""The paper's layout as a row: examples from its packed file equal those from the run, and it trains."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np

from test_lm_examples import CONFIG, SILENCE, _stream
from test_lm_train import LM
from umo_train import export
from umo_train.frames import ablation_parts, packed
from umo_train.frames.packed import Packed
from umo_train.frames.train import FrameStagePlan
from umo_train.lm.examples import Examples


def _packed(path: Path) -> tuple[Packed, Examples]:
    two = replace(_stream(), more_prompts=(np.array([41, 42, 43]),))
    streams = [_stream(), two, _stream(prompt=np.zeros(0, np.int64)), replace(_stream(), codes=None)]
    splits = {name: [ablation_parts._frame_stream(one) for one in streams] for name in ("train", "test_voice")}
    sizes = LM | {"d_model": 32, "d_kv": 16}
    packed.write(path, Packed(CONFIG | {"lm": sizes}, SILENCE, 4, [False, True, True, True], splits))
    return packed.read(path), Examples(CONFIG, streams, SILENCE, delay=4)


def test_what_is_drawn_of_the_packed_file_is_what_is_drawn_of_the_run(tmp_path: Path) -> None:
    data, given = _packed(tmp_path / "packed.xz")
    found = ablation_parts.examples(data, "train", augment=True)
    for text in (False, True):
        ours, theirs = (one.chunk(16, 5, np.random.default_rng(3), text=text) for one in (found, given))
        assert np.array_equal(ours.ids, theirs.ids) and np.array_equal(ours.labels, theirs.labels)
        assert np.array_equal(ours.heard, theirs.heard)


def test_it_trains_as_long_as_the_other_rows_and_says_what_it_reached(tmp_path: Path) -> None:
    data, _ = _packed(tmp_path / "packed.xz")
    like = FrameStagePlan("x", 6, 1e-3, batch=4, targets=(1, 2), heard=0.5, seed=3)
    ablation_parts.train(data, tmp_path, like)
    weights = export.load_state(tmp_path / "layout_parts.safetensors")
    assert all(tensor.isfinite().all() for tensor in weights.values())
    with (tmp_path / "lm_layout_parts.csv").open(newline="") as file:
        names = {row["name"]: int(row["step"]) for row in csv.DictReader(file)}
    assert names["held_out_loss"] == 5 and {"held_out_face", "held_out_lower"} <= set(names)
    # Trained networks are kept.
    before = (tmp_path / "layout_parts.safetensors").stat().st_mtime_ns
    ablation_parts.train(data, tmp_path, like)
    assert (tmp_path / "layout_parts.safetensors").stat().st_mtime_ns == before
