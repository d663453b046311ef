"""The frame processor in a Pipecat pipeline, with a scripted voice."""

import asyncio

import numpy as np
import pytest

import umo

pytest.importorskip("pipecat", reason="the package pipecat-ai is not installed: bindings/python/setup installs it")

from loguru import logger
from pipecat.frames.frames import (
    EndFrame,
    Frame,
    InterruptionFrame,
    LLMFullResponseEndFrame,
    OutputAudioRawFrame,
    TTSAudioRawFrame,
    TTSSpeakFrame,
    TTSStartedFrame,
    TTSStoppedFrame,
    TTSTextFrame,
)
from pipecat.pipeline.pipeline import Pipeline
from pipecat.pipeline.worker import PipelineParams, PipelineWorker
from pipecat.processors.frame_processor import FrameDirection, FrameProcessor
from pipecat.services.settings import TTSSettings
from pipecat.services.tts_service import TTSService
from pipecat.transports.base_output import BaseOutputTransport
from pipecat.transports.base_transport import TransportParams
from pipecat.workers.runner import WorkerRunner

from umo.agents.pipecat import AvatarProcessor, PoseFrame

logger.remove()
# Pipecat's own warnings.
pytestmark = pytest.mark.filterwarnings("default")


class Sink(FrameProcessor):
    """Collects the frames that arrive."""

    def __init__(self):
        super().__init__()
        self.frames = []
        self.arrived = asyncio.Event()

    async def process_frame(self, frame: Frame, direction: FrameDirection):
        await super().process_frame(frame, direction)
        self.frames.append(frame)
        self.arrived.set()
        await self.push_frame(frame, direction)

    async def until(self, condition):
        while not condition(self.frames):
            self.arrived.clear()
            await self.arrived.wait()


class Speaker(BaseOutputTransport):
    """A transport that plays in real time."""

    def __init__(self):
        super().__init__(TransportParams(audio_out_enabled=True, audio_out_sample_rate=16000))
        self.played = bytearray()
        self.seen = []

    async def start(self, frame):
        await super().start(frame)
        await self.set_transport_ready(frame)

    async def write_audio_frame(self, frame: OutputAudioRawFrame) -> bool:
        await asyncio.sleep(len(frame.audio) / 2 / frame.sample_rate)
        self.played += frame.audio
        return True

    async def write_transport_frame(self, frame: Frame):
        if isinstance(frame, PoseFrame):
            self.seen.append((frame.pose, len(self.played)))


def run(processors, script, **params):
    """Runs a pipeline while `script` queues frames, the last being an EndFrame."""

    async def all_of_it():
        made = processors()
        worker = PipelineWorker(
            Pipeline(made),
            params=PipelineParams(audio_out_sample_rate=16000, **params),
            cancel_on_idle_timeout=False,
            enable_rtvi=False,
        )
        started = asyncio.Event()

        @worker.event_handler("on_pipeline_started")
        async def on_pipeline_started(_, __):
            started.set()

        async def speak():
            await started.wait()
            await script(worker, *made)
            await worker.queue_frame(EndFrame())

        runner = WorkerRunner(handle_sigint=False)
        await runner.add_workers(worker)
        await asyncio.gather(runner.run(), speak())
        return made

    return asyncio.run(asyncio.wait_for(all_of_it(), 100))


def voice(samples, rate, context="a"):
    """A synthesiser's output, faster than real time."""
    data = samples.astype("<i2").tobytes()
    frames = [TTSStartedFrame(context_id=context)]
    for at in range(0, len(data), 6400):
        frames.append(TTSAudioRawFrame(data[at : at + 6400], rate, 1, context_id=context))
    frames.insert(3, TTSTextFrame("hello", text_type="word"))
    return [*frames, TTSStoppedFrame(context_id=context), LLMFullResponseEndFrame()]


def poses_of(frames):
    return [frame.pose for frame in frames if isinstance(frame, PoseFrame)]


def audio_of(frames):
    return b"".join(frame.audio for frame in frames if isinstance(frame, TTSAudioRawFrame))


def same(poses, motion):
    assert [pose.frame.index for pose in poses] == motion.index.tolist()
    for name in ("rotations", "translation", "face"):
        assert np.array_equal([getattr(pose.frame, name) for pose in poses], getattr(motion, name)), name


