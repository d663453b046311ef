"""The phase of a gesture, as the performer's plan and as one code per frame."""

import numpy as np
import pytest

from test_performer_speech import SENTENCES, speech
from umo_train.data import corpus
from umo_train.performer import STYLES, gestures, intent, perform, strokes
from umo_train.performer.arm_track import ArmTrack
from umo_train.performer.arms import STATE, WRIST
from umo_train.performer.intent import HOLD, PREPARE, REST, RETRACT, STROKE
from umo_train.performer.prosody import listen
from umo_train.speech.utterance import FRAME_RATE


def test_codes_are_of_phase_and_side() -> None:
    left = np.array([REST, STROKE, REST, STROKE, HOLD, PREPARE, RETRACT])
    right = np.array([REST, REST, PREPARE, STROKE, STROKE, HOLD, RETRACT])
    names = [intent.name(int(code)) for code in intent.codes(np.stack([left, right]))]
    # If two phases coincide, the more visible one counts.
    assert names == ["rest", "stroke left", "prepare right", "stroke both", "stroke right", "prepare left",
                     "retract both"]  # fmt: skip
    every = {intent.code(phase, side) for phase in range(5) for side in intent.SIDES}
    assert every == set(range(intent.CODES)) and intent.CODES == 13


def test_phases_of_one_gesture_by_hand() -> None:
    idle, prepared, struck = (np.full(STATE, value) for value in (0.0, 0.1, 0.16))
    track = ArmTrack(idle, 1.0, strokes.library(), np.random.default_rng(2))
    assert track.stroke(5.0, prepared, struck, wait=0.2)
    track.retract(0.8)
    stroke = track.made[0].seconds
    at = np.array([0.0, 5.0 - stroke - 0.2 - 0.01, 5.0 - stroke - 0.1, 5.0 - stroke / 2, 5.1, 5.5, 6.0, 20.0])
    assert track.phase(at).tolist() == [REST, PREPARE, HOLD, STROKE, HOLD, HOLD, RETRACT, REST]
    assert stroke > 0.1
    curve = track.curve(np.array([2.0, 5.0 - stroke, 5.0, 20.0]))
    np.testing.assert_allclose(curve, [idle, prepared, struck, idle], atol=1e-9)


def test_a_stroke_without_time_for_it_is_not_made() -> None:
    idle, prepared, struck = (np.full(STATE, value) for value in (0.0, 0.2, 0.4))
    track = ArmTrack(idle, 1.0, strokes.library(), np.random.default_rng(2))
    assert track.stroke(0.0, prepared, struck)
    made = len(track.times)
    assert not track.stroke(0.2, prepared, struck)
    assert len(track.times) == made and len(track.made) == 1


@pytest.fixture(scope="module")
def spoken():
    return speech(SENTENCES * 3)


def test_strokes_end_on_accents_and_move_the_hand(spoken) -> None:
    prosody = listen(spoken)
    made = gestures.gesticulate(prosody, STYLES["excited"], np.random.default_rng(3))
    speed = np.linalg.norm(np.gradient(made.states[..., WRIST], axis=1), axis=-1) * FRAME_RATE
    striking = made.phases == STROKE
    ends = np.flatnonzero(striking[:, :-1] & ~striking[:, 1:]) % (striking.shape[1] - 1)
    assert len(ends) > 10
    apart = np.abs((ends[:, None] + 1) / FRAME_RATE - prosody.accents).min(1)
    assert apart.max() < 1.5 / FRAME_RATE
    assert speed[striking].mean() > 3 * speed[made.phases == HOLD].mean()
    assert speed[made.phases == REST].max(initial=0.0) < 0.15
    # A stroke follows its preparation, or the hold of a ready hand.
    begins = [(arm, i) for arm, i in zip(*np.nonzero(striking[:, 1:] & ~striking[:, :-1]), strict=True)]
    assert {made.phases[arm, i] for arm, i in begins} <= {PREPARE, HOLD}


def test_the_corpus_keeps_it(tmp_path, spoken) -> None:
    motion = perform(spoken, STYLES["excited"], 1)
    assert motion["intent"].shape == (spoken.frames,) and motion["intent"].max() < intent.CODES
    assert len(np.unique(motion["intent"])) > 6
    corpus.write_item(tmp_path, corpus.Item("00000", "train", "excited", "", 1, spoken))
    corpus._perform_item((tmp_path, tmp_path / "speech" / "00000.npz", None, 0))
    assert (corpus.read_intent(tmp_path, "00000") == motion["intent"]).all()
    corpus.write(tmp_path / "motion" / "00001.npz", {"face": motion["face"]})
    with pytest.raises(ValueError, match="run the step `motion` again"):
        corpus.read_intent(tmp_path, "00001")


def test_the_label_changes_nothing_else(spoken) -> None:
    """The choices use a separate random stream."""
    prosody = listen(spoken)
    one, other = (gestures.gesticulate(prosody, STYLES["calm"], np.random.default_rng(5)) for _ in range(2))
    assert np.array_equal(one.states, other.states) and np.array_equal(one.phases, other.phases)
