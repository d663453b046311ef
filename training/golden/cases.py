"""Inputs and expected outputs of every stage of one model."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import torch
from torch import Tensor

import weights
from audio import nearest
from layout import MASK, PARTS, Config
from margin import LEAST, Margin
from reference import Reference

Tensors = dict[str, Tensor]
Propose = Callable[[torch.Generator], Tensors]
Run = Callable[[Reference, Tensors, Margin], Tensors]

ATTEMPTS = 400
# A case is kept only if f32 and f64 runs of the reference agree to this precision, a tenth of the tests' tolerance.
CONDITION = 2e-5


@dataclass
class Cases:
    """Contents of `cases.safetensors`."""

    seed: int
    single: Reference
    double: Reference
    tensors: Tensors = field(default_factory=dict)
    notes: dict[str, dict[str, object]] = field(default_factory=dict)

    def add(self, name: str, stage: str, propose: Propose, run: Run, **note: object) -> None:
        """Draws inputs until every discrete choice has a clear margin, then stores them with the f32 outputs."""
        for attempt in range(ATTEMPTS):
            inputs = propose(weights.seeded(self.seed, name, attempt))
            margin = Margin()
            outputs = run(self.single, inputs, margin)
            if margin.smallest < LEAST:
                continue
            condition = agreement(outputs, run(self.double, inputs, Margin()))
            if condition > CONDITION:
                continue
            self.tensors |= {f"{name}.in.{key}": value for key, value in inputs.items()}
            self.tensors |= {f"{name}.out.{key}": value for key, value in outputs.items()}
            clear = margin.smallest if margin.smallest < float("inf") else None
            self.notes[name] = {"stage": stage, **note, "margin": clear, "condition": condition, "attempt": attempt}
            return
        raise RuntimeError(f"{name}: no clear inputs in {ATTEMPTS} attempts")


def agreement(single: Tensors, double: Tensors) -> float:
    """The largest difference of two runs, relative to each output's largest value; integers must be equal."""
    worst = 0.0
    for name, value in single.items():
        assert value.isfinite().all(), f"{name} is not finite"
        if not value.is_floating_point():
            if not torch.equal(value, double[name]):
                return float("inf")
            continue
        largest = double[name].abs().max()
        assert largest > 0.05 or len(value) == 1, f"{name} is trivially small"
        worst = max(worst, ((value - double[name]).abs().max() / largest.clamp(min=1e-30)).item())
    return worst


def _split(group: str, values: Tensors) -> Tensors:
    return {f"{group}.{part}": values[part] for part in PARTS}


def _joined(group: str, tensors: Tensors) -> Tensors:
    return {part: tensors[f"{group}.{part}"] for part in PARTS}


def add_audio(cases: Cases, kind: str, lengths: tuple[int, ...]) -> None:
    def run(reference: Reference, inputs: Tensors, margin: Margin) -> Tensors:
        features = reference.audio(inputs["audio"])
        return {"features": features, "units": nearest(features, reference.centroids, margin)}

    def propose(samples: int, generator: torch.Generator) -> Tensors:
        return {"audio": weights.audio(samples, generator)}

    for i, samples in enumerate(lengths):
        cases.add(f"{kind}{i}", kind, partial(propose, samples), run)


def prompt(config: Config, length: int | None, generator: torch.Generator) -> Tensor:
    """Random ids from the whole vocabulary, or (without a length) a whole audio-to-motion prompt."""
    vocab = config["vocab"]
    if length is not None:
        return torch.randint(0, vocab["size"], (length,), generator=generator)
    ids: list[int] = []
    keyframes = config["prefix"] + config["target"]
    for item in config["templates"]["audio_to_motion"]:
        if isinstance(item, int):
            ids.append(item)
        elif item == "text":
            ids += torch.randint(3, vocab["face"]["first"] - 3, (5,), generator=generator).tolist()
        else:
            count = 10 * keyframes if item == "audio" else config["prefix"]
            codes = torch.randint(0, vocab[item]["codes"], (count,), generator=generator) + vocab[item]["first"]
            ids += [vocab[item]["start"], *codes.tolist(), vocab[item]["end"]]
    return torch.tensor(ids)


