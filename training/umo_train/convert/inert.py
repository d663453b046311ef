"""Stand-ins for the classes named in a pickle, so that reading one never runs its code."""

from typing import Any


class Inert(dict):
    """An object of a class that is not imported: it accepts any operation of a pickle, and keeps its state."""

    def __new__(cls, *_: Any, **__: Any) -> "Inert":
        return super().__new__(cls)

    def __init__(self, *_: Any, **__: Any) -> None:
        super().__init__()

    def __setstate__(self, state: Any) -> None:
        # Objects with slots have a pair of dictionaries; others may have any state.
        for part in state if isinstance(state, tuple) else (state,):
            if isinstance(part, dict):
                self.__dict__.update(part)

    def append(self, _: Any) -> None:
        """Used to fill lists."""

    def extend(self, _: Any) -> None:
        """Used to fill lists."""

    def add(self, _: Any) -> None:
        """Used to fill sets."""


def inert(name: str) -> type[Inert]:
    """Creates a stand-in for the class `name`."""
    return type(name.rpartition(".")[2], (Inert,), {})
