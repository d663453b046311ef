"""Loads a model file into the implementations that its outputs are compared with."""

import torch
from torch import Tensor, nn

from audio import front_end
from interp import Interpolation
from layout import Config
from lm import LanguageModel
from motion import Motion
from mouth import Mouth


class Reference(nn.Module):
    """Every stage of a model, with the values stored in its file."""

    centroids: Tensor

    def __init__(self, config: Config, tensors: dict[str, Tensor], *, dense: bool) -> None:
        super().__init__()
        self.audio = front_end(config, tensors)
        self.register_buffer("centroids", tensors["audio.kmeans.centroids"])
        self.lm = LanguageModel(config, tensors, dense=dense)
        self.interp = Interpolation(config, tensors)
        self.motion = Motion(config, tensors)
        self.mouth = Mouth(config, tensors) if "mouth" in config else None

    @property
    def dtype(self) -> torch.dtype:
        return self.centroids.dtype
