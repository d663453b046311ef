"""Table and numbers of the lips of umo and of others beside captured mouths (`benches/lips/run`)."""

import argparse
import json
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import captured
import methods
import numpy as np
import scores
from captured import Recording
from methods import Method
from scores import Score, Truth
from umo_train.metrics import program
from umo_train.metrics.lips import pearson

MODEL = methods.ROOT / "models/umo-people/model.safetensors"
COLUMNS = {
    "opening": "r of opening",
    "in step": "the same, lag removed",
    "width": "r of width",
    "rounding": "r of rounding",
    "found": "closures found",
    "false": "false",
    "closures": "found less false",
    "lag": "lag, ms",
}
# Columns by which methods are compared: a mouth that never opens finds every closure, one that never closes shows no
# false one.
COMPARED = [name for name in COLUMNS if name not in ("found", "false")]
SHARES = ("found", "false", "closures")


@dataclass(frozen=True)
class Row:
    method: Method
    scores: dict[str, Score]


@dataclass(frozen=True)
class Capture:
    """All methods on one capture."""

    title: str
    known: Truth
    rows: Sequence[Row]


def badness(name: str, values: np.ndarray | float) -> np.ndarray | float:
    """Smaller is better for every column."""
    return np.abs(values) if name == "lag" else -values


def lost(row: Row, rows: Sequence[Row]) -> list[str]:
    """Columns of one of umo's rows in which a peer that is told nothing is better; in brackets where the difference is
    within its 95 % interval."""
    others = [other for other in rows if not other.method.is_ours and not other.method.is_told]
    out = []
    for name in COMPARED:
        having = [other for other in others if name in other.scores]
        best = min(having, key=lambda other: badness(name, other.scores[name].value))
        ours, theirs = row.scores[name], best.scores[name]
        if badness(name, theirs.value) < badness(name, ours.value):
            difference = badness(name, ours.draws) - badness(name, theirs.draws)
            out.append(name if np.nanpercentile(difference, 2.5) > 0 else f"({name})")
    peers = [other.method for other in others if other.method.size is not None]
    if min(peer.cost for peer in peers) < row.method.cost:
        out.append("time")
    if min(peer.size for peer in peers) < row.method.size:
        out.append("bytes")
    return out


def number(name: str, one: Score) -> str:
    if math.isnan(one.value):
        return "–"
    if name == "lag":
        return f"{1000 * one.value:.0f} ({1000 * one.low:.0f} to {1000 * one.high:.0f})"
    if name in SHARES:
        return f"{100 * one.value:.0f} % ({100 * one.low:.0f} to {100 * one.high:.0f})"
    return f"{one.value:.2f} ({one.low:.2f} to {one.high:.2f})"


def size_text(size: int | None) -> str:
    if size is None:
        return "–"
    return f"{size / 1e6:.1f} MB" if size >= 1e6 else f"{size / 1e3:.0f} kB"


def table(capture: Capture) -> str:
    """The capture's table in Markdown, by r of opening; the best of each column is bold."""
    rows = sorted(capture.rows, key=lambda row: -row.scores["opening"].value)
    best = {}
    for name in COMPARED:
        having = [row for row in rows if name in row.scores and not row.method.is_told]
        best[name] = min(having, key=lambda row: badness(name, row.scores[name].value)).method.name
    lines = [
        "| umo loses | method | " + " | ".join(COLUMNS.values()) + " | core per second | bytes |",
        "| --- " * (len(COLUMNS) + 4) + "|",
    ]
    for row in rows:
        method = row.method
        cells = [", ".join(lost(row, rows)) if method.is_ours else "", method.name]
        for name in COLUMNS:
            text = number(name, row.scores[name]) if name in row.scores else "–"
            cells.append(f"**{text}**" if best.get(name) == method.name else text)
        lines.append("| " + " | ".join([*cells, f"{1000 * method.cost:.1f} ms", size_text(method.size)]) + " |")
    return "\n".join(lines)


def chance(method: Method, known: Truth) -> float:
    """Mean r of the opening with the next recording's captured mouth: what any talking mouth gets."""
    values = []
    for one, other in zip(known.recordings, [*known.recordings[1:], known.recordings[0]], strict=True):
        count = min(len(one.times), len(other.times))
        opening = method.curves[one.name.split("/")[0]].at(one.times[:count])[:, 0]
        values.append(pearson(opening, other.mouth[:count, 0]))
    return float(np.mean(values))


