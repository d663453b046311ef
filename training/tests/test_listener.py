"""The network that predicts the face from sound: its windows, its targets, and learning."""

import numpy as np
import pytest
import torch

from umo_train.audio.listener import ACCENT, CLOSURE, OPENING, SHAPES, WIDTH, Heard, Listener, Shapes, onsets, train
from umo_train.audio.mel import HOP, Mel
from umo_train.audio.units import telling_edge
from umo_train.skeleton import ARKIT, CHANNELS
from umo_train.speech.utterance import Phone

NETWORK = {"taps": 4, "widths": [7, 5]}


def _mel() -> Mel:
    torch.manual_seed(0)
    mel = Mel(window=400, fft=512, bands=6, floor=1e-4, deltas=1, network=NETWORK)
    mel.mean, mel.scale = torch.randn(12), 0.5 + torch.rand(12)
    return mel


def test_each_token_hears_its_own_row_and_those_before() -> None:
    mel = _mel()
    samples = 0.1 * torch.randn(6400, generator=torch.Generator().manual_seed(1))
    rows, features = mel.bands(samples), mel.features(samples)
    assert features.shape == (20, 5) and mel.width == 5
    first, last = mel.network.layers
    for t in range(20):
        seen = torch.cat([rows[i] if i >= 0 else mel.silence[0] for i in range(t - 3, t + 1)])
        expected = last.weight @ (first.weight @ seen + first.bias).clamp(min=0) + last.bias
        torch.testing.assert_close(features[t], expected, rtol=1e-5, atol=1e-5)


def test_blocks_add_what_rows_before_say() -> None:
    torch.manual_seed(5)
    network = Listener(6, 2, [7, 5], {"kernel": 3, "count": 2})
    assert network.reach == 5
    rows, silence = torch.randn(9, 6), torch.randn(1, 6)
    heard = network.heard(rows, silence)
    padded = torch.cat([silence.expand(5, -1), rows])
    x = {t: network.layers[0](torch.cat([padded[t - 1], padded[t]])).relu() for t in range(1, 14)}
    for k, (causal, pointwise) in enumerate(network.blocks):
        before = {t: sum(causal.weight[:, :, i] @ x[t - 2 + i] for i in range(3)) for t in range(3 + 2 * k, 14)}
        x = {t: x[t] + pointwise.weight[:, :, 0] @ (v + causal.bias).relu() + pointwise.bias for t, v in before.items()}
    expected = torch.stack([network.layers[1](x[t].relu()) for t in range(5, 14)])
    torch.testing.assert_close(heard, expected, rtol=1e-5, atol=1e-5)


def test_other_voices_keep_what_is_said_when() -> None:
    mel, generator = _mel(), torch.Generator().manual_seed(6)
    loudness = torch.where(torch.arange(40) % 20 < 10, 3.0, -3.0)[:, None] + torch.randn(40, 6, generator=generator)
    rows = ((torch.cat([loudness, torch.zeros(40, 6)], 1) - mel.mean) * mel.scale).expand(8, -1, -1)
    torch.manual_seed(7)
    varied = mel.voices.vary(rows)
    assert varied.shape == rows.shape and not torch.allclose(varied[0], varied[1])
    levels = (varied / mel.scale + mel.mean)[..., :6].mean(2)
    assert (levels.unflatten(1, (2, 2, 10)).mean(3).diff(dim=2) < -3.0).all()


def test_silence_after_silence_is_what_a_stream_begins_with() -> None:
    mel = _mel()
    features = mel.features(torch.zeros(10 * HOP))
    torch.testing.assert_close(features, features[:1].expand(10, -1))


def test_tensors_come_back() -> None:
    mel, other = _mel(), Mel(**_mel().sizes)
    other.load(mel.tensors())
    samples = 0.1 * torch.randn(3200, generator=torch.Generator().manual_seed(2))
    assert torch.equal(mel.features(samples), other.features(samples))


