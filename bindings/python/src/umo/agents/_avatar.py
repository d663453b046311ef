"""An avatar in an event loop: what all adapters share."""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import AsyncIterator
from dataclasses import dataclass, field, replace
from types import TracebackType
from typing import Any, NamedTuple, Optional, Union

import numpy as np
import numpy.typing as npt

from .._engine import Engine
from .._generated import PRIORITIES, Idle, Status
from .._library import Error, chosen
from .._model import Model
from .._motion import Frame
from .._session import Session, audio
from ..lips import Hint

SAMPLE = 2
"""Bytes of a sample: audio is PCM16."""
CHECK = 0.004
"""Seconds between two looks for a frame that is being computed."""
MOUTHFUL = 0.5
"""Seconds of audio that the session gets at once: it is resampled in the event loop."""


@dataclass(frozen=True, eq=False)
class Pose:
    """A pose, and the audio that is heard while it is shown."""

    frame: Frame
    """The pose itself. Its index and time are those of the session, which go on from speech to speech."""
    speech: Optional[int]
    """The speech's number, from 0; None between speeches."""
    time: float
    """Seconds from the speech's first sample; 0 between speeches."""
    audio: bytes
    """PCM16 of the speech from this pose to the next one; empty between speeches."""
    is_last: bool
    """Whether the speech ends with it."""
    packets: tuple[bytes, ...] = ()
    """With `packets="beside_frames"`: those for a `umo.Decoder` elsewhere that became ready."""
    marks: tuple[Any, ...] = ()
    """Those of `Avatar.mark` that are reached with the end of `audio`."""


class Interrupted(NamedTuple):
    """A speech that was cut."""

    speech: int
    """Its number."""
    seconds: float
    """How much of it was heard, if its audio was played as it was given out."""


@dataclass(eq=False)
class _Speech:
    number: int
    fed: float
    """When audio came last."""
    data: bytearray = field(default_factory=bytearray)
    """What was not given out with poses."""
    pushed: int = 0
    """Bytes of `data` that the session has."""
    is_begun: bool = False
    is_ended: bool = False
    is_finished: bool = False
    """Whether the session was told that it is ended."""
    poses: int = 0
    """How many were given out."""
    given: int = 0
    """Samples of each channel that were given out."""
    marks: deque[tuple[int, Any]] = field(default_factory=deque)
    """What is to be told when so many samples were given out."""
    first: int = 0
    """Samples of each channel that the session had before it."""
    hints: deque[Hint] = field(default_factory=deque)
    """Those that the session does not have."""


