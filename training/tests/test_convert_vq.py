from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file

import convert_sources
from umo_train.convert import SourceError, vq
from umo_train.convert.layout import shapes

CONFIG = convert_sources.golden_config()


def expected() -> dict[str, torch.Tensor]:
    return {f"vq.{part}.{k}": v for part, state in convert_sources.codecs(CONFIG).items() for k, v in state.items()}


def same(tensors):
    wanted = expected()
    assert set(wanted) == {name for name in shapes(CONFIG) if name.startswith("vq.")}
    return tensors.keys() == wanted.keys() and all(torch.equal(tensors[k], wanted[k]) for k in wanted)


def test_emages_files_are_told_apart_by_what_they_hold(tmp_path):
    paths = convert_sources.emage(tmp_path, CONFIG)
    assert same(vq.convert(reversed(paths), CONFIG))


def test_language_of_motions_checkpoint_has_all(tmp_path):
    path = convert_sources.language_of_motion(tmp_path / "vq.ckpt", CONFIG, None)
    assert same(vq.convert([path], CONFIG))


def test_a_trainers_own_classes_are_neither_needed_nor_run(tmp_path, monkeypatch):
    path = convert_sources.language_of_motion(tmp_path / "vq.ckpt", CONFIG, None)
    monkeypatch.delattr(convert_sources, "Settings")
    assert same(vq.convert([path], CONFIG))


class Attack:
    def __init__(self, where):
        self.where = where

    def __reduce__(self):
        return Path.mkdir, (self.where,)


def test_what_a_checkpoint_asks_to_run_is_not_run(tmp_path):
    path, ran = tmp_path / "vq.ckpt", tmp_path / "ran"
    torch.save({"state_dict": {"weight": torch.zeros(1)}, "callbacks": Attack(ran)}, path)
    with pytest.raises(SourceError):
        vq.convert([path], CONFIG)
    assert not ran.exists()
    torch.load(path, weights_only=False)
    assert ran.exists()


def test_published_again_as_safetensors(tmp_path):
    paths = []
    for part, state in convert_sources.codecs(CONFIG).items():
        paths.append(tmp_path / f"{part}.safetensors")
        save_file(state, paths[-1])
    assert same(vq.convert(paths, CONFIG))


def test_a_missing_codec_a_second_one_and_another_network_are_refused(tmp_path):
    paths = convert_sources.emage(tmp_path, CONFIG)
    with pytest.raises(SourceError, match="no file has the codec of lower, root"):
        vq.convert(paths[:3], CONFIG)
    with pytest.raises(SourceError, match="the codec `face` is in .*last_face.bin too"):
        vq.convert([*paths, paths[0]], CONFIG)
    state = convert_sources.codecs(CONFIG)["upper"]
    state["encoder.main.0.weight"] = torch.zeros(18, 78, 4)
    state["fc_mu.weight"] = torch.zeros(18, 18)
    torch.save({"model_state": state}, paths[2])
    with pytest.raises(SourceError) as raised:
        vq.convert(paths, CONFIG)
    assert "encoder.main.0.weight: expected [18, 78, 3], got [18, 78, 4]" in str(raised.value)
    assert "unknown: fc_mu.weight" in str(raised.value)


def test_files_without_a_codec_are_refused(tmp_path):
    odd, text, empty = tmp_path / "odd.bin", tmp_path / "text.bin", tmp_path / "empty.bin"
    torch.save({"encoder.main.0.weight": torch.zeros(18, 99, 3)}, odd)
    text.write_text("<html>404</html>")
    torch.save({"epoch": 1}, empty)
    for path, says in ((odd, "99 channels"), (text, "not a PyTorch file of weights"), (empty, "no codec in it")):
        with pytest.raises(SourceError, match=says):
            vq.convert([path], CONFIG)
    with pytest.raises(SourceError, match="there is no such file"):
        vq.convert([tmp_path / "gone.bin"], CONFIG)
