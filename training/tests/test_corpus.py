"""The corpus: held-out data is never trained on, and every item follows from the plan alone."""

import random
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from types import TracebackType

import numpy as np
import pytest

from test_performer_speech import SENTENCES, speech
from umo_train.__main__ import main
from umo_train.data import corpus
from umo_train.performer import actions
from umo_train.performer.style import PROMPTS
from umo_train.shard import Shard
from umo_train.speech import voices
from umo_train.speech.utterance import Phone, Utterance

PLAN = corpus.SpeechPlan(
    hours=20 * 6 / 3600, voices={"a": 1, "b": 3}, held_out=("c",), test_minutes=0.5, seconds_per_item=6
)


class _Voice:
    """Returns the same audio for any text; the text is the requested one."""

    def __init__(self, name: str) -> None:
        self.name = name

    def speak(self, lines: Sequence[voices.Line]) -> Iterator[Utterance]:
        for line in lines:
            made = speech(SENTENCES[:1], pause=0.1, voice=self.name)
            yield Utterance(self.name, line.text, made.samples, made.phones, made.words)


class _Inline:
    """Runs in this process instead of many."""

    def __init__(self, _workers: int) -> None:
        self.map = lambda call, jobs, chunksize: map(call, jobs)

    def __enter__(self) -> "_Inline":
        return self

    def __exit__(self, _type: type | None, _error: Exception | None, _trace: TracebackType | None) -> None:
        pass


@pytest.fixture
def made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(voices, "find", _Voice)
    monkeypatch.setattr(corpus, "ProcessPoolExecutor", _Inline)
    corpus.make_speech(PLAN, tmp_path, 1)
    return tmp_path


def test_what_is_held_out_is_never_trained_on(made: Path) -> None:
    splits = {split: list(corpus.items(made, split)) for split in ("train", "test_sentence", "test_voice")}
    assert [len(items) for items in splits.values()] == [20, 5, 5]
    assert sum(map(len, splits.values())) == len(list(corpus.items(made)))
    assert {item.utterance.voice for item in splits["train"]} == {"a", "b"}
    assert {item.utterance.voice for item in splits["test_sentence"]} <= {"a", "b"}
    assert {item.utterance.voice for item in splits["test_voice"]} == {"c"}
    texts = [item.utterance.text for items in splits.values() for item in items]
    assert len(set(texts)) == len(texts)
    seeds = [item.seed for items in splits.values() for item in items]
    assert len(set(seeds)) == len(seeds)


