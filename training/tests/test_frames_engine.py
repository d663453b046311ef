"""A model of layout `frames`, trained at minimal size: the Rust program reads it, computes the same as our modules, and
plays. `UMO_PROGRAM` names the program."""

import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.torch import load_file, save_file
from torch import Tensor

import layout
from umo_train import pipeline
from umo_train.data import corpus
from umo_train.frames import interp, parts, steps
from umo_train.frames.interp import VectorInterpolation
from umo_train.frames.model import FrameModel, for_file
from umo_train.frames.networks import ResidualVqVae
from umo_train.metrics import frame_agreement
from umo_train.metrics.item import Item
from umo_train.plan import merged

PROGRAM = os.environ.get("UMO_PROGRAM")
pytestmark = pytest.mark.skipif(PROGRAM is None, reason="UMO_PROGRAM is not set")
CONFIGS = Path(__file__).parents[1] / "configs"
# Even less than the smoke plan: the quality does not matter here.
LEAST = {
    "speech": {"hours": 0.004, "test_minutes": 0.1, "seconds_per_item": 6},
    "tokenizers": {"steps": 22},
    "audio": {"listener": {"steps": 4}},
    "interp_training": {"steps": 4},
    "depth": {"body_sooner": 4},
}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> pipeline.Run:
    """Every step of the plan, from speech to the model file."""
    work = tmp_path_factory.mktemp("work")
    made = pipeline.Run.read(CONFIGS / "frames.yaml", work, smoke=True)
    made.plan = merged(made.plan, LEAST)
    pipeline.run(made)
    return made


def test_items_to_choose_by_are_reported_apart(run: pipeline.Run) -> None:
    items = corpus.with_motion(run.corpus, "train", spoken=True)
    chosen = steps.chosen_by(run)
    assert len(chosen) == 1
    assert steps.trained_on(run, spoken=True) == [item for item in items if item not in chosen]
    chosen_by, held = ((run.folder / f"tokenizers{name}.md").read_text() for name in ("_validation", ""))
    assert chosen_by != held and all("| slide_cm_s | at most 0.3 |" in said for said in (chosen_by, held))


def test_the_root_network_is_stored_in_full(run: pipeline.Run) -> None:
    solved = steps.root_network(run).state_dict()
    with safe_open(_model(run), "pt") as file:
        assert all(torch.equal(file.get_tensor(f"vq.root.{name}"), values) for name, values in solved.items())


def _model(run: pipeline.Run) -> Path:
    return run.folder / f"{run.plan['name']}.safetensors"


def _state(run: pipeline.Run, prefix: str) -> dict[str, Tensor]:
    """The file's values under a prefix, which are rounded to bf16."""
    with safe_open(_model(run), "pt") as file:
        names = [name for name in file.keys() if name.startswith(prefix)]
        return {name.removeprefix(prefix): file.get_tensor(name).float() for name in names}


