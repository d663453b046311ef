"""From audio to frames in one call."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Optional

import numpy.typing as npt

from . import _library
from ._engine import Engine
from ._model import Model
from ._motion import Frame, Motion
from ._session import Idle, Session, audio


def _run(session: Session, chunks: Iterable[npt.ArrayLike]) -> Iterator[Motion]:
    """What a polled engine makes of audio, as it comes."""

    def ready() -> Iterator[Motion]:
        # A session computes no further than its queue goes: what is pulled makes room.
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
    **settings: Any,
) -> Motion:
    """Animates a recording: [samples] or [samples, channels], floats of full scale 1 or int16, `rate` samples per second.

    The frames are those of `umo animate`, bit for bit. `parameters` are those of `Session`, as `{"gain_face": 0.5}`;
    `mood` is one of `Session.set_mood`; `settings` are the session's other arguments, as `target`. It hears as far ahead as the
    model can, unless they say `horizon`.
    """
    recording = audio(samples)
    channels = recording.shape[1] if recording.ndim == 2 else 1
    with Engine(model, threads=threads, polled=True, max_sessions=1, max_batch=1) as engine:
        settings = {"idle": Idle.HOLD, "horizon": engine.model.max_horizon, **settings}
        with Session(engine, rate, channels, axes=axes, seed=seed, **settings) as session:
            return session._layout.joined(list(_run(_ready(session, prompt, mood, parameters), [recording])))


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
    """Frames as they come from audio as it comes, computed in the thread that iterates.

    They are those of `animate(horizon=0)`, however the audio is cut: with a `horizon` the stream hears ahead, and is as much later.

    `chunks` gives arrays as `animate` takes them, of any length. For a live avatar whose audio and picture have threads of
    their own, use `Session`.
    """
    with Engine(model, threads=threads, polled=True, max_sessions=1, max_batch=1) as engine:
        with Session(engine, rate, channels, axes=axes, seed=seed, **{"idle": Idle.HOLD, **settings}) as session:
            for motion in _run(_ready(session, prompt, mood, parameters), chunks):
                yield from motion
