"""Avatars of voice agents in an event loop, and events of the Realtime API."""

import asyncio
import base64
import json
import os
import pathlib
import sys
import time

import numpy as np
import pytest

import umo
import umo.agents
import umo.agents.openai


def run(coroutine):
    return asyncio.run(asyncio.wait_for(coroutine, 120))


def pieces(samples, seconds, rate):
    """A synthesiser's output: bytes, cut at odd positions."""
    data, size = samples.astype("<i2").tobytes(), int(seconds * rate) * 2 + 1
    return [data[at : at + size] for at in range(0, len(data), size)]


async def spoken(avatar, count=1):
    """The poses until `count` speeches are over."""
    poses = []
    async for pose in avatar:
        poses.append(pose)
        count -= pose.is_last
        if not count:
            return poses


def same(poses, motion):
    assert [pose.frame.index for pose in poses] == motion.index.tolist()
    for name in ("rotations", "translation", "face"):
        assert np.array_equal([getattr(pose.frame, name) for pose in poses], getattr(motion, name)), name


def joints(poses):
    """Largest joint rotation from each pose to the next, degrees."""
    rotations = np.array([pose.frame.rotations for pose in poses])
    cosine = np.abs((rotations[1:] * rotations[:-1]).sum(-1)).clip(0, 1)
    return np.degrees(2 * np.arccos(cosine)).max(-1)


def niceness():
    """Nice value of each thread of this process by name; Linux only."""
    found = {}
    for task in pathlib.Path("/proc/self/task").iterdir():
        name, rest = (task / "stat").read_text().split("(", 1)[1].rsplit(")", 1)
        found[name] = int(rest.split()[16])
    return found


def test_an_avatar_alone_has_a_thread_of_its_priority(model):
    with pytest.raises(ValueError, match="priority 'lwo': did you mean 'low'"):
        umo.agents.Avatar(model=model, priority="lwo")
    with umo.Engine(model) as engine, pytest.raises(ValueError, match="an engine has its priority"):
        umo.agents.Avatar(engine=engine, priority="low")

    async def started():
        async with umo.agents.Avatar(model=model, priority="low"):
            return niceness() if sys.platform == "linux" else None

    found = run(started())
    if found is not None:
        assert found["umo-0"] == os.nice(0) + 10, found


