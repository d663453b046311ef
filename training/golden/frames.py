"""Layout `frames`: keyframes as positions of T5, a depth network, residual codebooks, and vectors between keyframes."""

from collections.abc import Iterable

import torch
from torch import Tensor, nn
from torch.nn import functional

import skeleton
from audio import front_end, nearest
from interp import KEYFRAME, LAST_VALID, MASKED
from layout import PARTS, Config, channel_count, moving
from lm import LanguageModel
from margin import Margin
from motion import Motion, decoder, encoder, load

Codes = dict[str, Tensor]


class Keyframes(nn.Module):
    """Sums of code embeddings, `[T, levels]` of each part to `[T, d]`."""

    def __init__(self, config: Config, tensors: dict[str, Tensor]) -> None:
        super().__init__()
        self.parts = config["parts"]
        self.embed = nn.ModuleDict()
        for part in self.parts:
            table = nn.Embedding(part["levels"] * part["codes"], config["lm"]["d_model"])
            self.embed[part["name"]] = load(table, f"lm.frames.embed.{part['name']}.", tensors)
        kind = load(nn.Embedding(2, config["lm"]["d_model"]), "lm.frames.type.", tensors)
        self.history, self.start = kind.weight

    def forward(self, codes: Codes) -> Tensor:
        rows = [self.embed[part["name"]](codes[part["name"]] + offsets(part)).sum(1) for part in self.parts]
        return torch.stack(rows).sum(0)


def offsets(part: Config) -> Tensor:
    """First row of every level in a stacked table."""
    return torch.arange(part["levels"]) * part["codes"]


class DepthLayer(nn.Module):
    def __init__(self, sizes: Config) -> None:
        super().__init__()
        d, eps = sizes["d_model"], sizes["layer_norm_epsilon"]
        self.heads = sizes["num_heads"]
        self.attention_norm, self.feed_forward_norm = nn.RMSNorm(d, eps), nn.RMSNorm(d, eps)
        self.attention = nn.ModuleDict({name: nn.Linear(d, d, bias=False) for name in "qkvo"})
        up, down = nn.Linear(d, sizes["d_ff"], bias=False), nn.Linear(sizes["d_ff"], d, bias=False)
        gate = nn.Linear(d, sizes["d_ff"], bias=False)
        self.feed_forward = nn.ModuleDict({"wi_0": gate, "wi_1": up, "wo": down})

    def forward(self, x: Tensor) -> Tensor:
        """`[T, codes, d]`, causal over the codes."""
        normed = self.attention_norm(x)
        q, k, v = (self.attention[name](normed).unflatten(-1, (self.heads, -1)).transpose(1, 2) for name in "qkv")
        context = functional.scaled_dot_product_attention(q, k, v, is_causal=True)
        x = x + self.attention["o"](context.transpose(1, 2).flatten(-2))
        normed, inner = self.feed_forward_norm(x), self.feed_forward
        return x + inner["wo"](functional.gelu(inner["wi_0"](normed), approximate="tanh") * inner["wi_1"](normed))


