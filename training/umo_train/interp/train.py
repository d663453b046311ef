"""Trains the interpolation network: masked cross-entropy and a smoothness loss on code vectors (paper 3.4)."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from umo_train.device import best
from umo_train.interp.model import Interpolation
from umo_train.log import Log
from umo_train.skeleton import PARTS
from umo_train.state import Saved

SAVE_EVERY = 250


@dataclass(frozen=True)
class InterpPlan:
    """`velocity` and `acceleration` weight the smoothness terms; `shortest` is the minimum number of keyframes in a
    window.

    With `near`, label smoothing distributes `smoothing` over similar codes instead of uniformly: by the squared
    distance of their vectors, over `near` times its mean. The most likely code then lies in the middle of the plausible
    ones.
    """

    steps: int
    frames: int
    batch: int = 32
    rate: float = 1e-3
    smoothing: float = 0.1
    near: float = 0.0
    velocity: float = 1e-3
    acceleration: float = 1e-4
    shortest: int = 2
    # Share of keyframe codes replaced at random: the language model's keyframes are not always the performer's.
    noise: float = 0.02
    seed: int = 0


def train(
    plan: InterpPlan,
    config: dict[str, Any],
    codes: list[np.ndarray],
    folder: Path,
    codebooks: dict[str, Tensor] | None = None,
) -> Interpolation:
    """`codes` are `[4, T]` of every frame; with `codebooks` the network is initialised from them. Resumes from a
    checkpoint in the folder.

    Raises `ValueError` for a plan with `near` and no `codebooks`.
    """
    if plan.near > 0 and codebooks is None:
        raise ValueError("`near` of the interpolation's training needs the code vectors")
    torch.manual_seed(plan.seed)
    device = best()
    model = Interpolation(config)
    if codebooks is not None:
        model.know(codebooks)
    model = model.to(device)
    alike = None if codebooks is None or plan.near <= 0 else likeness(codebooks, plan.near).to(device)
    optimizer = torch.optim.AdamW(model.parameters(), plan.rate, betas=(0.9, 0.99), weight_decay=0.05)

    def rate(step: int) -> float:
        return float(min(1.0, (step + 1) / 200) * (0.05 + 0.475 * (1 + np.cos(np.pi * min(1.0, step / plan.steps)))))

    schedule = torch.optim.lr_scheduler.LambdaLR(optimizer, rate)
    saved = Saved(folder / "interp.pt", model=model, optimizer=optimizer, schedule=schedule)
    start = saved.load()
    log = Log(folder / "interp.csv", start)
    for step in tqdm(range(start, plan.steps), "interpolation", initial=start, total=plan.steps):
        chance = np.random.default_rng((plan.seed, step))
        truth, padding = (x.to(device) for x in _windows(plan, codes, model.stride, chance))
        loss, values = loss_of(model, plan, truth, padding, chance, alike)
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(model.parameters(), 1.0)
        optimizer.step()
        schedule.step()
        log.add(step, values)
        if (step + 1) % SAVE_EVERY == 0 or step + 1 == plan.steps:
            saved.save(step + 1)
    log.write(plan.steps - 1)
    return model.eval()


def _windows(
    plan: InterpPlan, codes: list[np.ndarray], stride: int, chance: np.random.Generator
) -> tuple[Tensor, Tensor]:
    """`[b, 4, t]` codes and `[b, t]` padding: windows of various lengths, each starting at a keyframe."""
    out = np.zeros((plan.batch, len(PARTS), plan.frames), np.int64)
    padding = np.ones((plan.batch, plan.frames), bool)
    for row, pad in zip(out, padding, strict=True):
        item = codes[chance.integers(len(codes))]
        length = min(int(chance.integers(plan.shortest * stride, plan.frames + 1)), item.shape[1])
        at = int(chance.integers((item.shape[1] - length) // stride + 1)) * stride
        row[:, :length] = item[:, at : at + length]
        pad[:length] = False
    return torch.from_numpy(out), torch.from_numpy(padding)


def likeness(codebooks: dict[str, Tensor], near: float) -> Tensor:
    """`[4, codes, codes]`: similarity of codes, with rows that sum to 1."""
    apart = torch.stack([torch.cdist(codebooks[part], codebooks[part]).square() for part in PARTS])
    return torch.softmax(-apart / (near * apart.mean((1, 2), keepdim=True)), -1)


def loss_of(
    model: Interpolation,
    plan: InterpPlan,
    truth: Tensor,
    padding: Tensor,
    chance: np.random.Generator,
    alike: Tensor | None = None,
) -> tuple[Tensor, dict[str, float]]:
    """The objective of one batch. Anchors are every keyframe and the last unpadded frame; `alike` is `likeness` if the
    plan has `near`."""
    batch, _, frames = truth.shape
    device = truth.device
    anchor = (torch.arange(frames, device=device) % model.stride == 0).repeat(batch, 1)
    anchor[torch.arange(batch, device=device), (~padding).sum(1) - 1] = True
    seen = torch.where(anchor[:, None], truth, model.codes)
    noisy = torch.from_numpy(chance.random(truth.shape) < plan.noise).to(device) & anchor[:, None]
    others = torch.from_numpy(chance.integers(0, model.codes, truth.shape)).to(device)
    seen = torch.where(noisy, others, seen)
    logits = model(seen, padding)
    asked = ~anchor & ~padding
    flat = asked[:, None].expand_as(truth)
    wanted = truth[flat]
    if alike is None:
        entropy = torch.nn.functional.cross_entropy(logits[flat], wanted, label_smoothing=plan.smoothing)
    else:
        part = torch.arange(len(PARTS), device=device)[None, :, None].expand_as(truth)[flat]
        spread = torch.nn.functional.cross_entropy(logits[flat], alike[part, wanted])
        right = torch.nn.functional.cross_entropy(logits[flat], wanted)
        entropy = plan.smoothing * spread + (1 - plan.smoothing) * right
    filled = torch.where(anchor[:, None], seen, logits.argmax(-1).detach())
    velocity, acceleration = _smoothness(model, filled, ~padding)
    loss = entropy + plan.velocity * velocity + plan.acceleration * acceleration
    hits = (logits.argmax(-1) == truth) & flat
    values = {f"accuracy_{part}": float(hits[:, i].sum() / asked.sum()) for i, part in enumerate(PARTS)}
    return loss, values | {"entropy": entropy.item(), "velocity": velocity.item(), "acceleration": acceleration.item()}


def _smoothness(model: Interpolation, codes: Tensor, valid: Tensor) -> tuple[Tensor, Tensor]:
    """Mean squared first and second differences of the selected codes' vectors, excluding pairs and triples with
    padding.
    """
    pairs, triples = valid[:, 1:] & valid[:, :-1], valid[:, 2:] & valid[:, 1:-1] & valid[:, :-2]
    velocity = acceleration = torch.zeros((), device=codes.device)
    for i, part in enumerate(PARTS):
        vectors = model.embed[part](codes[:, i])
        first, second = vectors.diff(dim=1), vectors.diff(n=2, dim=1)
        velocity = velocity + first[pairs].pow(2).mean() / len(PARTS)
        acceleration = acceleration + second[triples].pow(2).mean() / len(PARTS)
    return velocity, acceleration


@torch.no_grad()
def fill(model: Interpolation, codes: np.ndarray) -> np.ndarray:
    """`[4, T]` codes with `model.codes` if masked, all frames filled."""
    seen = torch.from_numpy(codes.astype(np.int64))[None]
    best = model(seen).argmax(-1)
    return torch.where(seen == model.codes, best, seen)[0].numpy()
