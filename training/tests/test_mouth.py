"""The live mouth: features and network compared with the golden reference, examples, training, and the file's part."""

import json
import zlib
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml
from safetensors import safe_open
from safetensors.torch import save_file

import made_run
from made_run import MOUTH_CHANNELS, MOUTH_FEATURES, MOUTH_NETWORK
from margin import Margin
from mouth import Mouth as Reference
from umo_train.export import checksum
from umo_train.mouth import examples, part, sounds
from umo_train.mouth.features import Front, Sizes, sizes_of
from umo_train.mouth.gate import gate, gated
from umo_train.mouth.make import make
from umo_train.mouth.run import Mouth
from umo_train.mouth.train import MouthPlan, train
from umo_train.people.align import covering
from umo_train.plan import Run
from umo_train.speech.utterance import FRAME_RATE, SAMPLE_RATE, Phone, Utterance

CONFIGS = Path(__file__).parents[1] / "configs"


def _sound(samples: int, level: float = 0.3) -> np.ndarray:
    rng = np.random.default_rng(4)
    t = np.arange(samples) / SAMPLE_RATE
    tone = np.sin(2 * np.pi * 180 * t) * np.maximum(np.sin(2 * np.pi * 1.5 * t), 0)
    return (level * (tone + 0.02 * rng.standard_normal(samples))).astype(np.float32)


def test_a_clip_is_what_the_reference_computes() -> None:
    about, tensors = made_run.mouth()
    config = {"mouth": about, "audio": {"sample_rate": SAMPLE_RATE}, "frame_rate": FRAME_RATE}
    samples = _sound(40_011)
    channels, opened = Reference(config, tensors)(torch.from_numpy(samples), Margin())
    mouth = Mouth(about, tensors)
    outputs = mouth.outputs(samples)
    np.testing.assert_allclose(gated(outputs, mouth.rest), channels, atol=2e-4)
    np.testing.assert_array_equal(gate(outputs[:, -1]), opened)
    assert len(outputs) == len(samples) * FRAME_RATE // SAMPLE_RATE
    assert np.ptp(outputs, 0).min() > 0.05


@pytest.mark.parametrize(("taps", "ahead"), [(3, 5), (6, 5), (9, 2)])
def test_rows_of_a_stretch_are_the_frames_own(taps: int, ahead: int) -> None:
    front = Front(Sizes(**MOUTH_FEATURES | {"taps": taps, "ahead": ahead}))
    rows = front.rows(_sound(16_000))
    assert len(rows) == front.row_count(30)


def test_levels_give_the_same_rows() -> None:
    front = Front(sizes_of(MOUTH_FEATURES | {"floor": 1e-12}))
    loud, quiet = (front.rows(_sound(10 * SAMPLE_RATE, level))[-300:] for level in (0.7, 0.002))
    assert (loud - quiet).abs().mean() < 0.02


def test_a_gate_opens_at_once_and_shuts_late() -> None:
    odds = np.concatenate([np.full(5, -4.0), np.full(5, 4.0), np.full(30, -4.0)])
    opened = gate(odds)
    assert opened[:5].max() == 0.0
    assert opened[6] == 1.0
    # Five frames without a voice are a short pause.
    assert opened[14] == 1.0 and opened[15] < 1.0 and opened[25] == 0.0
    # Between the thresholds nothing changes.
    assert gate(np.full(9, 0.0)).max() == 0.0


def test_voices_pause_where_it_is_silent_for_long() -> None:
    voice, weight = examples.voices([(0.0, 1.0), (1.5, 1.6)], 90)
    assert not voice[:30].any() and voice[30:].all()
    assert weight[30] < 1.0 and weight[20] == 1.0 and weight[46] == 1.0


@pytest.mark.parametrize("make_sound", [make_sound for make_sound, _ in sounds._KINDS])
def test_sounds_are_finite_and_as_long_as_asked(make_sound) -> None:
    for seed in range(4):
        sound = make_sound(9000, np.random.default_rng(seed))
        assert sound.shape == (9000,) and np.isfinite(sound).all() and np.abs(sound).max() > 0


