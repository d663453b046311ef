"""The three stages of the language model (paper 3.4) on one or many devices."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from accelerate import Accelerator, DistributedDataParallelKwargs
from torch import Tensor
from tqdm import tqdm

from umo_train.device import has_bf16
from umo_train.lm import moe
from umo_train.lm.examples import Batch, Examples
from umo_train.lm.model import LanguageModel
from umo_train.lm.places import align
from umo_train.log import Log
from umo_train.state import Saved

Config = dict[str, Any]
Draw = Callable[[np.random.Generator], Batch]


@dataclass(frozen=True)
class StagePlan:
    """`tasks` are names to sample counts n in p(t) = n^tau / sum n^tau; `balance` is the paper's lambda."""

    name: str
    steps: int
    tasks: dict[str, float]
    rate: float
    batch: int = 64
    balance: float = 0.01
    # Weight of the encoder's own prediction of the face, from each keyframe's audio token through the same head: the
    # alignment of audio and keyframes is learned thousands of steps sooner than through the decoder alone.
    heard: float = 0.0
    # Whether the decoder's cross-attention is initialised to attend to its keyframe's audio.
    align: bool = False
    tau: float = 0.5
    # Stage 1: frames of a window. Stage 2: keyframes of a chunk, drawn from these.
    dense_frames: int = 120
    targets: tuple[int, ...] = (5,)
    dense: bool = False
    warmup: int = 200
    final_rate: float = 0.05
    seed: int = 0
    betas: tuple[float, float] = (0.9, 0.99)
    decay: float = 0.05
    save_every: int = 250
    bf16: bool = True
    # Pre-training: the longest audio of an example.
    speech_seconds: float = 3.0
    # Dense windows per batch; 0 for as many as give the labels of a usual batch.
    dense_batch: int = 0
    # Processes that prepare batches ahead of a GPU; 0 draws them synchronously.
    readers: int = 0


class Master(torch.optim.Optimizer):
    """AdamW on f32 copies of a bf16 model's weights: steps too small for bf16 accumulate in the copies."""

    def __init__(self, model: torch.nn.Module, rate: float, betas: tuple[float, float], decay: float) -> None:
        self.model = [p for p in model.parameters() if p.requires_grad]
        self.copies = [p.detach().float().clone().requires_grad_() for p in self.model]
        # Only a language model has fixed position weights; a single layer does not.
        found = model.fixed() if hasattr(model, "fixed") else []
        fixed = {id(weight): mask for weight, mask in found}
        self.moved = [~fixed[id(p)] if id(p) in fixed else None for p in self.model]
        super().__init__(self.copies, {"lr": rate})
        matrices = [p for p in self.copies if p.ndim > 1]
        vectors = [p for p in self.copies if p.ndim <= 1]
        groups = [{"params": matrices, "weight_decay": decay}, {"params": vectors, "weight_decay": 0.0}]
        self.adam = torch.optim.AdamW([g for g in groups if g["params"]], rate, betas, fused=True)
        self.param_groups = self.adam.param_groups

    @torch.no_grad()
    def step(self, closure: None = None) -> None:
        for half, copy, moved in zip(self.model, self.copies, self.moved, strict=True):
            copy.grad = None if half.grad is None else half.grad.float()
            if copy.grad is not None and moved is not None:
                copy.grad *= moved
            half.grad = None
        torch.nn.utils.clip_grad_norm_(self.copies, 1.0)
        kept = [(c, m, c.clone()) for c, m in zip(self.copies, self.moved, strict=True) if m is not None]
        self.adam.step()
        # Weight decay must not change fixed values either.
        for copy, moved, before in kept:
            copy.copy_(torch.where(moved, copy, before))
        torch._foreach_copy_(self.model, self.copies)

    def state_dict(self) -> dict[str, Any]:
        return {"adam": self.adam.state_dict(), "copies": [c.detach() for c in self.copies]}

    @torch.no_grad()
    def load_state_dict(self, state: dict[str, Any]) -> None:
        self.adam.load_state_dict(state["adam"])
        self.param_groups = self.adam.param_groups
        for copy, half, saved in zip(self.copies, self.model, state["copies"], strict=True):
            copy.copy_(saved)
            half.copy_(saved)


def task_chances(tasks: dict[str, float], tau: float) -> dict[str, float]:
    """The temperature mixture of equation (task_mixture)."""
    powers = {name: count**tau for name, count in tasks.items() if count > 0}
    return {name: power / sum(powers.values()) for name, power in powers.items()}


def mixture(tasks: dict[str, float | str], examples: Examples) -> dict[str, float]:
    """Counts as given; `available` stands for the amount of data for a task, in seconds."""
    return {name: examples.seconds(name) if count == "available" else count for name, count in tasks.items()}


