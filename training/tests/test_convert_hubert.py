import json

import pytest
import torch
from safetensors.torch import load_file, save_file

import convert_sources
from umo_train.convert import SourceError, hubert
from umo_train.convert.layout import shapes

CONFIG = convert_sources.golden_config()
USED = CONFIG["audio"]["hubert"]["num_hidden_layers"]
CONVOLUTION = "encoder.pos_conv_embed.conv"


@pytest.fixture
def saved(tmp_path):
    return tmp_path, convert_sources.hubert(tmp_path, CONFIG, USED + 2)


def test_layers_beyond_the_used_ones_are_dropped_and_the_rest_is_renamed(saved):
    folder, model = saved
    tensors = hubert.convert(folder, CONFIG)
    assert set(tensors) == {name for name in shapes(CONFIG) if name.startswith("audio.hubert.")}
    state = model.state_dict()
    for name, tensor in tensors.items():
        if not name.endswith("pos_conv_embed.conv.weight"):
            assert torch.equal(tensor, state[name.removeprefix("audio.hubert.")]), name


def test_folded_position_convolution_is_what_the_weight_norm_computes(saved):
    folder, model = saved
    folded = hubert.convert(folder, CONFIG)[f"audio.hubert.{CONVOLUTION}.weight"]
    torch.testing.assert_close(folded, model.encoder.pos_conv_embed.conv.weight.detach(), rtol=1e-6, atol=1e-7)


def test_names_of_older_versions_and_of_a_model_with_a_head_are_read(saved):
    folder, _ = saved
    new = hubert.convert(folder, CONFIG)
    state = load_file(folder / "model.safetensors")
    (folder / "model.safetensors").unlink()
    old = {"original0": "weight_g", "original1": "weight_v"}
    for key in [k for k in state if "parametrizations" in k]:
        state[f"{CONVOLUTION}.{old[key.rsplit('.', 1)[1]]}"] = state.pop(key)
    headed = {f"hubert.{k}": v for k, v in state.items()} | {"lm_head.weight": torch.zeros(3, 2)}
    torch.save(headed, folder / "pytorch_model.bin")
    again = hubert.convert(folder, CONFIG)
    assert new.keys() == again.keys() and all(torch.equal(new[k], again[k]) for k in new)


def test_missing_and_unknown_names_are_listed(saved):
    folder, _ = saved
    state = load_file(folder / "model.safetensors")
    state["encoder.adapter.weight"] = torch.zeros(1)
    del state["encoder.layers.1.attention.q_proj.bias"], state["encoder.layers.0.final_layer_norm.weight"]
    save_file(state, folder / "model.safetensors")
    with pytest.raises(SourceError) as raised:
        hubert.convert(folder, CONFIG)
    assert "missing: encoder.layers.1.attention.q_proj.bias" in str(raised.value)
    assert "missing: encoder.layers.0.final_layer_norm.weight" in str(raised.value)
    assert "unknown: encoder.adapter.weight" in str(raised.value)


@pytest.mark.parametrize(
    ("key", "value"), [("hidden_size", 24), ("do_stable_layer_norm", True), ("feat_extract_norm", "layer")]
)
def test_another_network_is_refused_by_the_key_that_differs(saved, key, value):
    folder, _ = saved
    path = folder / "config.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {key: value}))
    with pytest.raises(SourceError, match=key):
        hubert.convert(folder, CONFIG)


def test_too_few_layers_are_refused(tmp_path):
    convert_sources.hubert(tmp_path, CONFIG, USED - 1)
    with pytest.raises(SourceError, match=f"{USED - 1} layers, the config asks for {USED}"):
        hubert.convert(tmp_path, CONFIG)


def test_a_folder_without_weights_says_what_belongs_there(tmp_path):
    (tmp_path / "config.json").write_text("{}")
    with pytest.raises(SourceError, match="model.safetensors"):
        hubert.convert(tmp_path, CONFIG)
