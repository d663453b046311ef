"""Speed of the program with a model on this machine, measured by its `bench` command."""

import json
import subprocess
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Speed:
    """Milliseconds to the first frame and per chunk (medians), frames a second of one avatar, and the machine."""

    first_frame_ms: float
    chunk_ms: float
    frames_per_second: float
    isa: str
    threads: int


def speed(umo: Path, model: Path | None = None, chunks: int = 40, starts: int = 10) -> Speed:
    """Runs `umo bench`; by default with the embedded model."""
    command = [str(umo), "bench", "--json", "--chunks", str(chunks), "--starts", str(starts), "--seconds", "0"]
    command += ["--model", str(model)] if model else []
    said = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    return Speed(
        said["first_frame_ms"]["p50"],
        said["chunk_ms"]["p50"],
        said["frames_per_second"],
        said["isa"],
        said["threads"],
    )
