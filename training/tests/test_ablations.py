"""The changes of the ablation table's variants, and that they change nothing else."""

import numpy as np
import pytest
import torch

from umo_train import ablations
from umo_train.lm.examples import Examples, Stream
from umo_train.plan import merged

FRAMES = 90


def _examples(kind: type[Examples]) -> Examples:
    vocab: dict = {"size": 200, "eos": 1, "decoder_start": 0, "audio": {"start": 2, "end": 3, "first": 100}}
    for i, part in enumerate(("face", "hands", "upper", "lower")):
        vocab[part] = {"start": 4 + 2 * i, "end": 5 + 2 * i, "first": 20 + 16 * i, "codes": 16, "mask": 99}
    template = ["audio", "face", "hands", "upper", "lower", 1]
    config = {
        "keyframe_stride": 3,
        "prefix": 4,
        "frame_rate": 30,
        "audio": {"token_rate": 50},
        "vocab": vocab,
        "rest": {"face": 0, "hands": 0, "upper": 0, "lower": 0},
        "templates": {"audio_to_motion": template, "audio_to_motion_with_text": ["text", *template]},
    }
    codes = (np.arange(4)[:, None] + np.arange(FRAMES)) % 16
    units = np.arange(FRAMES * 50 // 30)[None] % 60
    stream = Stream(codes, units, np.zeros(0, int), np.zeros(0, int))
    return kind(config, [stream], 0, augment=False, delay=4)


def test_without_keyframes_every_frame_is_said_after_the_same_history() -> None:
    plain, every = (_examples(kind).chunk(3, 5, np.random.default_rng(7)) for kind in (Examples, ablations.EveryFrame))
    assert np.array_equal(plain.ids, every.ids)
    assert plain.labels.shape == (3, 4 * 7) and every.labels.shape == (3, 4 * 17)
    for part in range(4):
        keys = plain.labels[:, part * 7 + 1 : part * 7 + 6]
        frames = every.labels[:, part * 17 + 1 : part * 17 + 16]
        assert np.array_equal(frames[:, ::3], keys)
        first = 20 + 16 * part
        assert ((frames[:, 1:] - frames[:, :-1]) % 16 == 1).all() and (frames >= first).all()


def test_every_frame_is_heard_in_order_within_the_window() -> None:
    every, plain = _examples(ablations.EveryFrame), _examples(Examples)
    at = every.heard_at(5)
    assert np.array_equal(at[::3], plain.heard_at(5))
    # Audio after the window is replaced with that at its end.
    assert (np.diff(at[:-2]) > 0).all() and (np.diff(at) >= 0).all() and at[-1] == (4 + 5) * 5 - 1


def test_the_end_of_an_item_asks_nothing() -> None:
    every = _examples(ablations.EveryFrame)
    said = every.said(every.streams[0], FRAMES // 3 - 2, 5)
    assert (said[:, :6] >= 0).all() and (said[:, 6:] == -1).all()


def test_codes_are_drawn_as_the_file_says() -> None:
    config = {"sampling": {"temperature": 1.0, "top_k": 2, "top_p": 1.0}}
    torch.manual_seed(0)
    logits = torch.tensor([[0.0, 1.0, 1.0, -1.0]]).repeat(400, 1)
    drawn = ablations._drawn(logits, config, {}, "face")
    assert set(drawn.tolist()) == {1, 2}
    logits = torch.tensor([[0.0, 0.5, 1.0]]).repeat(50, 1)
    assert (ablations._drawn(logits, config, {"sharpen": {"face": 100.0}}, "face") == 2).all()


def test_variants_change_the_plan_alone_where_they_say() -> None:
    plan = {"lm": {"experts": 4, "d_model": 8}, "stages": []}
    for variant in ablations.VARIANTS:
        changed = merged(plan, variant.over)
        assert (changed == plan) == (variant.name != "no experts")


def test_a_row_that_is_not_measured_says_so() -> None:
    row = {"parameters": 1.0, "ids": 56.0, "lips": 0.5, "closures": 0.5, "fgd": 1.0, "beat": 1.0, "jerk": 10.0}
    text = ablations.table({"a": row | {"loss": None}, "b": row | {"loss": 1.25}})
    a, b = text.splitlines()[2:]
    assert "| – |" in a and "| 1.250 |" in b and a.count("|") == b.count("|")


def test_an_unfinished_run_is_named(tmp_path) -> None:
    from umo_train.plan import Run

    with pytest.raises(FileNotFoundError, match=r"audio\.safetensors"):
        ablations.prepare(Run({}, tmp_path, tmp_path, tmp_path), ablations.VARIANTS[0])
