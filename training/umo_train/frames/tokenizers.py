"""Trains the tokenizers of layout `frames`: residual codebooks of every part, and the root network on what they say."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from umo_train.device import best
from umo_train.frames import feet, parts
from umo_train.frames.networks import ResidualVqVae
from umo_train.frames.parts import Part
from umo_train.log import Log
from umo_train.motion.networks import RootNetwork
from umo_train.motion.train import _between, _crops, _rate
from umo_train.skeleton import CHANNELS, CONTACT, VELOCITY
from umo_train.speech.utterance import FRAME_RATE
from umo_train.state import Chance, Saved

SAVE_EVERY = 250
# Smallest standard deviation that a channel is divided by: below it, differences are not seen.
LEAST_SCALE = 0.01
# Batches whose latents the codebooks start from, and rounds of k-means over them.
_START_BATCHES, _START_ROUNDS = 6, 8


@dataclass(frozen=True)
class ResidualPlan:
    """Of one part's tokenizer. `stride` is the keyframes'; errors of speed and acceleration are per frame."""

    steps: int
    stride: int
    batch: int = 24
    frames: int = 96
    rate: float = 1.5e-3
    commitment: float = 0.25
    velocity: float = 2.0
    acceleration: float = 2.0
    # Of the lower body: planted feet that slide, metres a second squared.
    slide: float = 20.0
    # Share of examples of which only the first levels are used: each level then says the most that it can.
    dropout: float = 0.25
    # Share of examples whose codes between keyframes are mixed from their neighbours': what is said at keyframes is all
    # that the language model makes.
    sparse: float = 0.35
    seed: int = 0


class PartLoss:
    """What the errors of a part's channels cost, as a share of what doing nothing at all would."""

    def __init__(self, part: Part, plan: ResidualPlan, deviation: Tensor) -> None:
        weight = torch.from_numpy(parts.weights(part)).to(deviation.device)
        self.plan = plan
        self.weight = weight / (weight * deviation**2).sum()
        self.legs = _legs(part)

    def __call__(self, y: Tensor, x: Tensor) -> tuple[Tensor, dict[str, float]]:
        """`[b, t, channels]` of what was decoded and of the motion."""
        difference = y - x
        terms = [
            (self.weight * d**2).sum(-1).mean() for d in (difference, *(difference.diff(n=n, dim=1) for n in (1, 2)))
        ]
        loss = terms[0] + self.plan.velocity * terms[1] + self.plan.acceleration * terms[2]
        values = dict(zip(("error", "velocity", "acceleration"), (term.item() for term in terms), strict=True))
        if self.legs is not None and self.plan.slide > 0:
            slide = self._slide(y[..., self.legs], x[..., self.legs])
            loss = loss + self.plan.slide * slide
            values["slide"] = slide.item()
        return loss, values

    def _slide(self, y: Tensor, x: Tensor) -> Tensor:
        """Squared differences of the speed of planted feet under the pelvis, (m/s)^2, along the floor."""
        planted = x[..., CONTACT] > 0.5
        both = (planted[:, 1:] & planted[:, :-1])[..., None]
        moved = (feet.places(y) - feet.places(x).detach()).diff(dim=1) * FRAME_RATE
        return (both * moved[..., [0, 2]] ** 2).sum() / both.sum().clamp(min=1)


def _legs(part: Part) -> list[int] | None:
    """Columns of a part that has all of the lower body, in the body's order; None for another part."""
    if set(part.channels) != {name for name, _ in parts.named([])["lower"]}:
        return None
    _, at = parts.columns(part, [])
    return np.argsort(at).tolist()