def _umo(*arguments: object) -> str:
    done = subprocess.run([PROGRAM, *map(str, arguments)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def _stage(run: pipeline.Run, name: str, inputs: dict[str, Tensor], folder: Path) -> dict[str, Tensor]:
    save_file({key: tensor.contiguous() for key, tensor in inputs.items()}, folder / "in.safetensors")
    common = ("--precision", "f32", "--threads", 1, "--model", _model(run))
    _umo("model", "stage", name, *common, "--in", folder / "in.safetensors", "--out", folder / "out.safetensors")
    return load_file(folder / "out.safetensors")


def _close(found: Tensor, expected: Tensor) -> None:
    assert found.shape == expected.shape
    torch.testing.assert_close(found, expected, rtol=1e-4, atol=2e-4 * float(expected.abs().max()))


def _language(run: pipeline.Run) -> FrameModel:
    """Our modules with the file's weights."""
    model = FrameModel(steps.model_file_config(run), steps.parts_of(run)).eval()
    stored = _state(run, "lm.") | {f"depth.{name}": tensor for name, tensor in _state(run, "depth.").items()}
    own = for_file({name: name for name in model.state_dict()})
    model.load_state_dict({own[name]: tensor for name, tensor in stored.items()})
    return model


def _split(run: pipeline.Run, prefix: str, codes: Tensor) -> dict[str, Tensor]:
    """Codes `[T, J]` in the format of the program's stages."""
    out, at = {}, 0
    for part in steps.parts_of(run):
        out[f"{prefix}.{part.name}"] = codes[:, at : at + part.levels]
        at += part.levels
    return out


def _codes(run: pipeline.Run, count: int, seed: int) -> Tensor:
    order = steps.parts_of(run)
    most = np.repeat([part.codes for part in order], [part.levels for part in order])
    return torch.from_numpy(np.random.default_rng(seed).integers(0, most, (count, len(most))))


def test_the_config_describes_every_tensor(run: pipeline.Run) -> None:
    with safe_open(_model(run), "pt") as file:
        found = {name: tuple(file.get_slice(name).get_shape()) for name in file.keys()}
        config = json.loads(file.metadata()["config"])
    del found["text.tokenizer"]
    assert config == json.loads(json.dumps(steps.model_file_config(run)))
    assert found == layout.shapes(config, encoders=True)


def test_inspect_tells_the_model(run: pipeline.Run) -> None:
    said = _umo("model", "inspect", _model(run))
    assert "umo-frames-smoke" in said and "18 codes a keyframe" in said and "intent 1x13" in said
    assert "right" in _umo("model", "inspect", "--verify", _model(run))


@torch.no_grad()
def test_depth(run: pipeline.Run, tmp_path: Path) -> None:
    codes, model = _codes(run, 6, 0), _language(run)
    hidden = torch.randn(6, run.plan["lm"]["d_model"], generator=torch.Generator().manual_seed(0))
    before = _codes(run, 6, 1)
    heard = torch.randn(6, run.plan["lm"]["d_model"], generator=torch.Generator().manual_seed(1))
    # The networks are trained with one order of all parts.
    inputs = (
        {"hidden": hidden, "heard": heard, "body_heard": heard.clone()}
        | _split(run, "codes", codes)
        | _split(run, "before", before)
    )
    out = _stage(run, "depth", inputs, tmp_path)
    for name, logits in model.depth(hidden, codes, before, heard).items():
        _close(out[f"logits.{name}"], logits)


@torch.no_grad()
def test_encoder_and_decoder_on_an_example(run: pipeline.Run, tmp_path: Path) -> None:
    """Training and the engine feed the same ids, history and keyframes at the same positions."""
    config, model = steps.model_file_config(run), _language(run)
    examples = steps.packed_of(run, config).examples(steps.parts_of(run), "train", augment=False)
    batch = examples.chunk(1, 5, np.random.default_rng(1))
    ids, history, codes = (torch.from_numpy(x) for x in (batch.ids[0], batch.history[0], batch.codes[0].clip(0)))
    inputs = {"input_ids": ids} | _split(run, "history", history)
    hidden = model.encode(ids[None], history[None])
    _close(_stage(run, "encoder", inputs, tmp_path)["hidden"], hidden[0])
    out = _stage(run, "decoder", inputs | _split(run, "codes", codes), tmp_path)
    _close(out["hidden"], model.decode(hidden, codes[None])[0])


@torch.no_grad()
def test_vectors_between(run: pipeline.Run, tmp_path: Path) -> None:
    model = VectorInterpolation(steps.model_file_config(run), steps.parts_of(run)).eval()
    model.load_state_dict(_state(run, "interp."))
    generator = torch.Generator().manual_seed(3)
    known = interp.anchors(29, model.stride)
    vectors = {part.name: torch.randn(29, part.width, generator=generator) * known[:, None] for part in model.parts}
    inputs = {"known": known.long()} | {f"vectors.{name}": rows for name, rows in vectors.items()}
    out = _stage(run, "interp", inputs, tmp_path)
    for name, rows in model({name: rows[None] for name, rows in vectors.items()}, known).items():
        _close(out[f"vectors.{name}"], rows[0])


@torch.no_grad()
def test_motion(run: pipeline.Run, tmp_path: Path) -> None:
    """Channels of all parts at their positions in the body, from the exported weights and approximately from the
    trained ones.
    """
    codes, trained = _codes(run, 40, 5), steps.tokenizers(run)
    face = steps.names_of_face(run)
    # Codes of motion, so that every joint's channels are those of a rotation.
    item = corpus.with_motion(run.corpus, "train", spoken=True)[0]
    codes = torch.from_numpy(np.load(run.folder / "codes" / f"{item}.npy")[:40].astype(np.int64))
    split = _split(run, "codes", codes)
    moving = {f"codes.{part.name}": split[f"codes.{part.name}"] for part in steps.moving(run)}
    out = _stage(run, "motion", moving, tmp_path)
    for part in steps.moving(run):
        region, at = parts.columns(part, face)
        model = ResidualVqVae(part, len(at)).eval()
        stored = _state(run, f"vq.{part.name}.")
        table = stored.pop("quantizer.embedding.weight")
        left = model.load_state_dict(stored, strict=False)
        assert not left.unexpected_keys
        for level, book in enumerate(model.levels):
            book.embedding.weight.copy_(table[part.codes * level : part.codes * (level + 1)])
        found = out[f"channels.{region}"][:, at]
        said = split[f"codes.{part.name}"][None]
        _close(found, model.motion(said)[0])
        unrounded = trained[part.name].motion(said)[0]
        assert (found - unrounded).abs().max() < 0.03 * unrounded.abs().max()


def test_it_plays(run: pipeline.Run, tmp_path: Path) -> None:
    speech = Path(__file__).parents[2] / "assets" / "hello.wav"
    for options in ((), ("--prompt", "calm")):
        _umo("animate", speech, "--model", _model(run), *options, "-o", tmp_path / "out.npz")
        with np.load(tmp_path / "out.npz") as motion:
            assert len(motion["poses"]) > 200
            assert all(np.isfinite(motion[name]).all() for name in ("poses", "trans", "arkit"))
    _umo("model", "quantize", _model(run), "-o", tmp_path / "int8.safetensors", "--weights", "int8")
    _umo("animate", speech, "--model", tmp_path / "int8.safetensors", "-o", tmp_path / "out.npz")


def test_the_report_is_written(run: pipeline.Run) -> None:
    rows = json.loads((run.folder / "tokenizers.json").read_text())
    assert [row["name"] for row in rows] == ["before", "1 level", "2 levels", "3 levels",
                                             "keyframes, straight lines between"]  # fmt: skip
    assert rows[0]["wrists_cm"] == 0 and all(row["wrists_cm"] > 0 for row in rows[1:])


def test_a_run_goes_on_where_it_is(run: pipeline.Run) -> None:
    """Everything exists: running the steps again changes nothing."""
    before = load_file(_model(run))
    pipeline.run(run, ("tokenizers", "codes", "lm", "interp", "export"))
    after = load_file(_model(run))
    assert before.keys() == after.keys() and all(torch.equal(before[name], after[name]) for name in before)


def test_rest_is_a_frame_that_was_seen(run: pipeline.Run) -> None:
    """Codes of levels belong together: a part's rest codes are those of one standing frame."""
    model = steps.tokenizers(run)["torso"]
    codes = np.array([[1, 2], [1, 2], [3, 0], [1, 3]])
    found = steps.middle(codes, model)
    vectors = model.vectors(torch.from_numpy(codes))
    nearest = (vectors - vectors.mean(0)).square().sum(1).argmin()
    assert found == codes[nearest].tolist() and steps.middle(np.array([[3], [5], [5]]), None) == [5]


@pytest.mark.parametrize(
    ("change", "said"),
    [({"codes": 12}, "of 13 codes"), ({"name": "mood"}, "only provides `intent`"), ({"levels": 2}, "1 level")],
)
def test_annotations_that_nobody_makes_are_refused(change: dict[str, object], said: str, tmp_path: Path) -> None:
    made = pipeline.Run.read(CONFIGS / "frames.yaml", tmp_path, smoke=True)
    made.plan["parts"][0] |= change
    with pytest.raises(ValueError, match=said):
        steps.parts_of(made)


def test_the_paper_layout_has_no_report(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no step `report`"):
        pipeline.run(pipeline.Run.read(CONFIGS / "small.yaml", tmp_path, smoke=True), ("report",))


def test_agreement_is_of_the_same_chunks(run: pipeline.Run) -> None:
    """Traced like a stream: sampled codes become the next chunk's history. f32 agrees with itself, int8 mostly."""
    umo, config = Path(PROGRAM), steps.model_file_config(run)
    speech = Item("noise", "", np.random.default_rng(0).normal(0.0, 0.1, 4 * 16000).astype(np.float32))
    first, second = frame_agreement.trace(umo, speech, _model(run), 2)
    for name, drawn in first.codes.items():
        assert drawn.shape == (config["target"], next(p["levels"] for p in config["parts"] if p["name"] == name))
        assert np.array_equal(second.history[name][-config["target"] :], drawn)
    shares, error = frame_agreement.compare(umo, [first], _model(run), precision="f32")
    assert shares["all"] == 1.0 and error == 0.0
    assert 0.0 < frame_agreement.compare(umo, [first], _model(run), precision="int8")[1] < 1.0
    coarse = frame_agreement.agreement(umo, [first, second], _model(run), precision="int8")
    assert set(coarse) == {*first.codes, "all"} and 0.8 < coarse["all"] <= 1.0
    assert frame_agreement.code_counts([first, second], config)["intent"].sum() == 2 * config["target"]
