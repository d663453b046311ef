"""The interpolation network on `torch.nn.TransformerEncoderLayer`."""

import torch
from torch import Tensor, nn

from layout import MASK, PARTS, Config
from margin import Margin

KEYFRAME, MASKED, LAST_VALID = range(3)


class Interpolation(nn.Module):
    """Codes of four parts with 256 where masked, to logits and filled codes."""

    def __init__(self, config: Config, tensors: dict[str, Tensor]) -> None:
        super().__init__()
        sizes = config["interp"]
        self.stride: int = config["keyframe_stride"]
        d = sizes["d_model"]

        def layers(count: int) -> nn.ModuleList:
            return nn.ModuleList(
                [
                    nn.TransformerEncoderLayer(
                        d, sizes["num_heads"], sizes["d_ff"], 0.0, "gelu", batch_first=True, norm_first=True
                    )
                    for _ in range(count)
                ]
            )

        self.embed = nn.ModuleDict({part: nn.Embedding(MASK + 1, d) for part in PARTS})
        self.frame_type = nn.Embedding(3, d)
        self.position = nn.Embedding(sizes["max_frames"], d)
        self.temporal = layers(sizes["temporal_layers"])
        self.part = layers(sizes["part_layers"])
        self.norm = nn.LayerNorm(d)
        self.head = nn.ModuleDict({part: nn.Linear(d, MASK) for part in PARTS})
        self.load_state_dict({k.removeprefix("interp."): t for k, t in tensors.items() if k.startswith("interp.")})
        self.eval()

    def forward(self, codes: dict[str, Tensor], margin: Margin) -> tuple[dict[str, Tensor], dict[str, Tensor]]:
        masked = codes["face"] == MASK
        assert all(torch.equal(codes[part] == MASK, masked) for part in PARTS), "all parts have the same mask"
        frame = torch.arange(len(masked))
        kind = torch.where(frame % self.stride == 0, KEYFRAME, LAST_VALID)
        kind = torch.where(masked, MASKED, kind)
        embedded = torch.stack([self.embed[part](codes[part]) for part in PARTS], 1)
        hidden = (embedded.sum(1) + self.frame_type(kind) + self.position(frame))[None]
        for layer in self.temporal:
            hidden = layer(hidden)
        hidden = hidden[0][:, None] + embedded
        for layer in self.part:
            hidden = layer(hidden)
        hidden = self.norm(hidden)
        logits, filled = {}, {}
        for i, part in enumerate(PARTS):
            logits[part] = self.head[part](hidden[:, i])
            margin.largest(logits[part][masked])
            filled[part] = torch.where(masked, logits[part].argmax(-1), codes[part])
        return logits, filled
