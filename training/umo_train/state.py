"""Checkpoints: everything that a stage needs to go on, in one file that is whole or absent."""

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import torch


class Chance:
    """Where a stage's draws stand: those of its own generator and those of PyTorch's global one."""

    def __init__(self, generator: np.random.Generator) -> None:
        self.generator = generator

    def state_dict(self) -> dict[str, Any]:
        return {"numpy": json.dumps(self.generator.bit_generator.state), "torch": torch.get_rng_state()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        self.generator.bit_generator.state = json.loads(state["numpy"])
        torch.set_rng_state(state["torch"])


class Saved:
    """The state of named objects that have `state_dict`, and the number of steps done."""

    def __init__(self, path: Path, **objects: Any) -> None:
        self.path, self.objects = path, objects

    def load(self) -> int:
        """Steps done; 0 where there is no checkpoint."""
        if not self.path.exists():
            return 0
        data = torch.load(self.path, map_location="cpu", weights_only=True)
        for name, target in self.objects.items():
            # Early checkpoints have no draws: their stages go on with fresh ones.
            if name in data or not isinstance(target, Chance):
                target.load_state_dict(data[name])
        return int(data["step"])

    def save(self, step: int) -> None:
        data = {name: target.state_dict() for name, target in self.objects.items()}
        self.path.parent.mkdir(parents=True, exist_ok=True)
        part = self.path.with_suffix(".part")
        torch.save(data | {"step": step}, part)
        os.replace(part, self.path)
