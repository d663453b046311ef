"""Packets: an avatar computed in one place and seen in another."""

import numpy as np
import pytest

import umo


def sent(hello, model, **settings):
    """A sender's packets and its frames without layers."""
    samples, rate = hello
    packets, frames = [], []
    with umo.Engine(model, polled=True) as engine, engine.session(rate, **settings) as session:
        for name in umo.Session.parameters():
            if name.startswith("layer_"):
                setattr(session, name, 0)
        for start in range(0, len(samples), 4000):
            assert session.push(samples[start : start + 4000]) == len(samples[start : start + 4000])
            if start + 4000 >= len(samples):
                session.finish()
            engine.poll()
            packets += session.pull_packets()
            frames.append(session.pull())
        assert session.is_done
    return packets, frames


def plain_decoder(model, **settings):
    decoder = umo.Decoder(model, **settings)
    for name in umo.Session.parameters():
        if name.startswith("layer_"):
            setattr(decoder, name, 0)
    return decoder


def test_a_decoder_has_the_sender_s_frames(hello, model):
    packets, frames = sent(hello, model, packets="beside_frames")
    wanted = np.concatenate([motion.rotations for motion in frames])
    with plain_decoder(model) as decoder:
        shown = []
        for packet in packets:
            decoder.push_packet(packet)
            decoder.push_packet(packet)
            shown.append(decoder.pull())
        assert decoder.is_done
        assert decoder.received == umo.Received(packets=len(packets), late=len(packets), lost=0, held=0)
    np.testing.assert_array_equal(np.concatenate([motion.rotations for motion in shown]), wanted)
    assert max(map(len, packets)) < 700


def test_packets_alone_are_the_same_and_a_lost_one_changes_the_mouth_alone(hello, model):
    packets, frames = sent(hello, model, packets="beside_frames")
    alone, none = sent(hello, model, packets="only")
    assert alone == packets and not any(map(len, none))
    wanted = np.concatenate([motion.rotations for motion in frames])
    with plain_decoder(model, reorder_window=1) as decoder:
        kept = [packet for number, packet in enumerate(packets) if number % 4 != 2]
        shown = []
        for packet in kept:
            decoder.push_packet(packet)
            shown.append(decoder.pull())
        assert decoder.received.lost > 0 and decoder.received.held == 0
    shown = np.concatenate([motion.rotations for motion in shown])
    body = np.arange(shown.shape[1]) != umo.JOINTS.index("jaw")
    np.testing.assert_array_equal(shown[:, body], wanted[: len(shown), body])


def test_what_is_no_packet_is_an_error(hello, model, mouth_model):
    packets, _ = sent(hello, model, packets="only")
    with umo.Decoder(model) as decoder, umo.Decoder(mouth_model) as other:
        for bad in (b"", packets[0][:-1], bytes(40), np.random.default_rng(1).bytes(200)):
            with pytest.raises(umo.Error) as caught:
                decoder.push_packet(bad)
            assert caught.value.status == umo.Status.PACKET
        with pytest.raises(umo.Error, match="another model"):
            other.push_packet(packets[0])
        with pytest.raises(umo.Error, match="decoder"):
            decoder.push(np.zeros(100, np.float32))
        with pytest.raises(AttributeError):
            decoder.engine
        assert decoder.received == umo.Received(0, 0, 0, 0)
        assert decoder.sample(0.5).is_ahead
    with umo.Engine(model, polled=True) as engine, engine.session() as session:
        with pytest.raises(umo.Error, match="without packets"):
            session.pull_packets()
        with pytest.raises(ValueError, match="packets"):
            engine.session(packets="all")
