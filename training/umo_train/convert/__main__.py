"""`python -m umo_train.convert`: converts published weights to one umo file."""

import argparse
import json
import sys
from pathlib import Path

from umo_train.convert.model import DTYPES, convert, write
from umo_train.convert.sources import SourceError, read_json


def main(arguments: list[str] | None = None) -> int:
    """Returns exit code 0, or 2 if the input is at fault."""
    options = _parser().parse_args(arguments)
    try:
        model = convert(
            read_json(options.config),
            options.hubert,
            options.kmeans,
            options.t5,
            options.vq,
            interp_file=options.interp,
            tokenizer=options.tokenizer,
            experts=options.experts,
            top_k=options.top_k,
            seed=options.seed,
        )
        write(options.output, model, options.dtype)
    except (SourceError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyError as error:
        print(f"error: {options.config}: no {json.dumps(error.args[0])} in the config", file=sys.stderr)
        return 2
    parameters = sum(tensor.numel() for tensor in model.tensors.values())
    print(f"{options.output}: {parameters:,} parameters")
    if "notice" in model.config:
        print(model.config["notice"])
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("python -m umo_train.convert", description=__doc__)
    add = parser.add_argument
    add("--config", type=Path, required=True, metavar="FILE", help="config in the format of docs/model-format.md")
    add("--hubert", type=Path, required=True, metavar="DIR", help="Hugging Face's HuBERT")
    add("--kmeans", type=Path, required=True, metavar="FILE", help="fairseq's .bin, a .npy, or safetensors")
    add("--t5", type=Path, required=True, metavar="DIR", help="Hugging Face's T5, or Language of Motion's .ckpt")
    add("--vq", type=Path, required=True, nargs="+", metavar="FILE", help="EMAGE's .bin files, or one .ckpt")
    add("--interp", type=Path, metavar="FILE", help="trained interpolation network (default: untrained)")
    add("--tokenizer", type=Path, metavar="FILE", help="SentencePiece model (default: T5's own)")
    add("--experts", type=int, metavar="E", help="experts of each feed-forward (default: the config's)")
    add("--top-k", type=int, metavar="K", help="experts that a row is sent to (default: the config's)")
    add("--dtype", choices=DTYPES, default="bf16", help="type of weights and tables (default: %(default)s)")
    add("--seed", type=int, default=0, metavar="NUMBER", help="seed of routers and other missing tensors")
    add("-o", "--output", type=Path, required=True, metavar="FILE", help="file to write")
    return parser


if __name__ == "__main__":
    sys.exit(main())
