"""Actions are recognised from motion."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from umo_train.data import corpus
from umo_train.metrics import acted
from umo_train.performer import actions
from umo_train.performer.actions import ACTIONS
from umo_train.skeleton import JOINT, JOINTS


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Items of two actions: one raises an arm, the other bends the trunk."""
    out = tmp_path_factory.mktemp("corpus")
    found = {}
    quarter = Rotation.from_euler("z", 80, degrees=True), Rotation.from_euler("x", 60, degrees=True)
    for name, joint, turned in zip(("bow", "press"), ("left_shoulder", "spine1"), quarter, strict=True):
        local = np.tile(np.eye(3), (90, JOINTS, 1, 1))
        local[:, JOINT[joint]] = turned.as_matrix()
        found |= dict.fromkeys(ACTIONS[name].clips, local)
    for name, first in (("bow", 0), ("press", 20)):
        for take in range(6):
            silence, motion = actions.act(ACTIONS[name], found, 10.0, first + take)
            index = corpus.FIRST_ACTION + first + take
            split = "train" if take < 4 else "test_action"
            prompt = "\n".join(ACTIONS[name].prompts)
            corpus.write_item(out, corpus.Item(f"{index}", split, f"action {name}", prompt, 0, silence))
            corpus._write_motion(out / "motion" / f"{index}.npz", motion)
    return out


def test_actions_that_were_not_learned_are_known(folder: Path) -> None:
    judge = acted.Judge(list(acted.known(folder, "train")))
    held = list(acted.known(folder, "test_action"))
    assert [name for name, _ in held] == ["bow", "bow", "press", "press"]
    assert judge.share(held) == 1.0
    assert judge.share([("press", motion) for _, motion in held]) == 0.5


def test_every_action_is_asked_for_by_its_prompt(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    held = dict(acted.known(folder, "test_action"))
    asked = []

    def bows(umo: Path, prompt: str, *rest: object) -> object:
        asked.append(prompt)
        return held["bow"]

    monkeypatch.setattr(acted, "from_text", bows)
    found = acted.measure(Path("umo"), None, folder, 2)
    assert asked == [ACTIONS[name].prompts[0] for name in ("bow", "press") for _ in range(2)]
    assert found["each"] == {"bow": 1.0, "press": 0.0}
    assert (found["model"], found["performer"]) == (0.5, 1.0)


def test_a_corpus_without_actions_says_nothing(tmp_path: Path) -> None:
    (tmp_path / "speech").mkdir()
    assert acted.measure(Path("umo"), None, tmp_path, 2) == {}
