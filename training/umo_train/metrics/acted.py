"""Whether the action that a text asked for can be recognised from the motion."""

import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from umo_train.data import corpus
from umo_train.metrics import program
from umo_train.metrics.diversity import statistics
from umo_train.metrics.item import Motion

# Prefix of the styles of action items.
PREFIX = "action "


def known(folder: Path, split: str) -> Iterator[tuple[str, Motion]]:
    """Actions of a split of the corpus with their motion."""
    for entry in corpus.entries(folder, split):
        if entry.style.startswith(PREFIX):
            yield entry.style.removeprefix(PREFIX), corpus.read_motion(folder, entry.name)


class Judge:
    """Linear discriminants over 5 s windows of the body; the windows of one motion vote together. Faces are left out:
    an action is defined by the body."""

    def __init__(self, motions: Sequence[tuple[str, Motion]]) -> None:
        from sklearn.discriminant_analysis import LinearDiscriminantAnalysis

        rows = [statistics(motion, face=False) for _, motion in motions]
        labels = np.repeat([name for name, _ in motions], [len(row) for row in rows])
        if len(set(labels)) < 2:
            raise ValueError("telling actions apart needs two of them at least")
        self.model = LinearDiscriminantAnalysis(solver="lsqr", shrinkage="auto").fit(np.concatenate(rows), labels)

    def name(self, motion: Motion) -> str:
        said = self.model.predict_log_proba(statistics(motion, face=False)).clip(min=-50.0).sum(0)
        return str(self.model.classes_[said.argmax()])

    def share(self, motions: Sequence[tuple[str, Motion]]) -> float:
        """Share of motions classified as their name."""
        return float(np.mean([self.name(motion) == name for name, motion in motions]))


def from_text(
    umo: Path, prompt: str, seconds: float, model: Path | None, seed: int, more: tuple[str, ...] = ()
) -> Motion:
    """The program's motion for a text alone; `more` are further arguments."""
    with tempfile.TemporaryDirectory(prefix="umo-") as folder:
        made = Path(folder, "motion.npz")
        options = ["--model", model] if model else []
        program.run(umo, "text", prompt, "--seconds", seconds, "--seed", seed, "-o", made, *options, *more)
        return program.from_npz(made)


def measure(
    umo: Path, model: Path | None, folder: Path, seeds: int, seconds: float = 10.0, more: tuple[str, ...] = ()
) -> dict[str, Any]:
    """Share of motions from text that are recognised as the requested action, with the first of an action's prompts,
    per action and overall; and the share of held-out performances. Empty if the corpus has no actions."""
    learned = list(known(folder, "train"))
    if not learned:
        return {}
    judge = Judge(learned)
    prompts = {
        entry.style.removeprefix(PREFIX): entry.prompt.split("\n")[0]
        for entry in corpus.entries(folder, "train")
        if entry.style.startswith(PREFIX)
    }
    told = {
        name: judge.share([(name, from_text(umo, prompt, seconds, model, seed, more)) for seed in range(seeds)])
        for name, prompt in prompts.items()
    }
    held = list(known(folder, "test_action"))
    return {
        "model": float(np.mean(list(told.values()))),
        "performer": judge.share(held) if held else None,
        "seeds": seeds,
        "each": told,
    }
