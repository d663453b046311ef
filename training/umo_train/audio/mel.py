"""The log-mel front end of small models (SPEC 2.1), as defined by the model file."""

from typing import Any

import numpy as np
import torch
from torch import Tensor

from umo_train.audio.listener import Listener, Voices
from umo_train.speech.utterance import SAMPLE_RATE

HOP = 320
# A window starts this many samples before its token's own: SPEC 2.1.
BEFORE = 80


class Mel:
    """Bands between 60 Hz and 7.6 kHz, equally wide on the mel scale; causal differences; normalised; then a network,
    if there is one."""

    def __init__(
        self, window: int, fft: int, bands: int, floor: float, deltas: int, network: dict[str, Any] | None = None
    ) -> None:
        self.sizes: dict[str, Any] = {"window": window, "fft": fft, "bands": bands, "floor": floor, "deltas": deltas}
        self.window = torch.hann_window(window, periodic=False)
        self.filters = filters(fft, bands)
        width = bands * (1 + deltas)
        self.mean, self.scale = torch.zeros(width), torch.ones(width)
        self.network: Listener | None = None
        if network:
            self.sizes["network"] = {key: network[key] for key in ("taps", "widths", "blocks") if key in network}
            self.network = Listener(width, **self.sizes["network"])

    @property
    def width(self) -> int:
        return self.network.widths[-1] if self.network else len(self.mean)

    @property
    def silence(self) -> Tensor:
        """The normalised feature of silence `[1, bands * (1 + deltas)]`."""
        row = torch.zeros(1, len(self.mean))
        row[:, : self.sizes["bands"]] = float(np.log(self.sizes["floor"]))
        return (row - self.mean) * self.scale

    @torch.no_grad()
    def features(self, samples: Tensor) -> Tensor:
        """Samples at 16 kHz `[n]` to features `[n // 320, width]`."""
        rows = self.bands(samples)
        return rows if self.network is None else self.network.heard(rows, self.silence)

    def bands(self, samples: Tensor) -> Tensor:
        """Samples at 16 kHz `[n]` to normalised log-mel features `[n // 320, bands * (1 + deltas)]`."""
        window, floor = self.sizes["window"], self.sizes["floor"]
        count = len(samples) // HOP
        padded = torch.nn.functional.pad(samples[: count * HOP], (BEFORE, 0))
        frames = padded.unfold(0, window, HOP)[:count] * self.window
        power = torch.fft.rfft(frames, n=self.sizes["fft"]).abs() ** 2
        out = [torch.log((power @ self.filters.T).clamp(min=floor))]
        before = torch.full((2, self.sizes["bands"]), float(np.log(floor)))
        for _ in range(self.sizes["deltas"]):
            longer = torch.cat([before, out[-1]])
            out.append((longer[2:] - longer[:-2]) / 2)
            before = torch.zeros_like(before)
        return (torch.cat(out, -1) - self.mean) * self.scale

    @property
    def voices(self) -> Voices:
        """Variation of rows of `bands` by other voices."""
        return Voices(self.mean, self.scale, self.sizes["bands"], float(np.log(self.sizes["floor"])))

    def fit(self, features: Tensor, delta_weight: float) -> None:
        """Sets mean and scale from unnormalised features: unit deviation per band, differences times `delta_weight`,
        all divided by the root of the number of bands."""
        bands = self.sizes["bands"]
        self.mean = features.mean(0)
        self.scale = 1 / features.std(0) / bands**0.5
        self.scale[bands:] *= delta_weight

    def tensors(self) -> dict[str, Tensor]:
        return {
            "audio.mel.window.weight": self.window,
            "audio.mel.filters.weight": self.filters,
            "audio.mel.mean": self.mean,
            "audio.mel.scale": self.scale,
            **(self.network.tensors() if self.network else {}),
        }

    def load(self, tensors: dict[str, Tensor]) -> None:
        self.mean, self.scale = tensors["audio.mel.mean"], tensors["audio.mel.scale"]
        if self.network:
            self.network.load(tensors)


def filters(fft: int, bands: int) -> Tensor:
    """Triangles on the mel scale `[bands, fft // 2 + 1]`, each of area 1 so that white noise is flat."""

    def mel(hertz: np.ndarray | float) -> np.ndarray:
        return 2595 * np.log10(1 + np.asarray(hertz) / 700)

    edges = 700 * (10 ** (np.linspace(mel(60.0), mel(7600.0), bands + 2) / 2595) - 1)
    bins = np.arange(fft // 2 + 1) * SAMPLE_RATE / fft
    low, middle, high = edges[:-2, None], edges[1:-1, None], edges[2:, None]
    triangles = np.clip(np.minimum((bins - low) / (middle - low), (high - bins) / (high - middle)), 0, None)
    # The narrowest may contain no bin: use the nearest one.
    empty = triangles.sum(1) == 0
    triangles[empty, np.abs(bins[None] - middle[empty]).argmin(1)] = 1
    return torch.from_numpy(triangles / triangles.sum(1, keepdims=True)).float()


def model_config(mel: Mel, units: int) -> dict[str, Any]:
    """`config.audio` of the model file."""
    rates = {"sample_rate": SAMPLE_RATE, "token_rate": SAMPLE_RATE // HOP}
    return {"kind": "mel", **rates, "units": units, "mel": mel.sizes}
