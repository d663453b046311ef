import copy
import json
import os
import subprocess
from pathlib import Path

import pytest
import torch
from safetensors import safe_open
from safetensors.torch import load_file, save_file

import convert_sources
from umo_train.convert import Model, SourceError, write
from umo_train.convert.__main__ import main
from umo_train.convert.layout import is_weight, shapes

CONFIG = convert_sources.golden_config()
USED = CONFIG["audio"]["hubert"]["num_hidden_layers"]
PROGRAM = os.environ.get("UMO_PROGRAM")
# Tensors named `scale` that are not scales of int8 tensors.
SCALES = ("audio.mel.scale", "mouth.scale")


@pytest.mark.parametrize("name", ["hubert_k1_smplx", "hubert_k3_i8", "mel_k1_upcycled", "mel_k2_arkit"])
def test_layout_is_that_of_the_projects_model_files(name):
    config = convert_sources.golden_config(name)
    with safe_open(convert_sources.GOLDEN / name / "model.safetensors", "pt") as file:
        found = {key: tuple(file.get_slice(key).get_shape()) for key in file.keys()}
    found = {key: shape for key, shape in found.items() if not key.endswith(".scale") or key in SCALES}
    found.pop("text.tokenizer", None)
    assert shapes(config, encoders="vq.face.encoder.main.0.weight" in found) == found


class Sources:
    """All published files, in a folder."""

    def __init__(self, folder: Path, text_rows: int = CONFIG["vocab"]["size"]) -> None:
        self.folder, self.output = folder, folder / "model.safetensors"
        for name in ("hubert", "t5"):
            (folder / name).mkdir()
        self.hubert = convert_sources.hubert(folder / "hubert", CONFIG, USED + 1)
        self.t5 = convert_sources.t5(CONFIG, text_rows)
        self.t5.save_pretrained(folder / "t5")
        self.centers = convert_sources.kmeans(folder / "km.bin", CONFIG)
        self.vq = convert_sources.emage(folder, CONFIG)
        (folder / "config.json").write_text(json.dumps(CONFIG))

    def arguments(self, *more: str) -> list[str]:
        at = self.folder
        given = {"hubert": at / "hubert", "kmeans": at / "km.bin", "t5": at / "t5", "config": at / "config.json"}
        named = [str(part) for name, path in given.items() for part in (f"--{name}", path)]
        return [*named, "--vq", *map(str, self.vq), "-o", str(self.output), *more]


@pytest.fixture
def sources(tmp_path):
    return Sources(tmp_path)


def metadata(path: Path) -> dict[str, str]:
    with safe_open(path, "pt") as file:
        return file.metadata()


def test_the_program_writes_one_file_of_all(sources):
    (sources.folder / "t5" / "spiece.model").write_bytes(b"pieces")
    assert main(sources.arguments("--experts", "4", "--top-k", "2")) == 0
    found, about = load_file(sources.output), metadata(sources.output)
    config = json.loads(about["config"])
    assert (about["format"], about["version"]) == ("umo", "1")
    assert (config["lm"]["experts"], config["lm"]["top_k"]) == (4, 2)
    assert config["notice"] == "Not trained: interpolation network."
    assert bytes(found.pop("text.tokenizer")) == b"pieces"
    wanted = shapes(config)
    assert {name: tuple(t.shape) for name, t in found.items()} == wanted
    for name, tensor in found.items():
        assert tensor.dtype == (torch.bfloat16 if is_weight(name, wanted[name]) else torch.float32), name
    assert [path.name for path in sources.folder.glob(".*")] == []
    assert sources.output.stat().st_mode == (sources.folder / "config.json").stat().st_mode


def test_new_tokens_are_named_in_the_notice(tmp_path):
    sources = Sources(tmp_path, convert_sources.TEXT)
    assert main(sources.arguments()) == 0
    notice = json.loads(metadata(sources.output)["config"])["notice"]
    assert notice == "Not trained: new tokens and interpolation network."


