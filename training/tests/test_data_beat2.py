from pathlib import Path

import numpy as np
import pytest
import soundfile
from scipy.spatial.transform import Rotation

from umo_train import skeleton
from umo_train.data.beat2 import beat2
from umo_train.data.clip import DataError
from umo_train.speech.utterance import PHONES

NAMES = {"2_scott_0_1_1": "train", "2_scott_0_2_2": "test", "10_kieks_0_1_1": "train"}
FRAMES = 61
RATE = 22050

TEXTGRID = """File type = "ooTextFile"
Object class = "TextGrid"

xmin = 0
xmax = 2.1
tiers? <exists>
size = 2
item []:
{}"""


def tier(number: int, name: str, spans: list[tuple[float, float, str]]) -> str:
    lines = [f"    item [{number}]:", '        class = "IntervalTier"', f'        name = "{name}"', "        xmin = 0"]
    lines += ["        xmax = 2.1", f"        intervals: size = {len(spans)}"]
    for i, (start, end, text) in enumerate(spans, 1):
        lines += [f"        intervals [{i}]:", f"            xmin = {start}", f"            xmax = {end}"]
        lines.append(f'            text = "{text}"')
    return "\n".join(lines) + "\n"


WORDS = [(0.0, 0.3, ""), (0.3, 0.8, "hello"), (0.8, 1.0, ""), (1.0, 2.1, "there")]
SOUNDS = [(0.0, 0.3, "sil"), (0.3, 0.4, "HH"), (0.4, 0.5, "AH0"), (0.5, 0.6, "L"), (0.6, 0.8, "OW1")]
SOUNDS += [(0.8, 1.0, ""), (1.0, 1.2, "DH"), (1.2, 1.5, "EH1"), (1.5, 1.6, "R")]


def write_words(path: Path, *tiers: tuple[str, list]) -> None:
    grid = TEXTGRID.format("".join(tier(i, *each) for i, each in enumerate(tiers, 1)))
    path.write_text(grid.replace("size = 2", f"size = {len(tiers)}", 1))


def write_clips(root: Path) -> Path:
    """BEAT2's folders and files."""
    random = np.random.default_rng(0)
    for part in ("smplxflame_30", "wave16k", "textgrid"):
        (root / part).mkdir()
    rows = "".join(f"{name},{split}\n" for name, split in NAMES.items())
    (root / "train_test_split.csv").write_text("id,type\n" + rows)
    for name in NAMES:
        poses = 0.2 * random.normal(size=(FRAMES, 165))
        np.savez(
            root / "smplxflame_30" / f"{name}.npz",
            betas=np.zeros(300),
            poses=poses,
            expressions=random.normal(size=(FRAMES, 100)),
            trans=random.normal(size=(FRAMES, 3)).cumsum(0) / 100 + (0, 1.2, 0),
            model="smplx2020",
            gender="neutral",
            mocap_frame_rate=30,
        )
        time = np.arange(int(2.1 * RATE)) / RATE
        soundfile.write(root / "wave16k" / f"{name}.wav", 0.5 * np.sin(2 * np.pi * 220 * time), RATE)
        write_words(root / "textgrid" / f"{name}.TextGrid", ("words", WORDS), ("phones", SOUNDS))
    return root


@pytest.fixture
def root(tmp_path):
    return write_clips(tmp_path)


def test_splits_and_speakers_are_chosen(root):
    assert [clip.name for clip in beat2(root, "train")] == ["2_scott_0_1_1", "10_kieks_0_1_1"]
    assert [clip.name for clip in beat2(root, "train", {10})] == ["10_kieks_0_1_1"]
    only = next(iter(beat2(root, "test")))
    assert (only.speaker, only.speech.voice) == ("2", "beat2_2")


def test_channels_are_the_rotations_and_coefficients_of_the_file(root):
    clip = next(iter(beat2(root, "test")))
    raw = np.load(root / "smplxflame_30" / "2_scott_0_2_2.npz")
    widths = {part: values.shape for part, values in clip.motion.items()}
    assert widths == {"face": (61, 106), "hands": (61, 180), "upper": (61, 78), "lower": (61, 61)}
    assert all(values.dtype == np.float32 for values in clip.motion.values())
    found = skeleton.rotations(clip.motion)
    wanted = Rotation.from_rotvec(raw["poses"].reshape(-1, 3)).as_matrix().reshape(61, 55, 3, 3)
    driven = [joint for joints in skeleton.JOINTS_OF.values() for joint in joints]
    np.testing.assert_allclose(found[:, driven], wanted[:, driven], atol=1e-5)
    np.testing.assert_allclose(clip.motion["face"][:, 6:], raw["expressions"], rtol=1e-6)
    np.testing.assert_allclose(clip.translation, raw["trans"], rtol=1e-6)


