"""An avatar in an event loop, shared by all adapters."""

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
from ..words import Word

SAMPLE = 2
"""Bytes per sample: audio is PCM16."""
CHECK = 0.004
"""Polling interval for a frame that is being computed, seconds."""
MOUTHFUL = 0.5
"""Maximum audio passed to the session at once, in seconds: it is resampled on the event loop."""


@dataclass(frozen=True, eq=False)
class Pose:
    """A pose, and the audio to play while it is shown."""

    frame: Frame
    """The pose. Its index and time are the session's, which continue from speech to speech."""
    speech: Optional[int]
    """Index of the speech, from 0; None between speeches."""
    time: float
    """Seconds from the speech's first sample; 0 between speeches."""
    audio: bytes
    """PCM16 of the speech from this pose to the next one; empty between speeches."""
    is_last: bool
    """Whether it is the last pose of the speech."""
    packets: tuple[bytes, ...] = ()
    """With `packets="beside_frames"`: newly ready packets for a remote `umo.Decoder`."""
    marks: tuple[Any, ...] = ()
    """Marks of `Avatar.mark` reached at the end of `audio`."""


class Interrupted(NamedTuple):
    """A speech that was interrupted."""

    speech: int
    """Index of the speech."""
    seconds: float
    """Seconds of it that were heard, if its audio was played as delivered."""


@dataclass(eq=False)
class _Speech:
    number: int
    fed: float
    """Time when audio last arrived."""
    data: bytearray = field(default_factory=bytearray)
    """Audio not yet delivered with poses."""
    pushed: int = 0
    """Bytes of `data` pushed to the session."""
    is_begun: bool = False
    is_ended: bool = False
    is_finished: bool = False
    """Whether the session was told that the speech has ended."""
    poses: int = 0
    """Number of poses delivered."""
    given: int = 0
    """Samples per channel delivered."""
    marks: deque[tuple[int, Any]] = field(default_factory=deque)
    """Marks, each with the number of delivered samples that triggers it."""
    first: int = 0
    """Samples per channel that the session took before this speech."""
    hints: deque[Union[Hint, Word]] = field(default_factory=deque)
    """Hints not yet passed to the session."""


