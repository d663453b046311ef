"""Scenes: who speaks has the floor, and the others look there."""

import math

import numpy as np
import pytest

import umo

# The speaker is to the listener's left.
SPEAKER, LISTENER = (1.0, 0.0, 1.0), (0.0, 0.0, 0.0)
SECONDS = 3


@pytest.fixture(scope="module")
def engine(model):
    with umo.Engine(model, polled=True, threads=1) as engine:
        yield engine


def voices(engine, hello):
    """A session that has heard the recording, and one that has heard silence."""
    samples, rate = hello
    sessions = [engine.session(rate), engine.session(rate)]
    for session, heard in zip(sessions, (samples, np.zeros_like(samples))):
        session.push(heard[: SECONDS * rate])
        session.finish()
    while engine.poll():
        pass
    return sessions


def play(scene, sessions, frames=SECONDS * 30):
    """The frames of each session, and who had the floor at each."""
    shown, floors = [[] for _ in sessions], []
    for _ in range(frames):
        if scene is not None:
            scene.update(1 / 30)
            floors.append(scene.floor)
        for session, of in zip(sessions, shown):
            of.extend(session.pull(1))
    return shown, floors


def yaw(frame):
    """Turn of neck and head to the left, radians, if it is about the upward axis alone."""
    turns = (frame.rotations[umo.JOINTS.index(name)] for name in ("neck", "head"))
    return sum(2 * math.atan2(turn[1], turn[3]) for turn in turns)


@pytest.fixture(scope="module")
def alone(engine, hello):
    sessions = voices(engine, hello)
    shown, _ = play(None, sessions)
    for session in sessions:
        session.close()
    return shown


def test_who_speaks_has_the_floor_and_the_listener_turns_there(engine, hello, alone):
    sessions = voices(engine, hello)
    with umo.Scene(seed=1) as scene:
        speaker = scene.add(sessions[0], SPEAKER, math.pi)
        listener = scene.add(sessions[1], LISTENER)
        scene.set_allowed(listener, ["look"])
        shown, floors = play(scene, sessions)
        assert floors[0] is None and set(floors[45:75]) == {speaker}
        found = scene.member(listener)
        assert found.level == 0 and scene.member(speaker).level > 0.001
        with pytest.raises(umo.Error, match="no such member 9"):
            scene.member(9)
    turned = [yaw(together) - yaw(before) for together, before in zip(shown[1], alone[1])]
    assert np.mean(turned[45:75]) > math.radians(5), np.degrees(turned)
    for session in sessions:
        session.close()


def test_a_target_is_looked_at_whatever_is_said(engine, hello, alone):
    sessions = voices(engine, hello)
    with umo.Scene() as scene:
        speaker, listener = scene.add(sessions[0], SPEAKER), scene.add(sessions[1], LISTENER)
        scene.set_target(listener, speaker)
        scene.set_target(listener, None)
        with pytest.raises(ValueError, match="did you mean 'look'"):
            scene.set_allowed(listener, ["lok"])
        with pytest.raises(umo.Error):
            scene.set_target(listener, listener)
        scene.set_allowed(listener, ["look"])
        # To its right.
        scene.set_target(listener, [-2.0, 1.6, 2.0])
        shown, _ = play(scene, sessions, 60)
    turned = [yaw(together) - yaw(before) for together, before in zip(shown[1], alone[1])]
    assert np.mean(turned[30:60]) < math.radians(-5), np.degrees(turned)
    for session in sessions:
        session.close()


def test_a_person_speaks_by_a_microphone(hello):
    samples, rate = hello
    with umo.Scene(axes="unity") as scene:
        person = scene.add(position=(0.0, 0.0, 2.0), facing=math.pi, eye_height=1.7)
        other = scene.add()
        step = rate // 30
        for at in range(0, rate * 3 // 2, step):
            scene.push(person, samples[at : at + step])
            scene.update(1 / 30)
        assert scene.floor == person
        assert scene.member(person).role == umo.Role.SPEAKING
        assert scene.member(other).role == umo.Role.LISTENING
        scene.set_place(person, (1.0, 0.0, 2.0))
        scene.remove(person)
        scene.update(1 / 30)
        assert scene.floor is None


def test_a_restored_scene_goes_on_with_the_same_bits(engine, hello):
    sessions = voices(engine, hello)
    scene = umo.Scene(seed=3)
    members = [scene.add(session, place) for session, place in zip(sessions, (SPEAKER, LISTENER))]
    play(scene, sessions, 30)
    state = scene.save()
    first, floors = play(scene, sessions, 20)
    scene.restore(state)
    again, same = play(scene, sessions, 20)
    assert floors == same and members[0] in floors
    for a, b in zip(first, again):
        assert len(a) == len(b) == 20
        assert all(np.array_equal(x.rotations, y.rotations) for x, y in zip(a, b))
    with pytest.raises(umo.Error) as error:
        scene.restore(state[:-1])
    assert error.value.status == umo.Status.STATE
    # Freed in any order: a session first, then the scene, then the other session.
    sessions[0].close()
    scene.update(1 / 30)
    assert scene.floor != members[0]
    scene.close()
    assert len(sessions[1].pull(1)) == 1
    sessions[1].close()
    with pytest.raises(umo.Error) as error:
        scene.update(1 / 30)
    assert error.value.status == umo.Status.INVALID_HANDLE
