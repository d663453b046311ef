"""Avatars for LiveKit agents. Needs the extra `umo-avatar[livekit]`.

| class | for |
|---|---|
| `AvatarOutput` | an agent that speaks in the room itself: a tap before `session.output.audio`, which yields the poses |
| `AvatarVideo` | an avatar worker that sends video: the `VideoGenerator` of LiveKit's `AvatarRunner` |

    output = umo.agents.livekit.AvatarOutput(session.output.audio, on_pose=send)
    await output.start()
    session.output.audio = output
"""

from __future__ import annotations

import asyncio
import inspect
import math
from collections.abc import AsyncIterator, Awaitable
from types import TracebackType
from typing import Any, Callable, Optional, Union

from livekit import rtc
from livekit.agents.types import USERDATA_TIMED_TRANSCRIPT, TimedString
from livekit.agents.utils import is_given
from livekit.agents.voice.avatar import AudioSegmentEnd, VideoGenerator
from livekit.agents.voice.io import AudioOutput, AudioOutputCapabilities

from .. import lips, words as timed_words
from ._avatar import Avatar, Pose


class AvatarOutput(AudioOutput):
    """An audio output that yields poses, and passes the audio on to `next_in_chain` in sync with them.

    `on_pose` is called with each `Pose` before its audio is passed on; it may be a coroutine function. The other
    arguments are passed to `umo.agents.Avatar`. The rate is the next output's, or 24,000 if that accepts any.

    With `words`, some words of the synthesiser's aligned transcript become gestures, by the engine's rules
    (`umo.Engine.set_word_rules`). With `hints`, the transcript shapes the lips (`umo.lips.Transcript`): use it if the
    synthesiser's times are accurate to 40 ms.
    """

    def __init__(
        self,
        next_in_chain: AudioOutput,
        *,
        on_pose: Callable[[Pose], Union[Awaitable[None], None]],
        hints: bool = False,
        words: bool = False,
        **settings: Any,
    ) -> None:
        rate = settings.pop("rate", None) or next_in_chain.sample_rate or 24000
        if next_in_chain.sample_rate not in (None, rate):
            raise ValueError(f"rate {rate}: the next output needs {next_in_chain.sample_rate}")
        # The agent ends segments explicitly, so there is no timeout.
        self._avatar = Avatar(rate, patience=math.inf, **settings)
        super().__init__(
            label="umo",
            capabilities=AudioOutputCapabilities(pause=True),
            next_in_chain=next_in_chain,
            sample_rate=rate,
        )
        self._on_pose = on_pose
        self._hints = _Hints(self._avatar, hints, words) if hints or words else None
        self._task: Optional[asyncio.Task[None]] = None
        self._resumed = asyncio.Event()
        self._resumed.set()
        self._cuts = 0
        # Segments begun by the agent, and segments that have reached the next output.
        self._captured = 0
        self._passed = 0
        self._is_capturing = False
        # Whether the next output waits for the end of a segment.
        self._is_open = False

    @property
    def avatar(self) -> Avatar:
        """The avatar: use its session for moods, gestures and gaze."""
        return self._avatar

    async def start(self) -> None:
        """Loads the model on another thread. Called by `async with`."""
        if self._task is None:
            await self._avatar.start()
            self._task = asyncio.create_task(self._pass_on())

    async def aclose(self) -> None:
        """Stops and frees the avatar. Called by `async with`."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)
            self._task = None
        await self._avatar.aclose()

    async def __aenter__(self) -> AvatarOutput:
        await self.start()
        return self

    async def __aexit__(
        self, kind: Optional[type[BaseException]], error: Optional[BaseException], trace: Optional[TracebackType]
    ) -> None:
        await self.aclose()

    async def capture_frame(self, frame: rtc.AudioFrame) -> None:
        """Takes the agent's audio."""
        _check(frame, self._avatar)
        if self._task is not None and self._task.done():
            # Raise the task's error, as nothing would be heard any more.
            self._task.result()
        await super().capture_frame(frame)
        self._captured += not self._is_capturing
        self._is_capturing = True
        self._avatar.push(bytes(frame.data))
        if self._hints is not None:
            self._hints.take(frame)

    def flush(self) -> None:
        """The segment is complete."""
        super().flush()
        self._is_capturing = False
        if self._hints is not None:
            self._hints.end()
        self._avatar.end()

    def clear_buffer(self) -> None:
        """Barge-in."""
        self._cuts += 1
        self._is_capturing = False
        if self._hints is not None:
            self._hints.drop()
        self._avatar.interrupt()
        next_in_chain = self.next_in_chain
        assert next_in_chain is not None
        if self._is_open:
            # Outputs report the end of flushed segments, and an agent flushes before it clears.
            self._is_open = False
            next_in_chain.flush()
        next_in_chain.clear_buffer()
        # The next output reports the segments that it knows.
        unheard, self._passed = self._captured - self._passed, self._captured
        for _ in range(unheard):
            self.on_playback_finished(playback_position=0.0, interrupted=True)

    def pause(self) -> None:
        """Pauses audio and poses."""
        super().pause()
        self._resumed.clear()

    def resume(self) -> None:
        """Resumes."""
        super().resume()
        self._resumed.set()

    async def _pass_on(self) -> None:
        next_in_chain = self.next_in_chain
        assert next_in_chain is not None
        speech: Optional[int] = None
        async for pose in self._avatar:
            cuts = self._cuts
            await self._resumed.wait()
            if cuts != self._cuts:
                continue
            answer = self._on_pose(pose)
            if inspect.isawaitable(answer):
                await answer
            if pose.audio and cuts == self._cuts:
                self._passed += pose.speech != speech
                speech = pose.speech
                self._is_open = True
                await next_in_chain.capture_frame(_frame(pose.audio, self._avatar))
            if pose.is_last and cuts == self._cuts:
                self._is_open = False
                next_in_chain.flush()


