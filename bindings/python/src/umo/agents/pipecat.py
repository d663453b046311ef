"""A frame processor for Pipecat: behind the synthesiser, before the output transport. Needs `pip install umo[pipecat]`.

    avatar = umo.agents.pipecat.AvatarProcessor(idle=True)
    pipeline = Pipeline([transport.input(), stt, user, llm, tts, avatar, sender, transport.output(), assistant])

The synthesiser's audio goes on with a `PoseFrame` before each piece, so that a transport or a processor behind gets both in step.
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
)
from pipecat.processors.frame_processor import FrameDirection, FrameProcessor, FrameProcessorSetup

from ._avatar import Avatar, Pose


@dataclass
class PoseFrame(DataFrame):
    """A pose of the avatar. Its audio follows as a `TTSAudioRawFrame`, and is in the pose, too.

    An output transport passes it on when the audio before it was played; an interruption drops it, as it drops audio.
    """

    pose: Pose

    def __str__(self) -> str:
        return f"{self.name}(speech: {self.pose.speech}, time: {self.pose.time:.3f})"


class AvatarProcessor(FrameProcessor):
    """Makes poses of the synthesiser's audio. Frames that come behind audio stay behind it.

    `rate` is the synthesiser's, None the pipeline's; `name` is the processor's. All else are arguments of `umo.agents.Avatar`.
    """

    def __init__(self, *, rate: Optional[int] = None, name: Optional[str] = None, **settings: Any) -> None:
        super().__init__(name=name)
        self._rate = rate
        self._settings = settings
        self._avatar: Optional[Avatar] = None
        self._held: deque[Frame] = deque()
        # One frame of the audio of each speech, for what else it says.
        self._kinds: dict[int, TTSAudioRawFrame] = {}
        self._cuts = 0
        self._is_over = False
        self._task: Any = None

    @property
    def avatar(self) -> Avatar:
        """The avatar, once the pipeline is set up: its session is for moods, gestures and gaze."""
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
                await self.push_error(f"audio of {got}, but the avatar hears {expected}")
                await self._follow(frame)
                return
            avatar.push(frame.audio)
            self._kinds.setdefault(avatar.speeches - 1, frame)
        else:
            if isinstance(frame, (TTSStoppedFrame, EndFrame, StopFrame)):
                self.avatar.end()
            await self._follow(frame)

    async def _follow(self, frame: Frame) -> None:
        """Passes a frame on behind the audio that came before it."""
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
            # The user may cut in while one is passed on. What must arrive does.
            if cuts == self._cuts or not frame.interruptible:
                self._is_over |= isinstance(frame, EndFrame)
                await self.push_frame(frame)
