"""Audio tokens of a corpus: clean, and with other microphones and rooms."""

import itertools
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors.torch import load_file, save_file
from tqdm import tqdm

from umo_train.audio import hubert, listener, mel, units
from umo_train.audio.hubert import HubertTokenizer
from umo_train.audio.mel import Mel
from umo_train.audio.units import kmeans, nearest
from umo_train.data import corpus
from umo_train.device import best
from umo_train.speech.variation import recorded

Plan = dict[str, Any]
_CENTROIDS = "audio.kmeans.centroids"
# Written by the step `start`: the audio tensors of a published model.
PUBLISHED = "published_audio.safetensors"


@dataclass
class Tokenizer:
    """Samples at 16 kHz to units, 50 a second."""

    mel: Mel
    centroids: torch.Tensor

    def __call__(self, samples: np.ndarray) -> np.ndarray:
        features = self.mel.features(torch.from_numpy(np.ascontiguousarray(samples, np.float32)))
        return nearest(features, self.centroids).numpy().astype(np.int16)

    def tensors(self) -> dict[str, torch.Tensor]:
        """Tensors as in the model file."""
        return self.mel.tensors() | {_CENTROIDS: self.centroids}

    def save(self, path: Path) -> None:
        save_file(self.tensors(), path)

    @staticmethod
    def load(path: Path, plan: Plan) -> "Tokenizer":
        tensors = load_file(path)
        mel = Mel(**plan["mel"])
        mel.load(tensors)
        return Tokenizer(mel, tensors[_CENTROIDS])


AnyTokenizer = Tokenizer | HubertTokenizer


def load(path: Path, plan: Plan) -> AnyTokenizer:
    """Loads the result of `fit`. A plan's `hubert` is the folder of Hugging Face's HuBERT."""
    if plan["kind"] == "hubert":
        return HubertTokenizer.load(path, Path(plan["hubert"]), plan)
    return Tokenizer.load(path, plan)


def fit(folder: Path, out: Path, plan: Plan, seed: int) -> AnyTokenizer:
    """Clusters features of the corpus, or uses published clusters, including those of a published listener without
    further training. Skipped if `out` exists."""
    if not out.exists():
        before = out.parent / PUBLISHED
        if before.exists() and plan.get("listener", {}).get("steps") == 0:
            tokenizer: AnyTokenizer = load(before, plan)
        elif plan["kind"] == "hubert":
            tokenizer = _fit_hubert(folder, plan, seed)
        else:
            tokenizer = _fit_mel(folder, plan, seed, _published(before) if before.exists() else None)
        out.parent.mkdir(parents=True, exist_ok=True)
        tokenizer.save(out)
    return load(out, plan)


def _heard(folder: Path, plan: Plan, seed: int) -> Iterator[tuple[np.ndarray, slice]]:
    """Training items, in a random recording each, and the features to use."""
    # Part of the corpus contains every voice.
    for item in tqdm(itertools.islice(_spoken(folder), 0, None, plan["every"]), "features"):
        rng = np.random.default_rng((seed, int(item.name)))
        samples = item.utterance.samples if rng.random() < 0.3 else recorded(item.utterance.samples, rng)
        # A third of the windows: neighbours are similar.
        yield samples, slice(int(rng.integers(3)), None, 3)


def _spoken(folder: Path) -> Iterator[corpus.Item]:
    return (item for item in corpus.items(folder, "train") if len(item.utterance.samples))


def _fit_hubert(folder: Path, plan: Plan, seed: int) -> HubertTokenizer:
    network = Path(plan["hubert"])
    if plan.get("kmeans"):
        from umo_train.convert import kmeans as published

        config = {"audio": model_config(plan)}
        return HubertTokenizer(network, plan, published.convert(Path(plan["kmeans"]), config)[_CENTROIDS])
    front = hubert.reader(network, plan)
    features = torch.cat([front.features(heard[None])[0, some] for heard, some in _heard(folder, plan, seed)])
    return HubertTokenizer(network, plan, kmeans(features, plan["units"], plan["steps"], seed, best()))


def _published(path: Path) -> tuple[torch.Tensor, torch.Tensor, listener.Listener | None]:
    """Mean and scale of a published model's mel features, and its listener."""
    tensors = load_file(path)
    network = listener.Listener.of(tensors) if "audio.mel.network.0.weight" in tensors else None
    return tensors["audio.mel.mean"], tensors["audio.mel.scale"], network


def _fit_mel(
    folder: Path,
    plan: Plan,
    seed: int,
    published: tuple[torch.Tensor, torch.Tensor, listener.Listener | None] | None = None,
) -> Tokenizer:
    front = Mel(**plan["mel"])
    before = None
    features = torch.zeros(0)
    if published is not None and front.network is not None:
        front.mean, front.scale, before = published
    else:
        features = torch.cat([front.bands(torch.from_numpy(heard))[some] for heard, some in _heard(folder, plan, seed)])
        front.fit(features, plan["delta_weight"])
        features = (features - front.mean) * front.scale
    if front.network is not None:
        items = _listened(folder, front, plan, seed)
        steps = plan["listener"]["steps"]
        front.network = listener.train(items, front.silence, front.voices, front.sizes["network"], steps, seed, before)
        with torch.no_grad():
            heard = (front.network.heard(item.features.float(), front.silence) for item in items)
            features = torch.cat([some[::3] for some in heard])
        if plan["listener"].get("onset_delay") is not None:
            wanted = torch.cat([item.wanted[::3, -1] for item in items]) / listener.ONSET
            return Tokenizer(front, _with_onsets(features, wanted, plan, seed))
    return Tokenizer(front, kmeans(features, plan["units"], plan["steps"], seed))


