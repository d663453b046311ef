from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.io import wavfile

from metrics_motion import still, turned
from umo_train.metrics import mismatch, mismatch_report, takes, words
from umo_train.metrics.item import Word
from umo_train.skeleton import JOINT
from umo_train.speech.utterance import SAMPLE_RATE

FRAMES, NAMES = 150, ("no", "yes", "then", "and")
OPTIONS = mismatch.Options(seconds=1.0, edge=0.5, folds=2, steps=2, jobs=1)


def talker(seed: int, *, means: bool) -> takes.Take:
    """A word twice a second; the left arm rises at "no" and the right one at "yes", or each at random."""
    rng = np.random.default_rng(seed)
    said = [NAMES[i] for i in rng.integers(len(NAMES), size=10)]
    moved = said if means else [NAMES[i] for i in rng.integers(len(NAMES), size=10)]
    motion = still(FRAMES)
    for name, joint in (("no", "left_shoulder"), ("yes", "right_shoulder")):
        at = np.array([15 * i + 7 for i, word in enumerate(moved) if word == name])
        rise = np.exp(-(((np.arange(FRAMES)[:, None] - at) / 3.0) ** 2)).sum(1)
        motion = turned(motion, JOINT[joint], 0.5 * rise)
    samples = (0.1 * rng.normal(size=FRAMES * SAMPLE_RATE // 30)).astype(np.float32)
    spoken = [Word(f"{word.title()},", 0.5 * i, 0.5 * i + 0.5) for i, word in enumerate(said)]
    return replace(takes.of_motion(f"take{seed}", "one", samples, motion), words=spoken)


@pytest.mark.parametrize(("means", "low", "high"), [(True, 0.8, 1.0), (False, 0.3, 0.7)])
def test_words_are_found_if_the_motion_means_them(monkeypatch, means, low, high):
    monkeypatch.setattr(words, "STEPS", 80)
    monkeypatch.setattr(words, "BATCH", 16)
    monkeypatch.setattr(words, "CLIP_S", 2.0)
    of = [talker(seed, means=means) for seed in range(20)]
    found = mismatch_report.finds(mismatch.tried(of, OPTIONS), 0)
    assert found["clips"] == 20 * 2 and found["words"].count == 20
    assert low < found["words"].value <= high
    assert "Right words found" in mismatch_report.text({"one": found})


def test_a_clips_words_are_spread_over_its_voice_and_written(tmp_path: Path):
    samples = np.zeros(3 * SAMPLE_RATE, np.float32)
    samples[SAMPLE_RATE : 2 * SAMPLE_RATE] = 0.1 * np.random.default_rng(0).normal(size=SAMPLE_RATE)
    no, table = words.spread("No, table.", samples)
    assert (no.name, table.name) == ("no", "table")
    assert no.start == pytest.approx(1.0, abs=0.1) and table.end == pytest.approx(2.0, abs=0.1)
    assert no.end == table.start == pytest.approx(4 / 3, abs=0.1)
    words.write(tmp_path / "one.ctm", [no, table])
    assert [line.split()[-1] for line in (tmp_path / "one.ctm").read_text().splitlines()] == ["No,", "table."]


def test_clips_with_text_are_joined_with_their_words(tmp_path: Path):
    noise = (0.1 * np.random.default_rng(0).normal(size=2 * SAMPLE_RATE)).astype(np.float32)
    for name in "abcd":
        wavfile.write(tmp_path / f"{name}.wav", SAMPLE_RATE, noise)
    (tmp_path / "text.csv").write_text("a|First, one.\nb|Second.\nc|Second.\n")
    (one,) = takes.joined([], [tmp_path], 4.0, 1.0)
    assert one.seconds == 4.0 and [word.name for word in one.words] == ["first", "one", "second"]
    assert 2.0 <= one.words[2].start < one.words[2].end <= 4.0