def test_a_trained_interpolation_network_is_taken(sources, tmp_path):
    assert main(sources.arguments("--seed", "1", "--dtype", "f32")) == 0
    first = load_file(sources.output)
    network = {name: tensor for name, tensor in first.items() if name.startswith("interp.")}
    trained = tmp_path / "interp.safetensors"
    save_file(network, trained)
    assert main(sources.arguments("--seed", "2", "--dtype", "f32", "--interp", str(trained))) == 0
    again = load_file(sources.output)
    assert "notice" not in json.loads(metadata(sources.output)["config"])
    assert all(torch.equal(again[name], network[name]) for name in network)
    router = "lm.encoder.block.0.layer.1.moe.router.weight"
    assert not torch.equal(again[router], first[router])


def test_what_is_wrong_is_said_and_an_older_file_stays(sources, capsys):
    sources.output.write_bytes(b"older")
    sources.vq.pop()
    assert main(sources.arguments()) == 2
    assert "error: no file has the codec of root" in capsys.readouterr().err
    config = copy.deepcopy(CONFIG)
    del config["lm"]["d_ff"]
    (sources.folder / "config.json").write_text(json.dumps(config))
    assert main(sources.arguments()) == 2
    assert 'no "d_ff" in the config' in capsys.readouterr().err
    assert sources.output.read_bytes() == b"older"


def test_values_that_a_type_cannot_hold_are_refused(tmp_path):
    tensors = {name: torch.zeros(shape) for name, shape in shapes(CONFIG).items()}
    name = "lm.shared.weight"
    for dtype, value in (("f32", float("nan")), ("f16", 1e6)):
        tensors[name] = torch.full(shapes(CONFIG)[name], value)
        with pytest.raises(SourceError, match=name):
            write(tmp_path / "model.safetensors", Model(CONFIG, tensors), dtype)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(PROGRAM is None, reason="UMO_PROGRAM is not set")
class TestProgram:
    """The Rust program reads the file, and its outputs equal the published models'."""

    @pytest.fixture
    def model(self, sources):
        assert main(sources.arguments("--dtype", "f32")) == 0
        return sources

    def stage(self, model: Sources, stage: str, inputs: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
        paths = [model.folder / name for name in ("in.safetensors", "out.safetensors")]
        save_file(inputs, paths[0])
        command = [PROGRAM, "model", "stage", stage, "--model", model.output, "--in", paths[0], "--out", paths[1]]
        subprocess.run([*command, "--threads", "1"], check=True, capture_output=True)
        return load_file(paths[1])

    def test_inspect_knows_it(self, model):
        said = subprocess.run(
            [PROGRAM, "model", "inspect", model.output], check=True, capture_output=True, text=True
        ).stdout
        assert "hubert" in said and "3 experts" in said

    def test_hubert_is_the_same_network(self, model):
        samples = torch.randn(12000, generator=torch.Generator().manual_seed(0))
        features = self.stage(model, "hubert", {"audio": samples})["features"]
        normal = (samples - samples.mean()) / (samples.var(correction=0) + 1e-7).sqrt()
        with torch.no_grad():
            wanted = model.hubert(normal[None], output_hidden_states=True).hidden_states[USED][0]
        torch.testing.assert_close(features, wanted, rtol=2e-4, atol=2e-4)

    def test_upcycled_t5_is_the_dense_one(self, model):
        ids = torch.randint(0, CONFIG["vocab"]["size"], (40,), generator=torch.Generator().manual_seed(0))
        found = self.stage(model, "decoder", {"input_ids": ids, "decoder_input_ids": ids[:9].clone()})["logits"]
        with torch.no_grad():
            wanted = model.t5(input_ids=ids[None], decoder_input_ids=ids[None, :9]).logits[0]
        torch.testing.assert_close(found, wanted, rtol=2e-4, atol=2e-4)
