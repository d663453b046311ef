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
    """Codes of four parts, `codes` if masked, to logits of every frame."""

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
        """Initialises the network to linear interpolation of code vectors.

        Each part's code vectors `[codes, width]`, along their principal directions, occupy three quarters of a quarter
        of the width, in tables and heads. The rest holds waves of the frame index and a mark for masked frames. With
        these the first layer attends to the keyframes around a frame, weighted by distance, and every head finds the
        code nearest to the result. The other layers initially contribute little.
        """
        d = self.position.weight.shape[1]
        slot = d // len(PARTS)
        width = slot * 3 // 4
        own = [range(i * slot, i * slot + width) for i in range(len(PARTS))]
        rest = [at for i in range(len(PARTS)) for at in range(i * slot + width, (i + 1) * slot)]
        mark, waves = rest[0], rest[1:]
        first = self.temporal[0]
        attention = first.self_attn
        each = d // attention.num_heads
        pairs = min(len(waves) // 2, (each - 1) // 2)
        sines, cosines = waves[:pairs], waves[pairs : 2 * pairs]

        for table in (*self.embed.values(), self.frame_type, self.position):
            table.weight.zero_()
        # Lengths of about 1: each part's vector, all waves together, the mark.
        self.frame_type.weight[MASKED, mark] = 1.0
        frequencies = 1.5 * 0.8 ** torch.arange(pairs)
        turns = torch.arange(len(self.position.weight))[:, None] * frequencies
        self.position.weight[:, sines] = turns.sin() / pairs**0.5
        self.position.weight[:, cosines] = turns.cos() / pairs**0.5
        masked, keyframe, filled = (2 / d) ** 0.5, (5 / d) ** 0.5, (6 / d) ** 0.5
        for i, part in enumerate(PARTS):
            centred = codebooks[part] - codebooks[part].mean(0)
            axes = torch.linalg.svd(centred, full_matrices=False).Vh[:width]
            vectors = centred @ axes.T
            vectors = vectors / vectors.square().sum(1).mean().sqrt()
            at = own[i][: len(axes)]
            self.embed[part].weight[: self.codes, at] = vectors
            head = self.head[part]
            head.weight.zero_()
            head.weight[:, at] = 8 * filled * vectors
            head.bias.copy_(-4 * vectors.square().sum(1))

        # Attention weights fall with the squared distance, so that the two keyframes around a frame count by proximity.
        apart = torch.arange(len(self.position.weight))
        wanted = (-2.0 * apart.square() / self.stride**2).clamp(min=-12)
        basis = torch.cat([(apart[:, None] * frequencies).cos(), torch.ones(len(apart), 1)], 1)
        near = (apart[:, None] <= 3 * self.stride).float() * 3 + 1
        shares = torch.linalg.lstsq(basis * near, wanted[:, None] * near).solution[:pairs, 0]
        q, k, v = attention.in_proj_weight.view(3, d, d)
        attention.in_proj_weight.zero_()
        attention.in_proj_bias.zero_()
        gain = pairs * masked * keyframe * each**0.5
        for head in range(attention.num_heads):
            for n in range(pairs):
                for row, column in ((head * each + n, sines[n]), (head * each + pairs + n, cosines[n])):
                    q[row, column] = gain * shares[n]
                    k[row, column] = 1.0
            # Masked frames are never attended to.
            row = head * each + 2 * pairs
            attention.in_proj_bias[row] = each**0.5
            k[row, mark] = -15 * masked
        for at in own:
            v[at, at] = keyframe
        attention.out_proj.weight.copy_(torch.eye(d))
        attention.out_proj.bias.zero_()
        for layer in (*self.temporal, *self.part):
            layer.linear2.weight.mul_(0.1)
            if layer is not first:
                layer.self_attn.out_proj.weight.mul_(0.1)

    def forward(self, codes: Tensor, padding: Tensor | None = None) -> Tensor:
        """`[b, 4, t]` codes and padding mask `[b, t]`, to `[b, 4, t, codes]`."""
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
