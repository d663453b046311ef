import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import soundfile
from scipy.io import wavfile
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from metrics_motion import still, swinging, turned
from test_data_beat2 import write_clips
from umo_train.metrics import __main__ as command
from umo_train.metrics import mismatch, mismatch_report, takes
from umo_train.metrics.item import Item
from umo_train.skeleton import ARKIT, JOINT, JOINTS, rotations
from umo_train.speech.utterance import SAMPLE_RATE

SECONDS = 9
FRAMES = 30 * SECONDS
WINDOW, EDGE, WINDOWS = 30, 15, 8
OPTIONS = mismatch.Options(seconds=WINDOW / 30, edge=EDGE / 30, folds=2, steps=30, jobs=1)
TAKES = 10


def speech(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Noise whose loudness comes and goes as syllables do, and the loudness of each frame."""
    rng = np.random.default_rng(seed)
    loud = np.exp(1.5 * gaussian_filter1d(rng.normal(size=SECONDS * 30), 2.0) * 2.5)
    level = np.interp(np.arange(SECONDS * SAMPLE_RATE) / SAMPLE_RATE * 30, np.arange(len(loud)) + 0.5, loud)
    return (0.02 * level * rng.normal(size=len(level))).astype(np.float32), loud


def talker(seed: int, *, follows: bool = True) -> takes.Take:
    """Somebody whose jaw and left arm follow the loudness, or another talker's."""
    samples, loud = speech(seed)
    moved = np.log(loud if follows else speech(seed + 1000)[1])
    motion = turned(still(len(moved)), JOINT["left_shoulder"], 0.1 * moved)
    motion["face"][:, 6 + ARKIT.index("jawOpen")] = 0.2 + 0.1 * moved
    return takes.of_motion(f"take{seed}", f"speaker{seed}", samples, motion)


def only(view: str, of: list[takes.Take]) -> list[takes.Take]:
    return [replace(take, seen={view: take.seen[view]}, energy={view: take.energy[view]}) for take in of]


def finds(of: list[takes.Take]) -> dict:
    return mismatch_report.finds(mismatch.tried(of, OPTIONS), 0)


def test_motion_that_follows_the_speech_is_found_and_other_motion_is_not():
    found = finds(only("face", [talker(seed) for seed in range(TAKES)]))
    assert found["groups"] == TAKES and found["pairs"] == TAKES * WINDOWS
    assert found["network"]["face"].value > 0.9 and found["plain"]["face"].value > 0.9
    other = finds(only("face", [talker(seed, follows=False) for seed in range(TAKES)]))
    assert all(0.3 < other[judge]["face"].value < 0.7 for judge in ("network", "plain"))


def test_a_puppet_of_the_loudness_is_found_and_its_swapped_motion_is_not():
    of = [takes.of_motion(f"t{i}", f"s{i}", speech(i)[0], swinging(FRAMES, i, 0.05)) for i in range(TAKES)]
    puppets = only("body", mismatch.puppets(of, metres=0.05))
    assert finds(puppets)["network"]["body"].value > 0.85
    assert np.abs(puppets[0].energy["body"] - of[0].energy["body"]).max() > 1e-4
    assert 0.3 < finds(mismatch.swapped(puppets))["network"]["body"].value < 0.7


def test_other_speech_is_the_speakers_own_elsewhere_and_as_loud():
    samples, _ = speech(0)
    loud = samples * np.where(np.arange(len(samples)) < len(samples) / 2, 0.1, 1.0).astype(np.float32)
    of = [takes.of_motion(f"t{i}", "one" if i < 4 else "two", loud, still(FRAMES)) for i in range(6)]
    prepared = [mismatch.prepare(take, EDGE) for take in of]
    found = mismatch.pairs(prepared, WINDOW, 0)
    assert len(found) == 6 * WINDOWS
    for pair in found:
        assert pair.other.speaker == pair.motion.speaker
        assert pair.other is not pair.motion or abs(pair.other_start - pair.start) >= WINDOW
        assert min(pair.start, pair.other_start) >= EDGE and max(pair.start, pair.other_start) <= FRAMES - EDGE - WINDOW

    def level(one: mismatch.Prepared, start: int) -> float:
        return one.loudness[start : start + WINDOW].mean()

    apart = [abs(level(pair.motion, pair.start) - level(pair.other, pair.other_start)) for pair in found]
    assert np.median(apart) < 0.2 * of[0].loudness.max()


def test_a_judge_is_tried_on_speakers_that_it_was_not_trained_on(monkeypatch):
    seen: list[tuple[set[str], set[str]]] = []

    def note(learned, rows, view, window, options):
        seen.append(({p.speaker for p in learned}, {p.motion.speaker for p in rows}))
        return np.zeros(len(rows))

    monkeypatch.setattr(mismatch, "_try", note)
    of = [talker(seed) for seed in range(6)]
    network = finds(of)["network"]
    assert list(network) == ["whole", "body", "face"]
    assert (network["whole"].value, network["whole"].low, network["whole"].high) == (0.5, 0.5, 0.5)
    assert all(not learned & tried for learned, tried in seen)
    assert set.union(*(tried for _, tried in seen)) == {take.speaker for take in of}


def test_a_live_mouth_has_a_face_alone():
    take = talker(0)
    spoken = Item("one", "somebody", take.samples)
    (seen,) = takes.of_mouth(lambda samples: (take.motion["face"], samples), [spoken])
    assert seen.speaker == "somebody" and seen.motion is None and list(seen.seen) == ["face"]
    assert np.corrcoef(seen.energy["face"], take.energy["face"])[0, 1] > 0.99


def save(path: Path, take: takes.Take, **arrays: np.ndarray) -> None:
    np.savez(path, **arrays)
    wavfile.write(path.with_suffix(".wav"), SAMPLE_RATE, take.samples)


def test_folders_of_motion_beside_its_sound_are_read(tmp_path):
    take = talker(0)
    turns = Rotation.from_matrix(rotations(take.motion).reshape(-1, 3, 3)).as_rotvec().reshape(-1, JOINTS * 3)
    body = {"poses": turns, "trans": np.zeros((FRAMES, 3))}
    save(tmp_path / "a_1.npz", take, **body, arkit=take.motion["face"][:, 6:], arkit_names=np.array(ARKIT))
    save(tmp_path / "b_1.npz", take, **body, expressions=np.random.default_rng(0).normal(size=(FRAMES, 100)))
    save(tmp_path / "c_1.npz", take, weights=np.ones((FRAMES, 7)))
    save(tmp_path / "d_1.npz", take, opening=np.ones(FRAMES))
    np.savez(tmp_path / "silent.npz", poses=turns)
    a, b, c, d = takes.from_folder(tmp_path)
    assert [one.speaker for one in (a, b, c, d)] == ["a", "b", "c", "d"]
    assert a.seen["body"] == pytest.approx(take.seen["body"], abs=1e-5)
    assert b.seen["body"] == pytest.approx(take.seen["body"], abs=1e-5)
    assert a.energy["face"] == pytest.approx(take.energy["face"], abs=1e-5)
    assert b.seen["face"].shape == (FRAMES, 106)
    assert (c.seen["face"].shape, d.seen["face"].shape) == ((FRAMES, 7), (FRAMES, 1)) and not set(c.seen) - {"face"}
    save(tmp_path / "e_1.npz", take, other=np.ones(3))
    with pytest.raises(ValueError, match="expected poses, weights or opening"):
        takes.from_folder(tmp_path)
    with pytest.raises(FileNotFoundError, match="no motion"):
        takes.from_folder(tmp_path / "nowhere")


def test_folders_of_beat2_and_of_landmarks_are_read(tmp_path):
    clips = takes.from_folder(write_clips(tmp_path))
    assert [(one.name, one.speaker) for one in clips] == [
        ("2_scott_0_1_1", "2"),
        ("10_kieks_0_1_1", "10"),
        ("2_scott_0_2_2", "2"),
    ]
    assert all(one.seen["face"].shape == (61, 106) and one.motion is not None for one in clips)
    (tmp_path / "talker" / "audio").mkdir(parents=True)
    order = sorted({point for pair in (*takes._DISTANCES, takes._EYES) for point in pair})
    places = np.zeros((1, 75, len(order), 3), np.int16)
    places[..., order.index(33), 0] = 160
    places[0, :, order.index(14), 1] = np.arange(75)
    np.savez(tmp_path / "talker" / "landmarks_0.npz", names=["one"], index=order, landmarks=places)
    soundfile.write(tmp_path / "talker" / "audio" / "one.opus", np.zeros(72000), 24000, format="OGG", subtype="OPUS")
    talker = takes.from_folder(tmp_path / "talker")[0]
    assert (talker.name, talker.speaker, set(talker.seen)) == ("one", "talker", {"face"})
    # 75 frames at 25 a second are 89 at 30; the lips part by a 160th of the eyes' distance in each of the former.
    assert talker.energy["face"] == pytest.approx(np.arange(89) * 25 / 30 / 160)


def test_clips_of_a_speaker_are_joined(tmp_path):
    for name in ("a_1", "a_2", "a_3", "b_1"):
        wavfile.write(tmp_path / f"{name}.wav", SAMPLE_RATE, speech(0)[0])
    found = takes.joined([tmp_path], [], 10.0, 1.0)
    assert [(one.voice, one.seconds) for one in found] == [("a", 18.0)]
    assert [one.voice for one in takes.joined([], [tmp_path], 10.0, 0.2)] == [tmp_path.name]


def test_the_command_writes_both_tables(tmp_path):
    for seed in range(4):
        take = talker(seed)
        turns = Rotation.from_matrix(rotations(take.motion).reshape(-1, 3, 3)).as_rotvec()
        save(
            tmp_path / f"s{seed}_1.npz",
            take,
            poses=turns.reshape(-1, JOINTS * 3),
            trans=np.zeros((FRAMES, 3)),
            arkit=take.motion["face"][:, 6:],
            arkit_names=np.array(ARKIT),
        )
    words = f"mismatch --motion people={tmp_path} --seconds 2 --edge 0.5 --folds 2 --steps 2 --jobs 1 --controls"
    arguments = command._arguments().parse_args([*words.split(), "-o", str(tmp_path / "out")])
    arguments.run(arguments)
    found = json.loads((tmp_path / "out" / "mismatch.json").read_text())
    assert list(found["subjects"])[2] == "people" and len(found["subjects"]) == 3
    assert found["subjects"]["people"]["network"]["face"].keys() == {"value", "low", "high", "count"}
    said = (tmp_path / "out" / "mismatch.md").read_text()
    assert said.count("| people | ") == 2 and said.count("| control: ") == 2 and "Smooth-BC" in said