def test_velocity_integrates_to_the_place(root):
    clip = next(iter(beat2(root, "test")))
    speed = clip.motion["lower"][:, skeleton.VELOCITY].astype(np.float64)
    moved = np.concatenate([np.zeros((1, 3)), speed[:-1].cumsum(0) / 30])
    wanted = clip.translation - clip.translation[0]
    np.testing.assert_allclose(moved[:, [0, 2]], wanted[:, [0, 2]], atol=1e-5)
    assert not speed[:, 1].any()
    assert set(np.unique(clip.motion["lower"][:, skeleton.CONTACT])) <= {0.0, 1.0}


def test_speech_is_16_khz_of_the_motions_length(root):
    clip = next(iter(beat2(root, "test")))
    assert clip.speech.frames == FRAMES == len(clip.translation)
    spectrum = np.abs(np.fft.rfft(clip.speech.samples))
    assert abs(spectrum.argmax() * 16000 / len(clip.speech.samples) - 220) < 1
    assert abs(np.abs(clip.speech.samples).max() - 0.5) < 0.02


def test_words_and_phones_cover_the_speech(root):
    speech = next(iter(beat2(root, "test"))).speech
    assert speech.text == "hello there" and [word.text for word in speech.words] == ["hello", "there"]
    assert speech.words[1].end == pytest.approx(speech.seconds)
    names = "pau hh ax l ow pau dh eh r pau".split()
    assert [phone.name for phone in speech.phones] == names and set(names) <= PHONES
    assert [phone.stress for phone in speech.phones if phone.name in ("ax", "ow", "eh")] == [0, 1, 1]
    ends = [phone.end for phone in speech.phones]
    assert [phone.start for phone in speech.phones] == pytest.approx([0.0, *ends[:-1]])
    assert ends[-1] == pytest.approx(speech.seconds)


@pytest.mark.parametrize(
    ("part", "suffix"), [("smplxflame_30", ".npz"), ("wave16k", ".wav"), ("textgrid", ".TextGrid")]
)
def test_what_is_missing_is_named_with_what_to_do(root, part, suffix):
    path = root / part / f"2_scott_0_2_2{suffix}"
    path.unlink()
    with pytest.raises(DataError) as raised:
        list(beat2(root, "test"))
    assert str(path) in str(raised.value) and "train_test_split.csv lists it" in str(raised.value)


def test_damaged_and_foreign_files_are_refused(root):
    motion = root / "smplxflame_30" / "2_scott_0_2_2.npz"
    words = root / "textgrid" / "2_scott_0_2_2.TextGrid"

    def refused(says):
        with pytest.raises(DataError, match=says):
            list(beat2(root, "test"))

    write_words(words, ("words", WORDS), ("phones", [(0.0, 0.5, "ʃ")]))
    refused("phone `ʃ` at 0.00 s is not ARPAbet's")
    write_words(words, ("words", WORDS))
    refused("no tier `phones`, it has words")
    words.write_text("nothing")
    refused("cannot read a TextGrid")
    write_words(words, ("words", WORDS), ("phones", SOUNDS))
    np.savez(motion, poses=np.zeros((5, 165)), trans=np.zeros((5, 3)))
    refused("no expressions in it")
    np.savez(motion, poses=np.zeros((5, 72)), trans=np.zeros((5, 3)), expressions=np.zeros((5, 100)))
    refused(r"poses of shape \[5, 72\]")
    np.savez(motion, poses=np.zeros((5, 165)), trans=np.zeros((5, 3)), expressions=np.zeros((5, 50)))
    refused(r"expressions of shape \[5, 50\], expected \[5, 100\]")
    motion.write_bytes(b"PK nothing")
    refused("not an .npz of numbers")
    (root / "wave16k" / "2_scott_0_2_2.wav").write_bytes(b"RIFF")
    np.savez(motion, poses=np.zeros((5, 165)), trans=np.zeros((5, 3)), expressions=np.zeros((5, 100)))
    refused("cannot read audio")


def test_wrong_folders_and_lists_are_refused(root, tmp_path):
    for found, says in ((root / "textgrid", "smplxflame_30"), (tmp_path / "gone", "no such folder")):
        with pytest.raises(DataError, match=says):
            beat2(found, "train")
    with pytest.raises(DataError, match="no clip of the split `train` of speakers 5"):
        beat2(root, "train", {5})
    with pytest.raises(DataError, match="no split `dev`"):
        beat2(root, "dev")
    (root / "train_test_split.csv").write_text("name,split\na,train\n")
    with pytest.raises(DataError, match="expected columns id and type, got name, split"):
        beat2(root, "train")
