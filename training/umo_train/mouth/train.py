"""Trains the live mouth: least squares on the channels, an extra term for the lips' opening, and voice detection."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from umo_train.log import Log
from umo_train.metrics.lips import WIDTH
from umo_train.mouth.examples import KINDS, Example
from umo_train.mouth.features import Front
from umo_train.mouth.network import MouthNetwork
from umo_train.performer.lips import OPENING
from umo_train.skeleton import ARKIT
from umo_train.state import Saved

SAVE_EVERY = 250
# Channels that round the lips.
ROUNDING = np.array([float(name in ("mouthPucker", "mouthFunnel")) for name in ARKIT])


@dataclass(frozen=True)
class MouthPlan:
    """`frames` of each of `batch` clips per step; the weights apply to the loss terms other than the channels.

    `lead`: frames, below 1, by which the live head's mouth is ahead of its frame, as it is shown that much later.
    `live`: weight of the closures in the live head's loss, relative to `closures`, as it hears less of what follows.
    `shares`: how often each kind of example is drawn, 0 to 1, relative to each other. `open` weighs lips that are less
    apart than open ones. `warp`: highest share by which a stretch's frequencies are scaled, voices of another size."""

    steps: int
    frames: int = 160
    batch: int = 32
    rate: float = 2e-3
    opening: float = 2.0
    width: float = 1.0
    closures: float = 2.0
    open: float = 0.0
    velocity: float = 1.0
    voice: float = 0.03
    lead: float = 0.0
    live: float = 1.0
    later: float = 1.0
    shares: dict[str, float] = field(default_factory=lambda: dict.fromkeys(KINDS, 1.0))
    noise: float = 0.05
    warp: float = 0.0
    seed: int = 0
    network: dict[str, Any] = field(default_factory=dict)


def train(
    plan: MouthPlan,
    front: Front,
    examples: Sequence[Example],
    names: Sequence[str],
    rest: np.ndarray,
    folder: Path,
    begin: Mapping[str, Tensor] | None = None,
) -> MouthNetwork:
    """Resumes from a checkpoint in the folder, or begins with the tensors of an earlier mouth, if any."""
    torch.manual_seed(plan.seed)
    network = MouthNetwork(front.width, len(names), rows=front.sizes.rows, taps=front.sizes.taps, **plan.network)
    some = torch.cat([example.rows[::7].float() for example in examples])
    network.mean.copy_(some.mean(0))
    network.scale.copy_(1.0 / some.std(0).clamp(min=0.1))
    with torch.no_grad():
        network.head.bias[:-1] = torch.from_numpy(rest).float()
    optimizer = torch.optim.AdamW(network.parameters(), plan.rate, betas=(0.9, 0.98), weight_decay=0.02)

    def rate(step: int) -> float:
        return float(min(1.0, (step + 1) / 100) * (0.02 + 0.49 * (1 + np.cos(np.pi * min(1.0, step / plan.steps)))))

    schedule = torch.optim.lr_scheduler.LambdaLR(optimizer, rate)
    saved = Saved(folder / "mouth.pt", network=network, optimizer=optimizer, schedule=schedule)
    start = saved.load()
    log = Log(folder / "mouth.csv", start)
    at = [ARKIT.index(name) for name in names]
    lips = torch.from_numpy(np.stack([OPENING[at], WIDTH[at], ROUNDING[at]], 1)).float()
    if begin and not start:
        network.load_state_dict({name: begin[f"mouth.{name}"].float() for name in network.state_dict()})
    chances = _chances(plan, examples)
    bar = tqdm(range(start, plan.steps), "mouth", initial=start, total=plan.steps)
    for step in bar:
        chance = np.random.default_rng((plan.seed, step))
        picked = chance.choice(len(examples), plan.batch, p=chances)
        batch = [_stretch(examples[i], front, plan.frames, chance) for i in picked]
        rows, *columns = (torch.stack(column).float() for column in zip(*batch, strict=True))
        if plan.warp:
            scales = 1.0 + plan.warp * torch.from_numpy(chance.uniform(-1.0, 1.0, plan.batch)).float()
            rows = warped(rows, front.sizes.bands, scales)
        loss, values = loss_of(network, plan, lips, rows, *columns)
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimizer.step()
        schedule.step()
        log.add(step, values)
        if step % 20 == 0:
            bar.set_postfix({name: f"{value:.4f}" for name, value in values.items()})
        if (step + 1) % SAVE_EVERY == 0 or step + 1 == plan.steps:
            saved.save(step + 1)
    log.write(plan.steps - 1)
    return network.eval()


def _chances(plan: MouthPlan, examples: Sequence[Example]) -> np.ndarray:
    """Probability of each example: its kind's share, by length within the kind."""
    kinds = np.array([int(example.kind) for example in examples])
    lengths = np.array([len(example.voice) for example in examples], float)
    shares = np.array([plan.shares[name] for name in KINDS])
    out = shares[kinds] * lengths / np.bincount(kinds, lengths, len(KINDS))[kinds]
    return out / out.sum()


