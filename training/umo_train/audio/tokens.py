"""Audio tokens of a corpus: clean, and as other microphones and rooms give them."""

import itertools
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors.torch import load_file, save_file
from tqdm import tqdm

from umo_train.audio.mel import Mel
from umo_train.audio.units import kmeans, nearest
from umo_train.data import corpus
from umo_train.speech.variation import recorded


@dataclass
class Tokenizer:
    """Samples at 16 kHz to units, 50 a second."""

    mel: Mel
    centroids: torch.Tensor

    def __call__(self, samples: np.ndarray) -> np.ndarray:
        features = self.mel.features(torch.from_numpy(np.ascontiguousarray(samples, np.float32)))
        return nearest(features, self.centroids).numpy().astype(np.int16)

    def save(self, path: Path) -> None:
        save_file(self.mel.tensors() | {"audio.kmeans.centroids": self.centroids}, path)

    @staticmethod
    def load(path: Path, plan: dict[str, Any]) -> "Tokenizer":
        tensors = load_file(path)
        mel = Mel(**plan["mel"])
        mel.load(tensors)
        return Tokenizer(mel, tensors["audio.kmeans.centroids"])


def fit(folder: Path, out: Path, plan: dict[str, Any], seed: int) -> Tokenizer:
    """Clusters every item's features, as one recording or another. Done already where `out` exists."""
    if out.exists():
        return Tokenizer.load(out, plan)
    mel = Mel(**plan["mel"])
    rows = []
    # A part of the corpus holds every voice.
    for item in tqdm(itertools.islice(corpus.items(folder, "train"), 0, None, plan["every"]), "features"):
        rng = np.random.default_rng((seed, int(item.name)))
        samples = item.utterance.samples if rng.random() < 0.3 else recorded(item.utterance.samples, rng)
        # A third of the windows: neighbours say the same.
        rows.append(mel.features(torch.from_numpy(samples))[int(rng.integers(3)) :: 3])
    features = torch.cat(rows)
    mel.fit(features, plan["delta_weight"])
    features = (features - mel.mean) * mel.scale
    tokenizer = Tokenizer(mel, kmeans(features, plan["units"], plan["steps"], seed))
    out.parent.mkdir(parents=True, exist_ok=True)
    tokenizer.save(out)
    return tokenizer


def tokenize(folder: Path, out: Path, tokenizer: Tokenizer, recordings: int, workers: int) -> None:
    """Writes `out/NAME.npy`: `[1 + recordings, tokens]`, the clean one first."""
    out.mkdir(parents=True, exist_ok=True)
    paths = sorted((folder / "speech").glob("?????.npz"))
    jobs = [(p, out / f"{p.stem}.npy", tokenizer, recordings) for p in paths if not (out / f"{p.stem}.npy").exists()]
    with ProcessPoolExecutor(workers) as pool:
        list(tqdm(pool.map(_tokenize_item, jobs, chunksize=8), "audio tokens", len(jobs), unit="item"))


def _tokenize_item(job: tuple[Path, Path, Tokenizer, int]) -> None:
    path, out, tokenizer, recordings = job
    torch.set_num_threads(1)
    samples = corpus.read_item(path).utterance.samples
    versions = [samples]
    for i in range(recordings):
        versions.append(recorded(samples, np.random.default_rng((int(path.stem), i))))
    tokens = np.stack([tokenizer(version) for version in versions])
    part = out.with_suffix(".part")
    with part.open("wb") as file:
        np.save(file, tokens)
    part.rename(out)
