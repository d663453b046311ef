"""The step `mouth`: examples, training, and the part of the model file."""

import zlib
from collections import defaultdict
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tqdm import tqdm

from umo_train.data import corpus
from umo_train.mouth import captured, part
from umo_train.mouth import examples as made
from umo_train.mouth.examples import Example
from umo_train.mouth.features import Front, sizes_of
from umo_train.mouth.recordings import read
from umo_train.mouth.train import MouthPlan, train
from umo_train.plan import Run
from umo_train.skeleton import ARKIT
from umo_train.speech.utterance import SAMPLE_RATE, Utterance
from umo_train.speech.voices import Espeak, Line

# espeak-ng's variants and pitches, which speak `umo_train/speech/more_languages.txt` by turns.
_SPEAKERS = (("", 0.9), ("f2", 1.05), ("m3", 1.15), ("f4", 0.95), ("m7", 1.0), ("f5", 1.1), ("", 1.3))
# Length of clips without speech, seconds.
_UNSPOKEN_S = 8.0
# Length of pieces of captured takes, seconds, and the speeds at which they are played.
_PIECE_S = 10.0
_SPEEDS = (0.85, 1.2)


def make(s: Run) -> None:
    """`run/mouth.safetensors`, from the corpus and from recordings, if the plan names any."""
    plan, out = s.plan["mouth"], s.folder / "mouth.safetensors"
    if out.exists():
        return
    s.folder.mkdir(parents=True, exist_ok=True)
    front = Front(sizes_of(plan["features"]))
    names, rest = _channels(s)
    begin = part.read(s.work / plan["begin"])[1] if "begin" in plan else None
    network = train(
        MouthPlan(**plan["training"], network=plan["network"], seed=s.plan["seed"]),
        front,
        _examples(s, front, [ARKIT.index(name) for name in names], rest),
        names,
        rest,
        s.folder,
        begin,
    )
    tensors = network.tensors(torch.bfloat16) | front.tensors() | {"mouth.rest": torch.from_numpy(rest).float()}
    part.write(out, {**plan["features"], **plan["network"], "channels": names}, tensors)


def _channels(s: Run) -> tuple[list[str], np.ndarray]:
    """Names of the channels moved by speech, and their rest values."""
    items = [item for item, _ in zip(_spoken(s), range(8), strict=False)]
    faces = [made.targets(item.utterance) for item in items]
    names = made.moved(faces)
    silence = np.zeros(2 * SAMPLE_RATE, np.float32)
    still = made.targets(Utterance("", "", silence, (corpus.Phone("pau", 0.0, 2.0),)))
    return names, still[30, [ARKIT.index(name) for name in names]].astype(np.float32)


def _spoken(s: Run) -> Iterator[corpus.Item]:
    every = s.plan["mouth"].get("every", 1)
    return (item for i, item in enumerate(corpus.items(s.corpus, "train")) if i % every == 0)


def _examples(s: Run, front: Front, channels: list[int], rest: np.ndarray) -> list[Example]:
    """Made once: `run/mouth_examples.pt`."""
    path = s.folder / "mouth_examples.pt"
    if not path.exists():
        jobs = list(_jobs(s, front, channels, rest))
        with ProcessPoolExecutor(s.plan["workers"]) as pool:
            found = list(tqdm(pool.map(_arrays, jobs, chunksize=4), "mouth examples", len(jobs), unit="clip"))
        torch.save([tuple(map(torch.from_numpy, arrays)) for arrays in found], path)
    return [Example(*tensors) for tensors in torch.load(path, weights_only=True)]


def _jobs(s: Run, front: Front, channels: list[int], rest: np.ndarray) -> Iterator[tuple[Any, ...]]:
    plan = s.plan["mouth"]
    shared = (front, channels, rest)
    versions = range(plan["versions"])
    paths = corpus.paths(s.corpus, "speech")
    trained = {entry.name for entry in corpus.entries(s.corpus, "train")}
    told = [path for path in paths if path.stem in trained][:: plan.get("every", 1)]
    for name in plan.get("aligned", ()):
        told += _found(corpus.paths(_folder(s, name), "speech"), s, name)
    untold = [path for name in plan.get("untold", ()) for path in _found(_sounds(_folder(s, name)), s, name)]
    for kind, files in (("spoken", told), ("untold", untold)):
        for i, path in enumerate(files):
            for version in versions:
                yield kind, path, (s.plan["seed"], i, version, kind == "untold"), *shared
    for i, utterance in enumerate(_foreign(plan.get("foreign", 0))):
        yield "spoken", utterance, (s.plan["seed"], i, 0, 4), *shared
    for kind, version, capture in _captures(s):
        yield kind, capture, (s.plan["seed"], version, zlib.crc32(capture.name.encode()), 3), *shared
    for i in range(round(plan["unspoken_hours"] * 3600 / _UNSPOKEN_S)):
        yield "unspoken", None, (s.plan["seed"], i, 0, 2), *shared


