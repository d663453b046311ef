"""Takes: a session's motion as bytes, played again."""

import numpy as np
import pytest

import umo


def shown(player, step):
    frames = []
    while not player.is_done:
        step()
        frames.append(player.pull())
    return np.concatenate([motion.rotations for motion in frames])


def test_a_take_plays_the_session_s_frames(hello, model):
    samples, rate = hello
    with umo.Engine(model, polled=True) as engine, engine.session(rate, take_bytes=1 << 16, seed=3) as session:
        session.hint_words("Hello there", 0.1, 0.9)
        session.set_mood("joy", 0.6)
        session.push(samples)
        session.finish()
        wanted = shown(session, engine.poll)
        take = session.take()
    info = take.info
    assert (info.version, info.frames, info.frame_rate, info.sample_rate, info.seed) == (5, len(wanted), 30, rate, 3)
    assert len(take.data) < 1000 * len(wanted) / 30 + 400
    with umo.Take(take.data) as again, umo.Decoder(model, take=again) as decoder:
        np.testing.assert_array_equal(shown(decoder, decoder.push_take), wanted)
        assert not decoder.push_take() and decoder.rate == rate
        decoder.reset()
        np.testing.assert_array_equal(shown(decoder, decoder.push_take), wanted)


def test_what_is_no_take_is_refused(model):
    with pytest.raises(umo.Error, match="not a take") as refused:
        umo.Take(b"RIFF")
    assert refused.value.status == umo.Status.TAKE
    with umo.Engine(model, polled=True) as engine, engine.session() as plain, pytest.raises(umo.Error, match="no take"):
        plain.take()
