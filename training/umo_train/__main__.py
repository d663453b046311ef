"""`python -m umo_train --config configs/small.yaml --work DIR [--smoke] [STEP ...]`: remakes a model from nothing."""

import argparse
from pathlib import Path

import torch

from umo_train import pipeline


def main() -> None:
    parser = argparse.ArgumentParser(prog="umo_train", description="Makes a umo model, step by step.")
    parser.add_argument("steps", nargs="*", help=f"which of: {' '.join(pipeline.STEPS)} (default: all, in order)")
    parser.add_argument("--config", type=Path, required=True, help="the YAML file of the plan")
    parser.add_argument("--work", type=Path, required=True, help="the folder for data, checkpoints and the model")
    parser.add_argument("--smoke", action="store_true", help="the smallest run of everything: with smoke.yaml over it")
    parser.add_argument("--threads", type=int, default=2, help="threads of PyTorch (default: 2)")
    parser.add_argument("--only", help="of the step `tokenizers`: one network alone")
    arguments = parser.parse_args()
    unknown = set(arguments.steps) - set(pipeline.STEPS)
    if unknown:
        parser.error(f"no such step: {' '.join(sorted(unknown))}")
    torch.set_num_threads(arguments.threads)
    settings = pipeline.Run.read(arguments.config, arguments.work, smoke=arguments.smoke)
    if arguments.only:
        pipeline.step_tokenizers(settings, (arguments.only,))
        return
    pipeline.run(settings, tuple(arguments.steps) or pipeline.STEPS)


if __name__ == "__main__":
    main()
