"""Stand-ins for the classes that a pickle names, so that reading one never runs what it asks for."""

from typing import Any


class Inert(dict):
    """An object of a class that is not imported: it takes whatever a pickle does to it, and keeps its state."""

    def __new__(cls, *_: Any, **__: Any) -> "Inert":
        return super().__new__(cls)

    def __init__(self, *_: Any, **__: Any) -> None:
        super().__init__()

    def __setstate__(self, state: Any) -> None:
        # Objects with slots have a pair of dictionaries; others may have anything.
        for part in state if isinstance(state, tuple) else (state,):
            if isinstance(part, dict):
                self.__dict__.update(part)

    def append(self, _: Any) -> None:
        """Lists are filled so."""

    def extend(self, _: Any) -> None:
        """Lists are filled so."""

    def add(self, _: Any) -> None:
        """Sets are filled so."""


def inert(name: str) -> type[Inert]:
    """A stand-in of its own for the class `name`."""
    return type(name.rpartition(".")[2], (Inert,), {})
