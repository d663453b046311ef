"""Frames equal those of the C interface and of the program `umo` bit for bit, through every function."""

import json
import os
import subprocess
import warnings
from pathlib import Path

import numpy as np
import pytest

import umo
from umo import _generated, _library


@pytest.fixture(scope="module")
def reference(prefix, tmp_path_factory):
    """Runs the C program: bytes of frames for samples."""
    program = tmp_path_factory.mktemp("c") / "reference"
    library = prefix / "lib"
    command = ["cc", "-std=c11", "-Wall", "-Wextra", "-I", prefix / "include", "-o", program]
    command += [Path(__file__).with_name("reference.c"), "-L", library, "-lumo", f"-Wl,-rpath,{library}"]
    subprocess.run(command, check=True)

    def run(samples, rate, channels=1, axes="gltf"):
        arguments = [prefix, str(rate), str(channels), str(_generated.AXES[axes])]
        return subprocess.run([program, *arguments], input=samples.tobytes(), check=True, stdout=subprocess.PIPE).stdout

    return run


def values(motion):
    """The bits of every value, for comparison."""
    return [motion.frames[name].tobytes() for name in motion.frames.dtype.names]


def as_motion(reference_bytes, like):
    return umo.Motion(np.frombuffer(reference_bytes, like.frames.dtype), like.rate, like.names)


@pytest.mark.parametrize("axes", ["gltf", "unreal", "unity"])
def test_animate_gives_the_frames_of_a_c_program(hello, model, reference, axes):
    motion = umo.animate(*hello, model=model, axes=axes)
    assert len(motion) == len(hello[0]) * 30 // hello[1]
    assert values(motion) == values(as_motion(reference(*hello, axes=axes), motion))


def test_animate_gives_the_frames_of_a_c_program_for_stereo_at_another_rate(hello, model, reference):
    stereo = np.stack([hello[0][:40000], hello[0][1000:41000]], 1)
    motion = umo.animate(stereo, 22050, model=model)
    assert values(motion) == values(as_motion(reference(stereo, 22050, 2), motion))
    assert values(umo.animate(stereo / np.float32(32768), 22050, model=model)) == values(motion)


def test_animate_gives_the_frames_of_umo_animate(whole):
    with open(os.environ["UMO_REFERENCE"], encoding="utf-8") as file:
        header, *frames = map(json.loads, file)
    assert tuple(header["face"]["names"]) == whole.names
    assert tuple(header["joints"]) == umo.JOINTS
    assert len(frames) == len(whole)
    for name in ("translation", "rotations", "face"):
        wanted = np.array([frame[name] for frame in frames], np.float32)
        assert np.array_equal(getattr(whole, name).view(np.uint32), wanted.view(np.uint32)), name
    assert np.array_equal(whole.times, [frame["time"] for frame in frames])


def test_motion_has_the_shapes_that_it_says(whole, model):
    t = len(whole)
    assert whole.rotations.shape == (t, 55, 4) and whole.rotations.dtype == np.float32
    assert whole.translation.shape == (t, 3)
    assert whole.face.shape == (t, len(model.channels)) and whole.names == model.channels
    assert whole.visemes.shape == (t, len(umo.VISEMES))
    assert np.allclose(whole.visemes.sum(1), 1, atol=1e-4)
    assert np.allclose(np.linalg.norm(whole.rotations, axis=2), 1, atol=1e-5)
    assert np.shares_memory(whole.channel("jawOpen"), whole.frames)
    assert np.array_equal(whole.joint("jaw"), whole.rotations[:, umo.JOINTS.index("jaw")])
    assert np.array_equal(whole.index, np.arange(t))
    frame = whole[7]
    assert (frame.index, frame.sample, frame.time) == (7, int(whole.sample[7]), 7 / 30)
    assert np.array_equal(frame.rotations, whole.rotations[7])
    assert len(whole[5:9]) == 4 and whole[5:9][0].index == 5
    with pytest.raises(KeyError, match="jawOpen"):
        whole.channel("jaw_open")


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("settings, animated", [({}, "whole"), ({"horizon": 0}, "live")])
def test_stream_gives_the_frames_of_animate_however_it_is_cut(hello, model, settings, animated, seed, request):
    samples, rate = hello
    animated = request.getfixturevalue(animated)
    cuts = np.sort(np.random.default_rng(seed).integers(0, len(samples), 60))
    chunks = np.split(samples, cuts)
    frames = list(umo.stream(chunks, rate, model=model, **settings))
    assert [frame.index for frame in frames] == list(range(len(animated)))
    for name in ("translation", "rotations", "face", "visemes"):
        assert np.stack([getattr(frame, name) for frame in frames]).tobytes() == getattr(animated, name).tobytes(), name


