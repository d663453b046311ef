"""Live avatars: threads, settings, errors, ends."""

import errno
import gc
import os
import pickle
import subprocess
import sys
import threading
import time
import warnings
import weakref

import numpy as np
import pytest

import umo
from conftest import ROOT

SALUTE = ROOT / "tests/capi/salute.glb"


@pytest.fixture()
def engine(model):
    with umo.Engine(model) as engine:
        yield engine


def drain(session, count, seconds=60):
    """Pulls `count` frames of an engine with its own threads."""
    parts, end = [], time.monotonic() + seconds
    while sum(map(len, parts)) < count:
        assert time.monotonic() < end, "no frames arrive"
        parts.append(session.pull())
        time.sleep(0.002)
    return parts


def test_an_audio_thread_pushes_while_this_one_pulls(engine, hello, live):
    samples, rate = hello
    with engine.session(rate, idle=umo.Idle.HOLD) as session:

        def speak():
            rest = samples
            while len(rest):
                taken = session.push(rest[:480])
                rest = rest[taken:]
            session.finish()

        speaker = threading.Thread(target=speak)
        speaker.start()
        parts = drain(session, len(live))
        speaker.join()
        assert sum(map(len, parts)) == len(live)
        for name in ("translation", "rotations", "face"):
            assert b"".join(getattr(part, name).tobytes() for part in parts) == getattr(live, name).tobytes()
        stats, latency = session.stats(), session.latency()
        assert stats.frames >= len(live) and stats.chunks > 0 and stats.silenced == 0
        assert latency.algorithmic_samples == -(-engine.model.latency_frames * rate // 30)
        assert 0 < latency.compute_p50 <= latency.compute_p999 <= latency.compute_max


def test_engines_have_priorities(model, hello):
    with pytest.raises(ValueError, match="priority 'hihg': did you mean 'high'"):
        umo.Engine(model, priority="hihg")
    for priority in ("low", "normal", "high"):
        with umo.Engine(model, priority=priority) as engine, engine.session(hello[1]) as session:
            session.push(hello[0])
            session.finish()
            while not session.is_done:
                time.sleep(0.01)
                session.pull()


def test_sessions_of_an_engine_that_gathers_have_the_same_frames(model, hello):
    with pytest.raises(ValueError, match="batch_window_ms -50"):
        umo.Engine(model, batch_window=-0.05)

    def frames(batch_window):
        with umo.Engine(model, threads=1, batch_window=batch_window) as engine:
            sessions = [engine.session(hello[1], seed=seed) for seed in range(3)]
            for session in sessions:
                session.push(hello[0])
                session.finish()
            found = [[] for _ in sessions]
            while not all(session.is_done for session in sessions):
                time.sleep(0.01)
                for session, of in zip(sessions, found):
                    of.extend(frame.rotations for frame in session.pull())
            return found

    for one, other in zip(frames(0), frames(0.05)):
        assert np.array_equal(one, other)


def test_other_threads_run_while_a_call_computes(model, hello):
    """A Python thread counts while another one is inside one long poll."""
    with umo.Engine(model, polled=True, threads=1) as engine, engine.session(hello[1]) as session:
        session.push(hello[0])
        counted, done = [0], threading.Event()

        def count():
            while not done.is_set():
                counted[0] += 1
                time.sleep(0.0005)

        counter = threading.Thread(target=count)
        counter.start()
        time.sleep(0.01)
        before, start = counted[0], time.monotonic()
        engine.poll()
        during, took = counted[0] - before, time.monotonic() - start
        done.set()
        counter.join()
        assert took > 0.02, "the poll was too short for a measurement"
        assert during >= 5


def test_sample_gives_poses_between_frames(model, hello, live):
    with umo.Engine(model, polled=True) as engine, engine.session(hello[1]) as session:
        session.push(hello[0])
        session.finish()
        engine.poll()
        at = session.sample(1.0)
        assert not at.is_ahead and at.oldest <= 1.0 <= at.newest
        assert np.array_equal(at.frame.rotations, live.rotations[30])
        between = session.sample(1.0 + 0.5 / 30).frame
        assert np.allclose(between.translation, live.translation[30:32].mean(0), atol=1e-6)
        assert not np.array_equal(between.rotations, live.rotations[30])
        assert session.sample(1e6).is_ahead


def test_the_arousal_of_a_voice_is_heard(model, hello):
    with umo.Engine(model, polled=True) as engine, engine.session(hello[1]) as session:
        assert (session.arousal, session.arousal_trend, session.expression) == (0.5, 0.0, 0.5)
        session.push(hello[0])
        engine.poll()
        session.sample(1.5)
        assert 0 < session.arousal < 1 and session.arousal != 0.5
        assert 0 < abs(session.arousal_trend) < 1


def test_interrupt_drops_what_was_not_shown_and_reset_starts_again(model, hello, live):
    with umo.Engine(model, polled=True) as engine, engine.session(hello[1], idle=umo.Idle.HOLD) as session:

        def push():
            rest = hello[0]
            while len(rest):
                rest = rest[session.push(rest) :]
                engine.poll()

        push()
        shown = session.pull(20)
        assert len(shown) == 20
        session.interrupt(0.1)
        push()
        after = session.pull()
        assert after.index[0] == 20 and session.stats().dropped_frames > 0
        session.reset()
        push()
        session.finish()
        engine.poll()
        again = session.pull()
        assert again.index[0] == 0 and len(again) > 100
        assert again.rotations.tobytes() == live.rotations[: len(again)].tobytes()


def test_parameters_are_properties_with_ranges(engine):
    with engine.session(16000) as session:
        for name, parameter in umo.Session.parameters().items():
            setattr(session, name, parameter.maximum)
            assert getattr(session, name) == parameter.maximum
            with pytest.raises(umo.Error, match=name) as caught:
                setattr(session, name, parameter.maximum + 1)
            assert caught.value.status is umo.Status.INVALID_ARGUMENT
            assert getattr(session, name) == parameter.maximum
        session.idle = umo.Idle.LIVE
        assert session.idle == umo.Idle.LIVE and isinstance(session.idle, int)
        with pytest.raises(umo.Error, match="whole"):
            session.top_k = 1.5
        assert "gain_face" in umo.Session.gain_face.name and umo.Session.gain_face.__doc__


def test_the_live_voice_gives_frames_for_what_was_heard(mouth_model, hello):
    samples, rate = hello
    assert mouth_model.has_mouth
    with umo.Engine(mouth_model, polled=True) as engine:
        with engine.session(rate, voice="live") as live, engine.session(rate, voice="delayed") as delayed:
            latency = live.latency()
            assert 0 < latency.mouth_samples <= 0.1 * rate < latency.algorithmic_samples
            assert delayed.latency().mouth_samples == delayed.latency().algorithmic_samples
            heard = latency.algorithmic_samples
            for session in (live, delayed):
                assert session.push(samples[:heard]) == heard
            # Nothing was computed: the mouth does not wait for that.
            assert live.ready >= (heard - latency.mouth_samples) * 30 // rate - 1 and delayed.ready == 0
            assert not np.array_equal(*live.pull().face[[0, -1]])
            with pytest.raises(ValueError, match="voice 'loud'"):
                engine.session(rate, voice="loud")
        short = samples[: 2 * rate]
        spoken = umo.animate(short, rate, model=mouth_model)
        followed = umo.animate(short, rate, model=mouth_model, voice="live")
        assert len(spoken) == 60 and len(followed) == 62 + -(-latency.algorithmic_samples * 30 // rate)


def test_a_model_without_a_mouth_network_has_no_live_voice(hello):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        model = umo.Model(ROOT / "tests/golden/hubert_k1_smplx/model.safetensors")
    assert not model.has_mouth
    with umo.Engine(model, polled=True) as engine, pytest.raises(umo.Error, match="voice") as caught:
        engine.session(hello[1], voice="live")
    assert caught.value.status is umo.Status.INVALID_ARGUMENT


def test_it_looks_listens_and_has_moods(model, hello):
    samples, rate = hello
    short = samples[: 2 * rate]

    def spoken(prepare):
        with umo.Engine(model, polled=True, threads=1) as engine:
            with engine.session(rate, idle=umo.Idle.HOLD) as session:
                prepare(session)
                session.push(short)
                session.finish()
                engine.poll()
                return session.pull()

    plain = spoken(lambda session: None)
    assert plain.rotations.tobytes() == umo.animate(short, rate, model=model, horizon=0).rotations.tobytes()
    head = umo.JOINTS.index("head")
    turned = {}
    for name, side in (("left", 1.0), ("right", -1.0)):
        turned[name] = spoken(lambda session: session.look_at([2 * side, 1.5, 1.0]))
    # Positive about Y is to the avatar's left.
    yaw = {name: 2 * np.arctan2(motion.rotations[-1, head, 1], motion.rotations[-1, head, 3]) for name, motion in turned.items()}
    assert yaw["left"] > yaw["right"] + 0.1
    smile = "mouthSmileLeft"
    happy = spoken(lambda session: session.set_mood("joy"))
    assert happy.channel(smile)[-1] > plain.channel(smile)[-1] + 0.05
    assert umo.animate(short, rate, model=model, horizon=0, mood="joy").face.tobytes() == happy.face.tobytes()
    with umo.Engine(model, polled=True) as engine, engine.session(rate, 2) as session:
        session.push_other(np.zeros((480, 2), np.float32))
        session.push_other(np.zeros(480, np.int16))
        for wrong in (lambda: session.push_other(np.zeros(3)), lambda: session.look_at([0, 0, np.nan])):
            with pytest.raises(umo.Error) as caught:
                wrong()
            assert caught.value.status is umo.Status.INVALID_ARGUMENT
        with pytest.raises(umo.Error, match="mood"):
            session.set_mood("sad", 1.5)
        with pytest.raises(ValueError, match="mood 'sadd': did you mean 'sad'"):
            session.set_mood("sadd")
        with pytest.raises(ValueError, match="3 coordinates"):
            session.look_at([1, 2])
        session.attention = umo.Attention.THINKING
        assert session.attention == umo.Attention.THINKING


def test_settings_of_the_motion_make_the_latency(model):
    with umo.Engine(model, polled=True, threads=1) as engine:
        samples = []
        for smoothing in (None, 0.0):
            with engine.session(30_000, lookahead=0, smoothing=smoothing, guidance=1.0, horizon=0) as session:
                samples.append(session.latency().algorithmic_samples)
        assert samples[0] == samples[1] + 3 * 1000
        for wrong in ({"smoothing": 2.0}, {"guidance": 9.0}, {"horizon": 1000}):
            with pytest.raises(umo.Error, match=next(iter(wrong))):
                engine.session(16_000, **wrong)


def test_what_moves_in_silence_goes_by_the_hosts_time(model):
    with umo.Engine(model, polled=True, threads=1) as engine, engine.session() as session:
        session.set_clock(5.0)
        poses = [session.sample(0.0).frame.rotations.copy() for _ in range(3)]
        assert np.array_equal(poses[1], poses[2])
        session.set_clock(5.5)
        assert not np.array_equal(session.sample(0.0).frame.rotations, poses[2])
        with pytest.raises(umo.Error, match="time"):
            session.set_clock(-1.0)


def test_gestures_play_at_their_time_and_hosts_add_theirs(model, hello):
    samples, rate = hello
    wrist, shoulder = umo.JOINTS.index("right_wrist"), umo.JOINTS.index("right_shoulder")

    def spoken(engine, gesture=None, **options):
        with engine.session(rate, idle=umo.Idle.HOLD) as session:
            if gesture:
                session.play_gesture(gesture, **options)
            session.push(samples[: 4 * rate])
            session.finish()
            parts = []
            while not session.is_done:
                engine.poll()
                parts.append(session.pull().rotations)
            return np.concatenate(parts)

    with umo.Engine(model, polled=True, threads=1) as engine:
        assert {"nod", "wave", "point", "thumbs_up"} <= set(engine.gestures)
        plain, waved = spoken(engine), spoken(engine, "wave", at=2.0)
        moved = np.abs(waved - plain).max(axis=(1, 2))
        assert moved[60] > 0.1 and moved[:20].max() < 1e-3
        left = spoken(engine, "wave", at=2.0, side="left")
        assert np.abs(left[60, shoulder] - plain[60, shoulder]).max() < 0.05 < np.abs(waved[60, shoulder] - plain[60, shoulder]).max()
        varied = spoken(engine, "wave", at=2.0, variant=5)
        assert 0.01 < np.abs(varied[60] - waved[60]).max()
        aside = spoken(engine, "point", at=2.0, target=[-2.0, 1.0, 0.5])
        ahead = spoken(engine, "point", at=2.0, target=[0.0, 1.0, 3.0])
        assert np.abs(aside[60] - ahead[60]).max() > 0.05

        still = np.zeros((31, len(umo.JOINTS), 4), np.float32)
        still[..., 3] = 1
        engine.add_gesture("salute", still, stroke=0.5, parts=["right_arm"])
        assert engine.gestures[-1] == "salute"
        saluted = spoken(engine, "salute", at=2.0)
        assert np.abs(saluted[60, [shoulder, wrist]] - [0, 0, 0, 1]).max() < 0.02
        head = umo.JOINTS.index("head")
        assert np.array_equal(saluted[:, head], plain[:, head])

        engine.add_gesture_file("greet", SALUTE, parts=["right_arm"])
        engine.add_gesture_file("look", SALUTE.read_bytes(), animation="turn", stroke=0.5, parts=["head"])
        assert engine.gestures[-2:] == ("greet", "look")
        greeted = spoken(engine, "greet", at=2.0)
        assert np.abs(greeted[60] - plain[60])[shoulder].max() > 0.2 and np.array_equal(greeted[:, head], plain[:, head])
        with pytest.raises(FileNotFoundError):
            engine.add_gesture_file("greet", "/no/such/file.glb")
        with pytest.raises(umo.Error, match="salute"):
            engine.add_gesture_file("greet", SALUTE, animation="wave")
        with pytest.raises(umo.Error, match="not a glb file"):
            engine.add_gesture_file("greet", b"RIFF")
        with pytest.raises(umo.Error, match="stroke"):
            engine.add_gesture("late", still, stroke=2.0)
        with pytest.raises(ValueError, match="part 'leg'"):
            engine.add_gesture("kick", still, stroke=0.5, parts=["leg"])
        with pytest.raises(ValueError, match="shape"):
            engine.add_gesture("flat", still[0], stroke=0.5)
        with engine.session(rate) as session:
            with pytest.raises(umo.Error, match="somersault"):
                session.play_gesture("somersault")
            with pytest.raises(umo.Error, match="speed"):
                session.play_gesture("nod", speed=9)
            with pytest.raises(ValueError, match="side"):
                session.play_gesture("nod", side="up")
            with pytest.raises(umo.Error, match="variant 256"):
                session.play_gesture("nod", variant=256)
            with pytest.raises(umo.Error) as caught:
                for _ in range(20):
                    session.play_gesture("nod", at=100)
            assert caught.value.status is umo.Status.BUSY


def test_this_machine_tests_itself(engine):
    found = umo.self_test(engine.model)
    assert found.passed, found.report
    assert str(found).startswith("umo ") and "self-test passed" in found.report and "/" not in found.report


def test_a_prompt_that_the_model_was_not_trained_with_brings_a_warning(engine):
    assert "calm" in engine.model.prompts
    with engine.session(16000) as session:
        with pytest.warns(UserWarning, match="not trained with the prompt 'friendly': its prompts are talking"):
            session.set_prompt("friendly")
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            session.set_prompt(" Calm")


def test_prompts_are_texts_or_ids(engine):
    ids = engine.model.encode_text("a person dances")
    assert ids.dtype == np.uint32 and len(ids) > 0
    with engine.session(16000, template="text_to_motion") as session:
        session.set_prompt("a person dances")
        session.set_prompt(ids)
        session.set_prompt("")
        session.set_seed(5)
        with pytest.raises(umo.Error) as caught:
            session.set_prompt(np.full(engine.model.max_prompt + 1, 3, np.uint32))
        assert caught.value.status is umo.Status.INVALID_ARGUMENT


def test_errors_are_in_umo_s_own_words(model, engine, tmp_path):
    (tmp_path / "empty.safetensors").write_bytes(b"")
    with pytest.raises(umo.Error, match="empty") as caught:
        umo.Model(tmp_path / "empty.safetensors")
    with pytest.raises(umo.Error) as caught:
        umo.Model(b"no model at all")
    assert caught.value.status is umo.Status.MODEL and len(str(caught.value)) > 10
    with pytest.raises(umo.Error, match="rate") as caught:
        engine.session(100)
    assert caught.value.status is umo.Status.INVALID_ARGUMENT
    assert pickle.loads(pickle.dumps(caught.value)).status is umo.Status.INVALID_ARGUMENT
    with pytest.raises(umo.Error) as caught:
        engine.session(16000, template="no_such_template")
    with pytest.raises(umo.Error) as caught:
        engine.poll()
    assert caught.value.status is umo.Status.UNSUPPORTED
    with engine.session(16000) as session:
        session.finish()
        with pytest.raises(umo.Error) as caught:
            session.push(np.zeros(10, np.float32))
        assert caught.value.status is umo.Status.FINISHED and "finish" in str(caught.value)


def test_a_model_file_that_cannot_be_opened_is_python_s_own_exception(tmp_path):
    missing = tmp_path / "nothing-here.safetensors"
    with pytest.raises(FileNotFoundError) as caught:
        umo.Model(missing)
    assert (caught.value.errno, caught.value.filename) == (errno.ENOENT, str(missing))
    with pytest.raises(IsADirectoryError) as caught:
        umo.Model(str(tmp_path))
    assert (caught.value.errno, caught.value.filename) == (errno.EISDIR, str(tmp_path))
    # Existing paths that are not regular files get umo's own message.
    with pytest.raises(umo.Error, match="null"):
        umo.Model(os.devnull)


def test_a_misspelt_attribute_is_refused_with_the_nearest_name(engine, model, whole):
    with engine.session(16000) as session:
        for thing, name, near in [
            (session, "gain_hand", "gain_hands"),
            (session, "Temperature", "temperature"),
            (whole, "frame", "frames"),
        ]:
            with pytest.raises(AttributeError, match=f"no attribute '{name}': did you mean '{near}'"):
                setattr(thing, name, 0.5)
            assert not hasattr(thing, name)
        with pytest.raises(AttributeError, match="no attribute 'xyzzy': expected one of activity, attention"):
            session.xyzzy = 1
        for thing, name in [(session, "push"), (session, "rate"), (session, "engine"), (engine, "model"), (model, "name")]:
            with pytest.raises(AttributeError, match=f"cannot set '{name}'"):
                setattr(thing, name, 1)
        with pytest.raises(AttributeError, match="umo.Engine has no attribute 'threads'"):
            engine.threads = 3
        session.gain_hands = 0.5
        assert session.gain_hands == 0.5
    with pytest.raises(ValueError, match="parameter 'gain_hand': did you mean 'gain_hands'"):
        umo.animate(np.zeros(1600), 16000, model=model, parameters={"gain_hand": 1})


def test_a_subclass_has_attributes_of_its_own(model):
    class Named(umo.Engine):
        label: str
        count = 0

    with Named(model) as engine:
        engine.label, engine.count = "one", 3
        with pytest.raises(AttributeError, match="did you mean 'label'"):
            engine.lable = "two"


def test_audio_with_channels_first_is_refused_with_what_to_pass(engine, model):
    stereo = np.zeros((2, 16000), np.float32)
    with engine.session(16000, 2) as session:
        for call in (lambda: session.push(stereo), lambda: umo.animate(stereo, 16000, model=model)):
            with pytest.raises(ValueError, match=r"shape \(2, 16000\).*\[samples, channels\].*audio\.T .*audio\.mean\(axis=0\)"):
                call()
        # The mean of int16 samples is not int16.
        with pytest.raises(ValueError, match=r"audio\.mean\(axis=0\)\.astype\(np\.int16\) for mono"):
            session.push(stereo.astype(np.int16))
        # Few enough samples to be mistaken for channels, but not the session's number.
        with pytest.raises(ValueError, match=r"shape \(2, 40\): expected \[samples, 2\].*audio\.T"):
            session.push(stereo[:, :40])
        with pytest.raises(ValueError, match=r"shape \(5, 0\)"):
            session.push(np.zeros((5, 0), np.float32))
        assert session.push(stereo.T) > 0
    with engine.session(16000) as session:
        assert session.push(stereo.mean(axis=0)) > 0
        assert session.push(stereo.astype(np.int16).mean(axis=0).astype(np.int16)) > 0


def test_what_umo_cannot_see_is_checked_before_it(engine, model):
    with engine.session(16000, 2) as session:
        for bad, error in [
            (np.zeros(4, np.int32), TypeError),
            (np.zeros((4, 3), np.float32), ValueError),
            (np.zeros((2, 2, 2), np.float32), ValueError),
            (["a"], TypeError),
        ]:
            with pytest.raises(error):
                session.push(bad)
        assert session.push(np.zeros((5, 2))) == 5
        assert session.push(np.zeros((5, 4), np.int16)[:, ::2]) == 5
        with pytest.raises(umo.Error, match="channel"):
            session.push(np.zeros(3, np.float32))
    for bad in ({"seed": -1}, {"target": 1 << 32}, {"axes": "blender"}):
        with pytest.raises(ValueError):
            engine.session(16000, **bad)
    with engine.session(16000) as session:
        for call in (lambda: session.set_seed(1 << 64), lambda: session.interrupt(-1), lambda: session.interrupt(2**32)):
            with pytest.raises(ValueError):
                call()
        with pytest.raises(umo.Error):
            session.interrupt(11)
    with pytest.raises(ValueError, match="gain_nose"):
        umo.animate(np.zeros(1600), 16000, model=model, parameters={"gain_nose": 1})


def test_closed_objects_say_so(model, hello):
    engine = umo.Engine(model)
    session = engine.session(hello[1])
    session.close()
    session.close()
    for call in (lambda: session.push(hello[0]), session.pull, session.reset, session.stats, lambda: session.idle):
        with pytest.raises(umo.Error, match="freed") as caught:
            call()
        assert caught.value.status is umo.Status.INVALID_HANDLE
    orphan = engine.session(hello[1])
    engine.close()
    with pytest.raises(umo.Error) as caught:
        orphan.push(hello[0])
    assert caught.value.status is umo.Status.CLOSED
    with pytest.raises(umo.Error):
        engine.session(hello[1])


def test_the_notice_of_a_model_is_a_warning(model):
    if not model.notice:
        pytest.skip("the default model has no notice")
    with pytest.warns(UserWarning, match=model.notice):
        umo.Model().close()


def test_the_skeleton_is_in_the_axes_asked_for(model):
    parents, offsets = model.skeleton()
    assert parents[0] == -1 and all(0 <= parent < i for i, parent in enumerate(parents) if i)
    assert offsets.shape == (len(umo.JOINTS), 3)
    # glTF: left is +X, up is +Y, metres; Unreal: forward is +X, right is +Y, up is +Z, centimetres.
    left, head = umo.JOINTS.index("left_shoulder"), umo.JOINTS.index("head")
    assert offsets[left, 0] > 0 and offsets[head, 1] > 0
    x, y, z = offsets.T
    assert np.allclose(model.skeleton("unreal")[1], 100 * np.stack([z, -x, y], 1), atol=1e-4)
    assert np.allclose(model.skeleton("unity")[1], np.stack([-x, y, z], 1), atol=1e-6)


def test_forgotten_objects_are_freed(model, hello):
    engine = umo.Engine(model, max_sessions=2)
    for _ in range(50):
        session = engine.session(hello[1])
        session.push(hello[0][:4000])
        # A reference cycle, which only the garbage collector can break.
        session._itself = session
        gone = weakref.ref(session)
        del session
        gc.collect()
        assert gone() is None
    # Both slots are free again.
    kept = [engine.session(hello[1]) for _ in range(2)]
    with pytest.raises(umo.Error) as caught:
        engine.session(hello[1])
    assert caught.value.status is umo.Status.FULL
    del kept


def test_python_ends_well_with_everything_open():
    program = """
import threading, time, warnings, numpy as np
warnings.simplefilter("ignore")
import umo
engine = umo.Engine()
sessions = [engine.session(16000, idle=umo.Idle.LIVE) for _ in range(8)]
def speak():
    while True:
        for session in sessions:
            session.push(np.random.default_rng(0).standard_normal(480).astype("f4"))
            session.pull()
threading.Thread(target=speak, daemon=True).start()
time.sleep(0.3)
frames = umo.stream(([np.zeros(16000, "f4")] * 3), 16000)
next(frames)
print("end")
"""
    for _ in range(3):
        done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
        assert (done.returncode, done.stdout) == (0, "end\n"), done.stderr


def resident():
    with open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def test_a_thousand_sessions_leave_no_memory_behind(model, hello):
    samples, rate = hello
    with umo.Engine(model, polled=True, threads=1) as engine:

        def once(i):
            # Every tenth speaks: computing chunks dominates the time of this test.
            speaks = i % 10 == 0
            with engine.session(rate, idle=umo.Idle.HOLD, seed=i) as session:
                session.push(samples[: 20000 if speaks else 2000])
                engine.poll()
                frames = session.pull()
                assert len(frames) > 0 or not speaks

        for i in range(100):
            once(i)
        before = resident()
        for i in range(1000):
            once(i)
        assert resident() - before < 8 << 20, "a session has about 1 MiB"


def test_a_thousand_sessions_at_once(model, hello):
    samples, rate = hello
    with umo.Engine(model, polled=True, max_sessions=1000) as engine:
        sessions = [engine.session(rate, idle=umo.Idle.HOLD) for _ in range(1000)]
        for session in sessions:
            session.push(samples[:20000])
        while engine.poll():
            pass
        first = sessions[0].pull()
        assert len(first) > 0
        for session in sessions[1:]:
            assert session.pull().frames.tobytes() == first.frames.tobytes()
        with pytest.raises(umo.Error) as caught:
            engine.session(rate)
        assert caught.value.status is umo.Status.FULL


def test_a_restored_session_goes_on_with_the_same_bits(model, hello):
    samples, rate = hello
    half = len(samples) // 2
    with umo.Engine(model, polled=True, threads=1) as engine, umo.Engine(model, polled=True, threads=1) as other:
        with engine.session(rate) as first, other.session(rate) as second:
            first.push(samples[:half])
            engine.poll()
            state = first.save()
            ends = []
            for session, runs in ((first, engine), (second, other)):
                if session is second:
                    session.restore(state)
                assert not session.is_done
                session.push(samples[half:])
                session.finish()
                pieces = []
                for _ in range(100):
                    # As many as the queue holds, and then the rest.
                    runs.poll()
                    pieces.append(session.pull().frames)
                    if session.is_done:
                        break
                assert session.is_done
                ends.append(np.concatenate(pieces))
            assert len(ends[0]) > 100
            assert ends[0].tobytes() == ends[1].tobytes()
            for bad in (b"", state[:-1], b"x" * len(state)):
                with pytest.raises(umo.Error):
                    second.restore(bad)