def test_splits_draw_from_seeds_of_their_own(made: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Even at the same position in the corpus."""
    seeds: list[str] = []

    class Noted(random.Random):
        def __init__(self, seed: str) -> None:
            seeds.append(seed)
            super().__init__(seed)

    monkeypatch.setattr(corpus.random, "Random", Noted)
    texts = []
    for split in ("train", "test_sentence", "test_voice"):
        folder = made / split
        corpus._speak_item((PLAN, folder, split, 3, "a"))
        texts.append(corpus.read_item(folder / "speech" / "00003.npz").utterance.text)
    assert len(set(seeds)) == 3 and len(set(texts)) == 3


def test_an_item_follows_from_the_plan_whatever_was_there(made: Path) -> None:
    path = made / "speech" / "00007.npz"
    before, untouched = corpus.read_item(path), (made / "speech" / "00006.npz").stat().st_mtime_ns
    path.unlink()
    corpus.make_speech(PLAN, made, 1)
    after = corpus.read_item(path)
    assert np.array_equal(before.utterance.samples, after.utterance.samples)
    assert (before.style, before.prompt, before.utterance.text, before.utterance.phones) == (
        after.style,
        after.prompt,
        after.utterance.text,
        after.utterance.phones,
    )
    assert (made / "speech" / "00006.npz").stat().st_mtime_ns == untouched


def test_shares_of_several_machines_are_the_whole(made: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    spoken: list[int] = []
    monkeypatch.setattr(corpus, "_speak_item", lambda job: spoken.append(job[3]))
    folder, shares = made / "shared", []
    for number in (1, 2, 3):
        spoken.clear()
        corpus.make_speech(PLAN, folder, 1, Shard(number, 3))
        shares.append(spoken.copy())
    spoken.clear()
    corpus.make_speech(PLAN, folder, 1)
    assert all(shares) and sorted(index for share in shares for index in share) == spoken
    moved: list[str] = []
    monkeypatch.setattr(corpus, "_perform_item", lambda job: moved.append(job[1].name))
    for number in (1, 2):
        corpus.make_motion(made, 1, Shard(number, 2))
    assert sorted(moved) == [path.name for path in corpus.paths(made, "speech")]


@pytest.mark.parametrize("text", ["", "3", "0/2", "3/2", "1/0", "a/b", "-1/2", "1/2/3", "1.5/2"])
def test_what_is_no_share_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="NUMBER/COUNT"):
        Shard.parse(text)


def test_steps_that_need_every_item_take_no_share(capsys: pytest.CaptureFixture) -> None:
    for steps in ([], ["audio"], ["speech", "lm"]):
        with pytest.raises(SystemExit):
            main(["--config", "plan.yaml", "--work", "w", "--shard", "1/2", *steps])
        assert "--shard" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["--config", "plan.yaml", "--work", "w", "--shard", "3/2", "speech"])
    assert "NUMBER from 1 to COUNT" in capsys.readouterr().err


def test_items_are_whole(made: Path) -> None:
    for item in corpus.items(made):
        assert item.prompt in PROMPTS[item.style]
        phones = item.utterance.phones
        assert phones[0].start == 0 and phones[-1].end == pytest.approx(item.utterance.seconds, abs=2e-3)
        assert all(a.end == pytest.approx(b.start) for a, b in pairwise(phones))
        assert 0.01 < np.sqrt(np.mean(item.utterance.samples**2)) < 0.2
    assert corpus.hours(made) == pytest.approx(sum(i.utterance.seconds for i in corpus.items(made)) / 3600)


def test_motion_has_the_frames_of_its_speech(made: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for path in sorted((made / "speech").glob("*.npz"))[2:]:
        path.unlink()
    corpus.make_motion(made, 1)
    for item in corpus.items(made):
        motion = corpus.read_motion(made, item.name)
        assert {len(values) for values in motion.values()} == {item.utterance.frames}
        assert list(corpus.read_motion(made, item.name, ("upper",))) == ["upper"]


def test_actions_are_items_of_silence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    still = np.tile(np.eye(3), (30, 55, 1, 1))
    clips = {name: still for action in actions.ACTIONS.values() for name in action.clips}
    monkeypatch.setattr(actions, "read_clips", lambda files: clips)
    plan = corpus.ActionPlan((tmp_path / "clips.glb",), takes=10, seconds_per_item=4.0)
    for index in (corpus.FIRST_ACTION, corpus.FIRST_ACTION + 9):
        corpus._act_item((plan, tmp_path, index, "bow", index - corpus.FIRST_ACTION))
    first, last = corpus.items(tmp_path)
    assert (first.split, last.split) == ("train", "test_action")
    assert first.prompt.split("\n") == list(actions.ACTIONS["bow"].prompts)
    assert not first.utterance.samples.any()
    assert len(corpus.read_intent(tmp_path, first.name)) == first.utterance.frames
    # The performer leaves them unchanged.
    before = (tmp_path / "motion" / f"{first.name}.npz").stat().st_mtime_ns
    corpus.make_motion(tmp_path, 1)
    assert (tmp_path / "motion" / f"{first.name}.npz").stat().st_mtime_ns == before


def test_accents_are_heard_in_runs_of_units(tmp_path: Path) -> None:
    units = np.zeros((2, 120), np.int16)
    units[0, 30:36] = 600
    # Too short, and another recording's.
    units[0, 60:63] = 512
    units[1, 80:90] = 700
    np.save(tmp_path / "00001.npy", units)
    heard = corpus.HeardAccents(tmp_path, first=512, delay=14, rate=50)
    np.testing.assert_allclose(heard.of("00001"), [(33 - 14) / 50])


def test_held_out_items_keep_their_true_accents_and_seeds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = {}

    def perform(utterance: Utterance, style: object, seed: int, accents: np.ndarray | None) -> dict[str, np.ndarray]:
        asked[utterance.text] = accents, seed
        return {"upper": np.zeros((3, 1)), "intent": np.zeros(3, np.int16)}

    monkeypatch.setattr("umo_train.performer.perform", perform)
    (tmp_path / "motion").mkdir()
    np.save(tmp_path / "00001.npy", np.full((1, 50), 600, np.int16))
    heard = corpus.HeardAccents(tmp_path, first=512, delay=14, rate=50)
    for name, split in (("00001", "train"), ("00002", "test_voice")):
        spoken = Utterance("v", split, np.zeros(16000, np.float32), (Phone("pau", 0.0, 1.0),))
        corpus.write_item(tmp_path, corpus.Item(name, split, "neutral", "", 1, spoken))
        corpus._perform_item((tmp_path, tmp_path / "speech" / f"{name}.npz", heard, 100))
    accents, seed = asked["train"]
    assert accents.tolist() == [pytest.approx((25 - 14) / 50)] and seed == 101
    assert asked["test_voice"] == (None, 1)
