"""A small network on log-mel features that hears what a face shows of speech: what k-means is run on in its place.

Clusters of mel features are clusters of voices: of the mouth's opening they leave a correlation of 0.70 in voices
that were not trained on, the features themselves 0.86. What this network gives is the opening and the shape of the
lips, whether they are closed, and accents, at distances that say how much each matters; clusters of that leave 0.89.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from umo_train.performer.lips import CLOSED, lip_opening
from umo_train.skeleton import ARKIT
from umo_train.speech.utterance import FRAME_RATE, Phone

TOKEN_RATE = 50
JAW = 6
# Shapes that speech moves, of which as many directions are kept.
LIPS = [i for i, name in enumerate(ARKIT) if name.startswith(("jaw", "mouth", "tongue"))]
SHAPES = 6
# Outputs: the shapes, the opening, whether the lips touch, accents; what distance 1 of each is.
WIDTH = SHAPES + 3
OPENING, CLOSURE, ACCENT = 3.5, 1.0, 0.8


class Listener(torch.nn.Module):
    """Rows of normalised mel features `[n, bands]` to as many of `widths[-1]`: each from its own row and the `taps - 1`
    before it. Before the first row is `silence`."""

    def __init__(self, bands: int, taps: int, widths: Sequence[int]) -> None:
        super().__init__()
        self.taps, self.widths = taps, list(widths)
        inputs = [taps * bands, *widths[:-1]]
        self.layers = torch.nn.ModuleList(torch.nn.Linear(a, b) for a, b in zip(inputs, widths, strict=True))

    def windows(self, rows: Tensor, silence: Tensor) -> Tensor:
        """`[n, taps * bands]`, oldest row first."""
        padded = torch.cat([silence.expand(self.taps - 1, -1), rows])
        return padded.unfold(0, self.taps, 1).transpose(1, 2).flatten(1)

    def forward(self, windows: Tensor) -> Tensor:
        for layer in self.layers[:-1]:
            windows = torch.relu(layer(windows))
        out: Tensor = self.layers[-1](windows)
        return out

    def tensors(self) -> dict[str, Tensor]:
        """As the model file has them."""
        return {f"audio.mel.network.{name.removeprefix('layers.')}": t for name, t in self.state_dict().items()}

    def load(self, tensors: dict[str, Tensor]) -> None:
        prefix = "audio.mel.network."
        self.load_state_dict({name: tensors[prefix + name.removeprefix("layers.")] for name in self.state_dict()})


@dataclass(frozen=True)
class Heard:
    """An item for training: features of one recording `[n, bands]`, and what they are to give `[n, WIDTH]`."""

    features: Tensor
    wanted: Tensor


@dataclass(frozen=True)
class Shapes:
    """Directions in which lips move `[SHAPES, lips]`, at unit deviation altogether."""

    mean: np.ndarray
    axes: np.ndarray

    @staticmethod
    def of(faces: Sequence[np.ndarray]) -> "Shapes":
        """From faces `[frames, channels]` of many items."""
        rows = np.concatenate([face[::5, JAW:][:, LIPS] for face in faces]).astype(np.float64)
        mean = rows.mean(0)
        values, axes = np.linalg.eigh(np.cov((rows - mean).T))
        axes, values = axes[:, ::-1][:, :SHAPES].T, values[::-1][:SHAPES]
        return Shapes(mean, axes / np.sqrt(values.sum()))

    def wanted(self, face: np.ndarray, phones: Sequence[Phone], count: int, delay: int) -> np.ndarray:
        """What token `i` of `count` is to say of the moment `delay` tokens before it `[count, WIDTH]`."""
        times = np.maximum(np.arange(count) - delay, 0) / TOKEN_RATE
        frames, known = times * FRAME_RATE, np.arange(len(face))
        lips = np.stack([np.interp(frames, known, face[:, JAW + i]) for i in LIPS], 1)
        shapes = (lips - self.mean) @ self.axes.T
        opening = np.interp(frames, known, lip_opening(face))
        accents = np.zeros(count)
        for phone in phones:
            inside = (times >= phone.start) & (times < phone.end)
            accents[inside] = (0.0, 0.4, 1.0)[phone.stress]
        columns = (opening * OPENING, (opening <= CLOSED) * CLOSURE, accents * ACCENT)
        return np.concatenate([shapes, np.stack(columns, 1)], 1).astype(np.float32)


def train(items: Sequence[Heard], silence: Tensor, plan: dict[str, Any], steps: int, seed: int) -> Listener:
    """Least squares on random stretches of the items."""
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    bands = items[0].features.shape[1]
    network = Listener(bands, plan["taps"], plan["widths"])
    # Mel features are normalised for distances between them; here each is to count as 1.
    unit = bands**0.5 / 2**0.5
    optimizer = torch.optim.AdamW(network.parameters(), 1.5e-3, weight_decay=1e-2)
    bar = tqdm(range(steps), "listener")
    for step in bar:
        optimizer.param_groups[0]["lr"] = 1.5e-3 * max(0.03, 1 - step / steps)
        parts = [_stretch(items[i], network, silence, rng) for i in rng.integers(len(items), size=64)]
        windows, wanted = torch.cat([p[0] for p in parts]).float() * unit, torch.cat([p[1] for p in parts])
        loss = (network(windows + 0.1 * torch.randn_like(windows)) - wanted).square().sum(1).mean()
        optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimizer.step()
        if step % 20 == 0:
            bar.set_postfix(loss=f"{loss.item():.3f}")
    with torch.no_grad():
        network.layers[0].weight *= unit
    return network.eval()


def _stretch(item: Heard, network: Listener, silence: Tensor, rng: np.random.Generator) -> tuple[Tensor, Tensor]:
    """32 neighbours; where the item begins, what is before it is silence."""
    first = int(rng.integers(-network.taps, max(len(item.features) - 32, 1)))
    low, high = max(first - network.taps + 1, 0), max(first, 0) + 32
    rows = item.features[low:high]
    windows = network.windows(rows, silence.to(rows.dtype))
    return windows[max(first, 0) - low :], item.wanted[max(first, 0) : high]