def add_language_model(cases: Cases, config: Config, targets: tuple[int, ...]) -> None:
    def encode(reference: Reference, inputs: Tensors, margin: Margin) -> Tensors:
        routers = reference.lm.begin()
        hidden = reference.lm.encode(inputs["input_ids"])
        margin.smallest = routers.smallest
        return {"hidden": hidden}

    def decode(reference: Reference, inputs: Tensors, margin: Margin) -> Tensors:
        routers = reference.lm.begin()
        logits = reference.lm.decode(inputs["input_ids"], inputs["decoder_input_ids"])
        margin.smallest = routers.smallest
        return {"logits": logits}

    def generate(reference: Reference, inputs: Tensors, margin: Margin) -> Tensors:
        routers = reference.lm.begin()
        codes = reference.lm.generate(inputs["input_ids"], int(inputs["target"]), margin)
        margin.smallest = min(margin.smallest, routers.smallest)
        return _split("codes", codes)

    def propose(length: int | None, more: Callable[[torch.Generator], Tensors], generator: torch.Generator) -> Tensors:
        return {"input_ids": prompt(config, length, generator)} | more(generator)

    def decoder_ids(rows: int, generator: torch.Generator) -> Tensors:
        start = torch.tensor([config["vocab"]["decoder_start"]])
        return {"decoder_input_ids": torch.cat([start, prompt(config, rows - 1, generator)])}

    def wanted(target: int, _: torch.Generator) -> Tensors:
        return {"target": torch.tensor([target])}

    for i, length in enumerate((1, 37, None)):
        cases.add(f"encoder{i}", "encoder", partial(propose, length, lambda _: {}), encode)
    for i, (count, rows) in enumerate(((1, 1), (43, 11))):
        cases.add(f"decoder{i}", "decoder", partial(propose, count, partial(decoder_ids, rows)), decode)
    for i, target in enumerate(targets):
        more = partial(wanted, target)
        cases.add(f"generate{i}", "generate", partial(propose, None, more), generate, target=target)


def add_interpolation(cases: Cases, config: Config, lengths: tuple[int, ...]) -> None:
    def propose(frames: int, generator: torch.Generator) -> Tensors:
        at = torch.arange(frames)
        anchor = (at % config["keyframe_stride"] == 0) | (at == frames - 1)
        return {f"codes.{part}": torch.where(anchor, weights.codes(frames, generator), MASK) for part in PARTS}

    def run(reference: Reference, inputs: Tensors, margin: Margin) -> Tensors:
        logits, codes = reference.interp(_joined("codes", inputs), margin)
        return _split("logits", logits) | _split("codes", codes)

    for i, frames in enumerate(lengths):
        cases.add(f"interp{i}", "interp", partial(propose, frames), run)


def add_motion(cases: Cases, lengths: tuple[int, ...]) -> None:
    def run(reference: Reference, inputs: Tensors, margin: Margin) -> Tensors:
        channels = reference.motion.decode(_joined("codes", inputs))
        rotations, translation = reference.motion.pose(channels, margin)
        return _split("channels", channels) | {"rotations": rotations, "translation": translation}

    def propose(frames: int, generator: torch.Generator) -> Tensors:
        return {f"codes.{part}": weights.codes(frames, generator) for part in PARTS}

    for i, frames in enumerate(lengths):
        cases.add(f"motion{i}", "motion", partial(propose, frames), run)


def add_mouth(cases: Cases, lengths: tuple[int, ...]) -> None:
    def propose(samples: int, generator: torch.Generator) -> Tensors:
        return {"audio": weights.audio(samples, generator)}

    def run(reference: Reference, inputs: Tensors, margin: Margin) -> Tensors:
        channels, voiced = reference.mouth(inputs["audio"], margin)
        return {"channels": channels, "voiced": voiced}

    for i, samples in enumerate(lengths):
        cases.add(f"mouth{i}", "mouth", partial(propose, samples), run)


def add_encoders(cases: Cases, config: Config, lengths: tuple[int, ...]) -> None:
    def propose(frames: int, generator: torch.Generator) -> Tensors:
        return {
            f"channels.{part}": weights.motion(frames, config["vq"][part]["channels"], joints, generator)
            for part, joints in weights.PART_JOINTS.items()
        }

    def run(reference: Reference, inputs: Tensors, margin: Margin) -> Tensors:
        channels = {part: value.to(reference.dtype) for part, value in _joined("channels", inputs).items()}
        return _split("codes", {part: reference.motion.encode(part, channels[part], margin) for part in PARTS})

    for i, frames in enumerate(lengths):
        cases.add(f"vqenc{i}", "vqenc", partial(propose, frames), run)


def describe(cases: Cases) -> str:
    """One line per output for manual review: spread of floats, variety of choices."""
    lines = []
    for name, value in cases.tensors.items():
        if ".out." not in name:
            continue
        if value.is_floating_point():
            spread = value.std().item() if value.numel() > 1 else 0.0
            text = f"largest {value.abs().max():.3f} deviation {spread:.3f}"
        else:
            text = f"{len(value.unique())} different of {value.numel()}"
        lines.append(f"  {name} {list(value.shape)}: {text}")
    return "\n".join(lines)
