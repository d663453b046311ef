"""`python -m umo_train.ablations`: effect of each part of the recipe, like the paper's table (4.3), on this data.

Every variant's stage 2 is trained for the same small number of steps on the outputs of a finished run in `--work`, and
animates the same held-out items. Interrupted runs continue.
"""

import argparse
import copy
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tqdm import tqdm

from umo_train import export, markdown, pipeline
from umo_train.interp.model import Interpolation
from umo_train.lm.examples import Examples, Stream
from umo_train.lm.model import LanguageModel
from umo_train.lm.train import StagePlan, mixture, train_stage
from umo_train.metrics import fgd, item, measure, program
from umo_train.metrics.agreement import config_of, encoder_ids, units_of
from umo_train.model_config import model_file_config
from umo_train.plan import Run, merged
from umo_train.skeleton import PARTS
from umo_train.speech.utterance import FRAME_RATE

# Files that a variant shares with the finished run.
_SHARED = ("audio.safetensors", "audio_tokens", "codes", "rest.yaml", "interp.pt", "lm_pretrain.safetensors")
_TOKENIZERS = tuple(f"tokenizer_{name}.pt" for name in (*PARTS, "root"))


@dataclass(frozen=True)
class Variant:
    """`over` is merged into the plan; `same` names the variant whose language model it shares."""

    name: str
    over: dict[str, Any]
    augment: bool = True
    keyframes: bool = True
    linear: bool = False
    same: str = ""


VARIANTS = (
    Variant("all of it", {}),
    Variant("no experts", {"lm": {"experts": 1}}),
    Variant("no keyframes", {}, keyframes=False),
    Variant("linear interpolation", {}, linear=True, same="all of it"),
    Variant("no augmentation", {}, augment=False),
)


