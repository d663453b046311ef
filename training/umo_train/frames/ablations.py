"""`python -m umo_train.frames.ablations`: effect of each part of layout `frames` and of its data.

Every variant's language model is trained from fresh weights for the same steps on a run's packed data in `--work`
(`train`, on a machine with a GPU), and animates the same held-out items with the run's tokenizers (`measure`). All have
one expert: the benefit of more does not show after so few steps (training/README.md). With `--parts`, the folder of a
run of `ablation_parts.yaml`, a row has the paper's layout: `pack` prepares its data for `train`.
"""

import argparse
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from umo_train import export, markdown
from umo_train.frames import ablation_parts, packed, steps
from umo_train.frames.model import FrameModel
from umo_train.frames.packed import Packed
from umo_train.frames.parts import Part
from umo_train.frames.train import FrameStagePlan, train_stage
from umo_train.log import EVERY
from umo_train.plan import Config, Run
from umo_train.skeleton import PARTS


@dataclass(frozen=True)
class Variant:
    """Left out: parts by name, levels from `levels` up, or people's recordings. `same` names the variant whose weights
    it shares, and `more` and `more_of_text` are then additional arguments of `umo animate` and `umo text`."""

    name: str
    without: tuple[str, ...] = ()
    levels: int = 0
    people: bool = True
    same: str = ""
    more: tuple[str, ...] = ()
    more_of_text: tuple[str, ...] = ()


VARIANTS = (
    Variant("all of it"),
    Variant("nothing heard ahead", same="all of it", more=("--horizon", "0")),
    Variant("no guidance of a text", same="all of it", more_of_text=("--guidance", "1")),
    Variant("no intent", without=("intent",)),
    Variant("two levels", levels=2),
    Variant("no recordings of people", people=False),
)


def file_of(variant: Variant) -> str:
    return (variant.same or variant.name).replace(" ", "_")


def varied(variant: Variant, whole: Packed, order: list[Part]) -> tuple[Packed, list[Part]]:
    """Training data of a variant's language model, and its parts."""
    kept, columns, at = [], [], 0
    for part in order:
        levels = min(part.levels, variant.levels or part.levels)
        if part.name not in variant.without:
            kept.append(replace(part, levels=levels))
            columns += range(at, at + levels)
        at += part.levels
    rests = {entry["name"]: entry["rest"] for entry in whole.config["parts"]}
    config = whole.config | {"parts": [part.config(rests[part.name][: part.levels]) for part in kept]}
    config["lm"] = config["lm"] | {"experts": 1}
    body = [mine for mine, part in zip(whole.body, order, strict=True) if part.name not in variant.without]
    splits = {
        split: [
            replace(stream, codes=None if stream.codes is None else stream.codes[:, columns])
            for stream in streams
            if variant.people or not stream.person
        ]
        for split, streams in whole.splits.items()
    }
    return replace(whole, config=config, body=body, splits=splits), kept


def train(s: Run, data: Packed, variant: Variant, plan: FrameStagePlan) -> None:
    """`run/ablations/NAME.safetensors`, f32."""
    folder = s.folder / "ablations"
    out = folder / f"{file_of(variant)}.safetensors"
    if out.exists():
        return
    mine, order = varied(variant, data, steps.parts_of(s))
    torch.manual_seed(plan.seed)
    model = FrameModel(mine.config, order, marked=s.plan.get("marked", False))
    given = replace(plan, name=file_of(variant))
    held = next(split for split in mine.splits if split != "train")
    examples = [mine.examples(order, split, augment=split == "train") for split in ("train", held)]
    folder.mkdir(parents=True, exist_ok=True)
    train_stage(given, model, *examples, folder)
    export.save_state(out, steps.copies(folder, given, model))


def write_model(s: Run, data: Packed, variant: Variant) -> Path:
    """The variant as a model file, bf16."""
    path = s.folder / "ablations" / "models" / f"{file_of(variant)}.safetensors"
    if not path.exists():
        mine, order = varied(variant, data, steps.parts_of(s))
        weights = export.load_state(s.folder / "ablations" / f"{file_of(variant)}.safetensors")
        steps.export_model(s, path, mine.config, order, weights)
    return path


