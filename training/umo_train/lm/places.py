"""Initialises the decoder to attend to the audio of its keyframe: least squares on one batch instead of thousands of
steps.
"""

import math

import numpy as np
import torch
from torch import Tensor

from umo_train.lm.examples import Examples
from umo_train.lm.model import LanguageModel
from umo_train.skeleton import PARTS

# Waves of position in audio tokens, and the strength of the preference for the matching position.
PERIODS, PREFERENCE = (24.0, 96.0), 16.0
RIDGE = 0.0003


def _code(place: Tensor) -> Tensor:
    """Positions in audio tokens to unit waves `[..., 4]`."""
    angles = torch.stack([2 * math.pi * place / period for period in PERIODS], -1)
    return torch.cat([angles.cos(), angles.sin()], -1)


@torch.no_grad()
def align(model: LanguageModel, examples: Examples, targets: tuple[int, ...], seed: int) -> None:
    """Sets the last cross-attention so that a code's query matches the keys of its keyframe's audio, and passes on the
    values found there. Queries and keys are fitted to the same position waves. Training continues from there.
    """
    if not model.marked:
        raise ValueError("a stage with `align` needs a plan with `marked: true` and at least 16 widths a head")
    rng = np.random.default_rng(seed)
    batches = [examples.chunk(96, target, rng) for target in targets]
    states = [_states(model, batch.ids, batch.labels) for batch in batches]
    first = examples.config["templates"]["audio_to_motion"].index("audio") + 1
    rows, wanted = [], []
    for target, (hidden, _) in zip(targets, states, strict=True):
        tokens = (examples.prefix + target) * examples.tokens
        code = torch.zeros(*hidden.shape[:2], 4)
        code[:, first : first + tokens] = _code(torch.arange(tokens).float())
        rows.append(hidden.flatten(0, 1))
        wanted.append(code.flatten(0, 1))
    keys = _fit(torch.cat(rows), torch.cat(wanted), model.places)
    layer = len(model.decoder.block) - 1
    rows, wanted = [], []
    for target, (hidden, said) in zip(targets, states, strict=True):
        state = _before(model, layer, hidden, said)
        places = torch.from_numpy(examples.heard_at(target))
        for part in range(len(PARTS)):
            at = 1 + part * (len(places) + 2)
            rows.append(state[:, at : at + len(places)].flatten(0, 1))
            wanted.append(_code(places).expand(len(state), -1, -1).flatten(0, 1))
    queries = _fit(torch.cat(rows), torch.cat(wanted), model.places)
    attention = model.decoder.block[layer].layer[1].EncDecAttention
    inner = attention.q.weight.shape[0]
    width = inner // attention.heads
    for linear, fitted in ((attention.q, queries), (attention.k, keys)):
        for row in range(0, inner, width):
            linear.weight[row : row + width] = 0.0
            linear.weight[row : row + fitted.shape[1]] = PREFERENCE**0.5 * fitted.T
    # The values pass to the head unchanged: the encoder's own prediction becomes the decoder's.
    attention.v.weight.copy_(torch.eye(*attention.v.weight.shape))
    attention.o.weight.copy_(torch.eye(*attention.o.weight.shape))
    attention.o.weight[: model.places] = 0.0


def _fit(rows: Tensor, wanted: Tensor, places: int) -> Tensor:
    """Ridge regression `[d, 4]` on the position dimensions only, which nothing else writes to."""
    seen = rows[:, :places]
    square = seen.T @ seen + RIDGE * len(seen) * torch.eye(places)
    out = torch.zeros(rows.shape[1], wanted.shape[1])
    out[:places] = torch.linalg.solve(square, seen.T @ wanted)
    return out


def _states(model: LanguageModel, ids: np.ndarray, labels: np.ndarray) -> tuple[Tensor, Tensor]:
    hidden = model.encode(torch.from_numpy(ids))
    after = torch.from_numpy(labels)
    start = torch.full_like(after[:, :1], model.vocab["decoder_start"])
    return hidden, torch.cat([start, after[:, :-1].clamp(min=0)], 1)


def _before(model: LanguageModel, layer: int, hidden: Tensor, said: Tensor) -> Tensor:
    """Input of a layer's cross-attention."""
    x = model.shared(said)
    bias = model.decoder.bias(said.shape[1], x.device)
    heads = model.decoder.block[0].layer[0].SelfAttention.heads
    keys_bias = torch.zeros(1, heads, said.shape[1], hidden.shape[1])
    for block in list(model.decoder.block)[:layer]:
        x = block.layer[-1](block.layer[1](block.layer[0](x, bias), hidden, keys_bias))
    block = model.decoder.block[layer]
    return block.layer[1].layer_norm(block.layer[0](x, bias))
