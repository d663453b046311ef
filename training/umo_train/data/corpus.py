"""The corpus of the default model: synthetic speech and the performer's motion to it, one file of each per item."""

import json
import random
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from tqdm import tqdm

from umo_train.performer.style import STYLES, draw
from umo_train.shard import ALL, Shard
from umo_train.skeleton import PARTS
from umo_train.speech import variation, voices
from umo_train.speech.sentences import sentence
from umo_train.speech.utterance import SAMPLE_RATE, Phone, Utterance, Word


@dataclass(frozen=True)
class Item:
    """The item's utterance, style, and split."""

    name: str
    split: str
    style: str
    prompt: str
    seed: int
    utterance: Utterance


@dataclass(frozen=True)
class SpeechPlan:
    """`hours` of speech by `voices`, name to weight; `held_out` voices speak only in the split `test_voice`."""

    hours: float
    voices: dict[str, float]
    held_out: tuple[str, ...]
    test_minutes: float = 6.0
    seconds_per_item: float = 24.0
    seed: int = 0


def make_speech(plan: SpeechPlan, folder: Path, workers: int, shard: Shard = ALL) -> None:
    """Synthesises missing items of the plan, or of a share of it. Depends only on the plan, not on existing files."""
    (folder / "speech").mkdir(parents=True, exist_ok=True)
    names = list(plan.voices)
    train = round(plan.hours * 3600 / plan.seconds_per_item)
    test = max(2, round(plan.test_minutes * 60 / plan.seconds_per_item))
    jobs: list[tuple[SpeechPlan, Path, str, int, str]] = []
    for index in range(train + test):
        split = "train" if index < train else "test_sentence"
        voice = random.Random(f"{plan.seed} {index}").choices(names, list(plan.voices.values()))[0]
        jobs.append((plan, folder, split, index, voice))
    for index in range(train + test, train + 2 * test):
        jobs.append((plan, folder, "test_voice", index, plan.held_out[index % len(plan.held_out)]))
    missing = [job for job in jobs if shard.has(job[3]) and not _path(folder, "speech", job[3]).exists()]
    with ProcessPoolExecutor(workers) as pool:
        list(tqdm(pool.map(_speak_item, missing, chunksize=4), "speech", len(missing), unit="item"))


def _path(folder: Path, kind: str, index: int) -> Path:
    return folder / kind / f"{index:05}.npz"


def _speak_item(job: tuple[SpeechPlan, Path, str, int, str]) -> None:
    plan, folder, split, index, voice = job
    # Sentences of the test splits use seeds that training never sees.
    chance = random.Random(f"{plan.seed} {split} {index}")
    stretch, pitch = chance.uniform(0.85, 1.25), chance.uniform(0.85, 1.2)
    style, prompt = draw(chance)
    factor = 1.0 if split == "test_voice" or chance.random() < 0.35 else chance.uniform(0.86, 1.2)
    count = max(2, round(plan.seconds_per_item / 3.3))
    lines = [voices.Line(sentence(chance), stretch * chance.uniform(0.95, 1.05), pitch) for _ in range(count)]
    spoken = [variation.faster(u, factor) for u in voices.find(voice).speak(lines)]
    # Mostly breaths between sentences, sometimes a silence long enough for idle motion.
    gaps = [chance.uniform(0.0, 0.5) if chance.random() < 0.8 else chance.uniform(0.8, 3.0) for _ in spoken]
    utterance = variation.joined(spoken, [*gaps, chance.uniform(0.3, 1.5)])
    levelled = replace(utterance, voice=voice, samples=variation.leveled(utterance.samples, 24))
    write_item(folder, Item(f"{index:05}", split, style, prompt, index, levelled))


def write_item(folder: Path, item: Item) -> None:
    """Writes an item's speech. An item without speech has no samples."""
    spoken = item.utterance
    about = {
        "voice": spoken.voice,
        "split": item.split,
        "text": spoken.text,
        "style": item.style,
        "prompt": item.prompt,
        "seed": item.seed,
    }
    if not len(spoken.samples):
        about["spoken"] = False
    data = {
        "samples": int16(spoken.samples),
        "phones": np.array([p.name for p in spoken.phones], str),
        "phone_times": np.array([(p.start, p.end) for p in spoken.phones]).reshape(-1, 2),
        "stress": np.array([p.stress for p in spoken.phones], np.int8),
        "words": np.array([w.text for w in spoken.words], str),
        "word_times": np.array([(w.start, w.end) for w in spoken.words]).reshape(-1, 2),
        "about": np.array(json.dumps(about)),
    }
    write(folder / "speech" / f"{item.name}.npz", data)