def _stretch(example: Example, front: Front, frames: int, chance: np.random.Generator) -> tuple[Tensor, ...]:
    """Consecutive frames; a shorter clip is padded with its last frame, which has no weight."""
    count = len(example.voice)
    # The start of a stream is as important as the rest.
    first = 0 if chance.random() < 0.2 else int(chance.integers(max(count - frames, 0) + 1))
    length = min(frames, count)
    rows = example.rows[first * front.sizes.rows :][: front.row_count(length)]
    rows = torch.cat([rows, rows[-1:].expand((frames - length) * front.sizes.rows, -1)])
    columns = [
        x[first : first + length] for x in (example.mouth, example.voice, example.mouth_weight, example.voice_weight)
    ]
    padded = []
    for i, column in enumerate(columns):
        end = column[-1:].expand(frames - length, *column.shape[1:]) * (0.0 if i >= 2 else 1.0)
        padded.append(torch.cat([column, end]))
    return rows, *padded, example.known


def loss_of(
    network: MouthNetwork,
    plan: MouthPlan,
    lips: Tensor,
    rows: Tensor,
    mouth: Tensor,
    voice: Tensor,
    mouth_weight: Tensor,
    voice_weight: Tensor,
    known: Tensor,
) -> tuple[Tensor, dict[str, float]]:
    """`lips [channels, 3]`: opening, width and rounding of the channels."""
    rows = rows + plan.noise / network.scale * torch.randn_like(rows) if network.training else rows
    wanted = (mouth, voice, mouth_weight, voice_weight)
    if not network.behind:
        return _loss(plan, lips, network(rows), *_earlier(plan.lead, *wanted), known)
    now, later = network.both(rows)
    live = replace(plan, closures=plan.live * plan.closures)
    loss, values = _loss(live, lips, now, *_earlier(plan.lead, *wanted), known)
    behind = network.behind
    more, others = _loss(plan, lips, later[:, behind:], *(x[:, :-behind] for x in wanted), known)
    return loss + plan.later * more, values | {f"later {name}": value for name, value in others.items()}


def warped(rows: Tensor, bands: int, scales: Tensor) -> Tensor:
    """Rows `[batch, rows, features]` whose first `bands` are read at their frequencies times `scales` `[batch]`."""
    # `umo_train.audio.mel.filters`' triangles.
    lowest, highest = _mel(torch.tensor([60.0, 7600.0]))
    step = (highest - lowest) / (bands + 1)
    centers = 700.0 * (10.0 ** ((lowest + step * torch.arange(1, bands + 1)) / 2595.0) - 1.0)
    at = ((_mel(centers * scales[:, None]) - lowest) / step - 1.0).clamp(0.0, bands - 1.0)
    low = at.floor().clamp(max=bands - 2.0)
    index = low.long()[:, None].expand(-1, rows.shape[1], -1)
    moved = torch.lerp(rows.gather(2, index), rows.gather(2, index + 1), (at - low)[:, None])
    return torch.cat([moved, rows[..., bands:]], -1)


def _mel(hertz: Tensor) -> Tensor:
    return 2595.0 * torch.log10(1.0 + hertz / 700.0)


def closing(opening: Tensor) -> Tensor:
    """Share to which each frame of `[batch, frames]` is a short closure between open lips."""
    around = torch.nn.functional.max_pool1d(opening[:, None], 11, 1, 5)[:, 0]
    return ((0.1 - opening) / 0.06).clamp(0, 1) * ((around - 0.1) / 0.1).clamp(0, 1)


def _earlier(lead: float, mouth: Tensor, voice: Tensor, *weights: Tensor) -> tuple[Tensor, ...]:
    """Targets of `lead` frames later, 0 to 1."""

    def moved(x: Tensor) -> Tensor:
        return torch.lerp(x, torch.cat([x[:, 1:], x[:, -1:]], 1), lead)

    return moved(mouth), moved(voice), *weights


def _loss(
    plan: MouthPlan,
    lips: Tensor,
    outputs: Tensor,
    mouth: Tensor,
    voice: Tensor,
    mouth_weight: Tensor,
    voice_weight: Tensor,
    known: Tensor,
) -> tuple[Tensor, dict[str, float]]:
    channels, odds = outputs[..., :-1], outputs[..., -1]
    count = mouth_weight.sum().clamp(min=1.0)
    closed = closing(mouth @ lips[:, 0])
    # Lips may touch firmly.
    apart = ((channels @ lips[:, 0]).clamp(min=-0.04) - (mouth @ lips[:, 0]).clamp(max=0.0)).clamp(min=0.0)
    closures = (apart.square() * closed * mouth_weight).sum() / count
    opened = ((mouth @ lips[:, 0] - 0.1) / 0.06).clamp(0, 1)
    less = ((mouth - channels) @ lips[:, 0]).clamp(min=0.0)
    less = (less.square() * opened * mouth_weight).sum() / count
    error = (channels - mouth) * known[:, None]
    shapes = (error.square().mean(-1) * mouth_weight).sum() / count
    weights = torch.tensor([plan.opening, plan.width, plan.width])
    parts = ((error @ lips).square() * mouth_weight[..., None]).sum((0, 1)) / count
    both = mouth_weight[:, 1:] * mouth_weight[:, :-1]
    speed = (error.diff(dim=1).square().mean(-1) * both).sum() / count
    entropy = torch.nn.functional.binary_cross_entropy_with_logits(odds, voice, reduction="none")
    entropy = (entropy * voice_weight).sum() / voice_weight.sum().clamp(min=1.0)
    lip_terms = (weights * parts).sum() + plan.closures * closures + plan.open * less
    loss = shapes + lip_terms / len(lips) + plan.velocity * speed + plan.voice * entropy
    values = {"shapes": shapes, "lips": parts[0], "width": parts[1], "closures": closures, "speed": speed}
    values["voice"] = entropy
    return loss, {name: value.item() for name, value in values.items()}