class Avatar:
    """What an agent says, as poses: `push` and `end` for each speech, `interrupt` when the user cuts in; iterating gives the poses.

    All calls are for one event loop, and none of them waits: umo computes in a thread of its own. Audio is PCM16 of `channels` at
    `rate`. Poses come when they are to be shown, `lead` seconds early at most, and each carries the piece of audio that belongs to
    it, so that whoever plays both keeps them in step. With a `lead` of None they come as they are computed.

    After each speech the avatar eases to rest within `ease` seconds, and the next speech begins out of rest. With `idle` poses come
    between speeches, too: it breathes, blinks and looks. A speech that gets no audio for `patience` seconds is ended.

    `engine` is shared by as many avatars as it has room for; None makes one for this avatar alone, of `model`, whose thread has the
    `priority` that `umo.Engine` describes. `settings` are those of `umo.Session`, as `seed`, `axes`, `voice` or
    `packets="beside_frames"`.
    """

    rate: int
    """Samples per second of the audio."""
    channels: int
    """Its channels."""

    def __init__(
        self,
        rate: int = 24000,
        channels: int = 1,
        *,
        engine: Optional[Engine] = None,
        model: Optional[Model] = None,
        priority: str = "normal",
        lead: Optional[float] = 0.2,
        ease: float = 0.2,
        idle: bool = False,
        patience: float = 1.0,
        **settings: Any,
    ) -> None:
        for name, value in (("lead", lead or 0.0), ("ease", ease), ("patience", patience)):
            if not value >= 0:
                raise ValueError(f"{name} {value}: expected seconds, not negative")
        if idle and lead is None:
            raise ValueError("idle poses come at their time: expected a lead")
        if engine is not None and model is not None:
            raise ValueError("an engine has its model: expected one of both")
        # Before the engine is made, which is in another thread.
        chosen("priority", PRIORITIES, priority)
        if engine is not None and priority != "normal":
            raise ValueError("an engine has its priority: expected one of both")
        if settings.get("packets") == "only":
            raise ValueError("poses are made of frames: expected packets='beside_frames'")
        self.rate, self.channels = rate, channels
        self._given_engine, self._model, self._priority = engine, model, priority
        self._own_engine: Optional[Engine] = None
        self._session: Optional[Session] = None
        self._settings = {"idle": Idle.REST if idle else Idle.HOLD, **settings}
        self._has_packets = settings.get("packets") == "beside_frames"
        self._lead, self._ease, self._is_idling, self._patience = lead, ease, idle, patience
        self._changed = asyncio.Event()
        self._is_closed = False
        self._count = 0
        self._odd = b""
        # Samples of each channel that the session took.
        self._taken = 0
        # Hints of the next speech.
        self._early: deque[Hint] = deque()
        # Speeches that were not given out whole. The session has the first of them.
        self._speeches: deque[_Speech] = deque()
        # Frames of an ease to rest that the session still has.
        self._resting = 0
        # The last frame of the session, and the last one that was given out, which differ while a speech begins.
        self._last: Optional[Frame] = None
        self._seen: Optional[Frame] = None
        self._from: Optional[Frame] = None
        self._mixed = 0
        # When the last pose is to be shown, and how long what was given out is heard.
        self._shown: Optional[float] = None
        self._heard: Optional[tuple[_Speech, float]] = None

    async def start(self) -> None:
        """Loads the model and makes the session, in another thread. Audio that comes before waits. `async with` calls it."""
        if self._session is None:
            await asyncio.get_running_loop().run_in_executor(None, self._make)
            if self._is_closed:
                await self.aclose()
            self._changed.set()

    def _make(self) -> None:
        engine = self._given_engine
        if engine is None:
            engine = self._own_engine = Engine(
                self._model, threads=1, max_sessions=1, max_batch=1, priority=self._priority
            )
        self._session = Session(engine, self.rate, self.channels, **self._settings)

    @property
    def session(self) -> Session:
        """For moods, gestures, gaze, attention and the user's audio (`push_other`). Speech goes through `push`."""
        if self._session is None:
            raise RuntimeError("the avatar is not started: use `async with`, or await start()")
        return self._session

    @property
    def is_speaking(self) -> bool:
        """Whether a speech was not given out whole."""
        return bool(self._speeches)

    @property
    def speeches(self) -> int:
        """How many speeches were begun, those included that were cut."""
        return self._count

    @property
    def pushed(self) -> float:
        """Seconds of audio of the speech that is pushed at present; 0 where the next audio begins one."""
        if not self._speeches or self._speeches[-1].is_ended:
            return 0.0
        speech = self._speeches[-1]
        return (speech.given + len(speech.data) // self._size) / self.rate

    def push(self, samples: Union[bytes, bytearray, memoryview, npt.ArrayLike]) -> None:
        """Takes audio of the speech: bytes of PCM16, cut anywhere, or an array of int16 or of floats of full scale 1.

        The first audio after `end` or `interrupt` begins the next speech.
        """
        if self._is_closed:
            raise RuntimeError("the avatar is closed")
        data = self._odd + (bytes(samples) if isinstance(samples, (bytes, bytearray, memoryview)) else _pcm16(samples))
        whole = len(data) - len(data) % self._size
        self._odd = data[whole:]
        if not whole:
            return
        if not self._speeches or self._speeches[-1].is_ended:
            self._speeches.append(_Speech(self._count, 0.0, hints=self._early))
            self._early = deque()
            self._count += 1
        self._speeches[-1].data += data[:whole]
        self._speeches[-1].fed = time.monotonic()
        self._changed.set()

    def end(self) -> None:
        """The speech is over: its last poses come without waiting for more audio. Nothing happens where there is none."""
        self._odd = b""
        if self._speeches and not self._speeches[-1].is_ended:
            speech = self._speeches[-1]
            if not speech.poses:
                # There must be a pose that its audio goes with.
                speech.data += bytes(max(self._place(1) * self._size - len(speech.data), 0))
            speech.is_ended = True
            self._changed.set()

    def mark(self, mark: Any) -> bool:
        """Says that something belongs behind the audio that was pushed: the pose that reaches it has it in `marks`. An interrupt drops it.

        False where all audio was given out: there is nothing to wait for.
        """
        if not self._speeches:
            return False
        speech = self._speeches[-1]
        speech.marks.append((speech.given + len(speech.data) // self._size, mark))
        return True

    def hint(self, hint: Hint) -> None:
        """Says that a sound is heard that one sees on the lips, at a time of the speech that is pushed at present, or else the next one.

        `umo.lips` makes hints of the times that synthesisers give. One whose pose was given out shows no more.
        """
        is_open = bool(self._speeches) and not self._speeches[-1].is_ended
        (self._speeches[-1].hints if is_open else self._early).append(hint)
        self._changed.set()

    def interrupt(self) -> Optional[Interrupted]:
        """Barge-in: drops what was not given out, and eases to rest. Says what was cut; None where nothing was to be heard."""
        now, cut = time.monotonic(), None
        if self._heard is not None and self._heard[1] > now:
            speech, until = self._heard
            cut = Interrupted(speech.number, max(speech.given / self.rate - (until - now), 0.0))
        elif self._speeches:
            cut = Interrupted(self._speeches[0].number, self._speeches[0].given / self.rate)
        is_begun = bool(self._speeches) and self._speeches[0].is_begun
        self._speeches.clear()
        self._early.clear()
        self._odd, self._heard = b"", None
        if is_begun:
            self._rest(self.session)
        if self._shown is not None:
            # Whoever plays drops what is early, too.
            self._shown = min(self._shown, now)
        self._changed.set()
        return cut

    async def aclose(self) -> None:
        """Ends iterating and frees everything but an engine that was given. `async with` calls it."""
        self._is_closed = True
        self._changed.set()
        parts = [part for part in (self._session, self._own_engine) if part is not None]
        # An engine's threads are waited for.
        await asyncio.get_running_loop().run_in_executor(None, lambda: [part.close() for part in parts])

    async def __aenter__(self) -> Avatar:
        await self.start()
        return self

    async def __aexit__(
        self, kind: Optional[type[BaseException]], error: Optional[BaseException], trace: Optional[TracebackType]
    ) -> None:
        await self.aclose()

    async def __aiter__(self) -> AsyncIterator[Pose]:
        while not self._is_closed:
            self._changed.clear()
            found = None if self._session is None else self._next(self._session, time.monotonic())
            if isinstance(found, Pose):
                yield found
                continue
            try:
                await asyncio.wait_for(self._changed.wait(), found)
            except asyncio.TimeoutError:
                pass

    def _next(self, session: Session, now: float) -> Union[Pose, float, None]:
        """The pose that is due, or how many seconds to wait for one; None is until something changes."""
        due = now if self._shown is None else max(self._shown + 1.0 / self._frame_rate, now)
        self._feed(session, now)
        speech = self._speeches[0] if self._speeches else None
        if self._lead is not None and due - now > self._lead:
            return due - now - self._lead
        # Not by `ready`: the mouth of a live voice computes in the call.
        pose = self._pull(session)
        if pose is None and self._is_idling and due <= now and (speech is None or not speech.poses):
            pose = self._idle(session)
        if pose is None:
            return CHECK if speech else due - now if self._is_idling else None
        self._shown = due
        if speech is not None and pose.audio:
            self._heard = speech, due + len(pose.audio) / self._size / self.rate
        return pose

    def _feed(self, session: Session, now: float) -> None:
        """Gives the session audio of the first speech, as much as it has room for."""
        if not self._speeches:
            return
        speech = self._speeches[0]
        if not speech.is_begun:
            speech.is_begun, speech.first = True, self._taken
        self._hint(session, speech)
        if not speech.is_ended and now - speech.fed > self._patience:
            self.end()
        if speech.pushed < len(speech.data):
            most = speech.pushed + int(MOUTHFUL * self.rate) * self._size
            samples = np.frombuffer(bytes(speech.data[speech.pushed : most]), "<i2").astype(np.int16, copy=False)
            taken = session.push(samples.reshape(-1, self.channels))
            speech.pushed += taken * self._size
            self._taken += taken
        if speech.is_ended and not speech.is_finished and speech.pushed == len(speech.data):
            session.finish()
            speech.is_finished = True

    def _hint(self, session: Session, speech: _Speech) -> None:
        """Gives the session the hints of the first speech, as many as it has room for."""
        while speech.hints:
            shape, start, duration = speech.hints[0].after(speech.first / self.rate)
            try:
                session.hint_lips(shape, start, duration)
            except Error as error:
                if error.status != Status.BUSY:
                    raise
                return
            speech.hints.popleft()

    def _pull(self, session: Session) -> Optional[Pose]:
        """The next frame with what belongs to it, if there is one."""
        pulled = session.pull(1)
        if not len(pulled):
            return None
        frame, packets = pulled[0], self._sent(session)
        if self._resting:
            self._resting -= 1
            return Pose(self._mix(frame), None, 0.0, b"", False, packets)
        # Nothing else has frames: an interrupt drops them.
        speech = self._speeches[0]
        if not speech.poses:
            # The session begins out of rest; where it idled, the first poses come out of the one before.
            self._from, self._mixed = (self._seen if self._is_idling else None), 0
        is_last = speech.is_finished and session.is_done
        count = len(speech.data) // self._size
        if not is_last:
            count = min(count, self._place(speech.poses + 1) - speech.given)
        heard = bytes(speech.data[: count * self._size])
        del speech.data[: count * self._size]
        speech.pushed -= len(heard)
        speech.given += count
        marks = []
        while speech.marks and (is_last or speech.marks[0][0] <= speech.given):
            marks.append(speech.marks.popleft()[1])
        seconds = speech.poses / self._frame_rate
        pose = Pose(self._mix(frame), speech.number, seconds, heard, is_last, packets, tuple(marks))
        speech.poses += 1
        if is_last:
            self._speeches.popleft()
            self._rest(session)
        return pose

    def _mix(self, frame: Frame) -> Frame:
        """The frame, still between the pose before the speech and its own within `ease` seconds; the face is its own."""
        self._last = self._seen = frame
        count = round(self._ease * self._frame_rate)
        if self._from is not None and self._mixed < count:
            self._mixed += 1
            x, before = self._mixed / (count + 1), self._from
            weight = np.float32(x * x * (3.0 - 2.0 * x))
            is_far = (frame.rotations * before.rotations).sum(-1, keepdims=True) < 0
            rotations = before.rotations + weight * (np.where(is_far, -frame.rotations, frame.rotations) - before.rotations)
            rotations /= np.linalg.norm(rotations, axis=-1, keepdims=True)
            translation = before.translation + weight * (frame.translation - before.translation)
            self._seen = replace(frame, rotations=rotations, translation=translation)
        return self._seen

    def _idle(self, session: Session) -> Pose:
        """The last pose, alive."""
        self._seen = session.sample(0.0 if self._last is None else self._last.time).frame
        self._from = None
        return Pose(self._seen, None, 0.0, b"", False, self._sent(session))

    def _rest(self, session: Session) -> None:
        """Ends what the session has of a speech. The frames of its ease are there at once; then comes the next speech."""
        session.interrupt(self._ease)
        self._resting = session.ready

    def _sent(self, session: Session) -> tuple[bytes, ...]:
        return tuple(session.pull_packets()) if self._has_packets else ()

    @property
    def _size(self) -> int:
        return SAMPLE * self.channels

    @property
    def _frame_rate(self) -> int:
        return 30 if self._session is None else self._session.engine.model.frame_rate

    def _place(self, frame: int) -> int:
        """Sample with which a frame of a speech begins."""
        return -(-frame * self.rate // self._frame_rate)


def _pcm16(samples: npt.ArrayLike) -> bytes:
    array = audio(samples)
    if array.dtype != np.int16:
        array = np.clip(np.rint(array * np.float32(32768.0)), -32768, 32767)
    return array.astype("<i2").tobytes()
