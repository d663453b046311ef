"""Several processes of one run, started by `accelerate launch`; a run without it has one."""

import os
from datetime import timedelta

from accelerate import PartialState

# The other processes wait while the first one makes a corpus.
_LONGEST_WAIT = timedelta(days=30)


def _several() -> bool:
    return int(os.environ.get("WORLD_SIZE", "1")) > 1


def is_first() -> bool:
    return not _several() or PartialState(timeout=_LONGEST_WAIT).is_main_process


def wait() -> None:
    """Waits until every process is here."""
    if _several():
        PartialState(timeout=_LONGEST_WAIT).wait_for_everyone()
