import os
import pickle

import joblib
import numpy as np
import pytest
import torch
from safetensors.torch import save_file

import convert_sources
from umo_train.convert import SourceError, kmeans

CONFIG = convert_sources.golden_config()
NAME = "audio.kmeans.centroids"


def test_centroids_of_a_joblib_dump_are_read(tmp_path):
    path = tmp_path / "km.bin"
    centers = convert_sources.kmeans(path, CONFIG)
    assert np.array_equal(kmeans.convert(path, CONFIG)[NAME].numpy(), centers)


def test_rows_and_safetensors_are_read(tmp_path):
    rows = convert_sources.kmeans(tmp_path / "km.bin", CONFIG)
    np.save(tmp_path / "km.npy", rows)
    save_file({"centroids": torch.from_numpy(rows)}, tmp_path / "km.safetensors")
    for name in ("km.npy", "km.safetensors"):
        assert np.array_equal(kmeans.convert(tmp_path / name, CONFIG)[NAME].numpy(), rows)


class Attack:
    def __reduce__(self):
        return os.mkdir, (self.where,)

    def __init__(self, where):
        self.where = where


def test_what_a_pickle_asks_to_run_is_not_run(tmp_path):
    attack = Attack(str(tmp_path / "ran"))
    holder = np.array([attack], dtype=object)
    for i, harmful in enumerate((attack, {"cluster_centers_": attack}, holder)):
        path = tmp_path / f"{i}.bin"
        joblib.dump(harmful, path)
        with pytest.raises(SourceError):
            kmeans.convert(path, CONFIG)
    assert not (tmp_path / "ran").exists()
    # The same bytes do run where nothing guards against it.
    pickle.loads(pickle.dumps(attack))
    assert (tmp_path / "ran").exists()


def test_wrong_files_are_named(tmp_path):
    short = tmp_path / "short.bin"
    convert_sources.kmeans(short, CONFIG)
    short.write_bytes(short.read_bytes()[:200])
    packed = tmp_path / "packed.bin"
    joblib.dump(np.zeros((2, 2)), packed, compress=3)
    other = tmp_path / "other.npy"
    np.save(other, np.zeros((3, 4), np.float32))
    for path, says in (
        (short, "cannot read a k-means"),
        (packed, "compress=0"),
        (other, r"expected \[37, 20\], got \[3, 4\]"),
    ):
        with pytest.raises(SourceError, match=says) as raised:
            kmeans.convert(path, CONFIG)
        assert str(path) in str(raised.value)