class EveryFrame(Examples):
    """Chunks in which the decoder predicts every frame, with the same history and speech."""

    def said(self, stream: Stream, at: int, target: int) -> np.ndarray:
        out = np.full((len(PARTS), target * self.stride), -1, np.int64)
        codes = stream.codes[:, at * self.stride :][:, : target * self.stride]
        out[:, : codes.shape[1]] = codes
        return out

    def heard_at(self, target: int) -> np.ndarray:
        frames = self.prefix * self.stride + np.arange(target * self.stride)
        return np.minimum(frames * self.tokens // self.stride + self.middle, (self.prefix + target) * self.tokens - 1)


def prepare(s: Run, variant: Variant) -> Run:
    """The variant's plan and folder, with its shared files linked into it."""
    folder = s.folder / "ablations" / (variant.same or variant.name).replace(" ", "_")
    folder.mkdir(parents=True, exist_ok=True)
    shared = [*_SHARED, *_TOKENIZERS]
    if not variant.over:
        shared.append("lm_stage1.safetensors")
    for name in shared:
        if not (s.folder / name).exists():
            raise FileNotFoundError(f"{s.folder / name} is missing: run the plan to its end first")
        if not (folder / name).exists():
            (folder / name).symlink_to((s.folder / name).resolve())
    return Run(merged(s.plan, copy.deepcopy(variant.over)), s.plans, s.corpus, folder)


def train(s: Run, variant: Variant, steps: int) -> None:
    """Trains the language model up to stage 2, of `steps` steps."""
    config = model_file_config(s)
    kind = Examples if variant.keyframes else EveryFrame
    held = pipeline.examples(s, config, s.plan.get("held_out", "test_voice"), augment=False, kind=kind)
    drawn = pipeline.examples(s, config, "train", augment=variant.augment, kind=kind)
    torch.manual_seed(s.plan["seed"])
    before: LanguageModel | None = None
    for stage in s.plan["stages"][:3]:
        over: dict[str, Any] = {"tasks": mixture(stage["tasks"], drawn), "targets": tuple(stage.get("targets", (5,)))}
        if stage["name"] == "stage2":
            over |= {"steps": steps, "tasks": {"a2m": 1.0}, "targets": (5,)}
        plan = StagePlan(**{"seed": s.plan["seed"]} | stage | over)
        model = LanguageModel(config, dense=plan.dense, marked=s.plan.get("marked", False))
        path = s.folder / f"lm_{plan.name}.safetensors"
        if path.exists():
            model.load_state_dict(export.load_state(path))
        else:
            if before is not None:
                model.load_state_dict(pipeline.carried(before, plan, config))
            train_stage(plan, model, drawn, held, s.folder)
            export.save_state(path, pipeline.train_result(s.folder, plan, model))
        before = model


def write_model(s: Run, variant: Variant) -> Path:
    """Writes the variant as a model file. Linear interpolation is the untrained network without its other layers."""
    path = s.folder / f"{variant.name.replace(' ', '_')}.safetensors"
    plan = s.plan | {"name": path.stem, "stages": s.plan["stages"][:3]}
    interpolation = None
    if variant.linear:
        interpolation = Interpolation(model_file_config(s))
        interpolation.know(
            {part: model.quantizer.embedding.weight.detach() for part, model in pipeline.tokenizers(s).items()}
        )
        for layer in (*interpolation.temporal, *interpolation.part):
            torch.nn.init.zeros_(layer.linear2.weight)
            torch.nn.init.zeros_(layer.linear2.bias)
            if layer is not interpolation.temporal[0]:
                torch.nn.init.zeros_(layer.self_attn.out_proj.weight)
                torch.nn.init.zeros_(layer.self_attn.out_proj.bias)
    pipeline.step_export(replace(s, plan=plan), interpolation)
    return path


@torch.no_grad()
def every_frame(
    s: Run, umo: Path, model: Path, items: Sequence[item.Item], seed: int = 0
) -> list[dict[str, np.ndarray]]:
    """Motion of a model that predicts every frame: chunks of all items in a batch, sampled according to the file."""
    config = config_of(umo, model)
    network = LanguageModel(model_file_config(s), marked=s.plan.get("marked", False)).eval()
    network.load_state_dict(export.load_state(s.folder / "lm_stage2.safetensors"))
    vocab, stride = config["vocab"], config["keyframe_stride"]
    prefix, target, rate = config["prefix"], config["target"], config["audio"]["token_rate"]
    each = rate * stride // config["frame_rate"]
    units = [units_of(umo, one, config, model) for one in items]
    chunks = min((len(row) // each - prefix) // target for row in units)
    made = np.zeros((len(items), len(PARTS), 0), np.int64)
    rest = np.repeat([[config["rest"][part]] for part in PARTS], prefix, 1)
    torch.manual_seed(seed)
    for number in tqdm(range(chunks), "every frame"):
        ids = []
        for row, so_far in zip(units, made, strict=True):
            history = np.concatenate([rest, so_far[:, ::stride]], 1)[:, -prefix:]
            window = row[number * target * each :][: (prefix + target) * each]
            ids.append(encoder_ids(config, window, dict(zip(PARTS, history, strict=True))))
        hidden = network.encode(torch.from_numpy(np.stack(ids)))
        said = torch.full((len(items), 1), vocab["decoder_start"])
        new = []
        for part in PARTS:
            of = vocab[part]
            said = torch.cat([said, torch.full_like(said[:, :1], of["start"])], 1)
            for _ in range(target * stride):
                logits = network.head(network.decode(hidden, said)[:, -1])[:, of["first"] : of["first"] + of["codes"]]
                said = torch.cat([said, of["first"] + _drawn(logits, config, s.plan, part)[:, None]], 1)
            new.append(said[:, -target * stride :].numpy() - of["first"])
            said = torch.cat([said, torch.full_like(said[:, :1], of["end"])], 1)
        made = np.concatenate([made, np.stack(new, 1)], 2)
    return [program.decode(umo, dict(zip(PARTS, codes, strict=True)), model) for codes in made]


def _drawn(logits: torch.Tensor, config: dict[str, Any], plan: dict[str, Any], part: str) -> torch.Tensor:
    """A code for each row, by the model's sampling: top k, then top p."""
    sampling = config["sampling"]
    values, order = (logits.float() * plan.get("sharpen", {}).get(part, 1.0) / sampling["temperature"]).sort(
        descending=True
    )
    chance = values[:, : sampling["top_k"]].softmax(-1)
    chance = torch.where(chance.cumsum(-1) - chance < sampling["top_p"], chance, 0)
    return order.gather(1, torch.multinomial(chance, 1))[:, 0]


def measured(items: Sequence[item.Item], moved: Sequence[item.Motion]) -> dict[str, Any]:
    """Numbers of a table row computed from one take of the items."""
    made = [measure.Made(one, motion) for one, motion in zip(items, moved, strict=True)]
    lips = list(measure.mouth(made).values())
    return {
        "lips": min(row["lip_correlation"] for row in lips),
        "closures": min(row["closures"] for row in lips),
        "beat": measure.beats(made)["accents_sharp"]["ratio"],
        "jerk": measure.smoothness(list(moved))["jerk"],
    }


def distance(
    subject: measure.Subject, encoder: fgd.AutoEncoder, items: Sequence[item.Item], moved: Sequence[item.Motion]
) -> dict[str, Any]:
    """FGD of the subject's takes without layers, relative to that of random codes (`measure.distance`)."""
    made = [measure.Made(one, motion) for one, motion in zip(items, moved, strict=True)]
    found = measure.distance(subject, made, encoder)
    return {"fgd": found["model"] / found["random_codes"]}


def millions(state: dict[str, torch.Tensor]) -> float:
    """Number of parameters in millions."""
    return sum(tensor.numel() for tensor in state.values()) / 1e6


def table(rows: dict[str, dict[str, Any]]) -> str:
    """The rows as Markdown."""
    columns: list[markdown.Column] = [
        ("parameters of the language model", lambda row: f"{row['parameters']:.1f} M"),
        ("ids a second", lambda row: f"{row['ids']:.0f}"),
        ("cross-entropy of a keyframe's codes", lambda row: "–" if row["loss"] is None else f"{row['loss']:.3f}"),
        ("lips", lambda row: f"{row['lips']:.3f}"),
        ("closed at p, b, m", lambda row: f"{100 * row['closures']:.1f} %"),
        ("FGD over random codes", lambda row: f"{row['fgd']:.3f}"),
        ("beat", lambda row: f"{row['beat']:.3f}"),
        ("jerk, m/s³", lambda row: f"{row['jerk']:.0f}"),
    ]
    return markdown.table(columns, rows)


def held_out_loss(folder: Path) -> float:
    """The last value in stage 2's log."""
    lines = (folder / "lm_stage2.csv").read_text().splitlines()
    return float([line for line in lines if ",held_out_loss," in line][-1].split(",")[2])


def row_of(s: Run, umo: Path, variant: Variant, encoder: fgd.AutoEncoder, items: list[item.Item]) -> dict[str, Any]:
    """All numbers of the table for a trained variant."""
    model = write_model(s, variant)
    config = config_of(umo, model)
    if variant.keyframes:
        moved = [measure.Subject(umo, model).animate(one) for one in items]
    else:
        moved = every_frame(s, umo, model, items)
    frames = min(len(motion["face"]) for motion in moved)
    seconds = config["target"] * config["keyframe_stride"] / FRAME_RATE
    labels = config["target"] * (1 if variant.keyframes else config["keyframe_stride"])
    # The same stretch of every item, however its chunks end.
    moved = [{part: values[:frames] for part, values in motion.items()} for motion in moved]
    return {
        **measured(items, moved),
        **distance(measure.Subject(umo, model), encoder, items, moved),
        "parameters": millions(export.load_state(s.folder / "lm_stage2.safetensors")),
        "ids": len(PARTS) * (labels + 2) / seconds,
        # Between keyframes the code is often the previous one: not comparable.
        "loss": held_out_loss(s.folder) if variant.keyframes else None,
    }


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="umo-train ablations", description=__doc__)
    parser.add_argument("--config", type=Path, required=True, help="the YAML file of the plan")
    parser.add_argument("--work", type=Path, required=True, help="the folder of a finished run")
    parser.add_argument("--smoke", action="store_true", help="the run was made with --smoke")
    parser.add_argument("--umo", type=Path, help="the program (default: on PATH or target/release/umo)")
    parser.add_argument("--steps", type=int, default=600, help="steps of stage 2, for every variant")
    parser.add_argument("--most", type=int, default=8, help="maximum number of items of the held-out voices")
    parser.add_argument(
        "--autoencoder", type=Path, default=fgd.JUDGE, help="motion auto-encoder (default: the package's)"
    )
    parser.add_argument("--threads", type=int, default=2, help="threads of PyTorch")
    parser.add_argument(
        "-o", "--output", type=Path, required=True, help="file for the table; the numbers are written beside it"
    )
    options = parser.parse_args(arguments)
    torch.set_num_threads(options.threads)
    s = Run.read(options.config, options.work, smoke=options.smoke)
    umo = program.find(options.umo)
    items = item.from_corpus(s.corpus, "test_voice", options.most, 0, 0)
    encoder = fgd.AutoEncoder.load(options.autoencoder)
    numbers = options.output.with_suffix(".json")
    rows: dict[str, dict[str, Any]] = json.loads(numbers.read_text()) if numbers.exists() else {}
    for variant in VARIANTS:
        own = prepare(s, variant)
        if not variant.same:
            train(own, variant, options.steps)
        if variant.name not in rows:
            rows[variant.name] = row_of(own, umo, variant, encoder, items)
            numbers.write_text(json.dumps(rows, indent=1) + "\n")
    text = table(rows)
    options.output.write_text(text)
    print(text, end="")


if __name__ == "__main__":
    main()
