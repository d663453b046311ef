"""Continuing from a model file: int8 weights with their scales, and networks that reproduce the file's outputs."""

import json
from pathlib import Path

import pytest
import torch
import yaml
from safetensors.torch import load_file, save_file

from umo_train.audio.listener import Listener
from umo_train.audio.tokens import PUBLISHED
from umo_train.frames import parts, published
from umo_train.frames.model import FrameModel, for_file
from umo_train.frames.networks import ResidualVqVae
from umo_train.frames.root import RootPlan
from umo_train.skeleton import ARKIT

ROOT = Path(__file__).parents[2]
MODEL = ROOT / "models/umo-people/model.safetensors"
PLAN = yaml.safe_load((ROOT / "training/configs/frames.yaml").read_text())
PARTS = parts.read(PLAN, list(ARKIT))
SIZES = RootPlan(**PLAN["tokenizers"]["root"])


def _file(path: Path, config: dict[str, object], tensors: dict[str, torch.Tensor]) -> Path:
    save_file(tensors, path, metadata={"format": "umo", "config": json.dumps(config)})
    return path


def test_int8_weights_are_multiplied_by_their_rows_scales(tmp_path: Path) -> None:
    weight = torch.tensor([[[1, -2]], [[127, 3]]], dtype=torch.int8)
    given = {"a.weight": weight, "a.weight.scale": torch.tensor([0.5, 2.0]), "b.scale": torch.ones(2)}
    path = _file(tmp_path / "m.safetensors", {"layout": "frames"}, given | {"text": torch.zeros(3, dtype=torch.uint8)})
    _, found = published.read(path)
    assert set(found) == {"a.weight", "b.scale"}
    assert found["a.weight"].tolist() == [[[0.5, -1.0]], [[254.0, 6.0]]]


def test_other_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="another layout"):
        published.read(_file(tmp_path / "m.safetensors", {"layout": "parts"}, {"a": torch.ones(1)}))
    save_file({"a": torch.ones(1)}, tmp_path / "other.safetensors")
    with pytest.raises(ValueError, match="not a umo model"):
        published.read(tmp_path / "other.safetensors")


def test_tokenizers_and_listener_are_those_of_the_file(tmp_path: Path) -> None:
    published.start(MODEL, tmp_path, PARTS, list(ARKIT), SIZES)
    _, tensors = published.read(MODEL)
    for part in (part for part in PARTS if part.moves):
        model = ResidualVqVae(part, len(parts.columns(part, list(ARKIT))[1]))
        model.load_state_dict(torch.load(tmp_path / f"tokenizer_{part.name}.pt", weights_only=True)["model"])
        for name, tensor in model.folded().items():
            torch.testing.assert_close(tensor, tensors[f"vq.{part.name}.{name}"])
    assert (tmp_path / "interp.pt").exists() and (tmp_path / "tokenizer_root.pt").exists()
    heard = Listener.of(load_file(tmp_path / PUBLISHED))
    for name, tensor in heard.tensors().items():
        torch.testing.assert_close(tensor, tensors[name])


def test_parts_of_other_sizes_are_refused(tmp_path: Path) -> None:
    fewer = [part if part.name != "mouth" else parts.read(_with_levels(3), list(ARKIT))[i]
             for i, part in enumerate(PARTS)]  # fmt: skip
    with pytest.raises(ValueError, match="`mouth`"):
        published.start(MODEL, tmp_path, fewer, list(ARKIT), SIZES)


def _with_levels(levels: int) -> dict[str, object]:
    changed = [entry | ({"levels": levels} if entry["name"] == "mouth" else {}) for entry in PLAN["parts"]]
    return PLAN | {"parts": changed}


def test_a_listener_takes_a_smaller_ones_weights() -> None:
    torch.manual_seed(0)
    before = Listener(6, 1, [5, 3], {"kernel": 3, "count": 1})
    after = Listener(6, 1, [5, 4], {"kernel": 3, "count": 2})
    after.take(before)
    rows, silence = torch.randn(9, 6), torch.randn(1, 6)
    torch.testing.assert_close(after.heard(rows, silence)[:, :3], before.heard(rows, silence))
    with pytest.raises(ValueError, match="sizes differ"):
        before.take(after)


def test_parts_that_are_trained_on_and_the_root_are_left_to_the_plan(tmp_path: Path) -> None:
    published.start(MODEL, tmp_path, PARTS, list(ARKIT), SIZES, ["lower"])
    assert (tmp_path / published.tokenizer("lower")).exists()
    assert not (tmp_path / "tokenizer_lower.pt").exists() and not (tmp_path / "tokenizer_root.pt").exists()
    assert (tmp_path / "tokenizer_torso.pt").exists()


def test_a_language_model_goes_on_from_the_file() -> None:
    config, tensors = published.read(MODEL)
    model = FrameModel(config, PARTS, marked=True)
    model.load_state_dict(published.language_model(MODEL))
    for name, tensor in for_file(model.state_dict()).items():
        torch.testing.assert_close(tensor, tensors[name if name.startswith("depth.") else f"lm.{name}"])
