"""`Motion.save` writes what `umo animate` writes."""

import json
import os
import struct
from pathlib import Path

import numpy as np
import pytest

import umo


@pytest.fixture(scope="module")
def reference():
    """The files of `umo animate`, without a suffix."""
    return Path(os.environ["UMO_REFERENCE"]).with_suffix("")


def arrays(path):
    with np.load(path) as file:
        return {name: file[name] for name in file.files}


@pytest.mark.parametrize("suffix", [".jsonl", ".csv", ".bvh"])
def test_texts_are_those_of_umo_animate_to_the_byte(whole, reference, tmp_path, suffix):
    whole.save(tmp_path / f"motion{suffix}")
    mine, wanted = (tmp_path / f"motion{suffix}").read_bytes(), reference.with_suffix(suffix).read_bytes()
    differ = next((i for i, (a, b) in enumerate(zip(mine.splitlines(), wanted.splitlines())) if a != b), None)
    assert differ is None, f"line {differ}"
    assert mine == wanted


def test_arrays_are_those_of_umo_animate(whole, reference, tmp_path):
    whole.save(str(tmp_path / "motion.NPZ"))
    mine, wanted = arrays(tmp_path / "motion.NPZ"), arrays(reference.with_suffix(".npz"))
    assert list(mine) == list(wanted) and len(mine) == 9
    for name, array in wanted.items():
        assert (mine[name].dtype, mine[name].shape) == (array.dtype, array.shape), name
        assert mine[name].tobytes() == array.tobytes(), name
    assert [path.name for path in tmp_path.iterdir()] == ["motion.NPZ"]


def gltf(path):
    """The JSON and the binary part."""
    data = path.read_bytes()
    magic, version, size, length, kind = struct.unpack_from("<4sIII4s", data)
    assert (magic, version, size, kind) == (b"glTF", 2, len(data), b"JSON")
    return json.loads(data[20 : 20 + length]), data[20 + length :]


@pytest.mark.parametrize("suffix", [".glb", ".vrma"])
def test_gltf_is_that_of_umo_animate_to_the_byte(whole, reference, tmp_path, suffix):
    whole.save(tmp_path / f"motion{suffix}")
    assert (tmp_path / f"motion{suffix}").read_bytes() == reference.with_suffix(suffix).read_bytes()
    assert [path.name for path in tmp_path.iterdir()] == [f"motion{suffix}"]


def test_a_glb_has_the_figure_that_is_wanted_or_none(whole, reference, tmp_path):
    assert umo.FIGURES == ("alex", "bea", "carl", "dina")
    whole.save(tmp_path / "motion.glb", figure="bea")
    assert (tmp_path / "motion.glb").read_bytes() == reference.with_name("bea.glb").read_bytes()
    whole.save(tmp_path / "motion.glb", figure=None)
    document, _ = gltf(tmp_path / "motion.glb")
    assert "meshes" not in document and [node["name"] for node in document["nodes"]] == list(umo.JOINTS)
    with pytest.raises(ValueError, match="figure 'bee': did you mean 'bea'"):
        whole.save(tmp_path / "other.glb", figure="bee")
    assert not (tmp_path / "other.glb").exists()


def test_frames_that_lie_apart_and_those_of_a_closed_model_become_a_glb(whole, hello, tmp_path):
    whole[::2].save(tmp_path / "half.glb", figure=None)
    document, _ = gltf(tmp_path / "half.glb")
    assert document["accessors"][-1]["count"] == (len(whole) + 1) // 2
    with umo.Model() as model:
        motion = umo.animate(hello[0][:8000], hello[1], model=model)
    motion.save(tmp_path / "closed.glb")
    assert gltf(tmp_path / "closed.glb")[0]["meshes"]


def test_what_gltf_cannot_hold_is_a_value_error(model, tmp_path):
    motion = by_hand(["a", "b"])
    with pytest.raises(ValueError, match="glb needs a skeleton"):
        motion.save(tmp_path / "motion.glb")
    motion.skeleton = model.skeleton()
    motion.rotations[1, 3] = 0
    with pytest.raises(ValueError, match="not a unit quaternion"):
        motion.save(tmp_path / "motion.glb")
    motion = by_hand(["a", "b"])
    motion.skeleton = (model.skeleton()[0][:9], model.skeleton()[1])
    with pytest.raises(ValueError, match=r"parents \[55\]"):
        motion.save(tmp_path / "motion.glb")
    assert list(tmp_path.iterdir()) == []


