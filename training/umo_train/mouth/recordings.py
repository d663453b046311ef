"""Recorded voices with phone times, found by pocketsphinx, whose English model and dictionary are free.

    python -m umo_train.mouth.recordings FOLDER --out WORK/corpus/recordings

`FOLDER/text.csv` has `name|text`, `FOLDER/NAME.EXTENSION` the sound. Clips with words missing in the dictionary, or
with a text that does not match, are left out.
"""

import argparse
import csv
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import soundfile
from scipy.signal import resample_poly
from tqdm import tqdm

from umo_train.data.corpus import Item, write_item
from umo_train.people.accents import accented
from umo_train.people.align import from_text
from umo_train.speech.utterance import SAMPLE_RATE
from umo_train.speech.variation import leveled


def read(path: Path) -> np.ndarray:
    """Samples at 16 kHz, mono."""
    samples, rate = soundfile.read(path, dtype="float32", always_2d=True)
    return resample_poly(samples.mean(1), SAMPLE_RATE, rate).astype(np.float32)


def _align_clip(job: tuple[Path, str, str, Path, int]) -> float:
    path, text, voice, out, index = job
    target = out / "speech" / f"{index:05}.npz"
    if not target.exists():
        utterance = from_text(leveled(read(path), 24), text)
        if utterance is None:
            return 0.0
        write_item(out, Item(f"{index:05}", "train", "neutral", "", index, accented(replace(utterance, voice=voice))))
    return 1.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="recordings and text.csv")
    parser.add_argument("--out", type=Path, required=True, help="corpus to write")
    parser.add_argument("--every", type=int, default=1, help="take every n-th clip (default: all)")
    parser.add_argument("--workers", type=int, default=1)
    options = parser.parse_args()
    sounds = {path.stem: path for path in options.folder.iterdir() if path.suffix != ".csv"}
    with (options.folder / "text.csv").open() as file:
        rows = [row for row in csv.reader(file, delimiter="|", quoting=csv.QUOTE_NONE) if row and row[0] in sounds]
    jobs = [
        (sounds[name], text, options.folder.name, options.out, index)
        for index, (name, text, *_) in enumerate(rows)
        if index % options.every == 0
    ]
    with ProcessPoolExecutor(options.workers) as pool:
        aligned = sum(tqdm(pool.map(_align_clip, jobs), "aligned", len(jobs), unit="clip"))
    print(f"{aligned:.0f} of {len(jobs)} clips")


if __name__ == "__main__":
    main()
