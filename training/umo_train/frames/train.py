"""Trains the language model and the depth network of layout `frames`."""

import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from accelerate import Accelerator, DistributedDataParallelKwargs
from torch import Tensor, nn
from torch.nn import functional
from tqdm import tqdm

from umo_train.device import has_bf16
from umo_train.frames.examples import FrameBatch, FrameExamples
from umo_train.frames.model import FrameModel
from umo_train.frames.parts import Part
from umo_train.lm import moe
from umo_train.lm.rounded import crest_of_gates, round_products
from umo_train.lm.train import Master, _experts, drawn_ahead, rate_at, task_chances
from umo_train.log import EVERY, Log
from umo_train.state import Saved


class Interrupted(Exception):
    """A stage's time is up before its end; its checkpoint is written."""


@dataclass(frozen=True)
class FrameStagePlan:
    """`tasks` are names to counts as in `StagePlan`, and `balance` is the paper's lambda."""

    name: str
    steps: int
    rate: float
    tasks: dict[str, float] = field(default_factory=lambda: {"a2m": 12.0, "t2m": 0.5})
    batch: int = 48
    balance: float = 0.01
    tau: float = 1.0
    targets: tuple[int, ...] = (5, 5, 5, 2, 10)
    # Weight of a level's codes relative to the previous level, and of a part's codes at a keyframe whose first code
    # differs from the previous keyframe: without it, repeating the last keyframe is a strong local optimum.
    level_weight: float = 0.7
    change_weight: float = 2.0
    # Weight of a part's codes relative to others (1).
    part_weights: dict[str, float] = field(default_factory=dict)
    # Weight of the encoder's own predictions of keyframes, each from its audio token, and number of them per chunk.
    heard: float = 0.0
    heard_keyframes: int = 2
    # Share of keyframes predicted without the previous one (`depth.before`): audio and older history must suffice, or a
    # stream can repeat one keyframe for ever.
    unknown: float = 0.1
    dense: bool = False
    warmup: int = 200
    final_rate: float = 0.05
    seed: int = 0
    betas: tuple[float, float] = (0.9, 0.99)
    decay: float = 0.05
    save_every: int = 250
    bf16: bool = True
    # Whether products are rounded as in int8, so that the weights adapt to it.
    rounded: bool = False
    # Weight of the crest factor of the inputs of a rounded depth network's gated products: `crest_of_gates`.
    crest: float = 0.0
    # Processes that prepare batches ahead of a GPU; 0 draws them synchronously.
    readers: int = 0


def code_weights(parts: list[Part], plan: FrameStagePlan, codes: Tensor, before: Tensor) -> Tensor:
    """Weight of every code of a chunk, `[b, N, J]`: `codes` `[b, N, J]`, -1 without a target, `before` `[b, J]` the
    keyframe before the chunk."""
    last = torch.cat([before[:, None], codes[:, :-1]], 1)
    out, at = [], 0
    for part in parts:
        changed = (codes[..., at] != last[..., at]) & (last[..., at] >= 0)
        levels = plan.level_weight ** torch.arange(part.levels, device=codes.device)
        weight = plan.part_weights.get(part.name, 1.0)
        out.append(weight * levels * torch.where(changed, plan.change_weight, 1.0)[..., None])
        at += part.levels
    return torch.cat(out, -1) * (codes >= 0)


def entropy(parts: list[Part], logits: dict[str, Tensor], codes: Tensor, weight: Tensor) -> Tensor:
    """The weighted mean cross-entropy of codes `[b, N, J]`; `logits` are `[b * N, levels, codes]` of each part."""
    flat, weights, at = codes.flatten(0, 1), weight.flatten(0, 1), 0
    total = torch.zeros((), device=codes.device)
    for part in parts:
        mine = slice(at, at + part.levels)
        each = functional.cross_entropy(
            logits[part.name].float().flatten(0, 1), flat[:, mine].flatten().clamp(min=0), reduction="none"
        )
        total = total + (each * weights[:, mine].flatten()).sum()
        at += part.levels
    return total / weights.sum().clamp(min=1e-6)


