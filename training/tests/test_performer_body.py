"""The performer's body: timing, limits, contact, styles."""

import time

import numpy as np
import pytest
from scipy.signal import argrelmin
from scipy.spatial.transform import Rotation

from test_performer_speech import SENTENCES, speech
from umo_train.performer import STYLES, Style, perform
from umo_train.performer.prosody import listen
from umo_train.skeleton import CHANNELS, CONTACT, CONTACT_JOINTS, JOINT, JOINTS_OF, VELOCITY, places, rotations
from umo_train.speech.utterance import Phone, Utterance

LONG = SENTENCES * 3
UPPER = list(JOINTS_OF["upper"])
HANDS = [JOINT["left_wrist"], JOINT["right_wrist"], *JOINTS_OF["hands"]]


def walk(motion):
    """World positions of all joints `[T, 55, 3]`."""
    steps = motion["lower"][:, VELOCITY].astype(np.float64) / 30.0
    at = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)[:-1]])
    at[:, 1] = motion["height"]
    return places(rotations(motion), at)


@pytest.fixture(scope="module")
def spoken():
    return speech(LONG)


@pytest.fixture(scope="module", params=["neutral", "excited", "shy", "angry", "sad", "listening"])
def performed(request, spoken):
    motions = [perform(spoken, STYLES[request.param], seed) for seed in (1, 2)]
    for motion in motions:
        motion["places"], motion["local"] = walk(motion), rotations(motion)
    return motions


def turned(motion, name, axis=None):
    """A joint's rotation angle in degrees `[T]`, or its Euler angles about X, Y and Z."""
    local = Rotation.from_matrix(motion["local"][:, JOINT[name]])
    return np.degrees(local.magnitude()) if axis is None else local.as_euler("YXZ", degrees=True)[:, axis]


def test_channels_are_sound(performed):
    for motion in performed:
        for part, width in CHANNELS.items():
            assert motion[part].dtype == np.float32
            assert motion[part].shape == (len(motion["height"]), width)
            assert np.isfinite(motion[part]).all()
            rows = motion[part][:, : 6 * len(JOINTS_OF[part])].reshape(-1, 2, 3).astype(np.float64)
            np.testing.assert_allclose(np.linalg.norm(rows, axis=-1), 1.0, atol=1e-5)
            np.testing.assert_allclose((rows[:, 0] * rows[:, 1]).sum(-1), 0.0, atol=1e-5)
        assert motion["face"][:, 6:].min() >= 0.0
        assert motion["face"][:, 6:].max() <= 1.0


def test_same_arguments_same_motion():
    made = speech()
    first, again, other = (perform(made, STYLES["excited"], seed) for seed in (7, 7, 8))
    for name in first:
        np.testing.assert_array_equal(first[name], again[name])
    assert np.abs(first["upper"] - other["upper"]).max() > 0.1


def test_joints_stay_within_human_limits(performed):
    most = {"neck": 25, "head": 35, "spine1": 12, "spine2": 12, "spine3": 20, "left_collar": 30, "right_collar": 30}
    most |= {"left_wrist": 85, "right_wrist": 85, "left_elbow": 150, "right_elbow": 150, "left_knee": 60}
    most |= {"right_knee": 60, "left_hip": 45, "right_hip": 45, "left_ankle": 35, "right_ankle": 35, "pelvis": 18}
    for motion in performed:
        for name, limit in most.items():
            assert turned(motion, name).max() < limit, name
        # Knees bend backward only.
        assert turned(motion, "left_knee", 1).min() > 0.0
        assert turned(motion, "right_knee", 1).min() > 0.0


def test_fingers_only_curl_inward(performed):
    for motion in performed:
        for side, sign in (("left", -1.0), ("right", 1.0)):
            for finger in ("index", "middle", "ring", "pinky"):
                for bone in (1, 2, 3):
                    curl = sign * turned(motion, f"{side}_{finger}{bone}", 2)
                    assert curl.min() > -5.0 and curl.max() < 105.0


def test_hands_stay_out_of_the_body(performed):
    for motion in performed:
        at = motion["places"]
        spine = at[:, [JOINT["pelvis"], JOINT["spine2"], JOINT["neck"]]]
        for low, high in ((0, 1), (1, 2)):
            a, b = spine[:, None, low], spine[:, None, high]
            along = np.clip(((at[:, HANDS] - a) * (b - a)).sum(-1) / ((b - a) ** 2).sum(-1), 0.0, 1.0)
            away = np.linalg.norm(at[:, HANDS] - a - along[..., None] * (b - a), axis=-1)
            assert away.min() > 0.105
        face = at[:, [JOINT["head"]]] + np.array([0.0, 0.08, 0.03])
        assert np.linalg.norm(at[:, HANDS] - face, axis=-1).min() > 0.14


def test_planted_feet_do_not_slide(performed):
    for motion in performed:
        at, contact = motion["places"], motion["lower"][:, CONTACT] > 0.5
        speed = np.linalg.norm(np.diff(at[:, CONTACT_JOINTS], axis=0), axis=-1) * 30.0
        assert speed[contact[1:] & contact[:-1]].max() < 0.01
        assert at[:, CONTACT_JOINTS, 1].min() > 0.015
        # The pelvis stays within limits, and at least one foot stands.
        assert np.abs(at[:, 0, [0, 2]]).max() < 0.25
        assert (contact[:, :2].all(1) | contact[:, 2:].all(1)).all()