def test_poses_are_those_of_animate_with_the_audio_cut_at_them(hello, live, model):
    samples, rate = hello

    async def speak():
        async with umo.agents.Avatar(rate, model=model, lead=None) as avatar:
            for piece in pieces(samples, 0.1, rate):
                avatar.push(piece)
                await asyncio.sleep(0)
            avatar.end()
            return await spoken(avatar)

    poses = run(speak())
    same(poses, live)
    assert {pose.speech for pose in poses} == {0} and [pose.is_last for pose in poses] == [False] * (len(live) - 1) + [True]
    assert b"".join(pose.audio for pose in poses) == samples.astype("<i2").tobytes()
    for number, pose in enumerate(poses):
        assert pose.time == number / 30
        before = sum(len(each.audio) for each in poses[:number]) // 2
        assert before == -(-number * rate // 30)


def test_speeches_follow_each_other_without_a_jump(hello, model):
    samples, rate = hello
    speech = samples[: 2 * rate]

    def alone():
        """The same calls on a session, one after the other."""
        with umo.Engine(model, polled=True) as engine, engine.session(rate, idle=umo.Idle.HOLD) as session:
            parts = []
            for _ in range(2):
                session.push(speech)
                session.finish()
                while not session.is_done:
                    engine.poll()
                    parts.append(session.pull())
                session.interrupt(0.3)
                parts.append(session.pull())
            return session._layout.joined(parts)

    async def speak():
        async with umo.agents.Avatar(rate, model=model, lead=None, ease=0.3) as avatar:
            for _ in range(2):
                avatar.push(speech)
                avatar.end()
            assert avatar.speeches == 2 and avatar.is_speaking
            poses = await spoken(avatar, 2)
            return poses + [pose async for pose in until_silent(avatar)]

    poses, reference = run(speak()), alone()
    assert [pose.frame.index for pose in poses] == reference.index.tolist() == list(range(138))
    assert [pose.speech for pose in poses] == [0] * 60 + [None] * 9 + [1] * 60 + [None] * 9
    assert [pose.time for pose in poses[69:72]] == [0, 1 / 30, 2 / 30]
    # The second one starts from rest, as the session itself does.
    same(poses, reference)
    assert joints(poses)[60:80].max() < 25


async def until_silent(avatar, seconds=0.3):
    """The remaining poses, until none arrives."""
    poses = avatar.__aiter__()
    while True:
        try:
            yield await asyncio.wait_for(poses.__anext__(), seconds)
        except asyncio.TimeoutError:
            return


def test_poses_come_at_their_time(hello, model):
    samples, rate = hello

    async def speak():
        async with umo.agents.Avatar(rate, model=model, lead=0.1) as avatar:
            avatar.push(samples[: 2 * rate])
            avatar.end()
            times = []
            async for pose in avatar:
                times.append(time.monotonic())
                if pose.is_last:
                    return np.array(times) - times[0]

    times = run(speak())
    assert len(times) == 60
    due = np.arange(60) / 30
    # Never earlier than the lead; the delay depends on the machine.
    assert (times >= due - 0.1 - 0.01).all()
    assert times[-1] > 1.8


def test_an_interrupt_drops_what_was_not_spoken_and_recovers(hello, live, model):
    samples, rate = hello

    async def speak():
        async with umo.agents.Avatar(rate, model=model, lead=0.1, ease=0.2) as avatar:
            avatar.push(samples)
            before, after = [], []
            async for pose in avatar:
                before.append(pose)
                if len(before) == 45:
                    break
            cut = avatar.interrupt()
            assert not avatar.is_speaking and avatar.interrupt() is None
            avatar.push(samples[: 3 * rate])
            avatar.end()
            after = await spoken(avatar)
            return before, cut, after

    before, cut, after = run(speak())
    same(before, live[:45])
    # 45 poses were delivered, up to 0.1 s before they are heard.
    assert cut.speech == 0 and 45 / 30 - 0.15 < cut.seconds <= 45 / 30 + 1e-6
    assert [pose.speech for pose in after] == [None] * 6 + [1] * 90
    assert [pose.frame.index for pose in before + after] == list(range(45 + 96))
    assert b"".join(pose.audio for pose in after) == samples[: 3 * rate].astype("<i2").tobytes()
    assert joints(before + after)[44:60].max() < 25


def test_hints_are_of_their_own_speech(hello, model):
    samples, rate = hello
    jaw, close = (model.channels.index(name) for name in ("jawOpen", "mouthClose"))

    async def speak(hints):
        async with umo.agents.Avatar(rate, model=model, lead=None) as avatar:
            for _ in range(2):
                # The first before any audio, the second with it.
                for hint in hints:
                    avatar.hint(hint)
                avatar.push(samples[: 2 * rate])
                avatar.end()
            return await spoken(avatar, 2)

    plain, hinted = run(speak([])), run(speak([umo.lips.Hint("closed", 1.0, 0.1)]))
    for number in range(2):
        inside = [pose for pose in hinted if pose.speech == number and 1.0 <= pose.time <= 1.1]
        assert len(inside) >= 3
        assert all(pose.frame.face[jaw] - pose.frame.face[close] < 0.01 for pose in inside)
        of = lambda poses: [pose.frame.face for pose in poses if pose.speech == number and not 0.92 < pose.time < 1.18]
        assert np.array_equal(of(plain), of(hinted))


def test_words_are_of_their_own_speech(hello, model):
    samples, rate = hello
    shoulder = umo.JOINTS.index("right_shoulder")

    async def speak(engine, words):
        async with umo.agents.Avatar(rate, engine=engine, lead=None) as avatar:
            for _ in range(2):
                for word in words:
                    avatar.hint(word)
                avatar.push(samples[: 2 * rate])
                avatar.end()
            return await spoken(avatar, 2)

    with umo.Engine(model, threads=1, max_sessions=1, max_batch=1) as engine:
        # "now" means nothing in the rules of English.
        engine.set_word_rules("en", "[class.own]\ngap = 0\nwords = ['now']\ngestures = [{ name = 'stop' }]")
        plain, said = run(speak(engine, [])), run(speak(engine, [umo.words.Word("now", 1.2, 1.5)]))
    for number in range(2):
        of = lambda poses: [pose.frame.rotations[shoulder] for pose in poses if pose.speech == number and 1.3 < pose.time < 1.5]
        assert np.abs(np.subtract(of(said), of(plain))).max() > 0.15


def test_pushed_counts_the_speech_that_is_open(hello, model):
    samples, rate = hello

    async def speak():
        async with umo.agents.Avatar(rate, model=model, lead=None) as avatar:
            assert avatar.pushed == 0
            avatar.push(samples[:rate])
            async for pose in avatar:
                break
            avatar.push(samples[: rate // 2])
            assert avatar.pushed == 1.5
            avatar.end()
            assert avatar.pushed == 0

    run(speak())


def test_an_interrupt_before_the_first_pose_leaves_nothing_of_the_speech(hello, live, model):
    samples, rate = hello

    async def speak():
        avatar = umo.agents.Avatar(rate, model=model, lead=None)
        # Before the start, audio is queued; interrupted audio was never heard.
        avatar.push(samples)
        assert avatar.interrupt() == (0, 0.0)
        async with avatar:
            avatar.push(samples[:rate])
            await asyncio.sleep(0)
            assert avatar.interrupt().seconds == 0
            avatar.push(samples)
            avatar.end()
            return await spoken(avatar)

    poses = run(speak())
    assert {pose.speech for pose in poses} == {2}
    same(poses, live)


def test_with_idle_poses_go_on_between_speeches(hello, model):
    samples, rate = hello

    async def speak():
        async with umo.agents.Avatar(rate, model=model, idle=True, lead=0.1) as avatar:
            poses = []
            async for pose in avatar:
                poses.append(pose)
                if len(poses) == 30:
                    avatar.push(samples[:rate])
                    avatar.end()
                if sum(each.speech is None for each in poses[30:]) > 60:
                    return poses

    poses = run(speak())
    speech = [n for n, pose in enumerate(poses) if pose.speech == 0]
    assert len(speech) == 30 and speech == list(range(speech[0], speech[0] + 30)) and speech[0] >= 30
    idle = np.array([pose.frame.rotations for pose in poses[:30]])
    assert (np.abs(np.diff(idle, axis=0)).max((1, 2)) > 0).sum() > 20, "it does not move"
    assert joints(poses).max() < 25


def test_a_stalled_speech_ends_by_itself_and_a_tiny_one_has_a_pose(hello, live, model):
    samples, rate = hello

    async def speak():
        async with umo.agents.Avatar(rate, model=model, lead=None, patience=0.2) as avatar:
            avatar.push(samples[:rate])
            stalled = await spoken(avatar)
            avatar.end()
            avatar.push(samples[:10])
            assert avatar.mark("behind it")
            avatar.end()
            tiny = [pose for pose in await spoken(avatar) if pose.speech is not None]
            assert not avatar.mark("nothing to wait for")
            return stalled, tiny

    stalled, tiny = run(speak())
    assert len(stalled) == 30 and stalled[-1].is_last
    assert [(pose.speech, pose.marks) for pose in tiny] == [(1, ("behind it",))]
    assert tiny[0].audio[:20] == samples[:10].astype("<i2").tobytes() and not any(tiny[0].audio[20:])


def test_the_loop_is_not_blocked(hello, model):
    samples, rate = hello

    async def speak():
        gaps, over = [], asyncio.Event()

        async def tick():
            while not over.is_set():
                start = time.monotonic()
                await asyncio.sleep(0.001)
                gaps.append(time.monotonic() - start)

        ticking = asyncio.create_task(tick())
        async with umo.agents.Avatar(rate, model=model, lead=None) as avatar:
            avatar.push(np.tile(samples, 4))
            avatar.end()
            poses = await spoken(avatar)
        over.set()
        await ticking
        return poses, gaps

    start = time.process_time()
    poses, gaps = run(speak())
    # Computing takes far longer than the longest blocked interval, also on a busy machine.
    assert len(poses) == int(4 * len(samples) / rate * 30)
    assert sorted(gaps)[-3] < (time.process_time() - start) / 10


def test_with_a_live_voice_poses_go_on_until_the_body_is_there(hello, model):
    samples, rate = hello

    async def speak():
        async with umo.agents.Avatar(rate, model=model, lead=None, voice="live") as avatar:
            for _ in range(2):
                avatar.push(samples[: 2 * rate])
                avatar.end()
            return await spoken(avatar, 2)

    poses = run(speak())
    for number in range(2):
        speech = [pose for pose in poses if pose.speech == number]
        assert 60 < len(speech) < 120 and speech[-1].is_last
        assert b"".join(pose.audio for pose in speech) == samples[: 2 * rate].astype("<i2").tobytes()


def test_packets_come_beside_poses(hello, model):
    samples, rate = hello
    layers = [name for name in umo.Session.parameters() if name.startswith("layer_")]

    async def speak():
        async with umo.agents.Avatar(rate, model=model, lead=None, packets="beside_frames") as avatar:
            for name in layers:
                setattr(avatar.session, name, 0)
            avatar.push(samples)
            avatar.end()
            return await spoken(avatar)

    poses, shown = run(speak()), []
    # Layers belong to the decoder.
    with umo.Decoder(model, idle=umo.Idle.HOLD) as decoder:
        for name in layers:
            setattr(decoder, name, 0)
        for pose in poses:
            for packet in pose.packets:
                decoder.push_packet(packet)
                shown.append(decoder.pull())
        assert decoder.received.packets > 10
    received = np.concatenate([motion.rotations for motion in shown])
    assert np.array_equal(received, [pose.frame.rotations for pose in poses])


def test_wrong_arguments_say_what_is_right(model):
    for settings, message in (
        ({"lead": -1}, "lead -1"),
        ({"idle": True, "lead": None}, "expected a lead"),
        ({"packets": "only"}, "beside_frames"),
        ({"engine": object(), "model": model}, "one of the two"),
    ):
        with pytest.raises(ValueError, match=message):
            umo.agents.Avatar(**settings)
    avatar = umo.agents.Avatar()
    with pytest.raises(RuntimeError, match="not started"):
        avatar.session
    with pytest.raises(TypeError, match="int64"):
        avatar.push([1, 2])
    run(avatar.aclose())
    with pytest.raises(RuntimeError, match="closed"):
        avatar.push(b"\0\0")


# Realtime API


def delta(data, item="item_1", kind="response.output_audio.delta", response="resp_1"):
    return {
        "type": kind,
        "event_id": "event_1",
        "response_id": response,
        "item_id": item,
        "output_index": 0,
        "content_index": 0,
        "delta": base64.b64encode(data).decode(),
    }


def done(item="item_1", kind="response.output_audio.done", response="resp_1"):
    fields = {"type": kind, "event_id": "event_2", "response_id": response, "item_id": item}
    return {**fields, "output_index": 0, "content_index": 0}


def started():
    return {"type": "input_audio_buffer.speech_started", "event_id": "event_3", "item_id": "item_u", "audio_start_ms": 1000}


def typed(events):
    """The same as objects of the package openai."""
    pytest.importorskip("openai", reason="the package openai is not installed")
    from openai.types.realtime import RealtimeServerEvent
    from pydantic import TypeAdapter

    adapter = TypeAdapter(RealtimeServerEvent)
    objects = [adapter.validate_python(event) for event in events]
    assert all(type(each) is not dict for each in objects)
    return objects


@pytest.fixture(scope="module")
def spoken_24k(hello):
    """The speech at the API's rate; that its pitch changes does not matter here."""
    samples, _ = hello
    return samples.astype("<i2").tobytes()


@pytest.mark.parametrize("form", ["dict", "json", "openai", "beta"])
def test_deltas_become_poses(hello, model, spoken_24k, form):
    kinds = {"kind": "response.audio.delta"} if form == "beta" else {}
    events = [delta(spoken_24k[at : at + 9600], **kinds) for at in range(0, len(spoken_24k), 9600)]
    events.append(done(kind="response.audio.done" if form == "beta" else "response.output_audio.done"))
    events.insert(2, {"type": "response.output_audio_transcript.delta", "delta": "hello"})
    if form == "json":
        events = [json.dumps(event) for event in events]
    if form == "openai":
        events = typed([event for event in events if "transcript" not in event["type"]])

    async def speak():
        async with umo.agents.Avatar(24000, model=model, lead=None) as avatar:
            speech = umo.agents.openai.RealtimeAudio(avatar)
            for event in events:
                assert speech.take(event) == []
            return await spoken(avatar)

    poses = run(speak())
    same(poses, umo.animate(hello[0], 24000, model=model, horizon=0))
    assert b"".join(pose.audio for pose in poses) == spoken_24k


def test_the_user_s_speech_truncates_the_item(model, spoken_24k):
    async def speak():
        async with umo.agents.Avatar(24000, model=model, lead=0.1) as avatar:
            speech = umo.agents.openai.RealtimeAudio(avatar)
            speech.take(delta(spoken_24k[:96000]))
            count = 0
            async for pose in avatar:
                count += 1
                if count == 15:
                    break
            answers = speech.take(started())
            # Audio that the server had sent before it heard of the interruption, and its end.
            assert speech.take(delta(spoken_24k[96000:])) == [] and not avatar.is_speaking
            speech.take(done())
            speech.take({"type": "response.done", "response": {"id": "resp_1", "status": "cancelled"}})
            assert speech.take(started()) == []
            speech.take(delta(spoken_24k[:48000], item="item_2", response="resp_2"))
            speech.take(done(item="item_2", response="resp_2"))
            return answers, await spoken(avatar)

    answers, after = run(speak())
    (answer,) = answers
    assert (answer["type"], answer["item_id"], answer["content_index"]) == ("conversation.item.truncate", "item_1", 0)
    assert 350 <= answer["audio_end_ms"] <= 500
    assert b"".join(pose.audio for pose in after) == spoken_24k[:48000]
    assert [pose.speech for pose in after] == [None] * 6 + [1] * 30
    pytest.importorskip("openai", reason="the package openai is not installed: the event's form is not checked")
    from openai.types.realtime import ConversationItemTruncateEvent

    ConversationItemTruncateEvent.model_validate(answer, strict=True)


def test_a_cancelled_response_ends_its_speech_and_cleared_audio_is_dropped(model, spoken_24k):
    async def speak():
        async with umo.agents.Avatar(24000, model=model, lead=None) as avatar:
            speech = umo.agents.openai.RealtimeAudio(avatar, cuts=False)
            speech.take(delta(spoken_24k[:48000]))
            assert speech.take(started()) == []
            speech.take({"type": "response.done", "response": {"id": "resp_1", "status": "incomplete"}})
            poses = await spoken(avatar)
            speech.take(delta(spoken_24k[:48000], item="item_2", response="resp_2"))
            assert speech.take({"type": "output_audio_buffer.cleared", "response_id": "resp_2"}) == []
            assert not avatar.is_speaking
            return poses

    assert len(run(speak())) == 30


def test_what_is_no_event_is_refused(model):
    avatar = umo.agents.Avatar()
    speech = umo.agents.openai.RealtimeAudio(avatar)
    for event, message in (
        ({**delta(b""), "delta": "§"}, "base64"),
        ({**delta(b""), "delta": None}, "base64"),
        ({"type": "response.output_audio.delta", "delta": ""}, "item_id"),
    ):
        with pytest.raises(ValueError, match=message):
            speech.take(event)
    with pytest.raises(TypeError, match="expected a dict"):
        speech.take(3)


def schemas(tools):
    return {tool["name"]: tool["input_schema"] for tool in tools.definitions("anthropic")}


@pytest.fixture()
def three(model):
    """Sessions with equal output unless told otherwise, and their motion over the next two seconds."""
    with umo.Engine(model, polled=True) as engine:
        sessions = [engine.session(24000) for _ in range(3)]

        def shown():
            motions = []
            for session in sessions:
                poses = []
                for step in range(60):
                    session.set_clock(step / 30)
                    pose = session.sample(0).frame
                    poses.append(b"".join(getattr(pose, name).tobytes() for name in ("rotations", "translation", "face")))
                motions.append(poses)
            return motions

        yield sessions, shown


def test_tools_are_made_of_what_the_library_knows(three):
    session = three[0][0]
    rest = np.zeros((30, 55, 4), np.float32) + np.float32([0, 0, 0, 1])
    session.engine.add_gesture("mine", rest, stroke=0.5)
    tools = umo.agents.Tools(session, {"door": (2, 1.5, 1)})
    found = schemas(tools)
    assert tuple(found) == tools.names == ("avatar_gesture", "avatar_mood", "avatar_look")
    gesture = found["avatar_gesture"]["properties"]
    assert gesture["gesture"]["enum"] == list(session.engine.gestures) and {"wave", "mine"} <= set(gesture["gesture"]["enum"])
    assert gesture["place"]["enum"] == ["door"]
    assert {"neutral", "joy", "afraid"} <= set(found["avatar_mood"]["properties"]["mood"]["enum"])
    assert found["avatar_look"]["properties"]["look"]["enum"] == ["auto", "idle", "listening", "thinking", "speaking", "door"]
    for style, schema in (
        ("openai", lambda tool: (tool["type"], tool["function"]["name"], tool["function"]["parameters"])),
        ("responses", lambda tool: (tool["type"], tool["name"], tool["parameters"])),
    ):
        made = tools.definitions(style)
        assert json.loads(json.dumps(made)) == made
        assert [schema(tool) for tool in made] == [("function", name, found[name]) for name in found]
    assert "place" not in schemas(umo.agents.Tools(session))["avatar_gesture"]["properties"]
    with pytest.raises(ValueError, match="style 'gemini': expected one of openai, responses, anthropic"):
        tools.definitions("gemini")
    with pytest.raises(ValueError, match="place 'idle': a look has this name"):
        umo.agents.Tools(session, {"idle": (0, 0, 0)})


@pytest.mark.parametrize(
    "name, arguments, told",
    [
        ("avatar_gesture", {"gesture": "wave", "side": "left", "strength": 0.8}, lambda s: s.play_gesture("wave", side="left", strength=0.8)),
        ("avatar_gesture", '{"gesture": "point", "place": "door"}', lambda s: s.play_gesture("point", target=(2, 1.5, 1))),
        ("avatar_mood", '{"mood": "joy", "strength": 0.5}', lambda s: s.set_mood("joy", 0.5)),
        ("avatar_look", {"look": "door"}, lambda s: s.look_at((2, 1.5, 1))),
        ("avatar_look", {"look": "thinking"}, lambda s: setattr(s, "attention", umo.Attention.THINKING)),
    ],
)
def test_a_call_is_carried_out(three, name, arguments, told):
    (called, twin, other), shown = three
    assert umo.agents.Tools(called, {"door": (2, 1.5, 1)}).call(name, arguments) == "done"
    told(twin)
    first, second, third = shown()
    assert first == second and first != third


def test_a_mood_may_end_by_itself(three, monkeypatch):
    told = []
    monkeypatch.setattr(umo.Session, "set_mood", lambda session, mood, strength=1.0: told.append((mood, strength)))
    tools = umo.agents.Tools(three[0][0])
    assert tools.call("avatar_mood", {"mood": "joy", "seconds": 0.05}) == "done"
    for _ in range(200):
        if len(told) > 1:
            break
        time.sleep(0.02)
    assert told == [("joy", 1.0), ("neutral", 1.0)]
    # A new mood cancels the timer of the old one.
    tools.call("avatar_mood", {"mood": "joy", "seconds": 0.05})
    tools.call("avatar_mood", {"mood": "sad"})
    time.sleep(0.2)
    assert told[2:] == [("joy", 1.0), ("sad", 1.0)]


def test_what_a_model_asks_for_wrongly_is_said_to_it(three):
    (session, *_), shown = three
    tools = umo.agents.Tools(session)
    for name, arguments, said in (
        ("avatar_gesture", "{", "error: "),
        ("avatar_gesture", "[]", "expected an object"),
        ("avatar_gesture", {}, "gesture is missing"),
        ("avatar_gesture", {"gesture": "wafe"}, "did you mean 'wave'"),
        ("avatar_gesture", {"gesture": "wave", "place": "door"}, "unknown argument 'place'"),
        ("avatar_gesture", {"gesture": "wave", "strength": 2}, "strength 2: expected a number from 0 to 1"),
        ("avatar_mood", {"mood": "joy", "seconds": 0}, "seconds 0: expected a number"),
        ("avatar_mood", {"mood": "joy", "strength": True}, "strength True"),
        ("avatar_mood", {"mood": 1}, "mood: expected a text"),
        ("avatar_look", {"look": "door"}, "look 'door'"),
    ):
        answer = tools.call(name, arguments)
        assert answer.startswith("error: ") and said in answer, (arguments, answer)
    first, second, _ = shown()
    assert first == second
    with pytest.raises(LookupError, match="tool 'weather'"):
        tools.call("weather", {})


def test_tools_of_an_avatar_wait_for_its_start(model):
    async def asked():
        avatar = umo.agents.Avatar(model=model)
        tools = umo.agents.Tools(avatar)
        with pytest.raises(RuntimeError, match="not started"):
            tools.definitions()
        async with avatar:
            assert tools.call("avatar_mood", {"mood": "joy", "seconds": 0.05}) == "done"
        # Its mood ends after it was closed.
        await asyncio.sleep(0.2)

    run(asked())
