"""Checkpoints: everything that a stage needs to continue, in one atomically written file."""

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import torch


class Chance:
    """The random state of a stage: its own generator and PyTorch's global one."""

    def __init__(self, generator: np.random.Generator) -> None:
        self.generator = generator

    def state_dict(self) -> dict[str, Any]:
        return {"numpy": json.dumps(self.generator.bit_generator.state), "torch": torch.get_rng_state()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        self.generator.bit_generator.state = json.loads(state["numpy"])
        torch.set_rng_state(state["torch"])


class Saved:
    """The state of named objects with `state_dict`, and the number of completed steps."""

    def __init__(self, path: Path, **objects: Any) -> None:
        self.path, self.objects = path, objects

    def load(self) -> int:
        """Number of completed steps; 0 without a checkpoint."""
        if not self.path.exists():
            return 0
        data = torch.load(self.path, map_location="cpu", weights_only=True)
        for name, target in self.objects.items():
            # Early checkpoints have no random state: their stages continue with a fresh one.
            if name in data or not isinstance(target, Chance):
                target.load_state_dict(data[name])
        return int(data["step"])

    def save(self, step: int) -> None:
        data = {name: target.state_dict() for name, target in self.objects.items()}
        self.path.parent.mkdir(parents=True, exist_ok=True)
        part = self.path.with_suffix(".part")
        torch.save(data | {"step": step}, part)
        os.replace(part, self.path)
