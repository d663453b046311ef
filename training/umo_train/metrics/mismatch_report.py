"""Tables of `mismatch`: the share of right speech found, and measures of other people's protocols on the same takes."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from umo_train import markdown
from umo_train.metrics import beat, genea
from umo_train.metrics.mismatch import WHOLE, Tried
from umo_train.metrics.takes import VIEWS, Take
from umo_train.speech.utterance import FRAME_RATE

DRAWS = 4000


@dataclass(frozen=True)
class Mean:
    """A weighted mean and its 95 % interval, a bootstrap over groups: speakers, or recordings."""

    value: float
    low: float
    high: float

    def said(self, scale: float = 1.0, form: str = ".2f") -> str:
        value, low, high = (format(scale * number, form) for number in (self.value, self.low, self.high))
        return f"{value} ({low}–{high})"


def mean(values: np.ndarray, groups: Sequence[str], seed: int, weights: np.ndarray | None = None) -> Mean:
    names, index = np.unique(groups, return_inverse=True)
    weights = np.ones(len(values)) if weights is None else weights
    sums, counts = np.bincount(index, weights * values), np.bincount(index, weights)
    drawn = np.random.default_rng(seed).integers(len(names), size=(DRAWS, len(names)))
    low, high = np.percentile(sums[drawn].sum(1) / counts[drawn].sum(1), [2.5, 97.5])
    return Mean(float(sums.sum() / counts.sum()), float(low), float(high))


def finds(tried: Tried, seed: int) -> dict[str, Any]:
    """Shares of pairs whose right speech was found, by judge and view; a tie is half a find."""

    def shares(margins: Mapping[str, np.ndarray]) -> dict[str, Mean]:
        return {
            view: mean(np.where(values == 0, 0.5, values > 0), tried.groups, seed) for view, values in margins.items()
        }

    return {
        "pairs": len(tried.groups),
        "groups": len(set(tried.groups)),
        "network": shares(tried.networks),
        "plain": shares(tried.plain),
    }


def protocols(takes: Sequence[Take], seed: int) -> dict[str, Mean]:
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
    ("beat alignment, onsets to motion", "alignment_to_motion", ".3f"),
    ("motion to onsets", "alignment_to_audio", ".3f"),
    ("L1 diversity, m", "l1_diversity", ".2f"),
    ("variance of the pose, rad²", "pose_variance", ".4f"),
    ("BC", "bc", ".3f"),
    ("its turns a second", "bc_turns", ".2f"),
    ("BC over shifted audio", "bc_ratio", ".3f"),
    ("Smooth-BC", "smooth_bc", ".3f"),
    ("its turns a second", "smooth_bc_turns", ".2f"),
    ("Smooth-BC over shifted audio", "smooth_bc_ratio", ".3f"),
)


def text(rows: Mapping[str, dict[str, Any]]) -> str:
    """Both tables in Markdown. A row has the `finds` of a subject, and its `protocols` if it has a body."""

    def share(judge: str, view: str) -> Callable[[dict[str, Any]], str]:
        return lambda row: row[judge][view].said(100, ".1f") if view in row[judge] else "–"

    names = {WHOLE: "whole", "body": "body without face", "face": "face alone"}
    columns = [(names[view], share("network", view)) for view in (WHOLE, *VIEWS)]
    columns += [(f"plain judge: {view}", share("plain", view)) for view in VIEWS]
    columns += [("pairs", lambda row: str(row["pairs"])), ("speakers or recordings", lambda row: str(row["groups"]))]
    out = "Right speech found, % of pairs (95 %), chance 50:\n\n" + markdown.table(columns, rows)
    bodies = {name: row for name, row in rows.items() if "protocols" in row}

    def measure(name: str, form: str) -> Callable[[dict[str, Any]], str]:
        return lambda row: row["protocols"][name].said(1, form)

    if bodies:
        columns = [(heading, measure(name, form)) for heading, name, form in _MEASURES]
        out += "\nGENEA's definitions on other audio, BC and Smooth-BC (95 %):\n\n" + markdown.table(columns, bodies)
    return out


def write(folder: Path, rows: Mapping[str, dict[str, Any]], about: Mapping[str, Any]) -> None:
    """`mismatch.json` and `mismatch.md`."""
    folder.mkdir(parents=True, exist_ok=True)
    found = {"about": about, "subjects": rows}
    (folder / "mismatch.json").write_text(json.dumps(found, indent=1, default=asdict) + "\n")
    (folder / "mismatch.md").write_text(text(rows))
