"""Trains the live mouth: least squares on the channels, an extra term for the lips' opening, and voice detection."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from umo_train.log import Log
from umo_train.mouth.examples import Example
from umo_train.mouth.features import Front
from umo_train.mouth.network import MouthNetwork
from umo_train.performer.lips import OPENING
from umo_train.skeleton import ARKIT
from umo_train.state import Saved

SAVE_EVERY = 250


@dataclass(frozen=True)
class MouthPlan:
    """`frames` of each of `batch` clips per step; the weights apply to the loss terms other than the channels."""

    steps: int
    frames: int = 160
    batch: int = 32
    rate: float = 2e-3
    opening: float = 2.0
    velocity: float = 1.0
    voice: float = 0.03
    noise: float = 0.05
    seed: int = 0
    network: dict[str, Any] = field(default_factory=dict)


def train(
    plan: MouthPlan, front: Front, examples: Sequence[Example], names: Sequence[str], rest: np.ndarray, folder: Path
) -> MouthNetwork:
    """Resumes from a checkpoint in the folder."""
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
    opening = torch.tensor([OPENING[ARKIT.index(name)] for name in names]).float()
    lengths = np.array([len(example.voice) for example in examples], float)
    bar = tqdm(range(start, plan.steps), "mouth", initial=start, total=plan.steps)
    for step in bar:
        chance = np.random.default_rng((plan.seed, step))
        picked = chance.choice(len(examples), plan.batch, p=lengths / lengths.sum())
        batch = [_stretch(examples[i], front, plan.frames, chance) for i in picked]
        columns = (torch.stack(column).float() for column in zip(*batch, strict=True))
        loss, values = loss_of(network, plan, opening, *columns)
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
    return rows, *padded


def loss_of(
    network: MouthNetwork,
    plan: MouthPlan,
    opening: Tensor,
    rows: Tensor,
    mouth: Tensor,
    voice: Tensor,
    mouth_weight: Tensor,
    voice_weight: Tensor,
) -> tuple[Tensor, dict[str, float]]:
    rows = rows + plan.noise / network.scale * torch.randn_like(rows) if network.training else rows
    outputs = network(rows)
    channels, odds = outputs[..., :-1], outputs[..., -1]
    count = mouth_weight.sum().clamp(min=1.0)
    error = channels - mouth
    shapes = (error.square().mean(-1) * mouth_weight).sum() / count
    lips = ((error @ opening).square() * mouth_weight).sum() / count
    both = mouth_weight[:, 1:] * mouth_weight[:, :-1]
    speed = (error.diff(dim=1).square().mean(-1) * both).sum() / count
    entropy = torch.nn.functional.binary_cross_entropy_with_logits(odds, voice, reduction="none")
    entropy = (entropy * voice_weight).sum() / voice_weight.sum().clamp(min=1.0)
    loss = shapes + plan.opening * lips / opening.numel() + plan.velocity * speed + plan.voice * entropy
    values = {"shapes": shapes, "lips": lips, "speed": speed, "voice": entropy}
    return loss, {name: value.item() for name, value in values.items()}