def _with_onsets(features: torch.Tensor, wanted: torch.Tensor, plan: Plan, seed: int) -> torch.Tensor:
    """Centroids in two versions: without the onset of an accent and with it. The threshold is the value with the most
    information about the onsets `wanted` `[n]`, 0 to 1."""
    centroids = kmeans(features[:, :-1].contiguous(), plan["units"] // 2, plan["steps"], seed)
    edge = units.telling_edge(features[:, -1], wanted > 0.5)
    sides = (torch.full((len(centroids), 1), edge + side) for side in (-0.5, 0.5))
    return torch.cat([torch.cat([centroids, side], 1) for side in sides])


def _listened(folder: Path, front: Mel, plan: Plan, seed: int) -> list[listener.Heard]:
    """Training data of the listener: every `every`-th training item, clean and as one recording."""
    about = plan["listener"]
    # A listening avatar's mouth does not depend on the voice.
    entries = [entry for entry in corpus.entries(folder, "train") if entry.spoken and not entry.listens]
    names = [entry.name for entry in entries][:: about["every"]]
    paths = [path for path in corpus.paths(folder, "speech") if path.stem in set(names)]
    shapes = listener.Shapes.of([corpus.read_motion(folder, path.stem, ("face",))["face"] for path in paths])
    delays = about["delay"], about.get("onset_delay")
    jobs = [(folder, path, front, shapes, delays, seed) for path in paths]
    with ProcessPoolExecutor() as pool:
        heard = tqdm(pool.map(_listen, jobs, chunksize=8), "listening", len(jobs), unit="item")
        return [listener.Heard(*map(torch.from_numpy, pair)) for pairs in heard for pair in pairs]


def _listen(
    job: tuple[Path, Path, Mel, listener.Shapes, tuple[int, int | None], int],
) -> list[tuple[np.ndarray, np.ndarray]]:
    folder, path, front, shapes, delays, seed = job
    torch.set_num_threads(1)
    utterance = corpus.read_item(path).utterance
    face = corpus.read_motion(folder, path.stem, ("face",))["face"]
    out = []
    for samples in (utterance.samples, recorded(utterance.samples, np.random.default_rng((seed, int(path.stem), 9)))):
        rows = front.bands(torch.from_numpy(np.ascontiguousarray(samples, np.float32)))
        wanted = shapes.wanted(face, utterance.phones, len(rows), *delays)
        out.append((rows.half().numpy(), wanted))
    return out


def model_config(plan: Plan) -> dict[str, Any]:
    """`config.audio` of the model file."""
    if plan["kind"] == "hubert":
        return hubert.model_config(Path(plan["hubert"]), plan)
    config = mel.model_config(Mel(**plan["mel"]), plan["units"])
    delay = plan.get("listener", {}).get("onset_delay")
    # The second half of the centroids are those with the onset of an accent.
    return config if delay is None else config | {"accents": {"first": plan["units"] // 2, "delay": delay}}


def tokenize(folder: Path, out: Path, tokenizer: AnyTokenizer, recordings: int, workers: int) -> None:
    """Writes `out/NAME.npy`: `[1 + recordings + voices, tokens]`, the clean one first."""
    out.mkdir(parents=True, exist_ok=True)
    jobs = [(path, out / f"{path.stem}.npy", recordings) for path in corpus.paths(folder, "speech")]
    jobs = [job for job in jobs if not job[1].exists()]
    with ProcessPoolExecutor(workers) as pool:
        if isinstance(tokenizer, Tokenizer):
            made = pool.map(_tokenize_item, [(tokenizer, *job) for job in jobs], chunksize=8)
            list(tqdm(made, "audio tokens", len(jobs), unit="item"))
            return
        # One process runs the network; the others prepare its input a few items ahead.
        ahead = 8 * workers
        for first in tqdm(range(0, len(jobs), ahead), "audio tokens", unit=f"{ahead} items"):
            some = jobs[first : first + ahead]
            for (_, target, _), versions in zip(some, pool.map(_versions, some), strict=True):
                if versions.shape[1]:
                    corpus.write_array(target, tokenizer.many(versions))


def _versions(job: tuple[Path, Path, int]) -> np.ndarray:
    """`[1 + recordings + voices, n]` samples of an item."""
    path, _, recordings = job
    samples = corpus.read_item(path).utterance.samples
    versions = [samples]
    if len(samples):
        versions += [recorded(samples, np.random.default_rng((int(path.stem), i))) for i in range(recordings)]
    return np.stack([*versions, *corpus.read_voices(path)])


def _tokenize_item(job: tuple[Tokenizer, Path, Path, int]) -> None:
    tokenizer, path, out, recordings = job
    torch.set_num_threads(1)
    versions = _versions((path, out, recordings))
    if versions.shape[1]:
        corpus.write_array(out, np.stack([tokenizer(version) for version in versions]))
