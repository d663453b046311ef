"""Tables in Markdown."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

Column = tuple[str, Callable[[dict[str, Any]], str]]


def table(columns: Sequence[Column], rows: Mapping[str, dict[str, Any]]) -> str:
    """A line per named row; a column has a heading and a function of the row."""
    lines = ["| | " + " | ".join(heading for heading, _ in columns) + " |", "| --- |" + " --- |" * len(columns)]
    lines += [f"| {name} | " + " | ".join(cell(row) for _, cell in columns) + " |" for name, row in rows.items()]
    return "\n".join(lines) + "\n"
