"""Motion of the program `umo` for a recording, as channels of the four parts."""

import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from safetensors.numpy import load_file, save_file
from scipy.io import wavfile
from scipy.spatial.transform import Rotation

from umo_train.metrics.item import Item
from umo_train.skeleton import ARKIT, CHANNELS, CONTACT, JOINTS, JOINTS_OF, PARTS, VELOCITY, rotation_6d
from umo_train.speech.utterance import FRAME_RATE, SAMPLE_RATE


def find(path: Path | None = None) -> Path:
    """The program: the given one, on PATH, or built in this repository."""
    built = Path(__file__).parents[3] / "target/release/umo"
    for candidate in (path, shutil.which("umo"), built):
        if candidate and Path(candidate).is_file():
            return Path(candidate).resolve()
    raise FileNotFoundError(
        f"no program `umo`: build it (cargo build --release) or say where it is; tried {path or built}"
    )


def run(umo: Path, *arguments: object) -> str:
    """Runs the program; raises an error with its output if it fails."""
    done = subprocess.run([str(umo), *map(str, arguments)], capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"umo {arguments[0]}: {done.stderr.strip() or done.returncode}")
    return done.stdout


def from_npz(path: Path) -> dict[str, np.ndarray]:
    """An animation's `.npz` as channels of the parts.

    The file has no contacts: they are 0. Velocity is derived from consecutive frames; height is left out.
    """
    with np.load(path) as file:
        poses, trans = file["poses"].reshape(-1, JOINTS, 3), file["trans"]
        if "arkit" not in file:
            raise ValueError(f"{path}: the face is not ARKit's; lips and prompts need a model with `face.kind` `arkit`")
        order = [list(file["arkit_names"]).index(name) for name in ARKIT]
        arkit = file["arkit"][:, order]
    turns = rotation_6d(Rotation.from_rotvec(poses.reshape(-1, 3)).as_matrix()).reshape(len(poses), JOINTS, 6)
    motion = {part: np.zeros((len(poses), CHANNELS[part]), np.float32) for part in PARTS}
    for part, joints in JOINTS_OF.items():
        motion[part][:, : 6 * len(joints)] = turns[:, joints].reshape(len(poses), -1)
    motion["face"][:, 6:] = arkit
    walked = np.diff(trans, axis=0, append=trans[-1:]) * FRAME_RATE
    walked[:, 1] = 0
    motion["lower"][:, VELOCITY] = walked
    return motion


def animate(
    umo: Path,
    item: Item,
    model: Path | None = None,
    seed: int = 0,
    prompt: str | None = None,
    precision: str | None = None,
    more: Sequence[str] = (),
) -> dict[str, np.ndarray]:
    """Animates an item's speech; by default with the embedded model. `more` are other arguments of the program."""
    with tempfile.TemporaryDirectory(prefix="umo-") as folder:
        speech, made = Path(folder, "speech.wav"), Path(folder, "motion.npz")
        wavfile.write(speech, SAMPLE_RATE, np.asarray(item.samples, np.float32))
        options = ["--seed", seed]
        options += ["--model", model] if model else []
        options += ["--prompt", prompt] if prompt else []
        options += ["--precision", precision] if precision else []
        run(umo, "animate", speech, "-o", made, *options, *more)
        return from_npz(made)


def stage(umo: Path, name: str, tensors: dict[str, np.ndarray], *options: object) -> dict[str, np.ndarray]:
    """Runs a single stage of a model."""
    with tempfile.TemporaryDirectory(prefix="umo-") as folder:
        given, made = Path(folder, "in.safetensors"), Path(folder, "out.safetensors")
        save_file({key: np.ascontiguousarray(value) for key, value in tensors.items()}, given)
        run(umo, "model", "stage", name, "--in", given, "--out", made, *options)
        return load_file(made)


def decode(umo: Path, codes: dict[str, np.ndarray], model: Path | None = None) -> dict[str, np.ndarray]:
    """Motion for codes of each part, `[T]` or in layout `frames` `[T, levels]`, from the model's decoders, with
    velocity and contacts."""
    tensors = {f"codes.{part}": np.asarray(values, np.int64) for part, values in codes.items()}
    made = stage(umo, "motion", tensors, *(["--model", model] if model else []))
    motion = {part: made[f"channels.{part}"] for part in PARTS}
    # The root network's velocity is contained in the position, not in the lower body's own channels.
    walked = np.diff(made["translation"], axis=0, append=made["translation"][-1:]) * FRAME_RATE
    walked[:, 1] = 0
    motion["lower"] = motion["lower"].copy()
    motion["lower"][:, VELOCITY] = walked
    motion["lower"][:, CONTACT] = motion["lower"][:, CONTACT].clip(0, 1)
    return motion