def said_right(folder: Path, name: str) -> dict[str, float]:
    """The last held-out numbers of a variant's log."""
    found: dict[str, float] = {}
    for line in (folder / f"lm_{name}.csv").read_text().splitlines():
        _, name, value = line.split(",")
        if name.startswith("held_out_"):
            found[name.removeprefix("held_out_")] = float(value)
    return found


def table(rows: dict[str, dict[str, Any]]) -> str:
    """The rows as Markdown."""

    def percent(name: str) -> Callable[[dict[str, Any]], str]:
        return lambda row: f"{100 * row[name]:.0f} %" if name in row else "–"

    def real_mouths(row: dict[str, Any]) -> str:
        return f"{row['real']:.2f}, {row['real_worst']:.2f}" if "real" in row else "–"

    columns: list[markdown.Column] = [
        ("parameters", lambda row: f"{row['parameters']:.1f} M"),
        ("codes a keyframe", lambda row: f"{row['codes']}"),
        ("mouth's first codes right", percent("mouth")),
        ("intent's", percent("intent")),
        ("arms'", lambda row: f"{50 * (row['left_arm'] + row['right_arm']):.0f} %" if "left_arm" in row else "–"),
        ("lips, r", lambda row: f"{row['lips']:.2f}"),
        ("closed at p, b, m", percent("closures")),
        ("recorded people: mouth against the envelope, mean, worst", real_mouths),
        ("actions from text known", percent("actions")),
        ("beats", lambda row: f"{row['beat']:.2f}"),
        ("FGD over random codes", lambda row: f"{row['fgd']:.2f}"),
        ("jerk, m/s³", lambda row: f"{row['jerk']:.0f}"),
    ]
    return markdown.table(columns, rows)


def measure(s: Run, data: Packed, options: argparse.Namespace) -> None:
    """Writes the table of all trained variants, and the numbers beside it."""
    # Imported late: the training machine may lack the requirements of measuring.
    from umo_train.ablations import distance, measured, millions
    from umo_train.metrics import acted, fgd, item, program
    from umo_train.metrics.measure import Made, Subject, real_mouth

    umo, encoder = program.find(options.umo), fgd.AutoEncoder.load(fgd.JUDGE)
    items = [one for split in options.split for one in item.from_corpus(s.corpus, split, options.most, 0, 0)]
    known = item.readers(s.corpus)
    real = [one for one in (item.recordings(options.speech) if options.speech else []) if one.voice not in known]
    numbers = options.output.with_suffix(".json")
    rows: dict[str, dict[str, Any]] = json.loads(numbers.read_text()) if numbers.exists() else {}
    folder = s.folder / "ablations"

    def row_of(model: Path, weights: Path, log: str, variant: Variant, *, acts: bool) -> dict[str, Any]:
        subject = Subject(umo, model, more=variant.more)
        moved = [[subject.animate(one, seed) for one in items] for seed in range(options.takes)]
        takes = [measured(items, take) for take in moved]
        row: dict[str, Any] = {name: float(np.mean([take[name] for take in takes])) for name in takes[0]}
        row |= distance(subject, encoder, items, moved[0])
        row["parameters"] = millions(export.load_state(weights))
        if real:
            speakers = real_mouth([Made(one, subject.animate(one)) for one in real]).values()
            found = [speaker["correlation"] for speaker in speakers]
            row |= {"real": float(np.mean(found)), "real_worst": min(found)}
        if acts and options.acted:
            more = variant.more_of_text
            row["actions"] = acted.measure(umo, model, s.corpus, options.acted, more=more)["model"]
        return row | said_right(folder, log)

    for variant in VARIANTS:
        trained = folder / f"{file_of(variant)}.safetensors"
        if variant.name in rows or not trained.exists():
            continue
        _, order = varied(variant, data, steps.parts_of(s))
        row = row_of(write_model(s, data, variant), trained, file_of(variant), variant, acts=True)
        rows[variant.name] = row | {"codes": sum(part.levels for part in order)}
        numbers.write_text(json.dumps(rows, indent=1) + "\n")
    trained = folder / f"{ablation_parts.FILE}.safetensors"
    if options.parts and ablation_parts.NAME not in rows and trained.exists():
        model = ablation_parts.write_model(parts_run(options), folder)
        row = row_of(model, trained, ablation_parts.FILE, Variant(ablation_parts.NAME), acts=False)
        rows[ablation_parts.NAME] = row | {"codes": len(PARTS)}
        numbers.write_text(json.dumps(rows, indent=1) + "\n")
    text = table(rows)
    options.output.write_text(text)
    print(text, end="")


