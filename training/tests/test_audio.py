"""The mel front end against the golden files' reference, and k-means."""

import numpy as np
import pytest
import torch

from audio import Mel as Reference
from umo_train.audio import tokens
from umo_train.audio.mel import HOP, Mel, model_config
from umo_train.audio.units import kmeans, nearest


def _mel(deltas: int) -> Mel:
    mel = Mel(window=400, fft=512, bands=24, floor=1e-4, deltas=deltas)
    torch.manual_seed(0)
    mel.mean, mel.scale = torch.randn(mel.width), 0.5 + torch.rand(mel.width)
    return mel


@pytest.mark.parametrize("deltas", [0, 1, 2])
def test_mel_is_the_golden_one_after_80_zeros(deltas: int) -> None:
    mel = _mel(deltas)
    samples = 0.1 * torch.randn(16000, generator=torch.Generator().manual_seed(1))
    samples[5000:9000] = 0
    reference = Reference({"audio": model_config(mel, 5)}, mel.tensors())
    # A token's window starts 80 samples before its own 320: the first one's in the silence before the stream.
    expected = reference(torch.cat([torch.zeros(80), samples]))
    assert expected.shape == (50, 24 * (1 + deltas))
    torch.testing.assert_close(mel.features(samples), expected, rtol=1e-5, atol=1e-5)


def test_a_config_says_which_units_are_accents_where_the_plan_wants_onsets() -> None:
    plan = {"kind": "mel", "mel": _mel(1).sizes, "units": 64}
    assert "accents" not in tokens.model_config(plan | {"listener": {"delay": 4}})
    told = tokens.model_config(plan | {"listener": {"delay": 4, "onset_delay": 14}})
    assert told["accents"] == {"first": 32, "delay": 14}


def test_features_wait_for_no_later_sample() -> None:
    mel = _mel(1)
    samples = 0.1 * torch.randn(16000, generator=torch.Generator().manual_seed(2))
    whole, part = mel.features(samples), mel.features(samples[: 20 * HOP + 100])
    assert len(part) == 20
    torch.testing.assert_close(part, whole[:20])


def test_bands_are_flat_for_white_noise_and_tell_pitches() -> None:
    mel = Mel(window=400, fft=512, bands=24, floor=1e-9, deltas=0)
    torch.testing.assert_close(mel.filters.sum(1), torch.ones(24))
    time = torch.arange(16000) / 16000
    tones = [torch.sin(2 * np.pi * hertz * time) for hertz in (200, 1000, 4000)]
    loudest = [int(mel.features(tone)[10:].mean(0).argmax()) for tone in tones]
    assert loudest == sorted(set(loudest))


def test_fit_normalises() -> None:
    mel = Mel(window=400, fft=512, bands=24, floor=1e-4, deltas=1)
    samples = 0.1 * torch.randn(48000, generator=torch.Generator().manual_seed(3))
    mel.fit(mel.features(samples), delta_weight=0.5)
    features = mel.features(samples)
    assert features.mean(0).abs().max() < 1e-4
    torch.testing.assert_close(features.std(0)[:24], torch.full((24,), 24**-0.5), rtol=1e-3, atol=0)
    torch.testing.assert_close(features.std(0)[24:], torch.full((24,), 0.5 * 24**-0.5), rtol=1e-3, atol=0)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_kmeans_finds_planted_clusters(seed: int) -> None:
    generator = torch.Generator().manual_seed(10 + seed)
    places = 5 * torch.randn(12, 6, generator=generator)
    counts = [200] * 11 + [60]
    rows = torch.cat([p + 0.1 * torch.randn(n, 6, generator=generator) for p, n in zip(places, counts, strict=True)])
    rows = rows[torch.randperm(len(rows), generator=generator)]
    centroids = kmeans(rows, 12, 10, seed)
    assert torch.cdist(places, centroids).min(1).values.max() < 0.15
    assert nearest(places, centroids).unique().numel() == 12


def test_kmeans_leaves_no_centroid_without_rows() -> None:
    generator = torch.Generator().manual_seed(0)
    rows = torch.randn(400, 3, generator=generator)
    centroids = kmeans(rows, 40, 20, 0)
    used = nearest(rows, centroids).bincount(minlength=40)
    assert centroids.isfinite().all() and (used > 0).all()


def test_nearest_is_by_euclidean_distance() -> None:
    generator = torch.Generator().manual_seed(0)
    rows, table = torch.randn(200, 3, generator=generator), torch.randn(30, 3, generator=generator)
    assert torch.equal(nearest(rows, table), torch.cdist(rows, table).argmin(1))
