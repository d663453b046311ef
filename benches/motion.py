#!/usr/bin/env python3
"""Measures how alive, smooth and steady a program's motion is, with and without layers, compared with people's.

    benches/motion.py target/release/umo SPEECH... [-- OPTIONS OF umo animate]

Runs `umo animate` on the recordings with three seeds: with `--smoothing 0 --layers 0`, with the defaults, with the
prompt `explaining`, and with the least and the most activity; and on 60 s of silence. Prints mean, minimum and maximum
of each number over all takes, beside the bar. Needs numpy and scipy.
"""

import subprocess
import sys
import tempfile
import wave
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import find_peaks
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "training"))
from umo_train.skeleton import ARKIT, JOINT, OFFSETS_M, PARENTS

FRAME_RATE = 30
SEEDS = 3
FEET = [JOINT["left_foot"], JOINT["right_foot"]]
# A foot joint raised by more than this above its usual height is not in contact, metres.
CONTACT_M = 0.025
# A hand slower than this is at rest, metres per second.
STILL_M_S = 0.04
# Eye rotation faster than this is a gaze shift, degrees per second.
SHIFT_DEG_S = 60
# Eye rotation for a gaze shape of 1, degrees.
GAZE_DEG = 30
# A wrist below this height over the pelvis is low, metres.
LOW_M = -0.02
# A gesture phrase: a wrist faster than this, metres per second, or this many frames beside such a frame.
MOVING_M_S, BESIDE = 0.25, 4
# A foot that rises by this much over the floor is lifted, metres.
LIFT_M = 0.02
SILENCE_S = 60

# Required value of a number, for every take or for the mean of all.
BARS = {
    "a hand low, % of time": "20 to 50; activity 0: > 80, 1: < 5",
    "gesture phrases, median, s": "≥ 3",
    "pelvis, rms, degrees": "≥ 7",
    "collars, rms, degrees": "≥ 5.5",
    "knees, rms, degrees": "≥ 6",
    "blinks a minute": "12 to 22",
    "gaze shifts a minute": "20 to 50",
    "both hands still, % of time": "< 3",
    "head, standard deviation of yaw, degrees": "≥ 2.5 (explaining)",
    "head, standard deviation of pitch, degrees": "≥ 2 (explaining)",
    "head, standard deviation of roll, degrees": "≥ 1.5 (explaining)",
    "wrist jerk, 95 %, m/s3": "120 to 260",
    "foot slide in contact, cm/s": "< 0.5",
    "brows lowered with frown, % of frames": "0",
    "drift of the root, cm": "< 15 in 600 s",
    "pelvis in frame 0, m": "within 2 cm of rest",
    "lips, correlation with the model alone": "1",
}


def matrices(axis_angle: np.ndarray) -> np.ndarray:
    """Converts axis-angles `[..., 3]` to matrices `[..., 3, 3]` (Rodrigues)."""
    angle = np.linalg.norm(axis_angle, axis=-1)[..., None, None]
    x, y, z = np.moveaxis(axis_angle, -1, 0)
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).reshape(*axis_angle.shape, 3)
    safe = np.maximum(angle, 1e-9)
    return np.eye(3) + np.sin(angle) / safe * cross + (1 - np.cos(angle)) / safe**2 * (cross @ cross)


