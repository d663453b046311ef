"""Ablations of layout `frames`: a variant learns from the same data as the full model, except what it leaves out."""

from dataclasses import replace

import numpy as np
import pytest

from frames_data import BODY, CONFIG, PARTS, SLOTS, at
from test_frames_examples import SILENCE, _stream
from umo_train.frames import ablations
from umo_train.frames.ablations import VARIANTS, Variant
from umo_train.frames.model import FrameModel
from umo_train.frames.packed import Packed


def _whole() -> Packed:
    codes = np.arange(30)[:, None] * 100 + np.arange(SLOTS)
    person = replace(_stream(), codes=codes, person=True)
    voice_alone = replace(_stream(), codes=None)
    return Packed(CONFIG, SILENCE, 4, BODY, {"train": [person, _stream(), voice_alone], "test_voice": [_stream()]})


@pytest.mark.parametrize("variant", VARIANTS, ids=lambda variant: variant.name)
def test_every_variant_can_be_trained(variant: Variant) -> None:
    data, order = ablations.varied(variant, _whole(), list(PARTS))
    assert [entry["levels"] for entry in data.config["parts"]] == [part.levels for part in order]
    assert [len(entry["rest"]) for entry in data.config["parts"]] == [part.levels for part in order]
    slots = sum(part.levels for part in order)
    assert len(data.body) == len(order) and data.config["lm"]["experts"] == 1
    batch = data.examples(order, "train", augment=True).chunk(4, 2, np.random.default_rng(0))
    assert batch.codes.shape == (4, 2, slots) and batch.history.shape[-1] == slots
    FrameModel(data.config, order)


def test_parts_levels_and_people_are_left_out() -> None:
    whole = _whole()
    data, order = ablations.varied(Variant("x", without=("hands",), levels=2), whole, list(PARTS))
    kept = [slot for part in PARTS if part.name != "hands" for slot in range(at(part.name).start, at(part.name).stop)]
    kept = [slot for slot in kept if all(slot < at(p.name).start or slot >= at(p.name).stop or
                                         slot - at(p.name).start < 2 for p in PARTS)]  # fmt: skip
    assert data.splits["train"][0].codes.tolist() == whole.splits["train"][0].codes[:, kept].tolist()
    assert [part.name for part in order] == [part.name for part in PARTS if part.name != "hands"]
    assert data.splits["train"][2].codes is None
    without, _ = ablations.varied(Variant("x", people=False), whole, list(PARTS))
    assert [stream.person for stream in without.splits["train"]] == [False, False]


def test_the_table_has_a_row_of_each_and_a_dash_for_what_is_not_said() -> None:
    row = {"parameters": 14.0, "codes": 30, "mouth": 0.5, "left_arm": 0.6, "right_arm": 0.5, "lips": 0.9,
           "closures": 0.91, "beat": 1.2, "fgd": 0.3, "jerk": 100.0}  # fmt: skip
    text = ablations.table({"no intent": row, "all of it": row | {"intent": 0.75}})
    assert "| no intent | 14.0 M | 30 | 50 % | – | 55 % |" in text and "| 75 % |" in text
