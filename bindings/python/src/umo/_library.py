"""The shared library beside this file, and its functions for ctypes. Its constants and structures are in `_generated`.

ctypes releases the interpreter lock in every call, so other Python threads run meanwhile.
"""

from __future__ import annotations

import ctypes
import difflib
import functools
import sys
import time
import weakref
from collections.abc import Iterable
from ctypes import POINTER, byref, c_char_p, c_double, c_float, c_int32, c_size_t, c_uint32, c_uint64, c_void_p
from pathlib import Path
from typing import TYPE_CHECKING, Any, Callable, TypeVar

from . import _generated
from ._generated import ERROR_SIZE, Status

FOLDER = Path(__file__).resolve().parent
MODEL = FOLDER / "umo-people.safetensors"

MAX_CHANNELS = 64
MAX_BATCH = 64


class Error(RuntimeError):
    """A failed call: its text comes from umo, and `status` is the kind of error."""

    def __init__(self, status: int, text: str) -> None:
        super().__init__(text)
        self.status = Status(status) if status in Status.__members__.values() else status

    def __reduce__(self) -> tuple[Any, ...]:
        return Error, (int(self.status), str(self))


_U32, _SIZE, _TEXT, _HANDLE = c_uint32, c_size_t, c_char_p, c_void_p
_OUT = POINTER(c_void_p)
# Arguments of each function. Functions not in _RESULTS return a status.
_ARGUMENTS: dict[str, list[Any]] = {
    "umo_abi_version": [],
    "umo_version": [],
    "umo_status_message": [c_int32],
    "umo_last_error": [],
    "umo_joint_name": [_U32],
    "umo_viseme_name": [_U32],
    "umo_figure_name": [_U32],
    "umo_recording_gains": [POINTER(c_float), _SIZE, _U32, _U32, POINTER(c_float)],
    "umo_clip_write": [POINTER(_generated.Clip), _U32, POINTER(_generated.Output)],
    "umo_model_config_init": [POINTER(_generated.ModelConfig), _SIZE],
    "umo_model_load": [_U32, _TEXT, POINTER(_generated.ModelConfig), _OUT],
    "umo_model_load_memory": [_U32, _HANDLE, _SIZE, POINTER(_generated.ModelConfig), _OUT],
    "umo_model_free": [_HANDLE],
    "umo_model_get_info": [_HANDLE, POINTER(_generated.ModelInfo)],
    "umo_model_get_text": [_HANDLE, _U32, POINTER(_TEXT)],
    "umo_model_get_channel_name": [_HANDLE, _U32, POINTER(_TEXT)],
    "umo_model_get_skeleton": [_HANDLE, _U32, POINTER(c_int32), POINTER(c_float), _SIZE],
    "umo_model_encode_text": [_HANDLE, _TEXT, _SIZE, POINTER(_U32), _SIZE, POINTER(_SIZE)],
    "umo_self_test": [_HANDLE, POINTER(_U32), _TEXT, _SIZE],
    "umo_frame_layout_init": [POINTER(_generated.FrameLayout), _SIZE, _HANDLE],
    "umo_engine_config_init": [POINTER(_generated.EngineConfig), _SIZE],
    "umo_engine_new": [_HANDLE, POINTER(_generated.EngineConfig), _OUT],
    "umo_engine_free": [_HANDLE],
    "umo_engine_set_late_limit": [_HANDLE, c_double],
    "umo_engine_poll": [_HANDLE, _U32, POINTER(_U32)],
    "umo_engine_add_gesture": [_HANDLE, _TEXT, POINTER(_generated.GestureClip)],
    "umo_engine_add_gesture_file": [_HANDLE, _TEXT, _TEXT, _TEXT, _U32, c_float],
    "umo_engine_add_gesture_memory": [_HANDLE, _TEXT, _HANDLE, _SIZE, _TEXT, _U32, c_float],
    "umo_engine_set_word_rules": [_HANDLE, _TEXT, _TEXT],
    "umo_engine_get_gesture_name": [_HANDLE, _U32, POINTER(_TEXT)],
    "umo_gesture_options_init": [POINTER(_generated.GestureOptions), _SIZE],
    "umo_gesture_clip_init": [POINTER(_generated.GestureClip), _SIZE],
    "umo_parameter_get_info": [_U32, POINTER(_generated.ParameterInfo)],
    "umo_session_config_init": [POINTER(_generated.SessionConfig), _SIZE, _HANDLE],
    "umo_session_memory": [_HANDLE, POINTER(_generated.SessionConfig), POINTER(_SIZE), POINTER(_SIZE)],
    "umo_session_new": [_HANDLE, POINTER(_generated.SessionConfig), _OUT],
    "umo_session_free": [_HANDLE],
    "umo_session_last_error": [_HANDLE, _TEXT, _SIZE, POINTER(_SIZE)],
    "umo_session_push_audio": [_HANDLE, c_void_p, _SIZE, POINTER(_SIZE)],
    "umo_session_push_audio_i16": [_HANDLE, c_void_p, _SIZE, POINTER(_SIZE)],
    "umo_session_push_other_audio": [_HANDLE, c_void_p, _SIZE],
    "umo_session_finish": [_HANDLE],
    "umo_session_interrupt": [_HANDLE, _U32],
    "umo_session_reset": [_HANDLE],
    "umo_session_pull_frames": [_HANDLE, POINTER(_generated.FrameLayout), c_void_p, _SIZE, POINTER(_SIZE)],
    "umo_session_ready_frames": [_HANDLE, POINTER(_SIZE)],
    "umo_session_arousal": [_HANDLE, POINTER(ctypes.c_float), POINTER(ctypes.c_float)],
    "umo_session_is_done": [_HANDLE, POINTER(_U32)],
    "umo_session_state_size": [_HANDLE, POINTER(_SIZE)],
    "umo_session_save": [_HANDLE, c_void_p, _SIZE, POINTER(_SIZE)],
    "umo_session_restore": [_HANDLE, c_void_p, _SIZE],
    "umo_session_set_clock": [_HANDLE, c_double],
    "umo_session_sample_pose": [_HANDLE, c_double, POINTER(_generated.FrameLayout), c_void_p, _SIZE, POINTER(_generated.Sampled)],
    "umo_session_set_prompt": [_HANDLE, _TEXT, _SIZE],
    "umo_session_set_prompt_ids": [_HANDLE, POINTER(_U32), _SIZE],
    "umo_session_set_seed": [_HANDLE, c_uint64],
    "umo_session_look_at": [_HANDLE, _U32, POINTER(c_float), c_float],
    "umo_session_set_mood": [_HANDLE, _U32, c_float],
    "umo_session_hint_lips": [_HANDLE, _U32, c_double, c_double],
    "umo_session_hint_words": [_HANDLE, _TEXT, c_double, c_double],
    "umo_session_play_gesture": [_HANDLE, _TEXT, POINTER(_generated.GestureOptions)],
    "umo_session_set_parameter": [_HANDLE, _U32, c_double],
    "umo_session_get_parameter": [_HANDLE, _U32, POINTER(c_double)],
    "umo_session_latency": [_HANDLE, POINTER(_generated.RawLatency)],
    "umo_session_stats": [_HANDLE, POINTER(_generated.RawStats)],
    "umo_session_packet_size": [_HANDLE, POINTER(_SIZE)],
    "umo_session_pull_packets": [_HANDLE, c_void_p, _SIZE, POINTER(_SIZE), _SIZE, POINTER(_SIZE)],
    "umo_decoder_new": [_HANDLE, POINTER(_generated.SessionConfig), _OUT],
    "umo_decoder_push_packet": [_HANDLE, c_void_p, _SIZE],
    "umo_decoder_stats": [_HANDLE, POINTER(_generated.RawReceived)],
    "umo_take_new": [c_void_p, _SIZE, _OUT],
    "umo_take_free": [_HANDLE],
    "umo_take_get_info": [_HANDLE, POINTER(_generated.RawTakeInfo)],
    "umo_decoder_new_of_take": [_HANDLE, _HANDLE, POINTER(_generated.SessionConfig), _OUT],
    "umo_decoder_push_take": [_HANDLE, POINTER(_U32)],
    "umo_session_take_size": [_HANDLE, POINTER(_SIZE)],
    "umo_session_take": [_HANDLE, c_void_p, _SIZE, POINTER(_SIZE)],
    "umo_rig_init": [POINTER(_generated.Rig), _SIZE],
    "umo_retarget_new": [_HANDLE, POINTER(_generated.Rig), _OUT],
    "umo_retarget_free": [_HANDLE],
    "umo_retarget_get_joints": [_HANDLE, _U32, POINTER(c_int32)],
    "umo_retarget_set_step": [_HANDLE, c_float],
    "umo_retarget_apply": [_HANDLE, POINTER(c_float), POINTER(c_float), _U32, POINTER(c_float), POINTER(c_float)],
    "umo_place_init": [POINTER(_generated.Place), _SIZE],
    "umo_scene_new": [c_uint64, _OUT],
    "umo_scene_free": [_HANDLE],
    "umo_scene_add": [_HANDLE, _HANDLE, POINTER(_generated.Place), POINTER(_U32)],
    "umo_scene_remove": [_HANDLE, _U32],
    "umo_scene_set_place": [_HANDLE, _U32, POINTER(_generated.Place)],
    "umo_scene_set_target": [_HANDLE, _U32, _U32, _U32, POINTER(c_float)],
    "umo_scene_set_allowed": [_HANDLE, _U32, _U32],
    "umo_scene_push_audio": [_HANDLE, _U32, c_void_p, _SIZE],
    "umo_scene_update": [_HANDLE, c_double],
    "umo_scene_floor": [_HANDLE, POINTER(_U32)],
    "umo_scene_member": [_HANDLE, _U32, POINTER(_generated.Member)],
    "umo_scene_state_size": [_HANDLE, POINTER(_SIZE)],
    "umo_scene_save": [_HANDLE, c_void_p, _SIZE, POINTER(_SIZE)],
    "umo_scene_restore": [_HANDLE, c_void_p, _SIZE],
    "umo_scene_last_error": [_HANDLE, _TEXT, _SIZE, POINTER(_SIZE)],
}
_RESULTS = {
    "umo_abi_version": _U32,
    "umo_version": _TEXT,
    "umo_status_message": _TEXT,
    "umo_last_error": _TEXT,
    "umo_joint_name": _TEXT,
    "umo_viseme_name": _TEXT,
    "umo_figure_name": _TEXT,
}


