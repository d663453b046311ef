"""A run's plan: the contents of the YAML file, and the paths of the run's files."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from umo_train.shard import ALL, Shard

Config = dict[str, Any]
# Plan entries that are paths of third-party files and folders; relative ones are below the work folder.
_PATHS = (("audio", "hubert"), ("audio", "kmeans"), ("text", "model"), ("lm", "init"), ("tokenizers", "weights"))


@dataclass
class Run:
    """A plan, its folder, the corpus' folder and the folder of everything made from it. Training stops with a
    checkpoint at the time `until` of `time.monotonic`, if set; only items of `shard` are made."""

    plan: Config
    plans: Path
    corpus: Path
    folder: Path
    until: float | None = None
    shard: Shard = ALL

    @staticmethod
    def read(config: Path, work: Path, *, smoke: bool = False) -> "Run":
        """Reads a plan. With `base` it is merged over the plan in that file beside it, recursively."""
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
        """The SentencePiece model of prompts and transcripts: third-party ones below the work folder, our own beside
        the plans.
        """
        if "model" in self.plan.get("text", {}):
            return Path(self.plan["text"]["model"]).read_bytes()
        given = self.plan.get("text_model")
        return (self.plans / given if given else self.work / "text.model").read_bytes()


def merged(base: Config, over: Config) -> Config:
    """`over` merged over `base`; a mapping in it with `replace: true` replaces the other."""
    out = dict(base)
    for key, value in over.items():
        both = isinstance(value, dict) and isinstance(base.get(key), dict) and not value.pop("replace", False)
        out[key] = merged(base[key], value) if both else value
    return out