class Depth(nn.Module):
    """Logits of all codes of a keyframe from the decoder's state, the codes before it and, with `depth.before`, the
    same code of the previous keyframe, in one pass; with `depth.heard` also from the encoder's state where the
    keyframe is heard, with `depth.body_heard` from a second one for all parts except the face."""

    def __init__(self, config: Config, tensors: dict[str, Tensor]) -> None:
        super().__init__()
        sizes, self.parts = config["depth"], config["parts"]
        d, slots = sizes["d_model"], sum(part["levels"] for part in config["parts"])
        self.input = nn.Linear(config["lm"]["d_model"], d, bias=False)
        if "heard" in sizes:
            self.heard = nn.Linear(config["lm"]["d_model"], d, bias=False)
        face = {"jaw", *config["face"]["names"]}
        of_body = [not set(part["channels"]) & face for part in self.parts for _ in range(part["levels"])]
        self.places = [int(body and "body_heard" in sizes) for body in of_body]
        self.position = nn.Embedding(slots, d)
        self.layers = nn.ModuleList([DepthLayer(sizes) for _ in range(sizes["num_layers"])])
        self.norm = nn.RMSNorm(d, sizes["layer_norm_epsilon"])
        rows = {part["name"]: part["levels"] * part["codes"] for part in self.parts}
        self.embed = nn.ModuleDict({name: nn.Embedding(count, d) for name, count in rows.items()})
        self.head = nn.ModuleDict({name: nn.Linear(d, count, bias=False) for name, count in rows.items()})
        if sizes.get("before"):
            self.before = nn.ModuleDict({name: nn.Embedding(count, d) for name, count in rows.items()})
        load(self, "depth.", tensors)
        self.eval()

    def forward(self, states: Tensor, codes: Codes, before: Codes, heard: list[Tensor]) -> Codes:
        """States `[T, d_model]`, codes `[T, levels]` of each part, the previous keyframes' codes, and the encoder's
        states `[T, d_model]` for face and body, if configured, to logits `[T, levels, codes]`."""
        said = self._looked_up(self.embed, codes)[:, :-1]
        given = self.input(states)[:, None]
        if heard:
            given = given + torch.stack([self.heard(heard[place]) for place in self.places], 1)
        x = given + functional.pad(said, (0, 0, 1, 0)) + self.position.weight
        if hasattr(self, "before"):
            x = x + self._looked_up(self.before, before)
        for layer in self.layers:
            x = layer(x)
        x = self.norm(x)
        logits, at = {}, 0
        for part in self.parts:
            levels = self.head[part["name"]].weight.unflatten(0, (part["levels"], part["codes"]))
            logits[part["name"]] = torch.einsum("tld,lcd->tlc", x[:, at : at + part["levels"]], levels)
            at += part["levels"]
        return logits

    def _looked_up(self, tables: nn.ModuleDict, codes: Codes) -> Tensor:
        """Rows `[T, codes of a keyframe, d]`."""
        return torch.cat([tables[part["name"]](codes[part["name"]] + offsets(part)) for part in self.parts], 1)

    def greedy(self, state: Tensor, before: Codes, heard: list[Tensor], margin: Margin) -> Codes:
        """The codes `[1, levels]` of one keyframe, each by a pass over all before it; `before` is the previous
        keyframe, `[1, levels]`, `heard` the encoder's states."""
        codes = {part["name"]: torch.zeros(1, part["levels"], dtype=torch.long) for part in self.parts}
        for part in self.parts:
            for level in range(part["levels"]):
                logits = self(state[None], codes, before, heard)[part["name"]][0, level]
                margin.largest(logits)
                codes[part["name"]][0, level] = logits.argmax()
        return codes


class VectorInterpolation(nn.Module):
    """Interpolates code vectors of the known frames to all frames."""

    def __init__(self, config: Config, tensors: dict[str, Tensor]) -> None:
        super().__init__()
        sizes, self.parts = config["interp"], moving(config)
        self.stride: int = config["keyframe_stride"]
        d = sizes["d_model"]

        def layers(count: int) -> nn.ModuleList:
            make = nn.TransformerEncoderLayer
            sizes_of = (d, sizes["num_heads"], sizes["d_ff"], 0.0, "gelu")
            return nn.ModuleList([make(*sizes_of, batch_first=True, norm_first=True) for _ in range(count)])

        self.input = nn.ModuleDict({part["name"]: nn.Linear(part["width"], d) for part in self.parts})
        self.mask = nn.Embedding(len(self.parts), d)
        self.frame_type = nn.Embedding(3, d)
        self.position = nn.Embedding(sizes["max_frames"], d)
        self.temporal = layers(sizes["temporal_layers"])
        self.part = layers(sizes["part_layers"])
        self.norm = nn.LayerNorm(d)
        self.head = nn.ModuleDict({part["name"]: nn.Linear(d, part["width"]) for part in self.parts})
        load(self, "interp.", tensors)
        self.eval()

    def forward(self, vectors: dict[str, Tensor], known: Tensor) -> dict[str, Tensor]:
        frame = torch.arange(len(known))
        kind = torch.where(frame % self.stride == 0, KEYFRAME, LAST_VALID)
        kind = torch.where(known, kind, MASKED)
        tokens = [self.input[part["name"]](vectors[part["name"]]) for part in self.parts]
        tokens = torch.where(known[:, None, None], torch.stack(tokens, 1), self.mask.weight)
        hidden = (tokens.sum(1) + self.frame_type(kind) + self.position(frame))[None]
        for layer in self.temporal:
            hidden = layer(hidden)
        hidden = hidden[0][:, None] + tokens
        for layer in self.part:
            hidden = layer(hidden)
        hidden = self.norm(hidden)
        filled = {}
        for i, part in enumerate(self.parts):
            change = self.head[part["name"]](hidden[:, i])
            line = straight(vectors[part["name"]], known)
            filled[part["name"]] = torch.where(known[:, None], vectors[part["name"]], line + change)
        return filled


