"""HuBERT's features (SPEC 2.1) on any device, and the audio tokens of a k-means over them."""

from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from umo_train.audio.mel import BEFORE, HOP
from umo_train.audio.units import nearest
from umo_train.convert import hubert as checkpoint
from umo_train.convert.sources import SourceError, read_json
from umo_train.device import best
from umo_train.speech.utterance import SAMPLE_RATE

Config = dict[str, Any]
# Added to the waveform's variance by Hugging Face's feature extractor.
_WAVE_EPS = 1e-7
_SIZES = (
    "conv_dim", "conv_kernel", "conv_stride", "hidden_size", "intermediate_size", "num_attention_heads",
    "num_conv_pos_embeddings", "num_conv_pos_embedding_groups", "layer_norm_eps",
)  # fmt: skip


def model_config(folder: Path, plan: Config) -> Config:
    """`config.audio` of the model file, for the HuBERT in `folder`."""
    theirs = read_json(folder / "config.json")
    sizes = {key: theirs[key] for key in _SIZES} | {
        "num_hidden_layers": plan["layer"],
        "do_normalize": plan["normalize"],
    }
    return {
        "kind": "hubert",
        "sample_rate": SAMPLE_RATE,
        "token_rate": SAMPLE_RATE // HOP,
        "units": plan["units"],
        "hubert": sizes,
    }


class _GroupNorm(nn.Module):
    """The first convolution's norm over time, with statistics that exclude outputs of the prepended silence."""

    def __init__(self, norm: nn.GroupNorm, skip: int) -> None:
        super().__init__()
        self.norm, self.skip = norm, skip

    def forward(self, x: Tensor) -> Tensor:
        heard = x[..., self.skip :]
        mean = heard.mean(-1, keepdim=True)
        variance = heard.var(-1, unbiased=False, keepdim=True)
        weight, bias = self.norm.weight[:, None], self.norm.bias[:, None]
        return (x - mean) / (variance + self.norm.eps).sqrt() * weight + bias


class Hubert:
    """Features of layer `layer`. Convolutions run over the whole recording; layers see `window` features at a time, as
    in the program, or all of them if it is 0."""

    def __init__(self, folder: Path, layer: int, *, normalize: bool, window: int, device: torch.device | None = None):
        # Imported late: only some users need it.
        from transformers import HubertModel

        checkpoint.check_form(folder)
        self.device = device or best()
        model = HubertModel.from_pretrained(folder).eval().to(self.device)
        if len(model.encoder.layers) < layer:
            raise SourceError(f"{folder}: {len(model.encoder.layers)} layers, the plan asks for layer {layer}")
        model.encoder.layers = model.encoder.layers[:layer]
        first = model.feature_extractor.conv_layers[0]
        first.layer_norm = _GroupNorm(first.layer_norm, -(-BEFORE // model.config.conv_stride[0]))
        self.model, self.window, self.normalize = model, window, normalize
        self.width: int = model.config.hidden_size

    @torch.no_grad()
    def features(self, recordings: np.ndarray, batch: int = 64) -> Tensor:
        """Recordings of equal length `[b, n]` to `[b, n // 320, width]`, on the CPU."""
        rows = [self._convolved(torch.from_numpy(row).to(self.device)) for row in recordings]
        hidden = torch.stack(rows)
        out = torch.empty(*hidden.shape[:2], self.width)
        for where, tiles in self._tiles(hidden):
            made = torch.cat([self.model.encoder(part).last_hidden_state for part in tiles.split(batch)]).cpu()
            kept = where.stop - where.start
            out[:, where] = made.view(len(hidden), -1, self.width)[:, -kept:]
        return out

    def _convolved(self, samples: Tensor) -> Tensor:
        """`[n]` to the projected outputs of the convolutions `[n // 320, width]`."""
        samples = samples.float()
        if self.normalize:
            samples = (samples - samples.mean()) / (samples.var(unbiased=False) + _WAVE_EPS).sqrt()
        # A window starts before its token's own samples: SPEC 2.1.
        padded = nn.functional.pad(samples[: len(samples) // HOP * HOP], (BEFORE, 0))
        return self.model.feature_projection(self.model.feature_extractor(padded[None]).transpose(1, 2))[0]

    def _tiles(self, hidden: Tensor) -> list[tuple[slice, Tensor]]:
        """Slices of features and their source windows `[k, window, width]`; the last window ends at the end."""
        count, window = hidden.shape[1], self.window
        if not window or count <= window:
            return [(slice(0, count), hidden)]
        whole = count // window * window
        tiles = hidden[:, :whole].reshape(-1, window, hidden.shape[2])
        out = [(slice(0, whole), tiles)]
        if whole < count:
            out.append((slice(whole, count), hidden[:, -window:]))
        return out


class HubertTokenizer:
    """Samples at 16 kHz to units, 50 a second."""

    def __init__(self, folder: Path, plan: Config, centroids: Tensor) -> None:
        self.folder, self.plan = folder, plan
        self.hubert = reader(folder, plan)
        self.centroids = centroids.float()

    def __call__(self, samples: np.ndarray) -> np.ndarray:
        return self.many(np.asarray(samples)[None])[0]

    def many(self, recordings: np.ndarray) -> np.ndarray:
        """Recordings of equal length `[b, n]` to `[b, n // 320]`."""
        features = self.hubert.features(np.ascontiguousarray(recordings, np.float32))
        return nearest(features.flatten(0, 1), self.centroids).view(features.shape[:2]).numpy().astype(np.int16)

    def tensors(self) -> dict[str, Tensor]:
        """Tensors as in the model file."""
        config = {"audio": model_config(self.folder, self.plan)}
        return checkpoint.convert(self.folder, config) | {"audio.kmeans.centroids": self.centroids}

    def save(self, path: Path) -> None:
        """Saves the centroids only; the network stays in its folder."""
        path.parent.mkdir(parents=True, exist_ok=True)
        save_file({"audio.kmeans.centroids": self.centroids}, path)

    @staticmethod
    def load(path: Path, folder: Path, plan: Config) -> "HubertTokenizer":
        return HubertTokenizer(folder, plan, load_file(path)["audio.kmeans.centroids"])


def reader(folder: Path, plan: Config) -> Hubert:
    return Hubert(folder, plan["layer"], normalize=plan["normalize"], window=plan["window"])
