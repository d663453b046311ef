"""The report's pictures, each as SVG text to embed in a page."""

import io
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from umo_train.metrics.figure import INK, LEFT, RIGHT
from umo_train.metrics.item import Motion
from umo_train.metrics.lips import envelope
from umo_train.metrics.measure import Made
from umo_train.metrics.motion import joint_speed
from umo_train.performer.lips import lip_opening
from umo_train.speech.utterance import FRAME_RATE

GREY = "#98a3ad"


def _svg(draw: Callable[[Axes], None], width: float, height: float) -> str:
    figure = Figure((width, height), layout="constrained")
    axes = figure.add_subplot()
    axes.tick_params(colors="#62707d", labelsize=8, length=2)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color("#c3cad1")
    draw(axes)
    axes.xaxis.label.set(size=9, color=INK)
    axes.yaxis.label.set(size=9, color=INK)
    out = io.StringIO()
    # Without date and random ids: the same numbers give the same page.
    figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None})
    text = out.getvalue()
    return text[text.index("<svg") :]


def mouth_over_wave(made: Made) -> str:
    """Waveform, its envelope, and the mouth of the model and, if known, of the performer."""
    item, opening = made.item, lip_opening(made.motion["face"])

    def draw(axes: Axes) -> None:
        pieces = np.array_split(np.asarray(item.samples), min(1200, len(item.samples)))
        peak = max(float(np.abs(item.samples).max()), 1e-6)
        time = np.linspace(0, item.seconds, len(pieces))
        axes.fill_between(
            time, [p.min() / peak for p in pieces], [p.max() / peak for p in pieces], color="#d7dde3", lw=0
        )
        sound = envelope(item.samples, len(opening))
        frames = np.arange(len(opening)) / FRAME_RATE
        axes.plot(frames, sound / max(sound.max(), 1e-6), color=GREY, lw=1, label="envelope")
        if item.motion is not None:
            given = lip_opening(item.motion["face"])
            axes.plot(np.arange(len(given)) / FRAME_RATE, given, color=RIGHT, lw=1.2, label="performer's mouth")
        axes.plot(frames, opening, color=LEFT, lw=1.4, label="model's mouth")
        axes.set(xlim=(0, item.seconds), ylim=(-1, 1.05), yticks=[0, 1], xlabel="seconds")
        axes.legend(fontsize=8, frameon=False, ncols=3, loc="lower right")

    return _svg(draw, 10, 2)


def lags(speakers: Mapping[str, Any]) -> str:
    """Correlation of mouth and envelope by lag, a line per speaker."""

    def draw(axes: Axes) -> None:
        for number, (name, found) in enumerate(speakers.items()):
            by_lag = {int(lag): value for lag, value in found["by_lag"].items()}
            shade = 0.25 + 0.6 * number / max(len(speakers) - 1, 1)
            axes.plot(
                list(by_lag), list(by_lag.values()), "o-", ms=3, lw=1.2, color=(0.1, shade * 0.7, shade), label=name
            )
        axes.axhline(0.5, color=LEFT, lw=1, ls="--")
        axes.set(xlabel="frames by which the mouth is late", ylabel="correlation", xticks=list(by_lag))
        axes.legend(fontsize=7, frameon=False, loc="center left", bbox_to_anchor=(1, 0.5))

    return _svg(draw, 5, 2.8)


def histogram(rows: Mapping[str, np.ndarray], what: str) -> str:
    """Shares of values, the first row filled."""
    edges = np.linspace(0, max(float(np.quantile(v, 0.995)) for v in rows.values()) + 1e-6, 40)

    def draw(axes: Axes) -> None:
        for (name, values), colour in zip(rows.items(), (LEFT, RIGHT), strict=False):
            shares = np.histogram(values, edges)[0] / len(values)
            axes.stairs(
                shares,
                edges,
                color=colour,
                fill=colour == LEFT,
                alpha=0.75 if colour == LEFT else 1,
                lw=1.4,
                label=name,
            )
        axes.set(xlabel=what, ylabel="share of frames", yscale="log")
        axes.legend(fontsize=8, frameon=False)

    return _svg(draw, 5, 2.6)


def mouth_histogram(model: Sequence[Motion], performer: Sequence[Motion]) -> str:
    rows = {"model": model, "performer": performer}
    return histogram(
        {k: np.concatenate([lip_opening(m["face"]) for m in v]) for k, v in rows.items() if v}, "opening of the mouth"
    )


def speed_histogram(model: Sequence[Motion], performer: Sequence[Motion]) -> str:
    rows = {"model": model, "performer": performer}
    return histogram(
        {k: np.concatenate([joint_speed(m) for m in v]) for k, v in rows.items() if v},
        "mean speed of the upper body, m/s",
    )


def shares(rows: Mapping[str, Sequence[float]]) -> str:
    """Stacked bars, one row each: first choices of experts."""

    def draw(axes: Axes) -> None:
        names = list(rows)
        table = np.array([rows[name] for name in names])
        left = np.zeros(len(names))
        for expert in range(table.shape[1]):
            shade = 0.85 - 0.65 * expert / max(table.shape[1] - 1, 1)
            axes.barh(
                names, table[:, expert], left=left, color=(shade * 0.75, shade * 0.9, shade), edgecolor="white", lw=0.6
            )
            left += table[:, expert]
        axes.axvline(1 / table.shape[1], color=LEFT, lw=0.8, ls=":")
        axes.invert_yaxis()
        axes.set(xlim=(0, 1), xlabel="share of rows that go to each expert first")

    return _svg(draw, 5, 0.9 + 0.28 * len(rows))


def bars(rows: Mapping[str, float], what: str, mark: float | None = None) -> str:
    """Horizontal bars with their values, and a reference mark."""

    def draw(axes: Axes) -> None:
        found = axes.barh(list(rows), list(rows.values()), color=RIGHT, height=0.6)
        axes.bar_label(found, fmt="%.3g", fontsize=8, padding=3, color=INK)
        if mark is not None:
            axes.axvline(mark, color=LEFT, lw=1, ls="--")
        axes.invert_yaxis()
        axes.margins(x=0.15)
        axes.set(xlabel=what)

    return _svg(draw, 5, 0.9 + 0.32 * len(rows))
