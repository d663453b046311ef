"""Small checkpoints in the formats of the published ones, written by the libraries that define the formats."""

import json
from pathlib import Path

import joblib
import numpy as np
import torch
from safetensors import safe_open
from sklearn.cluster import MiniBatchKMeans
from torch import Tensor, nn
from transformers import HubertConfig, HubertModel, T5Config, T5ForConditionalGeneration

from umo_train.skeleton import PARTS

GOLDEN = Path(__file__).parents[2] / "tests" / "golden"
TEXT = 101


def golden_config(name: str = "hubert_k1_smplx") -> dict:
    """The config of one of the project's small models."""
    with safe_open(GOLDEN / name / "model.safetensors", "pt") as file:
        return json.loads(file.metadata()["config"])


def hubert(folder: Path, config: dict, layers: int) -> HubertModel:
    """`save_pretrained` of a HuBERT with `layers` layers."""
    torch.manual_seed(1)
    sizes = {k: v for k, v in config["audio"]["hubert"].items() if k not in ("do_normalize", "num_hidden_layers")}
    model = HubertModel(HubertConfig(**sizes, num_hidden_layers=layers, num_feat_extract_layers=7)).eval()
    for parameter in model.parameters():
        parameter.data += 0.05 * torch.randn_like(parameter)
    model.save_pretrained(folder)
    return model


def t5(config: dict, rows: int) -> T5ForConditionalGeneration:
    """A dense T5 with its own output head, like Flan-T5."""
    torch.manual_seed(2)
    sizes = {k: v for k, v in config["lm"].items() if k not in ("experts", "top_k")}
    settings = T5Config(
        **sizes, vocab_size=rows, pad_token_id=0, eos_token_id=1, decoder_start_token_id=0, dropout_rate=0.0
    )
    model = T5ForConditionalGeneration(settings).eval()
    # transformers 5 uses the embedding table regardless of the config.
    model.lm_head = nn.Linear(sizes["d_model"], rows, bias=False)
    for parameter in model.parameters():
        parameter.data = 0.3 * torch.randn_like(parameter)
    return model


def t5_state(model: T5ForConditionalGeneration) -> dict[str, Tensor]:
    """As in `torch.save(model.state_dict())`: with the embedding table three times."""
    return {name: tensor.clone() for name, tensor in model.state_dict().items()}


def kmeans(path: Path, config: dict) -> np.ndarray:
    """joblib's dump of scikit-learn's `MiniBatchKMeans`."""
    width, units = config["audio"]["hubert"]["hidden_size"], config["audio"]["units"]
    points = np.random.default_rng(3).normal(size=(4 * units, width)).astype(np.float32)
    random = np.random.RandomState(0)
    fitted = MiniBatchKMeans(units, n_init=1, max_iter=2, batch_size=64, random_state=random).fit(points)
    joblib.dump(fitted, path)
    return fitted.cluster_centers_


class Residual(nn.Module):
    def __init__(self, width: int) -> None:
        super().__init__()
        self.model = nn.Sequential(_conv(width, width), nn.LeakyReLU(0.2), _conv(width, width))


class Main(nn.Module):
    def __init__(self, *layers: nn.Module) -> None:
        super().__init__()
        self.main = nn.Sequential(*layers)


class Codec(nn.Module):
    """The modules of `VQVAEConvZero`, and without a codebook of `VAEConvZero`, with their names."""

    def __init__(self, width: int, channels: int, layers: int, codes: int | None) -> None:
        super().__init__()
        inputs = [channels] + [width] * (layers - 1)
        self.encoder = Main(*[m for n in inputs for m in (_conv(n, width), nn.LeakyReLU(0.2), Residual(width))])
        if codes is not None:
            self.quantizer = nn.Module()
            self.quantizer.embedding = nn.Embedding(codes, width)
        outputs = [width] * (layers - 1) + [channels]
        widen = [m for n in outputs for m in (_conv(width, n), nn.LeakyReLU(0.2))]
        self.decoder = Main(Residual(width), Residual(width), *widen, _conv(channels, channels))


def _conv(inputs: int, outputs: int) -> nn.Conv1d:
    return nn.Conv1d(inputs, outputs, 3, padding=1)


def codecs(config: dict) -> dict[str, dict[str, Tensor]]:
    """Weights of the five codecs."""
    torch.manual_seed(4)
    vq = config["vq"]
    return {
        name: Codec(vq["width"], vq[name]["channels"], vq[name]["layers"], vq["codes"] if name in PARTS else None)
        .state_dict()
        for name in (*PARTS, "root")
    }  # fmt: skip


def emage(folder: Path, config: dict) -> list[Path]:
    """EMAGE's files: one per part, from a model inside `DataParallel`, with the epoch."""
    paths = []
    for name, state in codecs(config).items():
        paths.append(folder / f"last_{name}.bin")
        torch.save({"model_state": {f"module.{k}": v for k, v in state.items()}, "epoch": 790}, paths[-1])
    return paths


class Settings:
    """A trainer's own class, which a reader does not have."""

    def __init__(self) -> None:
        self.stage = "lm_instruct"


def language_of_motion(path: Path, config: dict, lm: dict[str, Tensor] | None) -> Path:
    """PyTorch Lightning's checkpoint: weights, and other data of the trainer."""
    names = {"hands": "hand", "root": "global"}
    parts = {f"vae_{names.get(part, part)}": weights for part, weights in codecs(config).items()}
    state = {f"{part}.{k}": v for part, weights in parts.items() for k, v in weights.items()}
    state |= {f"lm.language_model.{k}": v for k, v in (lm or {}).items()}
    state["smplx.v_template"] = torch.zeros(4, 3)
    torch.save({"state_dict": state, "epoch": 3, "hyper_parameters": {"cfg": Settings(), "lr": [1e-4]}}, path)
    return path
