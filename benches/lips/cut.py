"""Writes the ten sentences of the repository from GRID: `python cut.py FOLDER` (the folder of `--grid`)."""

import json
import shutil
import sys
from pathlib import Path

import captured
import numpy as np

COUNT = 10


def cut(source: Path, target: Path) -> None:
    """Ten of the seeded tenth, evenly by name: sound as it is, mouths as whole numbers."""
    target.mkdir(exist_ok=True)
    entries = {}
    tenth = captured.grid(source)
    for one in tenth[:: len(tenth) // COUNT][:COUNT]:
        shutil.copyfile(source / "audio" / f"{one.name}.opus", target / f"{one.name}.opus")
        mouth = np.round(one.mouth * captured.STEPS).astype(int).tolist()
        entries[one.name] = {"words": [(word.start, word.end, word.text) for word in one.words], "mouth": mouth}
    lines = [f"{json.dumps(name)}:{json.dumps(entry, separators=(',', ':'))}" for name, entry in entries.items()]
    (target / "mouths.json").write_text("{\n" + ",\n".join(lines) + "\n}\n")


if __name__ == "__main__":
    cut(Path(sys.argv[1]), captured.TEN)