def parts_run(options: argparse.Namespace) -> Run:
    """The run of layout `parts`; its plan is beside the other's."""
    return Run.read(options.config.parent / "ablation_parts.yaml", options.parts)


def stage(options: argparse.Namespace, given: Config) -> FrameStagePlan:
    """`given` is the plan's first stage with experts: its batch, tasks and weights."""
    own = {"name": "", "steps": options.steps, "rate": 1.5e-3, "warmup": 60, "final_rate": 0.05}
    known = {key: given[key] for key in ("batch", "readers", "tasks", "unknown", "part_weights") if key in given}
    # Fresh weights find the audio of a keyframe sooner if the encoder has to predict it itself.
    return FrameStagePlan(**own, **known, heard=0.5, balance=0.0, save_every=options.steps)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="umo-train frames ablations", description=__doc__)
    parser.add_argument("what", choices=("pack", "train", "measure"))
    parser.add_argument("--config", type=Path, required=True, help="the YAML file of the plan")
    parser.add_argument("--work", type=Path, required=True, help="the folder of a run with run/packed.xz")
    parser.add_argument("--steps", type=int, default=600, help="steps of every variant")
    parser.add_argument("--rows", nargs="+", help="names of the rows to train (default: all)")
    parser.add_argument("--umo", type=Path, help="the program (default: on PATH or target/release/umo)")
    parser.add_argument("--split", nargs="+", default=["test_sentence", "test_voice"])
    parser.add_argument("--most", type=int, default=8, help="maximum number of held-out items per split")
    parser.add_argument("--takes", type=int, default=2, help="takes of each item")
    parser.add_argument("--parts", type=Path, help="the folder of a run of ablation_parts.yaml")
    parser.add_argument("--speech", type=Path, help="folder of real recordings")
    parser.add_argument("--acted", type=int, default=4, help="takes of each action")
    parser.add_argument("--threads", type=int, default=2, help="threads of PyTorch")
    parser.add_argument("-o", "--output", type=Path, help="file for the table; the numbers are written beside it")
    options = parser.parse_args(arguments)
    torch.set_num_threads(options.threads)
    s = Run.read(options.config, options.work)
    packed_parts = s.folder / "packed_parts.xz"
    if options.what == "pack":
        if options.parts is None:
            parser.error("--parts is required: the folder of the run of ablation_parts.yaml")
        ablation_parts.pack(parts_run(options), packed_parts)
        return
    data = packed.read(s.folder / packed.NAME)
    if options.what == "measure":
        if options.output is None:
            parser.error("-o: where to?")
        measure(s, data, options)
        return
    if options.steps < EVERY:
        parser.error(f"--steps: expected at least {EVERY}, the logging interval")
    plan = stage(options, next(one for one in s.plan["stages"] if not one.get("dense")))
    wanted = set(options.rows or [ablation_parts.NAME, *(variant.name for variant in VARIANTS)])
    for variant in VARIANTS:
        if not variant.same and variant.name in wanted:
            train(s, data, variant, plan)
    if packed_parts.exists() and ablation_parts.NAME in wanted:
        ablation_parts.train(packed.read(packed_parts), s.folder / "ablations", plan)


if __name__ == "__main__":
    main()
