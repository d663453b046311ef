"""Prints statistics of the performer's motion for speech: `python -m umo_train.performer FOLDER` (a corpus' folder)."""

import argparse
from pathlib import Path

from umo_train.data import corpus
from umo_train.performer import actions, animation, perform
from umo_train.performer.prosody import listen
from umo_train.performer.report import Take, measure
from umo_train.performer.style import STYLES


def main() -> None:
    parser = argparse.ArgumentParser(prog="umo_train.performer", description=__doc__)
    parser.add_argument("corpus", type=Path, help="folder with speech/*.npz")
    parser.add_argument("--style", nargs="+", default=["neutral", "explaining"], choices=list(STYLES))
    parser.add_argument("--most", type=int, default=10, help="items to perform")
    parser.add_argument("--animations", type=Path, help="folder for the takes, each as STYLE-ITEM.jsonl")
    parser.add_argument("--clips", type=Path, nargs="+", help="glTF files: writes each action as NAME.jsonl too")
    options = parser.parse_args()
    paths = corpus.paths(options.corpus, "speech")[: options.most]
    if not paths:
        parser.error(f"no speech in {options.corpus}")
    if options.animations:
        options.animations.mkdir(parents=True, exist_ok=True)
    if options.clips:
        if not options.animations:
            parser.error("--clips needs --animations")
        found = actions.read_clips(options.clips)
        for seed, (name, action) in enumerate(actions.ACTIONS.items()):
            _, motion = actions.act(action, found, 10.0, seed)
            animation.write(options.animations / f"{name.replace(' ', '-')}.jsonl", motion)
    columns = {}
    for style in options.style:
        takes = []
        for path in paths:
            item = corpus.read_item(path)
            motion = perform(item.utterance, STYLES[style], item.seed)
            takes.append(Take(motion, listen(item.utterance)))
            if options.animations:
                animation.write(options.animations / f"{style}-{item.name}.jsonl", motion)
        columns[style] = measure(takes)
    print("| measure | " + " | ".join(columns) + " |")
    print("| --- |" + " --- |" * len(columns))
    for name in columns[options.style[0]]:
        print(f"| {name} | " + " | ".join(f"{column[name]:.3g}" for column in columns.values()) + " |")


if __name__ == "__main__":
    main()
