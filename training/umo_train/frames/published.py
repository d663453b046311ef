"""The step `start`: tokenizers and the interpolation network of a model file that exists, so that a plan trains the
rest alone."""

import json
from collections.abc import Sequence
from pathlib import Path

import torch
from safetensors import safe_open
from safetensors.torch import save_file
from torch import Tensor, nn

from umo_train.audio.tokens import PUBLISHED
from umo_train.frames.interp import VectorInterpolation
from umo_train.frames.model import from_file
from umo_train.frames.networks import ResidualVqVae
from umo_train.frames.parts import Part, columns
from umo_train.frames.root import RootPlan
from umo_train.motion.networks import RootNetwork
from umo_train.plan import Config
from umo_train.stored import floats


def read(path: Path) -> tuple[Config, dict[str, Tensor]]:
    """Config and f32 tensors of a model file; int8 and int4 weights are multiplied by their scales.

    Raises `ValueError` where the file is no model of layout `frames`.
    """
    with safe_open(path, "pt") as file:
        about = file.metadata() or {}
        if about.get("format") != "umo":
            raise ValueError(f"{path} is no umo model: its metadata do not say so")
        config = json.loads(about["config"])
        if config.get("layout") != "frames":
            raise ValueError(f"{path} has another layout than `frames`, of which no run can go on")
        stored = {name: file.get_tensor(name) for name in file.keys()}
    return config, floats(stored)


def tokenizer(part: str) -> str:
    """The file that a part's tokenizer goes on from."""
    return f"published_{part}.pt"


def start(
    path: Path, folder: Path, order: list[Part], face: list[str], root: RootPlan, more: Sequence[str] = ()
) -> None:
    """Writes `tokenizer_*.pt`, `interp.pt` and what the listener starts from in `folder`, from the model file `path`,
    for the plan's parts; what exists stays. Tokenizers of the parts `more`, which are to be trained on, and with a
    lower body among them the root network, are not yet what the plan is to have. Raises `ValueError` where parts are
    not the file's."""
    config, tensors = read(path)
    given = {entry["name"]: entry for entry in config["parts"]}
    for part in order:
        entry = given.get(part.name)
        if entry is None or (entry["codes"], entry["levels"]) != (part.codes, part.levels):
            raise ValueError(f"part `{part.name}` of the plan is not that of {path}")
    folder.mkdir(parents=True, exist_ok=True)
    for part in order:
        if not part.moves:
            continue
        model = ResidualVqVae(part, len(columns(part, face)[1]))
        mine = _below(tensors, f"vq.{part.name}.")
        table = mine.pop("quantizer.embedding.weight").split(part.codes)
        mine |= {f"levels.{i}.embedding.weight": rows for i, rows in enumerate(table)}
        # Channels go in as they are: the file's weights have mean and scale in them.
        _write(model, mine, folder / (tokenizer(part.name) if part.name in more else f"tokenizer_{part.name}.pt"))
    heard = {name: tensor.contiguous() for name, tensor in tensors.items() if name.startswith("audio.")}
    if heard:
        save_file(heard, folder / PUBLISHED)
    network = RootNetwork(root.width, config["vq"]["root"]["channels"], root.layers)
    if "lower" not in more:
        _write(network, _below(tensors, "vq.root."), folder / "tokenizer_root.pt")
    sizes = {"interp": config["interp"], "keyframe_stride": config["keyframe_stride"]}
    _write(VectorInterpolation(sizes, order), _below(tensors, "interp."), folder / "interp.pt")


def language_model(path: Path) -> dict[str, Tensor]:
    """Weights of a `FrameModel` from a model file: what `for_file` has named."""
    _, tensors = read(path)
    depth = {name: tensor for name, tensor in tensors.items() if name.startswith("depth.")}
    return from_file(_below(tensors, "lm.") | depth)


def _below(tensors: dict[str, Tensor], prefix: str) -> dict[str, Tensor]:
    return {name.removeprefix(prefix): tensor for name, tensor in tensors.items() if name.startswith(prefix)}


def _write(model: nn.Module, found: dict[str, Tensor], path: Path) -> None:
    if path.exists():
        return
    state = model.state_dict()
    unknown = sorted(set(found) - set(state))
    if unknown:
        raise ValueError(f"{path.name}: the model file has {', '.join(unknown)}, which the plan's network has not")
    model.load_state_dict(state | found)
    torch.save({"model": model.state_dict()}, path)
