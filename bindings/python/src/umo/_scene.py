"""Scenes: avatars that know each other, and people with microphones."""

from __future__ import annotations

import ctypes
from collections.abc import Iterable
from ctypes import byref
from typing import NamedTuple, Optional, Union

import numpy as np
import numpy.typing as npt

from . import _generated, _library
from ._generated import Role
from ._library import lib
from ._session import Session, audio


class Member(NamedTuple):
    """State of a member of a scene."""

    role: Role
    """Whether it speaks, listens, or neither."""
    attends_to: Optional[int]
    """Whom it attends to; None for nobody, and for a point."""
    is_contact: bool
    """Whether it looks there now, rather than past."""
    nods: int
    """Nods so far."""
    brows: int
    """Brow raises so far."""
    smiles: int
    """Half smiles so far."""
    yielding: float
    """1 while it yields to who interrupts it, else 0."""
    level: float
    """Level of its voice, root mean square, full scale 1."""


class Scene(_library.Handle):
    """Avatars that know each other, and people with microphones: up to 32 members, each a number from 1 on.

    It hears who speaks, decides who has the floor, and tells each session whom to look at and when to nod. Call
    `update` once per frame, before frames are pulled or sampled. Equal seeds, voices and times of updates give equal
    frames. Positions and angles are in `axes`: `"gltf"` (and Godot), `"unreal"` or `"unity"`.
    """

    def __init__(self, seed: int = 0, *, axes: str = "gltf") -> None:
        self._axes = _library.chosen("axes", _generated.AXES, axes)
        handle = ctypes.c_void_p()
        _library.check(lib.umo_scene_new(_library.fitting("seed", seed, ctypes.c_uint64), byref(handle)))
        super().__init__(handle.value or 0, lib.umo_scene_free)
        # A session that is collected would leave the scene.
        self._sessions: dict[int, Session] = {}

    def _check(self, status: int) -> None:
        _library.check_scene(self._handle, status)

    def _place(self, position: npt.ArrayLike, facing: float, eye_height: Optional[float]) -> _generated.Place:
        place = _generated.Place()
        _library.check(lib.umo_place_init(byref(place), ctypes.sizeof(place)))
        place.axes, place.facing = self._axes, facing
        place.position = tuple(_point(position))
        # The default height is in metres.
        units = 100.0 if self._axes == _generated.AXES["unreal"] else 1.0
        place.eye_height = place.eye_height * units if eye_height is None else eye_height
        return place

    def add(
        self,
        session: Optional[Session] = None,
        position: npt.ArrayLike = (0.0, 0.0, 0.0),
        facing: float = 0.0,
        eye_height: Optional[float] = None,
    ) -> int:
        """Adds an avatar, or without a session a person whose voice comes by `push`, and returns its number.

        `position` is on the floor. `facing` is an angle about the upward axis in radians; 0 is the axis along which an
        avatar looks, positive is to its left in glTF's axes and to its right in Unity's and Unreal's. `eye_height` is
        above the position, 1.6 m if not given. A session may be in one scene at a time.
        """
        place, member = self._place(position, facing, eye_height), ctypes.c_uint32()
        handle = None if session is None else session._handle
        self._check(lib.umo_scene_add(self._handle, handle, byref(place), byref(member)))
        if session is not None:
            self._sessions[member.value] = session
        return member.value

    def remove(self, member: int) -> None:
        """Removes a member. Its session goes on alone."""
        self._check(lib.umo_scene_remove(self._handle, _number(member)))
        self._sessions.pop(member, None)

    def set_place(
        self, member: int, position: npt.ArrayLike, facing: float = 0.0, eye_height: Optional[float] = None
    ) -> None:
        """Moves a member: as in `add`."""
        place = self._place(position, facing, eye_height)
        self._check(lib.umo_scene_set_place(self._handle, _number(member), byref(place)))

    def set_target(self, member: int, target: Union[int, npt.ArrayLike, None]) -> None:
        """Makes a member look at another member or at a point of the scene, whatever is said; None ends it."""
        other, point = 0, None
        if isinstance(target, int):
            other = _number(target)
        elif target is not None:
            point = _point(target).ctypes.data_as(ctypes.POINTER(ctypes.c_float))
        self._check(lib.umo_scene_set_target(self._handle, _number(member), other, self._axes, point))

    def set_allowed(self, member: int, parts: Iterable[str]) -> None:
        """Sets the parts that the scene plays of a member, of `look`, `nod`, `smile`, `mirror` and `yield`; all at first."""
        bits = sum({_library.chosen("part", _generated.SCENE_PARTS, part) for part in parts})
        self._check(lib.umo_scene_set_allowed(self._handle, _number(member), bits))

    def push(self, member: int, samples: npt.ArrayLike) -> None:
        """Pushes the voice of a member without a session, of any rate and number of channels; any thread may.

        Floats of full scale 1, or int16. Only the loudness is used.
        """
        array = audio(samples)
        if array.dtype == np.int16:
            array = array.astype(np.float32) / 32768
        self._check(lib.umo_scene_push_audio(self._handle, _number(member), array.ctypes.data, array.size))

    def update(self, seconds: float) -> None:
        """Advances the scene: once per frame, before frames are pulled or sampled."""
        self._check(lib.umo_scene_update(self._handle, seconds))

    @property
    def floor(self) -> Optional[int]:
        """The member that has the floor; None if nobody has."""
        member = ctypes.c_uint32()
        self._check(lib.umo_scene_floor(self._handle, byref(member)))
        return member.value or None

    def member(self, member: int) -> Member:
        """State of a member."""
        raw = _generated.Member(struct_size=ctypes.sizeof(_generated.Member))
        self._check(lib.umo_scene_member(self._handle, _number(member), byref(raw)))
        return Member(
            Role(raw.role),
            raw.attends_to or None,
            bool(raw.is_contact),
            raw.nods,
            raw.brows,
            raw.smiles,
            raw.yielding,
            raw.level,
        )

    def save(self) -> bytes:
        """The complete state of the scene and of its members' sessions."""
        size = ctypes.c_size_t()
        self._check(lib.umo_scene_state_size(self._handle, byref(size)))
        state = ctypes.create_string_buffer(size.value)
        self._check(lib.umo_scene_save(self._handle, state, size, byref(size)))
        return state.raw[: size.value]

    def restore(self, state: bytes) -> None:
        """Restores a state of this scene, or of one to which the same members were added in the same order."""
        self._check(lib.umo_scene_restore(self._handle, bytes(state), len(state)))

    def close(self) -> None:
        """Frees the scene; its sessions go on alone."""
        super().close()
        self._sessions.clear()


def _number(member: int) -> int:
    return _library.fitting("member", member, ctypes.c_uint32)


def _point(values: npt.ArrayLike) -> npt.NDArray[np.float32]:
    point = np.ascontiguousarray(values, np.float32)
    if point.shape != (3,):
        raise ValueError(f"a point of shape {point.shape}: expected 3 coordinates")
    return point
