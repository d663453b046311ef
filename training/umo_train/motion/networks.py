"""The motion networks: VQ-VAEs of four parts and the root auto-encoder, numbered as in EMAGE and Language of Motion."""

import torch
from torch import Tensor, nn


def _conv(inputs: int, outputs: int) -> nn.Conv1d:
    return nn.Conv1d(inputs, outputs, 3, padding=1)


class Residual(nn.Module):
    def __init__(self, width: int) -> None:
        super().__init__()
        self.model = nn.Sequential(_conv(width, width), nn.LeakyReLU(0.2), _conv(width, width))

    def forward(self, x: Tensor) -> Tensor:
        return x + self.model(x)


class Encoder(nn.Module):
    """`[b, channels, t]` to `[b, width, t]`: each layer is a convolution, its activation and a residual block."""

    def __init__(self, width: int, channels: int, layers: int) -> None:
        super().__init__()
        inputs = [channels] + [width] * (layers - 1)
        self.main = nn.Sequential(*[m for n in inputs for m in (_conv(n, width), nn.LeakyReLU(0.2), Residual(width))])

    def forward(self, x: Tensor) -> Tensor:
        return self.main(x)


class Decoder(nn.Module):
    """`[b, width, t]` to `[b, channels, t]`: two residual blocks, `layers` convolutions of which the last changes to
    the output width, and one more at that width."""

    def __init__(self, width: int, channels: int, layers: int) -> None:
        super().__init__()
        outputs = [width] * (layers - 1) + [channels]
        widen = [m for n in outputs for m in (_conv(width, n), nn.LeakyReLU(0.2))]
        self.main = nn.Sequential(Residual(width), Residual(width), *widen, _conv(channels, channels))

    def forward(self, x: Tensor) -> Tensor:
        return self.main(x)


class Codebook(nn.Module):
    """Nearest of `codes` vectors, updated towards their rows; unused codes are reset."""

    # Decay of the running means, and the running count per batch below which a code is unused.
    DECAY, UNUSED = 0.99, 0.1

    def __init__(self, codes: int, width: int) -> None:
        super().__init__()
        self.embedding = nn.Embedding(codes, width)
        self.embedding.weight.requires_grad_(False)
        self.register_buffer("count", torch.zeros(codes))
        self.register_buffer("total", torch.zeros(codes, width))

    def nearest(self, rows: Tensor) -> Tensor:
        """`[n, width]` to codes `[n]`, by Euclidean distance."""
        table = self.embedding.weight
        return (table.pow(2).sum(1) - 2 * rows @ table.T).argmin(1)

    @torch.no_grad()
    def follow(self, rows: Tensor, codes: Tensor) -> None:
        """One step of the running means, and new positions for unused codes among the rows."""
        hits = torch.bincount(codes, minlength=len(self.count)).float()
        sums = torch.zeros_like(self.total).index_add_(0, codes, rows)
        self.count.mul_(self.DECAY).add_(hits, alpha=1 - self.DECAY)
        self.total.mul_(self.DECAY).add_(sums, alpha=1 - self.DECAY)
        used = self.count > self.UNUSED
        weight = self.embedding.weight
        weight[used] = self.total[used] / self.count[used, None]
        unused = (~used).nonzero()[:, 0]
        if len(unused):
            places = rows[torch.randint(len(rows), (len(unused),), device=rows.device)]
            weight[unused] = places
            self.count[unused], self.total[unused] = 1.0, places


class VqVae(nn.Module):
    """One part's tokenizer. Channels are normalised inside; `folded` folds this into the weights for the model file."""

    def __init__(self, width: int, channels: int, layers: int, codes: int) -> None:
        super().__init__()
        self.encoder, self.decoder = Encoder(width, channels, layers), Decoder(width, channels, layers)
        self.quantizer = Codebook(codes, width)
        self.register_buffer("mean", torch.zeros(channels))
        self.register_buffer("scale", torch.ones(channels))

    def latents(self, motion: Tensor) -> Tensor:
        """Motion `[b, t, channels]` to `[b, t, width]`."""
        return self.encoder(((motion - self.mean) / self.scale).transpose(1, 2)).transpose(1, 2)

    def codes(self, motion: Tensor) -> Tensor:
        """`[b, t, channels]` to codes `[b, t]`."""
        z = self.latents(motion)
        return self.quantizer.nearest(z.flatten(0, 1)).view(z.shape[:2])

    def decode(self, vectors: Tensor) -> Tensor:
        """Code vectors `[b, t, width]` to motion `[b, t, channels]`."""
        return self.decoder(vectors.transpose(1, 2)).transpose(1, 2) * self.scale + self.mean

    def motion(self, codes: Tensor) -> Tensor:
        return self.decode(self.quantizer.embedding(codes))

    def folded(self) -> dict[str, Tensor]:
        """Weights for unnormalised channels. Only the encoder's first and last frames differ: there the zero padding
        stands for zeros, in training for the mean."""
        state = {k: v.clone() for k, v in self.state_dict().items() if k.startswith(("encoder.", "decoder."))}
        first = state["encoder.main.0.weight"] / self.scale[None, :, None]
        state["encoder.main.0.bias"] -= (first * self.mean[None, :, None]).sum((1, 2))
        state["encoder.main.0.weight"] = first
        last = f"decoder.main.{len(self.decoder.main) - 1}"
        state[f"{last}.weight"] *= self.scale[:, None, None]
        state[f"{last}.bias"] = state[f"{last}.bias"] * self.scale + self.mean
        state["quantizer.embedding.weight"] = self.quantizer.embedding.weight.clone()
        return state


class RootNetwork(nn.Module):
    """Lower-body channels without velocity, to the same with velocity x and z, and the height at channel 55."""

    def __init__(self, width: int, channels: int, layers: int) -> None:
        super().__init__()
        self.encoder, self.decoder = Encoder(width, channels, layers), Decoder(width, channels, layers)

    def forward(self, lower: Tensor) -> Tensor:
        """`[b, t, 61]` to `[b, t, 61]`."""
        return self.decoder(self.encoder(lower.transpose(1, 2))).transpose(1, 2)
