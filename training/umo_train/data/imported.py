"""Third-party data sets in the corpus' layout: an item per clip, or per described span of a clip."""

import csv
import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from umo_train.data import corpus
from umo_train.data.amass import amass
from umo_train.data.beat2 import beat2
from umo_train.data.clip import Clip, DataError, file
from umo_train.data.humanml3d import Described, humanml3d, motion_name
from umo_train.data.librispeech import librispeech
from umo_train.speech.utterance import FRAME_RATE, Utterance
from umo_train.speech.variation import leveled

Plan = dict[str, Any]
# Loudness of all speech in decibels below full scale, as in the default model.
_LEVEL = 24


@dataclass(frozen=True)
class Source:
    """One part of a data set: its name, its split in the corpus, and its clips."""

    name: str
    split: str
    clips: Iterator[tuple[Clip, tuple[str, ...]]]


def import_clips(plan: Plan, root: Path, folder: Path, coefficients: int) -> None:
    """Writes every clip of the plan's data sets, whose folders are below `root`. An interrupted import restarts with
    the current part of a data set; existing items are overwritten with the same contents."""
    done_file = folder / "imported.json"
    done: dict[str, int] = json.loads(done_file.read_text()) if done_file.exists() else {}
    first = 0
    for source in _sources(plan, root, coefficients):
        if source.name in done:
            first += done[source.name]
            continue
        count = 0
        for clip, sentences in tqdm(source.clips, source.name, unit="clip"):
            if _seconds(clip) >= plan["least_seconds"]:
                _write(folder, f"{first + count:05}", source.split, clip, sentences)
                count += 1
        first += count
        done[source.name] = count
        done_file.write_text(json.dumps(done, indent=1))


def _sources(plan: Plan, root: Path, coefficients: int) -> Iterator[Source]:
    """Sources in the plan's order. Readers check their folders on creation."""
    if (beat := plan.get("beat2")) is not None:
        speakers = set(beat["speakers"]) if beat.get("speakers") else None
        prompts = _prompts(root / beat["prompts"]) if beat.get("prompts") else {}
        for split, theirs in beat["splits"].items():
            for one in theirs:
                clips = ((clip, prompts.get(clip.name, ())) for clip in beat2(root / beat["root"], one, speakers))
                yield Source(f"beat2 {one}", split, clips)
    if (motion := plan.get("amass")) is not None:
        described = humanml3d(root / motion["humanml3d"]) if motion.get("humanml3d") else {}
        spans = (span for clip in amass(root / motion["root"], coefficients) for span in _spans(clip, described))
        yield Source("amass", "train", spans)
    if (read := plan.get("librispeech")) is not None:
        yield Source("librispeech", "train", ((clip, ()) for clip in librispeech(root / read["root"])))


def _prompts(path: Path) -> dict[str, tuple[str, ...]]:
    """Columns `id` and `text` of a CSV; several lines with one id are several prompts."""
    out: dict[str, tuple[str, ...]] = {}
    with file(path, "columns id and text: a prompt for each clip").open(newline="", encoding="utf-8-sig") as lines:
        rows = csv.DictReader(lines)
        if not {"id", "text"} <= set(rows.fieldnames or ()):
            raise DataError(f"{path}: expected columns id and text, got {', '.join(rows.fieldnames or ()) or 'none'}")
        for row in rows:
            out[row["id"]] = (*out.get(row["id"], ()), row["text"])
    return out


def _spans(clip: Clip, described: dict[str, list[Described]]) -> Iterator[tuple[Clip, tuple[str, ...]]]:
    """The described spans of a motion, or all of it if there are none."""
    found = described.get(motion_name(clip.name), [])
    for i, span in enumerate(found):
        frames = slice(round(span.start * FRAME_RATE), round(span.end * FRAME_RATE))
        motion = {part: values[frames] for part, values in clip.motion.items()}
        cut = replace(clip, name=f"{clip.name} {i}", motion=motion, translation=clip.translation[frames])
        yield cut, span.sentences
    if not found:
        yield clip, ()


def _seconds(clip: Clip) -> float:
    return len(clip.translation) / FRAME_RATE if clip.speech is None else clip.speech.seconds


def _write(folder: Path, name: str, split: str, clip: Clip, sentences: tuple[str, ...]) -> None:
    speech = clip.speech or Utterance(clip.speaker, "", np.zeros(0, np.float32), ())
    if len(speech.samples):
        speech = replace(speech, samples=leveled(speech.samples, _LEVEL))
    # Several prompts of one item are the lines of its prompt.
    item = corpus.Item(name, split, "", "\n".join(sentences), int(name), speech)
    if clip.motion is not None:
        height = clip.translation[:, 1].astype(np.float32)
        corpus.write(folder / "motion" / f"{name}.npz", clip.motion | {"height": height})
    corpus.write_item(folder, item)
