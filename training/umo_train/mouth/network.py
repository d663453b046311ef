"""The live mouth's network (SPEC 2.10): causal convolutions at the frame rate."""

from collections.abc import Sequence

import torch
from torch import Tensor, nn


class MouthNetwork(nn.Module):
    """Rows `[batch, rows, features]` to channels and the log-odds of a voice `[batch, frames, channels + 1]`.

    With `behind` there is a second head from the same frames: the mouth of the frame `behind` frames before."""

    mean: Tensor
    scale: Tensor

    def __init__(
        self,
        features: int,
        outputs: int,
        *,
        rows: int,
        taps: int,
        width: int,
        kernel: int,
        dilations: Sequence[int],
        behind: int = 0,
    ) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(features))
        self.register_buffer("scale", torch.ones(features))
        self.input = nn.Conv1d(features, width, taps, stride=rows)
        self.blocks = nn.ModuleList(
            nn.ModuleList([nn.Conv1d(width, width, kernel, dilation=dilation), nn.Conv1d(width, width, 1)])
            for dilation in dilations
        )
        self.head = nn.Conv1d(width, outputs + 1, 1)
        self.behind = behind
        if behind:
            self.later = nn.Conv1d(width, outputs + 1, 1)

    def forward(self, rows: Tensor) -> Tensor:
        return self.head(self.heard(rows)).transpose(1, 2)

    def both(self, rows: Tensor) -> tuple[Tensor, Tensor]:
        """Outputs of both heads; the second's row `t` is of frame `t - behind`."""
        x = self.heard(rows)
        return self.head(x).transpose(1, 2), self.later(x).transpose(1, 2)

    def heard(self, rows: Tensor) -> Tensor:
        """Input of both heads `[batch, width, frames]`."""
        x = self.input(((rows - self.mean) * self.scale).transpose(1, 2)).relu()
        for dilated, pointwise in self.blocks:
            before = (dilated.kernel_size[0] - 1) * dilated.dilation[0]
            x = x + pointwise(dilated(nn.functional.pad(x, (before, 0))).relu())
        return x

    def tensors(self, dtype: torch.dtype) -> dict[str, Tensor]:
        """Tensors as in the model file: weights in `dtype`, vectors in f32."""
        return {
            f"mouth.{name}": tensor.detach().to(dtype if tensor.dim() > 1 else torch.float32).contiguous()
            for name, tensor in self.state_dict().items()
        }
