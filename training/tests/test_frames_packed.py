"""The packed file: examples from it equal those from the corpus."""

from pathlib import Path

import numpy as np

from frames_data import BODY, CONFIG, PARTS, SLOTS
from test_frames_examples import SILENCE, _stream
from umo_train.frames import packed
from umo_train.frames.examples import FrameExamples, FrameStream


def test_examples_of_a_packed_file_are_those_of_the_corpus(tmp_path: Path) -> None:
    text_alone = FrameStream(np.full((30, SLOTS), -1), None, (np.array([5, 6]),), True, 8.0, (2, 7), True)
    audio_alone = FrameStream(None, np.arange(60).reshape(2, 30) % 20)
    streams = [_stream(), text_alone, audio_alone, _stream(51)]
    splits = {"train": streams, "test_voice": [_stream(42, prompts=False)]}
    path = tmp_path / packed.NAME
    packed.write(path, packed.Packed(CONFIG, SILENCE, 4, BODY, splits))
    found = packed.read(path)
    assert (found.config, found.silence, found.delay, found.body) == (CONFIG, SILENCE, 4, BODY)
    assert [stream.person for stream in found.splits["train"]] == [False, True, False, False]
    for split, given in splits.items():
        for task in ("a2m", "t2m") if split == "train" else ("a2m",):
            ours = found.examples(PARTS, split, augment=True)
            theirs = FrameExamples(CONFIG, PARTS, BODY, given, SILENCE, augment=True, delay=4)
            a, b = (x.chunk(12, 2, np.random.default_rng(7), task=task) for x in (ours, theirs))
            for name in ("ids", "history", "codes", "before"):
                assert np.array_equal(getattr(a, name), getattr(b, name)), (split, task, name)