def straight(vectors: Tensor, known: Tensor) -> Tensor:
    """Linear interpolation between the known rows, and constant extrapolation."""
    at = known.nonzero()[:, 0]
    frame = torch.arange(len(known))
    after = torch.searchsorted(at, frame).clamp(max=len(at) - 1)
    before = (torch.searchsorted(at, frame, right=True) - 1).clamp(min=0)
    a, b = at[before], at[after]
    share = (frame - a).clamp(min=0).to(vectors.dtype) / (b - a).clamp(min=1).to(vectors.dtype)
    return torch.lerp(vectors[a], vectors[b], share[:, None])


class ResidualMotion(Motion):
    """Decoders of any parts whose codes have levels; the root network is that of `Motion`."""

    def __init__(self, config: Config, tensors: dict[str, Tensor]) -> None:
        nn.Module.__init__(self)
        self.parts, self.places = moving(config), places(config)
        self.decoders, self.encoders, self.codebooks = nn.ModuleDict(), nn.ModuleDict(), nn.ModuleDict()
        root = config["vq"]["root"]
        sizes = {part["name"]: (part["width"], channel_count(config, part), part["layers"]) for part in self.parts}
        sizes["root"] = (config["vq"]["width"], root["channels"], root["layers"])
        for name, size in sizes.items():
            self.decoders[name] = load(decoder(*size), f"vq.{name}.decoder.main.", tensors)
            if f"vq.{name}.encoder.main.0.weight" in tensors:
                self.encoders[name] = load(encoder(*size), f"vq.{name}.encoder.main.", tensors)
        for part in self.parts:
            book = nn.Embedding(part["levels"] * part["codes"], part["width"])
            self.codebooks[part["name"]] = load(book, f"vq.{part['name']}.quantizer.embedding.", tensors)
        self.eval()

    def own(self, channels: dict[str, Tensor], part: Config) -> Tensor:
        """A part's channels out of the four body parts' channels."""
        region, columns = self.places[part["name"]]
        return channels[region][:, columns]

    def levels(self, channels: dict[str, Tensor], part: Config, margin: Margin) -> Tensor:
        """Motion to codes `[T, levels]`: each level encodes the residual of those before it."""
        book = self.codebooks[part["name"]].get_parameter("weight").unflatten(0, (part["levels"], part["codes"]))
        left, codes = self.latents(part["name"], self.own(channels, part)), []
        for level in book:
            codes.append(nearest(left, level, margin))
            left = left - level[codes[-1]]
        return torch.stack(codes, 1)

    def decode(self, codes: Codes) -> dict[str, Tensor]:
        frames = len(codes[self.parts[0]["name"]])
        dtype = next(self.parameters()).dtype
        widths = {region: 1 + max(c.max() for r, c in self.places.values() if r == region) for region in PARTS}
        body = {region: torch.zeros(frames, int(width), dtype=dtype) for region, width in widths.items()}
        for part in self.parts:
            region, columns = self.places[part["name"]]
            vectors = self.codebooks[part["name"]](codes[part["name"]] + offsets(part)).sum(1)
            body[region][:, columns] = self.decoders[part["name"]](vectors.T[None])[0].T
        return body


def places(config: Config) -> dict[str, tuple[str, Tensor]]:
    """The body part and the columns in it of every part's channels."""
    known = {name: (region, columns) for region, names in named(config).items() for name, columns in names}
    out = {}
    for part in moving(config):
        regions = {known[name][0] for name in part["channels"]}
        assert len(regions) == 1, part["name"]
        out[part["name"]] = (regions.pop(), torch.cat([torch.tensor(known[name][1]) for name in part["channels"]]))
    return out