def train_part(plan: ResidualPlan, part: Part, motions: list[np.ndarray], folder: Path) -> ResidualVqVae:
    """`motions` are `[T, channels]`. Resumes from what is in the folder."""
    torch.manual_seed(plan.seed)
    device = best()
    channels = motions[0].shape[1]
    model = ResidualVqVae(part, channels)
    everything = torch.from_numpy(np.concatenate(motions[:: max(1, len(motions) // 400)]))
    deviation = everything.std(0)
    model.mean.copy_(everything.mean(0))
    model.scale.copy_(deviation.clamp(min=LEAST_SCALE))
    model.to(device)
    loss_of_part = PartLoss(part, plan, deviation.to(device))
    optimizer = torch.optim.AdamW(model.parameters(), plan.rate, betas=(0.9, 0.99), weight_decay=1e-4)
    schedule = torch.optim.lr_scheduler.LambdaLR(optimizer, lambda step: _rate(step, plan.steps))
    chance = np.random.default_rng((plan.seed, 0))
    path = folder / f"tokenizer_{part.name}.pt"
    saved = Saved(path, model=model, optimizer=optimizer, schedule=schedule, chance=Chance(chance))
    start = saved.load()
    log = Log(folder / f"tokenizer_{part.name}.csv", start)
    warm = warm_steps(plan)
    for step in tqdm(range(start, plan.steps), f"tokenizer {part.name}", initial=start, total=plan.steps):
        if step == warm:
            start_codebooks(model, plan, motions, chance)
        x = torch.from_numpy(_crops(motions, plan.batch, plan.frames, chance)).to(device)
        loss, values = loss_of(model, plan, x, loss_of_part, chance, coded=step >= warm, phase=step % plan.stride)
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


def warm_steps(plan: ResidualPlan) -> int:
    """The first steps train without codes, so that the codebooks start among latents that mean something."""
    return plan.steps // 20


@torch.no_grad()
def start_codebooks(
    model: ResidualVqVae, plan: ResidualPlan, motions: list[np.ndarray], chance: np.random.Generator
) -> None:
    """Every level from the k-means of what the levels before it leave."""
    device = model.mean.device
    crops = np.concatenate([_crops(motions, plan.batch, plan.frames, chance) for _ in range(_START_BATCHES)])
    left = model.latents(torch.from_numpy(crops).to(device)).flatten(0, 1)
    for level in model.levels:
        table, count = level.embedding.weight, len(level.count)
        table.copy_(left[torch.randint(len(left), (count,), device=device)])
        for _ in range(_START_ROUNDS):
            chosen = level.nearest(left)
            hits = torch.bincount(chosen, minlength=count)
            sums = torch.zeros_like(table).index_add_(0, chosen, left)
            table[hits > 0] = sums[hits > 0] / hits[hits > 0, None]
        # As if the running means had seen these alone.
        level.count.copy_(hits.float() / _START_BATCHES)
        level.total.copy_(table * level.count[:, None])
        left = left - level.embedding(level.nearest(left))


def used_levels(plan: ResidualPlan, levels: int, chance: np.random.Generator) -> np.ndarray:
    """How many levels each example of a batch uses `[batch]`: all, or for a share of them the first few."""
    fewer = chance.integers(1, levels + 1, plan.batch)
    return np.where(chance.random(plan.batch) < plan.dropout, fewer, levels)


def loss_of(
    model: ResidualVqVae,
    plan: ResidualPlan,
    x: Tensor,
    loss_of_part: PartLoss,
    chance: np.random.Generator,
    *,
    coded: bool,
    phase: int,
) -> tuple[Tensor, dict[str, float]]:
    """The objective of one batch `[b, t, channels]`; with `coded` the codebooks follow what they are asked to say."""
    z = model.latents(x)
    used = torch.from_numpy(used_levels(plan, len(model.levels), chance)).to(x.device)
    sparse = torch.from_numpy(chance.random(len(x)) < plan.sparse).to(x.device)
    if not coded:
        return loss_of_part(model.decode(z), x)
    rows = z.flatten(0, 1)
    codes, vectors, asked = model.quantized(rows.detach(), used.repeat_interleave(x.shape[1]))
    spoken = vectors.sum(1).view_as(z)
    for i, level in enumerate(model.levels):
        level.follow(asked[:, i], codes[:, i])
    through = z + (spoken - z).detach()
    mixed = _between(through, plan.stride, phase)
    loss, values = loss_of_part(model.decode(torch.where(sparse[:, None, None], mixed, through)), x)
    # Of each level that is used: what the levels up to it leave.
    levels = torch.arange(1, len(model.levels) + 1, device=x.device)
    uses = (used.repeat_interleave(x.shape[1])[:, None] >= levels).float()
    left = (rows[:, None] - vectors.cumsum(1)).pow(2).mean(-1)
    commitment = (uses * left).sum() / uses.sum()
    values["commitment"] = commitment.item()
    for i, level in enumerate(model.levels):
        share = torch.bincount(codes[:, i], minlength=len(level.count)).float() / len(codes)
        values[f"perplexity_{i}"] = float(torch.exp(-(share * (share + 1e-9).log()).sum()))
    return loss + plan.commitment * commitment, values


@torch.no_grad()
def tokenize(model: ResidualVqVae, motion: np.ndarray) -> np.ndarray:
    """`[T, channels]` to codes `[T, levels]`."""
    frames = torch.from_numpy(motion.astype(np.float32))[None].to(model.mean.device)
    return model.codes(frames)[0].cpu().numpy().astype(np.int16)


@torch.no_grad()
def decoded(model: ResidualVqVae, codes: np.ndarray, levels: int | None = None, stride: int = 1) -> np.ndarray:
    """Codes `[T, levels]` to motion `[T, channels]`: by the first levels alone, or from every `stride`-th frame's
    vectors with straight lines between them."""
    some = torch.from_numpy(codes.astype(np.int64))[None, :, :levels].to(model.mean.device)
    return model.decode(_between(model.vectors(some), stride, 0))[0].cpu().numpy()


@dataclass(frozen=True)
class RootPlan:
    """Of the root network. `slide` weighs planted feet that slide, (m/s)^2."""

    steps: int
    width: int
    layers: int
    batch: int = 32
    frames: int = 96
    rate: float = 1e-3
    slide: float = 300.0
    seed: int = 0


@dataclass(frozen=True)
class RootItem:
    """One item: the lower body as the performer has it `[T, 61]` and as codes say it (each `[T, 61]`), and the pelvis'
    height `[T]`, metres."""

    lower: np.ndarray
    said: tuple[np.ndarray, ...]
    height: np.ndarray


def train_root(plan: RootPlan, items: list[RootItem], folder: Path) -> RootNetwork:
    """The root from the lower body, as it is and as codes say it: the body goes so that planted feet stay."""
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
    width = CHANNELS["lower"]
    joined = [np.concatenate([lower, item.lower, item.height[:, None]], 1)
              for item in items for lower in (item.lower, *item.said)]  # fmt: skip
    weight = torch.ones(width, device=device)
    weight[VELOCITY] = torch.tensor([30.0, 300.0, 30.0], device=device)
    weight[CONTACT] = 0.1
    for step in tqdm(range(start, plan.steps), "tokenizer root", initial=start, total=plan.steps):
        crop = torch.from_numpy(_crops(joined, plan.batch, plan.frames, chance)).to(device)
        source, truth = rooted(crop[..., :width]), crop[..., width:-1].clone()
        y = model(source)
        slide = sliding(y[..., VELOCITY], feet.places(source), truth[..., CONTACT] > 0.5)
        truth[..., VELOCITY.start + 1] = crop[..., -1]
        error = (weight * (y - truth) ** 2).mean()
        drift = (y - truth)[..., VELOCITY.start :: 2][..., :2].cumsum(1).div(FRAME_RATE).pow(2).mean()
        loss = error + 30.0 * drift + plan.slide * slide
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(model.parameters(), 1.0)
        optimizer.step()
        schedule.step()
        log.add(step, {"error": error.item(), "drift": drift.item(), "slide": slide.item()})
        if (step + 1) % SAVE_EVERY == 0 or step + 1 == plan.steps:
            saved.save(step + 1)
    log.write(plan.steps - 1)
    return model.eval()


def rooted(lower: Tensor) -> Tensor:
    """What the root network sees of decoded channels `[..., 61]`: rotations made proper, no velocity (SPEC 2.7)."""
    joints = len(feet.NAMES)
    out = lower.clone()
    proper = feet.matrices(lower[..., : 6 * joints].unflatten(-1, (joints, 6)))[..., :2, :]
    out[..., : 6 * joints] = proper.flatten(-3)
    out[..., VELOCITY] = 0.0
    return out


def sliding(velocity: Tensor, under: Tensor, planted: Tensor) -> Tensor:
    """Mean squared speed along the floor of planted feet, (m/s)^2: `velocity` `[b, t, 3]` of the pelvis, the feet's
    places under it `[b, t, 4, 3]` and which are planted `[b, t, 4]`. Frame `i + 1` is where frame `i`'s velocity
    leads."""
    both = (planted[:, 1:] & planted[:, :-1])[..., None]
    speed = under.diff(dim=1)[..., [0, 2]] * FRAME_RATE + velocity[:, :-1, None][..., [0, 2]]
    return (both * speed**2).sum() / both.sum().clamp(min=1)


def plan_of(shared: dict[str, Any], own: dict[str, Any], stride: int, seed: int) -> ResidualPlan:
    """A part's own numbers laid over those of all."""
    known = set(ResidualPlan.__dataclass_fields__) - {"stride", "seed"}
    given = {key: value for key, value in (shared | own).items() if key in known}
    return ResidualPlan(**given, stride=stride, seed=seed)