class Avatar:
    """Converts an agent's speech to poses: `push` and `end` for each speech, `interrupt` when the user cuts in;
    iterating yields the poses.

    All calls belong on one event loop, and none of them waits: umo computes on its own thread. Audio is PCM16 of
    `channels` at `rate`. Poses are delivered when they are to be shown, at most `lead` seconds early, and each carries
    the audio that belongs to it, so that playing both keeps them in sync. With a `lead` of None they are delivered as
    soon as they are computed.

    After each speech the avatar eases to rest within `ease` seconds, and the next speech starts from rest. With `idle`
    there are poses between speeches too: it breathes, blinks and looks around. A speech that gets no audio for
    `patience` seconds is ended.

    `engine` can be shared by several avatars, up to its number of sessions; None creates one for this avatar, with
    `model` and with the thread `priority` described at `umo.Engine`. `settings` are arguments of `umo.Session`, such as
    `seed`, `axes`, `voice` or `packets="beside_frames"`.
    """

    rate: int
    """Sample rate of the audio."""
    channels: int
    """Channels of the audio."""

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
            raise ValueError("idle poses are delivered in real time: expected a lead")
        if engine is not None and model is not None:
            raise ValueError("an engine has its model: give only one of the two")
        # Checked before the engine is created, which happens on another thread.
        chosen("priority", PRIORITIES, priority)
        if engine is not None and priority != "normal":
            raise ValueError("an engine has its priority: give only one of the two")
        if settings.get("packets") == "only":
            raise ValueError("poses need frames: expected packets='beside_frames'")
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
        # Samples per channel taken by the session.
        self._taken = 0
        # Hints of the next speech.
        self._early: deque[Union[Hint, Word]] = deque()
        # Speeches not completely delivered. The session has the first of them.
        self._speeches: deque[_Speech] = deque()
        # Frames of an ease to rest still in the session.
        self._resting = 0
        # The session's last frame, and the last one delivered, which differ while a speech begins.
        self._last: Optional[Frame] = None
        self._seen: Optional[Frame] = None
        self._from: Optional[Frame] = None
        self._mixed = 0
        # Time to show the last pose, and end of the delivered audio.
        self._shown: Optional[float] = None
        self._heard: Optional[tuple[_Speech, float]] = None

    async def start(self) -> None:
        """Loads the model and creates the session on another thread. Earlier audio is queued. Called by `async with`.
        """
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
        """For moods, gestures, gaze, attention and the user's audio (`push_other`). Push speech with `push`."""
        if self._session is None:
            raise RuntimeError("the avatar is not started: use `async with`, or await start()")
        return self._session

    @property
    def is_speaking(self) -> bool:
        """Whether a speech has not been completely delivered."""
        return bool(self._speeches)

    @property
    def speeches(self) -> int:
        """Number of speeches begun, including interrupted ones."""
        return self._count

    @property
    def pushed(self) -> float:
        """Seconds of audio pushed to the current speech; 0 if the next audio starts a speech."""
        if not self._speeches or self._speeches[-1].is_ended:
            return 0.0
        speech = self._speeches[-1]
        return (speech.given + len(speech.data) // self._size) / self.rate

    def push(self, samples: Union[bytes, bytearray, memoryview, npt.ArrayLike]) -> None:
        """Pushes audio of the speech: bytes of PCM16, cut anywhere, or an array of int16 or of floats of full scale 1.

        The first audio after `end` or `interrupt` starts the next speech.
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
        """Ends the speech: its last poses are computed without waiting for more audio. No-op without a speech."""
        self._odd = b""
        if self._speeches and not self._speeches[-1].is_ended:
            speech = self._speeches[-1]
            if not speech.poses:
                # Its audio needs at least one pose.
                speech.data += bytes(max(self._place(1) * self._size - len(speech.data), 0))
            speech.is_ended = True
            self._changed.set()

    def mark(self, mark: Any) -> bool:
        """Attaches a mark to the end of the pushed audio: the pose that reaches it has it in `marks`. An interrupt
        drops it.

        Returns False if all audio was already delivered, so that there is nothing to wait for.
        """
        if not self._speeches:
            return False
        speech = self._speeches[-1]
        speech.marks.append((speech.given + len(speech.data) // self._size, mark))
        return True

    def hint(self, hint: Union[Hint, Word]) -> None:
        """Schedules a visible lip shape, or a word, at a time of the current speech, or else of the next one.

        `umo.lips` and `umo.words` derive them from the timings of synthesisers. By the engine's rules
        (`Engine.set_word_rules`) some words become gestures. Hints for poses already delivered have no effect.
        """
        is_open = bool(self._speeches) and not self._speeches[-1].is_ended
        (self._speeches[-1].hints if is_open else self._early).append(hint)
        self._changed.set()

    def interrupt(self) -> Optional[Interrupted]:
        """Barge-in: drops everything not yet delivered, and eases to rest. Returns what was interrupted, or None if
        nothing was.
        """
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
            # The player also drops audio delivered early.
            self._shown = min(self._shown, now)
        self._changed.set()
        return cut

    async def aclose(self) -> None:
        """Stops iteration and frees everything except an engine that was passed in. Called by `async with`."""
        self._is_closed = True
        self._changed.set()
        parts = [part for part in (self._session, self._own_engine) if part is not None]
        # Closing waits for the engine's threads.
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
        """The pose that is due, or the seconds to wait for one; None means until something changes."""
        due = now if self._shown is None else max(self._shown + 1.0 / self._frame_rate, now)
        self._feed(session, now)
        speech = self._speeches[0] if self._speeches else None
        if self._lead is not None and due - now > self._lead:
            return due - now - self._lead
        # Not checked with `ready`: the mouth of a live voice is computed in the call.
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
        """Pushes audio of the first speech to the session, as much as fits."""
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
        """Passes hints of the first speech to the session, as many as fit."""
        while speech.hints:
            hint = speech.hints[0].after(speech.first / self.rate)
            try:
                if isinstance(hint, Word):
                    session.hint_words(*hint)
                else:
                    session.hint_lips(*hint)
            except Error as error:
                if error.status != Status.BUSY:
                    raise
                return
            speech.hints.popleft()

    def _pull(self, session: Session) -> Optional[Pose]:
        """The next frame with its audio and marks, if there is one."""
        pulled = session.pull(1)
        if not len(pulled):
            return None
        frame, packets = pulled[0], self._sent(session)
        if self._resting:
            self._resting -= 1
            return Pose(self._mix(frame), None, 0.0, b"", False, packets)
        # Only a speech has frames: an interrupt drops them.
        speech = self._speeches[0]
        if not speech.poses:
            # The session starts from rest; if it idled, blend from the last idle pose.
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
        """The frame, blended within `ease` seconds from the pose before the speech; the face is not blended."""
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
        """The last pose with idle motion."""
        self._seen = session.sample(0.0 if self._last is None else self._last.time).frame
        self._from = None
        return Pose(self._seen, None, 0.0, b"", False, self._sent(session))

    def _rest(self, session: Session) -> None:
        """Ends the session's part of a speech. The frames of its ease are ready at once; then the next speech follows.
        """
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
        """First sample of a frame of a speech."""
        return -(-frame * self.rate // self._frame_rate)


def _pcm16(samples: npt.ArrayLike) -> bytes:
    array = audio(samples)
    if array.dtype != np.int16:
        array = np.clip(np.rint(array * np.float32(32768.0)), -32768, 32767)
    return array.astype("<i2").tobytes()