def places(rotations: np.ndarray, root: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """World rotation of each joint, `[frames, 55, 3, 3]`, and position, `[frames, 55, 3]`, metres."""
    turned, where = np.empty_like(rotations), np.empty(rotations.shape[:2] + (3,))
    for joint, parent in enumerate(PARENTS):
        if parent < 0:
            turned[:, joint], where[:, joint] = rotations[:, joint], root
        else:
            turned[:, joint] = turned[:, parent] @ rotations[:, joint]
            where[:, joint] = where[:, parent] + turned[:, parent] @ OFFSETS_M[joint]
    return turned, where


def jerk(where: np.ndarray) -> np.ndarray:
    """Third difference, m/s^3."""
    return np.linalg.norm(np.diff(where, 3, axis=0), axis=-1) * FRAME_RATE**3


def face(channels: np.ndarray, seconds: float) -> dict[str, float]:
    """Blinks, gaze shifts and lowered brows from ARKit shapes, `[frames, 52]`."""
    shape = {name: channels[:, index].astype(float) for index, name in enumerate(ARKIT)}
    blinks, _ = find_peaks(np.pad(shape["eyeBlinkLeft"], 1), height=0.6, distance=6)
    across = GAZE_DEG * (shape["eyeLookOutLeft"] - shape["eyeLookInLeft"])
    up = GAZE_DEG * (shape["eyeLookUpLeft"] - shape["eyeLookDownLeft"])
    speed = np.sqrt(np.diff(across) ** 2 + np.diff(up) ** 2) * FRAME_RATE
    shifts, _ = find_peaks(speed, height=SHIFT_DEG_S, distance=4)
    brows = np.minimum(shape["browDownLeft"], shape["browDownRight"])
    frown = np.minimum(shape["mouthFrownLeft"], shape["mouthFrownRight"])
    return {
        "blinks a minute": len(blinks) / seconds * 60,
        "gaze shifts a minute": len(shifts) / seconds * 60,
        "brows lowered with frown, % of frames": 100 * ((brows > 0.15) & (frown > 0.15)).mean(),
    }


def lips(channels: np.ndarray) -> np.ndarray:
    """Mouth opening from ARKit shapes, `[frames, 52]`."""
    return channels[:, ARKIT.index("jawOpen")].astype(float) - channels[:, ARKIT.index("mouthClose")]


def spread(rotations: np.ndarray) -> float:
    """Root mean square of the angles of rotations `[frames, 3, 3]` from their mean, degrees."""
    turns = Rotation.from_matrix(rotations)
    return float(np.degrees(np.sqrt(np.square((turns.mean().inv() * turns).magnitude()).mean())))


def resting(rotations: np.ndarray, hands: np.ndarray, toes: np.ndarray) -> dict[str, float]:
    """Rests, phrases and the body's part in them, from rotations of the joints `[frames, 55, 3, 3]`, the wrists in the
    pelvis' frame `[frames, 2, 3]` and the height of the toes `[frames, 2]`."""
    minutes = len(hands) / FRAME_RATE / 60
    speed = np.linalg.norm(np.gradient(hands, axis=0), axis=-1) * FRAME_RATE
    phrase = np.convolve(speed.max(1) > MOVING_M_S, np.ones(2 * BESIDE + 1), "same") > 0
    lengths = np.diff(np.flatnonzero(np.diff(np.pad(phrase.astype(int), 1))).reshape(-1, 2)) / FRAME_RATE
    lifts = toes - np.percentile(toes.min(1), 20)
    low = 100 * (hands[..., 1] < LOW_M).mean(0)

    def of(*names: str) -> float:
        return float(np.mean([spread(rotations[:, JOINT[name]]) for name in names]))

    return {
        "a hand low, % of time": low.mean(),
        "the left hand low, % of time": low[0],
        "gesture phrases, median, s": np.median(lengths) if len(lengths) else 0.0,
        "gesture phrases a minute": len(lengths) / minutes,
        "path of both wrists, m a minute": speed.sum() / FRAME_RATE / minutes,
        "pelvis, rms, degrees": of("pelvis"),
        "collars, rms, degrees": of("left_collar", "right_collar"),
        "knees, rms, degrees": of("left_knee", "right_knee"),
        "feet lifted a minute": sum(len(find_peaks(foot, height=LIFT_M, distance=8)[0]) for foot in lifts.T) / minutes,
    }


def measure(path: Path) -> dict[str, float]:
    """The numbers of one animation in SMPL-X `.npz` format."""
    file = np.load(path, allow_pickle=True)
    rotations = matrices(file["poses"].reshape(len(file["poses"]), -1, 3)[:, :55].astype(float))
    root = file["trans"].astype(float)
    seconds = len(root) / FRAME_RATE
    (turned, world), (_, body) = places(rotations, root), places(rotations, np.zeros_like(root))
    wrists = [JOINT["left_wrist"], JOINT["right_wrist"]]
    wrist_jerk = jerk(body[:, wrists]).max(1)
    # In the pelvis' frame, as a viewer sees gestures.
    hands = gaussian_filter1d(np.einsum("tji,tkj->tki", turned[:, 0], (body - body[:, :1])[:, wrists]), 1.0, axis=0)
    hand_speed = np.linalg.norm(np.gradient(hands, axis=0), axis=-1) * FRAME_RATE
    head = Rotation.from_matrix(turned[:, JOINT["head"]])
    yaw, pitch, roll = (head.mean().inv() * head).as_euler("YXZ", degrees=True).std(0)
    height = world[:, FEET, 1]
    low = height - np.percentile(height.min(1), 20) < CONTACT_M
    speed = np.linalg.norm(np.diff(world[:, FEET][..., [0, 2]], axis=0), axis=-1) * FRAME_RATE
    second = min(len(root), FRAME_RATE)
    drift = root[-second:].mean(0) - root[:second].mean(0)
    return face(file["arkit"], seconds) | resting(rotations, hands, height) | {
        "both hands still, % of time": 100 * (hand_speed.max(1) < STILL_M_S).mean(),
        "head, standard deviation of yaw, degrees": yaw,
        "head, standard deviation of pitch, degrees": pitch,
        "head, standard deviation of roll, degrees": roll,
        "wrist jerk, median, m/s3": np.percentile(wrist_jerk, 50),
        "wrist jerk, 95 %, m/s3": np.percentile(wrist_jerk, 95),
        "head jerk, 95 %, m/s3": np.percentile(jerk(body[:, JOINT["head"]]), 95),
        "foot slide in contact, cm/s": 100 * speed[low[1:] & low[:-1]].mean(),
        "drift of the root, cm": 100 * np.linalg.norm(drift[[0, 2]]),
        "pelvis, lowest, m": root[:, 1].min(),
        "pelvis, highest, m": root[:, 1].max(),
        "pelvis in frame 0, m": root[0, 1],
    }


def silence(path: Path) -> Path:
    """A silent recording."""
    with wave.open(str(path), "wb") as file:
        file.setparams((1, 2, 16000, 0, "NONE", ""))
        file.writeframes(bytes(2 * 16000 * SILENCE_S))
    return path


def main() -> None:
    arguments, options = sys.argv[1:], []
    if "--" in arguments:
        at = arguments.index("--")
        arguments, options = arguments[:at], arguments[at + 1 :]
    program, recordings = arguments[0], arguments[1:]
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        quiet = [str(silence(Path(folder) / "silence.wav"))]
        columns = {
            "model alone": (recordings, ["--smoothing", "0", "--layers", "0"]),
            "default": (recordings, []),
            "default, `explaining`": (recordings, ["--prompt", "explaining"]),
            "default, activity 0": (recordings, ["--activity", "0"]),
            "default, activity 1": (recordings, ["--activity", "1"]),
            "default, silence": (quiet, []),
        }
        out = Path(folder) / "motion.npz"
        alone = {}
        for name, (speech, settings) in columns.items():
            rows = []
            for recording in speech:
                for seed in range(SEEDS):
                    command = [program, "animate", recording, "-o", str(out), "--seed", str(seed)]
                    subprocess.run(command + settings + options, check=True, stdout=subprocess.DEVNULL)
                    rows.append(measure(out))
                    if speech is recordings and "--prompt" not in settings:
                        opening = lips(np.load(out, allow_pickle=True)["arkit"])
                        same = np.corrcoef(opening, alone.setdefault((recording, seed), opening))[0, 1]
                        rows[-1]["lips, correlation with the model alone"] = same
            found[name] = rows
    print("| | " + " | ".join(found) + " | bar |\n|---" + "|---" * len(found) + "|---|")
    summary: list[tuple[Callable, str]] = [(np.mean, ""), (np.min, " ("), (np.max, " to ")]
    for key in found["default"][0]:
        cells = []
        for rows in found.values():
            values = [row[key] for row in rows if key in row]
            cells.append("".join(f"{before}{of(values):.3g}" for of, before in summary) + ")" if values else "")
        print(f"| {key} | " + " | ".join(cells) + f" | {BARS.get(key, '')} |")


if __name__ == "__main__":
    main()
