"""A contact sheet for visual inspection: one recording as a strip of poses and faces over its waveform."""

from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from umo_train.metrics.figure import INK, LEFT, RIGHT, draw_body, draw_face
from umo_train.metrics.item import Item, Motion
from umo_train.metrics.lips import envelope
from umo_train.metrics.motion import joint_places
from umo_train.performer.lips import lip_opening
from umo_train.skeleton import JOINT, PARENTS, rotations
from umo_train.speech.utterance import FRAME_RATE

WIDTH_IN, MARGIN_IN = 16.0, 0.35
# Distance between two poses' centres; two figures with half-open arms do not touch.
STEP_M = 1.08
HEIGHT_M = 1.86
ROWS_IN = {"front": 2.5, "aside": 2.5, "face": 1.45, "wave": 1.7}
ASIDE = np.radians(-40)


def _head(local: np.ndarray) -> np.ndarray:
    """World matrices of the head, `[T, 3, 3]`."""
    chain, joint = [], JOINT["head"]
    while joint >= 0:
        chain.append(joint)
        joint = PARENTS[joint]
    out = np.tile(np.eye(3), (len(local), 1, 1))
    for joint in reversed(chain):
        out = out @ local[:, joint]
    return out


def draw(item: Item, motion: Motion, title: str = "", poses: int = 12, aside: bool = True) -> Figure:
    """Front view, three-quarter view unless `aside` is false, faces, and the waveform with the mouth's opening.

    Poses are equally spaced; each stands over its time in the waveform.
    """
    frames = len(motion["face"])
    at, head = joint_places(motion), _head(rotations(motion))
    shown = ((np.arange(poses) + 0.5) / poses * frames).astype(int).clip(0, frames - 1)
    rows = {name: size for name, size in ROWS_IN.items() if aside or name != "aside"}
    height = sum(rows.values()) + 0.75
    figure = Figure((WIDTH_IN, height), facecolor="white")
    inner = WIDTH_IN - 2 * MARGIN_IN
    scale = inner / (poses * STEP_M)
    top = height - 0.42
    axes = {}
    for name, size in rows.items():
        top -= size
        axes[name] = figure.add_axes((MARGIN_IN / WIDTH_IN, top / height, inner / WIDTH_IN, size / height * 0.97))
        if name != "wave":
            axes[name].axis("off")
    for name, turn in (("front", 0.0), ("aside", ASIDE)):
        if name in rows:
            axes[name].set(xlim=(0, poses * STEP_M), ylim=(-0.06, rows[name] * 0.97 / scale - 0.06))
            for number, frame in enumerate(shown):
                draw_body(axes[name], at[frame], head[frame], (number + 0.5) * STEP_M, turn, 72 * scale)
    units = inner / (rows["face"] * 0.97) * 2.3
    axes["face"].set(xlim=(0, units), ylim=(-1.25, 1.05))
    for number, frame in enumerate(shown):
        draw_face(axes["face"], motion["face"][frame, 6:], (number + 0.5) * units / poses, 0.98)
    _wave(axes["wave"], item, motion, shown)
    figure.text(
        MARGIN_IN / WIDTH_IN, 1 - 0.3 / height, title or item.name, fontsize=13, color=INK, weight="bold", va="center"
    )
    note = f"{item.seconds:.1f} s, {frames} frames"
    figure.text(1 - MARGIN_IN / WIDTH_IN, 1 - 0.3 / height, note, fontsize=10, color="#7b8794", va="center", ha="right")
    return figure


def _wave(axes: matplotlib.axes.Axes, item: Item, motion: Motion, shown: np.ndarray) -> None:
    """Waveform, its smoothed envelope and the mouth's opening, each with its own scale."""
    opening = lip_opening(motion["face"])
    sound = envelope(item.samples, len(opening))
    bins = np.array_split(np.asarray(item.samples), min(1600, len(item.samples)))
    time = np.linspace(0, item.seconds, len(bins))
    peak = max(float(np.abs(item.samples).max()), 1e-6)
    low, high = (np.array([f(piece) for piece in bins]) / peak for f in (np.min, np.max))
    axes.fill_between(time, low, high, color="#cfd6dd", lw=0, zorder=1)
    frames = np.arange(len(opening)) / FRAME_RATE
    axes.plot(frames, sound / max(sound.max(), 1e-6), color=RIGHT, lw=1.3, label="envelope of the speech", zorder=2)
    # A nearly still mouth must not look as if it moved.
    axes.plot(frames, opening / max(opening.max(), 0.25), color=LEFT, lw=1.8, label="opening of the mouth", zorder=3)
    for frame in shown:
        axes.axvline(frame / FRAME_RATE, color="#98a3ad", lw=0.7, ls=(0, (2, 3)), zorder=0)
    axes.set(xlim=(0, item.seconds), ylim=(-1.05, 1.12), yticks=[])
    axes.tick_params(colors="#7b8794", labelsize=9, length=2)
    axes.xaxis.set_major_formatter("{x:g} s")
    for side, spine in axes.spines.items():
        spine.set_visible(side == "bottom")
        spine.set_color("#c3cad1")
    axes.legend(loc="lower right", fontsize=9, frameon=False, ncols=2, labelcolor=INK)


def save(item: Item, motion: Motion, path: Path, title: str = "", dots_per_inch: int = 110) -> None:
    draw(item, motion, title).savefig(path, dpi=dots_per_inch)
