"""Writes a performance as the program's `.jsonl` animation, for `umo draw` and `umo view`."""

import json
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from umo_train.performer.eyes import FULL_LOOK
from umo_train.skeleton import ARKIT, JOINT, JOINT_NAMES, OFFSETS_M, PARENTS, SHAPE, VELOCITY, rotations
from umo_train.speech.utterance import FRAME_RATE


def write(path: Path, motion: dict[str, np.ndarray]) -> None:
    """Converts channels of `perform` to an animation of the 55 joints and 52 coefficients."""
    local, face = rotations(motion), motion["face"][:, 6:].astype(np.float64)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        name = side.capitalize()
        yaw = sign * (face[:, SHAPE["eyeLookOut" + name]] - face[:, SHAPE["eyeLookIn" + name]])
        pitch = face[:, SHAPE["eyeLookDown" + name]] - face[:, SHAPE["eyeLookUp" + name]]
        turned = Rotation.from_euler("YX", FULL_LOOK * np.stack([yaw, pitch], -1))
        local[:, JOINT[side + "_eye"]] = turned.as_matrix()
    root = np.zeros((len(local), 3))
    root[1:] = np.cumsum(motion["lower"][:-1, VELOCITY].astype(np.float64), axis=0) / FRAME_RATE
    root[:, 1] = motion["height"]
    quaternions = Rotation.from_matrix(local.reshape(-1, 3, 3)).as_quat().reshape(len(local), -1, 4)
    head = {
        "format": "umo-animation", "version": 1, "frame_rate": float(FRAME_RATE), "frames": len(local),
        "joints": JOINT_NAMES, "parents": PARENTS, "offsets": OFFSETS_M.tolist(),
        "face": {"kind": "arkit", "names": ARKIT},
        "units": {
            "time": "seconds", "offsets": "metres, from the parent joint",
            "translation": "metres, added to the root's offset",
            "rotations": "unit quaternions x y z w, relative to the parent",
        },
        "axes": {"x": "left of the body", "y": "up", "z": "forward", "handedness": "right"},
    }  # fmt: skip
    with path.open("w") as out:
        out.write(json.dumps(head) + "\n")
        for index, (at, turned, shapes) in enumerate(zip(root, quaternions, face, strict=True)):
            frame = {"frame": index, "time": index / FRAME_RATE, "translation": at.round(6).tolist()}
            frame |= {"rotations": turned.round(6).tolist(), "face": shapes.round(5).tolist()}
            out.write(json.dumps(frame) + "\n")