def _foreign(speakers: int) -> Iterator[Utterance]:
    """Sentences of further languages, each by this many speakers."""
    languages: dict[str, list[str]] = defaultdict(list)
    for line in (resources.files("umo_train.speech") / "more_languages.txt").read_text("utf-8").splitlines():
        if not line.startswith("#"):
            language, text = line.split("\t")
            languages[language].append(text)
    for i, (language, texts) in enumerate(languages.items()):
        for j in range(speakers):
            variant, pitch = _SPEAKERS[(i + j) % len(_SPEAKERS)]
            lines = [Line(text, pitch=pitch * (1.0 + 0.03 * j)) for text in texts]
            yield from Espeak(language, variant).speak(lines)


def _captures(s: Run) -> Iterator[tuple[str, int, captured.Capture]]:
    """Captures of the plan with their kind and number of the version."""
    for entry in s.plan["mouth"].get("captured", ()):
        folder, kind = _folder(s, entry["name"]), entry["kind"]
        _found([path for path in [folder] if path.is_dir()], s, entry["name"])
        found = captured.landmarks(folder) if kind == "landmarks" else captured.weights(folder, entry["takes"])
        used = found[: len(found) - entry.get("validation", 0)]
        for capture in (piece for one in used for piece in one.pieces(_PIECE_S)):
            for version in range(entry["versions"]):
                yield kind, version, capture


def _folder(s: Run, name: str) -> Path:
    return s.work / "recordings" / name


def _sounds(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.suffix in (".opus", ".flac", ".wav", ".ogg"))


def _found(paths: list[Path], s: Run, name: str) -> list[Path]:
    if not paths:
        folder = _folder(s, name)
        raise FileNotFoundError(f"no recordings in {folder}: see training/README.md, or take {name} out of the plan")
    return paths


def _arrays(job: tuple[Any, ...]) -> list[np.ndarray]:
    """An example's arrays: each tensor would hold a file open on its way from the process."""
    return [tensor.numpy() for tensor in vars(_example(job)).values()]


def _example(job: tuple[str, Any, tuple[int, ...], Front, list[int], np.ndarray]) -> Example:
    kind, path, seed, front, channels, rest = job
    torch.set_num_threads(1)
    rng = np.random.default_rng(seed)
    if kind == "spoken":
        utterance = path if isinstance(path, Utterance) else corpus.read_item(path).utterance
        # Silence before speech, so that it starts at every state of the level control.
        before = np.zeros(int(rng.uniform(0.0, 0.5) * SAMPLE_RATE), np.float32)
        return made.spoken(front, _later(utterance, before), channels, rng)
    if kind in ("landmarks", "weights"):
        # The size of the speaker's head, and the speed; a quarter as it is.
        speed = 1.0 if rng.random() < 0.25 else float(rng.uniform(*_SPEEDS))
        return made.captured(kind, front, path.faster(speed), channels, rest, rng)
    if kind == "untold":
        return made.untold(front, read(path), rest, rng)
    return made.unspoken(front, _UNSPOKEN_S, rest, rng)


def _later(utterance: Utterance, before: np.ndarray) -> Utterance:
    """The utterance after some silence; words are left out, as they are not needed."""
    seconds = len(before) / SAMPLE_RATE
    phones = [replace(p, start=p.start + seconds, end=p.end + seconds) for p in utterance.phones]
    if phones[0].name == "pau":
        phones[0] = replace(phones[0], start=0.0)
    elif seconds:
        phones.insert(0, corpus.Phone("pau", 0.0, seconds))
    return replace(utterance, samples=np.concatenate([before, utterance.samples]), phones=tuple(phones), words=())
