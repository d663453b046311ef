"""A run's plan: the YAML file's content, and where the run's files are."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from umo_train.shard import ALL, Shard

Config = dict[str, Any]
# Paths in a plan, of files and folders that others publish; they are below the work folder where they are relative.
_PATHS = (("audio", "hubert"), ("audio", "kmeans"), ("text", "model"), ("lm", "init"), ("tokenizers", "weights"))


@dataclass
class Run:
    """A plan, the folder that it is in, the corpus' folder and the folder of everything made from it. Training ends
    with a checkpoint at the moment `until` of `time.monotonic`, where there is one; of the items that are made only
    those of `shard` are."""

    plan: Config
    plans: Path
    corpus: Path
    folder: Path
    until: float | None = None
    shard: Shard = ALL

    @staticmethod
    def read(config: Path, work: Path, *, smoke: bool = False) -> "Run":
        """A plan with `base` is laid over the one in that file beside it, which may have one too."""
        plan = yaml.safe_load(config.read_text())
        while base := plan.pop("base", None):
            plan = merged(yaml.safe_load((config.parent / base).read_text()), plan)
        smallest = plan.pop("smoke", "smoke.yaml")
        if smoke:
            plan = merged(plan, yaml.safe_load((config.parent / smallest).read_text()))
        for section, key in _PATHS:
            value = plan.get(section, {}).get(key)
            if value:
                below = [str(work / one) for one in value] if isinstance(value, list) else str(work / value)
                plan[section][key] = below
        return Run(plan, config.parent, work / "corpus", work / "run")

    @property
    def work(self) -> Path:
        return self.folder.parent

    def text_model(self) -> bytes:
        """The SentencePiece model of prompts and transcripts: others' below the work folder, our own beside plans."""
        if "model" in self.plan.get("text", {}):
            return Path(self.plan["text"]["model"]).read_bytes()
        given = self.plan.get("text_model")
        return (self.plans / given if given else self.work / "text.model").read_bytes()


def merged(base: Config, over: Config) -> Config:
    """`over` laid over `base`; a mapping of it with `replace: true` takes the other's place."""
    out = dict(base)
    for key, value in over.items():
        both = isinstance(value, dict) and isinstance(base.get(key), dict) and not value.pop("replace", False)
        out[key] = merged(base[key], value) if both else value
    return out