def _refuse_stranger() -> None:
    """Fails if another package has overwritten this one: PyPI's `umo` is another project with the same folder name.
    Installed after this one, its files replace some of these; uninstalled, it removes them."""
    package = sys.modules[__name__.rpartition(".")[0]]
    if not hasattr(package, "_DISTRIBUTION"):
        found = getattr(package, "__file__", None) or "a folder without __init__.py"
        raise ImportError(
            f"the module umo is not that of umo-avatar, but {found}: run `pip uninstall umo umo-avatar`, then install umo-avatar again"
        )


def _open() -> ctypes.CDLL:
    _refuse_stranger()
    name = {"win32": "umo.dll", "darwin": "libumo.dylib"}.get(sys.platform, "libumo.so")
    library = ctypes.CDLL(str(FOLDER / name))
    for function, arguments in _ARGUMENTS.items():
        entry = getattr(library, function)
        entry.argtypes, entry.restype = arguments, _RESULTS.get(function, c_int32)
    return library


lib: Any = _open()


def error(status: int, detail: str = "") -> Error:
    """The exception for a failure: the detail, or the status's description if there is none."""
    return Error(status, detail or lib.umo_status_message(status).decode())


def check(status: int) -> None:
    """Raises if a call without a session failed."""
    if status != Status.OK:
        raise error(status, lib.umo_last_error().decode())


