"""T5 with mixtures of experts in the model file's format: Hugging Face's names and arithmetic with less memory traffic.

Hugging Face's own module spends most of a step on a CPU in small element-wise operations. This one loads its
checkpoints and computes the same (`tests/test_lm_model.py`).
"""

import math
from typing import Any

import torch
from torch import Tensor, nn

from umo_train.lm.moe import FeedForward, MixtureOfExperts

Config = dict[str, Any]


# For positions of a fresh model: audio tokens per keyframe, and history keyframes before the first predicted one.
TOKENS_PER_KEYFRAME, KEYFRAMES_BEFORE = 5, 10


def _wave(place: Tensor, index: int) -> Tensor:
    """Scores by position in audio tokens: pairs of waves a quarter period apart, of 24 tokens length, then 96, …"""
    period = 24.0 * 4.0 ** (index // 2)
    return 1.5 * torch.cos(2 * math.pi * place / period + math.pi / 2 * (index % 2))


class _RmsNorm(torch.autograd.Function):
    """PyTorch's own consists of a dozen operations of mixed types, which take several times as long on a CPU."""

    @staticmethod
    def forward(ctx: Any, x: Tensor, weight: Tensor, eps: float) -> Tensor:
        wide = x.float()
        scale = torch.rsqrt(wide.square().mean(-1, keepdim=True) + eps)
        normed = (wide * scale).to(x.dtype)
        ctx.save_for_backward(normed, scale, weight)
        return normed * weight.to(x.dtype)

    @staticmethod
    def backward(ctx: Any, grad: Tensor) -> tuple[Tensor, Tensor, None]:
        normed, scale, weight = ctx.saved_tensors
        inner, wide = (grad * weight.to(grad.dtype)).float(), normed.float()
        along = (inner * wide).mean(-1, keepdim=True)
        of_weight = (grad.float() * wide).flatten(0, -2).sum(0)
        return ((inner - wide * along) * scale).to(normed.dtype), of_weight.to(weight.dtype), None


class RmsNorm(nn.Module):
    def __init__(self, width: int, eps: float) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.ones(width))
        self.eps = eps

    def forward(self, x: Tensor) -> Tensor:
        if x.is_cuda:
            return nn.functional.rms_norm(x, self.weight.shape, self.weight.to(x.dtype), self.eps)
        return _RmsNorm.apply(x, self.weight, self.eps)


class Attention(nn.Module):
    """Multi-head attention without scaling, plus a bias on the scores."""

    def __init__(self, lm: Config, *, biased: bool) -> None:
        super().__init__()
        d, inner = lm["d_model"], lm["num_heads"] * lm["d_kv"]
        self.heads = lm["num_heads"]
        self.q, self.k, self.v = (nn.Linear(d, inner, bias=False) for _ in range(3))
        self.o = nn.Linear(inner, d, bias=False)
        nn.init.normal_(self.q.weight, std=(d * lm["d_kv"]) ** -0.5)
        nn.init.normal_(self.k.weight, std=d**-0.5)
        nn.init.normal_(self.v.weight, std=d**-0.5)
        nn.init.normal_(self.o.weight, std=inner**-0.5)
        if biased:
            self.relative_attention_bias = nn.Embedding(lm["relative_attention_num_buckets"], self.heads)

    def _split(self, x: Tensor) -> Tensor:
        """`[b, n, h * w]` to `[b * h, n, w]`."""
        b, n, _ = x.shape
        return x.view(b, n, self.heads, -1).transpose(1, 2).reshape(b * self.heads, n, -1)

    def forward(self, x: Tensor, keys: Tensor, bias: Tensor) -> Tensor:
        """`bias` is `[h, n, m]`, or `[b, h, n, m]` if items have their own masks."""
        b, n, _ = x.shape
        q, k, v = self._split(self.q(x)), self._split(self.k(keys)), self._split(self.v(keys))
        full = bias.to(q.dtype).expand(b, -1, -1, -1).reshape(b * self.heads, n, -1)
        scores = torch.baddbmm(full, q, k.transpose(1, 2))
        mixed = torch.bmm(torch.softmax(scores, -1), v)
        return self.o(mixed.view(b, self.heads, n, -1).transpose(1, 2).reshape(b, n, -1))


