"""Reading weights: what `umo model quantize` writes, in every type."""

from pathlib import Path

import torch
from safetensors.torch import load_file

from umo_train import stored
from umo_train.metrics import program


def test_int4_codes_are_multiplied_by_multipliers_and_scales() -> None:
    codes = torch.zeros(2, 17, dtype=torch.uint8)
    codes[0, 0], codes[0, 16], codes[1, 16] = 0xF0, 0x7A, 0x8F
    given = {
        "a": codes,
        "a.multipliers": torch.tensor([[3, -2], [0, 15]], dtype=torch.int8),
        "a.scale": torch.tensor([0.5, 2.0]),
        "b": torch.tensor([[1, -2]], dtype=torch.int8),
        "b.scale": torch.tensor([0.25]),
        "c.scale": torch.ones(2),
        "text": torch.zeros(3, dtype=torch.uint8),
    }
    found = stored.floats(given)
    assert set(found) == {"a", "b", "c.scale"}
    assert found["a"].shape == (2, 34)
    assert found["a"][0, [0, 1, 2, 32, 33]].tolist() == [-12.0, 10.5, -12.0, -2.0, 1.0]
    assert found["a"][1, [0, 31, 32, 33]].tolist() == [0.0, 0.0, 210.0, 0.0]
    assert found["b"].tolist() == [[0.25, -0.5]]


def test_files_of_the_program_are_near_the_floats(tmp_path: Path) -> None:
    """A random float model to int4 and back, with the error of four bits."""
    umo = program.find()
    before, after = tmp_path / "float.safetensors", tmp_path / "int4.safetensors"
    program.run(umo, "model", "random", "--size", "tiny", "--store", "f32", "-o", before)
    program.run(umo, "model", "quantize", before, "--weights", "int4", "-o", after)
    exact, given = load_file(before), load_file(after)
    read = stored.floats(given)
    int4 = [name for name in exact if f"{name}.multipliers" in given]
    assert int4 and all(".moe.experts." in name for name in int4)
    for name in int4:
        # Channels of `wi_1` and `wo` are equalised, which changes values but not the function.
        if name.endswith("wi_0.weight"):
            error = (read[name] - exact[name]).norm() / exact[name].norm()
            assert 0.01 < error < 0.12, name