class Outputs(nn.Module):
    """Logits, the encoder's own, the balancing loss and the crest factor in one pass: gradients of several devices are
    only synchronised for a module's outputs."""

    def __init__(self, model: FrameModel, *, balanced: bool, crested: bool = False) -> None:
        super().__init__()
        self.model, self.balanced, self.crested = model, balanced, crested

    def forward(
        self,
        ids: Tensor,
        history: Tensor,
        codes: Tensor,
        mask: Tensor | None,
        places: Tensor | None,
        guessed: Tensor | None,
        unknown: Tensor | None,
    ) -> tuple[dict[str, Tensor], dict[str, Tensor] | None, Tensor | None, Tensor | None]:
        logits, guess = self.model(ids, history, codes, mask, places, guessed, unknown)
        balance = moe.balance(self.model) if self.balanced else None
        return logits, guess, balance, crest_of_gates(self.model) if self.crested else None


def inputs(batch: FrameBatch, device: torch.device) -> tuple[Tensor, Tensor, Tensor, Tensor | None]:
    """Ids, history, codes and mask of a batch."""
    ids, history, codes = (torch.from_numpy(x).to(device) for x in (batch.ids, batch.history, batch.codes))
    return ids, history, codes, None if batch.mask is None else torch.from_numpy(batch.mask).to(device)


def places_of(batch: FrameBatch, device: torch.device) -> Tensor | None:
    """Positions in a batch's ids where its keyframes are heard, if there are any."""
    return None if batch.heard is None else torch.from_numpy(batch.heard).to(device)


@dataclass(frozen=True)
class Drawn:
    """A step's task, its batch, the keyframes that the encoder itself has to predict, and those predicted without the
    previous one."""

    task: str
    batch: FrameBatch
    guessed: np.ndarray | None
    unknown: np.ndarray


class Draws(torch.utils.data.Dataset):  # type: ignore[type-arg]
    """Data of the steps from `start` on. Each step and device has its own random stream, so that a resumed run sees the
    same data, whichever process draws it."""

    def __init__(self, plan: FrameStagePlan, examples: FrameExamples, start: int, process: int) -> None:
        self.plan, self.examples, self.start, self.process = plan, examples, start, process
        self.chances = task_chances(plan.tasks, plan.tau)

    def __len__(self) -> int:
        return self.plan.steps - self.start

    def __getitem__(self, index: int) -> Drawn:
        plan, step = self.plan, self.start + index
        rng = np.random.default_rng((plan.seed, step, self.process))
        tasks, chances = list(self.chances), list(self.chances.values())
        task = tasks[int(np.random.default_rng((plan.seed, step)).choice(len(tasks), p=chances))]
        batch = self.examples.chunk(plan.batch, int(rng.choice(plan.targets)), rng, task=task)
        guessed = None
        if plan.heard > 0 and batch.heard is not None:
            guessed = np.sort(rng.permutation(len(batch.heard))[: plan.heard_keyframes])
        return Drawn(task, batch, guessed, rng.random(batch.codes.shape[:2]) < plan.unknown)


