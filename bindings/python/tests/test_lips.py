"""Lip hints: sounds that are certain from the spelling, and their effect in a session."""

import numpy as np
import pytest

import umo
from umo import lips


def shapes(text):
    """The hints of a text with characters of 0.1 s each."""
    starts = [0.1 * at for at in range(len(text))]
    return [(hint.shape, round(10 * hint.start)) for hint in lips.of_characters(text, starts, [start + 0.1 for start in starts])]


@pytest.mark.parametrize(
    "text, expected",
    [
        ("Map", [("closed", 0), ("closed", 2)]),
        ("happy", [("closed", 2)]),
        ("lamb", [("closed", 2)]),
        ("lambs", [("closed", 2)]),
        ("number", [("closed", 2), ("closed", 3)]),
        ("debt", []),
        ("psalm", [("closed", 4)]),
        ("mnemonic", [("closed", 3)]),
        ("photo", [("teeth", 0)]),
        ("five", [("teeth", 0), ("teeth", 2)]),
        ("a be", [("closed", 2)]),
        ("Äpfel", [("closed", 1), ("teeth", 2)]),
        ("FBI", []),
        ("I'm", [("closed", 2)]),
        ("5pm", []),
        ("receipt", []),
        ("so  on, OK!", []),
        ("", []),
    ],
)
def test_letters_that_are_certain_become_hints(text, expected):
    assert shapes(text) == expected


def test_doubled_letters_are_one_sound():
    (hint,) = lips.of_characters("happy", np.arange(5) / 10, np.arange(1, 6) / 10)
    assert hint.duration == pytest.approx(0.2)
    assert hint.after(1.0).start == pytest.approx(1.2)


def test_words_say_their_first_sound_alone():
    assert lips.of_word("Maybe,", 2.0, 2.4) == ("closed", 2.0, 0.08)
    assert lips.of_word("phone", 2.0, 2.04) == ("teeth", 2.0, pytest.approx(0.04))
    assert lips.of_word("apple", 2.0, 2.4) is None
    assert lips.of_word("psychology", 2.0, 2.4) is None
    assert lips.of_word("...", 2.0, 2.4) is None
    assert lips.of_word(" “but ", 2.0) == ("closed", 2.0, 0.08)
    for text in ("<break/>", "[pause]", "5pm", "$5m", "FM", "m3", "be there", ""):
        assert lips.of_word(text, 2.0, 2.4) is None, text


def test_a_transcript_gives_hints_as_its_words_end():
    transcript = lips.Transcript()
    assert transcript.push("Maybe ", 0.1, 0.4) == [("closed", 0.1, 0.08)]
    # Characters, in two calls; "I" is a word or a character, and has no hints.
    assert transcript.push("I", 0.5, 0.55) == []
    assert transcript.push("but ", 0.6, 0.8) == [("closed", 0.6, 0.08)]
    made = [transcript.push(character, 1 + 0.1 * at, 1.1 + 0.1 * at) for at, character in enumerate("top map")]
    assert made == [[], [], [], [("closed", pytest.approx(1.2), pytest.approx(0.1))], [], [], []]
    assert [hint.start for hint in transcript.finish()] == pytest.approx([1.4, 1.6])
    assert transcript.finish() == []


def test_a_transcript_whose_times_begin_anew_has_no_more_hints():
    transcript = lips.Transcript()
    assert transcript.push("be", 1.0, 1.2)
    assert transcript.push("by", 0.9, 1.1)
    assert transcript.push("me", 0.0, 0.2) == [] and transcript.push("my", 3.0, 3.2) == []


def test_visemes_of_azure_last_until_the_next():
    made = lips.of_azure([(0.0, 0), (0.1, 21), (0.18, 1), (0.3, 18), (0.35, 7)])
    assert made == [("closed", 0.1, pytest.approx(0.08)), ("teeth", 0.3, pytest.approx(0.05)), ("round", 0.35, pytest.approx(0.08))]


def test_times_must_fit():
    with pytest.raises(ValueError, match="the same number"):
        lips.of_characters("ab", [0.0], [0.1])


def test_hints_close_the_lips_of_a_session(hello, model):
    samples, rate = hello

    def run(hints):
        with umo.Engine(model, polled=True, max_sessions=1, max_batch=1) as engine, engine.session(rate) as session:
            for hint in hints:
                session.hint_lips(*hint)
            rest, parts = samples, []
            while not session.is_done:
                if len(rest):
                    rest = rest[session.push(rest) :]
                if not len(rest):
                    session.finish()
                engine.poll()
                parts.append(session.pull())
            return np.concatenate([part.face for part in parts]), np.concatenate([part.sample for part in parts])

    (plain, at), (hinted, same) = run([]), run([lips.Hint("closed", 1.0, 0.1)])
    assert np.array_equal(at, same)
    seconds = at / rate
    inside, outside = (seconds >= 1.0) & (seconds <= 1.1), (seconds < 0.92) | (seconds > 1.18)
    jaw, close = (model.channels.index(name) for name in ("jawOpen", "mouthClose"))
    assert inside.sum() >= 3
    assert (hinted[inside, jaw] - hinted[inside, close] < 0.01).all()
    assert np.array_equal(plain[outside], hinted[outside])
    with umo.Engine(model, polled=True) as engine, engine.session(rate) as session:
        with pytest.raises(ValueError, match="closed"):
            session.hint_lips("open", 0.0, 0.1)