def test_feet_are_sometimes_set_anew(spoken):
    lifted = [perform(spoken, STYLES["excited"], seed)["lower"][:, CONTACT].min() for seed in range(4)]
    assert min(lifted) == 0.0


def test_nothing_jerks(performed):
    for motion in performed:
        at = motion["places"][:, UPPER]
        assert np.linalg.norm(np.diff(at, axis=0), axis=-1).max() * 30.0 < 3.5
        assert np.linalg.norm(np.diff(at, n=3, axis=0), axis=-1).max() * 30.0**3 < 1500.0
        local = motion["local"]
        step = np.swapaxes(local[:-1], -1, -2) @ local[1:]
        trace = np.clip((np.trace(step, axis1=-2, axis2=-1) - 1.0) / 2.0, -1.0, 1.0)
        assert np.degrees(np.arccos(trace)).max() < 60.0


def _closeness(events, turns):
    nearest = np.abs(np.subtract.outer(events, turns)).min(1)
    return np.exp(-(nearest**2) / (2.0 * 0.1**2)).mean()


@pytest.mark.parametrize("style", ["neutral", "calm", "excited", "explaining", "stern"])
def test_the_body_turns_at_accents(spoken, style):
    heard = listen(spoken)
    own, shifted = [], []
    for seed in (1, 2):
        at = walk(perform(spoken, STYLES[style], seed))[:, UPPER]
        at = at - at[:, :1]
        speed = np.linalg.norm(np.gradient(at, axis=0), axis=-1).mean(1)
        turns = argrelmin(speed, order=7)[0] / 30.0
        own.append(_closeness(heard.accents, turns))
        shifts = (0.43, 0.71, 1.13, 1.57, 2.03)
        shifted += [_closeness((heard.accents + s) % spoken.seconds, turns) for s in shifts]
    assert np.mean(own) > 1.4 * np.mean(shifted)


def test_strokes_end_on_accents(spoken):
    heard = listen(spoken)
    fast, met = 0, 0
    for seed in range(4):
        motion = perform(spoken, STYLES["excited"], seed)
        at = walk(motion)
        for name in ("left_wrist", "right_wrist"):
            speed = np.linalg.norm(np.gradient(at[:, JOINT[name]] - at[:, JOINT["spine3"]], axis=0), axis=-1) * 30.0
            for accent in heard.accents:
                frame = round(accent * 30)
                peak = speed[max(frame - 6, 0) : frame - 1].max()
                if peak > 0.7:
                    fast += 1
                    met += speed[frame - 1 : frame + 2].min() < 0.35 * peak
    assert fast > 20
    assert met > 0.75 * fast


def _statistics(motion):
    channels = np.concatenate([motion[part] for part in CHANNELS], axis=1)
    return np.concatenate([channels.mean(0), channels.std(0), np.abs(np.diff(channels, axis=0)).mean(0)])


def test_styles_are_told_apart():
    """A ridge classifier is trained on some seeds and an utterance, and tested on others."""
    rows, made = [], (speech(LONG[:8]), speech(LONG[1:9][::-1]))
    for k, spoken in enumerate(made):
        rows.append([[_statistics(perform(spoken, style, 50 * k + s)) for s in range(8)] for style in STYLES.values()])
    learn, judge = (np.array(r).reshape(8 * len(STYLES), -1) for r in rows)
    middle, scale = learn.mean(0), learn.std(0) + 1e-4
    learn, judge = (np.c_[(x - middle) / scale, np.ones(len(x))] for x in (learn, judge))
    label = np.repeat(np.arange(len(STYLES)), 8)
    weights = learn.T @ np.linalg.solve(learn @ learn.T + 30.0 * np.eye(len(learn)), np.eye(len(STYLES))[label])
    assert ((judge @ weights).argmax(1) == label).mean() >= 0.9


def test_style_numbers_show(spoken):
    def reach(style):
        at = np.concatenate([walk(perform(spoken, style, seed)) for seed in (5, 6, 7)])
        hands = at[:, [JOINT["left_wrist"], JOINT["right_wrist"]]]
        return np.linalg.norm(np.diff(hands, axis=0), axis=-1).mean(), np.ptp(at[:, HANDS, 0], axis=1).mean()

    assert reach(Style(energy=1.0))[0] > 1.2 * reach(Style(energy=0.0))[0]
    assert reach(Style(gesture_rate=1.0))[0] > 1.5 * reach(Style(gesture_rate=0.0))[0]
    assert reach(Style(openness=1.0))[1] > 1.15 * reach(Style(openness=0.0))[1]


def test_silence_and_short_utterances():
    for seconds in (0.02, 0.2, 6.0):
        count = round(seconds * 16000)
        still = Utterance("none", "", np.zeros(count, np.float32), (Phone("pau", 0.0, seconds),))
        motion = perform(still, Style(), 1)
        for part, width in CHANNELS.items():
            assert motion[part].shape == (still.frames, width)
            assert np.isfinite(motion[part]).all()
    hands = walk(motion)[:, HANDS]
    assert np.ptp(hands, axis=0).max() < 0.12
    # Idle, but moving.
    assert np.ptp(hands, axis=0).max() > 0.001


def test_far_faster_than_real_time(spoken):
    perform(spoken, Style(), 1)
    start = time.process_time()
    perform(spoken, Style(), 2)
    # A fifth of the requirement for an idle core, to allow for busy machines.
    assert spoken.seconds / (time.process_time() - start) > 60.0
