"""From audio to frames in one call."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from ctypes import POINTER, c_float
from typing import Any, Optional, Union, overload

import numpy as np
import numpy.typing as npt

from . import _library
from ._engine import Engine
from ._generated import Idle
from ._library import lib
from ._model import Model
from ._motion import Frame, Motion
from ._session import Session, audio


def _run(session: Session, chunks: Iterable[npt.ArrayLike]) -> Iterator[Motion]:
    """Yields a polled engine's frames for audio as it arrives."""

    def ready() -> Iterator[Motion]:
        # A session computes until its queue is full: pulling makes room.
        while True:
            session.engine.poll()
            motion = session.pull()
            if not len(motion):
                return
            yield motion

    for chunk in chunks:
        rest = audio(chunk)
        while len(rest):
            rest = rest[session.push(rest) :]
            yield from ready()
    session.finish()
    yield from ready()


def _settings(engine: Engine, given: Mapping[str, Any]) -> dict[str, Any]:
    """A session's arguments for a recording: maximum lookahead unless they say otherwise."""
    return {"idle": Idle.HOLD, "horizon": engine.model.max_horizon, **given}


def _heard(recording: npt.NDArray[Any], rate: int) -> npt.NDArray[Any]:
    """The recording, with channel gains applied if its speech level needs correction."""
    floats = recording.astype(np.float32) / np.float32(32768) if recording.dtype == np.int16 else recording
    channels = recording.shape[1] if recording.ndim == 2 else 1
    gains = np.empty(channels, np.float32)
    pointers = (floats.ctypes.data_as(POINTER(c_float)), gains.ctypes.data_as(POINTER(c_float)))
    _library.check(lib.umo_recording_gains(pointers[0], floats.size, rate, channels, pointers[1]))
    if (gains == 1).all():
        return recording
    each = ", ".join(f"{gain:g}" for gain in gains)
    message = f"the recording's speech is not at a usual level, or in one channel of several: channels are scaled by {each}"
    warnings.warn(message, stacklevel=4)
    return floats * (gains if recording.ndim == 2 else gains[0])


def _ready(session: Session, prompt: Optional[str], mood: Optional[str], parameters: Mapping[str, float]) -> Session:
    for name, value in parameters.items():
        if name not in Session.parameters():
            raise ValueError(f"parameter {name!r}: {_library.suggestion(name, Session.parameters())}")
        setattr(session, name, value)
    if prompt is not None:
        session.set_prompt(prompt)
    if mood is not None:
        session.set_mood(mood)
    return session


def _run_all(sessions: Iterator[tuple[Session, npt.NDArray[Any]]], jobs: int) -> Iterator[tuple[Session, list[Motion]]]:
    """Yields each recording's motion when it is done; `jobs` of them are computed together by one polled engine."""
    active: list[tuple[Session, npt.NDArray[Any], list[Motion]]] = []
    while True:
        while len(active) < jobs and (following := next(sessions, None)) is not None:
            active.append((*following, []))
        if not active:
            return
        rest: list[tuple[Session, npt.NDArray[Any], list[Motion]]] = []
        for session, samples, parts in active:
            if len(samples):
                samples = samples[session.push(samples) :]
            if not len(samples):
                session.finish()
            rest.append((session, samples, parts))
        rest[0][0].engine.poll()
        active = []
        for session, samples, parts in rest:
            parts.append(session.pull())
            if session.is_done:
                yield session, parts
            else:
                active.append((session, samples, parts))


def _each(name: str, value: Any, count: int) -> list[Any]:
    """One value per recording: the given one for all, or a list of as many."""
    if value is None or isinstance(value, (str, int, np.integer)):
        return [value] * count
    values = list(value)
    if len(values) != count:
        raise ValueError(f"{len(values)} values of {name}: expected one, or {count}, one per recording")
    return values


