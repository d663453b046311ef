"""The language model of layout `frames` (SPEC 2.13): T5 over keyframes, and a depth network for a keyframe's codes."""

from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from umo_train.frames.parts import Part
from umo_train.lm.model import (
    BEGINS,
    RESULTS,
    SHARED,
    STARTS,
    LanguageModel,
    RmsNorm,
    Stack,
    fixed_weights,
    mark_heads,
)

Config = dict[str, Any]
# Rows of the `kind` table.
HISTORY, START = range(2)


class Tables(nn.ModuleDict):
    """A vector for every code of every part and level, level after level."""

    def __init__(self, parts: list[Part], width: int, std: float) -> None:
        super().__init__({part.name: nn.Embedding(part.levels * part.codes, width) for part in parts})
        self.parts = parts
        for table in self.values():
            nn.init.normal_(table.weight, std=std)

    def forward(self, codes: Tensor) -> Tensor:
        """Codes `[..., J]` to vectors `[..., J, width]`; zero for unknown codes, -1."""
        out, at = [], 0
        for part in self.parts:
            mine = codes[..., at : at + part.levels]
            rows = mine + part.codes * torch.arange(part.levels, device=codes.device)
            vectors = self[part.name](rows.clamp(min=0))
            out.append(vectors * (mine >= 0)[..., None])
            at += part.levels
        return torch.cat(out, -2)


class DepthLayer(nn.Module):
    def __init__(self, sizes: Config) -> None:
        super().__init__()
        d, eps = sizes["d_model"], sizes["layer_norm_epsilon"]
        self.heads = sizes["num_heads"]
        self.attention_norm, self.feed_forward_norm = RmsNorm(d, eps), RmsNorm(d, eps)
        self.attention = nn.ModuleDict({name: nn.Linear(d, d, bias=False) for name in "qkvo"})
        gate, up = (nn.Linear(d, sizes["d_ff"], bias=False) for _ in range(2))
        self.feed_forward = nn.ModuleDict({"wi_0": gate, "wi_1": up, "wo": nn.Linear(sizes["d_ff"], d, bias=False)})

    def forward(self, x: Tensor) -> Tensor:
        """`[n, J, d]`, causal over the codes."""
        normed = self.attention_norm(x)
        q, k, v = (self.attention[name](normed).unflatten(-1, (self.heads, -1)).transpose(1, 2) for name in "qkv")
        # For about thirty codes this is faster on a CPU than the fused operation.
        later = torch.ones(x.shape[1], x.shape[1], dtype=torch.bool, device=x.device).triu(1)
        scores = (q @ k.transpose(-1, -2) * q.shape[-1] ** -0.5).masked_fill(later, float("-inf"))
        context = torch.softmax(scores, -1) @ v
        x = x + self.attention["o"](context.transpose(1, 2).flatten(-2))
        normed, inner = self.feed_forward_norm(x), self.feed_forward
        return x + inner["wo"](functional.gelu(inner["wi_0"](normed), approximate="tanh") * inner["wi_1"](normed))


