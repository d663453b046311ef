"""The step `start`: takes tokenizers and the interpolation network from an existing model file, so that a plan trains
only the rest."""

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

    Raises `ValueError` if the file is not a model of layout `frames`.
    """
    with safe_open(path, "pt") as file:
        about = file.metadata() or {}
        if about.get("format") != "umo":
            raise ValueError(f"{path} is not a umo model: its metadata lack the format")
        config = json.loads(about["config"])
        if config.get("layout") != "frames":
            raise ValueError(f"{path} has another layout than `frames`: training cannot continue from it")
        stored = {name: file.get_tensor(name) for name in file.keys()}
    return config, floats(stored)


def tokenizer(part: str) -> str:
    """The file that training of a part's tokenizer continues from."""
    return f"published_{part}.pt"


def start(
    path: Path, folder: Path, order: list[Part], face: list[str], root: RootPlan, more: Sequence[str] = ()
) -> None:
    """Writes `tokenizer_*.pt`, `interp.pt` and the listener's start to `folder`, from the model file `path`, for the
    plan's parts; existing files are kept. Tokenizers of the parts `more`, which are to be trained further, and with
    a lower body among them the root network, are not yet final. Raises `ValueError` if the parts differ from the
    file's."""
    config, tensors = read(path)
    given = {entry["name"]: entry for entry in config["parts"]}
    for part in order:
        entry = given.get(part.name)
        if entry is None or (entry["codes"], entry["levels"]) != (part.codes, part.levels):
            raise ValueError(f"part `{part.name}` of the plan differs from that of {path}")
    folder.mkdir(parents=True, exist_ok=True)
    for part in order:
        if not part.moves:
            continue
        model = ResidualVqVae(part, len(columns(part, face)[1]))
        mine = _below(tensors, f"vq.{part.name}.")
        table = mine.pop("quantizer.embedding.weight").split(part.codes)
        mine |= {f"levels.{i}.embedding.weight": rows for i, rows in enumerate(table)}
        # Channels are not normalised: mean and scale are folded into the file's weights.
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
    """Weights of a `FrameModel` from a model file: the inverse naming of `for_file`."""
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
        raise ValueError(f"{path.name}: the model file has {', '.join(unknown)}, which the plan's network lacks")
    model.load_state_dict(state | found)
    torch.save({"model": model.state_dict()}, path)
