"""Outputs and generators of LiveKit agents, with a scripted voice."""

import asyncio

import numpy as np
import pytest

import umo

pytest.importorskip("livekit.agents", reason="the package livekit-agents is not installed: bindings/python/setup installs it")

from livekit import rtc
from livekit.agents import Agent, AgentSession, tts
from livekit.agents.types import DEFAULT_API_CONNECT_OPTIONS, TimedString
from livekit.agents.voice.avatar import AudioSegmentEnd, QueueAudioOutput
from livekit.agents.voice.io import AudioOutput, AudioOutputCapabilities

from umo.agents.livekit import AvatarOutput, AvatarVideo

pytestmark = pytest.mark.filterwarnings("default")


def run(coroutine):
    return asyncio.run(asyncio.wait_for(coroutine, 100))


class Speaker(AudioOutput):
    """Plays in real time and reports when it is done, like a room's output."""

    def __init__(self, rate):
        super().__init__(label="speaker", capabilities=AudioOutputCapabilities(pause=True), sample_rate=rate)
        self.rate, self.data, self.segments = rate, bytearray(), []
        self.begun = 0.0
        self.timer = None

    async def capture_frame(self, frame):
        await super().capture_frame(frame)
        if not self.data:
            self.begun = asyncio.get_running_loop().time()
            self.on_playback_started(created_at=self.begun)
        self.data += bytes(frame.data)

    def flush(self):
        super().flush()
        left = self.begun + len(self.data) / 2 / self.rate - asyncio.get_running_loop().time()
        self.timer = asyncio.get_running_loop().call_later(max(left, 0), self.over, False)

    def clear_buffer(self):
        if self.data:
            self.over(True)

    def over(self, is_cut):
        if self.timer:
            self.timer.cancel()
        played = min(asyncio.get_running_loop().time() - self.begun, len(self.data) / 2 / self.rate)
        self.segments.append((bytes(self.data), is_cut))
        self.data = bytearray()
        self.on_playback_finished(playback_position=played, interrupted=is_cut)


