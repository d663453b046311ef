import numpy as np
import pytest
import torch
from transformers import HubertModel

import base_sources
from umo_train.audio import tokens
from umo_train.audio.hubert import Hubert, HubertTokenizer
from umo_train.convert import SourceError
from umo_train.convert.layout import audio_shapes

LAYER = 2
PLAN = {"kind": "hubert", "layer": LAYER, "units": 7, "normalize": False, "window": 50}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("hubert")
    base_sources.hubert(path)
    return path


def plain(folder, samples):
    """Hugging Face's features of the samples after 80 zeros, with group norm statistics that include the zeros."""
    model = HubertModel.from_pretrained(folder).eval()
    padded = torch.nn.functional.pad(torch.from_numpy(samples), (80, 0))
    with torch.no_grad():
        return model(padded[None], output_hidden_states=True).hidden_states[LAYER][0]


@pytest.mark.parametrize("count", [1, 50, 73])
def test_a_feature_for_every_320_samples(folder, count):
    samples = base_sources.speech(count * 0.02, 0)
    for more in (0, 319):
        longer = np.concatenate([samples, np.zeros(more, np.float32)])
        for window in (0, 20):
            found = Hubert(folder, LAYER, normalize=False, window=window).features(longer[None])
            assert found.shape == (1, count, 16) and found.isfinite().all()


def test_features_are_hugging_faces(folder, monkeypatch):
    samples = base_sources.speech(1.5, 1)
    ours = Hubert(folder, LAYER, normalize=False, window=0)
    found = ours.features(samples[None])[0]
    wanted = plain(folder, samples)
    # They differ only through the statistics, which exclude 16 of 4800 outputs.
    assert 0 < (found - wanted).abs().max() < 0.05
    ours.model.feature_extractor.conv_layers[0].layer_norm.skip = 0
    torch.testing.assert_close(ours.features(samples[None])[0], wanted, rtol=1e-4, atol=1e-4)


def test_statistics_leave_the_silence_before_out(folder):
    hubert = Hubert(folder, LAYER, normalize=False, window=0)
    norm = hubert.model.feature_extractor.conv_layers[0].layer_norm
    heard = torch.randn(1, 8, 100)
    x = torch.cat([torch.full((1, 8, norm.skip), 9.0), heard], -1)
    torch.testing.assert_close(norm(x)[..., norm.skip :], norm.norm(heard), rtol=1e-4, atol=1e-5)
    assert norm.skip == 16


def test_layers_see_windows_and_the_last_ends_at_the_end(folder):
    hubert = Hubert(folder, LAYER, normalize=False, window=50)
    samples = np.stack([base_sources.speech(2.5, seed) for seed in (2, 3)])
    found = hubert.features(samples, batch=3)
    hidden = torch.stack([hubert._convolved(torch.from_numpy(row)) for row in samples]).detach()
    with torch.no_grad():
        for row in range(2):
            for start, kept in ((0, slice(0, 50)), (50, slice(50, 100)), (75, slice(100, 125))):
                made = hubert.model.encoder(hidden[row : row + 1, start : start + 50]).last_hidden_state[0]
                torch.testing.assert_close(found[row, kept], made[kept.start - start :], rtol=1e-4, atol=1e-5)


def test_normalised_recordings_are_alike_at_any_gain(folder):
    hubert = Hubert(folder, LAYER, normalize=True, window=0)
    samples = base_sources.speech(1.0, 4)
    torch.testing.assert_close(
        hubert.features(0.1 * samples[None]), hubert.features(samples[None]), rtol=1e-3, atol=1e-3
    )


def test_units_are_the_nearest_centroids_and_travel_with_the_network(folder, tmp_path):
    plan = PLAN | {"hubert": str(folder)}
    centroids = torch.randn(7, 16, generator=torch.Generator().manual_seed(0))
    HubertTokenizer(folder, plan, centroids).save(tmp_path / "audio.safetensors")
    tokenizer = tokens.load(tmp_path / "audio.safetensors", plan)
    samples = base_sources.speech(1.7, 5)
    units = tokenizer(samples)
    distances = torch.cdist(tokenizer.hubert.features(samples[None])[0], centroids)
    assert units.dtype == np.int16 and units.tolist() == distances.argmin(1).tolist()
    shapes = {name: tuple(tensor.shape) for name, tensor in tokenizer.tensors().items()}
    assert shapes == audio_shapes({"audio": tokens.model_config(plan)})


def test_a_published_k_means_is_taken(folder, tmp_path):
    rows = np.random.default_rng(0).normal(size=(7, 16)).astype(np.float32)
    np.save(tmp_path / "km.npy", rows)
    plan = PLAN | {"hubert": str(folder), "kmeans": str(tmp_path / "km.npy")}
    tokenizer = tokens.fit(tmp_path, tmp_path / "audio.safetensors", plan, 0)
    np.testing.assert_array_equal(tokenizer.centroids.numpy(), rows)
    with pytest.raises(SourceError, match=r"expected \[8, 16\]"):
        tokens.fit(tmp_path, tmp_path / "other.safetensors", plan | {"units": 8}, 0)


def test_too_deep_a_layer_is_refused(folder):
    with pytest.raises(SourceError, match="3 layers, the plan asks for layer 9"):
        Hubert(folder, 9, normalize=False, window=0)
