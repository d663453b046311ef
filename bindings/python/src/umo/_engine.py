"""Engines, which compute sessions."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Sequence
from ctypes import byref
from typing import Any, Optional, Union

import numpy as np
import numpy.typing as npt

from . import _generated, _library
from ._library import lib
from ._model import Model, _check_readable, default_model
from ._session import Session


class Engine(_generated.EngineArguments, _library.Handle):
    """Computes the sessions of one model, on `threads` of its own, or, where `polled`, in `poll`.

    `model` is None for the one that comes with the package; `cores` binds threads to processors.
    """

    def _make(self, model: Optional[Model], polled: bool, cores: Sequence[int], **settings: Any) -> None:
        self._model = model or default_model()
        config, handle = _generated.EngineConfig(), ctypes.c_void_p()
        _library.check(lib.umo_engine_config_init(config, ctypes.sizeof(config)))
        _library.set_values(config, mode="polled" if polled else "threads", **settings)
        _library.set_fields(config, core_count=len(cores), cores=(ctypes.c_uint32 * len(cores))(*cores))
        _library.check(lib.umo_engine_new(self._model._handle, config, byref(handle)))
        _library.Handle.__init__(self, handle.value or 0, lib.umo_engine_free)

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
        while (status := lib.umo_engine_get_gesture_name(self._handle, len(names), byref(name))) == _generated.Status.OK:
            names.append((name.value or b"").decode())
        if status != _generated.Status.INVALID_ARGUMENT:
            _library.check(status)
        return tuple(names)

    def add_gesture(
        self,
        name: str,
        rotations: npt.ArrayLike,
        *,
        stroke: float,
        rate: float = 30.0,
        parts: Sequence[str] = tuple(_generated.GESTURE_PARTS),
        axes: str = "gltf",
    ) -> None:
        """Adds a gesture for sessions created from now on, replacing any gesture of the same name.

        `rotations` are [frames, 55, 4] as in `Motion.rotations`, at `rate` frames a second; `stroke` is the time of the
        stroke in them, seconds. `parts` are the parts that it moves: `"head"`, `"trunk"`, `"left_arm"`, `"right_arm"`.
        """
        values = np.ascontiguousarray(rotations, np.float32)
        if values.ndim != 3 or values.shape[1:] != (_generated.JOINT_COUNT, 4):
            raise ValueError(f"rotations of shape {values.shape}: expected [frames, {_generated.JOINT_COUNT}, 4]")
        if "\0" in name:
            raise ValueError("a gesture's name has no zero bytes")
        clip = _generated.GestureClip()
        _library.check(lib.umo_gesture_clip_init(clip, ctypes.sizeof(clip)))
        clip.axes = _library.chosen("axes", _generated.AXES, axes)
        clip.parts = sum({_library.chosen("part", _generated.GESTURE_PARTS, part) for part in parts})
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
        parts: Sequence[str] = tuple(_generated.GESTURE_PARTS),
    ) -> None:
        """As `add_gesture`, from the animation in a `.glb`, `.gltf` or `.vrm` file of any humanoid character: a path,
        or its bytes (of a `.gltf` with embedded data).

        `animation` is its name in the file; None is the first. The default `stroke` is the middle.
        """
        if "\0" in name or (animation is not None and "\0" in animation):
            raise ValueError("a name has no zero bytes")
        bits = sum({_library.chosen("part", _generated.GESTURE_PARTS, part) for part in parts})
        clip = None if animation is None else animation.encode()
        at = -1.0 if stroke is None else float(stroke)
        if isinstance(file, bytes):
            status = lib.umo_engine_add_gesture_memory(self._handle, name.encode(), file, len(file), clip, bits, at)
        else:
            path = os.fspath(file)
            if "\0" in path:
                raise ValueError("a path must not contain zero bytes")
            status = lib.umo_engine_add_gesture_file(self._handle, name.encode(), path.encode(), clip, bits, at)
            if status == _generated.Status.IO:
                detail = lib.umo_last_error().decode()
                _check_readable(path)
                raise _library.error(status, detail)
        _library.check(status)

    def set_word_rules(self, language: Optional[str] = None, toml: Optional[str] = None) -> None:
        """Sets the rules by which words become gestures, for sessions created from now on: of a language (`"en"`, `"de"`;
        None keeps the present ones), and the text of a file of rules to add to them, if any.
        """
        if any(text is not None and "\0" in text for text in (language, toml)):
            raise ValueError("rules have no zero bytes")
        code = None if language is None else language.encode()
        _library.check(lib.umo_engine_set_word_rules(self._handle, code, None if toml is None else toml.encode()))

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
