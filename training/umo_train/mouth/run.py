"""Runs a trained mouth on whole clips, as the engine computes it on streams."""

from pathlib import Path
from typing import Any

import numpy as np
import torch

from umo_train.mouth import part
from umo_train.mouth.features import Front, sizes_of
from umo_train.mouth.gate import gate, gated
from umo_train.mouth.network import MouthNetwork
from umo_train.skeleton import ARKIT
from umo_train.speech.utterance import FRAME_RATE, SAMPLE_RATE


class Mouth:
    """Contents of `run/mouth.safetensors`."""

    def __init__(self, about: dict[str, Any], tensors: dict[str, torch.Tensor]) -> None:
        self.front = Front(sizes_of(about))
        self.front.window = tensors["mouth.window.weight"].float()
        self.front.filters = tensors["mouth.filters.weight"].float()
        self.names: list[str] = about["channels"]
        self.rest = tensors["mouth.rest"].float().numpy()
        self.behind: int = about.get("behind", 0)
        sizes = {name: about[name] for name in ("rows", "taps", "width", "kernel", "dilations")}
        self.network = MouthNetwork(self.front.width, len(self.names), **sizes, behind=self.behind).eval()
        self.network.load_state_dict({name: tensors[f"mouth.{name}"].float() for name in self.network.state_dict()})

    @staticmethod
    def read(path: Path) -> "Mouth":
        return Mouth(*part.read(path))

    @torch.no_grad()
    def outputs(self, samples: np.ndarray) -> np.ndarray:
        """The network's own outputs `[frames, channels + 1]`."""
        return self.network(self.front.rows(samples)[None])[0].numpy()

    @torch.no_grad()
    def later(self, samples: np.ndarray) -> np.ndarray:
        """Channels of the second head `[frames, channels]`, gated; each from `behind` further frames of sound."""
        front = self.front
        silence = np.zeros(-(-self.behind * SAMPLE_RATE // FRAME_RATE), np.float32)
        count = len(samples) * FRAME_RATE // SAMPLE_RATE
        outputs = self.network.both(front.rows(np.concatenate([samples, silence]))[None])[1][0].numpy()
        return gated(outputs, self.rest)[self.behind :][:count]

    def __call__(self, samples: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Samples at 16 kHz to the face's channels `[frames, 58]`, of which only the mouth's are set, and the gate."""
        outputs = self.outputs(samples)
        face = np.zeros((len(outputs), 6 + len(ARKIT)))
        face[:, [6 + ARKIT.index(name) for name in self.names]] = gated(outputs, self.rest)
        return face, gate(outputs[:, -1])
