"""Models."""

from __future__ import annotations

import ctypes
import errno
import functools
import os
import warnings
from ctypes import byref
from typing import Any, NamedTuple, Union

import numpy as np
import numpy.typing as npt

from . import _generated, _library
from ._library import lib


class Model(_library.Handle):
    """A loaded model: immutable, shared by any number of engines and threads.

    `source` is a path, the bytes of a model file, or None for the model that comes with the package; a missing file
    raises `FileNotFoundError`. `precision` is `"stored"`, `"f32"`, `"bf16"` or `"int8"`; `isa` limits the
    instruction set: `"best"`, `"scalar"`, `"avx2"`, `"avxvnni"`, `"avx512vnni"`, `"avx512bf16"`, `"amx"`, `"neon"`,
    `"neon_dotprod"` or `"neon_i8mm"`; `"portable"` gives the same bits on every processor. `parts` is `"all"`, or
    `"mouth"` for the live mouth alone, in a fraction of the memory: sessions then need the voice `"mouth"`. A notice
    that users of the model must see is raised as a warning.
    """

    def __init__(
        self,
        source: Union[str, os.PathLike[str], bytes, bytearray, memoryview, None] = None,
        *,
        precision: str = "stored",
        isa: str = "best",
        parts: str = "all",
    ) -> None:
        config, handle = _generated.ModelConfig(), ctypes.c_void_p()
        _library.check(lib.umo_model_config_init(config, ctypes.sizeof(config)))
        _library.set_values(config, precision=precision, isa=isa, parts=parts)
        if isinstance(source, (bytes, bytearray, memoryview)):
            data = np.frombuffer(source, np.uint8)
            status = lib.umo_model_load_memory(_generated.ABI_VERSION, data.ctypes.data, data.size, config, byref(handle))
        else:
            path = os.fspath(_library.MODEL if source is None else source)
            if "\0" in path:
                raise ValueError("a path has no zero bytes")
            status = lib.umo_model_load(_generated.ABI_VERSION, path.encode(), config, byref(handle))
            if status == _generated.Status.IO:
                detail = lib.umo_last_error().decode()
                _check_readable(path)
                raise _library.error(status, detail)
        _library.check(status)
        super().__init__(handle.value or 0, lib.umo_model_free)
        # Read once: they do not change, and are still there when the model is closed.
        self._info = _library.filled(_generated.ModelInfo, lambda info: lib.umo_model_get_info(self._handle, info))
        self._channels = tuple(self._text(lib.umo_model_get_channel_name, i) for i in range(self._info.channels))
        if self._info.has_notice:
            warnings.warn(f"{self.name}: {self.notice}", stacklevel=2)

    def _text(self, get: Any, which: int) -> str:
        text = ctypes.c_char_p()
        _library.check(get(self._handle, which, byref(text)))
        return (text.value or b"").decode()

    @property
    def name(self) -> str:
        """Name of the model."""
        return self._text(lib.umo_model_get_text, _generated.MODEL_TEXTS["name"])

    @property
    def license(self) -> str:
        """Licence of its weights."""
        return self._text(lib.umo_model_get_text, _generated.MODEL_TEXTS["license"])

    @property
    def notice(self) -> str:
        """Notice that users must see; empty if there is none."""
        return self._text(lib.umo_model_get_text, _generated.MODEL_TEXTS["notice"])

    @property
    def isa(self) -> str:
        """The instructions that it was packed for, as `avx512vnni`."""
        return self._text(lib.umo_model_get_text, _generated.MODEL_TEXTS["isa"])

    @property
    def prompts(self) -> tuple[str, ...]:
        """Prompts that it was trained with; empty if it has no list. With others its motion is chance."""
        return tuple(filter(None, self._text(lib.umo_model_get_text, _generated.MODEL_TEXTS["prompts"]).split("\n")))

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the face channels, such as `jawOpen`."""
        return self._channels

    @property
    def is_arkit(self) -> bool:
        """Whether the face channels are the 52 ARKit blendshapes, 0 to 1; otherwise SMPL-X expression coefficients."""
        return bool(self._info.is_arkit)

    @property
    def has_text(self) -> bool:
        """Whether text prompts are supported."""
        return bool(self._info.has_text)

    @property
    def has_mouth(self) -> bool:
        """Whether it has a mouth network, which the voices `"live"` and `"mouth"` need."""
        return bool(self._info.has_mouth)

    @property
    def frame_rate(self) -> int:
        """Frames per second: 30."""
        return int(self._info.frame_rate)

    @property
    def sample_rate(self) -> int:
        """Sample rate of the model; sessions take any rate and resample."""
        return int(self._info.sample_rate)

    @property
    def latency_frames(self) -> int:
        """Maximum number of frames of future speech that a frame needs by default."""
        return int(self._info.latency_frames)

    @property
    def target(self) -> int:
        """Keyframes predicted per chunk by default."""
        return int(self._info.target)

    @property
    def max_target(self) -> int:
        """Maximum number of keyframes per chunk."""
        return int(self._info.max_target)

    @property
    def lookahead(self) -> int:
        """Frames held back by default."""
        return int(self._info.lookahead)

    @property
    def max_horizon(self) -> int:
        """Maximum number of keyframes of future speech that a session can use; 0 if unsupported."""
        return int(self._info.max_horizon)

    @property
    def keyframe_stride(self) -> int:
        """Frames from one keyframe to the next."""
        return int(self._info.keyframe_stride)

    @property
    def max_prompt(self) -> int:
        """Maximum number of token ids of a prompt."""
        return int(self._info.max_prompt)

    @property
    def file_size(self) -> int:
        """Size of the model file in bytes."""
        return int(self._info.file_size)

    def skeleton(self, axes: str = "gltf") -> tuple[npt.NDArray[np.int32], npt.NDArray[np.float32]]:
        """The bones: each joint's parent [55], -1 for the first, and where it is in its parent's frame at rest [55, 3]."""
        parents = np.empty(_generated.JOINT_COUNT, np.int32)
        offsets = np.empty((_generated.JOINT_COUNT, 3), np.float32)
        status = lib.umo_model_get_skeleton(
            self._handle,
            _library.chosen("axes", _generated.AXES, axes),
            parents.ctypes.data_as(ctypes.POINTER(ctypes.c_int32)),
            offsets.ctypes.data_as(ctypes.POINTER(ctypes.c_float)),
            _generated.JOINT_COUNT,
        )
        _library.check(status)
        return parents, offsets

    def encode_text(self, text: str) -> npt.NDArray[np.uint32]:
        """Token ids of a prompt, for `Session.set_prompt`."""
        ids, count, bytes_ = np.empty(self.max_prompt, np.uint32), ctypes.c_size_t(), text.encode()
        pointer = ids.ctypes.data_as(ctypes.POINTER(ctypes.c_uint32))
        _library.check(lib.umo_model_encode_text(self._handle, bytes_, len(bytes_), pointer, ids.size, byref(count)))
        return ids[: count.value]


def _check_readable(path: str) -> None:
    """Raises Python's own exception if a file is missing, is a directory, or cannot be read."""
    os.stat(path)
    for wrong, number in ((os.path.isdir(path), errno.EISDIR), (not os.access(path, os.R_OK), errno.EACCES)):
        if wrong:
            raise OSError(number, os.strerror(number), path)


class SelfTest(NamedTuple):
    """Result of `self_test`; printed, it is the report."""

    passed: bool
    """Whether all checks passed."""
    report: str
    """Text that is safe to publish: it contains no path, host or user name."""

    def __str__(self) -> str:
        return self.report


def self_test(model: Model | None = None) -> SelfTest:
    """Tests this machine with a model, the default one if not given, for about 10 s: kernels, motion, speed."""
    passed, report = ctypes.c_uint32(), ctypes.create_string_buffer(_generated.SELF_TEST_SIZE)
    handle = (model or default_model())._handle
    _library.check(lib.umo_self_test(handle, byref(passed), report, _generated.SELF_TEST_SIZE))
    return SelfTest(passed.value == 1, report.value.decode())


@functools.lru_cache(maxsize=None)
def default_model() -> Model:
    """The model that comes with the package, loaded once."""
    return Model()
