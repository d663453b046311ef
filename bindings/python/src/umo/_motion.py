"""Frames as numpy arrays."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Optional, Union, overload

import numpy as np
import numpy.typing as npt

from . import _generated, _library, _save
from ._gltf import FIGURES
from ._library import lib
from ._names import JOINTS, VISEMES

Floats = npt.NDArray[np.float32]
# Parent of each joint [55], and rest position in the parent's frame [55, 3].
Skeleton = tuple[npt.NDArray[np.int32], Floats]


@dataclass(frozen=True, eq=False)
class Frame:
    """One pose."""

    index: int
    """Index of the frame since the start or the last reset."""
    sample: int
    """Sample (per channel) of the pushed audio that the frame belongs to."""
    time: float
    """Seconds: `index` over the frame rate."""
    translation: Floats
    """[3]: position of the root."""
    rotations: Floats
    """[55, 4]: rotation of each joint of `umo.JOINTS` in its parent's frame, unit quaternions x y z w."""
    face: Floats
    """[C]: values of `Model.channels`."""
    visemes: Optional[Floats]
    """[15]: weight of each of `umo.VISEMES`; None if the model has no ARKit channels."""


class Motion(_library.Strict):
    """Consecutive frames: arrays that are views of one block of memory."""

    frames: npt.NDArray[Any]
    """The structured array: fields index, sample, translation, rotations, face and, with ARKit channels, visemes."""
    rate: int
    """Frames per second."""
    names: tuple[str, ...]
    """Names of the face channels."""
    axes: str
    """Axes and units: `"gltf"`, `"unreal"` or `"unity"`."""
    skeleton: Optional[Skeleton]
    """`Model.skeleton` in those axes; None if the motion was created without one."""

    def __init__(
        self,
        frames: npt.NDArray[Any],
        rate: int,
        names: tuple[str, ...],
        *,
        axes: str = "gltf",
        skeleton: Optional[Skeleton] = None,
    ) -> None:
        self.frames = frames
        self.rate = rate
        self.names = names
        self.axes = axes
        self.skeleton = skeleton

    @property
    def index(self) -> npt.NDArray[np.uint64]:
        """[T]: indices of the frames since the start or the last reset."""
        return self.frames["index"]

    @property
    def sample(self) -> npt.NDArray[np.uint64]:
        """[T]: samples of the pushed audio that the frames belong to."""
        return self.frames["sample"]

    @property
    def times(self) -> npt.NDArray[np.float64]:
        """[T]: seconds."""
        return self.index / float(self.rate)

    @property
    def translation(self) -> Floats:
        """[T, 3]: positions of the root."""
        return self.frames["translation"]

    @property
    def rotations(self) -> Floats:
        """[T, 55, 4]: rotation of each joint of `umo.JOINTS` in its parent's frame, unit quaternions x y z w."""
        return self.frames["rotations"]

    @property
    def face(self) -> Floats:
        """[T, C]: values of the channels `names`."""
        return self.frames["face"]

    @property
    def visemes(self) -> Optional[Floats]:
        """[T, 15]: weight of each of `umo.VISEMES`; None if the model has no ARKit channels."""
        return self.frames["visemes"] if "visemes" in (self.frames.dtype.names or ()) else None

    def channel(self, name: str) -> Floats:
        """[T]: one face channel, such as `jawOpen`."""
        if name not in self.names:
            raise KeyError(f"{name}: the model's channels are {', '.join(self.names)}")
        return self.face[:, self.names.index(name)]

    def joint(self, name: str) -> Floats:
        """[T, 4]: one joint's rotations."""
        if name not in JOINTS:
            raise KeyError(f"{name}: the joints are {', '.join(JOINTS)}")
        return self.rotations[:, JOINTS.index(name)]

    def save(self, path: Union[str, os.PathLike[str]], *, figure: Optional[str] = FIGURES[0]) -> None:
        """Writes the frames like `umo animate`; the suffix selects the format, and the first frame is at second 0.

        `.npz` are SMPL-X arrays, with an ARKit face as `arkit`; `.bvh` is the skeleton; `.glb` is the skeleton with
        `figure`, one of `umo.FIGURES`, and its face, or, with None, bones only; `.vrma` is for VRM avatars; `.csv` is
        the face (ARKit channels) and the head's angles, as recorded by Live Link Face; `.jsonl` is everything, one
        frame per line. A failed write leaves no partial file. Raises `ValueError` for an unknown suffix or figure, an
        empty motion, or axes other than glTF's.
        """
        _save.save(self, path, figure)

    def __len__(self) -> int:
        return len(self.frames)

    def __iter__(self) -> Iterator[Frame]:
        return (self[i] for i in range(len(self)))

    @overload
    def __getitem__(self, key: int) -> Frame: ...
    @overload
    def __getitem__(self, key: slice) -> Motion: ...
    def __getitem__(self, key: Union[int, slice]) -> Union[Frame, Motion]:
        if isinstance(key, slice):
            return Motion(self.frames[key], self.rate, self.names, axes=self.axes, skeleton=self.skeleton)
        frame = self.frames[key]
        return Frame(
            int(frame["index"]),
            int(frame["sample"]),
            int(frame["index"]) / self.rate,
            frame["translation"],
            frame["rotations"],
            frame["face"],
            frame["visemes"] if self.visemes is not None else None,
        )

    def __repr__(self) -> str:
        return f"<umo.Motion: {len(self)} frames of {len(JOINTS)} joints and {len(self.names)} face channels>"


class Layout:
    """Layout in which the library writes frames, and the same for numpy."""

    def __init__(self, model: Any, axes: str) -> None:
        layout = _generated.FrameLayout()
        _library.check(lib.umo_frame_layout_init(layout, ctypes.sizeof(layout), model._handle))
        layout.axes = _library.chosen("axes", _generated.AXES, axes)
        self.raw = layout
        self.rate = model.frame_rate
        self.names = model.channels
        self.axes = axes
        self.skeleton = model.skeleton(axes)
        fields = {
            "index": (np.uint64, layout.index),
            "sample": (np.uint64, layout.sample),
            "translation": ((np.float32, 3), layout.translation),
            "rotations": ((np.float32, (_generated.JOINT_COUNT, 4)), layout.rotations),
            "face": ((np.float32, len(self.names)), layout.channels),
            "visemes": ((np.float32, _generated.VISEME_COUNT), layout.visemes),
        }
        present = {name: field for name, field in fields.items() if field[1] != _generated.ABSENT}
        self.dtype = np.dtype(
            {
                "names": list(present),
                "formats": [kind for kind, _ in present.values()],
                "offsets": [offset for _, offset in present.values()],
                "itemsize": layout.frame_stride,
            }
        )

    def empty(self, count: int) -> npt.NDArray[Any]:
        """Memory for frames, zeroed so that padding bytes are always the same."""
        return np.zeros(count, self.dtype)

    def motion(self, frames: npt.NDArray[Any]) -> Motion:
        return Motion(frames, self.rate, self.names, axes=self.axes, skeleton=self.skeleton)

    def joined(self, parts: list[Motion]) -> Motion:
        """Joins several motions into one. Copied into this layout: numpy's own concatenation would remove the padding.
        """
        frames, start = self.empty(sum(map(len, parts))), 0
        for part in parts:
            frames[start : start + len(part)] = part.frames
            start += len(part)
        return self.motion(frames)