def frames_of(samples, rate):
    data = samples.astype("<i2").tobytes()
    parts = [data[at : at + 3200] for at in range(0, len(data), 3200)]
    return [rtc.AudioFrame(part, rate, 1, len(part) // 2) for part in parts]


def same(poses, motion):
    assert [pose.frame.index for pose in poses] == motion.index.tolist()
    for name in ("rotations", "translation", "face"):
        assert np.array_equal([getattr(pose.frame, name) for pose in poses], getattr(motion, name)), name


def test_an_output_gives_poses_and_passes_the_audio_on(hello, live, model):
    samples, rate = hello

    async def speak():
        poses, speaker = [], Speaker(rate)

        async def on_pose(pose):
            poses.append((pose, len(speaker.data)))

        async with AvatarOutput(speaker, on_pose=on_pose, model=model, lead=None) as output:
            assert output.sample_rate == rate
            for frame in frames_of(samples, rate):
                await output.capture_frame(frame)
            output.flush()
            event = await output.wait_for_playout()
        return poses, speaker, event

    poses, speaker, event = run(speak())
    speech = [(pose, before) for pose, before in poses if pose.speech == 0]
    same([pose for pose, _ in speech], live)
    assert speaker.segments == [(samples.astype("<i2").tobytes(), False)]
    assert [before for _, before in speech] == [-(-n * rate // 30) * 2 for n in range(len(speech))]
    assert not event.interrupted and event.playback_position == pytest.approx(len(samples) / rate, abs=0.1)


@pytest.mark.parametrize("is_early", [False, True])
def test_an_interrupt_is_told_and_the_next_segment_is_whole(hello, live, model, is_early):
    samples, rate = hello

    async def speak():
        poses, speaker, enough = [], Speaker(rate), asyncio.Event()

        def on_pose(pose):
            poses.append(pose)
            if len(poses) == 40:
                enough.set()

        async with AvatarOutput(speaker, on_pose=on_pose, model=model, lead=0.1) as output:
            for frame in frames_of(samples, rate):
                await output.capture_frame(frame)
            if not is_early:
                await enough.wait()
            output.clear_buffer()
            before = list(poses)
            cut = await asyncio.wait_for(output.wait_for_playout(), 5)
            output.flush()
            for frame in frames_of(samples[:rate], rate):
                await output.capture_frame(frame)
            output.flush()
            whole = await asyncio.wait_for(output.wait_for_playout(), 20)
            return before, poses[len(before) :], speaker, cut, whole

    before, after, speaker, cut, whole = run(speak())
    assert cut.interrupted and not whole.interrupted
    assert (cut.playback_position == 0 and not before) if is_early else cut.playback_position > 1
    assert is_early or len(before) >= 40
    assert all(np.array_equal(pose.frame.rotations, wanted) for pose, wanted in zip(before, live.rotations))
    assert [pose.frame.index for pose in before + after] == list(range(len(before) + len(after)))
    assert b"".join(pose.audio for pose in after if pose.speech == 1) == samples[:rate].astype("<i2").tobytes()
    assert speaker.segments[-1] == (samples[:rate].astype("<i2").tobytes(), False)
    assert len(speaker.segments) == 2 - is_early


def test_a_pause_holds_both(hello, model):
    samples, rate = hello

    async def speak():
        poses, speaker = [], Speaker(rate)
        async with AvatarOutput(speaker, on_pose=poses.append, model=model) as output:
            assert output.can_pause
            for frame in frames_of(samples[:rate], rate):
                await output.capture_frame(frame)
            output.pause()
            await asyncio.sleep(0.5)
            assert not poses and not speaker.data
            output.resume()
            output.flush()
            await output.wait_for_playout()
        return poses

    assert sum(pose.speech == 0 for pose in run(speak())) == 30


class Voice(tts.TTS):
    """A synthesiser with one fixed sentence."""

    def __init__(self, samples, rate):
        super().__init__(capabilities=tts.TTSCapabilities(streaming=False), sample_rate=rate, num_channels=1)
        self.data = samples.astype("<i2").tobytes()

    def synthesize(self, text, *, conn_options=DEFAULT_API_CONNECT_OPTIONS):
        return Sentence(tts=self, input_text=text, conn_options=conn_options)


class Sentence(tts.ChunkedStream):
    async def _run(self, emitter):
        emitter.initialize(request_id="1", sample_rate=self._tts.sample_rate, num_channels=1, mime_type="audio/pcm")
        emitter.push(self._tts.data)
        emitter.flush()


def test_an_agent_speaks_through_it_and_is_interrupted(hello, model):
    """A complete LiveKit agent, except for the room."""
    samples, rate = hello

    async def speak():
        poses, speaker, begun = [], Speaker(rate), asyncio.Event()

        def on_pose(pose):
            poses.append(pose)
            if len(poses) == 20:
                begun.set()

        async with AvatarOutput(speaker, on_pose=on_pose, model=model) as output:
            async with AgentSession(tts=Voice(samples, rate)) as session:
                session.output.audio = output
                await session.start(Agent(instructions="speak"))
                handle = session.say("hello")
                await begun.wait()
                await session.interrupt()
                await handle
                assert handle.interrupted
                cut = len(poses)
                handle = session.say("again")
                await handle
                assert not handle.interrupted
            return poses, cut, speaker

    poses, cut, speaker = run(speak())
    assert 20 <= cut < 150
    (first, is_cut), (second, is_second_cut) = speaker.segments
    assert is_cut and not is_second_cut
    data = samples.astype("<i2").tobytes()
    assert data.startswith(first) and len(first) < len(data)
    # LiveKit's own decoding may add some silence at the end.
    assert second.startswith(data) and not any(second[len(data) :])
    assert [pose.frame.index for pose in poses] == list(range(len(poses)))


class TimedVoice(tts.TTS):
    """A streaming synthesiser, which reports timings with the second half of the audio."""

    def __init__(self, samples, rate, pieces):
        capabilities = tts.TTSCapabilities(streaming=True, aligned_transcript=True)
        super().__init__(capabilities=capabilities, sample_rate=rate, num_channels=1)
        self.data, self.pieces = samples.astype("<i2").tobytes(), pieces

    def synthesize(self, text, *, conn_options=DEFAULT_API_CONNECT_OPTIONS):
        raise NotImplementedError

    def stream(self, *, conn_options=DEFAULT_API_CONNECT_OPTIONS):
        return TimedSentence(tts=self, conn_options=conn_options)


class TimedSentence(tts.SynthesizeStream):
    async def _run(self, emitter):
        emitter.initialize(request_id="1", sample_rate=self._tts.sample_rate, num_channels=1, mime_type="audio/pcm", stream=True)
        async for _ in self._input_ch:
            pass
        emitter.start_segment(segment_id="1")
        self._mark_started()
        half = len(self._tts.data) // 4 * 2
        emitter.push(self._tts.data[:half])
        emitter.push_timed_transcript(self._tts.pieces)
        emitter.push(self._tts.data[half:])
        emitter.end_segment()


WORDS = [TimedString("I ", 0.7, 0.8), TimedString("map ", 1.0, 1.3), TimedString("top ", 1.5, 1.8)]
CHARACTERS = [TimedString(character, 1.0 + 0.1 * at, 1.1 + 0.1 * at) for at, character in enumerate("map top")]
SENTENCE = [TimedString("Map", start_time=1.0), TimedString("map the top", 1.0, 1.8)]


@pytest.mark.parametrize(
    "pieces, hints, expected, said",
    [
        (WORDS, True, [("closed", 1.0, 0.08)], [("I", 0.7, 0.8), ("map", 1.0, 1.3), ("top", 1.5, 1.8)]),
        (
            CHARACTERS,
            True,
            [("closed", 1.0, 0.1), ("closed", 1.2, 0.1), ("closed", 1.6, 0.1)],
            [("map", 1.0, 1.3), ("top", 1.4, 1.7)],
        ),
        (SENTENCE, True, [], [("map the top", 1.0, 1.8)]),
        (WORDS, False, [], []),
    ],
)
def test_an_aligned_transcript_shapes_the_lips_and_has_words(hello, live, model, pieces, hints, expected, said):
    samples, rate = hello

    async def speak():
        poses, given = [], []
        async with AvatarOutput(Speaker(rate), on_pose=poses.append, model=model, lead=None, hints=hints, words=hints) as output:
            take = output.avatar.hint
            output.avatar.hint = lambda hint: (given.append(hint), take(hint))
            async with AgentSession(tts=TimedVoice(samples, rate, pieces), use_tts_aligned_transcript=True) as session:
                session.output.audio = output
                await session.start(Agent(instructions="speak"))
                for _ in range(2):
                    await session.say("map the top")
        return poses, given

    poses, given = run(speak())
    for kind, wanted in ((umo.lips.Hint, expected), (umo.words.Word, said)):
        found = [hint for hint in given if isinstance(hint, kind)]
        assert found == [(what, pytest.approx(first), pytest.approx(second)) for what, first, second in wanted] * 2
    jaw, close = (model.channels.index(name) for name in ("jawOpen", "mouthClose"))
    for number in range(2):
        speech = [pose for pose in poses if pose.speech == number]
        near = lambda time: any(start - 0.08 < time < start + duration + 0.08 for _, start, duration in expected)
        inside = [pose for pose in speech if any(start <= pose.time <= start + duration for _, start, duration in expected)]
        assert len(inside) >= 2 * len(expected)
        assert all(pose.frame.face[jaw] - pose.frame.face[close] < 0.01 for pose in inside)
        if number == 0:
            # The rest equals the result without hints.
            assert all(np.array_equal(p.frame.face, w) for p, w in zip(speech, live.face) if not near(p.time))
            assert expected == [] or not np.array_equal([pose.frame.face for pose in speech][: len(live)], live.face)


def test_a_generator_gives_pictures_and_audio_in_step(hello, live, model):
    samples, rate = hello

    def render(pose):
        picture = rtc.VideoFrame(2, 2, rtc.VideoBufferType.RGBA, bytes(16))
        picture.pose = pose
        return picture

    async def speak():
        generator = AvatarVideo(render, rate=rate, model=model, idle=False, lead=None)
        queue = QueueAudioOutput(sample_rate=rate)
        for frame in frames_of(samples, rate):
            await queue.capture_frame(frame)
        queue.flush()

        async def read():
            async for frame in queue:
                await generator.push_audio(frame)

        reading = asyncio.create_task(read())
        made = []
        async for frame in generator:
            made.append(frame)
            if isinstance(frame, AudioSegmentEnd):
                break
        reading.cancel()
        generator.clear_buffer()
        await generator.aclose()
        return made

    *made, _ = run(speak())
    pictures, sounds = made[::2], made[1::2]
    assert all(isinstance(frame, rtc.VideoFrame) for frame in pictures) and all(isinstance(frame, rtc.AudioFrame) for frame in sounds)
    same([picture.pose for picture in pictures], live)
    assert b"".join(bytes(frame.data) for frame in sounds) == samples.astype("<i2").tobytes()


def test_another_rate_is_refused(model):
    async def refused():
        with pytest.raises(ValueError, match="the next output needs 8000"):
            AvatarOutput(Speaker(8000), on_pose=print, rate=16000)
        output = AvatarOutput(Speaker(None), on_pose=print)
        assert output.sample_rate == 24000
        with pytest.raises(ValueError, match="1 channels at 8000 Hz: expected 1 at 24000 Hz"):
            await output.capture_frame(rtc.AudioFrame(bytes(160), 8000, 1, 80))

    run(refused())
