"""`python -m umo_train.mouth add MODEL PART -o OUT` adds a trained mouth to a model file; `measure` measures one."""

import argparse
import json
from pathlib import Path

from umo_train.mouth import measure, part
from umo_train.mouth.run import Mouth


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m umo_train.mouth", description=__doc__)
    commands = parser.add_subparsers(required=True, dest="command")
    add = commands.add_parser("add", help="add the part to a model file; its other tensors keep their bytes")
    add.add_argument("model", type=Path)
    add.add_argument("part", type=Path, help="run/mouth.safetensors, or a model with the part")
    add.add_argument("-o", "--output", type=Path, required=True)
    look = commands.add_parser("measure", help="compare with the performer, over levels and noises, on recordings")
    look.add_argument("part", type=Path, help="run/mouth.safetensors")
    look.add_argument("--corpus", type=Path, required=True, help="speech and motion of the plan")
    look.add_argument("--speech", type=Path, help="a folder of real recordings")
    options = parser.parse_args(arguments)
    if options.command == "add":
        part.add(options.model, options.part, options.output)
        return
    mouth = Mouth.read(options.part)
    suffixes = (".wav", ".flac", ".ogg", ".opus")
    speech = sorted(path for path in options.speech.rglob("*") if path.suffix in suffixes) if options.speech else []
    found = {
        "held-out voices": measure.against_performer(mouth, options.corpus, "test_voice"),
        "held-out sentences": measure.against_performer(mouth, options.corpus, "test_sentence"),
        "levels": measure.at_levels(mouth, options.corpus, (-60, -50, -40, -30, -20, -10, 0)),
        "shut": measure.shut_over(mouth),
        "recordings": measure.recordings(mouth, speech),
    }
    print(json.dumps(found, indent=1, default=float))


if __name__ == "__main__":
    main()