def int16(samples: np.ndarray) -> np.ndarray:
    return np.clip(samples * 32767, -32767, 32767).astype(np.int16)


def write(path: Path, data: dict[str, np.ndarray]) -> None:
    """Atomic by renaming: an existing file is complete."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".tmp.npz")
    np.savez(part, **data)
    part.rename(path)


def write_array(path: Path, values: np.ndarray) -> None:
    """Atomic by renaming: an existing file is complete."""
    part = path.with_suffix(".part")
    with part.open("wb") as file:
        np.save(file, values)
    part.rename(path)


def read_item(path: Path) -> Item:
    with np.load(path) as data:
        about = json.loads(str(data["about"]))
        phones = tuple(
            Phone(str(name), float(start), float(end), int(stress))
            for name, (start, end), stress in zip(data["phones"], data["phone_times"], data["stress"], strict=True)
        )
        words = tuple(
            Word(str(text), float(start), float(end))
            for text, (start, end) in zip(data["words"], data["word_times"], strict=True)
        )
        samples = data["samples"].astype(np.float32) / 32767
    utterance = Utterance(about["voice"], about["text"], samples, phones, words)
    return Item(path.stem, about["split"], about["style"], about["prompt"], about["seed"], utterance)


def paths(folder: Path, kind: str) -> list[Path]:
    """Files of all items, in order of their numbers."""
    found = [path for path in (folder / kind).glob("*.npz") if path.stem.isdecimal()]
    return sorted(found, key=lambda path: int(path.stem))


def read_voices(path: Path) -> list[np.ndarray]:
    """An item's words spoken by other voices at the same times, if available, with as many samples as its own."""
    voices = path.parent.parent / "voices" / path.name
    if not voices.exists():
        return []
    with np.load(voices) as data:
        return [data[name].astype(np.float32) / 32767 for name in sorted(data.files)]


# Prefix of voices that are people's.
PEOPLE = "people/"


@dataclass(frozen=True)
class Entry:
    """An item without its sound."""

    name: str
    split: str
    style: str
    prompt: str
    text: str
    words: tuple[Word, ...]
    # Whether it has speech; if not, there is only body motion.
    spoken: bool
    voice: str

    @property
    def person(self) -> bool:
        """Whether a recorded person speaks instead of a synthesiser."""
        return self.voice.startswith(PEOPLE)

    @property
    def listens(self) -> bool:
        """Whether the voice belongs to the interlocutor."""
        return self.style in STYLES and STYLES[self.style].listens


def entries(folder: Path, split: str | None = None) -> Iterator[Entry]:
    """Entries of one split or of all, in order."""
    for path in paths(folder, "speech"):
        with np.load(path) as data:
            about = json.loads(str(data["about"]))
            if split is not None and about["split"] != split:
                continue
            times = zip(data["words"], data["word_times"], strict=True)
            words = tuple(Word(str(text), float(start), float(end)) for text, (start, end) in times)
        spoken = about.get("spoken", True)
        said = (about["split"], about["style"], about["prompt"], about["text"])
        yield Entry(path.stem, *said, words, spoken, about["voice"])


def with_motion(folder: Path, split: str, *, spoken: bool) -> list[str]:
    """Names of a split's items that have a motion, and speech if asked."""
    made = {path.stem for path in paths(folder, "motion")}
    return [entry.name for entry in entries(folder, split) if entry.name in made and (entry.spoken or not spoken)]


def items(folder: Path, split: str | None = None) -> Iterator[Item]:
    """The corpus' speech in order, of one split or of all."""
    for path in paths(folder, "speech"):
        item = read_item(path)
        if split is None or item.split == split:
            yield item


# First item number of actions, above people's.
FIRST_ACTION = 80_000


@dataclass(frozen=True)
class ActionPlan:
    """`clips`: glTF files with the clips named in `performer.actions`; each action has `takes` items, of which every
    tenth is held out."""

    clips: tuple[Path, ...]
    takes: int = 16
    seconds_per_item: float = 14.0
    seed: int = 0