def test_poses_and_audio_come_in_step_and_other_frames_stay_in_their_place(hello, live, model):
    samples, rate = hello

    async def speak(worker, processor, sink):
        for frame in voice(samples, rate):
            await worker.queue_frame(frame)

    _, sink = run(lambda: [AvatarProcessor(model=model, lead=None), Sink()], speak)
    frames = sink.frames
    speech = [pose for pose in poses_of(frames) if pose.speech is not None]
    same(speech, live)
    assert audio_of(frames) == samples.astype("<i2").tobytes()
    assert {frame.context_id for frame in frames if isinstance(frame, TTSAudioRawFrame)} == {"a"}
    # Each pose precedes its audio.
    order = [frame for frame in frames if isinstance(frame, (PoseFrame, TTSAudioRawFrame))]
    for pose, audio in zip(order[0 : 2 * len(live) : 2], order[1 : 2 * len(live) : 2]):
        assert pose.pose.audio == audio.audio
    # The word belongs after 0.4 s of audio, the end after all of it.
    kinds = [type(frame) for frame in frames]
    assert len(audio_of(frames[: kinds.index(TTSTextFrame)])) in range(12800, 12800 + 1068)
    assert kinds.index(TTSStartedFrame) < kinds.index(PoseFrame)
    assert audio_of(frames[: kinds.index(TTSStoppedFrame)]) == audio_of(frames)
    assert kinds.index(TTSStoppedFrame) < kinds.index(LLMFullResponseEndFrame) < kinds.index(EndFrame)


class Voice(TTSService):
    """A synthesiser with one fixed sentence and its word times, some of which arrive before their audio."""

    def __init__(self, samples, rate, words):
        settings = TTSSettings(model=None, voice=None, language=None)
        super().__init__(
            sample_rate=rate, push_text_frames=False, push_start_frame=True, push_stop_frames=True, stop_frame_timeout_s=0.3,
            settings=settings,
        )
        self.data, self.rate, self.words = samples.astype("<i2").tobytes(), rate, words

    async def run_tts(self, text, context_id):
        await self.add_word_timestamps(self.words[:1], context_id)
        half = len(self.data) // 4 * 2
        yield TTSAudioRawFrame(self.data[:half], self.rate, 1, context_id=context_id)
        await self.add_word_timestamps(self.words[1:], context_id)
        yield TTSAudioRawFrame(self.data[half:], self.rate, 1, context_id=context_id)


@pytest.mark.parametrize("hints", [True, False])
def test_times_of_words_shape_the_lips_and_are_words(hello, live, model, hints):
    """"big" has no time, and "the" and "top" start with no visible sound."""
    samples, rate = hello
    given, loud = [], [("map", 0.1), ("the", 0.9), ("top", 1.2), ("man", 1.5)]

    async def speak(worker, voice, processor, sink):
        take = processor.avatar.hint
        processor.avatar.hint = lambda hint: (given.append((processor.avatar.speeches, hint)), take(hint))
        for count in range(1, 4):
            await worker.queue_frame(TTSSpeakFrame("Map the top man big."))
            # The second speech arrives while the first one's words are still to be heard, the third after a pause.
            await sink.until(lambda frames: sum(isinstance(frame, TTSStoppedFrame) for frame in frames) >= count)
            await asyncio.sleep(2 if count == 2 else 0)

    processors = lambda: [Voice(samples, rate, loud), AvatarProcessor(model=model, lead=None, hints=hints, words=hints), Sink()]
    *_, sink = run(processors, speak)
    lips, said = ([hint for _, hint in given if isinstance(hint, kind)] for kind in (umo.lips.Hint, umo.words.Word))
    assert (len(lips), len(said)) == ((6, 12) if hints else (0, 0))
    for speech in range(3 if hints else 0):
        first, second = lips[2 * speech : 2 * speech + 2]
        # They equal the synthesiser's times, except for the duration of a call.
        assert first == ("closed", pytest.approx(0.1, abs=0.01), 0.08)
        assert second == ("closed", pytest.approx(1.5, abs=0.01), 0.08)
        assert [(word.text, word.start) for word in said[4 * speech : 4 * speech + 4]] == [
            (text, pytest.approx(start, abs=0.01)) for text, start in loud
        ]
    jaw, close = (model.channels.index(name) for name in ("jawOpen", "mouthClose"))
    poses = [pose for pose in poses_of(sink.frames) if pose.speech == 1]
    assert len(poses) == len(live)
    closed = [pose.frame.face[jaw] - pose.frame.face[close] < 0.01 for pose in poses if 1.51 <= pose.time <= 1.57]
    assert closed and all(closed) == hints