def test_a_recording_is_heard_ahead_as_far_as_the_model_can(hello, model, whole, live):
    samples, rate = hello
    assert model.max_horizon > 0 and values(whole) != values(live)
    assert values(umo.animate(samples, rate, model=model, horizon=model.max_horizon)) == values(whole)


def test_stream_gives_frames_before_the_speech_is_over(hello, model):
    samples, rate = hello
    taken = []

    def chunks():
        for start in range(0, len(samples), 800):
            taken.append(start)
            yield samples[start : start + 800]

    frames = umo.stream(chunks(), rate, model=model, horizon=0)
    first = next(frames)
    assert first.index == 0
    # No more audio was requested than the frame needs, except for the rest of its block.
    assert len(taken) * 800 <= (1 + model.latency_frames) * rate / 30 + 2 * 800
    frames.close()


def test_a_long_recording_is_longer_than_what_waits_inside(hello, model):
    samples, rate = hello
    long = np.tile(samples, 5)
    motion = umo.animate(long, rate, model=model, threads=1)
    assert len(motion) == len(long) * 30 // rate
    assert np.array_equal(motion.index, np.arange(len(motion)))


def test_no_audio_gives_no_frames(model):
    motion = umo.animate(np.zeros(0, np.float32), 16000, model=model)
    assert len(motion) == 0 and motion.rotations.shape == (0, 55, 4)
    assert list(umo.stream([], 16000, model=model)) == []


def test_seed_and_parameters_change_the_motion(hello, model, whole):
    samples, rate = hello
    again = umo.animate(samples, rate, model=model)
    assert values(again) == values(whole)
    assert values(umo.animate(samples, rate, model=model, seed=7)) != values(whole)
    still = umo.animate(samples, rate, model=model, parameters={"gain_face": 0})
    assert np.abs(still.face).max() < np.abs(whole.face).max()


def test_a_prompt_changes_the_motion(hello, model, whole):
    assert model.has_text
    told = umo.animate(*hello, model=model, prompt="a person dances")
    assert len(told) == len(whole) and values(told) != values(whole)


def test_the_model_can_come_from_memory(hello, whole):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        model = umo.Model(_library.MODEL.read_bytes())
    assert values(umo.animate(*hello, model=model)) == values(whole)


def test_a_recording_s_speech_is_heard_at_any_level_and_in_any_channel(hello, model):
    samples, rate = hello
    speech = samples[: 4 * rate] / np.float32(32768)
    plain = umo.animate(speech, rate, model=model)
    with pytest.warns(UserWarning, match="channels are scaled by 1, -1"):
        opposite = umo.animate(np.stack([speech, -speech], 1), rate, model=model)
    with pytest.warns(UserWarning, match="channels are scaled by 3.05176e-05"):
        integers = umo.animate(samples[: 4 * rate].astype(np.float32), rate, model=model)
    assert values(opposite) == values(plain) == values(integers)
    with pytest.warns(UserWarning, match="channels are scaled by 16"):
        quiet = umo.animate([speech * np.float32(0.02)], rate, model=model)[0]
    assert np.corrcoef(quiet.channel("jawOpen"), plain.channel("jawOpen"))[0, 1] >= 0.85
