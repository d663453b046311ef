"""The interpolation network of layout `frames` (SPEC 2.14): vectors between keyframes, and its training."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from tqdm import tqdm

from umo_train.device import best
from umo_train.frames.networks import ResidualVqVae
from umo_train.frames.parts import Part, weights
from umo_train.interp.model import KEYFRAME, LAST_VALID, MASKED, _layers
from umo_train.log import Log
from umo_train.motion.train import _rate
from umo_train.state import Saved

SAVE_EVERY = 250


class VectorInterpolation(nn.Module):
    """Interpolates vectors of the known frames to all frames; linearly until it is trained."""

    def __init__(self, config: dict[str, Any], parts: list[Part]) -> None:
        super().__init__()
        sizes = config["interp"]
        self.parts = [part for part in parts if part.moves]
        self.stride: int = config["keyframe_stride"]
        d = sizes["d_model"]
        self.input = nn.ModuleDict({part.name: nn.Linear(part.width, d) for part in self.parts})
        self.mask = nn.Embedding(len(self.parts), d)
        self.frame_type = nn.Embedding(3, d)
        self.position = nn.Embedding(sizes["max_frames"], d)
        self.temporal = _layers(sizes["temporal_layers"], sizes)
        self.part = _layers(sizes["part_layers"], sizes)
        self.norm = nn.LayerNorm(d)
        self.head = nn.ModuleDict({part.name: nn.Linear(d, part.width) for part in self.parts})
        for table in (self.mask, self.frame_type, self.position):
            nn.init.normal_(table.weight, std=d**-0.5)
        for head in self.head.values():
            nn.init.zeros_(head.weight)
            nn.init.zeros_(head.bias)

    def forward(self, vectors: dict[str, Tensor], known: Tensor) -> dict[str, Tensor]:
        """Vectors `[b, t, width]` of each part and the known frames `[t]`, to `[b, t, width]`: known frames are
        unchanged."""
        frame = torch.arange(len(known), device=known.device)
        kind = torch.where(frame % self.stride == 0, KEYFRAME, LAST_VALID)
        kind = torch.where(known, kind, MASKED)
        tokens = torch.stack([self.input[part.name](vectors[part.name]) for part in self.parts], 2)
        tokens = torch.where(known[:, None, None], tokens, self.mask.weight)
        hidden = tokens.sum(2) + self.frame_type(kind) + self.position(frame)
        for layer in self.temporal:
            hidden = layer(hidden)
        b, t, d = hidden.shape
        each = (hidden[:, :, None] + tokens).view(b * t, len(self.parts), d)
        for layer in self.part:
            each = layer(each)
        each = self.norm(each).view(b, t, len(self.parts), d)
        out = {}
        for i, part in enumerate(self.parts):
            line = straight(vectors[part.name], known) + self.head[part.name](each[:, :, i])
            out[part.name] = torch.where(known[:, None], vectors[part.name], line)
        return out


def straight(vectors: Tensor, known: Tensor) -> Tensor:
    """Linear interpolation between the known rows of `[b, t, width]`, and constant extrapolation."""
    at = known.nonzero()[:, 0]
    frame = torch.arange(len(known), device=known.device)
    after = torch.searchsorted(at, frame).clamp(max=len(at) - 1)
    before = (torch.searchsorted(at, frame, right=True) - 1).clamp(min=0)
    left, right = at[before], at[after]
    share = ((frame - left) / (right - left).clamp(min=1)).to(vectors.dtype)[:, None]
    return vectors[:, left] * (1 - share) + vectors[:, right] * share


@dataclass(frozen=True)
class VectorPlan:
    """`velocity` and `acceleration` weight errors of first and second differences relative to errors of values;
    `decoded` weights the same errors of decoded motion relative to errors of vectors."""

    steps: int
    frames: int
    batch: int = 16
    rate: float = 1e-3
    velocity: float = 2.0
    acceleration: float = 2.0
    decoded: float = 1.0
    shortest: int = 2
    seed: int = 0


def train(
    plan: VectorPlan,
    config: dict[str, Any],
    parts: list[Part],
    codes: list[np.ndarray],
    tokenizers: dict[str, ResidualVqVae],
    folder: Path,
) -> VectorInterpolation:
    """`codes` are `[T, J]` of every frame; `tokenizers` belong to the parts with channels. Resumes from a checkpoint in
    the folder."""
    torch.manual_seed(plan.seed)
    device = best()
    model = VectorInterpolation(config, parts).to(device)
    books = {name: tokenizer.to(device).eval().requires_grad_(False) for name, tokenizer in tokenizers.items()}
    optimizer = torch.optim.AdamW(model.parameters(), plan.rate, betas=(0.9, 0.99), weight_decay=0.05)
    schedule = torch.optim.lr_scheduler.LambdaLR(optimizer, lambda step: _rate(step, plan.steps))
    saved = Saved(folder / "interp.pt", model=model, optimizer=optimizer, schedule=schedule)
    start = saved.load()
    log = Log(folder / "interp.csv", start)
    for step in tqdm(range(start, plan.steps), "interpolation", initial=start, total=plan.steps):
        rng = np.random.default_rng((plan.seed, step))
        truth = vectors_of(parts, books, torch.from_numpy(windows(plan, codes, model.stride, rng)).to(device))
        loss, values = loss_of(model, plan, truth, books)
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


def windows(plan: VectorPlan, codes: list[np.ndarray], stride: int, rng: np.random.Generator) -> np.ndarray:
    """`[b, t, J]`: windows whose length varies from batch to batch, each starting at a keyframe."""
    longest = min(plan.frames, max(map(len, codes)))
    length = int(rng.integers(min(plan.shortest * stride, longest), longest + 1))
    fit = [item for item in codes if len(item) >= length]
    out = []
    for _ in range(plan.batch):
        item = fit[rng.integers(len(fit))]
        at = int(rng.integers((len(item) - length) // stride + 1)) * stride
        out.append(item[at : at + length])
    return np.stack(out).astype(np.int64)


def vectors_of(parts: list[Part], books: dict[str, ResidualVqVae], codes: Tensor) -> dict[str, Tensor]:
    """Codes `[..., J]` to the vectors of the parts with channels."""
    out, at = {}, 0
    for part in parts:
        if part.moves:
            out[part.name] = books[part.name].vectors(codes[..., at : at + part.levels])
        at += part.levels
    return out


def anchors(frames: int, stride: int) -> Tensor:
    """Known frames of a window: keyframes and the last one."""
    at = torch.arange(frames)
    return (at % stride == 0) | (at == frames - 1)


def errors(y: Tensor, x: Tensor, weight: Tensor, plan: VectorPlan) -> tuple[Tensor, list[float]]:
    """Weighted squared errors of values, first and second differences of `[b, t, n]`."""
    difference, total, terms = y - x, torch.zeros((), device=x.device), []
    for share in (1.0, plan.velocity, plan.acceleration):
        if difference.shape[1] == 0:
            break
        term = (weight * difference**2).sum(-1).mean()
        total = total + share * term
        terms.append(term.item())
        difference = difference.diff(dim=1)
    return total, terms


def loss_of(
    model: VectorInterpolation, plan: VectorPlan, truth: dict[str, Tensor], books: dict[str, ResidualVqVae]
) -> tuple[Tensor, dict[str, float]]:
    """The objective of one batch: `truth` `[b, t, width]` of each part, of which the anchors are inputs."""
    frames = next(iter(truth.values())).shape[1]
    known = anchors(frames, model.stride).to(next(iter(truth.values())).device)
    filled = model({name: vectors * known[:, None] for name, vectors in truth.items()}, known)
    total, values = torch.zeros((), device=known.device), {}
    for part in model.parts:
        book, y, x = books[part.name], filled[part.name], truth[part.name]
        spread = book.table().var(0).sum().clamp(min=1e-6)
        on_vectors, terms = errors(y, x, torch.ones(part.width, device=x.device) / spread, plan)
        channel = torch.from_numpy(weights(part)).to(x.device)
        channel = channel / (channel * book.scale**2).sum()
        on_motion, moved = errors(book.decode(y), book.decode(x), channel, plan)
        total = total + on_vectors + plan.decoded * on_motion
        values |= {f"vectors_{part.name}": terms[0], f"motion_{part.name}": moved[0]}
    return total / len(model.parts), values


@torch.no_grad()
def fill(model: VectorInterpolation, vectors: dict[str, np.ndarray], known: np.ndarray) -> dict[str, np.ndarray]:
    """Vectors `[T, width]` with every frame filled."""
    given = {name: torch.from_numpy(rows)[None] for name, rows in vectors.items()}
    return {name: rows[0].numpy() for name, rows in model(given, torch.from_numpy(known)).items()}
