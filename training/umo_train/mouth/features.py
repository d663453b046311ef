"""Input features of the live mouth's network (SPEC 2.10): log-mel rows with level control."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from umo_train.audio.mel import filters
from umo_train.speech.utterance import FRAME_RATE, SAMPLE_RATE

# Natural logarithm of power per decibel.
DECIBEL = math.log(10.0) / 10.0
# Range of a row's values relative to the level.
LOWEST, HIGHEST = -12.0, 6.0
# Levels of a new stream and the minimum level of a voice, dB relative to full scale.
START_DB, START_NOISE_DB, LEAST_DB = -55.0, -90.0, -75.0
# Time constants of the levels in seconds.
ATTACK_S, RELEASE_S, FALL_S, RISE_S = 0.015, 1.5, 0.05, 3.0
# A sound this far above the noise may be a voice; with the ramp added, it counts in full.
STANDS_OUT, STANDS_OUT_RAMP = 6.0 * DECIBEL, 6.0 * DECIBEL
# Values of a row besides its bands: its energy and the noise relative to the level.
LEVEL_FEATURES = 2


@dataclass(frozen=True)
class Sizes:
    """`config.mouth` without the network's own settings."""

    window: int
    fft: int
    bands: int
    floor: float
    rows: int
    ahead: int
    taps: int


class Front:
    """Samples at 16 kHz to rows; frame `f` uses `taps` rows, up to row `f * rows + ahead`."""

    def __init__(self, sizes: Sizes) -> None:
        self.sizes = sizes
        self.window = torch.hann_window(sizes.window, periodic=False)
        self.filters = filters(sizes.fft, sizes.bands)
        self.row_rate = FRAME_RATE * sizes.rows

    @property
    def width(self) -> int:
        return self.sizes.bands + LEVEL_FEATURES

    def row_count(self, frames: int) -> int:
        """Number of rows for the given number of frames, including those before the stream."""
        return (frames - 1) * self.sizes.rows + self.sizes.taps

    @torch.no_grad()
    def rows(self, samples: np.ndarray) -> Tensor:
        """`[row_count(frames), bands + 2]` of the `frames` of a clip, not normalised."""
        sizes = self.sizes
        frames = len(samples) * FRAME_RATE // SAMPLE_RATE
        last = (frames - 1) * sizes.rows + sizes.ahead
        ends = torch.arange(1, last + 1) * SAMPLE_RATE // self.row_rate
        sound = torch.from_numpy(np.ascontiguousarray(samples, np.float32))
        padded = torch.nn.functional.pad(sound, (sizes.window, max(int(ends[-1]) - len(sound), 0)))
        windows = padded.unfold(0, sizes.window, 1)[ends] * self.window
        bands = torch.fft.rfft(windows, n=sizes.fft).abs().square() @ self.filters.T
        energies = torch.log(bands.sum(1).clamp(min=sizes.floor))
        voice, noise = self.levels(energies.numpy())
        logarithms = torch.cat([self._silence(), torch.log(bands.clamp(min=sizes.floor))])
        energies = torch.cat([self._silence()[:, 0], energies])
        values = torch.cat([logarithms, energies[:, None], noise[:, None]], 1) - voice[:, None]
        values = values.clamp(LOWEST, HIGHEST)
        before = sizes.taps - 1 - sizes.ahead
        return torch.cat([values[:1].expand(max(before, 0), -1), values[max(-before, 0) :]])

    def _silence(self) -> Tensor:
        return torch.full((1, self.sizes.bands), math.log(self.sizes.floor))

    def levels(self, energies: np.ndarray) -> tuple[Tensor, Tensor]:
        """Levels of the voice and of the noise after each row, and before the first `[rows + 1]`."""
        full_scale = math.log(float(self.filters.double().sum() * self.window.double().square().sum()))
        attack, release, fall, rise = (
            1.0 - math.exp(-1.0 / (self.row_rate * seconds)) for seconds in (ATTACK_S, RELEASE_S, FALL_S, RISE_S)
        )
        voice, noise, least = (full_scale + db * DECIBEL for db in (START_DB, START_NOISE_DB, LEAST_DB))
        out = np.empty((2, len(energies) + 1))
        out[:, 0] = voice, noise
        for i, energy in enumerate(energies.tolist(), 1):
            above = energy - voice
            stands_out = min(max((energy - noise - STANDS_OUT) / STANDS_OUT_RAMP, 0.0), 1.0)
            voice = max(voice + (attack if above > 0.0 else release * stands_out) * above, least)
            noise += (rise if energy > noise else fall) * (energy - noise)
            out[:, i] = voice, noise
        both = torch.from_numpy(out).float()
        return both[0], both[1]

    def tensors(self) -> dict[str, Tensor]:
        """Tensors as in the model file."""
        return {"mouth.window.weight": self.window, "mouth.filters.weight": self.filters}


def sizes_of(plan: dict[str, Any]) -> Sizes:
    return Sizes(**{name: plan[name] for name in Sizes.__dataclass_fields__})
