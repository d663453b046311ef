"""Cuts the stroke library from captures and clips, and writes it as `strokes.npz` beside this module.

    python -m umo_train.performer.cut --cmu FOLDER --clips FILE... [-o FILE]

`LICENSE-captures.txt` names the sources of both. The performer itself only needs the written file.
"""

import argparse
from pathlib import Path

from umo_train.performer import captures, strokes

# Clips with a standing person moving the arms; the others fight, dance, run or sit.
CLIPS = ("Bow", "Confused", "Consume Item", "Fixing_Kneeling", "Interact", "Reject", "Throw Object", "Victory")


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m umo_train.performer.cut", description=__doc__)
    parser.add_argument("--cmu", type=Path, required=True, help="folder of basketball_signal_*.npz and directing_*.npz")
    parser.add_argument("--clips", type=Path, nargs="*", default=[], help="glTF files with clips of CC0 libraries")
    parser.add_argument("-o", "--output", type=Path, default=Path(__file__).with_name(strokes.FILE))
    options = parser.parse_args(arguments)
    files = sorted([*options.cmu.glob("basketball_signal_*.npz"), *options.cmu.glob("directing_*.npz")])
    if not files:
        parser.error(f"no captures in {options.cmu}")
    made = [captures.cmu(path) for path in files]
    for path in sorted(options.clips):
        made += [clip for clip in captures.gltf(path) if clip.name in CLIPS]
    library = strokes.cut(made)
    strokes.write(options.output, library)
    print(f"{options.output}: {len(library)} movements of {len(made)} captures and clips")


if __name__ == "__main__":
    main()
