"""Conversations: turns that are laid out, and measures of frames."""

from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from umo_train.metrics import conversation
from umo_train.metrics.conversation import SAMPLE_RATE, Conversation, Posed, Turn
from umo_train.skeleton import JOINT, JOINTS

READERS = [[np.full(int(length * SAMPLE_RATE), 0.1, np.float32) for length in lengths] for lengths in ((2, 5), (3, 8))]


def motion(eyes_degrees: np.ndarray, head_degrees: np.ndarray) -> Posed:
    """A motion at rest whose eyes are turned to the left, and whose head goes down."""
    turns = np.zeros((len(eyes_degrees), JOINTS, 3))
    turns[:, [JOINT["left_eye"], JOINT["right_eye"]], 1] = np.radians(eyes_degrees)[:, None]
    turns[:, JOINT["head"], 0] = np.radians(head_degrees)
    local = Rotation.from_rotvec(turns.reshape(-1, 3)).as_matrix().reshape(-1, JOINTS, 3, 3)
    return Posed(local, np.zeros((len(turns), 3)), np.zeros(len(turns)))


def test_turns_follow_each_other_and_some_interrupt():
    laid_out = conversation.lay_out(READERS, 120, 0)
    turns = laid_out.turns
    assert len(turns) > 15 and [turn.who for turn in turns[:4]] == [0, 1, 0, 1]
    gaps = [after.start - before.end for before, after in pairwise(turns)]
    assert min(gaps) >= 0 and max(gaps) <= conversation.GAPS_S[1] + 1e-6
    both = np.mean((laid_out.voices[0] != 0) & (laid_out.voices[1] != 0))
    assert 0.01 < both < 0.2
    again = conversation.lay_out(READERS, 120, 0)
    assert again.turns == turns and np.array_equal(again.voices[1], laid_out.voices[1])


def test_looks_and_nods_are_found():
    frames, seconds = 900, 30
    nodding = np.zeros(frames)
    for at in range(100, 800, 150):
        nodding[at : at + 12] = 4 * np.sin(np.pi * np.arange(12) / 12)
    voice = np.zeros(seconds * SAMPLE_RATE, np.float32)
    # Phrases of 4.5 s that end half a second before each nod begins.
    for at in range(100, 800, 150):
        end = int((at / 30 - 0.5) * SAMPLE_RATE)
        voice[max(end - int(4 * SAMPLE_RATE), 0) : end] = 0.1
    speaks = Conversation((voice, 0 * voice), (Turn(0, 0.5, 29.5),))
    # Both runs have the body's own motion, and the layer sways besides.
    clock = np.arange(frames) / 30
    body, sway = 3 * np.sin(2 * np.pi * 1.9 * clock), 2 * np.sin(2 * np.pi * 0.6 * clock)
    one = motion(0 * nodding + 20, 0 * nodding)
    still = [one, motion(0 * nodding, body)]
    found = conversation.measure(speaks, [one, motion(0 * nodding, body + sway + nodding)], still)
    assert found["looks at the speaker while listening"] > 0.75
    assert found["looks at the listener while speaking"] == 0 and found["mutual gaze"] == 0
    assert 8 < found["nods, a minute of listening"] < 12
    assert found["of them within 1.2 s of a phrase's end"] == 1 and found["by chance"] < 0.4


def test_a_look_that_comes_late_is_timed():
    still = np.zeros(300)
    silent = np.zeros(10 * SAMPLE_RATE, np.float32)
    late = motion(np.where(np.arange(300) < 39, 20.0, 0.0), still)
    pair = [motion(still, still), late]
    found = conversation.measure(Conversation((silent, silent), (Turn(0, 1.0, 9.0),)), pair, pair)
    assert abs(found["first look at a new speaker, s, median"] - 0.3) < 0.04


def test_a_mouth_that_moves_with_anothers_voice_is_found():
    silent = np.zeros(10 * SAMPLE_RATE, np.float32)
    speaks = Conversation((silent + 0.1, silent), (Turn(0, 0.0, 5.0),))
    assert np.allclose(conversation.leaky(speaks.voices)[1], 0.1 * conversation.LEAK)
    one = motion(np.zeros(300), np.zeros(300))
    jaw = np.where(np.arange(300) < 75, 0.3, 0.0)
    assert conversation.open_mouths(speaks, [one, Posed(one.local, one.at, jaw)]) == 0.5
    assert conversation.open_mouths(speaks, [Posed(one.local, one.at, jaw), one]) == 0