class Depth(nn.Module):
    """Logits of all codes of a keyframe from the decoder's state, the codes before it and, with `depth.before`, the
    same code of the previous keyframe, in one pass."""

    # Scale of the head's initial weights relative to the table of the previous keyframe: an untrained network mostly
    # repeats it.
    AGAIN = 0.1

    def __init__(self, config: Config, parts: list[Part]) -> None:
        super().__init__()
        sizes, self.parts = config["depth"], parts
        d = sizes["d_model"]
        self.slots = sum(part.levels for part in parts)
        self.input = nn.Linear(config["lm"]["d_model"], d, bias=False)
        self.position = nn.Embedding(self.slots, d)
        self.layers = nn.ModuleList(DepthLayer(sizes) for _ in range(sizes["num_layers"]))
        self.norm = RmsNorm(d, sizes["layer_norm_epsilon"])
        self.embed = Tables(parts, d, 0.5)
        self.head = nn.ModuleDict({part.name: nn.Linear(d, part.levels * part.codes, bias=False) for part in parts})
        nn.init.normal_(self.position.weight, std=0.5)
        self.heard = nn.Linear(config["lm"]["d_model"], d, bias=False) if sizes.get("heard") is not None else None
        self.before = Tables(parts, d, 0.5) if sizes.get("before") else None
        if self.before is not None:
            for name, head in self.head.items():
                head.weight.data.copy_(self.AGAIN * self.before[name].weight.data)

    def forward(
        self, states: Tensor, codes: Tensor, before: Tensor | None = None, heard: Tensor | None = None
    ) -> dict[str, Tensor]:
        """States `[n, d_model]` and codes `[n, J]` to logits `[n, levels, codes]` of each part. Code `j` sees the codes
        before it, as already sampled by the engine at `j`, and the previous keyframe `before` `[n, J]`, -1 if
        unknown. `heard` `[n, d_model]` are the encoder's states where the keyframes are heard."""
        drawn = functional.pad(self.embed(codes)[:, :-1], (0, 0, 1, 0))
        given = self.input(states)
        if self.heard is not None and heard is not None:
            given = given + self.heard(heard)
        x = given[:, None] + drawn + self.position.weight
        if self.before is not None and before is not None:
            x = x + self.before(before)
        for layer in self.layers:
            x = layer(x)
        # Code-major order, so that a level's matrix product accesses consecutive rows.
        states = self.norm(x).transpose(0, 1).contiguous()
        logits = {}
        for part, mine in zip(self.parts, states.split([part.levels for part in self.parts]), strict=True):
            rows = self.head[part.name].weight.unflatten(0, (part.levels, part.codes))
            logits[part.name] = (mine @ rows.transpose(-1, -2)).transpose(0, 1)
        return logits


class Frames(nn.Module):
    """Tables for keyframes: `embed` for codes, `kind` for the history and the decoder's start."""

    def __init__(self, parts: list[Part], width: int) -> None:
        super().__init__()
        # `type` in the model file, which is a method name of modules.
        self.kind = nn.Embedding(2, width)
        # Scaled so that a keyframe's sum is as long as another token's vector.
        self.embed = Tables(parts, width, sum(part.levels for part in parts) ** -0.5)