class Sublayer(nn.Module):
    """Contents of a block's `layer.{i}`: a norm and one operation, with Hugging Face's names."""

    def __init__(self, lm: Config, name: str, operation: nn.Module) -> None:
        super().__init__()
        self.layer_norm = RmsNorm(lm["d_model"], lm["layer_norm_epsilon"])
        self.add_module(name, operation)
        self.name = name

    def forward(self, x: Tensor, *rest: Tensor) -> Tensor:
        normed = self.layer_norm(x)
        operation = getattr(self, self.name)
        if self.name == "SelfAttention":
            return x + operation(normed, normed, *rest)
        return x + operation(normed, *rest)


class Block(nn.Module):
    def __init__(self, lm: Config, *, decoder: bool, first: bool, dense: bool) -> None:
        super().__init__()
        layers = [Sublayer(lm, "SelfAttention", Attention(lm, biased=first))]
        if decoder:
            layers.append(Sublayer(lm, "EncDecAttention", Attention(lm, biased=False)))
        d, ff = lm["d_model"], lm["d_ff"]
        if dense:
            layers.append(Sublayer(lm, "DenseReluDense", FeedForward(d, ff)))
        else:
            layers.append(Sublayer(lm, "moe", MixtureOfExperts(d, ff, lm["experts"], lm["top_k"])))
        self.layer = nn.ModuleList(layers)


class Stack(nn.Module):
    """Encoder or decoder. Its first layer's table of relative positions is shared by all layers."""

    def __init__(self, lm: Config, *, decoder: bool, dense: bool) -> None:
        super().__init__()
        count = lm["num_decoder_layers" if decoder else "num_layers"]
        self.block = nn.ModuleList(Block(lm, decoder=decoder, first=i == 0, dense=dense) for i in range(count))
        self.final_layer_norm = RmsNorm(lm["d_model"], lm["layer_norm_epsilon"])
        self.decoder = decoder
        self.buckets, self.distance = lm["relative_attention_num_buckets"], lm["relative_attention_max_distance"]
        self._spread()

    @torch.no_grad()
    def _spread(self) -> None:
        """Initialises heads to attend to different distances: half of them near, half as waves of distance, in pairs a
        quarter period apart. From nearly equal heads, learning where speech is in the window takes thousands of
        steps."""
        relative = torch.arange(-self.distance, self.distance + 1)
        table = self.block[0].layer[0].SelfAttention.relative_attention_bias.weight
        bucket = _bucket(relative, self.buckets, self.distance, two_sided=not self.decoder)
        heads = table.shape[1]
        near = heads - heads // 2
        for head in range(heads):
            if head < near:
                bias = -relative.abs() * 2.0 ** (-1.0 - head)
            elif self.decoder:
                # A keyframe is five audio tokens; of several parts' starts, the nearest counts.
                place = (-relative + KEYFRAMES_BEFORE + 0.5) * TOKENS_PER_KEYFRAME
                bias = _wave(place, head - near) + 0.4 * relative.clamp(max=0)
            else:
                bias = _wave(-relative - 1.0, head - near)
            table[bucket, head] = bias.to(table.dtype)

    def bias(self, n: int, device: torch.device) -> Tensor:
        """`[h, n, n]`, with the causal mask in a decoder."""
        position = torch.arange(n, device=device)
        relative = position[None] - position[:, None]
        table = self.block[0].layer[0].SelfAttention.relative_attention_bias
        bias = table(_bucket(relative, self.buckets, self.distance, two_sided=not self.decoder)).permute(2, 0, 1)
        return bias.masked_fill(relative > 0, float("-inf")) if self.decoder else bias

    def forward(self, x: Tensor, bias: Tensor, keys: Tensor | None = None, keys_bias: Tensor | None = None) -> Tensor:
        for block in self.block:
            x = block.layer[0](x, bias)
            if keys is not None:
                x = block.layer[1](x, keys, keys_bias)
            x = block.layer[-1](x)
        return self.final_layer_norm(x)


