"""Tokenizers with residual codes: a convolutional auto-encoder with a codebook per level (SPEC 2.12)."""

import torch
from torch import Tensor, nn

from umo_train.frames.parts import Part
from umo_train.motion.networks import Codebook, Decoder, Encoder


class ResidualVqVae(nn.Module):
    """One part's tokenizer. Channels are normalised inside; `folded` folds this into the weights for the model file."""

    def __init__(self, part: Part, channels: int) -> None:
        super().__init__()
        self.encoder = Encoder(part.width, channels, part.layers)
        self.decoder = Decoder(part.width, channels, part.layers)
        self.levels = nn.ModuleList(Codebook(part.codes, part.width) for _ in range(part.levels))
        self.register_buffer("mean", torch.zeros(channels))
        self.register_buffer("scale", torch.ones(channels))

    def latents(self, motion: Tensor) -> Tensor:
        """Motion `[b, t, channels]` to `[b, t, width]`."""
        return self.encoder(((motion - self.mean) / self.scale).transpose(1, 2)).transpose(1, 2)

    @torch.no_grad()
    def quantized(self, rows: Tensor, used: Tensor | None = None) -> tuple[Tensor, Tensor, Tensor]:
        """`[n, width]` to codes `[n, levels]`, their vectors `[n, levels, width]`, and the target of each level.

        With `used` `[n]`, a row's levels from that number up have no vector, as if not yet decoded.
        """
        left, codes, vectors, asked = rows, [], [], []
        for i, level in enumerate(self.levels):
            chosen = level.nearest(left)
            vector = level.embedding(chosen)
            asked.append(left)
            codes.append(chosen)
            vectors.append(vector if used is None else vector * (used > i)[:, None])
            left = left - vector
        return torch.stack(codes, 1), torch.stack(vectors, 1), torch.stack(asked, 1)

    def codes(self, motion: Tensor) -> Tensor:
        """`[b, t, channels]` to codes `[b, t, levels]`."""
        z = self.latents(motion)
        return self.quantized(z.flatten(0, 1))[0].unflatten(0, z.shape[:2])

    def vectors(self, codes: Tensor) -> Tensor:
        """Codes `[..., levels]`, or the first ones, to their sum `[..., width]`, levels ascending."""
        out = self.levels[0].embedding(codes[..., 0])
        for i in range(1, codes.shape[-1]):
            out = out + self.levels[i].embedding(codes[..., i])
        return out

    def decode(self, vectors: Tensor) -> Tensor:
        """Vectors `[b, t, width]` to motion `[b, t, channels]`."""
        return self.decoder(vectors.transpose(1, 2)).transpose(1, 2) * self.scale + self.mean

    def motion(self, codes: Tensor) -> Tensor:
        """Codes `[b, t, levels]`, or the first levels, to motion `[b, t, channels]`."""
        return self.decode(self.vectors(codes))

    def table(self) -> Tensor:
        """All levels' vectors, `[levels * codes, width]`, as in the model file."""
        return torch.cat([level.embedding.weight for level in self.levels]).detach()

    @torch.no_grad()
    def unfold(self, mean: Tensor, scale: Tensor) -> None:
        """Converts weights from `folded` back to normalised channels with these statistics."""
        self.mean.copy_(mean)
        self.scale.copy_(scale)
        first, last = self.encoder.main[0], self.decoder.main[-1]
        first.bias += (first.weight * mean[None, :, None]).sum((1, 2))
        first.weight *= scale[None, :, None]
        last.weight /= scale[:, None, None]
        last.bias.copy_((last.bias - mean) / scale)

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
        return state | {"quantizer.embedding.weight": self.table()}
