"""Curves of a run: a figure for each stage's log, and one of the use of experts."""

import csv
import re
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("Agg")
from matplotlib import pyplot
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

# Contents of a log: name to steps and values.
Curves = dict[str, tuple[np.ndarray, np.ndarray]]

# Panels of a figure: title, names of the curves, and whether the scale is logarithmic.
_PANELS = (
    ("Cross-entropy", re.compile(r"loss_.*|held_out_loss|entropy"), False),
    ("Accuracy", re.compile(r"accuracy(_.*)?|held_out_(?!copied_|loss).*"), False),
    ("Accuracy of saying the last keyframe again", re.compile(r"held_out_copied_.*"), False),
    ("Codes in use (perplexity)", re.compile(r"perplexity"), False),
    ("Errors", re.compile(r"error|velocity|acceleration|sparse|commitment|drift"), True),
)
_EXPERTS = re.compile(r"(top1|used)_layer(\d+)")
_COLORS = ("#3b6fb6", "#d1622b", "#3f9142", "#8a5aa8", "#b23a48", "#6b6b6b", "#c79a1b", "#2a9d9d", "#9c6b4f")


def read(path: Path) -> Curves:
    """Reads a log written by `umo_train.log`."""
    rows: dict[str, list[tuple[float, float]]] = defaultdict(list)
    with path.open(newline="") as file:
        for row in csv.DictReader(file):
            rows[row["name"]].append((float(row["step"]), float(row["value"])))
    return {name: (np.array(points)[:, 0], np.array(points)[:, 1]) for name, points in rows.items()}


def draw(run: Path, out: Path) -> list[Path]:
    """Draws a PNG for each log in the run's folder, and `experts.png` if the model is sparse; returns the written
    files.
    """
    logs = {path.stem: read(path) for path in sorted(run.glob("*.csv"))}
    logs = {name: curves for name, curves in logs.items() if curves}
    if not logs:
        raise FileNotFoundError(f"{run}: no log (*.csv) with a row")
    out.mkdir(parents=True, exist_ok=True)
    written = []
    for name, curves in logs.items():
        written.append(_save(_stage(name, curves), out / f"{name}.png"))
    sparse = {name: curves for name, curves in logs.items() if any(_EXPERTS.fullmatch(n) for n in curves)}
    if sparse:
        written.append(_save(_experts(sparse), out / "experts.png"))
    return written


def _save(figure: Figure, path: Path) -> Path:
    figure.savefig(path, dpi=130)
    pyplot.close(figure)
    return path


def _stage(title: str, curves: Curves) -> Figure:
    panels = []
    for name, pattern, logarithmic in _PANELS:
        names = [curve for curve in curves if pattern.fullmatch(curve)]
        if names:
            panels.append((name, names, logarithmic))
    known = {curve for _, names, _ in panels for curve in names}
    rest = [curve for curve in curves if curve not in known and not _EXPERTS.fullmatch(curve)]
    if rest:
        panels.append(("Other", rest, False))
    figure, axes = pyplot.subplots(
        1, len(panels), figsize=(5.6 * len(panels), 3.6), squeeze=False, layout="constrained"
    )
    for axis, (name, names, logarithmic) in zip(axes[0], panels, strict=True):
        _panel(axis, name, {curve: curves[curve] for curve in sorted(names)}, logarithmic=logarithmic)
    figure.suptitle(title.replace("_", " "), x=0.01, ha="left", fontweight="bold")
    return figure


def _panel(axis: Axes, title: str, curves: Curves, *, logarithmic: bool) -> None:
    for color, (name, (steps, values)) in zip(_cycled(len(curves)), curves.items(), strict=True):
        held_out = name.startswith("held_out")
        if logarithmic:
            # Terms are zero while they are switched off.
            steps, values = steps[values > 0], values[values > 0]
        smooth = values if held_out else _smoothed(values)
        if smooth is not values:
            axis.plot(steps, values, color=color, linewidth=0.6, alpha=0.25)
        mark = {"marker": "o", "markersize": 3, "linestyle": "--"} if held_out else {}
        if len(steps) == 1:
            mark = {"marker": "o", "markersize": 4}
        axis.plot(steps, smooth, color=color, linewidth=1.6, label=name.replace("_", " "), **mark)
    _plain(axis, title)
    if logarithmic:
        axis.set_yscale("log")
    axis.legend(frameon=False, fontsize=8, loc="upper left", bbox_to_anchor=(1.0, 1.0), borderaxespad=0)


def _cycled(count: int) -> Iterable[str]:
    return (_COLORS[i % len(_COLORS)] for i in range(count))


def _plain(axis: Axes, title: str) -> None:
    axis.set_title(title, loc="left", fontsize=10)
    axis.set_xlabel("step", fontsize=9)
    axis.set_xlim(left=0)
    axis.xaxis.set_major_locator(MaxNLocator(6, integer=True))
    axis.spines[["top", "right"]].set_visible(False)
    axis.grid(axis="y", color="0.9", linewidth=0.8)
    axis.tick_params(labelsize=8)


def _smoothed(values: np.ndarray) -> np.ndarray:
    """A running mean over a thirtieth of the curve, shorter at its ends."""
    reach = len(values) // 60
    if reach == 0:
        return values
    sums = np.concatenate([[0.0], values.cumsum()])
    place = np.arange(len(values))
    low, high = np.maximum(place - reach, 0), np.minimum(place + reach + 1, len(values))
    return (sums[high] - sums[low]) / (high - low)


def _experts(logs: dict[str, Curves]) -> Figure:
    """Per stage and layer over time: the most used expert's share of rows, and the share of experts in use."""
    figure, axes = pyplot.subplots(
        len(logs), 2, figsize=(10.4, 0.8 + 2.6 * len(logs)), squeeze=False, layout="constrained"
    )
    titles = {"top1": "rows at the most used expert", "used": "experts in use"}
    for row, (stage, curves) in zip(axes, logs.items(), strict=True):
        for axis, (kind, title) in zip(row, titles.items(), strict=True):
            layers = sorted(
                int(match[2]) for match in map(_EXPERTS.fullmatch, curves) if match is not None and match[1] == kind
            )
            steps = curves[f"{kind}_layer{layers[0]}"][0]
            values = np.stack([curves[f"{kind}_layer{layer}"][1] for layer in layers])
            edges = np.concatenate([[0.0], steps])
            colors = axis.pcolormesh(edges, np.arange(len(layers) + 1) - 0.5, values, vmin=0, vmax=1, cmap="viridis")
            _plain(axis, f"{stage.replace('_', ' ')}: {title}")
            axis.grid(visible=False)
            axis.set_yticks(range(len(layers)), [str(layer) for layer in layers])
            axis.set_ylabel("layer, encoder first", fontsize=9)
            figure.colorbar(colors, ax=axis, format="{x:.0%}").ax.tick_params(labelsize=8)
    return figure
