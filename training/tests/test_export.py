"""Export of the model file."""

import json
import zlib
from pathlib import Path

import torch
from safetensors import safe_open

from umo_train import export


def test_the_checksums_are_those_of_the_config_and_the_data_and_of_the_header(tmp_path: Path) -> None:
    path = tmp_path / "model.safetensors"
    # A config with text that looks like the placeholder of the checksum, and non-ASCII letters.
    config = {"name": 'the "crc32:00000000" of ümo', "checksum": "crc32:00000000", "rest": [1, 2, 3]}
    export.write(path, config, {"b": torch.arange(7.0), "a": torch.ones(3, 5, dtype=torch.bfloat16)})
    with safe_open(path, "pt") as file:
        metadata = file.metadata()
        assert torch.equal(file.get_tensor("b"), torch.arange(7.0))
    assert json.loads(metadata["config"]) == config
    whole = path.read_bytes()
    data = whole[8 + int.from_bytes(whole[:8], "little") :]
    assert len(data) == 7 * 4 + 15 * 2
    assert metadata["checksum"] == export.checksum(zlib.crc32(metadata["config"].encode() + data))
    head = whole[: len(whole) - len(data)]
    before = f'"{export.HEADER}":"{export.checksum(0)[:-8]}'.encode()
    place = head.index(before) + len(before)
    unsealed = head[:place] + b"00000000" + head[place + 8 :]
    assert metadata[export.HEADER] == export.checksum(zlib.crc32(unsealed))