def _face(frames: int) -> np.ndarray:
    face = np.zeros((frames, CHANNELS["face"]), np.float32)
    rng = np.random.default_rng(3)
    for name in ("jawOpen", "mouthFunnel", "mouthPucker", "mouthClose", "jawForward", "mouthShrugUpper", "tongueOut"):
        face[:, 6 + ARKIT.index(name)] = rng.uniform(0, 1, frames)
    return face


@pytest.mark.parametrize("delay", [0, 4])
def test_what_is_wanted_is_of_a_moment_before(delay: int) -> None:
    face = _face(90)
    face[30:, 6:] = 0.0
    phones = (Phone("aa", 0.0, 0.5, 2), Phone("ih", 0.5, 1.0, 1), Phone("pau", 1.0, 3.0))
    wanted = Shapes.of([face]).wanted(face, phones, 150, delay)
    assert wanted.shape == (150, WIDTH)
    opening, closure, accent = wanted[:, SHAPES:].T
    # The mouth is shut from the first second on.
    assert (opening[: 48 + delay] > 0).any() and np.all(opening[50 + delay :] == 0) and opening.max() <= OPENING * 1.5
    assert np.all(closure[50 + delay :] == np.float32(CLOSURE))
    assert np.all(accent[delay : 25 + delay] == np.float32(ACCENT))
    assert np.all(accent[25 + delay : 50 + delay] == np.float32(0.4 * ACCENT)) and np.all(accent[50 + delay :] == 0)


def test_shapes_have_unit_deviation_altogether() -> None:
    # Held for 20 frames each: interpolation between frames smooths little.
    face = np.repeat(_face(500), 20, 0)
    shapes = Shapes.of([face])
    wanted = shapes.wanted(face, (), 16000, 0)[:, :SHAPES]
    assert 0.9 < wanted.var(0).sum() < 1.1


@pytest.mark.parametrize("blocks", [None, {"kernel": 3, "count": 1}])
def test_it_learns_to_hear(blocks: dict[str, int] | None) -> None:
    generator = torch.Generator().manual_seed(4)
    teacher = Listener(6, 3, [WIDTH])
    silence = torch.zeros(1, 6)
    items = []
    for _ in range(4):
        rows = torch.randn(200, 6, generator=generator) / 6**0.5
        with torch.no_grad():
            items.append(Heard(rows.half(), teacher.heard(rows, silence)))
    plan = {"taps": 3, "widths": [24, WIDTH]} | ({"blocks": blocks} if blocks else {})
    network = train(items, silence, None, plan, 300, 0)
    rows, wanted = items[0].features.float(), items[0].wanted
    with torch.no_grad():
        error = (network.heard(rows, silence) - wanted).square().mean() / wanted.var(0).mean()
    assert error < 0.1
    assert any(tensor.shape == (24, 18) for tensor in network.tensors().values())


def test_onsets_are_bumps_at_accented_vowels_heard_late() -> None:
    phones = [Phone("AH", 0.0, 0.2, 0), Phone("IY", 0.4, 0.6, 2), Phone("OW", 0.8, 0.9, 1), Phone("EH", 1.2, 1.3, 2)]
    heard = onsets(phones, 100, delay=14)
    assert heard.max() == 1.0 and np.flatnonzero(heard > 0.99).tolist() == [20 + 14, 60 + 14]
    # 0.04 s away, two tokens: one standard deviation.
    assert heard[36] == pytest.approx(np.exp(-0.5)) and heard[54] < 1e-6
    assert not onsets(phones[:1], 10, delay=14).any()


def test_the_edge_between_units_tells_most() -> None:
    generator = torch.Generator().manual_seed(0)
    wanted = torch.rand(4000, generator=generator) < 0.1
    values = wanted * 1.0 + 0.2 * torch.randn(4000, generator=generator)
    edge = telling_edge(values, wanted)
    assert 0.35 < edge < 0.75
    # If a value carries no more information than that, edges on either side are less informative.
    assert telling_edge(3 * values - 1, wanted) == pytest.approx(3 * edge - 1, abs=0.05)
