"""The paper's recipe from BEAT2, AMASS, LibriSpeech, HuBERT and Flan-T5 to a model file, on synthetic data."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml
from safetensors import safe_open
from safetensors.torch import load_file

import base_sources
from umo_train import pipeline
from umo_train.convert.layout import shapes
from umo_train.data import corpus
from umo_train.device import has_bf16
from umo_train.lm.model import LanguageModel
from umo_train.lm.start import from_t5
from umo_train.model_config import pieces

CONFIGS = Path(__file__).parents[1] / "configs"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A run of all steps."""
    work = tmp_path_factory.mktemp("base")
    base_sources.everything(work)
    run = pipeline.Run.read(CONFIGS / "base.yaml", work, smoke=True)
    run.plan["voices"] = [base_sources.voice(work)]
    pipeline.run(run)
    return run


def entries(made):
    return {entry.name: entry for entry in corpus.entries(made.corpus)}


def test_every_clip_is_an_item(made):
    found = entries(made)
    assert [(e.split, e.spoken) for e in found.values()] == [
        ("train", True), ("train", True), ("val", True), ("test", True),
        ("train", False), ("train", False), ("train", False), ("train", True), ("train", True),
    ]  # fmt: skip
    assert [found[f"{i:05}"].prompt for i in (4, 5, 6)] == ["", "a man walks.\nsomebody walks", "a man stops"]
    assert found["00000"].text == base_sources.SPOKEN and len(found["00000"].words) == 5
    assert found["00008"].text == "my old friend walks and stops"
    frames = {path.stem: len(corpus.read_motion(made.corpus, path.stem)["face"]) for path in
              corpus.paths(made.corpus, "motion")}  # fmt: skip
    assert frames == {"00000": 120, "00001": 120, "00002": 120, "00003": 120, "00004": 120, "00005": 60, "00006": 60}
    motion = corpus.read_motion(made.corpus, "00000")
    assert motion["face"].shape == (120, 106) and 1.0 < motion["height"].mean() < 1.4


def test_units_have_a_row_for_each_recording_and_voice(made):
    rows = {path.stem: np.load(path).shape for path in (made.folder / "audio_tokens").glob("*.npy")}
    # One clean, one recorded, and for training items with words one in another voice.
    assert rows == {
        "00000": (3, 200), "00001": (3, 200), "00002": (2, 200), "00003": (2, 200),
        "00007": (2, 100), "00008": (2, 150),
    }  # fmt: skip
    assert len(np.unique(np.load(made.folder / "audio_tokens" / "00000.npy"))) > 3


def test_faces_of_those_who_do_not_speak_are_not_learned(made):
    silent, spoken = (np.load(made.folder / "codes" / f"{name}.npy") for name in ("00005", "00000"))
    assert (silent[0] == -1).all() and (silent[1:] >= 0).all() and (spoken >= 0).all()


def test_the_file_is_what_its_config_says(made):
    path = made.folder / "umo-smoke-base.safetensors"
    with safe_open(path, "pt") as file:
        config = json.loads(file.metadata()["config"])
        found = {name: tuple(file.get_slice(name).get_shape()) for name in file.keys()}
    text = found.pop("text.tokenizer")
    assert text == (len(made.text_model()),)
    assert found == shapes(config)
    assert config["face"]["kind"] == "smplx_expression" and len(config["face"]["names"]) == 100
    assert config["vq"]["face"]["channels"] == 106 and "init" not in config["lm"]
    first = pieces(made).get_piece_size() + base_sources.EXTRA_IDS + 3
    assert config["vocab"]["face"]["first"] == first
    template = config["templates"]["audio_to_motion"]
    assert [item for item in template if isinstance(item, str)] == ["audio", "face", "hands", "upper", "lower"]
    assert pieces(made).decode([i for i in template if isinstance(i, int)][:-1]).startswith("Move to this speech")
    assert set(config["templates"]) == {"audio_to_motion", "audio_to_motion_with_text", "text_to_motion"}


def test_training_began_with_t5_and_moved(made):
    config = pipeline.model_file_config(made)
    before = from_t5(Path(made.plan["lm"]["init"]), config, dense=False, seed=made.plan["seed"])
    after = load_file(made.folder / "lm_pretrain.safetensors")
    assert before.keys() == after.keys()
    # Training starts from bf16 weights if bf16 products are fast.
    began = torch.bfloat16 if has_bf16(torch.device("cpu")) else torch.float32
    change = {name: float((after[name] - before[name].to(began)).abs().max()) for name in before}
    # At most six steps of 1e-4; routers are not trained while lambda is 0.
    assert 0 < change["shared.weight"] < 1e-3 and 0 < change["encoder.block.0.layer.0.SelfAttention.q.weight"] < 1e-3
    assert all(value == 0 for name, value in change.items() if "router" in name)
    last = load_file(made.folder / "lm_stage2.safetensors")
    moved = [name for name in last if "router" in name and not torch.equal(last[name], after[name])]
    assert moved


def test_a_dense_model_begins_with_t5_itself(made):
    config = pipeline.model_file_config(made)
    model = LanguageModel(config, dense=True).eval()
    model.load_state_dict(from_t5(Path(made.plan["lm"]["init"]), config, dense=True, seed=0))
    sparse = LanguageModel(config).eval()
    sparse.load_state_dict(from_t5(Path(made.plan["lm"]["init"]), config, dense=False, seed=0))
    ids = torch.arange(24).view(2, 12)
    with torch.no_grad():
        torch.testing.assert_close(model(ids, ids[:, :5]), sparse(ids, ids[:, :5]), rtol=1e-4, atol=1e-5)


def test_a_second_run_finds_everything_done(made):
    path = made.folder / "umo-smoke-base.safetensors"
    before = load_file(path)
    times = {
        p: p.stat().st_mtime_ns for kind in ("speech", "motion", "voices") for p in corpus.paths(made.corpus, kind)
    }
    pipeline.run(made, ("import", "voices", "audio", "tokenizers", "codes", "lm", "export"))
    after = load_file(path)
    assert before.keys() == after.keys() and all(torch.equal(before[name], after[name]) for name in before)
    assert times == {p: p.stat().st_mtime_ns for p in times}


def test_the_papers_numbers_stand_in_the_plan():
    plan = yaml.safe_load((CONFIGS / "base.yaml").read_text())
    stages = {stage["name"]: stage for stage in plan["stages"]}
    assert [stage["balance"] for stage in stages.values()] == [0.0, 0.01, 0.01]
    assert all(stage["rate"] == 1e-4 and stage["batch"] == 24 for stage in stages.values())
    assert stages["stage1"]["dense_frames"] == 120
    assert plan["window"] == {"keyframe_stride": 6, "prefix": 10, "target": 5, "max_target": 10, "lookahead": 9}
    interp = plan["interp_training"]
    assert (interp["smoothing"], interp["velocity"], interp["acceleration"]) == (0.1, 1e-3, 1e-4)
    assert (plan["audio"]["layer"], plan["audio"]["units"], len(plan["voices"])) == (9, 500, 5)
