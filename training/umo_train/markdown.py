"""Tables in Markdown."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

Column = tuple[str, Callable[[dict[str, Any]], str]]


def table(columns: Sequence[Column], rows: Mapping[str, dict[str, Any]]) -> str:
    """A line for each named row; of a column its heading, and what it says of a row."""
    lines = ["| | " + " | ".join(heading for heading, _ in columns) + " |", "| --- |" + " --- |" * len(columns)]
    lines += [f"| {name} | " + " | ".join(cell(row) for _, cell in columns) + " |" for name, row in rows.items()]
    return "\n".join(lines) + "\n"