def test_a_face_of_coefficients_moves_the_jaw_of_vrm(model, tmp_path):
    motion = by_hand([f"expression{i}" for i in range(10)])
    with pytest.raises(ValueError, match="skeleton"):
        motion.save(tmp_path / "face.vrma")
    motion.skeleton = model.skeleton()
    motion.save(tmp_path / "face.vrma")
    document, _ = gltf(tmp_path / "face.vrma")
    extension = document["extensions"]["VRMC_vrm_animation"]
    assert "jaw" in extension["humanoid"]["humanBones"] and "expressions" not in extension


def test_a_part_of_a_motion_starts_at_second_0(whole, tmp_path):
    whole[50:60].save(tmp_path / "part.jsonl")
    header, *frames = map(json.loads, (tmp_path / "part.jsonl").read_text("utf-8").splitlines())
    assert header["frames"] == len(frames) == 10
    assert [frame["frame"] for frame in frames] == list(range(10)) and frames[3]["time"] == 0.1
    assert np.array_equal(np.array(frames[0]["face"], np.float32), whole.face[50])


def test_numbers_of_every_size_read_back_as_the_same_bits(tmp_path):
    from umo import _save

    texts = {1e-6: "0.000001", 9.9e-7: "9.9e-7", 1e12: "1000000000000.0", 0.1: "0.1", -0.0: "-0.0", 3: "3.0", -2e-30: "-2e-30"}
    for value, text in texts.items():
        assert _save.number(np.float32(value)) == text
    bits = np.random.default_rng(1).integers(0, 1 << 32, 5000, np.uint32).view(np.float32)
    values = bits[np.isfinite(bits)]
    assert np.array(json.loads(_save.numbers(values)), np.float32).tobytes() == values.tobytes()


def by_hand(names, count=2):
    fields = [("rotations", np.float32, (55, 4)), ("translation", np.float32, 3), ("face", np.float32, len(names))]
    frames = np.zeros(count, fields)
    frames["rotations"][..., 3] = 1
    frames["face"] = 0.25
    return umo.Motion(frames, 30, tuple(names))


def test_a_face_of_coefficients_is_padded_in_arrays_and_has_no_csv(model, tmp_path):
    motion = by_hand([f"expression{i}" for i in range(10)])
    motion.save(tmp_path / "face.npz")
    saved = arrays(tmp_path / "face.npz")
    assert "arkit" not in saved and saved["expressions"].shape == (2, 100)
    assert (saved["expressions"][:, :10] == 0.25).all() and (saved["expressions"][:, 10:] == 0).all()
    assert (saved["poses"] == 0).all()
    with pytest.raises(ValueError, match="EyeBlinkLeft.*save .npz or .jsonl"):
        motion.save(tmp_path / "face.csv")
    with pytest.raises(ValueError, match="skeleton"):
        motion.save(tmp_path / "face.jsonl")
    motion.skeleton = model.skeleton()
    motion.save(tmp_path / "face.jsonl")
    assert json.loads((tmp_path / "face.jsonl").read_text("utf-8").splitlines()[0])["face"]["kind"] == "smplx_expression"


def test_what_cannot_be_saved_says_why_and_leaves_nothing(whole, model, tmp_path):
    with pytest.raises(ValueError, match=r"`\.fbx` is unknown; expected one of \.npz, \.bvh, \.glb, \.vrma, \.csv, \.jsonl$"):
        whole.save(tmp_path / "motion.fbx")
    with pytest.raises(ValueError, match="no suffix; expected one of"):
        whole.save(tmp_path / "motion")
    with pytest.raises(ValueError, match="no frames"):
        whole[:0].save(tmp_path / "motion.npz")
    with pytest.raises(ValueError, match="unity.*axes='gltf'"):
        umo.animate(np.zeros(16000), 16000, model=model, axes="unity").save(tmp_path / "motion.npz")
    broken = by_hand(["a"])
    broken.translation[1, 2] = np.nan
    with pytest.raises(ValueError, match="not a finite number"):
        broken.save(tmp_path / "motion.npz")
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(FileNotFoundError) as caught:
        whole.save(tmp_path / "nowhere" / "motion.npz")
    assert caught.value.filename == str(tmp_path / "nowhere" / "motion.npz")
    (tmp_path / "motion.csv").mkdir()
    with pytest.raises(IsADirectoryError):
        whole.save(tmp_path / "motion.csv")
    assert [path.name for path in tmp_path.iterdir()] == ["motion.csv"]