def train_stage(
    plan: FrameStagePlan,
    model: FrameModel,
    examples: FrameExamples,
    held_out: FrameExamples,
    folder: Path,
    until: float | None = None,
) -> FrameModel:
    """Trains `model` in place from the stage's checkpoint to its end or, with a checkpoint, until the time `until` of
    `time.monotonic`."""
    several = DistributedDataParallelKwargs(find_unused_parameters=True)
    accelerator = Accelerator(kwargs_handlers=[several])
    device = accelerator.device
    torch.manual_seed(plan.seed)
    if plan.bf16 and has_bf16(device):
        model = model.to(torch.bfloat16)
    if plan.rounded:
        round_products(model)
    plain = model
    outputs = accelerator.prepare_model(Outputs(model, balanced=plan.balance > 0, crested=plan.crest > 0))
    optimizer = Master(plain, plan.rate, plan.betas, plan.decay)
    saved = Saved(folder / f"lm_{plan.name}.pt", optimizer=optimizer)
    start = saved.load()
    log = Log(folder / f"lm_{plan.name}.csv", start) if accelerator.is_main_process else None
    draws = drawn_ahead(Draws(plan, examples, start, accelerator.process_index), plan.readers, device)
    bar = tqdm(range(start, plan.steps), f"lm {plan.name}", initial=start, total=plan.steps, disable=log is None)
    for step, drawn in zip(bar, draws, strict=True):
        task, batch = drawn.task, drawn.batch
        for group in optimizer.param_groups:
            group["lr"] = plan.rate * rate_at(step, plan)
        ids, history, codes, mask = inputs(batch, device)
        guessed = None if drawn.guessed is None else torch.from_numpy(drawn.guessed).to(device)
        unknown = torch.from_numpy(drawn.unknown).to(device)
        logits, guess, balance, crest = outputs(ids, history, codes, mask, places_of(batch, device), guessed, unknown)
        weight = code_weights(plain.parts, plan, codes, torch.from_numpy(batch.before).to(device))
        loss = total = entropy(plain.parts, logits, codes, weight)
        if balance is not None:
            total = total + plan.balance * balance
        if crest is not None:
            total = total + plan.crest * crest
        if guess is not None:
            total = total + plan.heard * entropy(plain.parts, guess, codes[:, guessed], weight[:, guessed])
        accelerator.backward(total)
        optimizer.step()
        if log is None:
            continue
        # Numbers are only fetched when they are written, so that not every step waits for the GPU.
        written = (step + 1) % EVERY == 0 or step + 1 == plan.steps
        log.add(step, {f"loss_{task}": loss.detach()} | (_experts(plain) if written else {}))
        if written:
            bar.set_postfix(task=task, loss=f"{loss.item():.3f}")
        over = until is not None and time.monotonic() > until
        if (step + 1) % plan.save_every == 0 or step + 1 == plan.steps or over:
            saved.save(step + 1)
            log.add(step, {f"held_out_{k}": v for k, v in evaluate(plain, held_out, plan).items()})
        if over:
            log.write(step)
            raise Interrupted(f"stage {plan.name}: its time is up after {step + 1} of {plan.steps} steps")
    if log is not None:
        log.write(plan.steps - 1)
    accelerator.wait_for_everyone()
    return plain


@torch.no_grad()
def evaluate(model: FrameModel, examples: FrameExamples, plan: FrameStagePlan, batches: int = 4) -> dict[str, float]:
    """On held-out items with teacher forcing: the loss, the accuracy of each part's first codes, and that of repeating
    the last keyframe (`copied_`)."""
    device = next(model.parameters()).device
    sums: dict[str, list[float]] = {}
    for i in range(batches):
        batch = examples.chunk(plan.batch, 5, np.random.default_rng((plan.seed, 1_000_000 + i)))
        ids, history, codes, mask = inputs(batch, device)
        logits, _ = model(ids, history, codes, mask, places_of(batch, device))
        before = torch.from_numpy(batch.before).to(device)
        weight = code_weights(model.parts, plan, codes, before)
        sums.setdefault("loss", []).append(entropy(model.parts, logits, codes, weight).item())
        last, at = torch.cat([before[:, None], codes[:, :-1]], 1), 0
        for part in model.parts:
            wanted = codes[..., at].flatten()
            asked = wanted >= 0
            right = (logits[part.name][:, 0].argmax(-1) == wanted)[asked].float().mean()
            copied = (last[..., at].flatten() == wanted)[asked].float().mean()
            sums.setdefault(part.name, []).append(right.item())
            sums.setdefault(f"copied_{part.name}", []).append(copied.item())
            at += part.levels
    return {name: float(np.mean(values)) for name, values in sums.items()}