def check(recordings: Sequence[Recording], capture: Capture) -> None:
    """Facts that hold unless something broke. Raises `AssertionError`, which names the fact."""
    for row in capture.rows:
        label = row.method.name
        wanted = {"opening", "in step", "lag", "found", "found in step", "false", "closures"}
        wanted |= {"width", "rounding"} if row.method.parts == 3 else set()
        assert row.scores.keys() == wanted, f"{label}: columns {sorted(row.scores)}"
        assert all(math.isfinite(one.value) for one in row.scores.values()), f"{label}: a value that is not finite"
        for one in recordings:
            curve = row.method.curves[one.name]
            assert np.isfinite(curve.mouth).all() and np.ptp(curve.mouth[:, 0]) > 0, f"{label}, {one.name}: no mouth"
            assert (np.diff(curve.times) > 0).all(), f"{label}, {one.name}: times go back"
            assert curve.times[-1] > one.seconds - 0.15, f"{label}, {one.name}: ends at {curve.times[-1]:.2f} s"
    by_name = {row.method.name: row for row in capture.rows}
    # The bounds are wide: they find a shifted, swapped or dead mouth, not a worse one.
    for label, latest in ((methods.DEFAULT, 0.1), (methods.LIVE, 0.15)):
        row = by_name[label]
        floor = chance(row.method, capture.known)
        assert row.scores["in step"].value > floor + 0.15, f"{label}: r no better than another sentence's, {floor:.2f}"
        assert abs(row.scores["lag"].value) < latest, f"{label}: lag of {row.scores['lag'].value:.3f} s"
    assert by_name["loudness"].scores["opening"].value > 0.3, "the sound does not belong to the captured mouths"


def processor() -> str:
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return f"{names[0] if names else 'unknown processor'}, {os.cpu_count()} cores"


def as_json(captures: Sequence[Capture]) -> str:
    out = {"processor": processor(), "captures": {}}
    for capture in captures:
        entries = {}
        for row in capture.rows:
            values = {
                name: dict(zip(("value", "low", "high"), (round(x, 4) for x in (s.value, s.low, s.high)), strict=True))
                for name, s in row.scores.items()
            }
            entries[row.method.name] = values | {"core": round(row.method.cost, 6), "bytes": row.method.size}
        known = capture.known
        about = {"recordings": len(known.recordings), "closures": sum(len(times) for times in known.closures)}
        out["captures"][capture.title] = about | {"methods": entries}
    return json.dumps(out, indent=1, ensure_ascii=False) + "\n"


def measured(title: str, recordings: Sequence[Recording], found: Sequence[Method]) -> Capture:
    known = scores.truth(recordings)
    return Capture(title, known, [Row(one, scores.score(one.curves, one.parts, known)) for one in found])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--peers", type=Path, required=True, help="folder of the peers' node_modules")
    parser.add_argument("--grid", type=Path, help="GRID's talker: landmarks_*.npz, words.json, audio")
    parser.add_argument("--face", type=Path, help="captured weights of an actress: *.npz, *.opus, weight_names.txt")
    parser.add_argument("-o", "--output", type=Path, help="Markdown file [default: print]")
    parser.add_argument("--json", type=Path, help="file of all numbers")
    options = parser.parse_args()
    umo = program.find(Path(os.environ["UMO_PROGRAM"]) if "UMO_PROGRAM" in os.environ else None)
    sources = {}
    if options.grid:
        sources["GRID"] = captured.grid(options.grid)
    if options.face:
        sources["Mandarin"] = captured.face(options.face)
    is_small = not sources
    if is_small:
        sources["GRID, ten sentences"] = captured.ten()
    captures = []
    for title, recordings in sources.items():
        found = methods.all_methods(umo, MODEL, options.peers, recordings, is_small)
        captures.append(measured(title, recordings, found))
        if is_small:
            check(recordings, captures[-1])
    text = "".join(
        f"### {one.title}\n\n{len(one.known.recordings)} recordings or pieces of {scores.PIECE_S:.0f} s, "
        f"{sum(map(len, one.known.closures))} closures; {processor()}.\n\n{table(one)}\n\n"
        for one in captures
    )
    if options.output:
        options.output.write_text(text)
    else:
        print(text, end="")
    if options.json:
        options.json.write_text(as_json(captures))


if __name__ == "__main__":
    main()
