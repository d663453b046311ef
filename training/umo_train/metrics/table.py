"""Several reports as one Markdown table, one row each: ablations, sizes, precisions."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

# Heading, path to the number in `measures`, format, and whether more is better.
COLUMNS: tuple[tuple[str, tuple[str, ...], str, bool], ...] = (
    ("FGD", ("fgd", "model"), ".2f", False),
    ("BC", ("beat", "onsets_beat", "own"), ".3f", True),
    ("BC ratio", ("beat", "accents_sharp", "ratio"), ".2f", True),
    ("diversity", ("variety", "model", "spread"), ".2f", True),
    ("seeds", ("variety", "model", "seeds"), ".2f", True),
    ("prompts told", ("variety", "model", "separable"), ".2f", True),
    ("lips", ("mouth", "*", "lip_correlation"), ".3f", True),
    ("p b m closed", ("mouth", "*", "closures"), ".3f", True),
    ("pauses still", ("mouth", "*", "pauses"), ".3f", True),
    ("real speech", ("real_mouth", "*", "correlation"), ".3f", True),
    ("jerk", ("model", "jerk"), ".0f", False),
    ("foot slide", ("model", "foot_slide"), ".3f", False),
    ("first frame, ms", ("speed", "first_frame_ms"), ".1f", False),
    ("frames/s", ("speed", "frames_per_second"), ".0f", True),
)


def _at(group: Any, way: tuple[str, ...]) -> float | None:
    """A number of a report; `*` takes the minimum over all keys. None if it is missing."""
    if not way:
        return group
    if not isinstance(group, Mapping):
        return None
    if way[0] == "*":
        found = [value for key in group if (value := _at(group[key], way[1:])) is not None]
        return min(found, default=None)
    return _at(group.get(way[0]), way[1:])


def table(reports: Mapping[str, Path]) -> str:
    """Rows by name from `report.json` files. The best of each column is bold; columns without values are left out."""
    read = {name: json.loads(Path(path).read_text())["measures"] for name, path in reports.items()}
    head, rules, cells = [""], ["---"], [[name] for name in read]
    for heading, way, form, more in COLUMNS:
        values = [_at(measures, way) for measures in read.values()]
        present = [value for value in values if value is not None]
        if not present:
            continue
        best = max(present) if more else min(present)
        head.append(f"{heading} {'↑' if more else '↓'}")
        rules.append("---:")
        for row, value in zip(cells, values, strict=True):
            text = "–" if value is None else format(value, form)
            row.append(f"**{text}**" if value == best and len(values) > 1 else text)
    return "\n".join("| " + " | ".join(row) + " |" for row in (head, rules, *cells)) + "\n"
