"""Quality of motion through the tokenizers of layout `frames`: beats, wrists, head, jerk and planted feet, level by
level.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch

from umo_train.frames import parts
from umo_train.frames.networks import ResidualVqVae
from umo_train.frames.parts import Part
from umo_train.frames.root import rooted
from umo_train.frames.tokenizers import decoded, encode
from umo_train.metrics import beat
from umo_train.metrics.item import Item, Motion
from umo_train.metrics.motion import foot_slide, joint_places
from umo_train.motion.networks import RootNetwork
from umo_train.skeleton import CONTACT, JOINT, PARENTS, VELOCITY, rotations
from umo_train.speech.utterance import FRAME_RATE

WRISTS = (JOINT["left_wrist"], JOINT["right_wrist"])


@dataclass(frozen=True)
class Row:
    """One setting of the tokenizers, over all items. Errors are relative to the performer: means, and for wrists also
    the 95th percentile; `jerk` is the 95th percentile of the faster wrist's."""

    name: str
    beats: float
    wrists_cm: float
    wrists_95_cm: float
    head_deg: float
    jerk_m_s3: float
    slide_cm_s: float
    face: float


@dataclass(frozen=True)
class Bar:
    """A bar for a value of a row: a minimum with `least`, else a maximum."""

    name: str
    limit: float
    least: bool = False

    def met(self, row: Row, before: Row) -> bool:
        value = self.value(row, before)
        return value >= self.limit if self.least else value <= self.limit

    def value(self, row: Row, before: Row) -> float:
        return row.jerk_m_s3 / before.jerk_m_s3 if self.name == "jerk" else float(getattr(row, self.name))


BARS = (
    Bar("beats", 1.45, least=True),
    Bar("wrists_cm", 1.5),
    Bar("head_deg", 0.4),
    Bar("jerk", 1.3),
    Bar("slide_cm_s", 0.3),
)


def through(
    motion: Motion,
    models: dict[str, ResidualVqVae],
    order: Sequence[Part],
    face: list[str],
    levels: int | None = None,
    stride: int = 1,
) -> dict[str, np.ndarray]:
    """Motion decoded from the first levels' codes, or from the vectors of every `stride`-th frame with linear
    interpolation. Codes of all levels, part after part."""
    out = {region: np.array(motion[region], np.float32) for region in ("face", "hands", "upper", "lower")}
    codes, _ = encode(order, models, out, face)
    for part in order:
        if part.moves:
            region, at = parts.columns(part, face)
            out[region][:, at] = decoded(models[part.name], codes[part.name], levels, stride)
    return out


@torch.no_grad()
def walked(motion: dict[str, np.ndarray], root: RootNetwork) -> dict[str, np.ndarray]:
    """The motion with the root network's velocity, as in the engine."""
    lower = motion["lower"].copy()
    device = next(root.parameters()).device
    lower[:, VELOCITY] = root(rooted(torch.from_numpy(lower)[None].to(device)))[0, :, VELOCITY].cpu().numpy()
    return {**motion, "lower": lower}


def heads(motion: Motion) -> np.ndarray:
    """World rotations of the head `[T, 3, 3]`."""
    local = rotations(dict(motion))
    joint, out = JOINT["head"], local[:, JOINT["head"]]
    while (joint := PARENTS[joint]) >= 0:
        out = local[:, joint] @ out
    return out


def turned_deg(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Angles between rotations `[T, 3, 3]`, degrees. By the chord: near 0, an arc cosine loses all digits."""
    chord = np.linalg.norm((one - other).reshape(len(one), -1), axis=1) / np.sqrt(8.0)
    return np.degrees(2.0 * np.arcsin(np.clip(chord, 0.0, 1.0)))


def row(name: str, items: Sequence[Item], motions: Sequence[Motion], slides: Sequence[Motion]) -> Row:
    """`motions` belong to the items, in order, and `slides` are the same with the root network's walk."""
    wrists, head, jerks, face, feet, seconds, pairs = [], [], [], [], [], [], []
    for item, motion, walking in zip(items, motions, slides, strict=True):
        at, truly = (joint_places(m, walking=False)[:, WRISTS] for m in (motion, item.motion))
        wrists.append(np.linalg.norm(at - truly, axis=-1).ravel())
        head.append(turned_deg(heads(motion), heads(item.motion)))
        jerks.append(np.linalg.norm(np.diff(at, 3, axis=0), axis=-1).max(1) * FRAME_RATE**3)
        face.append(np.abs(motion["face"][:, 6:] - item.motion["face"][:, 6:]).mean(1))
        feet.append(foot_slide(walking, item.motion["lower"][:, CONTACT] > 0.5))
        seconds.append(len(at))
        pairs.append((beat.stressed(item), beat.turning_points(motion), item.seconds))
    gathered = np.concatenate(wrists)
    return Row(
        name,
        beat.beat(pairs, beat.SHARP_SIGMA_S).ratio,
        100 * float(gathered.mean()),
        100 * float(np.percentile(gathered, 95)),
        float(np.concatenate(head).mean()),
        float(np.percentile(np.concatenate(jerks), 95)),
        100 * float(np.average(feet, weights=seconds)),
        float(np.concatenate(face).mean()),
    )


def measure(
    items: Sequence[Item],
    models: dict[str, ResidualVqVae],
    order: Sequence[Part],
    face: list[str],
    root: RootNetwork,
    stride: int,
) -> list[Row]:
    """Without the tokenizers, through more and more of their levels, and through all of them at keyframes only."""
    own = [item.motion for item in items]
    out = [row("before", items, own, own)]
    most = max(part.levels for part in order if part.moves)
    ways = [(f"{levels} level{'s' * (levels > 1)}", levels, 1) for levels in range(1, most + 1)]
    for name, levels, each in [*ways, ("keyframes, straight lines between", most, stride)]:
        said = [through(motion, models, order, face, levels, each) for motion in own]
        out.append(row(name, items, said, [walked(motion, root) for motion in said]))
    return out


def markdown(rows: Sequence[Row]) -> str:
    """The rows, and the bars met by the row of all levels."""
    lines = [
        "| | beats | wrists, cm (95 %) | head, degrees | wrist jerk 95 %, m/s³ | slide, cm/s | face |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for one in rows:
        lines.append(
            f"| {one.name} | {one.beats:.2f} | {one.wrists_cm:.2f} ({one.wrists_95_cm:.2f}) | {one.head_deg:.2f} "
            f"| {one.jerk_m_s3:.0f} | {one.slide_cm_s:.2f} | {one.face:.4f} |"
        )
    lines += ["", "| bar | | found | |", "| --- | --- | --- | --- |"]
    before, full = rows[0], rows[-2]
    for bar in BARS:
        sign = "at least" if bar.least else "at most"
        verdict = "met" if bar.met(full, before) else "missed"
        lines.append(f"| {bar.name} | {sign} {bar.limit:g} | {bar.value(full, before):.2f} | {verdict} |")
    return "\n".join(lines) + "\n"


def write(rows: Sequence[Row], folder: Path, name: str = "tokenizers") -> None:
    """`NAME.json` and `NAME.md`."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{name}.json").write_text(json.dumps([asdict(one) for one in rows], indent=1) + "\n")
    (folder / f"{name}.md").write_text(markdown(rows))