@overload
def animate(
    samples: list[npt.NDArray[Any]],
    rate: Union[int, Sequence[int]],
    *,
    model: Optional[Model] = None,
    axes: str = "gltf",
    seed: Union[int, Sequence[Optional[int]], None] = None,
    prompt: Union[str, Sequence[Optional[str]], None] = None,
    mood: Union[str, Sequence[Optional[str]], None] = None,
    parameters: Mapping[str, float] = {},
    threads: Optional[int] = None,
    jobs: int = 8,
    **settings: Any,
) -> list[Motion]: ...
@overload
def animate(
    samples: npt.ArrayLike,
    rate: int,
    *,
    model: Optional[Model] = None,
    axes: str = "gltf",
    seed: Optional[int] = None,
    prompt: Optional[str] = None,
    mood: Optional[str] = None,
    parameters: Mapping[str, float] = {},
    threads: Optional[int] = None,
    jobs: int = 8,
    **settings: Any,
) -> Motion: ...
def animate(
    samples: Any,
    rate: Any,
    *,
    model: Optional[Model] = None,
    axes: str = "gltf",
    seed: Any = None,
    prompt: Any = None,
    mood: Any = None,
    parameters: Mapping[str, float] = {},
    threads: Optional[int] = None,
    jobs: int = 8,
    **settings: Any,
) -> Union[Motion, list[Motion]]:
    """Animates a recording: [samples] or [samples, channels], floats of full scale 1 or int16, `rate` samples per
    second.

    A list of arrays stands for several recordings: `jobs` of them are computed together, so that the model is read once
    for all, with the same bits as computed alone. `rate`, `seed`, `prompt` and `mood` are then one for all, or one per
    recording.

    Speech far from its usual level, channels that cancel each other, and speech in the centre of five or more channels
    are corrected, with a warning.

    The frames equal those of `umo animate` bit for bit. `parameters` are named as in `Session`, such as
    `{"gain_face": 0.5}`; `mood` is one of `Session.set_mood`; `settings` are other arguments of the session, such as
    `target`. The lookahead is the model's maximum unless `horizon` is given.
    """
    if isinstance(samples, (list, tuple)) and samples and all(isinstance(each, np.ndarray) and each.ndim for each in samples):
        return _animate_all(samples, rate, model, axes, (seed, prompt, mood), parameters, threads, jobs, settings)
    recording = audio(samples)
    channels = recording.shape[1] if recording.ndim == 2 else 1
    with Engine(model, threads=threads, polled=True, max_sessions=1, max_batch=1) as engine:
        with Session(engine, rate, channels, axes=axes, seed=seed, **_settings(engine, settings)) as session:
            return session._layout.joined(list(_run(_ready(session, prompt, mood, parameters), [_heard(recording, rate)])))


def _animate_all(
    samples: Sequence[npt.NDArray[Any]],
    rate: Any,
    model: Optional[Model],
    axes: str,
    told: tuple[Any, Any, Any],
    parameters: Mapping[str, float],
    threads: Optional[int],
    jobs: int,
    settings: Mapping[str, Any],
) -> list[Motion]:
    if jobs < 1:
        raise ValueError(f"jobs {jobs}: expected at least 1")
    recordings = [audio(each) for each in samples]
    names = ("rate", "seed", "prompt", "mood")
    rates, seeds, prompts, moods = (_each(name, value, len(samples)) for name, value in zip(names, (rate, *told)))
    motions: dict[Session, Motion] = {}
    order: list[Session] = []
    jobs = min(jobs, len(recordings), _library.MAX_BATCH)
    with Engine(model, threads=threads, polled=True, max_sessions=jobs, max_batch=jobs) as engine:
        settings = _settings(engine, settings)

        def sessions() -> Iterator[tuple[Session, npt.NDArray[Any]]]:
            for at, recording in enumerate(recordings):
                channels = recording.shape[1] if recording.ndim == 2 else 1
                session = Session(engine, rates[at], channels, axes=axes, seed=seeds[at], **settings)
                order.append(_ready(session, prompts[at], moods[at], parameters))
                yield session, _heard(recording, rates[at])

        for session, parts in _run_all(sessions(), jobs):
            motions[session] = session._layout.joined(parts)
            session.close()
    return [motions[session] for session in order]


def stream(
    chunks: Iterable[npt.ArrayLike],
    rate: int,
    channels: int = 1,
    *,
    model: Optional[Model] = None,
    axes: str = "gltf",
    seed: Optional[int] = None,
    prompt: Optional[str] = None,
    mood: Optional[str] = None,
    parameters: Mapping[str, float] = {},
    threads: Optional[int] = None,
    **settings: Any,
) -> Iterator[Frame]:
    """Yields frames as they are computed from arriving audio, on the thread that iterates.

    They equal the frames of `animate`, however the audio is cut: each is available once its audio and the
    horizon after it have arrived. With `horizon=0` they are available earlier, and equal the frames of
    `animate(horizon=0)`.

    `chunks` yields arrays as for `animate`, of any length. For a live avatar with separate threads for audio and
    rendering, use `Session`.
    """
    with Engine(model, threads=threads, polled=True, max_sessions=1, max_batch=1) as engine:
        with Session(engine, rate, channels, axes=axes, seed=seed, **_settings(engine, settings)) as session:
            for motion in _run(_ready(session, prompt, mood, parameters), chunks):
                yield from motion