def named(config: Config) -> dict[str, list[tuple[str, list[int]]]]:
    """Every channel of the four body parts, by name."""

    def joints(of: Iterable[int]) -> list[tuple[str, int]]:
        return [(skeleton.NAMES[joint], 6) for joint in of]

    lists = {
        "face": joints([skeleton.JAW]) + [(name, 1) for name in config["face"]["names"]],
        "hands": joints(skeleton.HANDS),
        "upper": joints(skeleton.UPPER),
        "lower": [*joints(skeleton.LOWER), ("root_velocity", 3), ("contacts", 4)],
    }
    out: dict[str, list[tuple[str, list[int]]]] = {}
    for region, names in lists.items():
        at, out[region] = 0, []
        for name, width in names:
            out[region].append((name, list(range(at, at + width))))
            at += width
    return out


class FrameReference(nn.Module):
    """Every stage of a model of layout `frames`, from the values that its file holds."""

    centroids: Tensor

    def __init__(self, config: Config, tensors: dict[str, Tensor]) -> None:
        super().__init__()
        self.audio = front_end(config, tensors)
        self.register_buffer("centroids", tensors["audio.kmeans.centroids"])
        head = torch.zeros(config["vocab"]["size"], config["lm"]["d_model"])
        plain = {name: tensor for name, tensor in tensors.items() if not name.startswith("lm.frames.")}
        self.lm = LanguageModel(config, plain | {"lm.lm_head.weight": head}, dense=False)
        self.keyframes = Keyframes(config, tensors)
        self.depth = Depth(config, tensors)
        self.interp = VectorInterpolation(config, tensors)
        self.motion = ResidualMotion(config, tensors)
        self.size: int = config["vocab"]["size"]
        self.start: int = config["vocab"]["audio"]["start"]
        self.prefix: int = config["prefix"]
        self.tokens: int = config["keyframe_stride"] * config["audio"]["token_rate"] // config["frame_rate"]
        self.heard_tokens = [config["depth"][key] for key in ("heard", "body_heard") if key in config["depth"]]
        self.ahead: int = config["audio"]["ahead"]

    @property
    def dtype(self) -> torch.dtype:
        return self.centroids.dtype

    def encode(self, ids: Tensor, history: Codes) -> Tensor:
        """Encoder states of ids; ids beyond the vocabulary are keyframes of the history."""
        rows = self.keyframes(history) + self.keyframes.history
        table = torch.cat([self.lm.model.shared.weight, rows])
        return self.lm.model.encoder(inputs_embeds=table[ids][None]).last_hidden_state[0]

    def decode(self, hidden: Tensor, codes: Codes) -> Tensor:
        """The decoder's states for keyframes, of which all but the last are inputs."""
        rows = torch.cat([self.keyframes.start[None], self.keyframes(codes)[:-1]])
        output = self.lm.model.decoder(inputs_embeds=rows[None], encoder_hidden_states=hidden[None], use_cache=False)
        return output.last_hidden_state[0]

    def heard(self, ids: Tensor, hidden: Tensor, keyframe: int, target: int) -> list[Tensor]:
        """The encoder's states `[1, d_model]` at the position where a keyframe of the chunk is heard, or at the last
        audio token if that is beyond it; zeros without audio."""
        found = (ids == self.start).nonzero()
        out = []
        for token in self.heard_tokens:
            last = (self.prefix + target + self.ahead) * self.tokens - 1
            place = len(ids)
            if len(found):
                place = int(found[0]) + 1 + min((self.prefix + keyframe) * self.tokens + token, last)
            out.append(hidden[place : place + 1] if place < len(ids) else torch.zeros_like(hidden[:1]))
        return out

    def generate(self, ids: Tensor, hidden: Tensor, history: Codes, target: int, margin: Margin) -> Codes:
        """Greedy keyframes, each by a pass over all before it."""
        before = {name: rows[-1:] for name, rows in history.items()}
        codes = {part["name"]: torch.zeros(0, part["levels"], dtype=torch.long) for part in self.keyframes.parts}
        for keyframe in range(target):
            more = {name: functional.pad(value, (0, 0, 0, 1)) for name, value in codes.items()}
            heard = self.heard(ids, hidden, keyframe, target)
            drawn = before = self.depth.greedy(self.decode(hidden, more)[-1], before, heard, margin)
            codes = {name: torch.cat([value, drawn[name]]) for name, value in codes.items()}
        return codes
