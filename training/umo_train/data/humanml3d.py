"""HumanML3D: people's descriptions of AMASS' motions and of spans in them."""

import csv
from dataclasses import dataclass
from pathlib import Path

from umo_train.data.clip import DataError, file, folder

_FETCH = "fetch the data set HumanML3D, with its texts unpacked"
_FRAME_RATE = 20
# Seconds dropped by HumanML3D at the start of some sets before counting frames.
_DROPPED = {
    "Eyes_Japan_Dataset": 3.0, "MPI_HDM05": 3.0, "TotalCapture": 1.0, "MPI_Limits": 1.0, "Transitions_mocap": 0.5,
}  # fmt: skip


@dataclass(frozen=True)
class Described:
    """A span of a motion in seconds, and sentences that each describe it."""

    start: float
    end: float
    sentences: tuple[str, ...]


def humanml3d(root: Path) -> dict[str, list[Described]]:
    """Descriptions by motion name as in `motion_name`. Mirrored motions are left out, as AMASS lacks them."""
    index = file(root / "index.csv", _FETCH)
    folder(root / "texts", _FETCH)
    out: dict[str, list[Described]] = {}
    with index.open(newline="", encoding="utf-8-sig") as lines:
        rows = csv.DictReader(lines)
        wanted = {"source_path", "start_frame", "end_frame", "new_name"}
        if not wanted <= set(rows.fieldnames or ()):
            raise DataError(f"{index}: expected columns {', '.join(sorted(wanted))}")
        for row in rows:
            source = row["source_path"].replace("\\", "/").split("pose_data/")[-1]
            before = next((seconds for name, seconds in _DROPPED.items() if name in source), 0.0)
            start, end = (before + float(row[key]) / _FRAME_RATE for key in ("start_frame", "end_frame"))
            text = file(root / "texts" / f"{Path(row['new_name']).stem}.txt", f"{index.name} lists it: {_FETCH}")
            out.setdefault(motion_name(source), []).extend(_described(text, start, end))
    return out


def motion_name(name: str) -> str:
    """Name of a motion independent of the version of AMASS: without suffix and the versions' additions."""
    return name.removesuffix(".npy").removesuffix(".npz").removesuffix("_poses").removesuffix("_stageii")


def _described(path: Path, start: float, end: float) -> list[Described]:
    """Lines `sentence#tokens#from#to`; `from` and `to` are seconds in the span, both 0 for the whole span."""
    spans: dict[tuple[float, float], list[str]] = {}
    for number, line in enumerate(path.read_text("utf-8").splitlines(), 1):
        fields = line.strip().split("#")
        if len(fields) != 4:
            raise DataError(f"{path}: line {number}: expected sentence#tokens#from#to, got `{line}`")
        try:
            first, last = float(fields[2]), float(fields[3])
        except ValueError as error:
            raise DataError(f"{path}: line {number}: expected seconds, got `{fields[2]}` and `{fields[3]}`") from error
        # A few lines of the data set lack numbers.
        span = (start + first, min(start + last, end)) if last > first else (start, end)
        spans.setdefault(span, []).append(fields[0].strip())
    return [Described(*span, tuple(sentences)) for span, sentences in spans.items()]
