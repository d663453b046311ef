"""A small network on log-mel features that predicts speech's effect on the face; k-means runs on its output instead.

Clusters of mel features are clusters of voices: in held-out voices their correlation with the mouth's opening is 0.70,
that of the features themselves 0.86. This network's outputs are the opening and the shape of the lips, whether they are
closed, and accents, scaled by how much each matters; clustering them loses nothing. Two dense layers predict the
opening with 0.86, residual blocks over time with 0.88 and, of 100 closures, 94 instead of 70.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from umo_train.device import has_bf16
from umo_train.performer.lips import CLOSED, lip_opening
from umo_train.skeleton import ARKIT
from umo_train.speech.utterance import FRAME_RATE, Phone

TOKEN_RATE = 50
JAW = 6
# Shapes moved by speech; `SHAPES` of their principal directions are kept.
LIPS = [i for i, name in enumerate(ARKIT) if name.startswith(("jaw", "mouth", "tongue"))]
SHAPES = 6
# Outputs: the shapes, the opening, whether the lips touch, accents; and the unit of each.
WIDTH = SHAPES + 3
OPENING, CLOSURE, ACCENT = 3.5, 1.0, 0.8
# One more if the plan asks for onsets of accents: a bump of this many seconds around each, predicted later than the
# rest.
ONSET, ONSET_S = 2.0, 0.04


class Listener(torch.nn.Module):
    """Rows of normalised mel features to `widths[-1]` values each, from a row and the `reach` before it: dense layers
    with ReLU in between, the first over `taps` rows; then `blocks` residual blocks `x + pointwise(relu(causal(x)))`,
    each over `kernel` rows, and ReLU. `silence` precedes the first row."""

    def __init__(self, bands: int, taps: int, widths: Sequence[int], blocks: dict[str, int] | None = None) -> None:
        super().__init__()
        self.taps, self.widths = taps, list(widths)
        kernel, count = (blocks["kernel"], blocks["count"]) if blocks else (1, 0)
        self.reach = taps - 1 + count * (kernel - 1)
        inputs = [taps * bands, *widths[:-1]]
        self.layers = torch.nn.ModuleList(torch.nn.Linear(a, b) for a, b in zip(inputs, widths, strict=True))
        width = widths[0]
        self.blocks = torch.nn.ModuleList(
            torch.nn.ModuleList([torch.nn.Conv1d(width, width, kernel), torch.nn.Conv1d(width, width, 1)])
            for _ in range(count)
        )

    def forward(self, rows: Tensor) -> Tensor:
        """`[b, reach + n, bands]`, oldest first, to `[b, n, widths[-1]]`."""
        x = rows.unfold(1, self.taps, 1).transpose(2, 3).flatten(2)
        for i, layer in enumerate(self.layers):
            x = layer(x)
            if i == 0 and self.blocks:
                x = self._residual(x.relu())
            if i + 1 < len(self.layers):
                x = x.relu()
        return x

    def _residual(self, x: Tensor) -> Tensor:
        x = x.transpose(1, 2)
        for causal, pointwise in self.blocks:
            inner = pointwise(causal(x).relu())
            x = x[..., x.shape[2] - inner.shape[2] :] + inner
        return x.transpose(1, 2)

    def heard(self, rows: Tensor, silence: Tensor) -> Tensor:
        """A whole stream `[n, bands]` to `[n, widths[-1]]`."""
        out: Tensor = self(torch.cat([silence.expand(self.reach, -1), rows])[None])[0]
        return out

    @torch.no_grad()
    def take(self, other: "Listener") -> None:
        """Copies the weights of a listener with as many taps and the same width, and with as many blocks and outputs or
        fewer: new blocks start as zero, new outputs keep their initial values."""
        if (other.taps, other.widths[:-1]) != (self.taps, self.widths[:-1]) or len(other.blocks) > len(self.blocks):
            raise ValueError("the published listener's sizes differ from the plan's: training cannot continue from it")
        mine = self.state_dict()
        for name, tensor in other.state_dict().items():
            mine[name][: len(tensor)] = tensor
        for _, pointwise in list(self.blocks)[len(other.blocks) :]:
            pointwise.weight.zero_()
            pointwise.bias.zero_()

    def tensors(self) -> dict[str, Tensor]:
        """Tensors as in the model file."""
        return {f"audio.mel.network.{name.removeprefix('layers.')}": t for name, t in self.state_dict().items()}

    @staticmethod
    def of(tensors: dict[str, Tensor]) -> "Listener":
        """The listener of a model file with one tap; sizes follow from its tensors."""
        prefix, count = "audio.mel.network.", 0
        while f"{prefix}blocks.{count}.0.weight" in tensors:
            count += 1
        layers = []
        while f"{prefix}{len(layers)}.weight" in tensors:
            layers.append(tensors[f"{prefix}{len(layers)}.weight"].shape)
        kernel = tensors[f"{prefix}blocks.0.0.weight"].shape[2] if count else 1
        blocks = {"kernel": kernel, "count": count} if count else None
        out = Listener(layers[0][1], 1, [rows for rows, _ in layers], blocks)
        out.load(tensors)
        return out

    def load(self, tensors: dict[str, Tensor]) -> None:
        prefix = "audio.mel.network."
        self.load_state_dict({name: tensors[prefix + name.removeprefix("layers.")] for name in self.state_dict()})


@dataclass(frozen=True)
class Voices:
    """Varies rows of mel features as other speakers, microphones and rooms would, for `bands` before and after
    normalising by `mean` and `scale`; no band is below the logarithm `floor`."""

    mean: Tensor
    scale: Tensor
    bands: int
    floor: float

    # Share of rows with another vocal tract, the shift of its resonances as a logarithm, and the variation of level,
    # tilt and curvature of the spectrum as logarithms of power.
    WARPED, TRACT, LEVEL, TILT, BEND = 0.7, 0.14, 0.8, 0.8, 0.5

    def vary(self, rows: Tensor) -> Tensor:
        """`[b, n, bands * (1 + deltas)]`, each item of the batch varied differently."""
        count, bands = len(rows), self.bands
        rows = rows / self.scale + self.mean
        moved = torch.empty(count).uniform_(-self.TRACT, self.TRACT) * (torch.rand(count) < self.WARPED)
        position = (torch.arange(bands) * moved.exp()[:, None]).clamp(0, bands - 1)
        low = position.floor().long().clamp(max=max(bands - 2, 0))
        share = (position - low)[:, None]
        out = []
        for values in rows.split(bands, 2):
            index = low[:, None].expand(-1, values.shape[1], -1)
            high = (index + 1).clamp(max=bands - 1)
            out.append(values.gather(2, index) * (1 - share) + values.gather(2, high) * share)
        level, tilt, bend = (x * torch.randn(count, 1) for x in (self.LEVEL, self.TILT, self.BEND))
        place = torch.linspace(-1, 1, bands)
        curve = level + tilt * place + bend * torch.cos(1.5 * torch.pi * (place + 1))
        out[0] = (out[0] + curve[:, None]).clamp(min=self.floor)
        return (torch.cat(out, 2) - self.mean) * self.scale


@dataclass(frozen=True)
class Heard:
    """A training item: features of one recording `[n, bands]`, and the targets `[n, WIDTH]`."""

    features: Tensor
    wanted: Tensor


@dataclass(frozen=True)
class Shapes:
    """Principal directions of lip motion `[SHAPES, lips]`, with unit deviation in total."""

    mean: np.ndarray
    axes: np.ndarray

    @staticmethod
    def of(faces: Sequence[np.ndarray]) -> "Shapes":
        """Computed from faces `[frames, channels]` of many items."""
        rows = np.concatenate([face[::5, JAW:][:, LIPS] for face in faces]).astype(np.float64)
        mean = rows.mean(0)
        values, axes = np.linalg.eigh(np.cov((rows - mean).T))
        axes, values = axes[:, ::-1][:, :SHAPES].T, values[::-1][:SHAPES]
        return Shapes(mean, axes / np.sqrt(values.sum()))

    def wanted(
        self, face: np.ndarray, phones: Sequence[Phone], count: int, delay: int, onset_delay: int | None = None
    ) -> np.ndarray:
        """Targets of token `i` of `count` for the moment `delay` tokens before it `[count, WIDTH]`; with `onset_delay`
        one more column for the onsets of accents `onset_delay` tokens before it."""
        times = np.maximum(np.arange(count) - delay, 0) / TOKEN_RATE
        frames, known = times * FRAME_RATE, np.arange(len(face))
        lips = np.stack([np.interp(frames, known, face[:, JAW + i]) for i in LIPS], 1)
        shapes = (lips - self.mean) @ self.axes.T
        opening = np.interp(frames, known, lip_opening(face))
        accents = np.zeros(count)
        for phone in phones:
            inside = (times >= phone.start) & (times < phone.end)
            accents[inside] = (0.0, 0.4, 1.0)[phone.stress]
        columns = [opening * OPENING, (opening <= CLOSED) * CLOSURE, accents * ACCENT]
        if onset_delay is not None:
            columns.append(onsets(phones, count, onset_delay) * ONSET)
        return np.concatenate([shapes, np.stack(columns, 1)], 1).astype(np.float32)


def onsets(phones: Sequence[Phone], count: int, delay: int) -> np.ndarray:
    """Proximity of each of `count` tokens to the onset of an accented vowel `delay` tokens before it: 0 to 1."""
    starts = np.array([phone.start for phone in phones if phone.stress == 2])
    if not len(starts):
        return np.zeros(count)
    times = (np.arange(count) - delay) / TOKEN_RATE
    away = np.abs(times[:, None] - starts).min(1)
    near: np.ndarray = np.exp(-0.5 * (away / ONSET_S) ** 2)
    return near


# Consecutive rows per training example, and examples per step.
STRETCH, BATCH = 128, 16
RATE, FINAL_RATE = 2e-3, 0.02


def train(
    items: Sequence[Heard],
    silence: Tensor,
    voices: Voices | None,
    plan: dict[str, Any],
    steps: int,
    seed: int,
    before: Listener | None = None,
) -> Listener:
    """Least squares on random stretches of the items, varied by other `voices`; from fresh weights, or from a
    listener `before` that may have fewer blocks and outputs."""
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    bands = items[0].features.shape[1]
    network = Listener(bands, plan["taps"], plan["widths"], plan.get("blocks"))
    # Mel features are normalised for distances; here each should have unit scale.
    unit = bands**0.5 / 2**0.5
    if before is not None:
        network.take(before)
        with torch.no_grad():
            network.layers[0].weight /= unit
    optimizer = torch.optim.AdamW(network.parameters(), RATE, weight_decay=1e-2)
    quick = has_bf16(torch.device("cpu"))
    bar = tqdm(range(steps), "listener")
    for step in bar:
        share = FINAL_RATE + (1 - FINAL_RATE) * 0.5 * (1 + np.cos(np.pi * step / steps))
        optimizer.param_groups[0]["lr"] = RATE * share
        parts = [_stretch(items[i], network, silence, rng) for i in rng.integers(len(items), size=BATCH)]
        rows, wanted, asked = (torch.stack(column).float() for column in zip(*parts, strict=True))
        rows = (voices.vary(rows) if voices else rows) * unit
        with torch.autocast("cpu", torch.bfloat16, enabled=quick):
            heard = network(rows + 0.1 * torch.randn_like(rows))
        loss = ((heard.float() - wanted).square().sum(2) * asked).sum() / asked.sum()
        optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimizer.step()
        if step % 20 == 0:
            bar.set_postfix(loss=f"{loss.item():.3f}")
    with torch.no_grad():
        network.layers[0].weight *= unit
    return network.eval()


def _stretch(item: Heard, network: Listener, silence: Tensor, rng: np.random.Generator) -> tuple[Tensor, ...]:
    """`STRETCH` consecutive rows with the rows they look back to, their targets, and a validity mask; silence precedes
    an item."""
    count = len(item.features)
    first = int(rng.integers(0, max(count - STRETCH, 0) + 1))
    rows = silence.to(item.features.dtype).repeat(network.reach + STRETCH, 1)
    wanted, asked = torch.zeros(STRETCH, item.wanted.shape[1]), torch.zeros(STRETCH)
    low, high = max(first - network.reach, 0), min(first + STRETCH, count)
    rows[low - first + network.reach : high - first + network.reach] = item.features[low:high]
    wanted[: high - first], asked[: high - first] = item.wanted[first:high], 1.0
    return rows, wanted, asked
