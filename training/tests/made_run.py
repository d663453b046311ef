"""A run of the smoke plan with random networks in place of trained ones, for the export step."""

from pathlib import Path
from typing import Any

import torch
import yaml

from umo_train import export, pipeline
from umo_train.audio.mel import Mel
from umo_train.audio.tokens import Tokenizer
from umo_train.interp.model import Interpolation
from umo_train.lm.model import LanguageModel
from umo_train.motion.networks import RootNetwork, VqVae
from umo_train.mouth.features import Front, sizes_of
from umo_train.mouth.network import MouthNetwork
from umo_train.skeleton import CHANNELS, PARTS, VELOCITY
from umo_train.state import Saved

SMALL = Path(__file__).parents[1] / "configs" / "small.yaml"


@torch.no_grad()
def make(work: Path) -> pipeline.Run:
    torch.manual_seed(0)
    run = pipeline.Run.read(SMALL, work, smoke=True)
    run.folder.mkdir(parents=True)
    plan = run.plan
    mel = Mel(**plan["audio"]["mel"])
    samples = 0.1 * torch.randn(32000)
    samples[10000:20000] = 0
    mel.fit(mel.bands(samples), plan["audio"]["delta_weight"])
    centroids = mel.features(samples)[:: 100 // plan["audio"]["units"]][: plan["audio"]["units"]]
    Tokenizer(mel, centroids.contiguous()).save(run.folder / "audio.safetensors")
    (run.folder / "rest.yaml").write_text(yaml.safe_dump({part: i for i, part in enumerate(PARTS)}))
    for part in PARTS:
        sizes = pipeline._tokenizer_plan(run, part)
        model = VqVae(sizes.width, CHANNELS[part], sizes.layers, sizes.codes)
        # Around zero rotations, so that every joint's six channels form a rotation.
        model.mean.copy_(_rest(part))
        model.scale.uniform_(0.5, 1.5)
        Saved(run.folder / f"tokenizer_{part}.pt", model=model).save(1)
    sizes = pipeline._tokenizer_plan(run, "root")
    Saved(run.folder / "tokenizer_root.pt", model=RootNetwork(sizes.width, 61, sizes.layers)).save(1)
    config = pipeline.model_file_config(run)
    Saved(run.folder / "interp.pt", model=Interpolation(config)).save(1)
    export.save_state(run.folder / "lm_stage2.safetensors", LanguageModel(config).state_dict())
    return run


MOUTH_FEATURES = {"window": 230, "fft": 256, "bands": 9, "floor": 1e-8, "rows": 2, "ahead": 3, "taps": 7}
MOUTH_NETWORK = {"width": 12, "kernel": 3, "dilations": [1, 3]}
MOUTH_CHANNELS = ["jawOpen", "mouthClose", "tongueOut"]


@torch.no_grad()
def mouth(behind: int = 0) -> tuple[dict[str, Any], dict[str, torch.Tensor]]:
    """A live mouth of random weights: its config and its tensors; with a second head if it is `behind`."""
    torch.manual_seed(5)
    front = Front(sizes_of(MOUTH_FEATURES))
    timing = {name: MOUTH_FEATURES[name] for name in ("rows", "taps")}
    network = MouthNetwork(front.width, len(MOUTH_CHANNELS), **timing, **MOUTH_NETWORK, behind=behind)
    network.mean.fill_(-4.0)
    network.scale.fill_(0.3)
    network.head.weight.mul_(5.0)
    about = {**MOUTH_FEATURES, **MOUTH_NETWORK, "channels": MOUTH_CHANNELS}
    if behind:
        network.later.weight.mul_(5.0)
        about["behind"] = behind
    return about, network.tensors(torch.float32) | front.tensors() | {"mouth.rest": torch.tensor([0.1, 0.2, 0.3])}


def _rest(part: str) -> torch.Tensor:
    out = torch.zeros(CHANNELS[part])
    joints = {"face": 1, "hands": 30, "upper": 13, "lower": 9}[part]
    out[: 6 * joints] = torch.tensor([1.0, 0, 0, 0, 1, 0]).repeat(joints)
    if part == "lower":
        out[VELOCITY] = 0.1
    return out