def test_training_learns_when_a_tone_speaks(tmp_path: Path) -> None:
    front = Front(sizes_of(MOUTH_FEATURES))
    samples = np.concatenate([np.zeros(16_000, np.float32), _sound(16_000), np.zeros(16_000, np.float32)])
    phones = (Phone("pau", 0.0, 1.0), Phone("aa", 1.0, 2.0), Phone("pau", 2.0, 3.0))
    utterance = Utterance("", "", samples, phones)
    items = [examples.spoken(front, utterance, [17, 18, 51], np.random.default_rng(seed)) for seed in range(4)]
    plan = MouthPlan(steps=150, frames=80, batch=4, rate=5e-3, voice=0.1, network=MOUTH_NETWORK)
    rest = np.array([0.02, 0.02, 0.0], np.float32)
    network = train(plan, front, items, MOUTH_CHANNELS, rest, tmp_path)
    clean = torch.cat([torch.sigmoid(network(item.rows.float()[None])[0, :, -1]) for item in items]).detach()
    voice = torch.cat([item.voice for item in items]) > 0
    assert clean[voice].mean() > clean[~voice].mean() + 0.3
    # Resumed after its end: the same weights.
    again = train(plan, front, items, MOUTH_CHANNELS, rest, tmp_path)
    assert all(torch.equal(a, b) for a, b in zip(network.parameters(), again.parameters(), strict=True))


def test_gaps_between_aligned_phones_are_silence() -> None:
    phones = covering([Phone("pau", 0.0, 0.1), Phone("aa", 0.2, 0.3, 1), Phone("t", 0.3, 9.0)], 0.5)
    assert [(p.name, p.start, p.end) for p in phones] == [("pau", 0.0, 0.2), ("aa", 0.2, 0.3), ("t", 0.3, 0.5)]


def test_a_part_is_added_and_replaced(tmp_path: Path) -> None:
    about, tensors = made_run.mouth()
    model, piece, out = tmp_path / "model.safetensors", tmp_path / "mouth.safetensors", tmp_path / "out.safetensors"
    other = {"lm.a": torch.arange(5, dtype=torch.int8), "lm.b": torch.randn(3, 2), "lm.c": torch.ones(3).bfloat16()}
    config = json.dumps({"name": "Zoë", "prefix": 10})
    save_file(other, model, metadata={"format": "umo", "version": "1", "config": config, "checksum": checksum(0)})
    part.write(piece, about, tensors)
    for _ in range(2):
        part.add(model, piece, out)
        with safe_open(out, framework="pt") as file:
            found = {name: file.get_tensor(name) for name in file.keys()}
            metadata = file.metadata()
        assert found.keys() == other.keys() | tensors.keys()
        assert all(torch.equal(found[name], tensor) for name, tensor in (other | tensors).items())
        assert json.loads(metadata["config"]) == {"name": "Zoë", "prefix": 10, "mouth": about}
        # Into its own result, replacing the existing part.
        model = out
    raw = out.read_bytes()
    length = int.from_bytes(raw[:8], "little")
    assert (8 + length) % 64 == 0
    assert metadata["checksum"] == f"crc32:{zlib.crc32(raw[8 + length :], zlib.crc32(metadata['config'].encode())):08x}"


def test_recordings_that_a_plan_names_must_be_there(tmp_path: Path) -> None:
    plan = yaml.safe_load((CONFIGS / "mouth.yaml").read_text())
    plan["speech"] |= {"hours": 0.02, "voices": {"flite-slt": 1}, "held_out": ["flite-slt"], "test_minutes": 0.05}
    from umo_train import pipeline

    run = Run(plan, CONFIGS, tmp_path / "corpus", tmp_path / "run")
    pipeline.step_speech(run)
    with pytest.raises(FileNotFoundError, match="kathleen"):
        make(run)
