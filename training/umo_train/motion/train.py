"""Trains the motion tokenizers (SPEC 2.7): straight-through VQ-VAEs, their codebooks, and the root network."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from umo_train.device import best
from umo_train.log import Log
from umo_train.motion.channels import LEAST_SCALE, weights
from umo_train.motion.networks import RootNetwork, VqVae
from umo_train.skeleton import CHANNELS, CONTACT, VELOCITY
from umo_train.state import Chance, Saved

SAVE_EVERY = 500


@dataclass(frozen=True)
class TokenizerPlan:
    """Settings of one network. `layers` as in the model file; `stride` is the keyframes'."""

    width: int
    layers: int
    codes: int
    steps: int
    stride: int
    batch: int = 32
    frames: int = 96
    rate: float = 1e-3
    commitment: float = 0.25
    velocity: float = 1.0
    # Weight of the error with codes between keyframes interpolated from their neighbours: keyframe codes learn to
    # represent the time around them, since the language model only produces keyframes.
    sparse: float = 0.5
    seed: int = 0


def train_part(plan: TokenizerPlan, part: str, motions: list[np.ndarray], folder: Path) -> VqVae:
    """`motions` are `[T, channels]`. Resumes from a checkpoint in the folder."""
    torch.manual_seed(plan.seed)
    device = best()
    channels = motions[0].shape[1]
    model = VqVae(plan.width, channels, plan.layers, plan.codes)
    everything = torch.from_numpy(np.concatenate(motions[:: max(1, len(motions) // 400)]))
    model.mean.copy_(everything.mean(0))
    model.scale.copy_(everything.std(0).clamp(min=LEAST_SCALE[part]))
    weight = torch.from_numpy(weights(part, channels))
    weight = weight.to(device) / weight.mean()
    model.to(device)
    optimizer = torch.optim.AdamW(model.parameters(), plan.rate, betas=(0.9, 0.99), weight_decay=1e-4)
    schedule = torch.optim.lr_scheduler.LambdaLR(optimizer, lambda step: _rate(step, plan.steps))
    chance = np.random.default_rng((plan.seed, 0))
    path = folder / f"tokenizer_{part}.pt"
    saved = Saved(path, model=model, optimizer=optimizer, schedule=schedule, chance=Chance(chance))
    start = saved.load()
    log = Log(folder / f"tokenizer_{part}.csv", start)
    for step in tqdm(range(start, plan.steps), f"tokenizer {part}", initial=start, total=plan.steps):
        x = torch.from_numpy(_crops(motions, plan.batch, plan.frames, chance)).to(device)
        loss, parts = _loss(model, plan, x, weight, step)
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(model.parameters(), 1.0)
        optimizer.step()
        schedule.step()
        log.add(step, parts)
        if (step + 1) % SAVE_EVERY == 0 or step + 1 == plan.steps:
            saved.save(step + 1)
    log.write(plan.steps - 1)
    return model.eval()


def _rate(step: int, steps: int) -> float:
    """Linear warm-up over 100 steps, then a cosine to a twentieth."""
    return float(min(1.0, (step + 1) / 100) * (0.05 + 0.95 * 0.5 * (1 + np.cos(np.pi * min(1.0, step / steps)))))


def _crops(motions: list[np.ndarray], batch: int, frames: int, chance: np.random.Generator) -> np.ndarray:
    lengths = np.array([max(len(m) - frames, 0) for m in motions], float)
    out = []
    for i in chance.choice(len(motions), batch, p=lengths / lengths.sum()):
        start = chance.integers(len(motions[i]) - frames + 1)
        out.append(motions[i][start : start + frames])
    return np.stack(out).astype(np.float32)


def _loss(model: VqVae, plan: TokenizerPlan, x: Tensor, weight: Tensor, step: int) -> tuple[Tensor, dict[str, float]]:
    z = model.latents(x)
    rows = z.detach().flatten(0, 1)
    codes = model.quantizer.nearest(rows)
    vectors = model.quantizer.embedding(codes).view_as(z)
    # The first steps train without codes, so that the codebook is initialised from meaningful latents.
    warm = plan.steps // 20
    if step >= warm:
        model.quantizer.follow(rows, codes)
    elif step == warm - 1:
        model.quantizer.embedding.weight.data.copy_(rows[torch.randperm(len(rows))[: plan.codes].to(rows.device)])
    through = z + (vectors - z).detach() if step >= warm else z
    error, speed = _errors(model, model.decode(through), x, weight)
    commitment = torch.nn.functional.mse_loss(z, vectors) if step >= warm else z.new_zeros(())
    loss = error + plan.velocity * speed + plan.commitment * commitment
    terms = {"error": error.item(), "velocity": speed.item(), "commitment": commitment.item()}
    if plan.sparse > 0 and step >= warm:
        between = _between(through, plan.stride, step % plan.stride)
        sparse, sparse_speed = _errors(model, model.decode(between), x, weight)
        loss = loss + plan.sparse * (sparse + plan.velocity * sparse_speed)
        terms["sparse"] = sparse.item()
    if step >= warm:
        use = torch.bincount(codes, minlength=plan.codes).float() / len(codes)
        terms["perplexity"] = float(torch.exp(-(use * (use + 1e-9).log()).sum()))
    return loss, terms


def _errors(model: VqVae, y: Tensor, x: Tensor, weight: Tensor) -> tuple[Tensor, Tensor]:
    """Weighted squared errors of position and of frame-to-frame change, in units of each channel's range."""
    difference = (y - x) / model.scale
    return (weight * difference**2).mean(), (weight * difference.diff(dim=1) ** 2).mean()


def _between(vectors: Tensor, stride: int, phase: int) -> Tensor:
    """Every `stride`-th vector from `phase` is kept, the others are linearly interpolated from the neighbouring kept
    ones.
    """
    frames = torch.arange(vectors.shape[1], device=vectors.device)
    last = phase + (vectors.shape[1] - 1 - phase) // stride * stride
    place = frames.clamp(phase, last) - phase
    left = phase + place // stride * stride
    right = (left + stride).clamp(max=last)
    share = ((place % stride) / stride)[None, :, None]
    return vectors[:, left] * (1 - share) + vectors[:, right] * share


def train_root(plan: TokenizerPlan, motions: list[tuple[np.ndarray, np.ndarray]], folder: Path) -> RootNetwork:
    """`motions` are lower-body channels `[T, 61]` and heights `[T]`, metres."""
    torch.manual_seed(plan.seed)
    device = best()
    model = RootNetwork(plan.width, CHANNELS["lower"], plan.layers).to(device)
    optimizer = torch.optim.AdamW(model.parameters(), plan.rate, betas=(0.9, 0.99), weight_decay=1e-4)
    schedule = torch.optim.lr_scheduler.LambdaLR(optimizer, lambda step: _rate(step, plan.steps))
    chance = np.random.default_rng((plan.seed, 0))
    path = folder / "tokenizer_root.pt"
    saved = Saved(path, model=model, optimizer=optimizer, schedule=schedule, chance=Chance(chance))
    start = saved.load()
    log = Log(folder / "tokenizer_root.csv", start)
    joined = [np.concatenate([lower, height[:, None]], 1) for lower, height in motions]
    target_weight = torch.ones(CHANNELS["lower"], device=device)
    # Metres and metres per second of the whole body's position: errors of a centimetre and of a centimetre per second
    # are visible.
    target_weight[VELOCITY] = torch.tensor([30.0, 300.0, 30.0], device=device)
    target_weight[CONTACT] = 0.1
    for step in tqdm(range(start, plan.steps), "tokenizer root", initial=start, total=plan.steps):
        crop = torch.from_numpy(_crops(joined, plan.batch, plan.frames, chance)).to(device)
        target = crop[..., :-1].clone()
        target[..., VELOCITY.start + 1] = crop[..., -1]
        # Its inputs will be decoded codes: add small smooth errors.
        draws = torch.randn(plan.batch, 54, plan.frames, device=device)
        noise = torch.nn.functional.avg_pool1d(draws, 5, 1, 2).transpose(1, 2)
        source = crop[..., :-1].clone()
        source[..., :54] += 0.01 * noise
        source[..., VELOCITY] = 0.0
        y = model(source)
        error = (target_weight * (y - target) ** 2).mean()
        drift = (y - target)[..., VELOCITY.start :: 2][..., :2].cumsum(1).div(30).pow(2).mean()
        loss = error + 30.0 * drift
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(model.parameters(), 1.0)
        optimizer.step()
        schedule.step()
        log.add(step, {"error": error.item(), "drift": drift.item()})
        if (step + 1) % SAVE_EVERY == 0 or step + 1 == plan.steps:
            saved.save(step + 1)
    log.write(plan.steps - 1)
    return model.eval()


@torch.no_grad()
def tokenize(model: VqVae, motion: np.ndarray) -> np.ndarray:
    """`[T, channels]` to codes `[T]`."""
    frames = torch.from_numpy(motion.astype(np.float32))[None].to(model.mean.device)
    return model.codes(frames)[0].cpu().numpy().astype(np.int16)
