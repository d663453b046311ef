"""Inputs and expected outputs of the stages of layout `frames`."""

from functools import partial

import torch
from torch import Tensor

import weights
from cases import Cases, Tensors
from frames import Codes, FrameReference
from layout import PARTS, Config, moving
from margin import Margin

# Encoder states passed to the face and the body.
HEARD = ("heard", "body_heard")


def add(cases: Cases, config: Config, *, encoders: bool) -> None:
    add_language_model(cases, config)
    add_depth(cases, config, (1, 5))
    add_interpolation(cases, config, (1, 13, 20))
    add_motion(cases, config, (1, 23))
    if encoders:
        add_encoders(cases, config, (1, 23))


def _split(group: str, values: Tensors) -> Tensors:
    return {f"{group}.{name}": value for name, value in values.items()}


def _joined(group: str, tensors: Tensors) -> Codes:
    prefix = f"{group}."
    return {name.removeprefix(prefix): tensor for name, tensor in tensors.items() if name.startswith(prefix)}


def _codes(parts: list[Config], count: int, generator: torch.Generator) -> Codes:
    return {
        part["name"]: torch.randint(0, part["codes"], (count, part["levels"]), generator=generator) for part in parts
    }


def prompt(config: Config, length: int | None, generator: torch.Generator) -> Tensor:
    """Random ids from the vocabulary and for keyframes, or (without a length) a whole audio-to-motion prompt."""
    vocab, prefix = config["vocab"], config["prefix"]
    if length is not None:
        return torch.randint(0, vocab["size"] + prefix, (length,), generator=generator)
    audio, ids = vocab["audio"], []
    for item in config["templates"]["audio_to_motion"]:
        if isinstance(item, int):
            ids.append(item)
        elif item == "text":
            ids += torch.randint(3, audio["first"] - 3, (5,), generator=generator).tolist()
        elif item == "history":
            ids += range(vocab["size"], vocab["size"] + prefix)
        else:
            # The last keyframe of the audio has not been heard.
            count = 10 * (prefix + config["target"] + config["audio"]["ahead"] - 1)
            units = torch.randint(0, audio["codes"], (count,), generator=generator) + audio["first"]
            ids += [audio["start"], *units.tolist(), *[audio["mask"]] * 10, audio["end"]]
    return torch.tensor(ids)


def add_language_model(cases: Cases, config: Config) -> None:
    def propose(length: int | None, keyframes: int, generator: torch.Generator) -> Tensors:
        inputs = {"input_ids": prompt(config, length, generator)}
        inputs |= _split("history", _codes(config["parts"], config["prefix"], generator))
        return inputs | (_split("codes", _codes(config["parts"], keyframes, generator)) if keyframes else {})

    def encode(reference: FrameReference, inputs: Tensors, margin: Margin) -> Tensors:
        routers = reference.lm.begin()
        hidden = reference.encode(inputs["input_ids"], _joined("history", inputs))
        margin.smallest = routers.smallest
        return {"hidden": hidden}

    def decode(reference: FrameReference, inputs: Tensors, margin: Margin) -> Tensors:
        routers = reference.lm.begin()
        hidden = reference.encode(inputs["input_ids"], _joined("history", inputs))
        states = reference.decode(hidden, _joined("codes", inputs))
        margin.smallest = routers.smallest
        return {"hidden": states}

    def generate(reference: FrameReference, inputs: Tensors, margin: Margin) -> Tensors:
        routers = reference.lm.begin()
        hidden = reference.encode(inputs["input_ids"], _joined("history", inputs))
        history = _joined("history", inputs)
        codes = reference.generate(inputs["input_ids"], hidden, history, int(inputs["target"]), margin)
        margin.smallest = min(margin.smallest, routers.smallest)
        return _split("codes", codes)

    for i, length in enumerate((1, 37, None)):
        cases.add(f"encoder{i}", "encoder", partial(propose, length, 0), encode)
    for i, (length, keyframes) in enumerate(((1, 1), (43, 3))):
        cases.add(f"decoder{i}", "decoder", partial(propose, length, keyframes), decode)
    for i, target in enumerate((1, 2)):

        def wanted(target: int, generator: torch.Generator) -> Tensors:
            return propose(None, 0, generator) | {"target": torch.tensor([target])}

        cases.add(f"generate{i}", "generate", partial(wanted, target), generate, target=target)


def add_depth(cases: Cases, config: Config, lengths: tuple[int, ...]) -> None:
    def propose(rows: int, generator: torch.Generator) -> Tensors:
        hidden = torch.randn(rows, config["lm"]["d_model"], generator=generator)
        inputs = {"hidden": hidden} | _split("codes", _codes(config["parts"], rows, generator))
        if config["depth"].get("before"):
            inputs |= _split("before", _codes(config["parts"], rows, generator))
        for key in HEARD:
            if key in config["depth"]:
                inputs[key] = torch.randn(rows, config["lm"]["d_model"], generator=generator)
        return inputs

    def run(reference: FrameReference, inputs: Tensors, _: Margin) -> Tensors:
        hidden = inputs["hidden"].to(reference.dtype)
        heard = [inputs[key].to(reference.dtype) for key in HEARD if key in inputs]
        return _split("logits", reference.depth(hidden, _joined("codes", inputs), _joined("before", inputs), heard))

    for i, rows in enumerate(lengths):
        cases.add(f"depth{i}", "depth", partial(propose, rows), run)


def add_interpolation(cases: Cases, config: Config, lengths: tuple[int, ...]) -> None:
    def propose(frames: int, generator: torch.Generator) -> Tensors:
        at = torch.arange(frames)
        # The last frame is known if it is off the keyframe grid, and unknown if on it.
        known = (at % config["keyframe_stride"] == 0) | (at == 11)
        vectors = {
            part["name"]: torch.randn(frames, part["width"], generator=generator) * known[:, None]
            for part in moving(config)
        }
        return {"known": known.long()} | _split("vectors", vectors)

    def run(reference: FrameReference, inputs: Tensors, _: Margin) -> Tensors:
        vectors = {name: value.to(reference.dtype) for name, value in _joined("vectors", inputs).items()}
        return _split("vectors", reference.interp(vectors, inputs["known"] != 0))

    for i, frames in enumerate(lengths):
        cases.add(f"interp{i}", "interp", partial(propose, frames), run)


def add_motion(cases: Cases, config: Config, lengths: tuple[int, ...]) -> None:
    def propose(frames: int, generator: torch.Generator) -> Tensors:
        return _split("codes", _codes(moving(config), frames, generator))

    def run(reference: FrameReference, inputs: Tensors, margin: Margin) -> Tensors:
        channels = reference.motion.decode(_joined("codes", inputs))
        rotations, translation = reference.motion.pose(channels, margin)
        outputs = _split("channels", {part: channels[part] for part in PARTS})
        return outputs | {"rotations": rotations, "translation": translation}

    for i, frames in enumerate(lengths):
        cases.add(f"motion{i}", "motion", partial(propose, frames), run)


def add_encoders(cases: Cases, config: Config, lengths: tuple[int, ...]) -> None:
    def propose(frames: int, generator: torch.Generator) -> Tensors:
        return _split("channels", weights.body(config, frames, generator))

    def run(reference: FrameReference, inputs: Tensors, margin: Margin) -> Tensors:
        channels = {part: value.to(reference.dtype) for part, value in _joined("channels", inputs).items()}
        codes = {part["name"]: reference.motion.levels(channels, part, margin) for part in moving(config)}
        return _split("codes", codes)

    for i, frames in enumerate(lengths):
        cases.add(f"vqenc{i}", "vqenc", partial(propose, frames), run)
