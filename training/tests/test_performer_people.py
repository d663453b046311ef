"""The performer's motion compared with people's numbers: properties over several seeds of fixed, synthetic speech."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from test_performer_speech import SENTENCES, speech
from umo_train.performer import STYLES, clearance, gestures, perform
from umo_train.performer.bearing import bear
from umo_train.performer.prosody import listen
from umo_train.performer.report import Take, measure, runs, world_places, world_rotation
from umo_train.skeleton import CONTACT, JOINT, rotations
from umo_train.speech.utterance import SAMPLE_RATE, SILENCE, Phone, Utterance

LONG = SENTENCES * 6
SEEDS = range(6)
# Styles with numbers of people for comparison; a few takes suffice for the others.
MEASURED = ("neutral", "explaining", "excited")


def chest_heading(motion):
    """Heading of the chest `[T]`, radians to the left."""
    forward = world_rotation(rotations(motion), JOINT["spine3"])[:, :, 2]
    return np.arctan2(forward[:, 0], forward[:, 2])


@pytest.fixture(scope="module")
def spoken():
    return speech(LONG)


@pytest.fixture(scope="module")
def takes(spoken):
    """Several takes of each style, by name."""
    heard = listen(spoken)

    def of(name):
        seeds = SEEDS if name in MEASURED else SEEDS[:2]
        return [Take(perform(spoken, STYLES[name], seed), heard) for seed in seeds]

    return {name: of(name) for name in STYLES}


@pytest.fixture(scope="module")
def numbers(takes):
    return {name: measure(takes[name]) for name in MEASURED}


@pytest.mark.parametrize(("style", "least"), [("neutral", (2.5, 2.0, 1.5)), ("explaining", (4.0, 3.5, 2.5))])
def test_head_moves_as_far_as_peoples(numbers, style, least):
    for name, bar in zip(("yaw", "pitch", "roll"), least, strict=True):
        # More than twice a lively speaker's value would no longer look like talking.
        assert bar <= numbers[style][f"head {name} sd, deg"] < 12.0


def test_head_is_hardly_ever_still(numbers):
    assert numbers["neutral"]["head below 5 deg/s"] < 0.2
    assert numbers["explaining"]["head below 5 deg/s"] < 0.12


def test_nods_fall_on_accents(numbers):
    for style in ("neutral", "explaining"):
        assert numbers[style]["nods on accents, own / shifted"] > 1.5


def test_head_leads_and_trunk_follows(spoken):
    """The trunk's rotation correlates best with the head's when shifted later."""
    heard = listen(spoken)
    found = []
    for seed in SEEDS:
        made = bear(heard, STYLES["explaining"], np.random.default_rng(seed))
        head, trunk = (np.gradient(gaussian_filter1d(x[:, 1], 3.0)) for x in (made.head, made.trunk))
        fit = [np.corrcoef(head[: len(head) - k] if k else head, trunk[k:])[0, 1] for k in range(25)]
        found.append(int(np.argmax(fit)))
    assert np.median(found) >= 4


def test_head_turns_ahead_of_a_phrase(spoken):
    """More of a new attitude's rotation precedes the phrase than with shifted phrases."""
    heard = listen(spoken)
    starts = heard.phrases[1:, 0]
    own, shifted = [], []
    for seed in SEEDS:
        head = bear(heard, STYLES["neutral"], np.random.default_rng(seed)).head
        speed = np.linalg.norm(np.gradient(gaussian_filter1d(head, 2.0, axis=0), axis=0), axis=1)
        at = np.round(starts * 30).astype(int)
        own.append(speed[at[:, None] + np.arange(-6, 6)].mean())
        shifted.append(speed.mean())
    assert np.mean(own) > 1.15 * np.mean(shifted)


def test_shoulder_blades_take_part(numbers):
    assert numbers["explaining"]["collar rms, deg"] > 3.0


def test_the_head_looks_ahead_on_average(takes):
    for made in takes.values():
        turned = [world_rotation(rotations(take.motion), JOINT["head"])[:, :, 2] for take in made]
        forward = np.concatenate(turned).mean(axis=0)
        assert forward[2] > 0.93
        assert abs(forward[0]) < 0.12


