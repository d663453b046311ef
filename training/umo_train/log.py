"""A CSV of a stage's numbers, averaged over several steps."""

import csv
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path

from torch import Tensor

EVERY = 20


class Log:
    """Appends rows `step, name, value`; a resumed stage continues from its checkpoint."""

    def __init__(self, path: Path, start: int) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        kept = []
        if path.exists() and start:
            with path.open(newline="") as file:
                kept = [row for row in csv.reader(file) if row[0] != "step" and int(row[0]) < start]
        with path.open("w", newline="") as file:
            csv.writer(file).writerows([["step", "name", "value"], *kept])
        self.path = path
        self.sums: dict[str, list[float | Tensor]] = defaultdict(list)

    def add(self, step: int, values: Mapping[str, float | Tensor]) -> None:
        """Values may still be pending on a GPU: they are fetched when they are written."""
        for name, value in values.items():
            self.sums[name].append(value)
        if (step + 1) % EVERY == 0:
            self.write(step)

    def write(self, step: int) -> None:
        """Writes values added since the last row; called at the end of a stage."""
        with self.path.open("a", newline="") as file:
            rows = [[step, name, f"{sum(map(float, v)) / len(v):.6g}"] for name, v in self.sums.items()]
            csv.writer(file).writerows(rows)
        self.sums.clear()