def draws(plan: StagePlan, examples: Examples) -> dict[str, Draw]:
    """Batch functions of each task."""
    b = plan.batch

    def target(rng: np.random.Generator) -> int:
        return int(rng.choice(plan.targets))

    dense = plan.dense_frames
    # A dense window has many more labels than a chunk, so a batch has fewer examples.
    few = plan.dense_batch or max(4, b * 20 // max(4 * dense, 20))
    return {
        "motion": lambda rng: examples.motion(b, examples.prefix, rng),
        "a2t": lambda rng: examples.speech(max(4, b // 2), plan.speech_seconds, rng, to="text"),
        "t2a": lambda rng: examples.speech(max(4, b // 4), plan.speech_seconds, rng, to="audio"),
        "a2m_dense": lambda rng: examples.dense(few, dense, rng, source="audio"),
        "t2m_dense": lambda rng: examples.dense(few, dense, rng, source="text"),
        "a2m": lambda rng: examples.chunk(b, target(rng), rng),
        "a2m_prompted": lambda rng: examples.chunk(b, target(rng), rng, text=True),
        "part": lambda rng: examples.part_level(b, target(rng), rng),
    }


class Draws(torch.utils.data.Dataset):  # type: ignore[type-arg]
    """Task and batch of the steps from `start` on. Each step and device has its own random stream, so that a resumed
    run sees the same data, whichever process draws it."""

    def __init__(self, plan: StagePlan, examples: Examples, start: int, process: int) -> None:
        self.plan, self.examples, self.start, self.process = plan, examples, start, process
        self.chances = task_chances(plan.tasks, plan.tau)

    def __len__(self) -> int:
        return self.plan.steps - self.start

    def __getitem__(self, index: int) -> tuple[str, Batch]:
        step = self.start + index
        rng = np.random.default_rng((self.plan.seed, step, self.process))
        names, chances = list(self.chances), list(self.chances.values())
        task = names[int(np.random.default_rng((self.plan.seed, step)).choice(len(names), p=chances))]
        return task, draws(self.plan, self.examples)[task](rng)


def drawn_ahead(steps: torch.utils.data.Dataset, readers: int, device: torch.device) -> torch.utils.data.DataLoader:  # type: ignore[type-arg]
    """Loads the steps of `steps` in order, prepared by `readers` processes ahead of a GPU."""
    readers = readers if device.type == "cuda" else 0
    return torch.utils.data.DataLoader(
        steps, batch_size=None, num_workers=readers, prefetch_factor=4 if readers else None
    )


class Outputs(torch.nn.Module):
    """Logits, the encoder's own loss and the balancing loss in one pass: gradients of several devices are only
    synchronised for a module's outputs."""

    def __init__(self, model: LanguageModel, *, balanced: bool) -> None:
        super().__init__()
        self.model, self.balanced = model, balanced

    def forward(
        self, ids: Tensor, decoder_ids: Tensor, mask: Tensor | None, heard: Tensor | None
    ) -> tuple[Tensor, Tensor | None, Tensor | None]:
        """`heard` are target ids of the encoder, -100 without a target."""
        logits, hidden = self.model(ids, decoder_ids, mask, states=True)
        guess = None
        if heard is not None:
            asked = heard != -100
            guess = torch.nn.functional.cross_entropy(self.model.head(hidden[asked]).float(), heard[asked])
        return logits, guess, moe.balance(self.model) if self.balanced else None


def _inputs(batch: Batch, device: torch.device, vocab: Config) -> tuple[Tensor, Tensor, Tensor | None, Tensor]:
    """Input of the encoder, input of the decoder, mask of the former, and labels."""
    labels = torch.from_numpy(batch.labels).to(device)
    start = torch.full_like(labels[:, :1], vocab["decoder_start"])
    said = torch.cat([start, labels[:, :-1].clamp(min=0)], 1)
    mask = None if batch.mask is None else torch.from_numpy(batch.mask).to(device)
    return torch.from_numpy(batch.ids).to(device), said, mask, labels


def _entropy(logits: Tensor, labels: Tensor) -> Tensor:
    return torch.nn.functional.cross_entropy(logits.float().flatten(0, 1), labels.flatten(), ignore_index=-100)


def loss_of(model: LanguageModel, batch: Batch, device: torch.device) -> tuple[Tensor, Tensor, Tensor]:
    """Cross-entropy of the labels, the logits `[b, m, vocab]` and the labels."""
    ids, said, mask, labels = _inputs(batch, device, model.vocab)
    logits = model(ids, said, mask)
    return _entropy(logits, labels), logits, labels


def rate_at(step: int, plan: StagePlan) -> float:
    """A linear warm-up, then a cosine."""
    share = min(1.0, step / max(plan.steps, 1))
    cosine = plan.final_rate + (1 - plan.final_rate) * 0.5 * (1 + np.cos(np.pi * share))
    return float(min(1.0, (step + 1) / max(plan.warmup, 1)) * cosine)


def train_stage(
    plan: StagePlan, model: LanguageModel, examples: Examples, held_out: Examples, folder: Path
) -> LanguageModel:
    """Trains `model` in place from the stage's checkpoint."""
    # An expert without rows in a batch has no gradient.
    several = DistributedDataParallelKwargs(find_unused_parameters=True)
    accelerator = Accelerator(kwargs_handlers=[several])
    torch.manual_seed(plan.seed)
    if plan.align and not (folder / f"lm_{plan.name}.pt").exists():
        align(model, examples, tuple(sorted(set(plan.targets))), plan.seed)
    if plan.bf16 and has_bf16(accelerator.device):
        model = model.to(torch.bfloat16)
    plain = model
    outputs = accelerator.prepare_model(Outputs(model, balanced=plan.balance > 0))
    optimizer = Master(plain, plan.rate, plan.betas, plan.decay)
    saved = Saved(folder / f"lm_{plan.name}.pt", optimizer=optimizer)
    start = saved.load()
    log = Log(folder / f"lm_{plan.name}.csv", start) if accelerator.is_main_process else None
    drawn = drawn_ahead(Draws(plan, examples, start, accelerator.process_index), plan.readers, accelerator.device)
    bar = tqdm(range(start, plan.steps), f"lm {plan.name}", initial=start, total=plan.steps, disable=log is None)
    for step, (task, batch) in zip(bar, drawn, strict=True):
        for group in optimizer.param_groups:
            group["lr"] = plan.rate * rate_at(step, plan)
        ids, said, mask, labels = _inputs(batch, accelerator.device, plain.vocab)
        wanted = None
        if batch.heard is not None and plan.heard > 0:
            wanted = torch.from_numpy(batch.heard).to(accelerator.device)
        logits, heard, balance = outputs(ids, said, mask, wanted)
        loss = total = _entropy(logits, labels)
        if balance is not None:
            total = total + plan.balance * balance
        if heard is not None:
            total = total + plan.heard * heard
        accelerator.backward(total)
        optimizer.step()
        values = {f"loss_{task}": loss.item()} | _experts(plain)
        if heard is not None:
            values["heard"] = heard.item()
        if task.startswith("a2m"):
            values["accuracy"] = _accuracy(logits, labels)
        bar.set_postfix(task=task, loss=f"{loss.item():.3f}")
        if log is None:
            continue
        log.add(step, values)
        if (step + 1) % plan.save_every == 0 or step + 1 == plan.steps:
            saved.save(step + 1)
            log.add(step, {f"held_out_{k}": v for k, v in evaluate(plain, held_out, plan).items()})
    if log is not None:
        log.write(plan.steps - 1)
    accelerator.wait_for_everyone()
    return plain


def _experts(model: LanguageModel) -> dict[str, float]:
    """Share of rows whose first choice is the most used expert, per layer."""
    out = {}
    for i, layer in enumerate(moe.layers(model)):
        if layer.first_choices is not None:
            counts = layer.first_choices.float()
            out[f"top1_layer{i}"] = float(counts.max() / counts.sum())
            out[f"used_layer{i}"] = float((counts > 0).float().mean())
    return out


def _accuracy(logits: Tensor, labels: Tensor) -> float:
    asked = labels != -100
    return float((logits.argmax(-1)[asked] == labels[asked]).float().mean())


@torch.no_grad()
def evaluate(model: LanguageModel, examples: Examples, plan: StagePlan, batches: int = 4) -> dict[str, float]:
    """Accuracy of each part's codes with teacher forcing, on held-out items."""
    device = next(model.parameters()).device
    sums: dict[str, list[float]] = {}
    for i in range(batches):
        rng = np.random.default_rng((plan.seed, 1_000_000 + i))
        loss, logits, labels = loss_of(model, examples.chunk(plan.batch, 5, rng), device)
        sums.setdefault("loss", []).append(loss.item())
        for part in ("face", "hands", "upper", "lower"):
            name = model.vocab[part]
            codes = (labels >= name["first"]) & (labels < name["first"] + name["codes"])
            right = logits[..., name["first"] : name["first"] + name["codes"]].argmax(-1) + name["first"] == labels
            sums.setdefault(part, []).append(float(right[codes].float().mean()))
    return {name: float(np.mean(values)) for name, values in sums.items()}
