"""Tests the client of `umo serve` against a server that `scripts/test-serve` starts."""

import asyncio
import os
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[3]
URL = os.environ.get("UMO_SERVE")
if not URL:
    pytest.skip("UMO_SERVE is not set: scripts/test-serve starts a server", allow_module_level=True)

import umo.serve


def run(coroutine):
    return asyncio.run(asyncio.wait_for(coroutine, 120))


async def frames(avatar):
    return [frame async for frame in avatar]


def same(made, motion):
    assert [frame.index for frame in made] == motion.index.tolist()
    assert np.array_equal([frame.rotations for frame in made], motion.rotations)
    assert np.array_equal([frame.translation for frame in made], motion.translation)
    assert np.array_equal([frame.face for frame in made], motion.face)


def test_frames_are_those_of_animate(hello, live):
    async def speak():
        samples, rate = hello
        async with umo.serve.connect(URL, rate=rate) as avatar:
            for piece in np.array_split(samples, 7):
                await avatar.push(piece)
            await avatar.finish()
            return await frames(avatar), avatar.done

    made, done = run(speak())
    same(made, live)
    assert done["frames"] == len(made)


def test_a_session_goes_on_where_its_state_was(hello, live):
    async def speak():
        samples, rate = hello
        async with umo.serve.connect(URL, rate=rate) as avatar:
            await avatar.push(samples[: len(samples) // 2])
            await avatar.save()
            made = []
            async for frame in avatar:
                made.append(frame)
                if avatar.saved:
                    break
            saved = avatar.saved
        async with umo.serve.connect(URL, rate=rate, state=saved.state) as avatar:
            await avatar.push(samples[saved.samples :])
            await avatar.finish()
            return made, await frames(avatar)

    before, after = run(speak())
    kept = [frame for frame in before if frame.index < after[0].index]
    same(kept + after, live)


def opus():
    """Packets of 20 ms, 0.6 s of speech."""
    data, packets = (ROOT / "serve/tests/opus/voice.packets").read_bytes(), []
    while data:
        length = int.from_bytes(data[:2], "little")
        packets.append(data[2 : 2 + length])
        data = data[2 + length :]
    return packets


def test_packets_of_opus_animate_and_lost_ones_keep_their_time():
    async def speak(packets):
        async with umo.serve.connect(URL, audio="opus") as avatar:
            assert avatar.ready["audio"] == "opus"
            for packet in packets:
                if packet:
                    await avatar.push_opus(packet)
                else:
                    await avatar.lost()
            await avatar.finish()
            return await frames(avatar)

    whole = opus()
    gaps = [b"" if at in (7, 8, 29) else packet for at, packet in enumerate(whole)]
    made, healed = run(speak(whole)), run(speak(gaps))
    assert [frame.index for frame in made] == [frame.index for frame in healed] == list(range(18))
    with pytest.raises(umo.serve.ServeError, match="not an Opus packet") as error:
        run(speak([*whole[:3], b"\x4b\x00"]))
    assert error.value.code == "bad_request"


def test_what_is_wrong_is_said():
    async def refused(**hello):
        async with umo.serve.connect(URL, **hello):
            pass

    with pytest.raises(umo.serve.ServeError, match="rate 1") as error:
        run(refused(rate=1))
    assert error.value.code == "bad_request"
    with pytest.raises(umo.serve.ServeError, match="joy"):
        run(refused(mood="happy"))

    async def shape():
        async with umo.serve.connect(URL) as avatar:
            await avatar.push(np.zeros((2, 2), np.float32))

    with pytest.raises(ValueError, match="one-dimensional"):
        run(shape())
