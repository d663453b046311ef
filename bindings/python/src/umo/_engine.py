"""Engines: who computes."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from ctypes import byref
from typing import Any, Optional

from . import _library
from ._library import lib
from ._model import Model, default_model
from ._session import Session


class Engine(_library.Handle):
    """Computes the sessions of one model, on `threads` of its own, or, where `polled`, in `poll`.

    `model` is None for the one that comes with the package. `max_sessions` is how many there may be at once, `max_batch` how
    many are computed together; `cores` binds threads to processors. What is None is umo's default.
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
    ) -> None:
        self._model = model or default_model()
        config, handle = _library.EngineConfig(), ctypes.c_void_p()
        _library.check(lib.umo_engine_config_init(config, ctypes.sizeof(config)))
        mode = _library.ENGINE_POLLED if polled else _library.ENGINE_THREADS
        _library.set_fields(config, mode=mode, threads=threads, max_sessions=max_sessions, max_batch=max_batch)
        _library.set_fields(config, core_count=len(cores), cores=(ctypes.c_uint32 * len(cores))(*cores))
        _library.check(lib.umo_engine_new(self._model._handle, config, byref(handle)))
        super().__init__(handle.value or 0, lib.umo_engine_free)

    @property
    def model(self) -> Model:
        """What it computes with."""
        return self._model

    def session(self, rate: Optional[int] = None, channels: int = 1, **settings: Any) -> Session:
        """A session of this engine: the arguments are those of `Session`."""
        return Session(self, rate, channels, **settings)

    def poll(self, budget: Optional[float] = None) -> bool:
        """Computes in this thread until nothing is due, or for `budget` seconds and at most one layer's time longer.

        Whether there is more to do. For engines that were made `polled`.
        """
        more = ctypes.c_uint32()
        microseconds = 0xFFFF_FFFF if budget is None else min(max(round(budget * 1e6), 0), 0xFFFF_FFFF)
        _library.check(lib.umo_engine_poll(self._handle, microseconds, byref(more)))
        return bool(more.value)
