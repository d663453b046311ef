"""The interpolation network (SPEC 2.6) on PyTorch's own encoder layers."""

from typing import Any

import torch
from torch import Tensor, nn

from umo_train.skeleton import PARTS

KEYFRAME, MASKED, LAST_VALID = range(3)


def _layers(count: int, sizes: dict[str, Any]) -> nn.ModuleList:
    return nn.ModuleList(
        nn.TransformerEncoderLayer(
            sizes["d_model"], sizes["num_heads"], sizes["d_ff"], 0.0, "gelu", batch_first=True, norm_first=True
        )
        for _ in range(count)
    )


class Interpolation(nn.Module):
    """Codes of four parts, `codes` where masked, to logits of every frame."""

    def __init__(self, config: dict[str, Any]) -> None:
        super().__init__()
        sizes = config["interp"]
        self.stride: int = config["keyframe_stride"]
        self.codes: int = config["vq"]["codes"]
        d = sizes["d_model"]
        self.embed = nn.ModuleDict({part: nn.Embedding(self.codes + 1, d) for part in PARTS})
        self.frame_type = nn.Embedding(3, d)
        self.position = nn.Embedding(sizes["max_frames"], d)
        self.temporal = _layers(sizes["temporal_layers"], sizes)
        self.part = _layers(sizes["part_layers"], sizes)
        self.norm = nn.LayerNorm(d)
        self.head = nn.ModuleDict({part: nn.Linear(d, self.codes) for part in PARTS})
        for table in (*self.embed.values(), self.frame_type, self.position):
            nn.init.normal_(table.weight, std=d**-0.5)

    @torch.no_grad()
    def know(self, codebooks: dict[str, Tensor]) -> None:
        """Starts from what codes are instead of from nothing: each part's code vectors `[codes, width]` along their main
        directions in a quarter of the width of its own, in tables and heads, and waves for positions."""
        d = self.position.weight.shape[1]
        width = d // len(PARTS)
        for i, part in enumerate(PARTS):
            centred = codebooks[part] - codebooks[part].mean(0)
            axes = torch.linalg.svd(centred, full_matrices=False).Vh[:width]
            vectors = centred @ axes.T
            vectors = vectors / vectors.square().sum(1).mean().sqrt()
            own = slice(i * width, i * width + len(axes))
            self.embed[part].weight[:, i * width : (i + 1) * width] = 0.0
            self.embed[part].weight[: self.codes, own] = vectors
            head = self.head[part]
            head.weight[:, own] = 8 * vectors / d**0.5
            head.bias.copy_(-4 * vectors.square().sum(1))
        places = torch.arange(len(self.position.weight))[:, None]
        turns = places / 10000 ** (torch.arange(0, d, 2) / d)
        self.position.weight.copy_(torch.cat([turns.sin(), turns.cos()], 1)[:, :d] * (2 / d) ** 0.5)

    def forward(self, codes: Tensor, padding: Tensor | None = None) -> Tensor:
        """`[b, 4, t]` codes and which frames are padding `[b, t]`, to `[b, 4, t, codes]`."""
        frames = torch.arange(codes.shape[-1], device=codes.device)
        masked = codes[:, 0] == self.codes
        kind = torch.where(frames % self.stride == 0, KEYFRAME, LAST_VALID).expand_as(masked)
        kind = torch.where(masked, MASKED, kind)
        embedded = torch.stack([self.embed[part](codes[:, i]) for i, part in enumerate(PARTS)], 2)
        hidden = embedded.sum(2) + self.frame_type(kind) + self.position(frames)
        for layer in self.temporal:
            hidden = layer(hidden, src_key_padding_mask=padding)
        b, t, d = hidden.shape
        tokens = (hidden[:, :, None] + embedded).view(b * t, len(PARTS), d)
        for layer in self.part:
            tokens = layer(tokens)
        tokens = self.norm(tokens).view(b, t, len(PARTS), d)
        return torch.stack([self.head[part](tokens[:, :, i]) for i, part in enumerate(PARTS)], 1)
