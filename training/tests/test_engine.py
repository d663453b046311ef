"""The Rust program reads the exported file, and its stages compute the same as our modules. `UMO_PROGRAM` names it."""

import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.torch import load_file, save_file
from scipy.spatial.transform import Rotation
from torch import Tensor

import made_run
from umo_train import pipeline
from umo_train.audio.tokens import Tokenizer
from umo_train.interp.model import Interpolation
from umo_train.interp.train import fill
from umo_train.lm.model import LanguageModel
from umo_train.motion.networks import RootNetwork, VqVae
from umo_train.mouth import part as mouth_part
from umo_train.mouth.gate import gate, gated
from umo_train.mouth.run import Mouth
from umo_train.skeleton import CHANNELS, JOINTS_OF, PARTS, VELOCITY, matrices, rotation_6d

PROGRAM = os.environ.get("UMO_PROGRAM")
pytestmark = pytest.mark.skipif(PROGRAM is None, reason="UMO_PROGRAM is not set")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> pipeline.Run:
    made = made_run.make(tmp_path_factory.mktemp("work"))
    pipeline.step_export(made)
    return made


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
    save_file(inputs, folder / "in.safetensors")
    common = ("--precision", "f32", "--threads", 1, "--model", _model(run))
    _umo("model", "stage", name, *common, "--in", folder / "in.safetensors", "--out", folder / "out.safetensors")
    return load_file(folder / "out.safetensors")


def _close(found: Tensor, expected: Tensor) -> None:
    assert found.shape == expected.shape
    torch.testing.assert_close(found, expected, rtol=1e-4, atol=2e-4 * float(expected.abs().max()))


def test_inspect_tells_the_model(run: pipeline.Run) -> None:
    said = _umo("model", "inspect", "--tensors", _model(run))
    assert "umo-smoke" in said
    with safe_open(_model(run), "pt") as file:
        assert all(name in said for name in file.keys())


def test_mel_and_units(run: pipeline.Run, tmp_path: Path) -> None:
    tokenizer = Tokenizer.load(run.folder / "audio.safetensors", run.plan["audio"])
    samples = 0.1 * torch.randn(16000, generator=torch.Generator().manual_seed(5))
    samples[4000:7000] = 0
    out = _stage(run, "mel", {"audio": torch.cat([torch.zeros(80), samples])}, tmp_path)
    _close(out["features"], tokenizer.mel.features(samples))
    assert out["units"].tolist() == tokenizer(samples.numpy()).tolist()
    assert len(set(out["units"].tolist())) > 5


@torch.no_grad()
def test_encoder_and_decoder(run: pipeline.Run, tmp_path: Path) -> None:
    config = pipeline.model_file_config(run)
    model = LanguageModel(config).eval()
    model.load_state_dict(_state(run, "lm."))
    generator = torch.Generator().manual_seed(1)
    ids = torch.randint(0, config["vocab"]["size"], (90,), generator=generator)
    said = torch.randint(0, config["vocab"]["size"], (30,), generator=generator)
    said[0] = 0
    hidden = model.encode(ids[None])
    _close(_stage(run, "encoder", {"input_ids": ids}, tmp_path)["hidden"], hidden[0])
    logits = _stage(run, "decoder", {"input_ids": ids, "decoder_input_ids": said}, tmp_path)["logits"]
    _close(logits, model(ids[None], said[None])[0])


@torch.no_grad()
def test_interpolation(run: pipeline.Run, tmp_path: Path) -> None:
    config = pipeline.model_file_config(run)
    model = Interpolation(config).eval()
    model.load_state_dict(_state(run, "interp."))
    frames, stride = 29, config["keyframe_stride"]
    codes = np.random.default_rng(0).integers(0, model.codes, (4, frames))
    anchor = (np.arange(frames) % stride == 0) | (np.arange(frames) == frames - 1)
    codes[:, ~anchor] = model.codes
    inputs = {f"codes.{part}": torch.from_numpy(codes[i]) for i, part in enumerate(PARTS)}
    out = _stage(run, "interp", inputs, tmp_path)
    logits = model(torch.from_numpy(codes)[None])[0]
    filled = fill(model, codes)
    for i, part in enumerate(PARTS):
        _close(out[f"logits.{part}"], logits[i])
        assert out[f"codes.{part}"].tolist() == filled[i].tolist()


