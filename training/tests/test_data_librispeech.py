import numpy as np
import pytest
import soundfile

from umo_train.data.clip import DataError
from umo_train.data.librispeech import librispeech


@pytest.fixture
def root(tmp_path):
    chapter = tmp_path / "train-clean-100" / "84" / "121123"
    chapter.mkdir(parents=True)
    lines = []
    for number, rate in enumerate((16000, 44100)):
        name = f"84-121123-{number:04}"
        time = np.arange(rate) / rate
        stereo = np.stack([np.sin(2 * np.pi * 300 * time), np.zeros(rate)], 1)
        soundfile.write(chapter / f"{name}.flac", stereo if number else stereo[:, 0], rate)
        lines.append(f"{name} THE NUMBER IS {number}")
    (chapter / "84-121123.trans.txt").write_text("\n".join(lines) + "\n")
    return tmp_path


def test_utterances_have_text_and_samples_at_16_khz(root):
    clips = list(librispeech(root))
    assert [clip.name for clip in clips] == ["84-121123-0000", "84-121123-0001"]
    assert [clip.speech.text for clip in clips] == ["the number is 0", "the number is 1"]
    assert {(clip.speaker, clip.speech.voice) for clip in clips} == {("84", "librispeech_84")}
    assert all(clip.motion is None for clip in clips)
    first, second = (clip.speech.samples for clip in clips)
    assert first.dtype == np.float32 and len(first) == len(second) == 16000
    # Two channels are averaged; the resampled tone stays the same.
    np.testing.assert_allclose(2 * second[2000:-2000], first[2000:-2000], atol=0.01)


def test_what_is_missing_or_odd_is_named(root, tmp_path):
    chapter = root / "train-clean-100" / "84" / "121123"
    (chapter / "84-121123-0001.flac").unlink()
    with pytest.raises(DataError, match="84-121123-0001.flac: there is no such file: 84-121123.trans.txt has its text"):
        list(librispeech(root))
    (chapter / "84-121123.trans.txt").write_text("84-121123-0000\n")
    with pytest.raises(DataError, match="line 1: expected SPEAKER-CHAPTER-NUMBER and a text"):
        list(librispeech(root))
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.raises(DataError, match="no .trans.txt below it: fetch a set of LibriSpeech"):
        librispeech(empty)
