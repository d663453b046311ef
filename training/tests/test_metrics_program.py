import os
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from metrics_motion import swinging
from umo_train.metrics import agreement, experts, program
from umo_train.metrics.item import Item
from umo_train.metrics.motion import joint_places
from umo_train.metrics.speed import speed
from umo_train.skeleton import ARKIT, CHANNELS, JOINTS, PARTS, VELOCITY, rotations

CONFIG = {
    "vocab": {
        "decoder_start": 0,
        "audio": {"first": 100, "codes": 8, "start": 108, "end": 109},
        **{
            part: {"first": 10 * i, "codes": 6, "start": 10 * i + 7, "end": 10 * i + 8}
            for i, part in enumerate(PARTS, 1)
        },
    },
    "templates": {"audio_to_motion": [3, "audio", "face", "hands", "upper", "lower", 1]},
}


def test_an_animation_is_read_as_channels(tmp_path):
    motion, order = swinging(20, 0), np.random.default_rng(0).permutation(52)
    motion["face"][:, 6:] = np.random.default_rng(1).uniform(size=(20, 52))
    motion["lower"][:-1, VELOCITY] = [0.3, 0, -0.1]
    walked = np.cumsum(np.concatenate([np.zeros((1, 3)), motion["lower"][:-1, VELOCITY]]), 0) / 30
    np.savez(
        tmp_path / "m.npz",
        poses=Rotation.from_matrix(rotations(motion).reshape(-1, 3, 3)).as_rotvec().reshape(20, JOINTS * 3),
        trans=walked + [0, 0.9, 0],
        arkit=motion["face"][:, 6:][:, order],
        arkit_names=np.array(ARKIT)[order],
    )
    got = program.from_npz(tmp_path / "m.npz")
    for part in PARTS:
        assert got[part].shape == (20, CHANNELS[part])
    assert got["face"][:, 6:] == pytest.approx(motion["face"][:, 6:])
    assert joint_places(got) == pytest.approx(joint_places(motion), abs=1e-5)


def test_a_face_of_expression_coefficients_is_refused(tmp_path):
    np.savez(tmp_path / "m.npz", poses=np.zeros((2, 165)), trans=np.zeros((2, 3)))
    with pytest.raises(ValueError, match="not ARKit"):
        program.from_npz(tmp_path / "m.npz")


def test_a_program_that_is_missing_or_fails_says_so(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(program, "__file__", str(tmp_path / "a/b/c/d.py"))
    with pytest.raises(FileNotFoundError, match="cargo build"):
        program.find()
    failing = tmp_path / "umo"
    failing.write_text("#!/bin/sh\necho no such model >&2\nexit 2\n")
    failing.chmod(0o755)
    assert program.find() == failing
    with pytest.raises(RuntimeError, match="umo model: no such model"):
        program.run(failing, "model", "inspect")


def test_ids_stand_between_their_markers():
    codes = {part: np.array([i, i + 1]) for i, part in enumerate(PARTS)}
    encoder = agreement.encoder_ids(CONFIG, [5, 6], codes)
    assert encoder.tolist() == [
        3,
        108,
        105,
        106,
        109,
        *(17, 10, 11, 18),
        *(27, 21, 22, 28),
        *(37, 32, 33, 38),
        *(47, 43, 44, 48),
        1,
    ]
    decoder = agreement.decoder_ids(CONFIG, codes)
    assert decoder.tolist() == [0, 17, 10, 11, 18, 27, 21, 22, 28, 37, 32, 33, 38, 47, 43, 44]


def test_the_likeliest_codes_are_read_where_they_are_told():
    codes = {part: np.array([i, 5 - i, 3]) for i, part in enumerate(PARTS)}
    ids = np.concatenate([agreement.decoder_ids(CONFIG, codes)[1:], [48]])
    # An id that is not a code is more likely everywhere, but is ignored.
    logits = np.where(np.arange(60) == ids[:, None], 1.0, 0.0)
    logits[:, 9] = 9.0
    got = agreement.likeliest(CONFIG, logits)
    assert {part: got[part].tolist() for part in PARTS} == {part: codes[part].tolist() for part in PARTS}


@pytest.fixture(scope="module")
def umo() -> Path:
    try:
        return program.find(Path(os.environ["UMO"]) if "UMO" in os.environ else None)
    except FileNotFoundError:
        pytest.skip("the program is not built")


@pytest.fixture(scope="module")
def model(umo, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("model") / "random.safetensors"
    program.run(umo, "model", "random", "--size", "small", "--store", "f32", "--seed", 3, "-o", path)
    return path


SPEECH = Item("noise", "nobody", np.random.default_rng(0).normal(size=40000).astype(np.float32) * 0.1)


def test_the_program_animates(umo, model):
    made = program.animate(umo, SPEECH, model, seed=1, prompt="calm")
    assert all(made[part].shape == (75, CHANNELS[part]) for part in PARTS)
    other = program.animate(umo, SPEECH, model, seed=2, prompt="calm")
    assert not np.array_equal(made["upper"], other["upper"])
    drawn = program.decode(umo, {part: np.arange(40) for part in PARTS}, model)
    assert all(drawn[part].shape == (40, CHANNELS[part]) for part in PARTS)
    assert speed(umo, model, 2, 2).frames_per_second > 0


def test_int8_agrees_with_f32_on_most_codes_and_f32_on_all(umo, model):
    chunks = agreement.trace(umo, SPEECH, model, 2)
    assert len(chunks) == 2 and chunks[0].codes["face"].shape == (5,)
    assert agreement.agreement(umo, chunks, model, precision="f32")["all"] == 1
    assert 0.5 < agreement.agreement(umo, chunks, model)["all"] <= 1


def test_experts_are_counted_over_all_rows(umo, model):
    pytest.importorskip("umo_train.lm.model")
    chunks = agreement.trace(umo, SPEECH, model, 1)
    counts = experts.first_choices(model, chunks)
    assert list(counts) == ["encoder 0", "encoder 1", "decoder 0", "decoder 1"]
    assert counts["encoder 1"].sum() == len(chunks[0].encoder) and counts["decoder 0"].sum() == len(chunks[0].decoder)
    assert 0 < experts.entropy(counts) <= 1
