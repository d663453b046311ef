"""`umo-train --config configs/small.yaml --work DIR [--smoke] [STEP ...]`: remakes a model from nothing."""

import argparse
import time
from pathlib import Path

import torch

from umo_train import pipeline, plots
from umo_train.frames.train import Interrupted
from umo_train.shard import ALL, Shard


def _shard(text: str) -> Shard:
    try:
        return Shard.parse(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="umo-train", description="Makes a umo model, step by step.")
    steps = f"some of: {' '.join(pipeline.STEPS)} (default: the plan's, in order); or plots: curves of the steps so far"
    parser.add_argument("steps", nargs="*", help=steps)
    parser.add_argument("--config", type=Path, help="the YAML file of the plan")
    parser.add_argument("--work", type=Path, required=True, help="the folder for data, checkpoints and the model")
    smallest = "a minimal run of everything: merges the plan's smoke file (smoke.yaml)"
    parser.add_argument("--smoke", action="store_true", help=smallest)
    parser.add_argument("--threads", type=int, default=2, help="threads of PyTorch (default: 2)")
    parser.add_argument("--only", help="for the step `tokenizers`: only this network")
    piece = "for the step `lm`: stops with a checkpoint after this many minutes; the same command continues from there"
    parser.add_argument("--minutes", type=float, help=piece)
    shares = f"for the steps {', '.join(pipeline.SHARED)}: makes share NUMBER of COUNT, such as 2/4"
    parser.add_argument("--shard", type=_shard, default=ALL, metavar="NUMBER/COUNT", help=shares)
    options = parser.parse_args(arguments)
    if options.steps == ["plots"]:
        for path in plots.draw(options.work / "run", options.work / "run" / "plots"):
            print(path)
        return
    unknown = set(options.steps) - set(pipeline.STEPS)
    if unknown:
        parser.error(f"no such step: {' '.join(sorted(unknown))}")
    if options.config is None:
        parser.error("--config is required")
    if options.shard != ALL and (not options.steps or set(options.steps) - set(pipeline.SHARED)):
        parser.error(
            f"--shard: only with the steps {', '.join(pipeline.SHARED)}, given by name; all others need every item"
        )
    torch.set_num_threads(options.threads)
    began = time.monotonic()
    settings = pipeline.Run.read(options.config, options.work, smoke=options.smoke)
    settings.shard = options.shard
    if options.minutes is not None:
        settings.until = began + 60 * options.minutes
    if options.only:
        pipeline.only(settings, options.only)
        return
    try:
        pipeline.run(settings, tuple(options.steps))
    except Interrupted as over:
        print(over)


if __name__ == "__main__":
    main()
