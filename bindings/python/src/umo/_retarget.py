"""Poses on other characters: bones of any skeleton, and arms that keep out of the body."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from ctypes import POINTER, byref
from typing import Any, Optional

import numpy as np
import numpy.typing as npt

from . import _generated, _library
from ._library import lib
from ._model import Model
from ._names import JOINTS

PARTS = ("pelvis", "belly", "chest", "neck", "head", "upper_arms", "forearms", "hands", "thighs")


class Retarget(_library.Handle):
    """A character that poses are put on.

    `names` are its bones, `parents` the index of each bone's parent (-1: none), `places` (bones x 3) and `rotations`
    (bones x 4, x y z w) their rest, in the character's space and not relative to parents, in `axes`: `"gltf"`,
    `"unreal"` or `"unity"`, which are those of the poses too. `joints` is the joint of each bone, -1 for none; without it,
    bones are found by name.

    `vertices` (points x 3) with `vertex_bones`, the bone that has at least half of each point's weight (-1: none), and
    `indices` (triangles x 3) are its mesh at rest; without a mesh the body has a person's proportions. `gain` is the
    strength of the body's volume, 0 to 1. `girths` are factors of the measured girth of `pelvis`, `belly`, `chest`,
    `neck`, `head`, `upper_arms`, `forearms`, `hands` and `thighs`.
    """

    def __init__(
        self,
        model: Model,
        names: Sequence[str],
        parents: npt.ArrayLike,
        places: npt.ArrayLike,
        rotations: npt.ArrayLike,
        *,
        joints: Optional[npt.ArrayLike] = None,
        axes: str = "gltf",
        gain: float = 1.0,
        girths: Optional[Mapping[str, float]] = None,
        vertices: Optional[npt.ArrayLike] = None,
        vertex_bones: Optional[npt.ArrayLike] = None,
        indices: Optional[npt.ArrayLike] = None,
    ) -> None:
        rig, count = _generated.Rig(), len(names)
        _library.check(lib.umo_rig_init(byref(rig), ctypes.sizeof(rig)))
        rig.axes, rig.gain, rig.bone_count = _library.chosen("axes", _generated.AXES, axes), gain, count
        for part, factor in (girths or {}).items():
            rig.girths[_library.chosen("girth", {name: at for at, name in enumerate(PARTS)}, part)] = factor
        texts = (ctypes.c_char_p * count)(*(name.encode() for name in names))
        rig.names = ctypes.cast(texts, POINTER(ctypes.c_char_p))
        # Kept until the call returns.
        kept: list[Any] = [texts]
        given: dict[str, tuple[Optional[npt.ArrayLike], Any, Any, tuple[int, ...]]] = {
            "parents": (parents, np.int32, ctypes.c_int32, (count,)),
            "joints": (joints, np.int32, ctypes.c_int32, (count,)),
            "places": (places, np.float32, ctypes.c_float, (count, 3)),
            "rotations": (rotations, np.float32, ctypes.c_float, (count, 4)),
        }
        if vertices is not None:
            if vertex_bones is None:
                raise ValueError("vertices: expected vertex_bones too")
            points = len(np.asarray(vertices))
            rig.vertex_count = points
            given["vertices"] = (vertices, np.float32, ctypes.c_float, (points, 3))
            given["vertex_bones"] = (vertex_bones, np.int32, ctypes.c_int32, (points,))
        if indices is not None:
            triangles = np.asarray(indices)
            if triangles.size and int(triangles.min()) < 0:
                raise ValueError("indices: expected whole numbers, not negative")
            rig.index_count = triangles.size
            given["indices"] = (triangles.reshape(-1), np.uint32, ctypes.c_uint32, (triangles.size,))
        for name, (values, kind, ctype, shape) in given.items():
            if values is None:
                continue
            array: Any = np.ascontiguousarray(values, dtype=kind)
            if array.shape != shape:
                raise ValueError(f"{name}: shape {array.shape}, expected {shape}")
            kept.append(array)
            setattr(rig, name, array.ctypes.data_as(POINTER(ctype)))
        handle = ctypes.c_void_p()
        _library.check(lib.umo_retarget_new(model._handle, byref(rig), byref(handle)))
        del kept
        super().__init__(handle.value or 0, lib.umo_retarget_free)
        self._bones = count

    @property
    def joints(self) -> npt.NDArray[np.int32]:
        """Joint that each bone follows, -1 for a bone that keeps its rest rotation."""
        joints = np.empty(self._bones, np.int32)
        _library.check(lib.umo_retarget_get_joints(self._handle, self._bones, joints.ctypes.data_as(POINTER(ctypes.c_int32))))
        return joints

    def set_step(self, seconds: float) -> None:
        """Sets the seconds from the last pose to the next; 1/30 at first."""
        _library.check(lib.umo_retarget_set_step(self._handle, seconds))

    def apply(
        self, rotations: npt.ArrayLike, translation: npt.ArrayLike
    ) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
        """Puts a pose, 55 x 4 rotations and a translation, on the character.

        Returns the rotation of each bone relative to its parent, bones x 4, and the place of the bone of joint 0 in the
        character's space.
        """
        turns, at = np.ascontiguousarray(rotations, np.float32), np.ascontiguousarray(translation, np.float32)
        if turns.shape != (len(JOINTS), 4) or at.shape != (3,):
            raise ValueError(f"rotations {turns.shape} and translation {at.shape}: expected ({len(JOINTS)}, 4) and (3,)")
        turned, place = np.empty((self._bones, 4), np.float32), np.empty(3, np.float32)
        pointers = [array.ctypes.data_as(POINTER(ctypes.c_float)) for array in (turns, at, turned, place)]
        _library.check(
            lib.umo_retarget_apply(self._handle, pointers[0], pointers[1], self._bones, pointers[2], pointers[3])
        )
        return turned, place
