"""Examples of every task: synthetic streams whose codes identify their frame, and units their token."""

from itertools import pairwise

import numpy as np
import pytest

from layout import vocabulary
from umo_train.lm.examples import Batch, Examples, Stream
from umo_train.skeleton import PARTS

FRAMES, STRIDE, PREFIX, TOKENS = 60, 3, 4, 5
KEYS = FRAMES // STRIDE
SILENCE = 499
AUDIO_TASK, MOTION_TASK, TEXT_TASK, TEXT_END, END = 8, 9, 10, 11, 1
CONFIG = {
    "vocab": vocabulary(100, 500),
    "rest": dict(zip(PARTS, (250, 251, 252, 253), strict=True)),
    "keyframe_stride": STRIDE,
    "prefix": PREFIX,
    "frame_rate": 30,
    "audio": {"token_rate": 50},
    "templates": {
        "audio_to_motion": [AUDIO_TASK, "audio", MOTION_TASK, *PARTS, END],
        "audio_to_motion_with_text": [AUDIO_TASK, "audio", MOTION_TASK, TEXT_TASK, "text", TEXT_END, *PARTS, END],
        "text_to_motion": [TEXT_TASK, "text", TEXT_END, *PARTS, END],
    },
}
VOCAB = CONFIG["vocab"]
REST = np.array(list(CONFIG["rest"].values()))
TEXT, PROMPT = np.array([21, 22, 23, 24]), np.array([31, 32])


def _stream(frames: int = FRAMES, prompt: np.ndarray = PROMPT) -> Stream:
    """Part p's code of frame f is f + 60 p; token j's unit is j."""
    codes = np.arange(frames)[None] + 60 * np.arange(4)[:, None]
    tokens = frames * TOKENS // STRIDE
    return Stream(codes.astype(np.int16), np.stack([np.arange(tokens)] * 2).astype(np.int16), TEXT, prompt)


def _examples(*streams: Stream, augment: bool = False) -> Examples:
    return Examples(CONFIG, list(streams) or [_stream()], SILENCE, augment=augment)


def _between(ids: np.ndarray, name: str) -> np.ndarray:
    """Codes between a modality's markers; -1 if masked."""
    ids = list(ids)
    first, last = ids.index(VOCAB[name]["start"]), ids.index(VOCAB[name]["end"])
    inside = np.array(ids[first + 1 : last])
    return np.where(inside == VOCAB[name]["mask"], -1, inside - VOCAB[name]["first"])


def _labels(labels: np.ndarray, part: str) -> np.ndarray:
    """A part's codes among labels, -100 for positions without a target."""
    first, last = list(labels).index(VOCAB[part]["start"]), list(labels).index(VOCAB[part]["end"])
    inside = labels[first + 1 : last]
    return np.where(inside == -100, -100, inside - VOCAB[part]["first"])


def _markers(row: np.ndarray) -> list[int]:
    """Task marks and start markers in order."""
    kinds = {VOCAB[name]["start"] for name in (*PARTS, "audio")} | {AUDIO_TASK, MOTION_TASK, TEXT_TASK, TEXT_END, END}
    return [int(i) for i in row if i in kinds]


STARTS = [VOCAB[part]["start"] for part in PARTS]


