"""One of several equal shares of the work, for machines without communication."""

import re
from dataclasses import dataclass


@dataclass(frozen=True)
class Shard:
    """Share `number` of `count`, counted from 1. Each item belongs to one share, determined by its number."""

    number: int = 1
    count: int = 1

    @staticmethod
    def parse(text: str) -> "Shard":
        """Parses `NUMBER/COUNT`, such as `2/4`. Raises ValueError for anything else."""
        found = re.fullmatch(r"(\d{1,9})/(\d{1,9})", text)
        if not found or not 1 <= int(found[1]) <= int(found[2]):
            raise ValueError(f"`{text}`: expected NUMBER/COUNT, such as 2/4, NUMBER from 1 to COUNT")
        return Shard(int(found[1]), int(found[2]))

    def has(self, item: int) -> bool:
        return item % self.count == self.number - 1


ALL = Shard()