def make_actions(plan: ActionPlan, folder: Path, workers: int, shard: Shard = ALL) -> None:
    """Writes missing items of the plan, or of a share of it: silence, and the motion. Depends only on the plan and the
    clips."""
    from umo_train.performer.actions import ACTIONS

    names = [(name, take) for name in ACTIONS for take in range(plan.takes)]
    jobs = [(plan, folder, FIRST_ACTION + k, name, take) for k, (name, take) in enumerate(names)]
    missing = [job for job in jobs if shard.has(job[2]) and not _path(folder, "motion", job[2]).exists()]
    with ProcessPoolExecutor(workers) as pool:
        list(tqdm(pool.map(_act_item, missing, chunksize=8), "actions", len(missing), unit="item"))


def _act_item(job: tuple[ActionPlan, Path, int, str, int]) -> None:
    from umo_train.performer.actions import ACTIONS, act

    plan, folder, index, name, take = job
    action, split = ACTIONS[name], "test_action" if take % 10 == 9 else "train"
    seed = 1_000_000 * plan.seed + index
    silence, motion = act(action, _clips(plan.clips), plan.seconds_per_item, seed)
    write_item(folder, Item(f"{index:05}", split, f"action {name}", "\n".join(action.prompts), seed, silence))
    _write_motion(_path(folder, "motion", index), motion)


@lru_cache(1)
def _clips(files: tuple[Path, ...]) -> dict[str, np.ndarray]:
    from umo_train.performer.actions import read_clips

    return read_clips(list(files))


@dataclass(frozen=True)
class HeardAccents:
    """Accents according to a model's audio units, at `rate` a second: runs of at least `least` units from `first` up,
    `delay` units after the onset. `folder` has an item's units as `NAME.npy` `[recordings, n]`, the clean ones
    first."""

    folder: Path
    first: int
    delay: int
    rate: int
    # Shorter runs are mostly stressed syllables of words without an accent.
    least: int = 4

    def of(self, name: str) -> np.ndarray:
        """Seconds of an item's accents."""
        marked = np.load(self.folder / f"{name}.npy")[0] >= self.first
        edges = np.flatnonzero(np.diff(np.r_[False, marked, False].astype(int))).reshape(-1, 2)
        # The middle of a run follows the onset by the units' delay.
        runs = [(first + last) / 2 for first, last in edges if last - first >= self.least]
        return (np.array(runs) - self.delay) / self.rate


def make_motion(
    folder: Path, workers: int, shard: Shard = ALL, heard: HeardAccents | None = None, seeds: int = 0
) -> None:
    """Lets the performer animate every item without motion, or those of a share. Training items use the accents
    `heard`, if given, and the item's seed with `seeds`; held-out items keep the true accents and their seed."""
    mine = [path for path in paths(folder, "speech") if shard.has(int(path.stem))]
    jobs = [(folder, path, heard, seeds) for path in mine if not (folder / "motion" / path.name).exists()]
    with ProcessPoolExecutor(workers) as pool:
        list(tqdm(pool.map(_perform_item, jobs, chunksize=4), "motion", len(jobs), unit="item"))


def _perform_item(job: tuple[Path, Path, HeardAccents | None, int]) -> None:
    from umo_train.performer import perform

    folder, path, heard, seeds = job
    item = read_item(path)
    learned = item.split == "train"
    accents = heard.of(path.stem) if heard is not None and learned else None
    motion = perform(item.utterance, STYLES[item.style], item.seed + (seeds if learned else 0), accents)
    _write_motion(folder / "motion" / path.name, motion)


def _write_motion(path: Path, motion: dict[str, np.ndarray]) -> None:
    floats = {name: values.astype(np.float32) for name, values in motion.items() if name != "intent"}
    write(path, floats | {"intent": motion["intent"]})


def read_motion(folder: Path, name: str, only: tuple[str, ...] = (*PARTS, "height")) -> dict[str, np.ndarray]:
    """`[T, C]` f32 of each part, and `height` `[T]`, metres; or some of these."""
    with np.load(folder / "motion" / f"{name}.npz") as data:
        return {part: data[part] for part in only}


def read_intent(folder: Path, name: str) -> np.ndarray:
    """Intent of the performer's arms, `[T]` codes of `performer.intent`.

    Raises `ValueError` if the motion has none.
    """
    path = folder / "motion" / f"{name}.npz"
    with np.load(path) as data:
        if "intent" not in data:
            raise ValueError(f"{path} has no `intent`: remove it and run the step `motion` again")
        return data["intent"]


def hours(folder: Path) -> float:
    return sum(len(item.utterance.samples) for item in items(folder)) / SAMPLE_RATE / 3600
