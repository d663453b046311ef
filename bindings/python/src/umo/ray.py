"""Animates recordings on the machines of a Ray cluster. Needs the extra `umo-avatar[ray]`.

    results = umo.ray.animate(["s3://lines/a.wav", {"file": "s3://lines/b.flac", "mood": "joy"}], "s3://motion", format=".bvh")
    for row in results.iter_rows(): ...

Paths may be on any file system that fsspec supports. Outputs are written atomically, and a second run keeps finished ones:
it compares the contents of recording, settings and model, not dates.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import posixpath
import uuid
from collections.abc import Iterable, Mapping
from typing import Any, Optional, Union

import fsspec
import numpy as np
import numpy.typing as npt
import ray.data
import soundfile

from . import _save
from ._animate import animate as _animate
from ._library import MODEL, lib
from ._model import Model
from ._motion import Motion

FIELDS = {"file": str, "output": str, "seed": int, "prompt": str, "mood": str}
"""Fields of a line, all optional except the file."""


def animate(
    lines: Iterable[Union[str, Mapping[str, Any]]],
    output: str,
    *,
    format: str = ".npz",
    model: Optional[str] = None,
    actors: int = 1,
    cpus: int = 1,
    jobs: int = 8,
    again: bool = False,
    **settings: Any,
) -> ray.data.Dataset:
    """Animates recordings on the cluster that `ray.init` connected to: a dataset with a row per line, computed lazily.

    A line is a path, or a mapping with `file` and optionally `output` (its path below the folder `output`; its suffix
    selects the format), `seed`, `prompt` and `mood`. The default output is the file's name with the suffix `format`.
    Each of `actors` holds the model, computes `jobs` lines together, and uses `cpus`; `model` is a path that all of
    them can read. `again` recomputes finished lines. `settings` are arguments of `umo.animate`; a line's fields take
    precedence.

    A row has `file`, `output`, `status` (`"done"`, `"kept"` or `"failed"`), `error`, `frames`, `seconds`, `sha256` of
    the output, and `key`, a hash of everything that the output depends on. A file `.NAME.umo.json` beside each output
    holds both hashes. A worker that dies is replaced, and its lines are computed again.
    """
    for name, value in (("actors", actors), ("cpus", cpus), ("jobs", jobs)):
        if value < 1:
            raise ValueError(f"{name} {value}: expected at least 1")
    work = [_line(line, output, format) for line in lines]
    seen: dict[str, str] = {}
    inputs = {_canonical(line["file"]) for line in work}
    for line in work:
        place = _canonical(line["output"])
        if place in inputs:
            raise ValueError(f"`{line['output']}` is an input and an output: name another output")
        if place in seen:
            raise ValueError(f"`{line['file']}` and `{seen[place]}` have one output: `{line['output']}`")
        seen[place] = line["file"]
    if not work:
        raise ValueError("no lines: expected at least one recording")
    # As text: numpy columns cannot hold missing fields. A block is what a dead worker loses.
    rows = [{"line": json.dumps(line)} for line in work]
    return ray.data.from_items(rows, override_num_blocks=-(-len(rows) // jobs)).map_batches(
        Animator,
        batch_size=jobs,
        batch_format="numpy",
        num_cpus=cpus,
        compute=ray.data.ActorPoolStrategy(size=min(actors, -(-len(rows) // jobs))),
        fn_constructor_kwargs={"model": model, "threads": cpus, "jobs": jobs, "again": again, "settings": settings},
    )


def _line(line: Union[str, Mapping[str, Any]], folder: str, suffix: str) -> dict[str, Any]:
    given = {"file": line} if isinstance(line, str) else line
    fields: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    for name, value in fields.items():
        if name not in FIELDS:
            raise ValueError(f"line {dict(fields)}: field {name!r} is unknown; expected {', '.join(FIELDS)}")
        if not isinstance(value, FIELDS[name]):
            raise ValueError(f"line {dict(fields)}: {name} {value!r}: expected {FIELDS[name].__name__}")
    if not fields.get("file"):
        raise ValueError(f"line {dict(fields)}: expected a `file`")
    name = fields.pop("output", None) or posixpath.splitext(posixpath.basename(fields["file"]))[0] + suffix
    if posixpath.isabs(name) or "://" in name or posixpath.normpath(name).split("/")[0] == "..":
        raise ValueError(f"line {dict(fields)}: output `{name}` is outside the outputs' folder, {folder}")
    path = posixpath.join(folder, name)
    _save.writer(path)
    return {**fields, "output": path}


def _canonical(path: str) -> str:
    """One spelling of a path: an absolute one on this machine, or a URL without detours."""
    system, separator, place = path.partition("://")
    if not separator or system in ("file", "local"):
        return os.path.realpath(place or path)
    return f"{system}://{posixpath.normpath(place)}"


class Animator:
    """Runs in an actor: the model, and batches of lines."""

    def __init__(
        self, model: Optional[str] = None, threads: int = 1, jobs: int = 8, again: bool = False, settings: Mapping[str, Any] = {}
    ) -> None:
        content = _read(model or str(MODEL))
        self._model = Model(content)
        self._threads, self._jobs, self._again = threads, jobs, again
        self._settings = dict(settings)
        # Instruction sets may differ in the last bit.
        version = lib.umo_version().decode()
        self._same = [version, self._model.isa, _hash(content), json.dumps(self._settings, sort_keys=True, default=str)]

    def __call__(self, batch: Mapping[str, Any]) -> dict[str, npt.NDArray[Any]]:
        """Processes a batch of lines, as JSON in the column `line`, to its rows."""
        rows = [_row(json.loads(str(text))) for text in batch["line"]]
        wanted: list[tuple[dict[str, Any], npt.NDArray[Any], int]] = []
        for row in rows:
            try:
                content = _read(row["file"])
                row["key"] = _hash(json.dumps([*self._same, row["line"], _hash(content)]).encode())
                if not self._again and _kept(row):
                    continue
                wanted.append((row, *_audio(content, row["file"])))
            except Exception as error:
                _failed(row, error)
        for (row, _, _), motion in zip(wanted, self._motions(wanted)):
            try:
                if isinstance(motion, Exception):
                    raise motion
                _write(row, motion)
            except Exception as error:
                _failed(row, error)
        columns = ("file", "output", "status", "error", "frames", "seconds", "sha256", "key")
        return {name: np.array([row[name] for row in rows]) for name in columns}

    def _motions(self, wanted: list[tuple[dict[str, Any], npt.NDArray[Any], int]]) -> list[Union[Motion, Exception]]:
        """Computed together; one by one if that fails, so that a bad line affects no other."""
        if not wanted:
            return []
        try:
            return list(self._together(wanted))
        except Exception:
            motions: list[Union[Motion, Exception]] = []
            for each in wanted:
                try:
                    motions += self._together([each])
                except Exception as error:
                    motions.append(error)
            return motions

    def _together(self, wanted: list[tuple[dict[str, Any], npt.NDArray[Any], int]]) -> list[Motion]:
        def of(name: str) -> list[Any]:
            return [row["line"].get(name, self._settings.get(name)) for row, _, _ in wanted]

        audio, rates = [samples for _, samples, _ in wanted], [rate for _, _, rate in wanted]
        told: dict[str, Any] = {name: of(name) for name in ("seed", "prompt", "mood")}
        told = {**self._settings, **told, "model": self._model, "threads": self._threads, "jobs": self._jobs}
        return _animate(audio, rates, **told)


def _row(line: dict[str, Any]) -> dict[str, Any]:
    empty = {"status": "", "error": "", "frames": 0, "seconds": 0.0, "sha256": "", "key": ""}
    return {"line": line, "file": line["file"], "output": line["output"], **empty}


def _failed(row: dict[str, Any], error: Exception) -> None:
    row.update(status="failed", error=f"{type(error).__name__}: {error}")


def _hash(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _read(path: str) -> bytes:
    system, place = fsspec.core.url_to_fs(path)
    content = system.cat_file(place)
    assert isinstance(content, bytes)
    return content


def _audio(content: bytes, path: str) -> tuple[npt.NDArray[Any], int]:
    try:
        samples, rate = soundfile.read(io.BytesIO(content), dtype="float32")
    except soundfile.LibsndfileError as error:
        raise ValueError(f"{error} Convert it: ffmpeg -i {path} {posixpath.splitext(path)[0]}.wav") from error
    if not len(samples):
        raise ValueError("the recording has no samples")
    return samples, int(rate)


def _beside(place: str, name: str) -> str:
    folder, base = posixpath.split(place)
    return posixpath.join(folder, name.format(base))


def _kept(row: dict[str, Any]) -> bool:
    """Whether the output already matches the line; the row is then filled in."""
    system, place = fsspec.core.url_to_fs(row["output"])
    try:
        note = json.loads(system.cat_file(_beside(place, ".{}.umo.json")))
        if note["key"] != row["key"] or note["sha256"] != _hash(system.cat_file(place)):
            return False
    except (FileNotFoundError, ValueError, KeyError, TypeError):
        return False
    row.update(status="kept", frames=note["frames"], seconds=note["seconds"], sha256=note["sha256"])
    return True


def _write(row: dict[str, Any], motion: Motion) -> None:
    content = _save.encoded(motion, row["output"])
    row.update(frames=len(motion), seconds=len(motion) / motion.rate, sha256=_hash(content), status="done")
    system, place = fsspec.core.url_to_fs(row["output"])
    system.makedirs(posixpath.dirname(place), exist_ok=True)
    note = {name: row[name] for name in ("file", "key", "sha256", "frames", "seconds")}
    # The note comes last: without it, or with another key, the line is computed again.
    _put(system, place, content)
    _put(system, _beside(place, ".{}.umo.json"), json.dumps(note).encode())


def _put(system: Any, place: str, content: bytes) -> None:
    """Writes atomically. Object stores without a rename do so anyway."""
    part = _beside(place, ".{}." + uuid.uuid4().hex + ".part")
    try:
        system.pipe_file(part, content)
        system.mv(part, place)
    except BaseException:
        if system.exists(part):
            system.rm_file(part)
        raise
