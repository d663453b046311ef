"""The live mouth: features and network compared with the golden reference, examples, training, and the file's part."""

import json
import zlib
from dataclasses import replace
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
import soundfile
import torch
import yaml
from safetensors import safe_open
from safetensors.torch import save_file

import made_run
from made_run import MOUTH_CHANNELS, MOUTH_FEATURES, MOUTH_NETWORK
from margin import Margin
from mouth import Mouth as Reference
from umo_train.export import checksum
from umo_train.metrics import languages
from umo_train.metrics.lips import WIDTH
from umo_train.mouth import captured, examples, part, sounds
from umo_train.mouth.features import Front, Sizes, sizes_of
from umo_train.mouth.gate import gate, gated
from umo_train.mouth.make import _foreign, make
from umo_train.mouth.run import Mouth
from umo_train.mouth.train import MouthPlan, _loss, closing, train, warped
from umo_train.people.align import covering
from umo_train.performer.lips import lip_opening
from umo_train.plan import Run
from umo_train.skeleton import SHAPE
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
    # Another training that begins with it.
    still = replace(plan, steps=1, rate=0.0)
    begun = train(still, front, items, MOUTH_CHANNELS, rest, tmp_path / "begun", network.tensors(torch.float32))
    assert all(torch.equal(a, b) for a, b in zip(network.parameters(), begun.parameters(), strict=True))


def test_a_second_head_gives_frames_before(tmp_path: Path) -> None:
    about, tensors = made_run.mouth(behind=4)
    mouth, samples = Mouth(about, tensors), _sound(30_000)
    later = mouth.later(samples)
    assert len(later) == len(mouth.outputs(samples))
    # It has heard what comes within four frames of the last one that the first head may hear, and no more.
    heard = 20 * SAMPLE_RATE // FRAME_RATE
    samples[heard:] *= -0.5
    changed = np.abs(mouth.later(samples) - later).max(1) > 1e-6
    assert not changed[:15].any() and changed[15:22].sum() > 4


def _folder_of_landmarks(folder: Path, closures: np.ndarray) -> None:
    """Ten sentences of 2 s of a talker: lips that open and close, `closures` of them, and a mouth that narrows."""
    (folder / "audio").mkdir(parents=True)
    points = (61, 291, 33, 263, 13, 14, 1, 152, 0, 17)
    t = np.arange(50) / captured.GRID_RATE
    names, every, words = [], [], {}
    for i in range(10):
        at = np.zeros((50, len(points), 3))
        gap = 10 * np.where(t < 0.5, 0, np.sin(np.pi * closures[i] * (t - 0.5) / 1.5) ** 2)
        narrow = 6 * np.where(t < 0.5, 0, np.sin(2 * np.pi * t) ** 2)
        for column, x in ((0, -20 + narrow), (1, 20 - narrow), (2, -40), (3, 40)):
            at[:, column, 0] = x
        for column, y in ((4, -gap / 2), (5, gap / 2), (6, -40), (7, 40 + gap), (8, -5 - gap / 2), (9, 5 + gap / 2)):
            at[:, column, 1] = y
        names.append(f"s{i}")
        every.append(at * 16)
        words[f"s{i}"] = [[0, 0.5, "sil"], [0.5, 2.0, "bin"]]
        soundfile.write(folder / "audio" / f"s{i}.opus", _sound(48_000), 24_000, format="OGG", subtype="OPUS")
    about = {"names": np.array(names), "index": np.array(points), "landmarks": np.array(every, np.int16)}
    np.savez(folder / "landmarks_0.npz", **about)
    (folder / "words.json").write_text(json.dumps(words))


def test_landmarks_become_a_mouth_that_opens_as_they_do(tmp_path: Path) -> None:
    _folder_of_landmarks(tmp_path, np.arange(1, 11) % 4 + 1)
    found = captured.landmarks(tmp_path)
    left_out = captured.held_out([f"s{i}" for i in range(10)])
    assert len(left_out) == 1 and {one.name for one in found} == {f"s{i}" for i in range(10)} - left_out
    for one in found:
        face = np.concatenate([np.zeros((50, 6)), one.mouth], axis=1)
        opening = lip_opening(face)
        count = (int(one.name[1:]) + 1) % 4
        wanted = np.sin(np.pi * (count + 1) * np.clip(np.arange(50) / 25 - 0.5, 0, None) / 1.5) ** 2
        assert np.corrcoef(opening, wanted)[0, 1] > 0.99 and opening[:12].max() < 0.03
        rounded = one.mouth[:, SHAPE["mouthPucker"]] + one.mouth[:, SHAPE["mouthFunnel"]]
        assert rounded[19] > 0.4 and rounded[:12].max() < 0.1
        assert one.mouth.min() >= 0 and one.mouth.max() <= 1


def test_a_mouth_narrows_as_captured_whatever_its_lips_do() -> None:
    still, least, most = np.array([[0, 60, 30, 8, 12, 90], [0, 50, 20, 6, 10, 80], [15, 65, 40, 10, 15, 100]], float)
    lengths = np.tile(still, (41, 1))
    lengths[:, 1] = np.linspace(least[1], most[1], 41)
    for red in (30, 25, 35):
        lengths[:, 2] = red
        mouth = captured.fitted(lengths, still, least, most)
        width = mouth @ WIDTH
        assert np.corrcoef(width, lengths[:, 1])[0, 1] > 0.97 and width[5] < width[15] - 0.1 < width[35] - 0.2
        assert mouth.min() >= 0 and mouth.max() <= 1


