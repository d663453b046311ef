"""The step `people`: people's recordings as items of the corpus, in addition to synthetic speech."""

import json
import random
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import Any

from tqdm import tqdm

from umo_train.data import corpus, recording
from umo_train.people import align
from umo_train.people.accents import accented
from umo_train.people.recordings import Recording, recordings
from umo_train.performer.style import draw
from umo_train.speech import variation
from umo_train.speech.utterance import Utterance

# First item number of people, above those of `speech`.
FIRST = 50_000
# Split of held-out readers: every tenth of each set.
HELD_OUT, _EVERY = "test_people", 10
# Loudness in decibels below full scale, as for all speech of the corpus.
_LEVEL = 24


@dataclass(frozen=True)
class PeoplePlan:
    """`sets`: folders below `root` with their language, as named by espeak-ng. Recordings of one reader are joined to
    items of `seconds_per_item`, each performed `takes` times in different styles."""

    root: Path
    sets: dict[str, str]
    seconds_per_item: float = 16.0
    takes: int = 1
    seed: int = 0


@dataclass(frozen=True)
class _Job:
    plan: PeoplePlan
    folder: Path
    split: str
    # Number of the first take.
    first: int
    language: str
    recordings: tuple[Recording, ...]


def make_people(plan: PeoplePlan, folder: Path, workers: int) -> None:
    """Writes missing items of the plan. Recordings without detected phones are left out and counted in `people.json`,
    with the hours of each set. Depends only on the plan and the recordings."""
    jobs = list(_jobs(plan, folder))
    done_file = folder / "people.json"
    done: dict[str, Any] = json.loads(done_file.read_text()) if done_file.exists() else {}
    missing = [job for job in jobs if str(job.first) not in done]
    with ProcessPoolExecutor(workers) as pool:
        for job, count in zip(
            missing, tqdm(pool.map(_make, missing), "people", len(missing), unit="item"), strict=True
        ):
            done[str(job.first)] = {"recordings": len(job.recordings), "found": count}
            done_file.write_text(json.dumps(done))


def _jobs(plan: PeoplePlan, folder: Path) -> Iterator[_Job]:
    first = FIRST
    for name, language in plan.sets.items():
        by_reader = groupby(recordings(plan.root / name), lambda one: one.reader)
        for number, (_, its) in enumerate((reader, list(its)) for reader, its in by_reader):
            split = HELD_OUT if number % _EVERY == _EVERY - 1 else "train"
            for group in _groups(its, plan.seconds_per_item):
                yield _Job(plan, folder, split, first, language, group)
                first += plan.takes


def _groups(its: list[Recording], seconds: float) -> Iterator[tuple[Recording, ...]]:
    import soundfile

    group: list[Recording] = []
    length = 0.0
    for one in its:
        group.append(one)
        length += soundfile.info(one.path).duration
        if length >= seconds:
            yield tuple(group)
            group, length = [], 0.0
    if group:
        yield tuple(group)


def _make(job: _Job) -> int:
    """Writes an item's takes; returns the number of its recordings with phones."""
    spoken: list[Utterance] = []
    for one in job.recordings:
        samples = variation.leveled(recording.samples(one.path), _LEVEL)
        found = align.phones(samples, one.text, job.language)
        if found is not None:
            spoken.append(accented(replace(found, voice=corpus.PEOPLE + one.reader)))
    if not spoken:
        return 0
    for take in range(job.plan.takes if job.split == "train" else 1):
        index = job.first + take
        chance = random.Random(f"{job.plan.seed} people {index}")
        # Readers pause naturally at sentence ends; sometimes add a longer silence for listening.
        gaps = [chance.uniform(0.0, 0.3) if chance.random() < 0.85 else chance.uniform(0.8, 3.0) for _ in spoken]
        utterance = variation.joined(spoken, [*gaps, chance.uniform(0.3, 1.5)])
        style, prompt = draw(chance)
        corpus.write_item(job.folder, corpus.Item(f"{index:05}", job.split, style, prompt, index, utterance))
    return len(spoken)


def hours(folder: Path) -> dict[str, float]:
    """Hours in the split `train`: people's, synthesisers', and actions without speech."""
    out: Counter[str] = Counter(people=0.0, synthesisers=0.0)
    for item in corpus.items(folder, "train"):
        kind = "people" if item.utterance.voice.startswith(corpus.PEOPLE) else "synthesisers"
        kind = "actions" if item.style.startswith("action ") else kind
        out[kind] += item.utterance.seconds / 3600
    return dict(out)
