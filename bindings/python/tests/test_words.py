"""Words of synthesisers, and their effect in a session."""

import numpy as np
import pytest

import umo
from umo import words

RULES = "[class.own]\nwords = ['now']\ngestures = [{ name = 'stop' }]"
"""In the rules of English "now" means nothing."""


def test_a_word_without_an_end_is_as_long_as_its_letters():
    assert words.of_word(" No, ", 1.0, 1.2) == ("No,", 1.0, 1.2)
    assert words.of_word("impossible", 1.0) == ("impossible", 1.0, pytest.approx(1.7))
    assert words.of_word("no", 1.0, 0.9) == ("no", 1.0, 1.0)
    assert words.of_word("no", 1.0).after(2.0) == ("no", 3.0, pytest.approx(3.14))
    for text, start, end in (
        (" ", 1.0, 1.2),
        ("a\0", 1.0, 1.2),
        ("a " * 65, 1.0, 9.0),
        ("a", 0.0, 31.0),
        ("a", float("nan"), 1.0),
    ):
        assert words.of_word(text, start, end) is None


def test_characters_are_words_between_blanks():
    text = " I don't,  no."
    starts = np.arange(len(text)) / 10
    made = words.of_characters(text, starts, starts + 0.1)
    assert [word.text for word in made] == ["I", "don't,", "no."]
    assert [(word.start, word.end) for word in made] == [
        pytest.approx(pair) for pair in ((0.1, 0.2), (0.3, 0.9), (1.1, 1.4))
    ]
    with pytest.raises(ValueError, match="the same number"):
        words.of_characters("ab", [0.0], [0.1])


def test_a_transcript_gives_words_as_they_end():
    transcript = words.Transcript()
    assert transcript.push("Well, ", 0.1, 0.4) == [("Well,", 0.1, 0.4)]
    assert transcript.push("I", 0.5, 0.55) == []
    assert transcript.push("say no ", 0.6, 0.8) == [("I", 0.5, 0.55), ("say no", 0.6, 0.8)]
    made = [transcript.push(character, 1 + 0.1 * at, 1.1 + 0.1 * at) for at, character in enumerate("no, n")]
    assert made == [[], [], [], [("no,", 1.0, pytest.approx(1.3))], []]
    assert [word.text for word in transcript.finish()] == ["n"] and transcript.finish() == []
    # Times that begin anew.
    assert transcript.push("no", 0.0, 0.2) == [] and transcript.push("no", 3.0, 3.2) == []


def test_words_become_gestures_of_a_session(hello, model):
    samples, rate = hello
    shoulder = umo.JOINTS.index("right_shoulder")

    def run(session, said):
        session.expression = 0  # without the voice's own movement
        for word in said:
            session.hint_words(*word)
        session.push(samples[: 3 * rate])
        session.finish()
        parts = []
        while not session.is_done:
            session.engine.poll()
            parts.append(session.pull().rotations)
        return np.concatenate(parts)[:, shoulder]

    with umo.Engine(model, polled=True) as engine:
        with engine.session(rate) as session:
            plain = run(session, [])
        with engine.session(rate) as session:
            assert np.array_equal(run(session, [words.Word("now", 2.0, 2.4)]), plain)
        engine.set_word_rules("en", RULES)
        with engine.session(rate) as session:
            moved = np.abs(run(session, [words.Word("now", 2.0, 2.4)]) - plain).max(axis=1)
            assert moved[:30].max() == 0 and moved[60:73].max() > 0.15
            with pytest.raises(umo.Error, match="words need"):
                session.hint_words("no", 1.0, 0.9)
            with pytest.raises(ValueError, match="zero"):
                session.hint_words("a\0b", 1.0, 1.1)
        with pytest.raises(umo.Error, match="xx"):
            engine.set_word_rules("xx")
        with pytest.raises(umo.Error, match="class"):
            engine.set_word_rules(None, "[class")
