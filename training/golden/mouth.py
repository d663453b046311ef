"""The live mouth: rows with torch's FFT, level control in plain Python, `nn.Conv1d` over whole clips."""

import math

import torch
from torch import Tensor, nn

from layout import Config
from margin import Margin

DECIBEL = math.log(10.0) / 10.0
LOWEST, HIGHEST = -12.0, 6.0
OPENS, SHUTS, HOLD = 0.6, 0.4, 6
OPENING, SHUTTING = 0.5, 0.125


class Mouth(nn.Module):
    """Samples `[n]` to channels `[frames, channels]` and the opening of the gate `[frames]`."""

    window: Tensor
    filters: Tensor
    mean: Tensor
    scale: Tensor
    rest: Tensor

    def __init__(self, config: Config, tensors: dict[str, Tensor]) -> None:
        super().__init__()
        self.sizes: Config = config["mouth"]
        self.sample_rate: int = config["audio"]["sample_rate"]
        self.frame_rate: int = config["frame_rate"]
        self.row_rate = self.frame_rate * self.sizes["rows"]
        for name in ("window.weight", "filters.weight", "mean", "scale", "rest"):
            self.register_buffer(name.split(".")[0], tensors[f"mouth.{name}"])

        def conv(name: str, **about: int) -> nn.Conv1d:
            weight = tensors[f"mouth.{name}.weight"]
            layer = nn.Conv1d(weight.shape[1], weight.shape[0], weight.shape[2], **about)
            layer.load_state_dict({"weight": weight, "bias": tensors[f"mouth.{name}.bias"]})
            return layer

        self.input = conv("input", stride=self.sizes["rows"])
        blocks = enumerate(self.sizes["dilations"])
        self.blocks = nn.ModuleList(
            nn.ModuleList([conv(f"blocks.{i}.0", dilation=dilation), conv(f"blocks.{i}.1")]) for i, dilation in blocks
        )
        self.head = conv("head")

    @torch.no_grad()
    def forward(self, audio: Tensor, margin: Margin) -> tuple[Tensor, Tensor]:
        frames = len(audio) * self.frame_rate // self.sample_rate
        outputs = self.network(self.rows(audio, frames), frames)
        gate = self.gate(outputs[:, -1], margin)[:, None]
        channels = self.rest + gate * (outputs[:, :-1].clamp(0.0, 1.0) - self.rest)
        return channels.clamp(0.0, 1.0), gate[:, 0]

    def rows(self, audio: Tensor, frames: int) -> Tensor:
        """Rows from 0 to the last frame's newest, `[rows, bands + 2]`; row 0 and earlier ones are silence."""
        count = (frames - 1) * self.sizes["rows"] + self.sizes["ahead"]
        ends = [row * self.sample_rate // self.row_rate for row in range(count + 1)]
        window = self.sizes["window"]
        samples = audio.to(self.window.dtype)
        padded = nn.functional.pad(samples, (window, max(ends[-1] - len(samples), 0)))
        windows = torch.stack([padded[end : end + window] for end in ends[1:]]) * self.window
        bands = torch.fft.rfft(windows, n=self.sizes["fft"]).abs() ** 2 @ self.filters.T
        floor = self.sizes["floor"]
        energies = torch.log(bands.sum(1).clamp(min=floor))
        silence = math.log(floor)
        logarithms = torch.cat([torch.full_like(bands[:1], silence), torch.log(bands.clamp(min=floor))])
        energies = torch.cat([torch.full_like(energies[:1], silence), energies])
        voice, noise = self.levels(energies[1:].tolist())
        values = torch.cat([logarithms, energies[:, None], noise[:, None]], 1) - voice[:, None]
        return (values.clamp(LOWEST, HIGHEST) - self.mean) * self.scale

    def levels(self, energies: list[float]) -> tuple[Tensor, Tensor]:
        """Levels of voice and noise after each row, starting with row 0."""
        full_scale = math.log(float(self.filters.double().sum() * self.window.double().square().sum()))

        def factor(seconds: float) -> float:
            return 1.0 - math.exp(-1.0 / (self.row_rate * seconds))

        attack, release, fall, rise = factor(0.015), factor(1.5), factor(0.05), factor(3.0)
        voice, noise = full_scale - 55.0 * DECIBEL, full_scale - 90.0 * DECIBEL
        out = [(voice, noise)]
        for energy in energies:
            above = energy - voice
            stands_out = min(max((energy - noise - 6.0 * DECIBEL) / (6.0 * DECIBEL), 0.0), 1.0)
            voice += (attack if above > 0.0 else release * stands_out) * above
            voice = max(voice, full_scale - 75.0 * DECIBEL)
            noise += (rise if energy > noise else fall) * (energy - noise)
            out.append((voice, noise))
        both = torch.tensor(out, dtype=self.mean.dtype)
        return both[:, 0], both[:, 1]

    def network(self, rows: Tensor, frames: int) -> Tensor:
        """Outputs `[frames, channels + 1]`: frame `f`'s newest row is `f * rows + ahead`."""
        first = self.sizes["ahead"] - self.sizes["taps"] + 1
        heard = torch.cat([rows[:1].expand(max(-first, 0), -1), rows[max(first, 0) :]])
        x = self.input(heard.T[None]).relu()
        assert x.shape[2] == frames
        for dilated, pointwise in self.blocks:
            before = (self.sizes["kernel"] - 1) * dilated.dilation[0]
            x = x + pointwise(dilated(nn.functional.pad(x, (before, 0))).relu())
        return self.head(x)[0].T

    def gate(self, odds: Tensor, margin: Margin) -> Tensor:
        """Weight of the network's output."""
        opened, speaks, without, out = 0.0, False, 0, []
        for probability in torch.sigmoid(odds).tolist():
            margin.smallest = min(margin.smallest, abs(probability - OPENS), abs(probability - SHUTS))
            without = min(without + 1, HOLD) if probability < SHUTS else 0
            speaks = probability >= OPENS or (speaks and without < HOLD)
            opened = min(opened + OPENING, 1.0) if speaks else max(opened - SHUTTING, 0.0)
            out.append(opened)
        return torch.tensor(out, dtype=odds.dtype)