def test_gestures_come_in_phrases(numbers):
    for style in ("neutral", "explaining"):
        assert 2.0 <= numbers[style]["gesture phrase, median s"] <= 6.0, style


def test_hands_move_like_peoples(numbers):
    for style in ("neutral", "explaining"):
        found = numbers[style]
        assert found["both hands still"] < 0.15
        assert found["strokes a minute"] > 100
        assert 100.0 <= found["wrist jerk 95 %, m/s3"] <= 400.0
        assert 0.6 <= found["stroke peak 50 %, m/s"] <= 1.0
    assert numbers["explaining"]["path of both wrists, m/min"] > 30.0


def test_the_body_turns_on_accents(numbers):
    for style in ("neutral", "explaining", "excited"):
        assert numbers[style]["body's turns on accents, own / shifted"] > 1.92


def test_hands_stay_out_of_each_other_and_of_the_trunk(takes):
    for made in takes.values():
        for take in made:
            at = world_places(take.motion)
            points = clearance.hand_points(at)
            # Two fingers are this thick.
            assert clearance.between_hands(points).min() > 0.018
            yaw = chest_heading(take.motion)
            assert clearance.inside_trunk(points, at, yaw).max() < 0.02


def test_hands_that_would_meet_are_parted(spoken, takes, monkeypatch):
    """Without the clearance some hands meet: the test above can fail."""
    monkeypatch.setattr(clearance, "clear", lambda states, yaw, solve: states)
    apart = [
        clearance.between_hands(clearance.hand_points(world_places(perform(spoken, STYLES["explaining"], seed)))).min()
        for seed in SEEDS
    ]
    assert min(apart) < 0.018


def silence(seconds=4.0):
    count = round(seconds * SAMPLE_RATE)
    return Utterance("none", "", np.zeros(count, np.float32), (Phone(SILENCE, 0.0, seconds),))


def test_rests_are_several_and_no_fig_leaf(monkeypatch):
    seen = []
    for kind in gestures.RESTS:
        monkeypatch.setattr(gestures, "choose_rest", lambda style, random, kind=kind: kind)
        for seed in range(3):
            # The crotch is 0.1 m below the pelvis joint.
            at = world_places(perform(silence(), STYLES["neutral"], seed))
            points = clearance.hand_points(at) - at[:, 0][None, :, None]
            middle = np.abs(points[..., 0]) < 0.1
            assert points[..., 1][middle].min(initial=1.0) > -0.05
            assert clearance.between_hands(clearance.hand_points(at)).min() > 0.02
        seen.append((at[:, [JOINT["left_wrist"], JOINT["right_wrist"]]] - at[:, :1]).mean(axis=0))
    for k, one in enumerate(seen):
        assert all(np.abs(one - other).max() > 0.04 for other in seen[:k])


def test_a_speaker_rests_in_several_ways(spoken):
    chosen = {gestures.choose_rest(STYLES["neutral"], np.random.default_rng(seed)) for seed in range(200)}
    assert chosen == set(gestures.RESTS)


def test_weight_shifts_and_steps_with_planted_feet(numbers, takes):
    for style in ("neutral", "explaining"):
        assert numbers[style]["weight shifts a minute"] > 12
        assert numbers[style]["pelvis rms, deg"] > 3.5
        assert numbers[style]["hip rms, deg"] > 5.0
        assert numbers[style]["planted feet's slide 95 %, cm/s"] < 1.0
    lifted = [take.motion["lower"][:, CONTACT] < 0.5 for take in takes["explaining"]]
    steps = sum(len(runs(foot)) for flags in lifted for foot in flags[:, ::2].T)
    minutes = sum(len(flags) for flags in lifted) / 30 / 60
    assert 2.0 < steps / minutes < 20.0


def test_head_and_trunk_never_jump(spoken):
    """An attitude may start before the previous one is reached."""
    for seed in range(12):
        made = bear(listen(spoken), STYLES["excited"], np.random.default_rng(seed))
        for turned in (made.head, made.trunk):
            # Between two frames, in rad/s.
            assert np.abs(np.diff(turned, axis=0)).max() * 30.0 < 2.0
            assert np.abs(np.diff(turned, n=2, axis=0)).max() * 30.0**2 < 10.0