def test_a_faster_capture_stays_in_step() -> None:
    t = np.arange(100) / 25
    mouth = np.tile(np.sin(2 * np.pi * t)[:, None] ** 2, (1, 52))
    sound = np.repeat(np.sin(2 * np.pi * np.arange(400) / 100) ** 2, 160).astype(np.float32)
    fast = captured.Capture("a", sound, mouth, 25.0).faster(1.25)
    frames = fast.frames()
    assert len(fast.samples) == 51_200 and len(frames) == 96
    heard = fast.samples[(np.arange(90) * SAMPLE_RATE // FRAME_RATE)]
    assert np.corrcoef(heard, frames[:90, 0])[0, 1] > 0.99
    pieces = captured.Capture("a", sound, mouth, 25.0).pieces(1.5)
    assert [len(one.samples) for one in pieces] == [24_000, 40_000]


def test_a_rigs_weights_become_a_mouth(tmp_path: Path) -> None:
    parts = [(shape, side) for shapes in captured.RIG.values() for shape, sides in shapes for side in sides.split()]
    names = ["brow", *(f"mouth_{shape}_{side}" for shape, side in parts)]
    (tmp_path / "weight_names.txt").write_text("\n".join(names))
    values = np.zeros((60, len(names) + 1), np.float32)
    values[:, names.index("mouth_stretch_c") + 1] = np.linspace(0, 0.8, 60)
    values[:, names.index("mouth_pucker_l") + 1] = 0.5
    np.savez(tmp_path / "take.npz", weights=values, fps=30)
    soundfile.write(tmp_path / "take.opus", _sound(48_000), 24_000, format="OGG", subtype="OPUS")
    (one,) = captured.weights(tmp_path, ["take"])
    opening = lip_opening(np.concatenate([np.zeros((60, 6)), one.mouth], axis=1))
    assert opening[-1] == pytest.approx(captured.OPEN, rel=0.03) and opening[0] == 0
    assert one.mouth[:, SHAPE["mouthPucker"]] == pytest.approx(0.25)


def test_what_a_capture_does_not_know_is_not_learned() -> None:
    front = Front(sizes_of(MOUTH_FEATURES))
    one = captured.Capture("a", _sound(16_000), np.full((25, 52), 0.4), 25.0)
    at = [SHAPE["jawOpen"], SHAPE["tongueOut"]]
    example = examples.captured("landmarks", front, one, at, np.array([0.1, 0.2]), np.random.default_rng(0))
    assert example.known.tolist() == [1, 0]
    assert example.mouth[:, 0].numpy() == pytest.approx(0.4, abs=1e-3)
    assert example.mouth[:, 1].numpy() == pytest.approx(0.2, abs=1e-3)


def test_short_closures_between_open_lips_weigh_more() -> None:
    opening = torch.full((1, 40), 0.3)
    opening[:, 10:12] = 0.0
    weight = closing(opening)[0]
    assert weight[10:12].min() > 0.9 and weight[:10].max() == 0 and weight[12:].max() == 0
    # A pause does not count.
    assert closing(torch.zeros(1, 40)).max() == 0


def test_lips_less_apart_than_open_ones_weigh_more() -> None:
    shape = (1, 8, 1)
    wanted, ones, known = torch.full(shape, 0.4), torch.ones(1, 8), torch.ones(1, 1)
    lips = torch.tensor([[1.0, 0.0, 0.0]])

    def loss(channel: float, weight: float) -> float:
        outputs = torch.cat([torch.full(shape, channel), torch.zeros(shape)], -1)
        plan = MouthPlan(steps=1, open=weight)
        return _loss(plan, lips, outputs, wanted, ones, ones, ones, known)[0].item()

    assert loss(0.2, 3.0) == pytest.approx(loss(0.2, 0.0) + 3.0 * 0.2**2)
    assert loss(0.6, 3.0) == loss(0.6, 0.0)


def test_warped_bands_have_a_tone_where_its_frequency_goes() -> None:
    front, t = Front(sizes_of(MOUTH_FEATURES | {"bands": 40})), np.arange(16_000) / SAMPLE_RATE
    low, high = (front.rows(np.sin(2 * np.pi * f * t).astype(np.float32))[None] for f in (1000.0, 1250.0))
    bands = front.sizes.bands
    assert torch.allclose(warped(low, bands, torch.ones(1)), low, atol=1e-3)
    moved = warped(low, bands, torch.tensor([1.0 / 1.25]))
    assert abs(int(moved[0, 40, :bands].argmax()) - int(high[0, 40, :bands].argmax())) <= 1
    assert torch.equal(moved[..., bands:], low[..., bands:])


def test_no_language_of_the_training_is_one_of_the_tests() -> None:
    spoken = list(_foreign(1))
    assert len(spoken) >= 30 and all(len(u.phones) > 10 for u in spoken)
    lines = (resources.files("umo_train.speech") / "more_languages.txt").read_text("utf-8").splitlines()
    assert not {line.split("\t")[0] for line in lines if not line.startswith("#")} & languages.sentences().keys()


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