class AvatarVideo(VideoGenerator):
    """Video and audio for LiveKit's `AvatarRunner`:
    `AvatarRunner(room, audio_recv=…, video_gen=AvatarVideo(render), options=…)`.

    `render` makes a picture of a `Pose`; it is called on another thread. `rate` is that of the incoming audio. The
    other arguments are passed to `umo.agents.Avatar`. `options.video_fps` must be 30.
    """

    def __init__(self, render: Callable[[Pose], rtc.VideoFrame], *, rate: int = 24000, idle: bool = True, **settings: Any) -> None:
        self._render = render
        self._avatar = Avatar(rate, idle=idle, patience=math.inf, **settings)
        self._cuts = 0

    @property
    def avatar(self) -> Avatar:
        """The avatar: use its session for moods, gestures and gaze."""
        return self._avatar

    async def push_audio(self, frame: Union[rtc.AudioFrame, AudioSegmentEnd]) -> None:
        """Takes audio, or the end of a segment."""
        if isinstance(frame, AudioSegmentEnd):
            self._avatar.end()
        else:
            _check(frame, self._avatar)
            self._avatar.push(bytes(frame.data))

    def clear_buffer(self) -> None:
        """Barge-in."""
        self._cuts += 1
        self._avatar.interrupt()

    async def __aiter__(self) -> AsyncIterator[Union[rtc.VideoFrame, rtc.AudioFrame, AudioSegmentEnd]]:
        await self._avatar.start()
        loop = asyncio.get_running_loop()
        async for pose in self._avatar:
            cuts = self._cuts
            yield await loop.run_in_executor(None, self._render, pose)
            if pose.audio and cuts == self._cuts:
                yield _frame(pose.audio, self._avatar)
            if pose.is_last and cuts == self._cuts:
                yield AudioSegmentEnd()

    async def aclose(self) -> None:
        """Frees the avatar."""
        await self._avatar.aclose()


class _Hints:
    """Passes an avatar the hints and words of the transcript that accompanies audio, with times relative to the segment's
    first sample.
    """

    def __init__(self, avatar: Avatar, hints: bool, words: bool) -> None:
        self._avatar = avatar
        self._kinds: list[Callable[[], Union[lips.Transcript, timed_words.Transcript]]] = []
        if hints:
            self._kinds.append(lips.Transcript)
        if words:
            self._kinds.append(timed_words.Transcript)
        self.drop()

    def take(self, frame: rtc.AudioFrame) -> None:
        for piece in frame.userdata.get(USERDATA_TIMED_TRANSCRIPT, []):
            # A piece without an end is a whole sentence with a time estimated by an adapter.
            if isinstance(piece, TimedString) and is_given(piece.start_time) and is_given(piece.end_time):
                for transcript in self._transcripts:
                    for hint in transcript.push(piece, piece.start_time, piece.end_time):
                        self._avatar.hint(hint)

    def end(self) -> None:
        if self._avatar.pushed:
            for transcript in self._transcripts:
                for hint in transcript.finish():
                    self._avatar.hint(hint)
        self.drop()

    def drop(self) -> None:
        self._transcripts = [kind() for kind in self._kinds]


def _check(frame: rtc.AudioFrame, avatar: Avatar) -> None:
    if (frame.sample_rate, frame.num_channels) != (avatar.rate, avatar.channels):
        got = f"{frame.num_channels} channels at {frame.sample_rate} Hz"
        raise ValueError(f"audio of {got}: expected {avatar.channels} at {avatar.rate} Hz")


def _frame(audio: bytes, avatar: Avatar) -> rtc.AudioFrame:
    return rtc.AudioFrame(audio, avatar.rate, avatar.channels, len(audio) // (2 * avatar.channels))
