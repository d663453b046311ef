"""Trains the tokenizers of layout `frames`: residual codebooks of every part."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from umo_train.device import best
from umo_train.frames import chain, feet, parts
from umo_train.frames.networks import ResidualVqVae
from umo_train.frames.parts import Part
from umo_train.log import Log
from umo_train.metrics.item import Motion
from umo_train.motion.train import _between, _crops, _rate
from umo_train.skeleton import CHANNELS, CONTACT
from umo_train.speech.utterance import FRAME_RATE
from umo_train.state import Chance, Saved

SAVE_EVERY = 250
# Minimum standard deviation for normalising a channel: smaller differences are not visible.
LEAST_SCALE = 0.01
# Number of batches whose latents initialise the codebooks, and rounds of k-means over them.
_START_BATCHES, _START_ROUNDS = 6, 8
# Weight of a joint's own rotation relative to that in its chain, and of feet sliding together relative to feet sliding
# against each other: the root network follows the former.
LOCAL, TOGETHER = 0.1, 0.1


@dataclass(frozen=True)
class ResidualPlan:
    """Settings of one part's tokenizer. `stride` is the keyframes'; errors of speed and acceleration are per frame."""

    steps: int
    stride: int
    batch: int = 24
    frames: int = 96
    rate: float = 1.5e-3
    commitment: float = 0.25
    velocity: float = 2.0
    acceleration: float = 2.0
    # For the lower body: weight of sliding planted feet, metres per second squared.
    slide: float = 20.0
    # Share of examples that use only the first levels, so that each level encodes as much as it can.
    dropout: float = 0.25
    # Share of examples with codes between keyframes interpolated from their neighbours: the language model only
    # produces keyframes.
    sparse: float = 0.35
    seed: int = 0


class PartLoss:
    """Error of a part's channels relative to that of outputting the mean. Rotations count accumulated along the part
    (`chain.Chained`), and slightly by themselves, so that decoded values stay near rotations.

    A part with feet also gets the lower body decoded from earlier parts, and the positions of the feet (`with_feet`).
    """

    def __init__(self, part: Part, plan: ResidualPlan, motions: Tensor) -> None:
        device = motions.device
        self.plan, self.part = plan, part
        self.chained = chain.Chained(part)
        self.chain_weight = self._shares(parts.chained_weights(part), self.chained(motions))
        self.weight = self._shares(parts.weights(part), motions)
        self.feet = feet_of(part)
        if self.feet:
            self.at = torch.from_numpy(parts.columns(part, [])[1]).to(device)

    @staticmethod
    def _shares(weights: np.ndarray, motions: Tensor) -> Tensor:
        weight = torch.from_numpy(weights).to(motions.device)
        return weight / (weight * motions.std(0) ** 2).sum()

    def __call__(self, y: Tensor, x: Tensor, beside: Tensor | None = None) -> tuple[Tensor, dict[str, float]]:
        """`[b, t, channels]`: the decoded motion and the true one."""
        difference = self.chained(y) - self.chained(x)
        terms = [
            (self.chain_weight * d**2).sum(-1).mean()
            for d in (difference, *(difference.diff(n=n, dim=1) for n in (1, 2)))
        ]
        loss = terms[0] + self.plan.velocity * terms[1] + self.plan.acceleration * terms[2]
        if self.chained.joints:
            loss = loss + LOCAL * (self.weight * (y - x) ** 2).sum(-1).mean()
        values = dict(zip(("error", "velocity", "acceleration"), (term.item() for term in terms), strict=True))
        if self.feet and beside is not None and self.plan.slide > 0:
            width = CHANNELS["lower"]
            lower = beside[..., :width].index_copy(-1, self.at, y)
            places, planted = beside[..., width:-4].unflatten(-1, (4, 3)), beside[..., -4:] > 0.5
            apart, together = slides(feet.places(lower) - places, planted)
            loss = loss + self.plan.slide * (apart + TOGETHER * together)
            values |= {"slide": apart.item(), "together": together.item()}
        return loss, values


def feet_of(part: Part) -> bool:
    """Whether a part moves feet."""
    return bool(set(part.channels) & {"left_ankle", "right_ankle", "left_foot", "right_foot"})


def with_feet(lower: np.ndarray, said: np.ndarray) -> np.ndarray:
    """`[T, 61 + 12 + 4]`: the lower body decoded from earlier parts, positions of the performer's feet relative to the
    pelvis, and whether they are planted."""
    places = feet.places(torch.from_numpy(lower)).flatten(1).numpy()
    return np.concatenate([said, places, lower[:, CONTACT]], 1)


def slides(error: Tensor, planted: Tensor) -> tuple[Tensor, Tensor]:
    """Sliding of planted feet `[b, t, 4]` with position errors `error` `[b, t, 4, 3]`, along the floor, mean squares in
    (m/s)^2: against each other, which no motion of the pelvis can compensate, and together."""
    both = (planted[:, 1:] & planted[:, :-1])[..., None]
    moved = (error.diff(dim=1) * FRAME_RATE)[..., [0, 2]] * both
    together = moved.sum(-2, keepdim=True) / both.sum(-2, keepdim=True).clamp(min=1) * both
    count = both.sum().clamp(min=1)
    return (moved - together).pow(2).sum() / count, together.pow(2).sum() / count


def train_part(
    plan: ResidualPlan,
    part: Part,
    motions: list[np.ndarray],
    folder: Path,
    beside: list[np.ndarray] | None = None,
    before: dict[str, Tensor] | None = None,
) -> ResidualVqVae:
    """`motions` are `[T, channels]`, `beside` the outputs of `with_feet`; with `before` it continues from a published
    model's weights, whose codes keep their meaning. Resumes from a checkpoint in the folder."""
    torch.manual_seed(plan.seed)
    device = best()
    channels = motions[0].shape[1]
    joined = motions if beside is None else [np.concatenate(pair, 1) for pair in zip(motions, beside, strict=True)]
    model = ResidualVqVae(part, channels)
    everything = torch.from_numpy(np.concatenate(motions[:: max(1, len(motions) // 400)]))
    mean, scale = everything.mean(0), everything.std(0).clamp(min=LEAST_SCALE)
    if before is None:
        model.mean.copy_(mean)
        model.scale.copy_(scale)
    else:
        model.load_state_dict(before)
        model.unfold(mean, scale)
    model.to(device)
    loss_of_part = PartLoss(part, plan, everything.to(device))
    optimizer = torch.optim.AdamW(model.parameters(), plan.rate, betas=(0.9, 0.99), weight_decay=1e-4)
    schedule = torch.optim.lr_scheduler.LambdaLR(optimizer, lambda step: _rate(step, plan.steps))
    chance = np.random.default_rng((plan.seed, 0))
    path = folder / f"tokenizer_{part.name}.pt"
    saved = Saved(path, model=model, optimizer=optimizer, schedule=schedule, chance=Chance(chance))
    start = saved.load()
    log = Log(folder / f"tokenizer_{part.name}.csv", start)
    warm = warm_steps(plan) if before is None else 0
    for step in tqdm(range(start, plan.steps), f"tokenizer {part.name}", initial=start, total=plan.steps):
        if step == warm:
            start_codebooks(model, plan, motions, chance, again=before is not None)
        crop = torch.from_numpy(_crops(joined, plan.batch, plan.frames, chance)).to(device)
        x, more = crop[..., :channels], crop[..., channels:] if beside is not None else None
        loss, values = loss_of(
            model, plan, x, loss_of_part, chance, coded=step >= warm, phase=step % plan.stride, beside=more
        )
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
    """The first steps train without codes, so that codebooks are initialised from meaningful latents."""
    return plan.steps // 20


@torch.no_grad()
def start_codebooks(
    model: ResidualVqVae,
    plan: ResidualPlan,
    motions: list[np.ndarray],
    chance: np.random.Generator,
    *,
    again: bool = False,
) -> None:
    """Initialises every level by k-means of the residuals of the levels before it; `again` from its own table."""
    device = model.mean.device
    crops = np.concatenate([_crops(motions, plan.batch, plan.frames, chance) for _ in range(_START_BATCHES)])
    left = model.latents(torch.from_numpy(crops).to(device)).flatten(0, 1)
    for level in model.levels:
        table, count = level.embedding.weight, len(level.count)
        if not again:
            table.copy_(left[torch.randint(len(left), (count,), device=device)])
        for _ in range(0 if again else _START_ROUNDS):
            chosen = level.nearest(left)
            hits = torch.bincount(chosen, minlength=count)
            sums = torch.zeros_like(table).index_add_(0, chosen, left)
            table[hits > 0] = sums[hits > 0] / hits[hits > 0, None]
        # As if the running means had seen only these. Entries of a published table that are absent in these rows are
        # kept.
        hits = torch.bincount(level.nearest(left), minlength=count).clamp(min=_START_BATCHES if again else 0)
        level.count.copy_(hits.float() / _START_BATCHES)
        level.total.copy_(table * level.count[:, None])
        left = left - level.embedding(level.nearest(left))


def used_levels(plan: ResidualPlan, levels: int, chance: np.random.Generator) -> np.ndarray:
    """Number of levels used by each example of a batch `[batch]`: all, or for a share of them the first few."""
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
    beside: Tensor | None = None,
) -> tuple[Tensor, dict[str, float]]:
    """The objective of one batch `[b, t, channels]`; with `coded` the codebooks follow their targets."""
    z = model.latents(x)
    used = torch.from_numpy(used_levels(plan, len(model.levels), chance)).to(x.device)
    sparse = torch.from_numpy(chance.random(len(x)) < plan.sparse).to(x.device)
    if not coded:
        return loss_of_part(model.decode(z), x, beside)
    rows = z.flatten(0, 1)
    codes, vectors, asked = model.quantized(rows.detach(), used.repeat_interleave(x.shape[1]))
    spoken = vectors.sum(1).view_as(z)
    for i, level in enumerate(model.levels):
        level.follow(asked[:, i], codes[:, i])
    through = z + (spoken - z).detach()
    mixed = _between(through, plan.stride, phase)
    loss, values = loss_of_part(model.decode(torch.where(sparse[:, None, None], mixed, through)), x, beside)
    # For each used level: the residual of the levels up to it.
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
    """Codes `[T, levels]` to motion `[T, channels]`: from the first levels only, or from every `stride`-th frame's
    vectors with linear interpolation."""
    some = torch.from_numpy(codes.astype(np.int64))[None, :, :levels].to(model.mean.device)
    return model.decode(_between(model.vectors(some), stride, 0))[0].cpu().numpy()


@torch.no_grad()
def encode(
    order: Sequence[Part], models: dict[str, ResidualVqVae], motion: Motion, face: list[str]
) -> tuple[dict[str, np.ndarray], chain.Said]:
    """Codes `[T, levels]` of each part with channels in `models`, in order, and their decoded motion."""
    said, codes = chain.Said(motion, face), {}
    for part in order:
        if part.name in models:
            codes[part.name] = tokenize(models[part.name], said.aims(part))
            said.say(part, decoded(models[part.name], codes[part.name]))
    return codes, said


def plan_of(shared: dict[str, Any], own: dict[str, Any], stride: int, seed: int) -> ResidualPlan:
    """A part's own settings merged over the shared ones."""
    known = set(ResidualPlan.__dataclass_fields__) - {"stride", "seed"}
    given = {key: value for key, value in (shared | own).items() if key in known}
    return ResidualPlan(**given, stride=stride, seed=seed)