@torch.no_grad()
def test_motion(run: pipeline.Run, tmp_path: Path) -> None:
    """Channels from the exported weights, joints and the root's path; the exported weights equal the trained ones."""
    frames, trained = 40, pipeline.tokenizers(run)
    generator = torch.Generator().manual_seed(2)
    count = run.plan["tokenizers"]["codes"]
    codes = {part: torch.randint(0, count, (frames,), generator=generator) for part in PARTS}
    out = _stage(run, "motion", {f"codes.{part}": rows for part, rows in codes.items()}, tmp_path)
    for part in PARTS:
        plan = pipeline._tokenizer_plan(run, part)
        model = VqVae(plan.width, CHANNELS[part], plan.layers, plan.codes).eval()
        left = model.load_state_dict(_state(run, f"vq.{part}."), strict=False)
        assert not left.unexpected_keys
        channels = model.motion(codes[part][None])[0]
        _close(out[f"channels.{part}"], channels)
        # bf16 keeps three digits.
        unrounded = trained[part].motion(codes[part][None])[0]
        error = (channels - unrounded).pow(2).mean().sqrt() / unrounded.std()
        assert 0 < error < 0.02
        joints = JOINTS_OF[part]
        six = channels[:, : 6 * len(joints)].reshape(frames, len(joints), 6).double().numpy()
        turned = Rotation.from_rotvec(out["rotations"][:, list(joints)].reshape(-1, 3).double().numpy()).as_matrix()
        np.testing.assert_allclose(turned.reshape(frames, -1, 3, 3), matrices(six), atol=2e-3)
    _root(run, out)


def _root(run: pipeline.Run, out: dict[str, Tensor]) -> None:
    plan = pipeline._tokenizer_plan(run, "root")
    root = RootNetwork(plan.width, CHANNELS["lower"], plan.layers).eval()
    root.load_state_dict(_state(run, "vq.root."))
    lower = out["channels.lower"].clone()
    joints = len(JOINTS_OF["lower"])
    six = matrices(lower[:, : 6 * joints].reshape(-1, joints, 6).double().numpy())
    lower[:, : 6 * joints] = torch.from_numpy(rotation_6d(six).reshape(len(lower), -1)).float()
    lower[:, VELOCITY] = 0
    found = root(lower[None])[0, :, VELOCITY]
    place = torch.zeros(len(lower), 3)
    # Frame i adds the velocity of the frame before.
    place[1:] = found[:-1].cumsum(0) / 30
    place[:, 1] = found[:, 1]
    _close(out["translation"], place)


@pytest.mark.parametrize("behind", [0, 5])
def test_mouth(run: pipeline.Run, tmp_path: Path, behind: int) -> None:
    """Added to a model, the live mouth computes the same as our modules, and the rest of the model is unchanged."""
    about, tensors = made_run.mouth(behind)
    mouth_part.write(tmp_path / "mouth.safetensors", about, tensors)
    model = tmp_path / "model.safetensors"
    mouth_part.add(_model(run), tmp_path / "mouth.safetensors", model)
    assert "right" in _umo("model", "inspect", "--verify", model)
    t = torch.arange(50_011) / 16_000
    samples = 0.3 * torch.sin(900 * t) * torch.sin(8 * t).clamp(min=0)
    save_file({"audio": samples}, tmp_path / "in.safetensors")
    _umo(
        "model",
        "stage",
        "mouth",
        "--model",
        model,
        "--in",
        tmp_path / "in.safetensors",
        "--out",
        tmp_path / "out.safetensors",
    )
    out = load_file(tmp_path / "out.safetensors")
    mouth = Mouth(about, tensors)
    outputs = mouth.outputs(samples.numpy())
    _close(out["channels"], torch.from_numpy(gated(outputs, mouth.rest)).float())
    _close(out["voiced"], torch.from_numpy(gate(outputs[:, -1])).float())
    assert ("later" in out) == (behind > 0)
    if behind:
        later = torch.from_numpy(mouth.later(samples.numpy())).float()
        assert len(later) == len(out["channels"]) and later.std(0).min() > 0.01
        _close(out["later"], later)
    codes = {f"codes.{name}": torch.arange(9) for name in PARTS}
    before = _stage(run, "motion", codes, tmp_path)
    save_file(codes, tmp_path / "in.safetensors")
    common = ("--precision", "f32", "--threads", 1, "--model", model)
    _umo(
        "model",
        "stage",
        "motion",
        *common,
        "--in",
        tmp_path / "in.safetensors",
        "--out",
        tmp_path / "after.safetensors",
    )
    after = load_file(tmp_path / "after.safetensors")
    assert all(torch.equal(before[name], after[name]) for name in before)


def test_animate(run: pipeline.Run, tmp_path: Path) -> None:
    speech = Path(__file__).parents[2] / "assets" / "hello.wav"
    _umo("animate", speech, "--model", _model(run), "--prompt", "calm", "-o", tmp_path / "out.npz")
    with np.load(tmp_path / "out.npz") as motion:
        assert len(motion["poses"]) > 30 and all(np.isfinite(motion[name]).all() for name in ("poses", "trans"))