def _bucket(relative: Tensor, buckets: int, distance: int, *, two_sided: bool) -> Tensor:
    """T5's buckets: half of them exact distances, the rest logarithmic up to `distance`."""
    offset = torch.zeros_like(relative)
    if two_sided:
        buckets //= 2
        offset = (relative > 0) * buckets
        relative = relative.abs()
    else:
        relative = (-relative).clamp(min=0)
    exact = buckets // 2
    far = relative.float().clamp(min=1) / exact
    logarithmic = exact + (far.log() / math.log(distance / exact) * (buckets - exact)).long()
    return offset + torch.where(relative < exact, relative, logarithmic.clamp(max=buckets - 1))


# Dimensions of a marked model's positions: the component common to all tokens, the mark of the audio's start, that of
# the decoder's start, and from there on one per head of the encoder and of the decoder.
SHARED, BEGINS, STARTS, RESULTS = range(4)


@torch.no_grad()
def mark_heads(stack: Stack, marker: int, score: float, first: int) -> None:
    """Makes a stack's heads with distance waves attend to one marker among all tokens, and write a sine of the
    position, the first of them at dimension `first`."""
    attention = stack.block[0].layer[0].SelfAttention
    heads = attention.heads
    width = attention.q.weight.shape[0] // heads
    for head in range(heads - heads // 2, heads):
        row = head * width
        for linear in (attention.q, attention.k, attention.v):
            linear.weight[row : row + width] = 0.0
        attention.o.weight[:, row : row + width] = 0.0
        attention.q.weight[row, SHARED] = 1.0
        attention.k.weight[row, marker] = score / (4.0 * 7.0)
        attention.v.weight[row, marker] = 1.0
        attention.o.weight[first + head, row] = 0.6


def fixed_weights(
    places: int, tables: list[Tensor], writers: list[nn.Linear], stacks: tuple[Stack, ...]
) -> list[tuple[Tensor, Tensor]]:
    """Weights of a marked model, and the values in them that training leaves unchanged: those that produce positions
    and those that would mask them."""
    masks: dict[Tensor, Tensor] = {}

    def mask(weight: Tensor) -> Tensor:
        return masks.setdefault(weight, torch.zeros_like(weight, dtype=torch.bool))

    for table in tables:
        mask(table)[:, :places] = True
    for linear in writers:
        mask(linear.weight)[:places] = True
    for stack in stacks:
        attention = stack.block[0].layer[0].SelfAttention
        inner = attention.q.weight.shape[0]
        waves = slice(inner - inner // attention.heads * (attention.heads // 2), inner)
        for linear in (attention.q, attention.k, attention.v):
            mask(linear.weight)[waves] = True
        mask(attention.o.weight)[:, waves] = True
        table = attention.relative_attention_bias.weight
        mask(table)[:, attention.heads - attention.heads // 2 :] = True
    return list(masks.items())


class LanguageModel(nn.Module):
    """`config["lm"]` over `config["vocab"]`, with fresh weights. `dense` is T5 itself, before upcycling; `marked` knows
    positions from the first step on, which a model with published weights has already learned."""

    def __init__(self, config: Config, *, dense: bool = False, marked: bool = False) -> None:
        super().__init__()
        lm, vocab = config["lm"], config["vocab"]
        self.vocab, self.width, self.tied = vocab, lm["d_model"], lm["tie_word_embeddings"]
        self.shared = nn.Embedding(vocab["size"], lm["d_model"])
        self.encoder = Stack(lm, decoder=False, dense=dense)
        self.decoder = Stack(lm, decoder=True, dense=dense)
        if not self.tied:
            self.lm_head = nn.Linear(lm["d_model"], vocab["size"], bias=False)
            nn.init.normal_(self.lm_head.weight, std=lm["d_model"] ** -0.5)
        self.marked = marked and self.places > 0
        if self.marked:
            self._mark_places()

    @property
    def places(self) -> int:
        """Number of dimensions reserved for positions, starting with the first: one common to all tokens, one for each
        kind of marker, and one per head and stack. 0 in models too small for it."""
        heads = self.encoder.block[0].layer[0].SelfAttention.heads
        return 3 + 2 * heads if self.width >= 16 * heads else 0

    @torch.no_grad()
    def _mark_places(self) -> None:
        """Lets the model derive each audio token's position from the audio's start, and each code's from its part's
        start.

        T5 only knows distances. A head that attends to one marker among all tokens, with a weight that depends on its
        distance wave, writes a sine of the position: a position encoding built from T5's own operations. `fixed` lists
        the weights that must not change.
        """
        table = self.shared.weight
        heads = self.encoder.block[0].layer[0].SelfAttention.heads
        table[:, : self.places] = 0.0
        table[:, SHARED] = 4.0
        table[self.vocab["audio"]["start"], BEGINS] = 8.0
        for part in ("face", "hands", "upper", "lower"):
            table[self.vocab[part]["start"], STARTS] = 8.0
        for linear in self._writers():
            linear.weight[: self.places] = 0.0
        # A marker's score: about the logarithm of the number of tokens around it.
        mark_heads(self.encoder, BEGINS, 5.3, RESULTS)
        mark_heads(self.decoder, STARTS, 1.0, RESULTS + heads)

    def _writers(self) -> list[nn.Linear]:
        """Every matrix that writes to the residual stream."""
        names = (".o", ".wo")
        return [m for name, m in self.named_modules() if name.endswith(names) and isinstance(m, nn.Linear)]

    def fixed(self) -> list[tuple[Tensor, Tensor]]:
        """Weights, and the values in them that training leaves unchanged: those that produce positions and those that
        would mask them.
        """
        if not self.marked:
            return []
        return fixed_weights(self.places, [self.shared.weight], self._writers(), (self.encoder, self.decoder))

    def encode(self, ids: Tensor, mask: Tensor | None = None) -> Tensor:
        """`[b, n]` ids and their mask to `[b, n, d]`."""
        bias = self.encoder.bias(ids.shape[1], ids.device)
        if mask is not None:
            bias = bias[None].masked_fill(~mask[:, None, None], float("-inf"))
        return self.encoder(self.shared(ids), bias)

    def decode(self, hidden: Tensor, ids: Tensor, mask: Tensor | None = None) -> Tensor:
        """States of the decoder `[b, m, d]` after each of `ids`, ready for the head."""
        keys_bias = torch.zeros(1, 1, 1, hidden.shape[1], device=ids.device)
        if mask is not None:
            keys_bias = keys_bias.masked_fill(~mask[:, None, None], float("-inf"))
        keys_bias = keys_bias.expand(-1, self.encoder.block[0].layer[0].SelfAttention.heads, ids.shape[1], -1)
        states = self.decoder(self.shared(ids), self.decoder.bias(ids.shape[1], ids.device), hidden, keys_bias)
        return states * self.width**-0.5 if self.tied else states

    def head(self, states: Tensor) -> Tensor:
        """Logits over the whole vocabulary."""
        return nn.functional.linear(states, self.shared.weight if self.tied else self.lm_head.weight)

    def forward(
        self, ids: Tensor, decoder_ids: Tensor, mask: Tensor | None = None, *, states: bool = False
    ) -> Tensor | tuple[Tensor, Tensor]:
        """Logits `[b, m, vocab]` with teacher forcing; with `states` also the encoder's `[b, n, d]`."""
        hidden = self.encode(ids, mask)
        logits = self.head(self.decode(hidden, decoder_ids, mask))
        return (logits, hidden) if states else logits
