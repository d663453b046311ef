"""Tables of `mismatch`: the share of right speech found, and measures of other people's protocols on the same takes."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from umo_train import markdown
from umo_train.metrics import beat, genea, words
from umo_train.metrics.interval import Estimate
from umo_train.metrics.interval import grouped_mean as mean
from umo_train.metrics.mismatch import WHOLE, Tried
from umo_train.metrics.takes import VIEWS, Take
from umo_train.speech.utterance import FRAME_RATE


def finds(tried: Tried, seed: int) -> dict[str, Any]:
    """Shares of pairs whose right speech was found, by judge and view; a tie is half a find."""

    def shares(margins: Mapping[str, np.ndarray]) -> dict[str, Estimate]:
        return {
            view: mean(np.where(values == 0, 0.5, values > 0), tried.groups, seed) for view, values in margins.items()
        }

    read = {}
    if tried.words is not None:
        found, recordings = tried.words
        share = mean(np.where(found == 0, 0.5, found > 0), recordings, seed)
        read = {"words": share, "clips": len(recordings)}
    return read | {
        "pairs": len(tried.groups),
        "groups": len(set(tried.groups)),
        "network": shares(tried.networks),
        "plain": shares(tried.plain),
    }


def protocols(takes: Sequence[Take], seed: int) -> dict[str, Estimate]:
    """GENEA's beat alignment and diversity, beat constancy and Smooth-BC, means over takes and intervals over them."""
    names = [take.name for take in takes]
    frames = np.array([len(take.motion["face"]) for take in takes], np.float64)
    aligned, inner = genea.beat_alignment([(take.samples, take.motion) for take in takes])
    out = {
        "alignment_to_motion": mean(aligned[:, 0], names, seed, inner),
        "alignment_to_audio": mean(aligned[:, 1], names, seed, inner),
        "l1_diversity": mean(np.array([genea.l1_diversity(take.motion) for take in takes]), names, seed, frames),
        "pose_variance": mean(np.array([genea.pose_variance(take.motion) for take in takes]), names, seed),
    }
    onsets = [beat.onsets(take.samples) for take in takes]
    turns: dict[str, Callable] = {"bc": beat.turning_points, "smooth_bc": beat.smooth_turning_points}
    for name, points in turns.items():
        kept = [points(take.motion) for take in takes]
        rows = list(zip(onsets, kept, frames / FRAME_RATE, strict=True))
        own = np.array([[b.own, b.shifted] for b in (beat.beat([row]) for row in rows)])
        weights = np.array([len(events) for events in onsets], np.float64)
        out[name] = mean(own[:, 0], names, seed, weights)
        # A mean of ratios weighted by their divisors is the ratio of the sums.
        ratio = np.divide(own[:, 0], own[:, 1], out=np.zeros(len(own)), where=own[:, 1] > 0)
        out[f"{name}_ratio"] = mean(ratio, names, seed, weights * own[:, 1])
        out[f"{name}_turns"] = mean(FRAME_RATE * np.array(list(map(len, kept))) / frames, names, seed, frames)
    return out


_MEASURES = (
    ("beat alignment, onsets to motion", "alignment_to_motion", 3),
    ("motion to onsets", "alignment_to_audio", 3),
    ("L1 diversity, m", "l1_diversity", 2),
    ("variance of the pose, rad²", "pose_variance", 4),
    ("BC", "bc", 3),
    ("its turns a second", "bc_turns", 2),
    ("BC over shifted audio", "bc_ratio", 3),
    ("Smooth-BC", "smooth_bc", 3),
    ("its turns a second", "smooth_bc_turns", 2),
    ("Smooth-BC over shifted audio", "smooth_bc_ratio", 3),
)


def text(rows: Mapping[str, dict[str, Any]]) -> str:
    """Both tables in Markdown. A row has the `finds` of a subject, and its `protocols` if it has a body."""

    def share(judge: str, view: str) -> Callable[[dict[str, Any]], str]:
        return lambda row: row[judge][view].text(1, 100) if view in row[judge] else "–"

    names = {WHOLE: "whole", "body": "body without face", "face": "face alone"}
    columns = [(names[view], share("network", view)) for view in (WHOLE, *VIEWS)]
    columns += [(f"plain judge: {view}", share("plain", view)) for view in VIEWS]
    columns += [("pairs", lambda row: str(row["pairs"])), ("speakers or recordings", lambda row: str(row["groups"]))]
    out = "Right speech found, % of pairs (95 %), chance 50:\n\n" + markdown.table(columns, rows)
    read = {name: row for name, row in rows.items() if "words" in row}
    if read:
        columns = [("body without face", lambda row: row["words"].text(1, 100))]
        columns += [("clips", lambda row: str(row["clips"])), ("recordings", lambda row: str(row["words"].count))]
        out += f"\nRight words found, % of clips of {words.CLIP_S:.0f} s (95 %), chance 50:\n\n" + markdown.table(
            columns, read
        )
    bodies = {name: row for name, row in rows.items() if "protocols" in row}

    def measure(name: str, places: int) -> Callable[[dict[str, Any]], str]:
        return lambda row: row["protocols"][name].text(places)

    if bodies:
        columns = [(heading, measure(name, places)) for heading, name, places in _MEASURES]
        out += "\nGENEA's definitions on other audio, BC and Smooth-BC (95 %):\n\n" + markdown.table(columns, bodies)
    return out


def write(folder: Path, rows: Mapping[str, dict[str, Any]], about: Mapping[str, Any]) -> None:
    """`mismatch.json` and `mismatch.md`."""
    folder.mkdir(parents=True, exist_ok=True)
    found = {"about": about, "subjects": rows}
    (folder / "mismatch.json").write_text(json.dumps(found, indent=1, default=asdict) + "\n")
    (folder / "mismatch.md").write_text(text(rows))
