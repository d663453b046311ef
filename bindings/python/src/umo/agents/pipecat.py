"""A frame processor for Pipecat: behind the synthesiser, before the output transport. Needs the extra `umo-avatar[pipecat]`.

    avatar = umo.agents.pipecat.AvatarProcessor(idle=True)
    pipeline = Pipeline([transport.input(), stt, user, llm, tts, avatar, sender, transport.output(), assistant])

The synthesiser's audio is passed on with a `PoseFrame` before each piece, so that later processors get both in sync.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any, Optional

from pipecat.frames.frames import (
    DataFrame,
    EndFrame,
    Frame,
    InterruptionFrame,
    StopFrame,
    SystemFrame,
    TTSAudioRawFrame,
    TTSStoppedFrame,
    TTSTextFrame,
)
from pipecat.processors.frame_processor import FrameCallback, FrameDirection, FrameProcessor, FrameProcessorSetup

from .. import lips, words as timed_words
from ._avatar import Avatar, Pose


@dataclass
class PoseFrame(DataFrame):
    """A pose of the avatar. Its audio follows as a `TTSAudioRawFrame`, and is also in the pose.

    An output transport passes it on once the audio before it was played; an interruption drops it, like audio.
    """

    pose: Pose

    def __str__(self) -> str:
        return f"{self.name}(speech: {self.pose.speech}, time: {self.pose.time:.3f})"


class AvatarProcessor(FrameProcessor):
    """Converts the synthesiser's audio to poses. Frames that follow audio stay behind it.

    `rate` is the synthesiser's, or None for the pipeline's; `name` is the processor's. The other arguments are passed to
    `umo.agents.Avatar`.

    With `words`, some words become gestures, by the engine's rules (`umo.Engine.set_word_rules`). With `hints`, the times
    of words shape the lips at their first sounds (`umo.lips.of_word`): use it if the synthesiser's times are accurate to
    40 ms. For both the processor must directly follow the synthesiser.
    """

    def __init__(
        self,
        *,
        rate: Optional[int] = None,
        name: Optional[str] = None,
        hints: bool = False,
        words: bool = False,
        **settings: Any,
    ) -> None:
        super().__init__(name=name)
        self._rate = rate
        self._has_hints, self._has_words = hints, words
        self._words = _Words() if hints or words else None
        self._settings = settings
        self._avatar: Optional[Avatar] = None
        self._held: deque[Frame] = deque()
        # One audio frame of each speech, as a template for its other fields.
        self._kinds: dict[int, TTSAudioRawFrame] = {}
        self._cuts = 0
        self._is_over = False
        self._task: Any = None

    @property
    def avatar(self) -> Avatar:
        """The avatar, once the pipeline is set up: use its session for moods, gestures and gaze."""
        if self._avatar is None:
            raise RuntimeError("the pipeline is not set up: there is no avatar yet")
        return self._avatar

    async def setup(self, setup: FrameProcessorSetup) -> None:
        await super().setup(setup)
        self._avatar = Avatar(self._rate or setup.audio_out_sample_rate, **self._settings)
        await self._avatar.start()
        self._task = self.create_task(self._give(self._avatar))

    async def cleanup(self) -> None:
        if self._task is not None:
            await self.cancel_task(self._task)
            self._task = None
        if self._avatar is not None:
            await self._avatar.aclose()
        await super().cleanup()

    async def queue_frame(
        self,
        frame: Frame,
        direction: FrameDirection = FrameDirection.DOWNSTREAM,
        callback: Any = None,
    ) -> None:
        # Called by the synthesiser as it sends the frame, so both clocks are read at the same time.
        if self._words is not None and self._avatar is not None and direction == FrameDirection.DOWNSTREAM:
            self._words.note(frame, self.get_clock().get_time())
        await super().queue_frame(frame, direction, callback)

    async def process_frame(self, frame: Frame, direction: FrameDirection) -> None:
        await super().process_frame(frame, direction)
        if isinstance(frame, InterruptionFrame):
            await self._interrupt(frame, direction)
        elif direction != FrameDirection.DOWNSTREAM or isinstance(frame, SystemFrame):
            await self.push_frame(frame, direction)
        elif isinstance(frame, TTSAudioRawFrame):
            avatar = self.avatar
            if (frame.sample_rate, frame.num_channels) != (avatar.rate, avatar.channels):
                got = f"{frame.num_channels} channels at {frame.sample_rate} Hz"
                expected = f"{avatar.channels} at {avatar.rate} Hz: give AvatarProcessor the rate and channels of the synthesiser"
                await self.push_error(f"audio of {got}, but the avatar takes {expected}")
                await self._follow(frame)
                return
            if self._words is not None:
                self._words.begin(frame.context_id, avatar.pushed)
            avatar.push(frame.audio)
            self._kinds.setdefault(avatar.speeches - 1, frame)
        else:
            if isinstance(frame, (TTSStoppedFrame, EndFrame, StopFrame)):
                self.avatar.end()
            if isinstance(frame, TTSStoppedFrame) and self._words is not None:
                self._words.end(frame.context_id)
            if isinstance(frame, TTSTextFrame) and self._words is not None:
                start = self._words.take(frame, self.avatar.pushed)
                if start is not None:
                    self._hint(frame.text, start)
            await self._follow(frame)

    def _hint(self, text: str, start: float) -> None:
        """Gives the avatar a word of the speech."""
        hint = lips.of_word(text, start) if self._has_hints else None
        word = timed_words.of_word(text, start) if self._has_words else None
        if hint is not None:
            self.avatar.hint(hint)
        if word is not None:
            self.avatar.hint(word)

    async def _follow(self, frame: Frame) -> None:
        """Passes a frame on after the audio that precedes it."""
        if self.avatar.mark(frame):
            self._held.append(frame)
        else:
            self._is_over |= isinstance(frame, EndFrame)
            await self.push_frame(frame)

    async def _interrupt(self, frame: Frame, direction: FrameDirection) -> None:
        self._cuts += 1
        kept = [each for each in self._held if not each.interruptible]
        self._held.clear()
        self._kinds.clear()
        if self._words is not None:
            self._words.drop()
        self.avatar.interrupt()
        await self.push_frame(frame, direction)
        for each in kept:
            await self.push_frame(each)

    async def _give(self, avatar: Avatar) -> None:
        try:
            async for pose in avatar:
                if self._is_over:
                    return
                await self._give_pose(avatar, pose)
        except Exception as error:
            await self.push_error(f"the avatar stopped: {error}", exception=error)

    async def _give_pose(self, avatar: Avatar, pose: Pose) -> None:
        frames: list[Frame] = [PoseFrame(pose)]
        if pose.speech is not None:
            kind = self._kinds[pose.speech]
            frames[0].transport_destination = kind.transport_destination
            if pose.audio:
                heard = TTSAudioRawFrame(pose.audio, avatar.rate, avatar.channels, context_id=kind.context_id)
                heard.transport_destination = kind.transport_destination
                frames.append(heard)
            if pose.is_last:
                del self._kinds[pose.speech]
        for _ in pose.marks:
            frames.append(self._held.popleft())
        cuts = self._cuts
        for frame in frames:
            # The user may cut in while a frame is passed on. Uninterruptible frames still go through.
            if cuts == self._cuts or not frame.interruptible:
                self._is_over |= isinstance(frame, EndFrame)
                await self.push_frame(frame)


class _Words:
    """Start times of words in a speech, in seconds.

    Pipecat stamps words with the pipeline's clock: the seconds reported by the synthesiser, counted from the time when
    it sent the first audio of their context, or the previous word's time if that is later. That origin is recorded as
    frames arrive, and subtracted again.
    """

    def __init__(self) -> None:
        # Clock origin in nanoseconds of the words of each context.
        self._bases: dict[str, int] = {}
        # Start of each context in the speech, seconds.
        self._starts: dict[str, float] = {}
        # Times in their context of words waiting to be processed, seconds, by frame id.
        self._timed: dict[int, float] = {}
        self._last = 0
        self._last_kept = 0

    def note(self, frame: Frame, now: int) -> None:
        """Records a frame as it arrives."""
        if isinstance(frame, InterruptionFrame):
            self._last = self._last_kept
            self._bases.clear()
        elif isinstance(frame, TTSStoppedFrame) and frame.context_id is not None:
            self._bases.pop(frame.context_id, None)
        elif isinstance(frame, (TTSAudioRawFrame, TTSTextFrame)) and frame.context_id is not None:
            if isinstance(frame, TTSAudioRawFrame) or frame.pts is not None:
                base = self._bases.setdefault(frame.context_id, max(self._last, now))
            if isinstance(frame, TTSTextFrame) and frame.pts is not None:
                # Text without a time of its own has the previous word's time.
                if frame.pts > self._last:
                    self._timed[frame.id] = max(frame.pts - base, 0) / 1e9
                self._last = frame.pts
                if not frame.interruptible:
                    self._last_kept = frame.pts

    def begin(self, context: Optional[str], pushed: float) -> None:
        """Audio of a context starts after `pushed` seconds of the speech."""
        if context is not None:
            self._starts.setdefault(context, pushed)

    def take(self, frame: TTSTextFrame, pushed: float) -> Optional[float]:
        """Start of a word in the speech; None if unknown."""
        seconds = self._timed.pop(frame.id, None)
        if seconds is None or frame.context_id is None:
            return None
        return self._starts.setdefault(frame.context_id, pushed) + seconds

    def end(self, context: Optional[str]) -> None:
        """Ends a context, which may start again."""
        if context is not None:
            self._starts.pop(context, None)

    def drop(self) -> None:
        """Forgets words that were not processed."""
        self._starts.clear()
        self._timed.clear()