def check_session(handle: int, status: int) -> None:
    """Raises if a call on a session failed."""
    if status != Status.OK:
        raise error(status, _detail(lib.umo_session_last_error, handle))


def check_scene(handle: int, status: int) -> None:
    """Raises if a call on a scene failed."""
    if status != Status.OK:
        raise error(status, _detail(lib.umo_scene_last_error, handle))


def _detail(last_error: Callable[[int, Any, int, None], int], handle: int) -> str:
    text = ctypes.create_string_buffer(ERROR_SIZE)
    return text.value.decode() if last_error(handle, text, ERROR_SIZE, None) == Status.OK else ""


def filled(kind: Any, fill: Callable[[Any], int]) -> Any:
    """A structure written by a call, with `struct_size` set before."""
    structure = kind(struct_size=ctypes.sizeof(kind))
    check(fill(byref(structure)))
    return structure


def suggestion(name: str, among: Iterable[str]) -> str:
    """Suggests the nearest of some names, or lists all if none is near."""
    among = sorted(among)
    near = difflib.get_close_matches(name, among, 1)
    if near:
        return f"did you mean {near[0]!r}?"
    return f"expected one of {', '.join(among)}" if among else "it has no attributes that can be set"


class Strict:
    """Refuses attributes that its class does not declare, as a misspelt setting would be lost silently.

    Declared are settable properties and annotated names; names that start with `_` are free.
    """

    # Hidden from type checkers, which would allow any name otherwise.
    if not TYPE_CHECKING:

        def __setattr__(self, name, value):
            kind = type(self)
            if not (name.startswith("_") or name in settable(kind)):
                problem = "cannot set" if hasattr(kind, name) else "has no attribute"
                raise AttributeError(f"umo.{kind.__name__} {problem} {name!r}: {suggestion(name, settable(kind))}")
            super().__setattr__(name, value)