class FrameModel(nn.Module):
    """`config["lm"]` and `config["depth"]` with fresh weights. `dense` has no experts, as before upcycling; `marked`
    knows positions from the first step on (see `LanguageModel`)."""

    def __init__(self, config: Config, parts: list[Part], *, dense: bool = False, marked: bool = False) -> None:
        super().__init__()
        lm, self.vocab, self.parts = config["lm"], config["vocab"], parts
        self.shared = nn.Embedding(self.vocab["size"], lm["d_model"])
        self.encoder = Stack(lm, decoder=False, dense=dense)
        self.decoder = Stack(lm, decoder=True, dense=dense)
        self.frames = Frames(parts, lm["d_model"])
        self.depth = Depth(config, parts)
        self.width = lm["d_model"]
        self.marked = marked and self.places > 0
        if self.marked:
            self._mark_places()

    places = LanguageModel.places

    @torch.no_grad()
    def _mark_places(self) -> None:
        """As in `LanguageModel`: heads derive positions from marks of the audio's start and the decoder's start."""
        tables = self._tables()
        for table in tables:
            table[:, : self.places] = 0.0
        self.shared.weight[:, SHARED] = 4.0
        self.shared.weight[self.vocab["audio"]["start"], BEGINS] = 8.0
        first = self.parts[0]
        # One code of every keyframe carries the component common to all tokens.
        self.frames.embed[first.name].weight[: first.codes, SHARED] = 4.0
        self.frames.kind.weight[START, SHARED], self.frames.kind.weight[START, STARTS] = 4.0, 8.0
        for linear in self._writers():
            linear.weight[: self.places] = 0.0
        heads = self.encoder.block[0].layer[0].SelfAttention.heads
        mark_heads(self.encoder, BEGINS, 5.3, RESULTS)
        mark_heads(self.decoder, STARTS, 1.0, RESULTS + heads)

    def _tables(self) -> list[Tensor]:
        embeddings = (self.shared, self.frames.kind, *self.frames.embed.values())
        return [embedding.weight for embedding in embeddings]

    def _writers(self) -> list[nn.Linear]:
        """Every matrix of T5 that writes to the residual stream."""
        modules = [*self.encoder.named_modules(), *self.decoder.named_modules()]
        return [m for name, m in modules if name.endswith((".o", ".wo")) and isinstance(m, nn.Linear)]

    def fixed(self) -> list[tuple[Tensor, Tensor]]:
        """Weights, and the values in them that training leaves unchanged."""
        if not self.marked:
            return []
        return fixed_weights(self.places, self._tables(), self._writers(), (self.encoder, self.decoder))

    def keyframes(self, codes: Tensor) -> Tensor:
        """Codes `[..., J]` to the sums of their vectors `[..., d]`."""
        return self.frames.embed(codes).sum(-2)

    def encode(self, ids: Tensor, history: Tensor, mask: Tensor | None = None) -> Tensor:
        """`[b, n]` ids, of which `vocab.size + k` is keyframe `k` of the history `[b, P, J]`, and their mask, to
        `[b, n, d]`."""
        size = self.vocab["size"]
        rows = self.keyframes(history) + self.frames.kind.weight[HISTORY]
        place = (ids - size).clamp(0, history.shape[1] - 1)
        past = rows.gather(1, place[..., None].expand(-1, -1, rows.shape[-1]))
        x = torch.where((ids >= size)[..., None], past, self.shared(ids.clamp(max=size - 1)))
        bias = self.encoder.bias(ids.shape[1], ids.device)
        if mask is not None:
            bias = bias[None].masked_fill(~mask[:, None, None], float("-inf"))
        return self.encoder(x, bias)

    def decode(self, hidden: Tensor, codes: Tensor, mask: Tensor | None = None) -> Tensor:
        """The decoder's states `[b, N, d]` for keyframes `[b, N, J]`, of which all but the last are inputs: each
        position sees the keyframes before it."""
        start = self.frames.kind.weight[START].expand(len(codes), 1, -1)
        x = torch.cat([start, self.keyframes(codes[:, :-1])], 1)
        heads = self.encoder.block[0].layer[0].SelfAttention.heads
        keys_bias = torch.zeros(1, 1, 1, hidden.shape[1], device=hidden.device)
        if mask is not None:
            keys_bias = keys_bias.masked_fill(~mask[:, None, None], float("-inf"))
        keys_bias = keys_bias.expand(-1, heads, x.shape[1], -1)
        return self.decoder(x, self.decoder.bias(x.shape[1], x.device), hidden, keys_bias)

    def forward(
        self,
        ids: Tensor,
        history: Tensor,
        codes: Tensor,
        mask: Tensor | None = None,
        places: Tensor | None = None,
        guessed: Tensor | None = None,
        unknown: Tensor | None = None,
    ) -> tuple[dict[str, Tensor], dict[str, Tensor] | None]:
        """Logits `[b * N, levels, codes]` of each part with teacher forcing. `places` `[N]` are the positions in `ids`
        where the chunk's keyframes are heard, if given. `unknown` `[b, N]` are keyframes whose depth network does
        not see the previous keyframe. With `guessed`, keyframes of the chunk `[H]`, also the logits
        `[b * H, levels, codes]` from the encoder's states at these positions alone."""
        hidden = self.encode(ids, history, mask)
        before = torch.cat([history[:, -1:], codes[:, :-1]], 1)
        if unknown is not None:
            before = before.masked_fill(unknown[..., None], -1)
        heard = None if places is None else hidden[:, places].flatten(0, 1)
        states = self.decode(hidden, codes, mask).flatten(0, 1)
        logits = self.depth(states, codes.flatten(0, 1), before.flatten(0, 1), heard)
        if guessed is None or places is None:
            return logits, None
        return logits, self.depth(hidden[:, places[guessed]].flatten(0, 1), codes[:, guessed].flatten(0, 1))


def for_file(state: dict[str, Tensor]) -> dict[str, Tensor]:
    """Weights of a `FrameModel` under the model file's names without `lm.`."""
    return {name.replace("frames.kind.", "frames.type."): tensor for name, tensor in state.items()}


def from_file(named: dict[str, Tensor]) -> dict[str, Tensor]:
    """The inverse of `for_file`."""
    return {name.replace("frames.type.", "frames.kind."): tensor for name, tensor in named.items()}
