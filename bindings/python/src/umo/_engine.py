"""Engines, which compute sessions."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Sequence
from ctypes import byref
from typing import Any, Optional, Union

import numpy as np
import numpy.typing as npt

from . import _library
from ._library import lib
from ._model import Model, _check_readable, default_model
from ._session import Session, _ms


class Engine(_library.Handle):
    """Computes the sessions of one model, on `threads` threads of its own or, if `polled`, in `poll`.

    `model` is None for the one that comes with the package. `max_sessions` is the maximum number of sessions,
    `max_batch` the maximum computed together; `cores` binds threads to processors. None stands for umo's default.

    `priority` is that of the engine's own threads: `"normal"`, `"high"` (before other programs) or `"low"` (behind
    them). If the system refuses it, as Linux does `"high"` to most users, they stay normal.

    `gather` is the batching window for crowds: the longest time in seconds that a due chunk waits for others. With
    0.05, 32 avatars take about a fifth less processor time, and frames are delayed by the wait.
    """

    def __init__(
        self,
        model: Optional[Model] = None,
        *,
        threads: Optional[int] = None,
        polled: bool = False,
        max_sessions: Optional[int] = None,
        max_batch: Optional[int] = None,
        cores: Sequence[int] = (),
        priority: str = "normal",
        gather: float = 0.0,
    ) -> None:
        self._model = model or default_model()
        config, handle = _library.EngineConfig(), ctypes.c_void_p()
        _library.check(lib.umo_engine_config_init(config, ctypes.sizeof(config)))
        mode = _library.ENGINE_POLLED if polled else _library.ENGINE_THREADS
        _library.set_fields(config, mode=mode, threads=threads, max_sessions=max_sessions, max_batch=max_batch)
        config.priority = _library.chosen("priority", _library.PRIORITIES, priority)
        _library.set_fields(config, gather_ms=_ms(gather))
        _library.set_fields(config, core_count=len(cores), cores=(ctypes.c_uint32 * len(cores))(*cores))
        _library.check(lib.umo_engine_new(self._model._handle, config, byref(handle)))
        super().__init__(handle.value or 0, lib.umo_engine_free)

    @property
    def model(self) -> Model:
        """The model that it computes."""
        return self._model

    def session(self, rate: Optional[int] = None, channels: int = 1, **settings: Any) -> Session:
        """Creates a session of this engine, with the arguments of `Session`."""
        return Session(self, rate, channels, **settings)

    @property
    def gestures(self) -> tuple[str, ...]:
        """Names of the gestures available to its sessions: the built-in ones, then the added ones."""
        names: list[str] = []
        name = ctypes.c_char_p()
        while (status := lib.umo_engine_get_gesture_name(self._handle, len(names), byref(name))) == _library.Status.OK:
            names.append((name.value or b"").decode())
        if status != _library.Status.INVALID_ARGUMENT:
            _library.check(status)
        return tuple(names)

    def add_gesture(
        self,
        name: str,
        rotations: npt.ArrayLike,
        *,
        stroke: float,
        rate: float = 30.0,
        parts: Sequence[str] = tuple(_library.GESTURE_PARTS),
        axes: str = "gltf",
    ) -> None:
        """Adds a gesture for sessions created from now on, replacing any gesture of the same name.

        `rotations` are [frames, 55, 4] as in `Motion.rotations`, at `rate` frames a second; `stroke` is the time of the
        stroke in them, seconds. `parts` are the parts that it moves: `"head"`, `"trunk"`, `"left_arm"`, `"right_arm"`.
        """
        values = np.ascontiguousarray(rotations, np.float32)
        if values.ndim != 3 or values.shape[1:] != (_library.JOINT_COUNT, 4):
            raise ValueError(f"rotations of shape {values.shape}: expected [frames, {_library.JOINT_COUNT}, 4]")
        if "\0" in name:
            raise ValueError("a gesture's name must not contain zero bytes")
        clip = _library.GestureClip()
        _library.check(lib.umo_gesture_clip_init(clip, ctypes.sizeof(clip)))
        clip.axes = _library.chosen("axes", _library.AXES, axes)
        clip.parts = sum({_library.chosen("part", _library.GESTURE_PARTS, part) for part in parts})
        clip.frame_count, clip.rate, clip.stroke = len(values), rate, stroke
        clip.rotations = values.ctypes.data_as(ctypes.POINTER(ctypes.c_float))
        _library.check(lib.umo_engine_add_gesture(self._handle, name.encode(), clip))

    def add_gesture_file(
        self,
        name: str,
        file: Union[str, os.PathLike[str], bytes],
        *,
        animation: Optional[str] = None,
        stroke: Optional[float] = None,
        parts: Sequence[str] = tuple(_library.GESTURE_PARTS),
    ) -> None:
        """As `add_gesture`, from the animation in a `.glb`, `.gltf` or `.vrm` file of any humanoid character: a path,
        or its bytes (of a `.gltf` with embedded data).

        `animation` is its name in the file; None is the first. The default `stroke` is the middle.
        """
        if "\0" in name or (animation is not None and "\0" in animation):
            raise ValueError("a name must not contain zero bytes")
        bits = sum({_library.chosen("part", _library.GESTURE_PARTS, part) for part in parts})
        clip = None if animation is None else animation.encode()
        at = -1.0 if stroke is None else float(stroke)
        if isinstance(file, bytes):
            status = lib.umo_engine_add_gesture_memory(self._handle, name.encode(), file, len(file), clip, bits, at)
        else:
            path = os.fspath(file)
            if "\0" in path:
                raise ValueError("a path must not contain zero bytes")
            status = lib.umo_engine_add_gesture_file(self._handle, name.encode(), path.encode(), clip, bits, at)
            if status == _library.Status.IO:
                detail = lib.umo_last_error().decode()
                _check_readable(path)
                raise _library.error(status, detail)
        _library.check(status)

    def set_late_limit(self, seconds: Optional[float]) -> None:
        """Holds bodies still, in turn, while chunks start more than `seconds` late; `None`, the initial value, turns
        this off.
        """
        _library.check(lib.umo_engine_set_late_limit(self._handle, -1.0 if seconds is None else seconds))

    def poll(self, budget: Optional[float] = None) -> bool:
        """Computes on this thread until nothing is due, or until the next layer would exceed `budget` seconds; at least
        one.

        Returns whether there is more to do. For engines created with `polled`.
        """
        more = ctypes.c_uint32()
        microseconds = 0xFFFF_FFFF if budget is None else min(max(round(budget * 1e6), 0), 0xFFFF_FFFF)
        _library.check(lib.umo_engine_poll(self._handle, microseconds, byref(more)))
        return bool(more.value)