@functools.lru_cache(maxsize=None)
def settable(kind: type) -> frozenset[str]:
    """Names of attributes that can be set from outside. A subclass adds its own, annotated or with a value."""
    names: set[str] = set()
    for base in kind.__mro__:
        names |= set(getattr(base, "__annotations__", ()))
        for name, value in vars(base).items():
            writes = value.fset is not None if isinstance(value, property) else hasattr(type(value), "__set__")
            if writes or (base.__module__.split(".")[0] != "umo" and not callable(value)):
                names.add(name)
    return frozenset(name for name in names if not name.startswith("_"))


def chosen(what: str, among: dict[str, int], name: str) -> int:
    """The value of a name."""
    if name not in among:
        raise ValueError(f"{what} {name!r}: {suggestion(name, among)}")
    return among[name]


def fitting(name: str, value: int, kind: Any) -> int:
    """Checks that a number fits its C type: ctypes would truncate it."""
    bits = 8 * ctypes.sizeof(kind)
    if not 0 <= value < 1 << bits:
        raise ValueError(f"{name} {value}: expected a whole number of {bits} bits, not negative")
    return value


def set_fields(config: Any, **values: Any) -> None:
    """Sets the values that are not None."""
    kinds = dict(config._fields_)
    for name, value in values.items():
        if isinstance(value, int):
            fitting(name, value, kinds[name])
        if value is not None:
            setattr(config, name, value)


def set_values(config: Any, **values: Any) -> None:
    """Sets the values that are not None: named values by their names, times in seconds."""
    for name, value in values.items():
        if isinstance(value, str):
            value = chosen(name, config.choices[name], value)
        elif name.endswith("_ms") and value is not None:
            value = round(value * 1e3)
        set_fields(config, **{name: value})


def _free(free: Callable[[int], int], handle: int) -> None:
    # Another thread is in a call on it, which ends soon.
    while free(handle) == Status.BUSY:
        time.sleep(0.0005)


Self = TypeVar("Self", bound="Handle")


class Handle(Strict):
    """An object of the library, freed when it is closed, at the end of `with`, when garbage-collected, or at exit."""

    def __init__(self, handle: int, free: Callable[[int], int]) -> None:
        self._handle = handle
        self._finalizer = weakref.finalize(self, _free, free, handle)

    def close(self) -> None:
        """Frees it. Later calls on it fail with an error that says so."""
        self._finalizer()

    def __enter__(self: Self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
