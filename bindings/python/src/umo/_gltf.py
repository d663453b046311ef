"""`.glb` and `.vrma`, written by the library as in `umo animate`."""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING, Any, Optional

import numpy as np

from . import _generated, _library
from ._generated import JOINT_COUNT
from ._library import lib
from ._names import is_arkit

if TYPE_CHECKING:
    from ._motion import Motion


def _figures() -> tuple[str, ...]:
    names: list[str] = []
    while (name := lib.umo_figure_name(len(names))) is not None:
        names.append(name.decode())
    return tuple(names)


FIGURES = _figures()


def glb(motion: Motion, figure: Optional[str]) -> bytes:
    """glTF 2.0: the skeleton with a figure and its face, or, with None, bones only."""
    return _written(motion, "glb", figure)


def vrma(motion: Motion) -> bytes:
    """VRM Animation 1.0, for any VRM avatar."""
    return _written(motion, "vrma", None)


def _written(motion: Motion, format: str, figure: Optional[str]) -> bytes:
    if motion.skeleton is None:
        raise ValueError(f"{format} needs a skeleton, which only a Motion from umo has; save .npz or .csv")
    parents, offsets = (np.ascontiguousarray(values, kind) for values, kind in zip(motion.skeleton, (np.int32, np.float32)))
    if parents.shape != (JOINT_COUNT,) or offsets.shape != (JOINT_COUNT, 3):
        raise ValueError(f"a skeleton is parents [55] and offsets [55, 3], not {parents.shape} and {offsets.shape}")
    names = (ctypes.c_char_p * len(motion.names))(*(name.encode() for name in motion.names))
    frames = _packed(motion)
    fields = {name: place for name, (_, place) in (frames.dtype.fields or {}).items()}
    layout = _generated.FrameLayout(
        struct_size=ctypes.sizeof(_generated.FrameLayout),
        axes=_generated.AXES["gltf"],
        frame_stride=frames.dtype.itemsize,
        index=_generated.ABSENT,
        sample=_generated.ABSENT,
        translation=fields["translation"],
        rotations=fields["rotations"],
        rotation_stride=16,
        channels=fields["face"],
        channel_stride=4,
        visemes=_generated.ABSENT,
    )
    clip = _generated.Clip(
        struct_size=ctypes.sizeof(_generated.Clip),
        is_arkit=is_arkit(motion.names),
        channel_count=len(motion.names),
        frame_count=len(motion),
        rate=motion.rate,
        channels=names,
        parents=parents.ctypes.data_as(ctypes.POINTER(ctypes.c_int32)),
        offsets=offsets.ctypes.data_as(ctypes.POINTER(ctypes.c_float)),
        layout=ctypes.pointer(layout),
        frames=frames.ctypes.data,
        figure=None if figure is None else figure.encode(),
    )
    return _output(clip, _generated.FORMATS[format])


def _packed(motion: Motion) -> Any:
    """Packs the frames tightly: a slice may have gaps."""
    kinds = [("translation", "f4", 3), ("rotations", "f4", (JOINT_COUNT, 4)), ("face", "f4", (len(motion.names),))]
    frames = np.empty(len(motion), kinds)
    for name, _, _ in kinds:
        frames[name] = getattr(motion, name)
    return frames


def _output(clip: Any, format: int) -> bytes:
    parts: list[bytes] = []
    errors: list[MemoryError] = []

    def write(_: Any, start: int, size: int) -> int:
        # ctypes would print an exception and continue: keep it, and raise it after the call.
        try:
            parts.append(ctypes.string_at(start, size))
        except MemoryError as error:
            errors.append(error)
        return len(errors)

    output = _generated.Output(write=_generated.OutputWrite(write))
    status = lib.umo_clip_write(clip, format, output)
    if errors:
        raise errors[0]
    if status == _generated.Status.INVALID_ARGUMENT:
        raise ValueError(lib.umo_last_error().decode())
    _library.check(status)
    return b"".join(parts)
