"""The ablation table's row for the paper's layout: the same corpus, audio units and steps, with four parts whose codes
the decoder samples one by one.

Its plan is `configs/ablation_parts.yaml`. It learns from audio with and without a prompt, but not from text alone, nor
from audio beyond a chunk, which the layout does not support.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from umo_train import export, pipeline
from umo_train.frames import packed
from umo_train.frames.examples import FrameStream
from umo_train.frames.packed import Packed
from umo_train.frames.train import FrameStagePlan
from umo_train.lm.examples import Examples, Stream
from umo_train.lm.model import LanguageModel
from umo_train.lm.train import StagePlan, train_stage
from umo_train.model_config import model_file_config
from umo_train.plan import Run
from umo_train.skeleton import PARTS

NAME = "layout parts"
FILE = "layout_parts"
_NOTHING = np.zeros(0, np.int64)


def pack(s: Run, out: Path) -> None:
    """Codes of keyframes, units and prompts of the run `s` of layout `parts`, in the format of layout `frames`' step
    `pack`."""
    config = model_file_config(s)
    held_out = s.plan.get("held_out", "test_voice")
    drawn = {split: pipeline.examples(s, config, split, augment=False) for split in ("train", held_out)}
    splits = {split: [_frame_stream(one) for one in examples.streams] for split, examples in drawn.items()}
    delay = s.plan["audio"].get("listener", {}).get("delay")
    packed.write(out, Packed(config, drawn["train"].silence, delay, [part != "face" for part in PARTS], splits))


def _frame_stream(stream: Stream) -> FrameStream:
    codes = None if stream.codes is None else stream.codes.T
    prompts = tuple(prompt for prompt in (stream.prompt, *stream.more_prompts) if len(prompt))
    return FrameStream(codes, stream.units, prompts)


def examples(data: Packed, split: str, *, augment: bool) -> Examples:
    """Examples from a packed split."""
    streams = [
        Stream(None if one.codes is None else one.codes.T, one.units, _NOTHING, *_prompts(one.prompts))
        for one in data.splits[split]
    ]
    return Examples(data.config, streams, data.silence, augment=augment, delay=data.delay)


def _prompts(given: tuple[np.ndarray, ...]) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
    return (given[0], given[1:]) if given else (_NOTHING, ())


def stage(like: FrameStagePlan) -> StagePlan:
    """As long, as large and as fast as the other rows' stage. Two thirds of the examples have a prompt, as there."""
    return StagePlan(
        FILE,
        like.steps,
        {"a2m": 1.0, "a2m_prompted": 2.0},
        like.rate,
        batch=like.batch,
        balance=0.0,
        heard=like.heard,
        align=True,
        tau=1.0,
        targets=like.targets,
        warmup=like.warmup,
        final_rate=like.final_rate,
        seed=like.seed,
        save_every=like.steps,
        readers=like.readers,
    )


def train(data: Packed, folder: Path, like: FrameStagePlan) -> None:
    """`folder/layout_parts.safetensors`, f32, from fresh weights."""
    out = folder / f"{FILE}.safetensors"
    if out.exists():
        return
    plan = stage(like)
    held = next(split for split in data.splits if split != "train")
    torch.manual_seed(plan.seed)
    model = LanguageModel(data.config, marked=True)
    folder.mkdir(parents=True, exist_ok=True)
    train_stage(plan, model, examples(data, "train", augment=True), examples(data, held, augment=False), folder)
    export.save_state(out, pipeline.train_result(folder, plan, model))


def write_model(s: Run, folder: Path) -> Path:
    """`folder/models/layout_parts.safetensors`: the row as a model file, bf16. Tokenizers and interpolation network
    come from the run `s`."""
    path = folder / "models" / f"{FILE}.safetensors"
    if not path.exists():
        export.save_state(s.folder / f"lm_{FILE}.safetensors", export.load_state(folder / f"{FILE}.safetensors"))
        plan = s.plan | {"name": FILE, "stages": [{"name": FILE}]}
        pipeline.step_export(replace(s, plan=plan))
        path.parent.mkdir(parents=True, exist_ok=True)
        (s.folder / f"{FILE}.safetensors").rename(path)
    return path