def test_an_end_in_the_middle_waits_for_what_was_said(hello, live, model):
    samples, rate = hello

    async def speak(worker, processor, sink):
        for frame in voice(samples, rate)[:-2]:
            await worker.queue_frame(frame)

    _, sink = run(lambda: [AvatarProcessor(model=model, lead=None), Sink()], speak)
    same([pose for pose in poses_of(sink.frames) if pose.speech == 0], live)
    assert audio_of(sink.frames) == samples.astype("<i2").tobytes() and isinstance(sink.frames[-1], EndFrame)


def test_an_interruption_drops_what_was_not_spoken_and_recovers(hello, live, model):
    samples, rate = hello

    async def speak(worker, processor, sink):
        for frame in voice(samples, rate)[:-2]:
            await worker.queue_frame(frame)
        await sink.until(lambda frames: len(poses_of(frames)) >= 40)
        await worker.queue_frame(InterruptionFrame())
        await sink.until(lambda frames: any(isinstance(frame, InterruptionFrame) for frame in frames))
        for frame in voice(samples[: 2 * rate], rate, "b"):
            await worker.queue_frame(frame)

    _, sink = run(lambda: [AvatarProcessor(model=model, lead=0.1), Sink()], speak)
    frames = sink.frames
    at = next(n for n, frame in enumerate(frames) if isinstance(frame, InterruptionFrame))
    before, after = poses_of(frames[:at]), poses_of(frames[at:])
    same(before, live[: len(before)])
    assert 40 <= len(before) < 100
    assert [pose.frame.index for pose in before + after] == list(range(len(before) + len(after)))
    spoken = [pose for pose in after if pose.speech is not None]
    assert {pose.speech for pose in spoken} == {1} and len(spoken) == 60
    assert audio_of(frames[at:]) == samples[: 2 * rate].astype("<i2").tobytes()
    contexts = {frame.context_id for frame in frames[at:] if isinstance(frame, TTSAudioRawFrame)}
    assert contexts == {"b"}
    assert sum(isinstance(frame, TTSStoppedFrame) for frame in frames) == 1


def test_a_transport_gets_poses_when_their_audio_is_played(hello, model):
    samples, rate = hello

    async def speak(worker, processor, speaker):
        for frame in voice(samples[: 2 * rate], rate):
            await worker.queue_frame(frame)

    _, speaker = run(lambda: [AvatarProcessor(model=model), Speaker()], speak)
    seen = [(pose, played) for pose, played in speaker.seen if pose.speech is not None]
    assert len(seen) == 60 and bytes(speaker.played).startswith(samples[: 2 * rate].astype("<i2").tobytes())
    # Within the chunk of 40 ms that a transport plays at once.
    for pose, played in seen:
        assert -0.041 <= played / 2 / rate - pose.time <= 0.001, (pose.time, played / 2 / rate)


def test_audio_of_another_rate_is_an_error_that_says_what_to_do(hello, model):
    samples, rate = hello
    errors = []

    class Errors(Sink):
        async def process_frame(self, frame, direction):
            await super().process_frame(frame, direction)
            if type(frame).__name__ == "ErrorFrame":
                errors.append(frame.error)

    async def speak(worker, errors, processor, sink):
        await worker.queue_frame(TTSAudioRawFrame(bytes(3200), 8000, 1))

    *_, sink = run(lambda: [Errors(), AvatarProcessor(model=model), Sink()], speak)
    assert len(errors) == 1 and "8000 Hz" in errors[0] and "give AvatarProcessor the rate" in errors[0]
    # It is still heard.
    assert audio_of(sink.frames) == bytes(3200)
