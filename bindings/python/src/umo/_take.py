"""Takes: motions that were recorded, to be played again."""

from __future__ import annotations

import ctypes
from ctypes import byref

from . import _generated, _library
from ._generated import TakeInfo
from ._library import lib


class Take(_library.Handle):
    """A motion that was recorded: its chunks, and what its host asked for. `Decoder(model, take=...)` plays it, without
    the audio and without the language model.

    `data` are the bytes of a `.umo` file: of `umo animate`, or of `Session.take`. Damaged ones raise `umo.Error` with
    `Status.TAKE`.
    """

    def __init__(self, data: bytes) -> None:
        handle = ctypes.c_void_p()
        self._data = bytes(data)
        _library.check(lib.umo_take_new(self._data, len(self._data), byref(handle)))
        super().__init__(handle.value or 0, lib.umo_take_free)

    @property
    def data(self) -> bytes:
        """The bytes of its file."""
        return self._data

    @property
    def info(self) -> TakeInfo:
        """What it says of itself."""
        info = _generated.RawTakeInfo(struct_size=ctypes.sizeof(_generated.RawTakeInfo))
        _library.check(lib.umo_take_get_info(self._handle, info))
        return TakeInfo(*(int(getattr(info, name)) for name in TakeInfo._fields))
