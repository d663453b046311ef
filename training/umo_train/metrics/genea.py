"""Numbers of the GENEA leaderboard by the definitions of its code (github.com/GENEALeaderboard/objective_metric, which
takes them from EMAGE and Audio2Photoreal): beat alignment, L1 diversity, variance of the pose.

Two things are ours. Joints' places are those of our rest pose. A speed is relative to its joint's mean over the takes
measured; theirs is over BEAT2, in a file that their code fetches. FGD needs their auto-encoder and is left out.
"""

from collections.abc import Sequence

import numpy as np
from scipy.signal import argrelmin
from scipy.spatial.transform import Rotation

from umo_train.metrics.beat import ORDER, SIGMA_S, constancy
from umo_train.metrics.item import Motion
from umo_train.metrics.motion import joint_places
from umo_train.skeleton import JOINTS_OF, rotations
from umo_train.speech.utterance import FRAME_RATE, SAMPLE_RATE

# Frames at both ends of a take that beats leave out.
EDGE = 60
# Share of a joint's mean speed below which a frame has no beat.
LEAST_SPEED = 0.1


def onsets(samples: np.ndarray) -> np.ndarray:
    """Times of onsets, seconds: peaks of the spectral flux, in steps of 32 ms."""
    import librosa

    samples = np.asarray(samples, np.float32)
    return librosa.onset.onset_detect(y=samples, sr=SAMPLE_RATE, hop_length=512, units="time")


def _speeds(motion: Motion) -> np.ndarray:
    at = joint_places(motion, walking=False)[:, JOINTS_OF["upper"]]
    return np.linalg.norm(np.gradient(at, 1 / FRAME_RATE, axis=0), axis=-1)


def beat_alignment(takes: Sequence[tuple[np.ndarray, Motion]]) -> tuple[np.ndarray, np.ndarray]:
    """From each onset to the nearest beat of a joint, and from each beat to the nearest onset, means over the joints of
    the upper body: of each take `[N, 2]`, and its weight in their mean, its frames `[N]`. Takes are `(samples,
    motion)`."""
    speeds = [_speeds(motion) for _, motion in takes]
    usual = np.concatenate(speeds).mean(0)
    out = []
    for (samples, _), speed in zip(takes, speeds, strict=True):
        inner = slice(EDGE, len(speed) - EDGE)
        heard = onsets(samples[EDGE * SAMPLE_RATE // FRAME_RATE : inner.stop * SAMPLE_RATE // FRAME_RATE])
        moved = []
        for joint, fast in enumerate((speed > LEAST_SPEED * usual).T):
            beats = argrelmin(speed[inner, joint], order=ORDER)[0]
            # As in their code, which looks the speed up without the offset of the edge.
            moved.append(beats[fast[beats]] / FRAME_RATE)
        out.append(np.mean([[constancy(heard, b, SIGMA_S), constancy(b, heard, SIGMA_S)] for b in moved], 0))
    return np.array(out), np.array([len(speed) - 2 * EDGE for speed in speeds])


def l1_diversity(motion: Motion) -> float:
    """Sum over joints and axes of the distance of positions to their mean over the take, metres, a frame."""
    at = joint_places(motion, walking=False)
    return float(np.abs(at - at.mean(0)).sum((1, 2)).mean())


def pose_variance(motion: Motion) -> float:
    """Variance over the take of rotation vectors, mean over joints and axes, radians squared."""
    turns = Rotation.from_matrix(rotations(motion).reshape(-1, 3, 3)).as_rotvec()
    return float(turns.reshape(len(motion["face"]), -1).var(0).mean())