def _check_chunk(batch: Batch, target: int) -> list[int]:
    """History, audio and labels of each example belong together; returns their starts."""
    begins = []
    for ids, labels in zip(batch.ids, batch.labels, strict=True):
        frame = int(_labels(labels, "face")[0])
        at = frame // STRIDE
        assert frame % STRIDE == 0
        begins.append(at)
        for p, part in enumerate(PARTS):
            asked = (at + np.arange(target)) * STRIDE
            expected = np.where(asked < FRAMES, asked + 60 * p, -100)
            assert (_labels(labels, part) == expected).all()
            before = (at - PREFIX + np.arange(PREFIX)) * STRIDE
            assert (_between(ids, part) == np.where(before < 0, REST[p], before + 60 * p)).all()
        heard = (at - PREFIX) * TOKENS + np.arange((PREFIX + target) * TOKENS)
        inside = (heard >= 0) & (heard < FRAMES * TOKENS // STRIDE)
        assert (_between(ids, "audio") == np.where(inside, heard, SILENCE)).all()
    return begins


@pytest.mark.parametrize("target", [1, 3, 7])
def test_chunks_hear_and_remember_what_belongs_to_them(target: int) -> None:
    batch = _examples().chunk(200, target, np.random.default_rng(0))
    assert batch.mask is None
    # Markers and codes; task marks and the end.
    assert batch.ids.shape == (200, 3 + (PREFIX + target) * TOKENS + 2 + 4 * (PREFIX + 2))
    assert batch.labels.shape == (200, 4 * (target + 2))
    begins = _check_chunk(batch, target)
    # They include the beginning, with its history of rest codes and silence, and the end.
    assert min(begins) == 0 and max(begins) == KEYS - target - 1
    for ids, labels in zip(batch.ids, batch.labels, strict=True):
        assert _markers(ids) == [AUDIO_TASK, VOCAB["audio"]["start"], MOTION_TASK, *STARTS, END]
        assert _markers(labels) == STARTS


def test_history_at_the_start_is_rest_and_silence() -> None:
    short = _examples(_stream(frames=STRIDE))
    batch = short.chunk(1, 1, np.random.default_rng(0))
    for p, part in enumerate(PARTS):
        assert (_between(batch.ids[0], part) == REST[p]).all()
    assert _between(batch.ids[0], "audio").tolist() == [SILENCE] * PREFIX * TOKENS + [0, 1, 2, 3, 4]


def test_nothing_is_asked_beyond_the_end() -> None:
    batch = _examples(_stream(frames=2 * STRIDE)).chunk(3, 5, np.random.default_rng(0))
    for labels in batch.labels:
        for p, part in enumerate(PARTS):
            assert _labels(labels, part).tolist() == [60 * p, 60 * p + STRIDE, -100, -100, -100]


def test_prompts_stand_in_their_place_and_are_padded() -> None:
    longer = np.array([41, 42, 43, 44, 45])
    examples = _examples(_stream(), _stream(prompt=longer))
    batch = examples.chunk(40, 2, np.random.default_rng(1), text=True)
    lengths = set()
    for ids, kept in zip(batch.ids, batch.mask, strict=True):
        ids, padding = ids[kept], ids[~kept]
        assert (padding == VOCAB["pad"]).all() and kept[: len(ids)].all()
        first, last = list(ids).index(TEXT_TASK), list(ids).index(TEXT_END)
        assert list(ids[first + 1 : last]) in ([31, 32], longer.tolist())
        assert _markers(ids) == [AUDIO_TASK, VOCAB["audio"]["start"], MOTION_TASK, TEXT_TASK, TEXT_END, *STARTS, END]
        lengths.add(len(ids))
    assert len(lengths) == 2
    _check_chunk(Batch(batch.ids, None, batch.labels), 2)


def test_a_part_is_asked_for_with_the_others_given() -> None:
    target, wanted = 3, set()
    for seed in range(20):
        batch = _examples().part_level(5, target, np.random.default_rng(seed))
        assert batch.labels.shape == (5, target + 2)
        for ids, labels in zip(batch.ids, batch.labels, strict=True):
            (part,) = [name for name in PARTS if VOCAB[name]["start"] == labels[0]]
            wanted.add(part)
            own = PARTS.index(part)
            at = (int(_labels(labels, part)[0]) - 60 * own) // STRIDE
            assert (_labels(labels, part) == (at + np.arange(target)) * STRIDE + 60 * own).all()
            for p, name in enumerate(PARTS):
                length = PREFIX if p == own else PREFIX + target
                frames = (at - PREFIX + np.arange(length)) * STRIDE
                assert (_between(ids, name) == np.where(frames < 0, REST[p], frames + 60 * p)).all()
            heard = (at - PREFIX) * TOKENS + np.arange((PREFIX + target) * TOKENS)
            assert (_between(ids, "audio") == np.where(heard < 0, SILENCE, heard)).all()
    assert wanted == set(PARTS)


def test_dense_windows_ask_every_frame() -> None:
    frames = 15
    batch = _examples().dense(60, frames, np.random.default_rng(2), source="audio")
    assert batch.labels.shape == (60, 4 * (frames + 2))
    for ids, labels in zip(batch.ids, batch.labels, strict=True):
        at = int(_labels(labels, "face")[0])
        assert at % STRIDE == 0
        for p, part in enumerate(PARTS):
            assert (_labels(labels, part) == at + np.arange(frames) + 60 * p).all()
            before = at - PREFIX + np.arange(PREFIX)
            assert (_between(ids, part) == np.where(before < 0, REST[p], before + 60 * p)).all()
        heard = at * TOKENS // STRIDE + np.arange(frames * TOKENS // STRIDE)
        assert (_between(ids, "audio") == heard).all()


def test_dense_windows_from_text_hear_nothing() -> None:
    batch = _examples().dense(4, 15, np.random.default_rng(2), source="text")
    for ids in batch.ids:
        assert ids[:4].tolist() == [TEXT_TASK, *PROMPT, TEXT_END]
        assert _markers(ids) == [TEXT_TASK, TEXT_END, *STARTS, END]


def test_motion_modelling_hides_keyframes_and_asks_all() -> None:
    batch = _examples().motion(100, 6, np.random.default_rng(3))
    hidden = []
    for ids, labels in zip(batch.ids, batch.labels, strict=True):
        for part in PARTS:
            asked, seen = _labels(labels, part), _between(ids, part)
            assert ((seen == asked) | (seen == -1)).all() and (asked >= 0).all()
            hidden.append((seen == -1).mean())
    assert 0.4 < np.mean(hidden) < 0.6


def test_speech_to_text_and_back() -> None:
    examples = _examples()
    to_text = examples.speech(2, 1.0, np.random.default_rng(0), to="text")
    to_audio = examples.speech(2, 1.0, np.random.default_rng(0), to="audio")
    # One second of two: half of the text.
    assert to_text.labels.tolist() == [[21, 22, VOCAB["eos"]]] * 2 == to_audio.ids.tolist()
    for ids, labels in zip(to_text.ids, to_audio.labels, strict=True):
        assert (_between(ids, "audio") == np.arange(50)).all() and ids[-1] == VOCAB["eos"]
        assert (_between(labels, "audio") == np.arange(50)).all()


def test_augmented_histories_are_cut_replaced_or_hidden() -> None:
    batch = _examples(augment=True).chunk(800, 2, np.random.default_rng(4))
    hidden = replaced = cut = 0
    for ids, labels in zip(batch.ids, batch.labels, strict=True):
        at = int(_labels(labels, "face")[0]) // STRIDE
        history = np.stack([_between(ids, part) for part in PARTS])
        audio = _between(ids, "audio")
        frames = (at - PREFIX + np.arange(PREFIX)) * STRIDE
        true = np.where(frames < 0, REST[:, None], frames + 60 * np.arange(4)[:, None])
        heard = (at - PREFIX) * TOKENS + np.arange((PREFIX + 2) * TOKENS)
        silent = (audio == SILENCE) & (heard >= 0)
        hidden += bool((history[0] == -1).all())
        cut += bool(silent.any())
        replaced += bool(((history[1:] != true[1:]) & (history[1:] != REST[1:, None])).any())
        # In a cut history, the codes of silence are removed too: silence ends where a keyframe begins.
        assert silent.sum() % TOKENS == 0 and not silent[PREFIX * TOKENS :].any()
        assert (np.where(silent, heard, audio) == np.where(heard < 0, SILENCE, heard)).all()
        # Targets stay unchanged.
        assert _labels(labels, "lower").tolist() == [(at + i) * STRIDE + 180 for i in range(2)]
    rates = np.array([hidden, replaced, cut]) / 800
    assert rates[0] == pytest.approx(Examples.HIDDEN, abs=0.05)
    assert 0.1 < rates[1] < Examples.NOISY and 0.03 < rates[2] <= Examples.SHORT + 0.04


def test_longer_items_are_drawn_more_often() -> None:
    examples = _examples(_stream(frames=15), _stream(frames=60))
    _, chance = examples._pool(("codes", "units"))
    assert chance.tolist() == [0.2, 0.8]


def test_vocabularies_do_not_overlap() -> None:
    """An assumption of these tests: a modality's markers are unique."""
    starts = [VOCAB[name]["first"] for name in (*PARTS, "audio")]
    assert all(a + 259 <= b for a, b in pairwise(starts))
